"""The ground of the open world: a valley with a river, hills, and what covers them (host)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from jaxvis.scene.builtin.mesh import Mesh, unit
from jaxvis.scene.builtin.noise import smoothstep
from jaxvis.scene.normals import area_vectors

SIZE = 1000.0
"""Width of the land, metres; it is square about the origin, x east and z south."""

BED, BED_DEPTH, BANK = 12.0, 4.5, 25.0
"""Half the river bed's width, its depth below the valley floor, and where the banks end."""

NORTH_FLOOR, SOUTH_FLOOR = 215.0, 70.0
"""How far the valley floor reaches from the river's middle: the village stands in the north."""

STREETS = (
    ((0.0, 300.0), (0.0, -235.0)),
    ((-165.0, -98.0), (175.0, -98.0)),
    ((-110.0, -98.0), (-110.0, -185.0)),
    ((105.0, -98.0), (105.0, -190.0)),
    ((105.0, -98.0), (105.0, -10.0)),
)
"""Ends (x, z) of the streets' middle lines; the first crosses the river on the bridge."""

STREET = 3.2
"""Half a street's width."""

SQUARE = (-28.0, 28.0, -118.0, -80.0)
"""The market place in the village: its least and greatest x and z."""

GRASS, MEADOW, ROCK, SCREE = (
    (0.16, 0.27, 0.07),
    (0.33, 0.36, 0.10),
    (0.36, 0.32, 0.29),
    (0.5, 0.44, 0.36),
)
SAND, WATER, DEEP = (0.66, 0.54, 0.33), (0.12, 0.33, 0.36), (0.05, 0.19, 0.24)
ROAD, COBBLES, FOREST_FLOOR = (0.55, 0.48, 0.38), (0.48, 0.42, 0.36), (0.15, 0.17, 0.06)
CROPS = np.array(
    [(0.62, 0.47, 0.13), (0.30, 0.42, 0.09), (0.38, 0.24, 0.13), (0.20, 0.33, 0.08)], np.float32
)

PERIOD = 32
"""Lattice points after which noise repeats."""

Plane = Float[np.ndarray, "..."]
"""Values at places: of one shape, or x [1, columns] with z [rows, 1] and the grid of both."""


def river_middle(x: Plane) -> tuple[Plane, Plane]:
    """The z of the river's middle line at x, and its slope; 0 and level where the bridge is."""
    near = np.exp(-((x / 120.0) ** 2))
    wave, slope = np.sin(x / 95.0), np.cos(x / 95.0) / 95.0
    z = 34.0 * (np.cos(x / 140.0) - 1.0) + 40.0 * (1.0 - near) * wave
    rise = -34.0 / 140.0 * np.sin(x / 140.0)
    return z, rise + 40.0 * ((1.0 - near) * slope + near * 2.0 * x / 120.0**2 * wave)


def from_river(x: Plane, z: Plane) -> Plane:
    """Distance from the river's middle line, metres, to first order; positive in the south."""
    middle, slope = river_middle(x)
    return (z - middle) / np.hypot(1.0, slope)


def _noise(x: Plane, z: Plane, wavelength: float, octaves: int, seed: int) -> Plane:
    """Value noise of the plane, within [-1, 1], each octave of half the wavelength and the weight.

    Random values on a square lattice, smooth between, as ``noise.noise`` has them in space; in the
    plane the interpolation is a product of two matrices, and a row of x with a column of z needs
    the weights of their rows and columns alone.

    Args:
        x, z: places: of one shape, or x [1, columns] with z [rows, 1].
        wavelength: of the coarsest octave, metres.
        octaves: how many.
        seed: of the random values.
    """
    random = np.random.default_rng([seed, 7])
    scattered = x.shape == z.shape
    total, weight = np.zeros(np.broadcast_shapes(x.shape, z.shape), x.dtype), 0.0
    for octave in range(octaves):
        values = random.uniform(-1.0, 1.0, (PERIOD, PERIOD)).astype(x.dtype)
        shift = random.uniform(
            0.0, PERIOD, 2
        )  # so that octaves do not share their lattice's points
        across, down = (
            _lattice_weights(place.reshape(-1) * 2.0**octave / wavelength + float(offset))
            for place, offset in zip((x, z), shift, strict=True)
        )
        if scattered:
            value = np.sum((down @ values) * across, axis=-1).reshape(x.shape)
        else:
            value = down @ values @ across.T
        total += 0.5**octave * value
        weight += 0.5**octave
    return total / weight


