"""Views from within scenes that enclose the viewer: buildings and streets (host)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int32

from jaxvis.scene.camera import Camera
from jaxvis.scene.scene import Scene

ROOM_FIELD_OF_VIEW = 1.0
"""Vertical, radians."""

PROBE_DIRECTIONS = 128
ENCLOSED = 0.6
"""Share of the directions around a place in a room or a street that meet a front."""

ARCHITECTURE = 0.06
"""Share of such places in the bounding box from which a scene is meant to be seen from within."""

EYE_HEIGHT = 0.22
"""Height of the eye in a room, as a share of the room's: sees floor, walls and vault."""

COLUMNS = 20
"""Places tried along each horizontal side of the bounding box."""

AZIMUTHS = 24
VIEW_RAYS = (18, 10)
"""Rays across and down a view that is tried."""

NEAREST, SKY = 1e-3, 0.03
"""Distances, as shares of the diagonal, up to which nothing counts as free view, and of the sky."""

VARIETY, TILT = 0.3, 0.5
"""Weights of variety and of lopsidedness beside reach."""


def is_architecture(scene: Scene) -> bool:
    """Whether much of the bounding box lies in rooms or streets rather than in or around objects.

    A closed object shows its backs to those inside it and little to those outside it; a room
    shows its fronts all around.
    """
    count = 8
    steps = (np.arange(count) + 0.5) / count
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    low, high = _box(scene)
    return bool(np.mean(_in_room(scene, low + grid * (high - low))) > ARCHITECTURE)


def is_open_below(scene: Scene) -> bool:
    """Whether the scene shows its backs to those below it, as land does, unlike closed objects."""
    low, high = _box(scene)
    steps = (np.arange(COLUMNS) + 0.5) / COLUMNS
    x, z = np.meshgrid(low[0] + steps * (high - low)[0], low[2] + steps * (high - low)[2])
    start = np.stack([x, np.full_like(x, low[1] - (high - low).max()), z], axis=-1).reshape(-1, 3)
    rays = _cast(scene, start, np.broadcast_to(np.array([[0.0, 1.0, 0.0]]), (len(start), 1, 3)))
    return bool(rays.back.sum() > rays.front.sum())


def room_camera(scene: Scene) -> Camera:
    """The view from a room or street that reaches farthest, at a human's or two's height in it."""
    places = _standing_places(scene)
    if not len(places):
        places = np.zeros((1, 3))
    eye, azimuth = _best_view(scene, places, np.arange(AZIMUTHS) * (2.0 * np.pi / AZIMUTHS))
    # A second, finer round about the winner.
    step = np.ptp(scene.positions, axis=0)[[0, 2]] / COLUMNS
    offsets = np.stack(np.meshgrid(*(np.linspace(-0.5, 0.5, 5),) * 2), axis=-1).reshape(-1, 2)
    near = np.repeat(eye[None], len(offsets), axis=0)
    near[:, [0, 2]] += offsets * step
    turns = azimuth + np.linspace(-1.0, 1.0, 9) * (np.pi / AZIMUTHS)
    eye, azimuth = _best_view(scene, near, turns)
    forward = _forward(np.array([azimuth]))[0]
    eye = eye + scene.origin
    return Camera(eye, eye + 0.25 * scene.diagonal * forward, field_of_view=ROOM_FIELD_OF_VIEW)


class _Rays(NamedTuple):
    """What rays of a batch met, [batches, rays]."""

    front: Bool[np.ndarray, "batches rays"]
    back: Bool[np.ndarray, "batches rays"]
    distance: Float[np.ndarray, "batches rays"]
    triangle: Int32[np.ndarray, "batches rays"]


def _cast(
    scene: Scene,
    origins: Float[np.ndarray, "batches 3"],
    directions: Float[np.ndarray, "batches rays 3"],
) -> _Rays:
    shape = directions.shape[:2]
    flat = directions.reshape(-1, 3)
    hits = scene.tracer.closest_hit(np.repeat(origins, shape[1], axis=0), flat)
    hit = hits.triangle >= 0
    # Two-sided faces count by their winding, too: many files declare closed objects two-sided.
    behind = np.sum(scene.geometric_normals[hits.triangle] * flat, axis=-1) > 0.0
    return _Rays(
        (hit & ~behind).reshape(shape),
        (hit & behind).reshape(shape),
        hits.distance.reshape(shape),
        hits.triangle.reshape(shape),
    )


