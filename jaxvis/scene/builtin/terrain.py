"""An open world: hills, a river under bridges, a village and woods (paper 003, its open scenes)."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Num

from jaxvis.reflectance import Lambert, Texture
from jaxvis.scene.builtin.noise import noise
from jaxvis.scene.builtin.parameters import Number, whole
from jaxvis.scene.builtin.terrain_buildings import (
    MATERIALS,
    NUMBER,
    PLASTERS,
    SLATE,
    TILES,
    arch_bridge,
    church,
    flat_house,
    foot_bridge,
    house,
    market_hall,
    wings,
)
from jaxvis.scene.builtin.terrain_ground import (
    SIZE,
    Ground,
    from_river,
    ground_colours,
    ground_uvs,
    hilliness,
    make_ground,
    river_middle,
    street_distance,
    woods,
)
from jaxvis.scene.builtin.terrain_parts import Solid, instances, join_solids, solid, turned
from jaxvis.scene.camera import Camera
from jaxvis.scene.scene import Scene

LEAST, MOST = 100_000, 1_850_000
TREE_SHARE = 0.3
"""Share of all triangles that trees get; what buildings and trees leave is the ground's."""

TEXELS = 1024
"""Texels of the ground's texture along each side: about one a metre."""


class Plot(NamedTuple):
    """A building, where it stands and which way it is turned; ``radius`` is its own."""

    building: Solid
    x: float
    z: float
    turn: float
    radius: float


def terrain(triangles: Number = 100_000, seed: Number = 0) -> Scene:
    """An open world of 1 km x 1 km: a height field with all that stands on it.

    The ground is one connected sheet with one height everywhere. Houses, a church, a market hall,
    trees and two bridges stand in it, each of closed solids of their own; roofs stand out, crowns
    hang over trunks and bridges span the river, so that they are no height fields.

    Args:
        triangles: 100,000 to 1,850,000, met within 5 %: a finer grid of ground, more and finer
            trees. Buildings stay the same.
        seed: of the hills, the buildings and the trees, 0 to 1,000,000. Streets and river stay.
    """
    count = whole("triangles", triangles, LEAST, MOST)
    number = whole("seed", seed, 0, 1_000_000)
    plots = _plots(np.random.default_rng([number, 1]))
    built = sum(len(plot.building.materials) for plot in plots)
    trees = int(TREE_SHARE * count)
    ground = make_ground(round(np.sqrt(0.5 * (count - built - trees))), number)
    mesh = ground.mesh()
    land = Solid(mesh, np.zeros(len(mesh.triangles), np.int64))
    buildings = [_stand(plot, ground) for plot in plots]
    wood = _trees(trees, plots, ground, number)
    return _scene(join_solids([land, *buildings, *wood]), len(mesh.triangles), ground, number)


def _plots(random: np.random.Generator) -> list[Plot]:
    """Who stands where: rows of houses along the streets, and the single ones."""
    roofs = [TILES, TILES, TILES, SLATE]
    plots = [
        Plot(arch_bridge(0.3), 0.0, 0.0, 0.5 * np.pi, 40.0),
        _crossing(foot_bridge(), 148.0, 32.0),
        Plot(church(), 47.0, -124.0, 0.0, 22.0),
        Plot(market_hall(), -15.0, -108.0, 0.0, 11.0),
        Plot(wings((26.0, 22.0), 8.0, PLASTERS[1], TILES, True), 23.0, 57.0, 0.5, 18.0),
        Plot(market_hall((22.0, 9.0), SLATE), -24.0, 56.0, 1.9, 14.0),
        Plot(flat_house((34.0, 22.0), 3, PLASTERS[3], True), -58.0, -128.0, 0.0, 21.0),
    ]
    back = 0.5 * np.pi
    rows = [
        # First and last place of a row's fronts, towards which the houses look, and how many.
        ((9.0, -36.0), (9.0, -74.0), -back, 2),
        ((-9.0, -36.0), (-9.0, -74.0), back, 2),
        ((9.0, -146.0), (9.0, -226.0), -back, 4),
        ((-9.0, -146.0), (-9.0, -226.0), back, 4),
        ((-36.0, -90.0), (-141.0, -90.0), np.pi, 5),
        ((36.0, -90.0), (92.0, -90.0), np.pi, 3),
        ((120.0, -90.0), (168.0, -90.0), np.pi, 2),
        ((-122.0, -106.0), (-160.0, -106.0), 0.0, 2),
        ((78.0, -106.0), (92.0, -106.0), 0.0, 1),
        ((118.0, -106.0), (164.0, -106.0), 0.0, 2),
        ((-118.0, -132.0), (-118.0, -182.0), back, 2),
        ((-102.0, -146.0), (-102.0, -186.0), -back, 2),
        ((113.0, -130.0), (113.0, -187.0), -back, 3),
        ((97.0, -146.0), (97.0, -186.0), back, 2),
        ((-9.0, 82.0), (-9.0, 122.0), back, 2),
    ]
    for (x0, z0), (x1, z1), turn, count in rows:
        for k in range(count):
            t = (k + 0.5) / count
            sides = (random.uniform(11.0, 15.0), random.uniform(8.5, 10.5))
            kind, storeys = random.uniform(), int(random.integers(1, 4, endpoint=False))
            plaster = PLASTERS[int(random.integers(len(PLASTERS)))]
            roof = roofs[int(random.integers(len(roofs)))]
            pitch = random.uniform(0.6, 0.85)
            if kind < 0.62:
                building = house(sides, min(storeys, 2), plaster, roof, pitch, kind > 0.42)
            elif kind < 0.84:
                sides = (16.0, 15.0)
                building = wings(sides, 7.0, plaster, roof, False)
            else:
                building = flat_house(sides, storeys, plaster, False)
            away = 0.5 * sides[1] + 1.2
            x = x0 + t * (x1 - x0) - np.sin(turn) * away
            z = z0 + t * (z1 - z0) - np.cos(turn) * away
            askew = random.normal(0.0, 0.03)
            plots.append(Plot(building, x, z, turn + askew, 0.5 * float(np.hypot(*sides))))
    return plots


