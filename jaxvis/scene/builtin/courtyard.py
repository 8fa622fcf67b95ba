"""An atrium with colonnades on two storeys: stands in for Sponza, at any size."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from jaxvis.reflectance import Lambert, Material
from jaxvis.scene.build import build_scene
from jaxvis.scene.builtin.courtyard_parts import (
    BURIED,
    arch,
    banner,
    column,
    curtain,
    opening_frame,
    opening_leaf,
    vase,
)
from jaxvis.scene.builtin.mesh import Mesh, join, rectangle, weld
from jaxvis.scene.builtin.parameters import Number, whole
from jaxvis.scene.builtin.shapes import box, rectangle_sweep
from jaxvis.scene.camera import Camera
from jaxvis.scene.scene import Scene

HALF_X, HALF_Z = 11.0, 3.75
"""Half the distance between the rows of columns, metres: everything is measured from there."""
BAYS_X, BAYS_Z = 8, 3
GALLERY = 3.5
"""From the columns to the outer walls, which are WALL thick."""
WALL = 0.5
STEP = 0.15
"""Height of the galleries' floor above the court."""
LOWER_SPRING, LOWER_CEILING = 3.6, 5.5
UPPER_FLOOR, UPPER_SPRING, UPPER_CEILING = 6.0, 8.6, 10.4
PARAPET = 7.0
WALL_TOP = 12.0

MATERIALS = (
    Material(base_colour=(0.52, 0.48, 0.42), name="court paving"),
    Material(base_colour=(0.52, 0.36, 0.26), name="gallery paving"),
    Material(base_colour=(0.70, 0.63, 0.52), name="stone"),
    Material(base_colour=(0.76, 0.72, 0.64), name="marble"),
    Material(base_colour=(0.78, 0.70, 0.57), name="plaster"),
    Material(base_colour=(0.50, 0.23, 0.13), name="roof tiles"),
    Material(base_colour=(0.22, 0.14, 0.08), name="wood"),
    Material(base_colour=(0.55, 0.28, 0.16), name="terracotta"),
    Material(base_colour=(0.50, 0.06, 0.05), two_sided=True, name="red cloth"),
    Material(base_colour=(0.08, 0.24, 0.11), two_sided=True, name="green cloth"),
    Material(base_colour=(0.09, 0.14, 0.38), two_sided=True, name="blue cloth"),
)
NUMBER = {material.name: number for number, material in enumerate(MATERIALS)}

Place = tuple[float, float, float, int]
"""Where a part stands (x, y, z), and by how many quarter turns its +z points to +x."""


class Part(NamedTuple):
    """A mesh, what it is made of, and every place that it stands at."""

    mesh: Mesh
    material: str
    places: Sequence[Place] = ((0.0, 0.0, 0.0, 0),)


class Side(NamedTuple):
    """One of the court's four sides; turns 0 is the side of +z, 1 that of +x, and so on."""

    turns: int
    bays: int

    @property
    def width(self) -> float:
        """Width of a bay."""
        return 2.0 * (HALF_Z if self.turns % 2 else HALF_X) / self.bays

    def places(
        self, bays: Iterable[Number], height: float, outward: float = 0.0, turned: int = 0
    ) -> list[Place]:
        """Where parts stand along the side.

        Args:
            bays: positions along the side in bays; column k stands at k.
            height: of the parts' y = 0.
            outward: distance from the line of columns, away from the court.
            turned: further quarter turns. Without them +z of a part points away from the court.
        """
        away = (HALF_X if self.turns % 2 else HALF_Z) + outward
        along = [(bay - 0.5 * self.bays) * self.width for bay in bays]
        cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[self.turns]
        return [
            (cosine * a + sine * away, height, cosine * away - sine * a, self.turns + turned)
            for a in along
        ]


SIDES = (Side(0, BAYS_X), Side(1, BAYS_Z), Side(2, BAYS_X), Side(3, BAYS_Z))


