"""The Utah teapot's 32 bicubic Bézier patches: Martin Newell, 1975.

The numbers are those published as "the teapot" ever since: the control points of Newell's thesis
(University of Utah, 1975) with the height that Blinn divided by 1.3, and the bottom that Crow added
("The origins of the teapot", IEEE Computer Graphics & Applications 7(1), 1987). Coordinates are
Newell's here: z up, spout towards +x, standing on z = 0.

Symmetry shortens the table: 24 patches are quarter turns of 6 profiles, and of the 8 patches of
handle and spout four mirror the others in y = 0.
"""

import numpy as np
from jaxtyping import Float64

# Each row: radius and height of a control point in the plane y = 0, and the length of the arm that
# makes the quarter circle there (0.56 of the radius but for the lid's knob, which has 0.45 / 0.8).
LID_TOP = ((0.0, 3.15, 0.0), (0.8, 3.15, 0.45), (0.0, 2.85, 0.0), (0.2, 2.7, 0.112))
LID = ((0.2, 2.7, 0.112), (0.4, 2.55, 0.224), (1.3, 2.55, 0.728), (1.3, 2.4, 0.728))
RIM = (
    (1.4, 2.4, 0.784),
    (1.3375, 2.53125, 0.749),
    (1.4375, 2.53125, 0.805),
    (1.5, 2.4, 0.84),
)
UPPER_BODY = ((1.5, 2.4, 0.84), (1.75, 1.875, 0.98), (2.0, 1.35, 1.12), (2.0, 0.9, 1.12))
LOWER_BODY = ((2.0, 0.9, 1.12), (2.0, 0.45, 1.12), (1.5, 0.225, 0.84), (1.5, 0.15, 0.84))
BOTTOM = ((1.5, 0.15, 0.84), (1.5, 0.075, 0.84), (1.425, 0.0, 0.798), (0.0, 0.0, 0.0))

PROFILES = (LID_TOP, LID, RIM, UPPER_BODY, LOWER_BODY, BOTTOM)
"""From the knob over the lid and the rim down to the middle of the bottom."""

# Each row, along the tube: (x, z) of one edge, (x, z) of the other, and the width. The four control
# points of half the tube go from the first at y = 0 out to y = -width and back to the second.
HANDLE = (
    ((-1.6, 2.025), (-1.5, 2.25), 0.3),
    ((-2.3, 2.025), (-2.5, 2.25), 0.3),
    ((-2.7, 2.025), (-3.0, 2.25), 0.3),
    ((-2.7, 1.8), (-3.0, 1.8), 0.3),
    ((-2.7, 1.575), (-3.0, 1.35), 0.3),
    ((-2.5, 1.125), (-2.65, 0.9375), 0.3),
    ((-2.0, 0.9), (-1.9, 0.6), 0.3),
)
SPOUT = (
    ((1.7, 1.425), (1.7, 0.6), 0.66),
    ((2.6, 1.425), (3.1, 0.825), 0.66),
    ((2.3, 2.1), (2.4, 2.025), 0.25),
    ((2.7, 2.4), (3.3, 2.4), 0.25),
    ((2.8, 2.475), (3.525, 2.49375), 0.25),
    ((2.9, 2.475), (3.45, 2.5125), 0.15),
    ((2.8, 2.4), (3.2, 2.4), 0.15),
)


def turned_patches() -> Float64[np.ndarray, "profiles quarters 4 4 3"]:
    """Control points of lid, body and bottom: [profile, quarter, down the profile, around, xyz].

    Quarters go clockwise seen from above, so that around x down points outwards.
    """
    radius, height, arm = np.moveaxis(np.array(PROFILES), -1, 0)
    zero = np.zeros_like(radius)
    x = np.stack([radius, radius, arm, zero], axis=-1)
    y = -np.stack([zero, arm, radius, radius], axis=-1)
    z = np.broadcast_to(height[..., None], x.shape)
    quarters = [(x, y), (y, -x), (-x, -y), (-y, x)]
    return np.stack([np.stack([a, b, z], axis=-1) for a, b in quarters], axis=1)


def tube_patches(
    rows: tuple[tuple[tuple[float, float], tuple[float, float], float], ...],
) -> Float64[np.ndarray, "lengths sides 4 4 3"]:
    """Control points [along, side, along, around, xyz] of :data:`HANDLE` or :data:`SPOUT`.

    Seven rows make two patches, which share the fourth; the second side carries on around the tube.
    """
    half = np.array(
        [
            [(x, 0.0, z), (x, -width, z), (x1, -width, z1), (x1, 0.0, z1)]
            for (x, z), (x1, z1), width in rows
        ]
    )
    other = half[:, ::-1] * [1.0, -1.0, 1.0]
    return np.stack([np.stack([half[i : i + 4], other[i : i + 4]]) for i in (0, 3)])
