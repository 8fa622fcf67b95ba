"""What people built in the open world: houses, a farm, a church, a market hall, bridges (host).

Every building stands about the origin with its floor at y = 0 and reaches below it by SUNK, for the
ground that it will stand on is not level. Its front looks to +z.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from jaxvis.reflectance import Material
from jaxvis.scene.builtin.terrain_parts import (
    Solid,
    block,
    box,
    boxes,
    join_solids,
    prism,
    solid,
    strip,
)

SUNK = 2.2
"""How far walls reach below the floor, metres."""

MATERIALS = (
    Material(base_colour=(1.0, 1.0, 1.0), name="ground"),
    Material(base_colour=(0.78, 0.74, 0.66), name="white plaster"),
    Material(base_colour=(0.80, 0.55, 0.18), name="yellow plaster"),
    Material(base_colour=(0.72, 0.36, 0.22), name="red plaster"),
    Material(base_colour=(0.32, 0.47, 0.58), name="blue plaster"),
    Material(base_colour=(0.58, 0.13, 0.06), name="roof tiles"),
    Material(base_colour=(0.20, 0.21, 0.24), name="slate"),
    Material(base_colour=(0.34, 0.19, 0.09), name="wood"),
    Material(base_colour=(0.50, 0.46, 0.40), name="stone"),
    Material(base_colour=(0.05, 0.07, 0.09), name="window"),
    Material(base_colour=(0.22, 0.14, 0.08), name="bark"),
    Material(base_colour=(0.11, 0.24, 0.04), name="leaves"),
    Material(base_colour=(0.27, 0.33, 0.05), name="light leaves"),
    Material(base_colour=(0.50, 0.24, 0.04), name="autumn leaves"),
    Material(base_colour=(0.04, 0.13, 0.06), name="needles"),
)
"""The first is the land's; its texture comes with the scene."""

NUMBER = {material.name: number for number, material in enumerate(MATERIALS)}
PLASTERS = [number for name, number in NUMBER.items() if name.endswith("plaster")]
TILES, SLATE, WOOD = NUMBER["roof tiles"], NUMBER["slate"], NUMBER["wood"]
STONE, WINDOW = NUMBER["stone"], NUMBER["window"]

BAY, GLASS = 4.6, 1.4
"""Width of a bay of wall around each window, and of the window, metres."""

EAVES, FASCIA = 0.7, 0.22
"""How far a roof stands out over the walls, and how thick its edge is."""

STOREY = 3.0

BATTER = 0.2
"""By how much a pier's sides lean over their foot, metres."""


def _bays(low: float, high: float) -> list[float]:
    """Cuts of a wall: every second interval is a window."""
    count = max(1, round((high - low) / BAY))
    middles = low + (np.arange(count) + 0.5) * (high - low) / count
    return [low, *np.stack([middles - 0.5 * GLASS, middles + 0.5 * GLASS], -1).reshape(-1), high]


def _storeys(count: int) -> list[float]:
    """Cuts of a wall's height: every second interval is a row of windows."""
    rows = [(STOREY * k + 0.9, STOREY * k + 2.3) for k in range(count)]
    return [-SUNK, *(y for row in rows for y in row), STOREY * count + 0.15]


def _walls(
    xs: Sequence[float],
    zs: Sequence[float],
    storeys: int,
    plaster: int,
    filled: Bool[np.ndarray, "columns rows"] | None = None,
) -> Solid:
    """Walls with windows, and a door in the front's bay nearest to the middle."""
    ys = _storeys(storeys)
    corners, cells = block(xs, ys, zs, filled)
    x, y, z, axis = cells.T
    along = np.where(axis == 0, z, x)
    materials = np.where((axis != 1) & (along % 2 == 1) & (y % 2 == 1), WINDOW, plaster)
    middles = 0.5 * (np.asarray(xs)[1:] + np.asarray(xs)[:-1])
    door = 1 + 2 * int(np.argmin(np.abs(middles[1::2])))
    front = (axis == 2) & (z > 0) & (x == door) & (y <= 1)
    return solid(corners, np.where(front, WOOD, materials))