def courtyard(triangles: Number = 60_000) -> Scene:
    """An atrium open to the sky, 30 x 15.5 m and 12 m high, inside.

    Round columns carry arches on two storeys around a court of 22 x 7.5 m; behind them run
    galleries with beams, doors and windows; curtains and banners of two-sided cloth hang in
    between. No face lies in another, and the outer walls let no light in.

    Args:
        triangles: 20,000 to 300,000, met within 10 % by the density of the tessellation.
    """
    parts = _parts(_spacing(whole("triangles", triangles, 20_000, 300_000)))
    meshes = [[part.mesh.moved(place[:3], place[3]) for place in part.places] for part in parts]
    mesh = weld(join(mesh for copies in meshes for mesh in copies))
    ids = np.repeat(
        [NUMBER[part.material] for part in parts],
        [sum(len(mesh.triangles) for mesh in copies) for copies in meshes],
    )
    return build_scene(
        mesh.positions,
        mesh.triangles,
        normals=mesh.normals[mesh.triangles],
        materials=MATERIALS,
        material_ids=ids,
        reflectance=Lambert(),
        camera=Camera(eye=(-10.2, 2.6, 1.1), target=(2.0, 3.7, -0.35), field_of_view=0.95),
        name="courtyard",
    )


def _spacing(triangles: int) -> float:
    """The spacing, in metres, that gives the count nearest to ``triangles``."""
    low, high = 0.05, 4.0
    best, miss = high, np.inf
    for _ in range(14):
        if miss < 0.005 * triangles:
            break
        middle = float(np.sqrt(low * high))
        count = sum(len(part.mesh.triangles) * len(part.places) for part in _parts(middle))
        if abs(count - triangles) < miss:
            best, miss = middle, abs(count - triangles)
        if count > triangles:
            low = middle
        else:
            high = middle
    return best


def _parts(spacing: float) -> list[Part]:
    return [
        *_building(spacing),
        *_storey(spacing, STEP, LOWER_SPRING, LOWER_CEILING, 0.28, 0.5),
        *_storey(spacing, UPPER_FLOOR, UPPER_SPRING, UPPER_CEILING, 0.2, 0.4),
        *_openings(spacing),
        *_furniture(spacing),
    ]


def _building(spacing: float) -> list[Part]:
    """Floors, ceilings, roof, parapet and outer walls: profiles carried around the court."""
    inside, outside = GALLERY, GALLERY + WALL
    sunk = GALLERY + BURIED

    def ring(*profile: tuple[float, float], coarser: float = 1.0) -> Mesh:
        return rectangle_sweep(HALF_X, HALF_Z, profile, coarser * spacing)

    court = rectangle(
        (0.7 - HALF_X, 0.0, 0.7 - HALF_Z),
        (0.0, 0.0, 2.0 * HALF_Z - 1.4),
        (2.0 * HALF_X - 1.4, 0.0, 0.0),
        (max(1, round(6.1 / spacing)), max(1, round(20.6 / spacing))),
    )
    return [
        Part(court, "court paving"),
        Part(ring((sunk, STEP), (-0.7, STEP)), "gallery paving"),
        Part(ring((-0.7, STEP), (-0.7, -BURIED)), "stone"),
        Part(ring((-0.3, LOWER_CEILING), (sunk, LOWER_CEILING)), "plaster"),
        Part(
            ring((-0.42, UPPER_FLOOR), (-0.42, 5.85), (-0.36, 5.8), (-0.36, 5.6), (-0.3, 5.5)),
            "stone",
        ),
        Part(ring((sunk, UPPER_FLOOR), (-0.42, UPPER_FLOOR)), "gallery paving"),
        Part(ring((0.12, UPPER_FLOOR - BURIED), (0.12, PARAPET - 0.1 + BURIED)), "stone"),
        Part(ring((-0.12, PARAPET - 0.1 + BURIED), (-0.12, UPPER_FLOOR - BURIED)), "stone"),
        Part(
            ring(
                (0.17, PARAPET - 0.1),
                (0.17, PARAPET),
                (-0.17, PARAPET),
                (-0.17, PARAPET - 0.1),
                (0.17, PARAPET - 0.1),
            ),
            "marble",
        ),
        Part(ring((-0.25, UPPER_CEILING), (sunk, UPPER_CEILING)), "plaster"),
        Part(
            ring((-0.6, 10.9), (-0.6, 10.75), (-0.5, 10.7), (-0.35, 10.5), (-0.25, UPPER_CEILING)),
            "stone",
        ),
        Part(ring((sunk, 11.6), (-0.6, 10.9), coarser=2.0), "roof tiles"),
        Part(ring((inside, WALL_TOP), (inside, -BURIED)), "plaster"),
        Part(
            ring((outside, -BURIED), (outside, WALL_TOP), (inside, WALL_TOP), coarser=4.0), "stone"
        ),
    ]


