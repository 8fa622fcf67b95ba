"""How exact vectorized visibility is at mesh vertices, before anything is interpolated.

Traces the polygons of vertices and compares their irradiance, under an environment and under a
uniform sky, with brute force: every texel of the same environment in parts, one ray each, from the
same origins. One row for each way to integrate over the same polygons; "oracle" cuts their edges
shorter than a texel, so that what is left is the error of the polygons themselves. A second table
has the time and size of the precomputation. Targets: 45 dB, 5e-4 pi under the sky, vsat within 1 dB
of the oracle, 5 ms and 2.1 KB a vertex.
"""

import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

import jaxvis
from experiments.output import Output
from experiments.settings import Common, execute, setting
from jaxvis.methods.reference import texel_lights
from jaxvis.methods.vectorized import VisibilityPolygons, tuning
from jaxvis.methods.vectorized.irradiance import Quadrature, irradiance
from jaxvis.methods.vectorized.light import PolygonLight, polygon_light
from jaxvis.methods.vectorized.plan import corner_sites
from jaxvis.methods.vectorized.precompute import Settings as PolygonSettings
from jaxvis.methods.vectorized.precompute import trace_polygons
from jaxvis.methods.vertices import VertexSamples, vertex_samples
from jaxvis.scene import Scene
from jaxvis.sphere.contours import Lookup
from jaxvis.sphere.polygons import uniform_irradiance

BATCH = 8
"""Vertices whose rays are traced together."""

_PER_VERTEX = ("positions", "normals", "origins", "dips")
"""The fields of samples that have a row for each vertex."""


@dataclass(frozen=True)
class Settings(Common):
    scene: tuple[str, ...] = setting(("duck", "teapot", "sponza"), "whose vertices are lit")
    environment: str = setting("stpeters", "what lights them")
    rows: int = setting(128, "of the environment, for both")
    subdivision: int = setting(2, "squared: rays a texel")
    vertices: int = setting(1000, "random ones")
    vectors: int = setting(PolygonSettings().vectors, "most position vectors of a polygon")
    polygons: int = setting(256, "that sharpness is fitted to")


class Polygons(NamedTuple):
    """Polygons of some of a scene's vertices, and what they took."""

    samples: VertexSamples
    visibility: VisibilityPolygons
    seconds: float


def polygons_at(
    scene: Scene, count: int | None, settings: PolygonSettings, seed: int = 0
) -> Polygons:
    """Polygons at ``count`` random vertices, or at all; the tree of the tracer is built before."""
    samples = vertex_samples(scene)
    total = len(samples.positions)
    chosen = np.arange(total)
    if count is not None and count < total:
        chosen = np.sort(np.random.default_rng(seed).choice(total, count, replace=False))
    some = samples._replace(**{name: getattr(samples, name)[chosen] for name in _PER_VERTEX})
    tracer, corners = scene.tracer, scene.positions[scene.triangles]
    start = time.perf_counter()
    vectors, counts = trace_polygons(
        tracer,
        some.positions,
        some.normals,
        origins=some.origins,
        dips=some.dips,
        corners=corners,
        settings=settings,
    )
    seconds = time.perf_counter() - start
    visibility = VisibilityPolygons(
        vectors=jnp.asarray(vectors),
        counts=jnp.asarray(counts),
        positions=jnp.asarray(some.positions),
        normals=jnp.asarray(some.normals),
        triangles=jnp.zeros((0, 3), jnp.int32),
        backs=jnp.zeros((0, 3), jnp.int32),
        buried=jnp.zeros(len(counts), bool),
    )
    return Polygons(some, visibility, seconds)


def brute_force(
    scene: Scene, samples: VertexSamples, environment: jaxvis.Environment, subdivision: int
) -> tuple[Float[np.ndarray, "vertices 3"], Float[np.ndarray, "vertices"]]:
    """Irradiance of the environment and of a uniform sky: ``subdivision``^2 rays a texel."""
    sky = jaxvis.Environment(jnp.ones_like(environment.radiance))
    directions, solid_angles = texel_lights(sky, subdivision)
    radiance = np.asarray(environment.radiance).repeat(subdivision, 0).repeat(subdivision, 1)
    flux = np.concatenate([radiance.reshape(-1, 3), np.ones((radiance[..., 0].size, 1))], axis=-1)
    flux = (flux * solid_angles[:, :1]).astype(np.float32)
    found = []
    for start in range(0, len(samples.positions), BATCH):
        part = slice(start, start + BATCH)
        cosine = np.maximum(samples.normals[part] @ directions.T, 0.0)
        vertex, direction = np.nonzero(cosine)
        blocked = scene.tracer.occluded(samples.origins[part][vertex], directions[direction])
        cosine[vertex[blocked], direction[blocked]] = 0.0
        found.append(cosine @ flux)
    total = np.concatenate(found)
    return total[:, :3], total[:, 3]