def gable_roof(
    length: float, width: float, pitch: float, roof: int, gable: int, hipped: bool = False
) -> Solid:
    """A closed roof over walls of length (x) by width (z), its eaves at y = 0."""
    half = 0.5 * width + EAVES
    top = FASCIA + half * np.tan(pitch)
    profile = [(-half, 0.0), (-half, FASCIA), (0.0, top), (half, FASCIA), (half, 0.0)]
    inset = [0.0, 0.0, 0.8 * half if hipped else 0.0, 0.0, 0.0]
    cap = roof if hipped else gable
    reach = 0.5 * length + EAVES
    return prism(profile, (-reach, reach), [WOOD, roof, roof, WOOD, WOOD], cap, inset)


def house(
    size: tuple[float, float], storeys: int, plaster: int, roof: int, pitch: float, hipped: bool
) -> Solid:
    """A house under one roof whose ridge runs along x."""
    length, width = size
    top = STOREY * storeys
    walls = _walls(
        _bays(-0.5 * length, 0.5 * length), _bays(-0.5 * width, 0.5 * width), storeys, plaster
    )
    cover = gable_roof(length, width, pitch, roof, plaster, hipped).placed((0.0, top, 0.0))
    ridge = top + (0.5 * width + EAVES) * np.tan(pitch)
    stack = box((0.8, 2.8, 0.8), (0.22 * length, ridge - 2.0, 0.13 * width), STONE)
    return join_solids([walls, cover, stack])


def wings(size: tuple[float, float], width: float, plaster: int, roof: int, second: bool) -> Solid:
    """An L (or a U with a ``second`` wing) around a court at the front, under gabled roofs."""
    length, depth = size
    x, z = 0.5 * length, 0.5 * depth
    back = _bays(-z, -z + width)
    zs = back + _bays(-z + width, z)[1:]
    left, right = _bays(-x, -x + width), _bays(x - width, x)
    xs = left + _bays(-x + width, x - width)[1:-1] + right
    filled = np.ones((len(xs) - 1, len(zs) - 1), bool)
    court_end = len(xs) - len(right) if second else len(xs)
    filled[len(left) - 1 : court_end, len(back) - 1 :] = False
    walls = _walls(xs, zs, 2, plaster, filled)
    pitch, top = 0.72, 2 * STOREY
    solids = [
        walls,
        gable_roof(length, width, pitch, roof, plaster).placed((0.0, top, -z + 0.5 * width)),
    ]
    # The wings' roofs run into the middle of the back one's, a little lower than that: no face
    # lies in another.
    wing = gable_roof(depth - 0.5 * width - EAVES, width, pitch, roof, plaster)
    middle = 0.25 * width + 0.5 * EAVES
    for side in (-1.0, 1.0)[: 2 if second else 1]:
        place = (side * (x - 0.5 * width), top - 0.03, middle)
        solids.append(wing.placed(place, 0.5 * np.pi))
    return join_solids(solids)


def flat_house(size: tuple[float, float], storeys: int, plaster: int, court: bool) -> Solid:
    """A house under a flat slab that stands out; with a ``court`` it is a U."""
    length, width = size
    x, z = 0.5 * length, 0.5 * width
    left, right = _bays(-x, -0.3 * length), _bays(0.3 * length, x)
    xs = left + _bays(-0.3 * length, 0.3 * length)[1:-1] + right
    back = _bays(-z, -0.1 * width)
    zs = back + _bays(-0.1 * width, z)[1:]
    filled = np.ones((len(xs) - 1, len(zs) - 1), bool)
    if court:
        filled[len(left) - 1 : len(xs) - len(right), len(back) - 1 :] = False
    top, out = STOREY * storeys, 1.1
    ends = (-x - out, -0.3 * length + out, 0.3 * length - out, x + out)
    plan = np.ones((3, 2), bool)
    plan[1, 1] = not court
    rows = (-z - out, -0.1 * width + out, z + out)
    slab = solid(block(ends, (top - 0.05, top + 0.45), rows, plan)[0], STONE)
    return join_solids([_walls(xs, zs, storeys, plaster, filled), slab])


