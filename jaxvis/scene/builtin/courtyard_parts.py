"""What the courtyard is furnished with: columns, arches, doors, cloth and vases (host)."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from jaxvis.scene.builtin.mesh import Mesh, grid, grid_normals, join
from jaxvis.scene.builtin.shapes import box, cell_count, lathe

BURIED = 0.02
"""Depth by which one part reaches into the next, so that no open edge can be seen."""


def column(height: float, radius: float, spacing: float) -> Mesh:
    """A round column with base and capital under a square abacus, standing on y = 0.

    The abacus' top is a little above ``height``, for what it carries to rest in.
    """
    around = 2 * max(4, cell_count(np.pi * radius, 0.6 * spacing))
    plinth, block = 0.5 * radius, 0.5 * radius
    top = height - block
    sections = [
        # The torus of the base bulges over the plinth, then the shaft leaves it in a hollow curve.
        _arc((1.15 * radius, plinth + 0.25 * radius), 0.25 * radius, -0.5, 0.5, spacing),
        _curve(
            (1.15 * radius, plinth + 0.5 * radius),
            (radius, plinth + 0.6 * radius),
            (radius, plinth + radius),
            spacing,
        ),
        # The shaft narrows by a sixth, in a gentle curve.
        _curve(
            (radius, plinth + radius),
            (radius, plinth + radius + 0.5 * (top - plinth)),
            (0.84 * radius, top - 1.2 * radius),
            spacing,
        ),
        _arc((0.84 * radius, top - 1.1 * radius), 0.1 * radius, -0.5, 0.5, spacing),
        _curve(
            (0.84 * radius, top - radius),
            (0.88 * radius, top - 0.25 * radius),
            (1.35 * radius, top + BURIED),
            spacing,
        ),
    ]
    turned = [lathe(section, around) for section in sections]
    foot = box((3.0 * radius, plinth + BURIED, 3.0 * radius), 2.0 * spacing)
    head = box((3.0 * radius, block + BURIED, 3.0 * radius), 2.0 * spacing)
    return join([*turned, foot.moved((0.0, -BURIED, 0.0)), head.moved((0.0, top, 0.0))])


def arch(width: float, height: float, radius: float, depth: float, spacing: float) -> Mesh:
    """A wall with a semicircular opening, over a bay from column to column.

    The wall is ``width`` wide about x = 0, from y = 0 (the spring line) to ``height``, ``depth``
    thick about z = 0. It has its two faces and the underside of the arch; what joins it to the next
    bay and to the columns is left open.
    """
    angle = _arch_angles(0.5 * width, height, radius, spacing)
    inner = radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    reach = np.minimum(
        0.5 * width / np.maximum(np.abs(np.cos(angle)), 1e-9),
        height / np.maximum(np.sin(angle), 1e-9),
    )
    outer = reach[:, None] / radius * inner
    rows = np.linspace(0.0, 1.0, cell_count(height - radius, spacing) + 1)[:, None, None]
    flat = inner + rows * (outer - inner)
    face = np.concatenate([flat, np.full((*flat.shape[:2], 1), 0.5 * depth)], axis=-1)
    front = grid(face, np.broadcast_to([0.0, 0.0, 1.0], face.shape))
    across = np.linspace(-0.5, 0.5, cell_count(depth, spacing) + 1) * depth
    return join([front, front.mirrored(), _along_z(inner, -inner / radius, across)])


def _arch_angles(
    half_width: float, height: float, radius: float, spacing: float
) -> Float64[np.ndarray, "columns"]:
    """Angles around the opening, from 0 to pi, that include the wall's two upper corners."""
    corner = np.arctan2(height, half_width)
    side = max(2, int(np.ceil(corner * radius / spacing)))
    top = 2 * max(1, int(np.ceil((0.5 * np.pi - corner) * radius / spacing)))
    right = np.linspace(0.0, corner, side + 1)
    middle = np.linspace(corner, np.pi - corner, top + 1)
    return np.concatenate([right, middle[1:-1], np.pi - right[::-1]])


def _along_z(
    path: Float64[np.ndarray, "columns 2"],
    normals: Float64[np.ndarray, "columns 2"],
    across: Float64[np.ndarray, "rows"],
) -> Mesh:
    """A path in the plane of x and y, drawn out along z."""
    shape = (len(across), len(path))
    flat = np.broadcast_to(path, (*shape, 2))
    z = np.broadcast_to(across[:, None], shape)[..., None]
    level = np.zeros((*shape, 1))
    facing = np.concatenate([np.broadcast_to(normals, (*shape, 2)), level], axis=-1)
    return grid(np.concatenate([flat, z], axis=-1), facing)


