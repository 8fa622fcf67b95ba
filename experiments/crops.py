"""Squares of a picture worth a closer look: where shadows end."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_erosion, gaussian_filter, uniform_filter

from jaxvis.scene import Surface

Image = Float[np.ndarray, "height width 3"]


def smooth_parts(surface: Surface) -> Bool[np.ndarray, "height width"]:
    """Pixels that do not lie where one body hides another, at a fold, or at the outline."""
    shape = surface.mask.shape
    position = np.asarray(surface.position).reshape(*shape, 3)
    normal = np.asarray(surface.normal).reshape(*shape, 3)
    smooth = np.asarray(surface.mask)
    usual = 0.0
    for axis in (0, 1):
        step = np.linalg.norm(position - np.roll(position, 1, axis), axis=-1)
        usual = usual or float(np.median(step[smooth]))
        turned = np.sum(normal * np.roll(normal, 1, axis), axis=-1) < 0.9
        smooth = smooth & ~turned & (step < 6.0 * usual)
    return binary_erosion(smooth, iterations=3)


def strongest_boundaries(
    shown: Image, inside: Bool[np.ndarray, "height width"], side: int, count: int
) -> list[tuple[int, int]]:
    """First row and column of the squares with the most contrast, which do not overlap.

    Contrast is the gradient of what is shown, slightly blurred, of the pixels inside.
    """
    blurred = gaussian_filter(shown.mean(axis=-1), 1.0)
    down, right = np.gradient(blurred)
    slope = np.where(inside, np.sqrt(down**2 + right**2), 0.0)
    total = uniform_filter(slope, side, mode="constant")
    height, width = inside.shape
    found: list[tuple[int, int]] = []
    for _ in range(count):
        row, column = np.unravel_index(np.argmax(total), total.shape)
        row = int(np.clip(row - side // 2, 0, height - side))
        column = int(np.clip(column - side // 2, 0, width - side))
        found.append((row, column))
        near = side + side // 2
        total[max(row - side // 2, 0) : row + near, max(column - side // 2, 0) : column + near] = 0
    return found
