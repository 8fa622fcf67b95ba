"""Visibility and occlusion masks of cells: filling, dilating, joining, labels, layout (host)."""

from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Array, Bool, Int32, Integer, Shaped, UInt8

from jaxvis.compiled import compiled
from jaxvis.methods.visibility_field.grid import Grid
from jaxvis.sphere.octahedral import pad, pad_indices

if TYPE_CHECKING:
    from jaxvis.methods.visibility_field.field import FieldVisibility

Dilation = Literal["full", "half", "none"]

DENSE_VISIBLE, DENSE_OCCLUDED, DENSE_LABEL = 128, 64, 32
"""Bits of a texel in the paper's layout (paper 001, section 4.2)."""

ONE = np.float32(1.0)


@compiled
def texel_of(x, y, z, size):
    """Texel i * size + j that holds a direction: :func:`jaxvis.sphere.octahedral.texel` for one
    direction, rounded alike."""
    scale = ONE / (abs(x) + abs(y) + abs(z))
    p, q = x * scale, y * scale
    if z < 0.0:
        folded = (ONE - abs(q)) * (ONE if p >= 0.0 else -ONE)
        q = (ONE - abs(p)) * (ONE if q >= 0.0 else -ONE)
        p = folded
    half = np.float32(0.5 * size)
    i, j = int((p + ONE) * half), int((q + ONE) * half)
    return min(i, size - 1) * size + min(j, size - 1)


@compiled
def merge(seen, rows, directions, blocked, size):
    """Enters the answers of rays into the masks of their cells (paper 001, eqs. 3 to 6).

    Only ever stores ones, so that threads may do it at once and in any order.

    Args:
        seen: uint8 [cells, 2, size * size], the visibility and the occlusion mask of each cell.
        rows: of ``seen``, one for each sample.
        directions: [samples * rays, 3].
        blocked: whether each ray is.
        size: of the octahedral maps.
    """
    rays = len(directions) // len(rows)
    for sample in range(len(rows)):
        masks = seen[rows[sample]]
        for k in range(sample * rays, (sample + 1) * rays):
            texel = texel_of(directions[k, 0], directions[k, 1], directions[k, 2], size)
            masks[int(blocked[k]), texel] = 1


def dilated(
    bits: Shaped[np.ndarray, "cells texels"], size: int, times: int
) -> Shaped[np.ndarray, "cells texels"]:
    """Masks grown ``times`` by one texel in all eight directions, on the sphere.

    ``bits`` are bool, or uint8 of which each bit is a mask of its own. A mask's neighbours across
    the map's edge come from where the sphere continues (Cigolle et al. 2014).
    """
    i, j = pad_indices(size)
    source = (i * size + j).reshape(-1).astype(np.int32)
    for _ in range(times):
        grown = np.empty_like(bits)
        _dilate(bits.view(np.uint8), source, size, grown.view(np.uint8))
        bits = grown
    return bits


@compiled
def _dilate(bits, source, size, grown):
    """One dilation: joins three columns, then three rows, of each map with a border."""
    side = size + 2
    padded = np.empty(side * side, np.uint8)
    for cell in range(len(bits)):
        for k in range(side * side):
            padded[k] = bits[cell, source[k]]
        for k in range(side * side - 2):
            padded[k] |= padded[k + 1] | padded[k + 2]
        for i in range(size):
            for j in range(size):
                k = i * side + j
                grown[cell, i * size + j] = padded[k] | padded[k + side] | padded[k + 2 * side]


def half_dilated(
    bits: Shaped[np.ndarray, "cells fine"], size: int
) -> Shaped[np.ndarray, "cells texels"]:
    """Masks of ``size`` x ``size`` texels, grown by half a texel in four directions, from masks of
    twice that size.

    With many samples in a cell what they saw fills its texels, and only the edges of what is
    visible or blocked can lie between two rays: half a texel covers these.
    """
    fine = 2 * size
    i, j = pad_indices(fine)
    source = (i * fine + j).reshape(-1).astype(np.int32)
    grown = np.zeros((len(bits), size * size), bits.dtype)
    _half_dilate(bits.view(np.uint8), source, fine, grown.view(np.uint8))
    return grown