def _crossing(bridge: Solid, x: float, radius: float) -> Plot:
    """A bridge across the river at x, square to it."""
    z, slope = river_middle(np.array([x]))
    return Plot(bridge, x, float(z[0]), float(np.arctan2(1.0, slope[0])), radius)


def _stand(plot: Plot, ground: Ground) -> Solid:
    """The building on its plot: floor level with the highest ground under it, if that is not far.

    Bridges stand on the valley floor's level, which is 0.
    """
    turned_ = plot.building.placed((plot.x, 0.0, plot.z), plot.turn)
    positions = turned_.mesh.positions
    low = positions[:, 1].min()
    if low < -5.0:
        return turned_
    feet = positions[positions[:, 1] < low + 0.01]
    under = ground.at(feet[:, 0], feet[:, 2])
    floor = min(under.max() + 0.1, under.min() - low - 0.25)
    moved = turned_.mesh._replace(positions=positions + [0.0, floor, 0.0])
    return turned_._replace(mesh=moved)


def _trees(budget: int, plots: list[Plot], ground: Ground, seed: int) -> list[Solid]:
    """As many trees as the budget of triangles allows, the first ones the same for every budget."""
    x, z, conifer = _tree_places(plots, seed)
    random = np.random.default_rng([seed, 3])
    turns = random.uniform(0.0, 2.0 * np.pi, len(x))
    widths = random.uniform(0.75, 1.25, len(x))
    heights = widths * random.uniform(0.85, 1.2, len(x))
    kinds = random.integers(3, size=len(x))
    prototypes = _tree_prototypes(fine=budget > 100_000)
    number = np.where(conifer, 3 + kinds % 2, kinds)
    sizes = np.array([len(tree.materials) for tree in prototypes])
    shown = np.cumsum(sizes[number]) <= budget
    wood = []
    for kind, prototype in enumerate(prototypes):
        here = shown & (number == kind)
        places = np.stack([x[here], ground.at(x[here], z[here]), z[here]], axis=-1)
        wood.append(instances(prototype, places, turns[here], widths[here], heights[here]))
    return wood


def _tree_places(
    plots: list[Plot], seed: int
) -> tuple[Float64[np.ndarray, "trees"], Float64[np.ndarray, "trees"], Bool[np.ndarray, "trees"]]:
    """Where trees stand, most wanted first, and which are conifers.

    A jittered grid, thinned: woods on the hills, single trees in the valley and along the river;
    none in the water, on streets and in buildings.
    """
    random = np.random.default_rng([seed, 2])
    spacing = 8.0
    cells = int(SIZE / spacing) - 2
    row, column = np.divmod(np.arange(cells * cells), cells)
    jitter = random.uniform(-0.3, 0.3, (2, cells * cells))
    x = (column - 0.5 * (cells - 1) + jitter[0]) * spacing
    z = (row - 0.5 * (cells - 1) + jitter[1]) * spacing
    d = np.abs(from_river(x, z))
    hills = hilliness(x, z)
    wood = woods(x, z, seed)
    by_water = (d > 17.0) & (d < 30.0)
    density = np.maximum(wood, np.where(by_water, 0.16, 0.035))
    free = (d > 16.0) & (street_distance(x, z) > 7.0)
    for plot in plots:
        free &= np.hypot(x - plot.x, z - plot.z) > plot.radius + 4.5
    eye = np.hypot(x - EYE[0], z - EYE[1])
    free &= eye > 48.0
    # Where the view looks trees count most: a small scene is not to be spread too thin.
    near = 1.0 / (1.0 + (np.hypot(x + 10.0, z + 60.0) / 170.0) ** 4)
    weight = np.where(free, density * (0.02 + near), 0.0)
    # The largest of u^(1 / w) are a sample without replacement in proportion to the weights
    # (Efraimidis and Spirakis 2006); in logarithms.
    draw = np.log(random.uniform(size=len(x))) / np.maximum(weight, 1e-12)
    order = np.argsort(-draw)[: int(np.sum(weight > 0.0))]
    conifer = random.uniform(size=len(x)) < 0.15 + 0.7 * np.clip(hills, 0.0, 1.0)
    return x[order], z[order], conifer[order]


