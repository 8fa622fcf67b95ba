"""A good default view: the scene's own, all of an object from outside, or along a room (host)."""

import numpy as np
from jaxtyping import Float

from jaxvis.scene.camera import Camera, Vector
from jaxvis.scene.rooms import is_architecture, is_open_below, room_camera
from jaxvis.scene.scene import Scene

OBJECT_FIELD_OF_VIEW = 0.6
MARGIN = 0.06
"""Share of the picture's half width and height that stays free around an object."""

FLAT, LAND_SHOWN = 0.2, 0.4
"""Land is lower than this share of its width; this share of its width is surely in the picture."""

SMALL = 0.5
"""Share of the height of a file's own view that a scene must fill for the view to be left as is."""


def default_camera(scene: Scene, *, aspect: float | int = 1.0) -> Camera:
    """A view that shows the scene well. Deterministic.

    The camera that came with the scene, if any. Otherwise a scene that encloses its viewer (a
    building's inside, a street) is seen from within, along the longest free view; anything else is
    seen whole, from the front, the right and slightly above.

    Args:
        scene: the scene.
        aspect: width by height of the narrowest picture in which a whole object must be seen.

    Raises:
        ValueError: the aspect is not positive.
    """
    if not (np.isfinite(aspect) and aspect > 0.0):
        raise ValueError(f"aspect must be positive, got {aspect}")
    if scene.camera is not None:
        return scene.camera
    if is_architecture(scene):
        return room_camera(scene)
    return object_camera(scene, aspect=aspect)


def object_camera(scene: Scene, *, aspect: float | int = 1.0) -> Camera:
    """A view from the front, the right and above: of all of an object, over flat land.

    An object is seen from as near as its vertices allow, a long one across its length. Land, much
    wider than high and without an underside, fills the picture from its middle on; its far corners
    may lie outside.
    """
    width, height, depth = np.ptp(scene.positions.astype(np.float64), axis=0)
    land = height < FLAT * min(width, depth) and is_open_below(scene)
    azimuth = np.radians(30.0 if depth <= 1.3 * width else 65.0)
    elevation = np.radians(30.0 if land else 18.0)
    towards = np.array(
        [
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
            np.cos(azimuth) * np.cos(elevation),
        ]
    )
    points = scene.positions
    if land:
        across = points[:, [0, 2]] / (0.5 * np.array([width, depth]))
        shown = np.sum(across**2, axis=-1) < LAND_SHOWN**2
        points = points[shown] if shown.any() else points  # a coarse grid may have no vertex there
    return fit_camera(scene, points, towards, aspect=aspect)


def fit_camera(
    scene: Scene,
    points: Float[np.ndarray, "points 3"],
    towards: Float[np.ndarray, "3"],
    *,
    aspect: float | int,
    field_of_view: float = OBJECT_FIELD_OF_VIEW,
    up: Vector = (0.0, 1.0, 0.0),
) -> Camera:
    """The nearest camera that lies in the direction ``towards`` and sees all points (centred)."""
    axes = Camera(towards, np.zeros(3), up).axes()
    seen = points @ axes.T
    tangent = np.tan(0.5 * field_of_view) * (1.0 - MARGIN)
    x, x_depth = _fit(seen[:, 0], seen[:, 2], tangent * aspect)
    y, y_depth = _fit(seen[:, 1], seen[:, 2], tangent)
    near = min(x_depth, y_depth)
    middle = 0.5 * (seen[:, 2].min() + seen[:, 2].max())
    eye, target = np.array([[x, y, near], [x, y, middle]]) @ axes + scene.origin
    return Camera(eye, target, up, field_of_view)


def close_up(scene: Scene, camera: Camera) -> Camera:
    """The camera, moved nearer in its own direction if the scene fills less than half its view.

    Cameras in mesh files are often left over from a larger scene.
    """
    right, up, forward = camera.axes()
    seen = (scene.positions + (scene.origin - camera.eye)) @ np.stack([right, up, forward]).T
    if np.any(seen[:, 2] <= 0.0):
        return camera
    reach = np.ptp(seen[:, :2] / seen[:, 2:], axis=0) / (2.0 * np.tan(0.5 * camera.field_of_view))
    if np.max(reach) >= SMALL:
        return camera
    return fit_camera(
        scene,
        scene.positions,
        -forward,
        aspect=1.0,
        field_of_view=camera.field_of_view,
        up=camera.up,
    )


def _fit(
    across: Float[np.ndarray, "points"], along: Float[np.ndarray, "points"], tangent: float
) -> tuple[float, float]:
    """Where a pinhole sees all points within ``tangent`` of its axis, as close as can be.

    Each point bounds the position across the axis from both sides, linearly in that along it:
    |p - e| <= tangent (q - f) for the pinhole at (e, f).
    """
    low = float(np.max(across - tangent * along))
    high = float(np.min(across + tangent * along))
    return 0.5 * (low + high), 0.5 * (high - low) / tangent
