"""Fields made by hand, and what decisions they should lead to: slow, and read off the paper."""

from itertools import product

import jax.numpy as jnp
import numpy as np

from jaxvis.methods.traced import RayVisibility
from jaxvis.methods.visibility_field.cull import ACCEPT, DROP, TRACE
from jaxvis.methods.visibility_field.field import OCCLUDED, VISIBLE, FieldVisibility, packed
from jaxvis.methods.visibility_field.grid import Grid, cell_of
from jaxvis.scene import RayTracer, Scene
from jaxvis.sphere import octahedral

V, O, VO = VISIBLE, OCCLUDED, VISIBLE | OCCLUDED
NEITHER = 0

LABELS = ("four-state", "paper", "balanced", "visible")


def of_texels(scene: Scene, grid: Grid, keys, texels, tracer: RayTracer | None = None):
    """The field with these texels [cells, size, size], whose bits are 1 and 2."""
    texels = np.asarray(texels, np.uint8)
    counts = [np.count_nonzero(texels & bit, axis=(1, 2)).astype(np.int32) for bit in (V, O)]
    rays = RayVisibility(scene.positions, scene.triangles, tracer or scene.tracer)
    words = packed(texels) if len(texels) else np.zeros((0, 1), np.uint32)
    keys = np.asarray(keys, np.int32)
    return FieldVisibility(grid, keys, words, *counts, rays, texels.shape[-1])


def filled(scene: Scene, state: int, edge: float | None = None, size: int = 6, tracer=None):
    """The field that has the same in every texel of every cell: of a single one if no edge is
    given, so that few programs are compiled."""
    if edge is None:
        low, high = scene.positions.min(axis=0), scene.positions.max(axis=0)
        whole = np.float32(2.0 * (high - low).max())
        grid = Grid((low + high - whole) / np.float32(2.0), np.asarray(whole), (1, 1, 1))
    else:
        grid = Grid.covering(scene.positions, edge)
    texels = np.full((grid.cells, size, size), state)
    return of_texels(scene, grid, np.arange(grid.cells), texels, tracer)


def exact_for(scene: Scene, origins, directions, decided, edge: float = 1.0, size: int = 18):
    """The field that knows how these rays ended, and nothing else.

    Args:
        directions: [points, rays, 3].
        decided: ACCEPT for the rays that reach the sky, DROP for the others.
    """
    grid = Grid.covering(scene.positions, edge)
    keys, rows = np.unique(cells_at(grid, origins), return_inverse=True)
    texels = np.zeros((len(keys), size, size), np.uint8)
    state = np.where(np.asarray(decided) == ACCEPT, V, O).astype(np.uint8)
    rows = np.broadcast_to(rows[:, None], state.shape)
    # Rays so close to an edge that rounding decides enter the texels on both sides of it.
    for offset in product((-1e-5, 1e-5), repeat=3):
        i, j = octahedral.texel(jnp.asarray(directions) + jnp.asarray(offset), size)
        np.bitwise_or.at(texels, (rows, np.asarray(i), np.asarray(j)), state)
    return of_texels(scene, grid, keys, texels)


def label_of(texels, rule: str) -> int:
    """A cell's label (paper 001, eqs. 7 and 8, and the rules that are not the paper's)."""
    texels = np.asarray(texels)
    occluded, visible = np.sum(texels & O > 0), np.sum(texels & V > 0)
    if rule == "paper":
        return int(occluded / texels.size > 0.5)
    if rule == "balanced":
        return int(occluded > visible)
    return 1


def fate(state: int, label: int, *, four_state: bool = False, conservative: bool = False) -> int:
    """What becomes of a ray in a texel of this state (Algorithm 2, lines 5 to 11)."""
    if four_state:
        return {V: ACCEPT, O: DROP, VO: TRACE, NEITHER: TRACE}[state]
    if conservative and state == NEITHER:
        return TRACE
    if label == 1:
        return TRACE if state & V else DROP
    return TRACE if state & O else ACCEPT


def inside_texels(rng, size: int, shape: tuple[int, ...]):
    """Random unit directions [*shape, 3] with their texels (i, j), none of them near an edge."""
    cells = rng.integers(0, size, (*shape, 2))
    points = 2.0 * (cells + rng.uniform(0.02, 0.98, cells.shape)) / size - 1.0
    directions = octahedral.decode(jnp.asarray(points, jnp.float32))
    return np.asarray(directions), cells[..., 0], cells[..., 1]


def by_component(directions):
    """Three JAX arrays."""
    return tuple(jnp.asarray(axis) for axis in np.moveaxis(np.asarray(directions), -1, 0))


def cells_at(grid: Grid, points):
    """The cell's number of each point, by the device's rounding, on the host."""
    return np.asarray(cell_of(grid, jnp.asarray(points)))