def _lattice_weights(places: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n period"]:
    """How much each value of a periodic row of PERIOD counts at each place."""
    cell = np.floor(places)
    part = smoothstep(0.0, 1.0, places - cell)
    weights, row = np.zeros((len(places), PERIOD), places.dtype), np.arange(len(places))
    weights[row, cell.astype(int) % PERIOD] = 1.0 - part
    weights[row, (cell.astype(int) + 1) % PERIOD] = part
    return weights


def hilliness(x: Plane, z: Plane) -> Plane:
    """0 on the valley floor and around the village, 1 on the hills."""
    d = from_river(x, z)
    north, south = smoothstep(NORTH_FLOOR, 520.0, -d), smoothstep(SOUTH_FLOOR, 430.0, d)
    sides = smoothstep(190.0, 470.0, np.abs(x)) * smoothstep(45.0, 160.0, np.abs(d))
    return np.maximum(np.maximum(north, south), 0.8 * sides)


def ground_height(x: Plane, z: Plane, seed: int) -> Float[np.ndarray, "..."]:
    """Height of the land, metres above the valley floor at the river.

    Ridged noise over rolling noise where it is hilly, less the river's bed. One height for every
    (x, z), so there is no overhang.

    Args:
        x, z: places within the land, metres: of one shape, or x [1, columns] with z [rows, 1].
        seed: of the hills.
    """
    d, hills = from_river(x, z), hilliness(x, z)
    # The square root rounds the ridges' crests: an edge there would be steep on any grid.
    ridges = 1.14 - np.sqrt(_noise(x, z, 310.0, 3, seed) ** 2 + 0.02)
    rolling = 0.5 + 0.5 * _noise(x, z, 190.0, 4, seed + 1)
    floor = 0.25 * _noise(x, z, 30.0, 2, seed + 2) * smoothstep(20.0, 60.0, np.abs(d))
    rise = 0.012 * np.maximum(np.abs(d) - BANK, 0.0)
    land = floor + rise + hills * (12.0 + 110.0 * ridges**3 + 42.0 * rolling)
    return land - BED_DEPTH * (1.0 - smoothstep(BED, BANK, np.abs(d)))


class Ground(NamedTuple):
    """A square grid of heights, each cell cut from its north-west to its south-east corner."""

    heights: Float64[np.ndarray, "rows columns"]

    @property
    def cells(self) -> int:
        """Cells along one side."""
        return len(self.heights) - 1

    def at(
        self, x: Float[np.ndarray, "points"], z: Float[np.ndarray, "points"]
    ) -> Float64[np.ndarray, "points"]:
        """Exact height of the triangles at places within the land."""
        along = np.clip((x / SIZE + 0.5) * self.cells, 0.0, self.cells)
        down = np.clip((z / SIZE + 0.5) * self.cells, 0.0, self.cells)
        column = np.minimum(along.astype(int), self.cells - 1)
        row = np.minimum(down.astype(int), self.cells - 1)
        u, v = along - column, down - row
        a, d = self.heights[row, column], self.heights[row + 1, column + 1]
        b, c = self.heights[row, column + 1], self.heights[row + 1, column]
        return np.where(u > v, a + u * (b - a) + v * (d - b), a + v * (c - a) + u * (d - c))

    def mesh(self) -> Mesh:
        """Its triangles, with smooth normals."""
        side = np.linspace(-0.5 * SIZE, 0.5 * SIZE, self.cells + 1)
        z, x = np.meshgrid(side, side, indexing="ij")
        points = np.stack([x, self.heights, z], axis=-1)
        number = np.arange(x.size).reshape(x.shape)
        a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
        triangles = np.stack([a, c, d, a, d, b], axis=-1).reshape(-1, 3)
        positions = points.reshape(-1, 3)
        # Area-weighted means: central differences may point behind a triangle on a crest.
        areas = area_vectors(positions[triangles]).reshape(self.cells, self.cells, 2, 3)
        total = np.zeros_like(points)
        for shift, share in (
            ((0, 0), areas.sum(axis=2)),
            ((1, 1), areas.sum(axis=2)),
            ((1, 0), areas[:, :, 0]),
            ((0, 1), areas[:, :, 1]),
        ):
            rows, columns = (slice(k, k + self.cells) for k in shift)
            total[rows, columns] += share
        return Mesh(positions, unit(total).reshape(-1, 3), triangles)


def make_ground(cells: int, seed: int) -> Ground:
    """The land's height field on a grid of cells x cells."""
    side = np.linspace(-0.5 * SIZE, 0.5 * SIZE, cells + 1)
    x, z = side[None, :], side[:, None]
    return Ground(ground_height(x, z, seed))


def ground_uvs(positions: Float[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 2"]:
    """Texture coordinates of the land: u east, v north, kept off the edge, where they repeat."""
    inside = np.clip(positions[:, [0, 2]] / SIZE, -0.4995, 0.4995)
    return np.stack([0.5 + inside[:, 0], 0.5 - inside[:, 1]], axis=-1)


def street_distance(x: Plane, z: Plane) -> Float[np.ndarray, "..."]:
    """Distance to the nearest street's middle line, metres."""
    nearest = np.full(np.broadcast_shapes(x.shape, z.shape), np.inf, x.dtype)
    for (x0, z0), (x1, z1) in STREETS:
        dx, dz = x1 - x0, z1 - z0
        t = np.clip(((x - x0) * dx + (z - z0) * dz) / (dx * dx + dz * dz), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(x - x0 - t * dx, z - z0 - t * dz))
    return nearest


def woods(x: Plane, z: Plane, seed: int) -> Plane:
    """How dense the forest is, in [0, 1]: patches on the hills."""
    patches = smoothstep(-0.12, 0.25, _noise(x, z, 120.0, 3, seed + 3))
    return patches * smoothstep(0.03, 0.2, hilliness(x, z))


def ground_colours(texels: int, seed: int) -> Float32[np.ndarray, "texels texels 3"]:
    """Base colour of the land (linear), row 0 in the north: by slope, height, water and use."""
    middle = ((np.arange(texels) + 0.5) / texels * SIZE - 0.5 * SIZE).astype(np.float32)
    x, z = middle[None, :], middle[:, None]
    d, heights = from_river(x, z), ground_height(x, z, seed)
    down, along = np.gradient(heights, SIZE / texels)
    slope = np.hypot(down, along)
    coarse, fine = _noise(x, z, 60.0, 3, seed + 4), _noise(x, z, 7.0, 2, seed + 5)

    colour = _over(np.array(GRASS, np.float32), MEADOW, smoothstep(-0.35, 0.4, coarse + 0.2 * fine))
    colour = _over(colour, FOREST_FLOOR, 0.8 * woods(x, z, seed))
    flat = 1.0 - smoothstep(0.02, 0.1, hilliness(x, z))
    crop, border = _fields(x, z, seed)
    away = smoothstep(30.0, 34.0, np.abs(d)) * (1.0 - _village(x, z))
    colour = _over(colour, crop * (1.0 + 0.12 * fine)[..., None], flat * away * border)
    colour = _over(colour, SCREE, 0.7 * smoothstep(95.0, 140.0, heights + 18.0 * coarse))
    colour = _over(colour, ROCK, smoothstep(0.62, 0.85, slope + 0.12 * fine) * (np.abs(d) > 40.0))
    colour = _over(colour, SAND, 1.0 - smoothstep(19.0, 24.0, np.abs(d) + 2.5 * fine))
    water = _over(
        np.array(DEEP, np.float32), WATER, smoothstep(4.0, 13.0, np.abs(d) + 2.0 * coarse)
    )
    colour = _over(colour, water, 1.0 - smoothstep(12.8, 14.2, np.abs(d) + 0.5 * fine))
    west, east, north, south = SQUARE
    square = (x > west) & (x < east) & (z > north) & (z < south)
    colour = _over(colour, COBBLES, square.astype(np.float32))
    paved = 1.0 - smoothstep(STREET - 0.4, STREET + 0.6, street_distance(x, z) + 0.5 * fine)
    colour = _over(colour, ROAD, paved * (np.abs(d) > BED + 4.0))
    return np.clip(colour * (1.0 + 0.1 * fine)[..., None], 0.0, 0.9)


def _over(
    below: Float[np.ndarray, "..."],
    above: tuple[float, float, float] | Float[np.ndarray, "..."],
    share: Plane,
) -> Float[np.ndarray, "... 3"]:
    return below + share[..., None] * (np.asarray(above, np.float32) - below)


def _village(x: Plane, z: Plane) -> Plane:
    return (
        (1.0 - smoothstep(165.0, 180.0, np.abs(x)))
        * (1.0 - smoothstep(205.0, 215.0, -z))
        * (z < 0.0)
    )


def _fields(x: Plane, z: Plane, seed: int) -> tuple[Float[np.ndarray, "... 3"], Plane]:
    """Each place's crop, and 1 inside its field falling to 0 on the balk around it."""
    across, along = (x + 0.25 * z) / 58.0, (z - 0.25 * x) / 42.0
    column, row = np.floor(across), np.floor(along)
    table = np.random.default_rng([seed, 11]).integers(len(CROPS), size=(64, 64))
    crop: Int[np.ndarray, "..."] = table[column.astype(int) % 64, row.astype(int) % 64]
    edge = np.minimum(
        58.0 * np.minimum(across - column, column + 1.0 - across),
        42.0 * np.minimum(along - row, row + 1.0 - along),
    )
    return CROPS[crop], smoothstep(0.8, 1.8, edge)
