"""Pictures of visibility correspondence: entity layouts, Voronoi diagrams and seams (paper 000)."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64, Int
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from scipy.spatial import KDTree

from jaxvis.methods.vectorized.correspondence.candidates import (
    JITTER,
    Layout,
    hull_facets,
    layout,
    tripoint_distance,
)
from jaxvis.methods.vectorized.correspondence.triples import CorrespondingPolygons
from jaxvis.methods.vectorized.mesh import Mesh

CORNER_COLOURS = ("#d6423b", "#2f9e44", "#3b6fd6")
"""Of the three corners: the paper's red, green and blue."""

CELL_PIXELS = 1000
"""Along the picture of Voronoi cells."""

PALE, DARK = 0.62, 0.25
"""How far the colours of cells and their borders are from the corners', towards white and black."""

SEAM_RANGE = (1e-4, 100.0)
"""Ends of the scale of seams, in per cent; what lies outside counts as an end."""

SEAM_COLOURS = ("#4c78a8", "#f58518", "#54a24b")


class Tripoints(NamedTuple):
    """Voronoi vertices between cells of three colours."""

    directions: Float64[np.ndarray, "tripoints 3"]
    triples: Int[np.ndarray, "tripoints 3"]
    """Entities of the three corners."""
    distances: Float64[np.ndarray, "tripoints"]
    """D_RGB (paper 000, eq. 22), in radians."""


def draw_correspondence(
    visibility: CorrespondingPolygons, triangle: int, ink: str = "#222222"
) -> Figure:
    """The entity layout of a triangle, and the Voronoi diagram that its triples come from.

    Left (paper 000, fig. 3): a column of dots for each corner, one dot for each entity, from the
    list's first triple on and, hollow, the first one again; lines are triples, strong where they
    are evaluated. Right (fig. 2): who has the nearest vector, as seen from the middle of the
    triangle, in an equal-area view of the hemisphere over it, and the RGB tripoints.

    Args:
        visibility: the correspondence.
        triangle: its number; backs count on after the last front.
        ink: colour of text.

    Raises:
        ValueError: there is no such triangle, or it has no polygons.
    """
    mesh = Mesh.of(visibility.polygons)
    faces = len(visibility.separate)
    if not 0 <= triangle < faces:
        raise ValueError(f"triangle must be from 0 to {faces - 1}, got {triangle}")
    if (mesh.faces[triangle] < 0).any():
        raise ValueError(f"triangle {triangle} has no polygons: its material has one side only")
    seen = seen_from_centre(visibility, triangle)
    figure = Figure((12.0, 8.4))
    figure.set_facecolor("none")
    left = figure.add_axes((0.035, 0.05, 0.27, 0.86))
    right = figure.add_axes((0.33, 0.05, 0.655, 0.86))
    _draw_layout(left, visibility, triangle, np.asarray(seen.counts[0]), ink)
    _draw_voronoi(right, seen, _up(mesh, triangle), ink)
    return figure


def seen_from_centre(visibility: CorrespondingPolygons, triangle: int) -> Layout:
    """What a triangle's three corners see, seen from its centre: a layout of one face."""
    polygons = visibility.polygons
    corners = Mesh.of(polygons).faces[[triangle]]
    centre = np.asarray(polygons.positions, np.float64)[corners].mean(axis=1)
    return layout(np.asarray(polygons.vectors), np.asarray(polygons.counts), corners, centre)


