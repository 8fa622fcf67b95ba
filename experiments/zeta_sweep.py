"""What dividing triangles buys (paper 000, figs. 10, 11 and 13): PSNR, evaluations, frame time.

One row for every zeta and for evaluation at vertices and fragments, on the same visibility, light
and reference. PSNR must rise with zeta and end near the fragment image's. With --out it also writes
the pictures, the reference's among them, and a figure, and a run that was killed goes on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from experiments.measuring import WHITE
from experiments.output import Output, Row
from experiments.settings import execute, setting
from experiments.sweeping import Sweeping, swept
from jaxvis.sweep import Grid, variants


@dataclass(frozen=True)
class Settings(Sweeping):
    scene: tuple[str, ...] = setting(("duck", "teapot"), "what is lit")
    environment: str = setting("stpeters", "what lights it")
    zeta: tuple[float, ...] = setting((0.0, 1.0, 2.0, 3.0, 4.0), "tessellation qualities")
    size: tuple[int, int] = setting((512, 512), "of the images", metavar=("W", "H"))
    vectors: int = setting(128, "most position vectors of a polygon")
    error: float = setting(0.005, "standard error of the reference, relative to its mean")
    own_materials: bool = setting(False, "instead of white diffuse")


def shadings(settings: Settings) -> dict[str, str]:
    """The method of each row, by what the row is called."""

    def method(**parameters: object) -> str:
        (name,) = variants("vectorized", vectors=settings.vectors, **parameters)
        return name

    return {
        "vertex": method(shading="vertex"),
        **{f"zeta {zeta:g}": method(zeta=zeta) for zeta in settings.zeta},
        "fragment": method(shading="fragment"),
    }


def draw(path: Path, rows: Sequence[Row]) -> None:
    """What the rows measured over the tessellation quality, a curve for each scene."""
    figure = Figure((12, 3.6), layout="constrained")
    axes = figure.subplots(1, 3)
    for scene in dict.fromkeys(row["scene"] for row in rows):
        part = [row for row in rows if row["scene"] == scene]
        shading = [row["shading"] for row in part]
        for axis, column in zip(axes, ("PSNR dB", "evaluations", "frame s"), strict=True):
            axis.plot(shading, [row[column] for row in part], marker="o", label=scene)
            axis.set_ylabel(column)
            axis.tick_params(axis="x", rotation=45)
    axes[1].set_yscale("log")
    axes[2].set_yscale("log")
    axes[0].legend()
    figure.savefig(path, dpi=120)


def run(settings: Settings, output: Output) -> None:
    """All scenes under one light."""
    methods = shadings(settings)
    shading_of = {method: shading for shading, method in methods.items()}
    grid = Grid(
        tuple(methods.values()),
        settings.scene,
        (settings.environment,),
        size=settings.size,
        albedo=None if settings.own_materials else WHITE,
        reference=f"reference:error={settings.error}",
    )
    pictured = output.folder is not None
    rows = []
    with swept(grid, settings, output, images=pictured) as found:
        for row in found.rows:
            shading = shading_of[row["method"]]
            rows.append(
                {
                    "scene": row["scene"],
                    "shading": shading,
                    "PSNR dB": row["psnr_db"],
                    "evaluations": row["evaluations"],
                    "frame s": row["frame_s"],
                }
            )
            if pictured:
                found.write_pictures(output, row, shading)
        size = f"{settings.size[0]} x {settings.size[1]}"
        output.say(f"{settings.environment}, {size}, {settings.vectors} vectors")
        output.table("sweep", "Over the tessellation quality", rows)
    path = output.path("zeta_sweep.png")
    if path is not None:
        draw(path, rows)


if __name__ == "__main__":
    execute(Settings, run, __doc__)