def opening_frame(width: float, spring: float, trim: float, spacing: float) -> Mesh:
    """The raised frame of an arched door or window, on a wall in z = 0 that faces +z.

    The opening is ``width`` wide; its jambs stand from y = 0 to ``spring``. The frame is ``trim``
    wide and stands half as far out of the wall.
    """
    radius, out = 0.5 * width, 0.5 * trim
    jambs = cell_count(spring, spacing)
    steps = 2 * max(2, int(np.ceil(0.5 * np.pi * radius / spacing)))
    angle = np.concatenate([np.zeros(jambs), np.linspace(0.0, np.pi, steps + 1), [np.pi] * jambs])
    y = np.concatenate([np.linspace(0.0, spring, jambs + 1)[:-1], np.full(steps + 1, spring)])
    y = np.concatenate([y, np.linspace(spring, 0.0, jambs + 1)[1:]])
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    foot = np.stack([np.zeros_like(y), y], axis=-1)
    inner, outer = foot + radius * outward, foot + (radius + trim) * outward
    depths = np.array([-BURIED, out])
    flat = np.stack([inner, outer])
    face = np.concatenate([flat, np.full((*flat.shape[:2], 1), out)], axis=-1)
    front = grid(face, np.broadcast_to([0.0, 0.0, 1.0], face.shape))
    return join([front, _along_z(inner, -outward, depths), _along_z(outer, outward, depths)])


def opening_leaf(width: float, spring: float, spacing: float) -> Mesh:
    """The door or shutter in an :func:`opening_frame`, just before the wall."""
    radius = 0.5 * width
    jambs = cell_count(spring, spacing)
    angle = np.linspace(0.0, 0.5 * np.pi, max(2, cell_count(0.5 * np.pi * radius, spacing)) + 1)
    y = np.concatenate([np.linspace(0.0, spring, jambs + 1)[:-1], spring + radius * np.sin(angle)])
    half = np.concatenate([np.full(jambs, radius), radius * np.cos(angle)])
    half[-1] = 0.0
    across = np.linspace(-1.0, 1.0, 2 * cell_count(radius, spacing) + 1)
    points = np.stack(np.broadcast_arrays(half[:, None] * across, y[:, None], BURIED), axis=-1)
    return grid(points, np.broadcast_to([0.0, 0.0, 1.0], points.shape))


def curtain(width: float, height: float, side: int, spacing: float) -> Mesh:
    """A pleated curtain tied back to one side, hanging from y = 0 in the plane z = 0.

    It is ``width`` wide at the rail, gathered to a quarter of that at a tie three fifths down, and
    falls open below; ``side`` is -1 or 1, the side in x that it is drawn to.
    """
    columns = 2 * max(12, cell_count(width, spacing))
    rows = max(8, cell_count(height, spacing))
    u = np.linspace(-1.0, 1.0, columns + 1)[None, :]
    v = np.linspace(0.0, 1.0, rows + 1)[:, None]
    tie = np.exp(-(((v - 0.6) / np.where(v < 0.6, 0.32, 0.22)) ** 2))
    half = 0.5 * width * (1.0 - 0.74 * tie)
    drawn = side * (0.5 * width - half)
    pleat = 0.035 + 0.075 * v * (1.0 - 0.5 * tie)
    phase = 4.0 * np.pi * u
    x = drawn + half * (u + 0.015 * np.sin(2.0 * phase))
    z = pleat * np.sin(phase + 0.6 * np.sin(3.0 * v)) + 0.05 * np.sin(4.0 * v + 1.3 * u)
    # The inner edge sags, as cloth does that is pulled aside.
    sag = 0.03 * tie * (1.0 - side * u) * np.sin(np.pi * np.minimum(v / 0.6, 1.0))
    y = np.broadcast_to(-height * v, x.shape) - sag
    points = np.stack([x, y, z], axis=-1)
    return grid(points, grid_normals(points))