def tripoints(seen: Layout) -> Tripoints:
    """The RGB tripoints of the first face of a layout: outward normals of the hull's facets."""
    counts = np.asarray(seen.counts[0])
    sites = np.concatenate([seen.directions[0, k, : counts[k]] for k in range(3)])
    starts = np.concatenate([[0], np.cumsum(counts)])
    jitter = JITTER * np.random.default_rng(0).standard_normal((len(sites) + 6, 3))
    points, facets = hull_facets(sites, jitter)
    facets = np.sort(facets, axis=1)
    colours = np.searchsorted(starts, facets, side="right") - 1
    facets = facets[(colours == [0, 1, 2]).all(axis=1)]
    a, b, c = (points[facets[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal *= np.sign(np.einsum("tc,tc->t", normal, a + b + c))[:, None]
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return Tripoints(normal / length, facets - starts[:3], tripoint_distance(a, b, c))


def unrolled(
    triples: Int[np.ndarray, "triples 3"], counts: Int[np.ndarray, "3"]
) -> Int[np.ndarray, "triples_and_end 3"]:
    """Steps along each polygon from a list's first triple to each, and to the first's return."""
    closed = np.concatenate([triples, triples[:1]]).astype(np.int64)
    steps = np.diff(closed, axis=0) % counts
    return np.concatenate([np.zeros((1, 3), np.int64), np.cumsum(steps, axis=0)])


def entity_heights(
    steps: Int[np.ndarray, "triples_and_end"],
) -> Float64[np.ndarray, "entities_and_end"]:
    """Where entities lie along a list, from 0 to 1: in the middle of the triples that know them."""
    places = np.linspace(0.0, 1.0, len(steps))
    return np.bincount(steps, places) / np.bincount(steps)


def _draw_layout(
    axes: Axes,
    visibility: CorrespondingPolygons,
    triangle: int,
    counts: Int[np.ndarray, "3"],
    ink: str,
) -> None:
    starts = np.asarray(visibility.starts)
    own = slice(starts[triangle], starts[triangle + 1])
    triples = np.asarray(visibility.triples)[own]
    evaluated = np.asarray(visibility.evaluated)[own]
    steps = unrolled(triples, counts) if len(triples) else None
    heights = [np.linspace(0.0, 1.0, n + 1) for n in counts]
    title = "no triples: three evaluations"
    if steps is not None:
        heights = [entity_heights(steps[:, k]) for k in range(3)]
        ends = np.stack([heights[k][steps[:, k]] for k in range(3)], axis=-1)
        marked = np.append(evaluated, evaluated[0])
        for chosen, alpha, width in ((~marked, 0.28, 0.6), (marked, 0.85, 0.9)):
            lines = [np.stack([np.arange(3), end], axis=-1) for end in ends[chosen]]
            axes.add_collection(LineCollection(lines, colors=ink, alpha=alpha, linewidths=width))
        title = f"{len(triples)} triples, {np.count_nonzero(evaluated)} evaluated (strong lines)"
    for k, colour in enumerate(CORNER_COLOURS):
        at, height = np.full(len(heights[k]), float(k)), heights[k]
        filled = np.arange(len(height)) < counts[k]
        faces = [colour if own else "none" for own in filled]
        axes.scatter(
            at, height, s=12, facecolors=faces, edgecolors=colour, linewidths=0.8, zorder=3
        )
        axes.text(k, -0.012, f"{counts[k]}", color=colour, ha="center", va="bottom", fontsize=10)
    axes.set_title(f"Entity layout of triangle {triangle}\n{title}", color=ink, fontsize=11)
    axes.set_xlim(-0.15, 2.15)
    axes.set_ylim(1.01, -0.04)
    axes.set_axis_off()


def _draw_voronoi(axes: Axes, seen: Layout, up: Float[np.ndarray, "3"], ink: str) -> None:
    counts = seen.counts[0]
    frame = _frame(up)
    sites = np.concatenate([seen.directions[0, k, : counts[k]] for k in range(3)])
    corner = np.repeat(np.arange(3), counts)
    picture = axes.imshow(
        voronoi_picture(sites, corner, frame),
        extent=(-1.0, 1.0, -1.0, 1.0),
        interpolation="antialiased",
    )
    rim = Circle((0.0, 0.0), 1.0, facecolor="none", edgecolor=ink, linewidth=1.0)
    axes.add_patch(rim)
    picture.set_clip_path(rim)
    for k, colour in enumerate(CORNER_COLOURS):
        at, above = equal_area(seen.directions[0, k, : counts[k]], frame)
        axes.scatter(
            *at[above].T, s=13, color=colour, edgecolors="#ffffff", linewidths=0.4, zorder=3
        )
    found = tripoints(seen)
    at, above = equal_area(found.directions, frame)
    axes.scatter(
        *at[above].T, s=17, facecolors="#ffffff", edgecolors="#000000", linewidths=0.7, zorder=4
    )
    title = f"{len(found.triples)} RGB tripoints, {np.count_nonzero(above)} above the horizon"
    axes.set_title(f"Voronoi diagram of the three polygons\n{title}", color=ink, fontsize=11)
    axes.set_xlim(-1.02, 1.02)
    axes.set_ylim(-1.02, 1.02)
    axes.set_aspect("equal")
    axes.set_axis_off()


def equal_area(
    directions: Float[np.ndarray, "points 3"], frame: Float[np.ndarray, "3 3"]
) -> tuple[Float64[np.ndarray, "points 2"], np.ndarray]:
    """(places in a disc of radius 1, whether they are in it) of unit vectors.

    Lambert's azimuthal projection of the hemisphere about the frame's third row.
    """
    local = np.asarray(directions, np.float64) @ frame.T
    scale = 1.0 / np.sqrt(np.maximum(1.0 + local[:, 2], 1e-12))
    return local[:, :2] * scale[:, None], local[:, 2] >= 0.0


def voronoi_picture(
    sites: Float[np.ndarray, "sites 3"],
    corner: Int[np.ndarray, "sites"],
    frame: Float[np.ndarray, "3 3"],
    pixels: int = CELL_PIXELS,
) -> Float[np.ndarray, "rows columns 4"]:
    """The colour of the nearest site in each direction, darker on the borders of cells.

    The projection is that of :func:`equal_area`; transparent outside its disc.
    """
    centres = (np.arange(pixels) + 0.5) / (0.5 * pixels) - 1.0
    x, y = np.meshgrid(centres, -centres)
    square = x * x + y * y
    reach = np.sqrt(np.maximum(2.0 - square, 0.0))
    directions = np.stack([x * reach, y * reach, 1.0 - square], axis=-1) @ frame
    found = KDTree(sites).query(directions.reshape(-1, 3))[1]
    nearest = np.asarray(found).reshape(square.shape)
    pure = np.array([to_rgb(colour) for colour in CORNER_COLOURS])
    colours = (pure + PALE * (1.0 - pure))[corner[nearest]]
    border = np.zeros(square.shape, bool)
    border[:, 1:] |= nearest[:, 1:] != nearest[:, :-1]
    border[1:] |= nearest[1:] != nearest[:-1]
    colours[border] = (pure * (1.0 - DARK))[corner[nearest[border]]]
    inside = square <= 1.0
    return np.concatenate([colours, inside[..., None].astype(float)], axis=-1)


def _up(mesh: Mesh, triangle: int) -> Float[np.ndarray, "3"]:
    """The normal of a face."""
    count = len(mesh.planes)
    return mesh.planes[triangle % count].astype(np.float64) * (1.0 if triangle < count else -1.0)


def _frame(up: Float[np.ndarray, "3"]) -> Float64[np.ndarray, "3 3"]:
    """Right, up and towards the reader in the picture; up is the world's +Y where it can be."""
    toward = np.array([0.0, 1.0, 0.0]) if abs(up[1]) < 0.95 else np.array([0.0, 0.0, -1.0])
    across = np.cross(toward, up)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(up, across), up])


def draw_seams(seams: Mapping[str, Float64[np.ndarray, "edges"]], ink: str = "#222222") -> Figure:
    """How many of the mesh's inner edges have which difference between their two sides.

    Args:
        seams: differences in % of the image's mean irradiance, by what makes them; the first are
            filled, the others lines.
        ink: colour of axes and text.
    """
    figure = Figure((8.4, 3.4))
    axes = figure.add_axes((0.085, 0.17, 0.89, 0.8))
    figure.set_facecolor("none")
    axes.set_facecolor("none")
    ends = np.geomspace(*SEAM_RANGE, 49)
    for i, (name, percent) in enumerate(seams.items()):
        if len(percent):
            summary = (
                f"{name}: mean {percent.mean():.2g} %, 95 % below "
                f"{np.quantile(percent, 0.95):.2g} %, largest {percent.max():.2g} %"
            )
            shares = np.histogram(np.clip(percent, *SEAM_RANGE), ends)[0] * (100.0 / len(percent))
            axes.stairs(shares, ends, fill=i == 0, color=SEAM_COLOURS[i], lw=1.6, label=summary)
    axes.set_xscale("log")
    axes.set_xlim(*SEAM_RANGE)
    axes.set_ylim(0.0, 1.35 * axes.get_ylim()[1])
    axes.set_xlabel("difference between the sides, % of the image's mean irradiance", color=ink)
    axes.set_ylabel("% of the inner edges", color=ink)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.tick_params(which="both", colors=ink, labelcolor=ink)
    axes.legend(loc="upper left", frameon=False, labelcolor=ink, fontsize=9)
    for name, spine in axes.spines.items():
        spine.set_visible(name in ("left", "bottom"))
        spine.set_color(ink)
    return figure
