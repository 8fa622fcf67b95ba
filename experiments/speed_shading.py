"""How fast light is integrated over visibility polygons, beside what the memory allows.

First table: rows a second that jnp.take fetches from the real table of nine channels, in as many
threads and rows a call as shading uses: random rows, and the very rows that polygons need. Second
table: polygons of the full number of vectors a second for each integration, the rows that each
needs, and rows x polygons a second over the rate of random rows. Targets: a share of 0.5, and
80,000 polygons a second for the fastest.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

import jaxvis
from experiments.measuring import best_of
from experiments.output import Output
from experiments.settings import Common, execute, setting
from experiments.vertex_irradiance import polygons_at
from jaxvis.methods.vectorized import VisibilityPolygons
from jaxvis.methods.vectorized.evaluation import LOOKUPS_PER_CHUNK, THREADS, References, Sites
from jaxvis.methods.vectorized.irradiance import Quadrature, irradiance, irradiance_lookups
from jaxvis.methods.vectorized.light import PolygonLight, polygon_light
from jaxvis.methods.vectorized.plan import corner_sites
from jaxvis.methods.vectorized.precompute import Settings as PolygonSettings
from jaxvis.sphere.contours import ContourTable

QUADRATURES = (
    Quadrature("split", 1, "nearest"),
    Quadrature("split", 2, "nearest"),
    Quadrature("split", 1, "bilinear"),
    Quadrature("split", 2, "bilinear"),
    Quadrature("vsat", 1, "nearest"),
    Quadrature("vsat", 1, "bilinear"),
)


@dataclass(frozen=True)
class Settings(Common):
    scene: str = setting("teapot", "whose polygons are taken")
    environment: str = setting("stpeters", "what is integrated over them")
    vectors: int = setting(128, "most position vectors of a polygon")
    polygons: int = setting(16384, "polygons that are evaluated")
    repeats: int = setting(7, "rounds of timing")


@jax.jit
def gather(
    rows: Int[Array, "rows channels"], index: Int[Array, "lookups"]
) -> Int[Array, "lookups channels"]:
    """The raw fetch: nothing is added up."""
    return jnp.take(rows, index, axis=0, mode="clip")


def gather_rates(table: ContourTable, indices: dict[str, np.ndarray], repeats: int) -> dict:
    """Rows a second for each array of indices [calls, lookups], the calls shared among threads."""
    rows = table.corners.reshape(-1, table.corners.shape[-1])
    pool = ThreadPoolExecutor(THREADS)
    calls = {name: [jnp.asarray(i, jnp.int32) for i in index] for name, index in indices.items()}

    def fetch(name: str) -> None:
        list(pool.map(lambda index: gather(rows, index).block_until_ready(), calls[name]))

    seconds = best_of(repeats, *(lambda name=name: fetch(name) for name in calls))
    return {name: indices[name].size / s for name, s in zip(calls, seconds, strict=True)}


def own_rows(visibility: VisibilityPolygons, light: PolygonLight, sites: Sites) -> np.ndarray:
    """Rows that shading fetches for whole chunks of polygons, [chunks, lookups]."""
    quadrature, size = QUADRATURES[0], visibility.capacity
    chunk = LOOKUPS_PER_CHUNK // (quadrature.lookups_per_vector * size)
    found = []
    for start in range(0, len(sites.polygon) - chunk + 1, chunk):
        some = sites.take(np.arange(start, start + chunk))
        seen = References(some.polygon[:, 0], *some[:3], ())
        lookups = irradiance_lookups(
            visibility.vectors, light, seen, size=size, quadrature=quadrature
        )
        found.append(np.asarray(lookups.index).reshape(-1))
    return np.stack(found)


def full_sites(visibility: VisibilityPolygons, count: int) -> Sites:
    """``count`` sites whose polygons count as long as the capacity, again and again."""
    full = np.flatnonzero(np.asarray(visibility.counts) > 0.75 * visibility.capacity)
    if not len(full):
        raise ValueError("no polygon has enough vectors: use a scene with more occlusion")
    return corner_sites(visibility, np.resize(full, count).astype(np.int32))


def run(settings: Settings, output: Output) -> None:
    """Rates of fetching, and of every integration."""
    environment = jaxvis.load_environment(settings.environment)
    scene = jaxvis.load_scene(settings.scene)
    fine = PolygonSettings(vectors=settings.vectors)
    visibility = polygons_at(scene, 2048, fine).visibility
    sites = full_sites(visibility, settings.polygons)
    lights = {
        lookup: polygon_light(environment, lookup=lookup) for lookup in ("nearest", "bilinear")
    }
    table = lights["nearest"].vector
    own = own_rows(visibility, lights["nearest"], sites)
    random = np.random.default_rng(0).integers(0, table.corners[..., 0].size, own.shape)

    def evaluate(quadrature: Quadrature) -> None:
        light = lights[quadrature.lookup]
        np.asarray(irradiance(visibility, light, sites, quadrature, light.vector))

    for quadrature in QUADRATURES:
        evaluate(quadrature)  # compiles
    gather_rates(table, {"random": random}, 1)
    rates = gather_rates(table, {"random": random, "own": own}, settings.repeats)
    seconds = best_of(settings.repeats, *(lambda q=q: evaluate(q) for q in QUADRATURES))
    again = gather_rates(table, {"random": random, "own": own}, settings.repeats)
    raw = {name: max(rates[name], again[name]) for name in rates}
    rows = []
    for quadrature, duration in zip(QUADRATURES, seconds, strict=True):
        needed = quadrature.lookups_per_vector * visibility.capacity
        rate = len(sites.polygon) / duration
        rows.append(
            {
                "integration": quadrature.integration,
                "pieces": quadrature.pieces,
                "lookup": quadrature.lookup,
                "rows/polygon": needed,
                "polygons/s": rate,
                "M rows/s": rate * needed / 1e6,
                "share of random": rate * needed / raw["random"],
                "share of own": rate * needed / raw["own"],
            }
        )
    output.say(
        f"{scene.name}, {environment.name}, table {table.corners.shape}, {THREADS} threads, "
        f"{own.shape[1]} rows a call, {len(sites.polygon)} polygons of {visibility.capacity}"
    )
    fetched = [{"rows": name, "M rows/s": rate / 1e6} for name, rate in raw.items()]
    output.table("fetched", "Rows fetched", fetched)
    output.table("integrals", "Integrals", rows)


if __name__ == "__main__":
    execute(Settings, run, __doc__)