def church() -> Solid:
    """A nave along x under a steep roof, and a tower with a spire at its western end."""
    nave_length, nave_width, eaves = 24.0, 11.0, 8.0
    xs, zs = _bays(-0.5 * nave_length, 0.5 * nave_length), _bays(-0.5 * nave_width, 5.5)
    white = NUMBER["white plaster"]
    corners, cells = block(xs, [-SUNK, 2.0, 6.5, eaves + 0.2], zs)
    x, y, _, axis = cells.T
    nave = solid(corners, np.where((axis == 2) & (x % 2 == 1) & (y == 1), WINDOW, white))
    roof = gable_roof(nave_length, nave_width, 0.95, SLATE, white).placed((0.0, eaves, 0.0))
    cuts = (-3.6, -1.0, 1.0, 3.6)
    corners, cells = block(cuts, [-SUNK, 14.0, 18.0, 21.0], cuts)
    x, y, z, axis = cells.T
    open_ = (axis != 1) & (np.where(axis == 0, z, x) == 1) & (y == 1)
    tower = solid(corners, np.where(open_, WINDOW, white)).placed((-15.0, 0.0, 0.0))
    half, height = 4.1, 12.0
    profile = [(-half, 0.0), (-half, 0.3), (0.0, height), (half, 0.3), (half, 0.0)]
    # The ridge is a point but for a hand's breadth.
    inset = [0.0, 0.0, half - 0.1, 0.0, 0.0]
    spire = prism(profile, (-half, half), [WOOD, SLATE, SLATE, WOOD, WOOD], SLATE, inset)
    return join_solids([nave, roof, tower, spire.placed((-15.0, 20.8, 0.0))])


def market_hall(size: tuple[float, float] = (18.0, 10.0), roof: int = TILES) -> Solid:
    """A roof on posts, open on all sides."""
    length, width = size
    cover = gable_roof(length, width, 0.6, roof, WOOD, hipped=True)
    count = max(2, round(length / 4.5))
    places = [
        (x, -SUNK, z)
        for x in np.linspace(-0.5 * length + 0.5, 0.5 * length - 0.5, count)
        for z in (-0.5 * width + 0.5, 0.5 * width - 0.5)
    ]
    posts = boxes([(0.45, 4.2 + SUNK, 0.45)] * len(places), places, WOOD)
    return join_solids([cover.placed((0.0, 4.0, 0.0)), posts])


def arch_bridge(ends: float) -> Solid:
    """A stone bridge of three arches along x over a river along z, with parapets.

    Args:
        ends: height of the deck's ends, 36 m from the middle; its middle is 4.4 m above the floor.
    """
    half, width = 36.0, 7.4
    bottom, spring = -6.5, -2.2
    arcs = [(-17.0, 6.2, 3.3), (0.0, 7.6, 4.8), (17.0, 6.2, 3.3)]
    stations = [(-half, bottom)]
    for middle, radius, rise in arcs:
        angle = np.linspace(np.pi, 0.0, 17)
        curve = np.stack([middle + radius * np.cos(angle), spring + rise * np.sin(angle)], axis=-1)
        # Piers taper a little downwards: the underside has one height at every x.
        left, right = middle - radius - BATTER, middle + radius + BATTER
        stations += [(left, bottom), *curve, (right, bottom)]
    x, low = np.array([*stations, (half, bottom)]).T
    high = ends + (4.4 - ends) * np.cos(0.5 * np.pi * x / half) ** 2
    body = strip(x, low, high, (-0.5 * width, 0.5 * width), (NUMBER["white plaster"], STONE))
    x = np.linspace(-half, half, 25)
    deck = ends + (4.4 - ends) * np.cos(0.5 * np.pi * x / half) ** 2
    edge = 0.5 * width
    parapets = [
        strip(x, deck - 0.25, deck + 0.95, sides, (STONE, STONE))
        for sides in ((edge - 0.45, edge + 0.12), (-edge - 0.12, 0.45 - edge))
    ]
    return join_solids([body, *parapets])


def foot_bridge() -> Solid:
    """A wooden deck along x on pairs of posts, with rails; its middle is 1.5 m above the floor."""
    half, width = 30.0, 2.4
    x = np.linspace(-half, half, 21)
    deck = 0.3 + 1.2 * np.cos(0.5 * np.pi * x / half)
    solids = [strip(x, deck - 0.3, deck, (-0.5 * width, 0.5 * width), (WOOD, WOOD))]
    at = np.linspace(-half + 1.0, half - 1.0, 10)
    sizes = [(0.24, 8.25 + 1.2 * np.cos(0.5 * np.pi * x / half), 0.24) for x in at]
    for side in (-0.5 * width + 0.1, 0.5 * width - 0.1):
        rail = (side - 0.06, side + 0.06)
        solids.append(strip(x, deck + 0.9, deck + 1.02, rail, (WOOD, WOOD)))
        solids.append(boxes(sizes, [(x, -7.0, side) for x in at], WOOD))
    return join_solids(solids)