def decibels(irradiance: np.ndarray, reference: np.ndarray) -> float:
    """Peak signal-to-noise ratio of linear irradiance; the peak is the largest."""
    error = np.mean(np.square(np.asarray(irradiance, np.float64) - reference))
    return float(10.0 * np.log10(np.max(reference) ** 2 / error))


def at_vertices(
    visibility: VisibilityPolygons, light: PolygonLight, quadrature: Quadrature
) -> Float[np.ndarray, "vertices 3"]:
    """Irradiance at the polygons' own places."""
    sites = corner_sites(visibility, _all(visibility))
    return np.asarray(irradiance(visibility, light, sites, quadrature, light.vector))


def by_oracle(
    visibility: VisibilityPolygons, light: PolygonLight
) -> Float[np.ndarray, "vertices 3"]:
    """The same with edges cut below a texel."""
    outlines = tuning.own_outlines(visibility, jnp.asarray(_all(visibility)))
    return np.asarray(tuning.oracle_irradiance(outlines, visibility.normals, light.vector))


def _all(visibility: VisibilityPolygons) -> Int[np.ndarray, "polygons"]:
    return np.arange(len(visibility.counts), dtype=np.int32)


def integrations(
    visibility: VisibilityPolygons, environment: jaxvis.Environment, polygons: int
) -> dict[str, np.ndarray]:
    """Irradiance by every way to integrate."""
    near = polygon_light(environment, lookup="nearest", sharpness="paper")
    fine = polygon_light(environment, lookup="bilinear", sharpness="paper")
    lights: dict[Lookup, PolygonLight] = {"nearest": near, "bilinear": fine}
    results = {"oracle": by_oracle(visibility, fine)}
    for pieces in (1, 2):
        for lookup, light in lights.items():
            quadrature = Quadrature("split", pieces, lookup)
            results[f"split {pieces} {lookup}"] = at_vertices(visibility, light, quadrature)
    key = jax.random.key(0)
    for lookup, light in lights.items():
        vsat = Quadrature("vsat", 1, lookup)
        results[f"vsat 5.8 {lookup}"] = at_vertices(visibility, light, vsat)
        for scaled in (False, True):
            fit = tuning.fit_sharpness(
                visibility, light, key, scaled=scaled, polygons=polygons, lookup=lookup
            )
            name = f"vsat {fit.sharpness:.3g}{'/edge' if scaled else ''} (tuned) {lookup}"
            results[name] = at_vertices(visibility, tuning.tuned(light, fit), vsat)
        five = replace(light, sharpness=jnp.float32(5.0), scaled=True)
        results[f"vsat 5/edge {lookup}"] = at_vertices(visibility, five, vsat)
    return results


def compare(
    scene: Scene, environment: jaxvis.Environment, settings: Settings
) -> tuple[list[dict[str, object]], dict[str, object]]:
    """The rows of the first table and the one of the second."""
    fine = PolygonSettings(vectors=settings.vectors)
    polygons_at(scene, 256, fine)  # starts the threads
    samples, visibility, seconds = polygons_at(scene, settings.vertices, fine)
    reference, sky = brute_force(scene, samples, environment, settings.subdivision)
    results = integrations(visibility, environment, settings.polygons)
    oracle = decibels(results["oracle"], reference)
    rows = []
    for name, values in results.items():
        dB = decibels(values, reference)
        against = decibels(values, results["oracle"]) if name != "oracle" else np.inf
        rows.append(
            {
                "scene": scene.name,
                "environment": environment.name,
                "integration": name,
                "dB": dB,
                "dB - oracle": dB - oracle,
                "dB against oracle": against,
            }
        )
    outlines = tuning.own_outlines(visibility, jnp.asarray(_all(visibility)))
    uniform = np.asarray(uniform_irradiance(outlines, visibility.normals))
    every = vertex_samples(scene)
    ends = every.triangles.nbytes + every.backs.nbytes
    count = len(visibility.counts)
    error = np.abs(uniform - sky) / np.pi
    return rows, {
        "scene": scene.name,
        "vertices": count,
        "of": len(every.positions),
        "sky mean error/pi": error.mean(),
        "99 %": np.quantile(error, 0.99),
        "largest": error.max(),
        "mean vectors": float(np.mean(np.asarray(visibility.counts))),
        "ms/vertex": 1e3 * seconds / count,
        "bytes/vertex": visibility.nbytes / count + ends / len(every.positions),
    }


def run(settings: Settings, output: Output) -> None:
    """All scenes under one light."""
    environment = jaxvis.load_environment(settings.environment).resize(settings.rows)
    irradiances, costs = [], []
    for name in settings.scene:
        rows, cost = compare(jaxvis.load_scene(name), environment, settings)
        irradiances += rows
        costs.append(cost)
    texels = environment.radiance[..., 0].size
    directions = texels * settings.subdivision**2
    output.say(f"{directions} directions in the sphere, {settings.vectors} vectors")
    output.table("irradiance", "Irradiance at vertices", irradiances)
    output.table("polygons", "Polygons", costs)


if __name__ == "__main__":
    execute(Settings, run, __doc__)
