"""What spherical Gaussians cost in accuracy: visible parts, lights and reflectance (paper 002).

Four tables. Integrals of lobes over the visible part of random masks against the exact sum over
their texels, in units of the lobe: the half-space at the axis, coverage of cells, iso-lines of
cells (eq. 5). Lights fitted by few lobes (eq. 2). Lights as the lobes of an adaptive partition: the
error of shadowed irradiance on random masks. Specular lobes against the exact models.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import scipy.ndimage
from jaxtyping import Array, Bool, Float

import jaxvis
from experiments.measuring import Row
from experiments.output import Output
from experiments.settings import Common, execute, setting
from jaxvis.lighting import Environment, cell_gaussians, fit_gaussians
from jaxvis.lighting.gaussians import LUMINANCE
from jaxvis.reflectance import (
    BlinnPhong,
    CookTorrance,
    MaterialValues,
    Phong,
    Reflectance,
    specular_lobe,
)
from jaxvis.sphere import SphericalGaussians, hemisphere_grid, latlong, visibility_integrals
from jaxvis.sphere.distance_transform import hemispherical_distance
from jaxvis.sphere.gaussians import visible_share

SIZE = 128


@dataclass(frozen=True)
class Settings(Common):
    environment: tuple[str, ...] = setting(("windows", "sky", "stpeters"), "lights that are fitted")
    rows: int = setting(128, "of the environments")
    lobes: tuple[int, ...] = setting((8, 16, 32, 64), "fitted")
    steps: int = setting(2000, "of the fit")
    cells: tuple[int, ...] = setting((64, 128, 256, 512, 1024), "of an adaptive partition")
    masks: int = setting(24, "random ones")
    roughness: tuple[float, ...] = setting((0.2, 0.4, 0.6, 0.8), "of specular lobes")


def random_masks(count: int, seed: int = 0) -> Bool[np.ndarray, "masks n n"]:
    """Smooth blobs of 6 to 16 texels that leave 20 to 80 % visible."""
    random = np.random.default_rng(seed)
    masks = []
    for _ in range(count):
        noise, width = random.normal(size=(SIZE, SIZE)), random.uniform(6.0, 16.0)
        smooth = scipy.ndimage.gaussian_filter(noise, width, mode="nearest")
        masks.append(smooth > np.quantile(smooth, random.uniform(0.2, 0.8)))
    return np.stack(masks)


def upper_directions(count: int, seed: int = 1) -> Float[np.ndarray, "directions 3"]:
    random = np.random.default_rng(seed).normal(size=(count, 3))
    random[:, 2] = np.abs(random[:, 2]) + 0.3
    return (random / np.linalg.norm(random, axis=1, keepdims=True)).astype(np.float32)


@partial(jax.jit, static_argnames=("name", "cells"))
def by_cells(
    distances: Float[Array, "masks n n"],
    axes: Float[Array, "lobes 3"],
    sharpness: float,
    name: str,
    cells: int,
) -> Float[Array, "masks lobes"]:
    """Integrals of lobes of amplitude 1 by coverage or iso-lines."""
    integral = getattr(visibility_integrals, name)
    integrand = partial(_lobes, axes, sharpness)
    return jax.lax.map(lambda map_: integral(map_, integrand, cells), distances)


def _lobes(axes: Array, sharpness: float, directions: Array) -> Array:
    return jnp.exp(sharpness * (directions @ axes.T - 1.0))


def visibility_table(masks: int) -> list[Row]:
    """Mean errors (the half-space's largest, too) in percent of the lobe's integral."""
    visible, axes = random_masks(masks), jnp.asarray(upper_directions(32))
    distances = hemispherical_distance(jnp.asarray(visible))
    angles = np.repeat(hemisphere_grid.texel_solid_angles(SIZE), SIZE)
    towards = hemisphere_grid.texel_directions(SIZE).reshape(-1, 3)
    rows = []
    for sharpness in (5.0, 20.0, 100.0, 500.0):
        values = np.exp(sharpness * (towards @ np.asarray(axes).T - 1.0)) * angles[:, None]
        exact = visible.reshape(masks, -1) @ values
        whole = 2.0 * np.pi / sharpness
        lobes = SphericalGaussians(axes, jnp.full(len(axes), sharpness), jnp.ones((len(axes), 1)))
        halves = jax.vmap(visibility_integrals.half_space_integral, (0, None))(distances, lobes)
        error = 100.0 * np.abs(halves[..., 0] - exact) / whole
        row = {"sharpness": sharpness, "half-space": error.mean(), "largest": error.max()}
        for cells in (16, 32, 64):
            for name in ("coverage", "isoline"):
                found = by_cells(distances, axes, sharpness, f"{name}_integral", cells)
                row[f"{name} {cells}"] = 100.0 * np.abs(found - exact).mean() / whole
        rows.append(row)
    return rows


def fit_table(environments: list[Environment], counts: Sequence[int], steps: int) -> list[Row]:
    """Residuals over the number of lobes; seconds where the fit did not come from the cache."""
    rows = []
    for environment in environments:
        for count in counts:
            start = time.perf_counter()
            fit = fit_gaussians(environment, count, steps)
            rows.append(
                {
                    "environment": environment.name,
                    "lobes": count,
                    "residual": fit.residual,
                    "weighted": fit.weighted_residual,
                    "energy before": np.mean(fit.energy),
                    "s": time.perf_counter() - start,
                }
            )
    return rows


def cell_table(environments: list[Environment], counts: Sequence[int], masks: int) -> list[Row]:
    """Errors of irradiance behind random masks, in percent of its root mean square."""
    visible = random_masks(masks, seed=2)
    distances = hemispherical_distance(jnp.asarray(visible))
    random = np.random.default_rng(3)
    turns = np.linalg.qr(random.normal(size=(masks, 3, 3)))[0]
    rows = []
    for environment in environments:
        exact = np.array(
            [shadowed(environment, turn, mask) for turn, mask in zip(turns, visible, strict=True)]
        )
        for count in counts:
            start = time.perf_counter()
            lobes = cell_gaussians(environment, count)
            seconds = time.perf_counter() - start
            energy = np.asarray(lobes.integral()) @ LUMINANCE
            found = []
            for turn, map_ in zip(turns, distances, strict=True):
                axes = jnp.asarray(np.asarray(lobes.axis) @ turn.T, jnp.float32)
                share = visible_share(visibility_integrals.distance_at(map_, axes), lobes.sharpness)
                found.append(np.sum(energy * np.asarray(share * jnp.maximum(axes[:, 2], 0.0))))
            error = np.sqrt(np.mean((np.array(found) - exact) ** 2) / np.mean(exact**2))
            bias = np.mean(np.array(found) - exact) / np.sqrt(np.mean(exact**2))
            rows.append(
                {
                    "environment": environment.name,
                    "cells": count,
                    "error %": 100.0 * error,
                    "bias %": 100.0 * bias,
                    "s": seconds,
                }
            )
    return rows


def shadowed(environment: Environment, turn: np.ndarray, mask: np.ndarray) -> float:
    """Luminous irradiance through a mask, texel by texel."""
    height, width = environment.height, environment.width
    local = latlong.texel_directions(height, width) @ turn.T
    angles = latlong.row_solid_angles(height, width)[:, None]
    theta, phi = np.arccos(local[..., 0]), np.arctan2(local[..., 2], local[..., 1])
    row, column = (np.clip((a * (SIZE / np.pi)).astype(int), 0, SIZE - 1) for a in (theta, phi))
    light = np.asarray(environment.radiance, np.float64) @ LUMINANCE
    return float(np.sum(light * angles * mask[row, column] * np.maximum(local[..., 2], 0.0)))


def lobe_table(roughnesses: Sequence[float]) -> list[Row]:
    """Energy and shape of specular lobes against the exact models, in percent."""
    models: dict[str, Reflectance] = {
        "Phong": Phong(),
        "Blinn-Phong": BlinnPhong(),
        "Beckmann": CookTorrance("beckmann"),
        "GGX": CookTorrance("ggx"),
    }
    rows = []
    for name, model in models.items():
        for roughness in roughnesses:
            row: Row = {"model": name, "roughness": roughness}
            for degrees in (0, 30, 60, 75):
                energy, shape = lobe_errors(model, roughness, degrees)
                row[f"energy {degrees}"], row[f"shape {degrees}"] = energy, shape
            rows.append(row)
    return rows


def lobe_errors(model: Reflectance, roughness: float, degrees: float) -> tuple[float, float]:
    """Of the energy, and root mean square over that of the model, in percent."""
    angle = np.radians(degrees)
    normal = jnp.array([0.0, 0.0, 1.0])
    view = jnp.asarray([np.sin(angle), 0.0, np.cos(angle)], jnp.float32)
    material = MaterialValues(jnp.zeros(3), jnp.full(3, 0.4), jnp.float32(roughness))
    lobe = specular_lobe(model, material, normal, view)
    # Rings about the mirror direction, dense where narrow lobes are.
    t = (np.arange(300) + 0.5) / 300
    theta, phi = np.pi * t**3, 2.0 * np.pi * (np.arange(600) + 0.5) / 600
    weight = (3.0 * np.pi * t**2 * np.sin(theta))[:, None] * (2.0 * np.pi / 600 / 300)
    ring = np.sin(theta)[:, None]
    across, aside, along = ring * np.cos(phi), ring * np.sin(phi), np.cos(theta)[:, None]
    mirror = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    upwards = np.array([np.cos(angle), 0.0, np.sin(angle)])
    light = along[..., None] * mirror + across[..., None] * upwards
    light = jnp.asarray(light + aside[..., None] * np.array([0.0, 1.0, 0.0]), jnp.float32)
    exact = np.asarray(_evaluate(model, material, normal, view, light), np.float64)[..., 0]
    found = np.asarray(lobe.evaluate(light), np.float64)[..., 0]
    energy = np.sum(weight * found) / np.sum(weight * exact) - 1.0
    square = np.sum(weight * (found - exact) ** 2) / np.sum(weight * exact**2)
    return 100.0 * float(energy), 100.0 * float(np.sqrt(square))


@partial(jax.jit, static_argnames="model")
def _evaluate(
    model: Reflectance, material: MaterialValues, normal: Array, view: Array, light: Array
) -> Array:
    return model.evaluate(material, normal, view, light)


def measure(settings: Settings, output: Output) -> None:
    """All four tables."""
    environments = [jaxvis.load_environment(e).resize(settings.rows) for e in settings.environment]
    output.table(
        "visibility",
        "Visible part of lobes: mean error in % of the lobe",
        visibility_table(settings.masks),
    )
    output.table("fits", "Fitted lobes", fit_table(environments, settings.lobes, settings.steps))
    output.table(
        "cells",
        "Lobes of cells: shadowed irradiance",
        cell_table(environments, settings.cells, settings.masks),
    )
    output.table(
        "specular",
        "Specular lobes: errors in %, view at 0 to 75 degrees",
        lobe_table(settings.roughness),
    )


if __name__ == "__main__":
    execute(Settings, measure, __doc__)