def banner(width: float, drop: float, thickness: float, spacing: float) -> Mesh:
    """A cloth thrown over a parapet whose top is y = 0 and which is ``thickness`` wide about z = 0.

    It hangs down by ``drop`` on the side of +z, pushed forward by the moulding below, and a third
    as far behind, in folds that grow downwards; its lower edge is a shallow point.
    """
    columns = 2 * max(6, cell_count(width, spacing))
    half = 0.5 * thickness + 0.03
    turn = 0.5 * np.pi * half
    total = drop / 3.0 + 2.0 * turn + drop
    rows = max(10, cell_count(total, spacing))
    along = np.linspace(0.0, total, rows + 1)[:, None]
    u = np.linspace(-1.0, 1.0, columns + 1)[None, :]
    behind = np.minimum(along - drop / 3.0, 0.0)
    hanging = np.maximum(along - drop / 3.0 - 2.0 * turn, 0.0)
    angle = np.clip((along - drop / 3.0) / half, 0.0, np.pi)
    down = hanging / drop
    fold = down * (0.06 * np.sin(4.5 * np.pi * u) + 0.03 * np.sin(2.0 * u + 5.0 * down))
    ease = np.clip(hanging / 0.8, 0.0, 1.0)
    forward = 0.32 * ease**2 * (3.0 - 2.0 * ease)
    x = 0.5 * width * u * (1.0 - 0.06 * down)
    y = behind + BURIED + 0.35 * half * np.sin(angle) - hanging * (1.0 + 0.08 * (1.0 - np.abs(u)))
    z = -half * np.cos(angle) + fold + forward
    points = np.stack(np.broadcast_arrays(x, y, z), axis=-1)
    return grid(points, grid_normals(points))


def vase(height: float, spacing: float) -> Mesh:
    """A vase with a foot, a belly, a neck and an inside, standing on y = 0."""
    around = 2 * max(5, cell_count(height, spacing))
    # (radius, height) in units of the vase's height: outside up to the lip, then inside down.
    foot = ((0.2, -0.02), (0.2, 0.05), (0.14, 0.08), (0.12, 0.11))
    outside = ((0.12, 0.11), (0.25, 0.2), (0.34, 0.42), (0.33, 0.6), (0.22, 0.78), (0.17, 0.86))
    lip = ((0.17, 0.86), (0.18, 0.92), (0.24, 0.98), (0.235, 1.0), (0.21, 0.99))
    inside = ((0.21, 0.99), (0.145, 0.88), (0.2, 0.77), (0.3, 0.6), (0.31, 0.42), (0.0, 0.2))
    sections = [_smooth(section, height, spacing) for section in (foot, outside, lip, inside)]
    return join([lathe(section, around) for section in sections])


def _smooth(
    corners: Sequence[tuple[float, float]], scale: float, spacing: float
) -> Float64[np.ndarray, "rows 2"]:
    """A smooth curve through points (Catmull-Rom), in steps of about the spacing."""
    points = scale * np.array(corners)
    ends = np.concatenate([[2.0 * points[0] - points[1]], points, [2.0 * points[-1] - points[-2]]])
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=-1).sum())
    steps = max(1, cell_count(length, spacing) // (len(points) - 1))
    t = np.linspace(0.0, 1.0, steps + 1)[:-1, None]
    pieces = []
    for before, start, end, after in zip(ends[:-3], ends[1:-2], ends[2:-1], ends[3:], strict=True):
        slope, next_slope = 0.5 * (end - before), 0.5 * (after - start)
        pieces.append(
            (1.0 + 2.0 * t) * (1.0 - t) ** 2 * start
            + t * (1.0 - t) ** 2 * slope
            + t**2 * (3.0 - 2.0 * t) * end
            - t**2 * (1.0 - t) * next_slope
        )
    curve = np.concatenate([*pieces, points[-1:]])
    return np.maximum(curve, [0.0, -np.inf])


def _arc(
    centre: tuple[float, float], radius: float, start: float, stop: float, spacing: float
) -> Float64[np.ndarray, "rows 2"]:
    """An arc of a profile; angles in units of pi, from the outward direction upwards."""
    steps = max(2, cell_count(np.pi * radius * (stop - start), spacing))
    angle = np.pi * np.linspace(start, stop, steps + 1)
    return np.asarray(centre) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _curve(
    start: tuple[float, float],
    bend: tuple[float, float],
    stop: tuple[float, float],
    spacing: float,
) -> Float64[np.ndarray, "rows 2"]:
    """A parabola of a profile between two points (a quadratic Bézier curve)."""
    a, b, c = np.array([start, bend, stop])
    steps = cell_count(float(np.linalg.norm(c - a)), 2.0 * spacing)
    t = np.linspace(0.0, 1.0, steps + 1)[:, None]
    return (1.0 - t) ** 2 * a + 2.0 * t * (1.0 - t) * b + t**2 * c