def _in_room(scene: Scene, places: Float[np.ndarray, "places 3"]) -> Bool[np.ndarray, "places"]:
    index = np.arange(PROBE_DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * index / PROBE_DIRECTIONS
    turn = index * np.pi * (3.0 - np.sqrt(5.0))
    radius = np.sqrt(1.0 - z * z)
    sphere = np.stack([radius * np.cos(turn), z, radius * np.sin(turn)], axis=-1)
    rays = _cast(scene, places, np.broadcast_to(sphere, (len(places), *sphere.shape)))
    return (rays.front.mean(axis=-1) > ENCLOSED) & (rays.back.mean(axis=-1) < 0.05)


def _standing_places(scene: Scene) -> Float64[np.ndarray, "places 3"]:
    """Eyes above the floors that are met from half the scene's height downwards."""
    low, high = (side.astype(np.float64) for side in _box(scene))
    steps = (np.arange(COLUMNS) + 0.5) / COLUMNS
    x, z = np.meshgrid(low[0] + steps * (high - low)[0], low[2] + steps * (high - low)[2])
    start = np.stack([x, np.full_like(x, 0.5 * (low[1] + high[1])), z], axis=-1).reshape(-1, 3)
    down = np.broadcast_to(np.array([[0.0, -1.0, 0.0]]), (len(start), 1, 3))
    below, above = _cast(scene, start, down), _cast(scene, start, -down)
    stands = below.front[:, 0] & ~above.back[:, 0]
    floor = start[stands, 1] - below.distance[stands, 0]
    ceiling = np.minimum(start[stands, 1] + above.distance[stands, 0], high[1])
    places = start[stands]
    places[:, 1] = floor + EYE_HEIGHT * (ceiling - floor)
    return places[_in_room(scene, places)]


def _best_view(
    scene: Scene, places: Float64[np.ndarray, "places 3"], azimuths: Float64[np.ndarray, "turns"]
) -> tuple[Float64[np.ndarray, "3"], float]:
    scores = np.array([_view_scores(scene, places, azimuth) for azimuth in azimuths])
    turn, place = np.unravel_index(np.argmax(scores), scores.shape)
    return places[place], float(azimuths[turn])


def _view_scores(
    scene: Scene, places: Float64[np.ndarray, "places 3"], azimuth: float
) -> Float64[np.ndarray, "places"]:
    """How well each view is composed: reaching far, above all in the middle, alike to the left and
    right, with much to see.

    Reach is the logarithm of distance, from 0 at a thousandth of the scene's diagonal to 1 at the
    diagonal. The sky reaches no farther than a wall nearby, and backs and the void below not at
    all. Much to see is many different triangles.
    """
    target = _forward(np.array([azimuth]))[0]
    lens = Camera(np.zeros(3), target, field_of_view=ROOM_FIELD_OF_VIEW)
    directions = lens.directions(*VIEW_RAYS).reshape(-1, 3)
    rays = _cast(scene, places, np.broadcast_to(directions, (len(places), *directions.shape)))
    sky = ~(rays.front | rays.back) & (directions[:, 1] > 0.0)
    distance = np.where(rays.front, rays.distance / scene.diagonal, np.where(sky, SKY, NEAREST))
    reach = 1.0 - np.log(np.clip(distance, NEAREST, 1.0)) / np.log(NEAREST)
    columns, rows = VIEW_RAYS
    x = np.abs(np.linspace(-1.0, 1.0, columns))
    y = np.abs(np.linspace(-1.0, 1.0, rows))
    weights = np.ravel(np.exp(-2.0 * (x[None, :] ** 2 + y[:, None] ** 2)))
    far = reach @ weights / weights.sum()
    by_column = reach.reshape(-1, rows, columns).mean(axis=1)
    tilt = np.abs(by_column - by_column[:, ::-1]).mean(axis=-1)
    seen = np.sort(np.where(rays.front, rays.triangle, -1), axis=-1)
    variety = np.mean(np.diff(seen, axis=-1) > 0, axis=-1)
    return far + VARIETY * variety - TILT * tilt


def _forward(azimuths: Float64[np.ndarray, "turns"]) -> Float64[np.ndarray, "turns 3"]:
    return np.stack([np.sin(azimuths), np.zeros_like(azimuths), np.cos(azimuths)], axis=-1)


def _box(scene: Scene) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    return scene.positions.min(axis=0), scene.positions.max(axis=0)