@compiled
def _half_dilate(bits, source, fine, grown):
    side, size = fine + 2, fine // 2
    for cell in range(len(bits)):
        for i in range(fine):
            for j in range(fine):
                k = (i + 1) * side + j + 1
                around = (
                    bits[cell, i * fine + j]
                    | bits[cell, source[k - side]]
                    | bits[cell, source[k + side]]
                    | bits[cell, source[k - 1]]
                    | bits[cell, source[k + 1]]
                )
                grown[cell, (i // 2) * size + j // 2] |= around


def halved(bits: Shaped[np.ndarray, "cells fine"], size: int) -> Shaped[np.ndarray, "cells texels"]:
    """Masks of ``size`` x ``size`` texels: those of twice that size, joined two by two."""
    blocks = bits.reshape(len(bits), size, 2, size, 2)
    joined = blocks[:, :, 0, :, 0] | blocks[:, :, 0, :, 1]
    joined |= blocks[:, :, 1, :, 0] | blocks[:, :, 1, :, 1]
    return joined.reshape(len(bits), size * size)


def with_neighbours(
    grid: Grid, keys: Int32[np.ndarray, "cells"], bits: Shaped[np.ndarray, "cells texels"]
) -> Shaped[np.ndarray, "cells texels"]:
    """Masks joined with those of the occupied cells that share a face.

    What a point sees that no sample of its cell stands for, one in the next cell often saw.
    """
    joined = bits.copy()
    _join(neighbour_rows(grid, keys), bits.view(np.uint8), joined.view(np.uint8))
    return joined


def neighbour_rows(grid: Grid, keys: Int32[np.ndarray, "cells"]) -> Int32[np.ndarray, "cells 6"]:
    """Rows of the six cells that share a face with each; -1 where there is none occupied."""
    place = np.stack(np.unravel_index(keys, grid.shape), axis=-1)
    rows = np.empty((len(keys), 6), np.int32)
    for k in range(6):
        axis, step = k // 2, 2 * (k % 2) - 1
        beside = place.copy()
        beside[:, axis] += step
        inside = (beside[:, axis] >= 0) & (beside[:, axis] < grid.shape[axis])
        wanted = np.ravel_multi_index(tuple(beside.T), grid.shape, mode="clip")
        row = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        rows[:, k] = np.where(inside & (keys[row] == wanted), row, -1)
    return rows


@compiled
def _join(rows, bits, joined):
    for cell in range(len(rows)):
        for row in rows[cell]:
            if row >= 0:
                for texel in range(bits.shape[1]):
                    joined[cell, texel] |= bits[row, texel]


def labels(
    visible: Integer[Array | np.ndarray, "cells"],
    occluded: Integer[Array | np.ndarray, "cells"],
    size: int,
    rule: str,
) -> Bool[Array | np.ndarray, "cells"]:
    """Whether a cell's visible directions are traced (True) or its occluded ones.

    Args:
        visible: how many texels of each cell are visible to some sample.
        occluded: how many are occluded to some sample.
        size: of the octahedral maps.
        rule: ``paper``: more than half of all directions are occluded (paper 001, eqs. 7 and 8);
            ``balanced``: more are occluded than visible, so that the fewer are traced;
            ``visible``: always the visible ones.

    Raises:
        ValueError: there is no such rule.
    """
    if rule == "paper":
        return occluded / size**2 > 0.5
    if rule == "balanced":
        return occluded > visible
    if rule == "visible":
        return occluded >= 0
    raise ValueError(f"labels must be paper, balanced or visible, got {rule!r}")


def dense(
    field: "FieldVisibility", rule: str = "paper"
) -> UInt8[np.ndarray, "nx ny nz padded padded"]:
    """The field in the paper's layout: a byte a texel, with a border, for every cell of the grid.

    128 marks visible texels, 64 occluded ones, and 32, in all texels of a cell, its label. Cells
    without samples are 0.

    Raises:
        ValueError: there is no such rule; see :func:`labels`.
    """
    texels = field.texels()
    label = labels(np.asarray(field.visible), np.asarray(field.occluded), field.size, rule)
    # The bits of a field's texels are 1 and 2.
    bytes_of = np.array([0, DENSE_VISIBLE, DENSE_OCCLUDED, DENSE_VISIBLE | DENSE_OCCLUDED])
    values = bytes_of.astype(np.uint8)[texels]
    values |= np.where(label, DENSE_LABEL, 0).astype(np.uint8)[:, None, None]
    cells = np.zeros((field.grid.cells, field.size + 2, field.size + 2), np.uint8)
    cells[np.asarray(field.keys)] = pad(values)
    return cells.reshape(*field.grid.shape, field.size + 2, field.size + 2)
