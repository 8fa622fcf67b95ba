"""Masks and dilation done one ray and one texel at a time: slow, and read off the paper."""

from collections import defaultdict

import jax.numpy as jnp
import numpy as np

from jaxvis.methods.visibility_field.build import DRAWN, Settings
from jaxvis.methods.visibility_field.grid import Grid
from jaxvis.methods.visibility_field.samples import Surface, draw
from jaxvis.sampling import hammersley
from jaxvis.sampling.hemisphere import sample_uniform
from jaxvis.scene import Scene
from jaxvis.sphere import octahedral
from jaxvis.sphere.frames import to_world


def all_samples(scene: Scene, settings: Settings):
    """The samples that trace_masks draws, in the order in which they are drawn."""
    grid = Grid.covering(scene.positions, settings.edge)
    surface = Surface.of(scene, grid, settings.sampling)
    for first in range(0, settings.samples, DRAWN):
        last = min(first + DRAWN, settings.samples)
        drawn = draw(surface, grid, first, last, total=settings.samples, seed=settings.seed)
        yield from zip(*drawn, strict=True)


def sample_directions(normal, angle, rays):
    """Directions of a sample's rays (Algorithm 1), by array code."""
    x, y, z = np.asarray(sample_uniform(hammersley(rays)), np.float64).T
    cosine, sine = np.cos(np.float64(angle)), np.sin(np.float64(angle))
    turned = np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=-1)
    return np.asarray(to_world(jnp.asarray(turned, jnp.float32), jnp.asarray(normal)))


def traced_masks(scene: Scene, settings: Settings):
    """Sets of visible and of occluded texels by cell (paper 001, eqs. 1 to 6)."""
    visible, occluded = defaultdict(set), defaultdict(set)
    for origin, normal, angle, cell in all_samples(scene, settings):
        directions = sample_directions(normal, angle, settings.rays)
        blocked = scene.tracer.occluded(np.tile(origin, (len(directions), 1)), directions)
        i, j = octahedral.texel(jnp.asarray(directions), settings.size)
        texels = np.asarray(i * settings.size + j)
        for texel, is_blocked in zip(texels.tolist(), blocked.tolist(), strict=True):
            (occluded if is_blocked else visible)[int(cell)].add(texel)
    return visible, occluded


def sets(keys, bits):
    """Masks as :func:`traced_masks` gives them."""
    found = zip(keys.tolist(), bits, strict=True)
    return {key: set(np.flatnonzero(row).tolist()) for key, row in found if row.any()}


def touching(size: int):
    """Whether two texels share a corner on the sphere (and each with itself): bool [n, n]."""
    lines = np.linspace(-1.0, 1.0, size + 1)
    grid = np.stack(np.meshgrid(lines, lines, indexing="ij"), axis=-1)
    points = octahedral._host_decode(grid[..., 0], grid[..., 1])
    corners = np.stack([points[:-1, :-1], points[1:, :-1], points[:-1, 1:], points[1:, 1:]], axis=2)
    corners = corners.reshape(size * size, 4, 3)
    result = np.zeros((size * size, size * size), bool)
    for one in range(size * size):
        apart = corners[:, :, None, :] - corners[one][None, None]
        result[one] = (np.abs(apart).max(axis=-1) < 1e-9).any(axis=(1, 2))
    return result


def joined(grid: Grid, keys, bits):
    """Masks or-ed with those of the cells one step away along one axis."""
    place = {tuple(np.unravel_index(key, grid.shape)): row for row, key in enumerate(keys.tolist())}
    result = bits.copy()
    for (x, y, z), row in place.items():
        for step in ((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)):
            other = place.get((x + step[0], y + step[1], z + step[2]))
            if other is not None:
                result[row] |= bits[other]
    return result