def _storey(
    spacing: float, floor: float, spring: float, ceiling: float, radius: float, depth: float
) -> list[Part]:
    """Columns, corner piers, arches, tie rods, and the galleries' beams and pilasters."""
    pillar = column(spring - floor, radius, 0.35 * spacing)
    pier = box((1.8 * depth, ceiling - floor + 2.0 * BURIED, 1.8 * depth), spacing)
    beam = box((0.28, 0.3 + 2.0 * BURIED, GALLERY + 2.0 * BURIED), spacing)
    pilaster = box((0.5, ceiling - floor + 2.0 * BURIED, 0.2), spacing)
    corners = [(x, floor - BURIED, z, 0) for x in (-HALF_X, HALF_X) for z in (-HALF_Z, HALF_Z)]
    parts = [Part(pier, "stone", corners)]
    for side in SIDES:
        ends, middles = range(1, side.bays), np.arange(side.bays) + 0.5
        opening = 0.5 * side.width - 1.3 * radius
        wall = arch(side.width, ceiling - spring + BURIED, opening, depth, 0.6 * spacing)
        rod = box((side.width - 0.5 * radius, 0.05, 0.05), 2.0 * spacing)
        parts += [
            Part(pillar, "marble", side.places(ends, floor)),
            Part(wall, "stone", side.places(middles, spring)),
            Part(rod, "wood", side.places(middles, spring - 0.06)),
            Part(beam, "wood", side.places(ends, ceiling - 0.3, 0.5 * GALLERY + BURIED)),
            Part(pilaster, "stone", side.places(ends, floor - BURIED, GALLERY - 0.1 + BURIED)),
        ]
    return parts


def _openings(spacing: float) -> list[Part]:
    """Doors on the lower galleries' outer walls, windows on the upper ones'."""
    parts = []
    sill = box((1.5, 0.1, 0.2), spacing)
    for side in SIDES:
        doors = [bay + 0.5 for bay in range(side.bays) if bay % 3 != 1]
        windows = np.arange(side.bays) + 0.5
        for bays, y, width, spring in (
            (doors, STEP - BURIED, 1.3, 2.3),
            (windows, UPPER_FLOOR + 1.0, 0.9, 1.4),
        ):
            inward = side.places(bays, y, GALLERY, turned=2)
            parts += [
                Part(opening_frame(width, spring, 0.2, 0.5 * spacing), "marble", inward),
                Part(opening_leaf(width, spring, spacing), "wood", inward),
            ]
        parts.append(Part(sill, "marble", side.places(windows, UPPER_FLOOR + 0.95, GALLERY - 0.08)))
    return parts


def _furniture(spacing: float) -> list[Part]:
    """Curtains between the lower columns, banners over the parapet, vases in the court."""
    cloth = 0.3 * spacing
    parts = []
    for side in (side for side in SIDES if side.bays == BAYS_X):
        for bay, colour in ((1, "red"), (5, "green")):
            for middle, drawn in ((bay + 0.5, 1), (bay + 1.5, -1)):
                hung = curtain(1.8, 3.25, drawn, cloth)
                place = side.places([middle], LOWER_SPRING - 0.045)
                parts.append(Part(hung, f"{colour} cloth", place))
        thrown = banner(1.4, 2.7, 0.34, cloth)
        for bays, colour in (([0, 4], "blue"), ([3, 7], "red")):
            middles = [bay + 0.5 for bay in bays]
            parts.append(Part(thrown, f"{colour} cloth", side.places(middles, PARAPET, turned=2)))
    small, large = vase(1.0, 0.2 * spacing), vase(1.5, 0.2 * spacing)
    around = [(x, 0.0, z, 0) for x in (-3.6, 8.25) for z in (-2.4, 2.4)]
    pedestal = box((1.3, 0.45 + BURIED, 1.3), spacing)
    return [
        *parts,
        Part(small, "terracotta", around),
        Part(pedestal, "marble", [(2.0, -BURIED, 0.0, 0)]),
        Part(large, "terracotta", [(2.0, 0.45, 0.0, 0)]),
    ]