def _tree_prototypes(fine: bool) -> list[Solid]:
    """Three broad-leaved trees and two conifers, about 9 m high; y = 0 is the ground."""
    leaves = [NUMBER[name] for name in ("leaves", "light leaves", "autumn leaves")]
    bark, needles = NUMBER["bark"], NUMBER["needles"]
    around = 10 if fine else 6
    trees = []
    for kind, (material, width, tall) in enumerate(
        zip(leaves, (3.3, 2.7, 3.0), (3.0, 3.7, 2.7), strict=True)
    ):
        trunk = [(0.0, -1.2), (0.42, -1.2), (0.27, 2.6 + 0.4 * tall), (0.0, 2.6 + 0.4 * tall)]
        crown = _blob(width, tall, 2.3 + tall, material, kind, 2 if fine else 1)
        trees.append(join_solids([turned(trunk, around, bark), crown]))
    for width, height in ((2.3, 10.0), (1.8, 12.5)):
        trunk = [(0.0, -1.2), (0.34, -1.2), (0.24, 2.6), (0.0, 2.6)]
        tiers = 5 if fine else 3
        trees.append(
            join_solids(
                [
                    turned(trunk, around, bark),
                    turned(_tiers(width, 1.7, height, tiers), 2 * around - 4, needles, 0.7),
                ]
            )
        )
    return trees


def _blob(
    width: float, tall: float, middle: float, material: int, seed: int, subdivisions: int
) -> Solid:
    """A lumpy crown: a subdivided icosahedron, its vertices moved in and out."""
    import trimesh  # only now: it takes a third of a second

    sphere = trimesh.creation.icosphere(subdivisions)
    points = np.asarray(sphere.vertices, np.float64)
    lumps = 0.72 + 0.56 * noise(1.4 * points + 7.0 * seed, 2, seed)
    shaped = points * lumps[:, None] * [width, tall, width] + [0.0, middle, 0.0]
    return solid(shaped[np.asarray(sphere.faces)], material, 1.4)


def _tiers(width: float, foot: float, top: float, count: int) -> list[tuple[float, float]]:
    """Profile of a conifer's crown: skirts of branches, each over the next lower one."""
    profile = [(0.0, foot + 0.5)]
    step = (top - foot) / (count + 0.6)
    for tier in range(count):
        radius = width * (1.0 - tier / (count + 0.3))
        y = foot + tier * step
        profile += [(radius, y), (0.45 * radius, y + step + 0.35)]
    return [*profile[:-1], (0.0, top)]


EYE = (85.0, 97.0)
"""Where the scene's camera stands (x, z)."""


def _scene(whole_: Solid, grounds: int, ground: Ground, seed: int) -> Scene:
    """The scene of a mesh whose vertices are welded already, part by part.

    ``build_scene`` would weld them again, which takes longer than all the rest together.
    """
    mesh = whole_.mesh
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    origin = 0.5 * low + 0.5 * high
    uvs = np.zeros((len(mesh.triangles), 3, 2), np.float32)
    uvs[:grounds] = ground_uvs(mesh.positions)[mesh.triangles[:grounds]]
    land = replace(
        MATERIALS[0],
        base_colour_texture=Texture(ground_colours(TEXELS, seed)),
    )
    height = max(float(ground.at(*np.array(EYE)[:, None])[0]) + 16.0, 27.0)
    return Scene(
        positions=_frozen(mesh.positions - origin, np.float32),
        normals=_frozen(mesh.normals, np.float32),
        triangles=_frozen(mesh.triangles, np.int32),
        material_ids=_frozen(whole_.materials, np.int32),
        materials=(land, *MATERIALS[1:]),
        uvs=_frozen(uvs, np.float32),
        origin=_frozen(origin, np.float64),
        reflectance=Lambert(),
        camera=Camera((EYE[0], height, EYE[1]), (-3.0, 3.0, -35.0), field_of_view=0.8),
        name="terrain",
    )


def _frozen(array: Num[np.ndarray, "..."], dtype: type) -> Any:
    made = np.ascontiguousarray(array, dtype)
    made.setflags(write=False)
    return made
