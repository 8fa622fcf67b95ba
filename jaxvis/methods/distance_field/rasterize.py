"""Visibility maps by rasterised shadow maps: the baseline of paper 002, section 7 (host, no rays).

At every sample all triangles are drawn into a hemicube (Cohen and Greenberg 1985, "The Hemi-Cube"):
a square above the sample and four half squares round it. The texels of the visibility map then look
up their directions in it.

What a shadow map stores is the nearest depth, and a direction is occluded where that is finite.
Light from infinity asks no more, so that we keep the one bit "something was drawn here" in place of
the depth. Nothing is culled by its winding: both sides of a triangle cast shadows.

Triangles are drawn in homogeneous coordinates (Olano and Greer 1997, "Triangle Scan Conversion
Using 2D Homogeneous Coordinates"): a texel is covered where its direction lies on the inner side of
the three planes through the sample and an edge. That holds for triangles that pass beside or behind
the sample too, so that there is no near plane, and nothing is clipped: what touches the surface
beside the sample, whose origin is a tiny step off it, covers what it covers for a ray.
"""

import functools
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Bool, Float32, Int32
from tqdm.auto import tqdm

from jaxvis.compiled import compiled
from jaxvis.cores import core_count
from jaxvis.scene import Scene
from jaxvis.sphere.hemisphere_grid import texel_directions

BLOCK = 8
"""Samples that a thread takes at a time."""

ROUNDING = 1e-6
"""Of a texel: more than rounding moves an edge by. Texels so close to it count as covered."""

EDGE_ON = 1e-9
"""Of the terms of a determinant: where it is less, the sample is in the triangle's plane."""

# Signs kept of each vertex: one bit each, set where the coordinate named is positive.
X, Y, Z, X_MINUS_Z, X_PLUS_Z, Y_MINUS_Z, Y_PLUS_Z, X_MINUS_Y, X_PLUS_Y = (1 << i for i in range(9))

TOP, RIGHT, LEFT, FRONT, BACK, NONE = range(6)
"""Faces of the hemicube: above the sample, and in the direction of +x, -x, +y and -y."""

UP_AXES = (1, 2, 2, 2, 2)
DEPTH_AXES = (2, 0, 0, 1, 1)
DEPTH_SIGNS = (1.0, 1.0, -1.0, 1.0, -1.0)
"""Of each face: which coordinate its rows follow, and which one, with its sign, is the depth."""

# A triangle misses a face if all its vertices lie beyond one of the planes that bound what the face
# sees: if none has a sign of the first line, or all have one of the second.
NEEDED = (
    X_PLUS_Z | Y_PLUS_Z,
    X | X_MINUS_Y | X_PLUS_Y | X_MINUS_Z,
    0,
    Y | X_PLUS_Y | Y_MINUS_Z,
    X_MINUS_Y,
)
EXCLUDED = (
    X_MINUS_Z | Y_MINUS_Z,
    0,
    X | X_MINUS_Y | X_PLUS_Y | X_PLUS_Z,
    X_MINUS_Y,
    Y | X_PLUS_Y | Y_PLUS_Z,
)

RISING, FALLING, LEVEL = range(3)
"""Where an edge's inner side is: right of it, left of it, or above or below a level one."""


def rasterized_maps(
    scene: Scene,
    origins: Float32[np.ndarray, "samples 3"],
    frames: Float32[np.ndarray, "samples 3 3"],
    resolution: int,
    progress: bool = False,
    *,
    faces: int | None = None,
    threads: int | None = None,
) -> Bool[np.ndarray, "samples resolution resolution"]:
    """Which texels of each sample's hemisphere map see the sky, every triangle drawn (no rays).

    Maps are those of ``jaxvis.sphere.hemisphere_grid``. A texel is decided by the hemicube texel
    that its centre falls into, so that beside a silhouette it may differ from a ray's answer.

    Args:
        origins: where the samples look from, off their surface; centred coordinates.
        frames: tangent, bitangent and normal of each sample as rows, orthonormal.
        resolution: texels along an edge of a map.
        progress: shows a bar.
        faces: hemicube texels along an edge of its top, an even number; as many as the map has if
            None (the hemicube then has three for each of the map's).
        threads: how many threads draw; all cores if None. Results do not depend on it.

    Raises:
        ValueError: ``resolution``, ``faces`` or ``threads`` is out of range, or an origin or frame
            is missing or not finite.
    """
    if resolution < 1:
        raise ValueError(f"resolution must be at least 1, got {resolution}")
    faces = resolution + resolution % 2 if faces is None else faces
    if faces < 2 or faces % 2:
        raise ValueError(f"faces must be an even number of texels, at least 2, got {faces}")
    threads = core_count() if threads is None else threads
    if threads < 1:
        raise ValueError(f"threads must be at least 1, got {threads}")
    if len(origins) != len(frames):
        raise ValueError(f"needs a frame for each origin, got {len(frames)} for {len(origins)}")
    bad = ~(np.isfinite(origins).all(axis=1) & np.isfinite(frames).all(axis=(1, 2)))
    if bad.any():
        first = int(np.argmax(bad))
        raise ValueError(f"origins and frames must be finite: leave out sample {first}")

    maps = np.empty((len(origins), resolution, resolution), bool)
    flat = maps.reshape(len(origins), resolution**2)
    # Read-only arrays, as a scene's are, would compile anew.
    positions, triangles = np.array(scene.positions), np.array(scene.triangles)
    starts = np.array(origins, np.float32)
    axes = np.array(frames, np.float32)
    texels = hemicube_texels(resolution, faces)

    def draw(block: slice) -> int:
        _draw(positions, triangles, starts[block], axes[block], faces, texels, flat[block])
        return len(starts[block])

    blocks = [slice(i, i + BLOCK) for i in range(0, len(origins), BLOCK)]
    with tqdm(
        total=len(origins), desc="shadow maps", unit="sample", leave=False, disable=not progress
    ) as bar:
        for done in _in_threads(draw, blocks, threads):
            bar.update(done)
    return maps


@functools.lru_cache(maxsize=8)
def hemicube_texels(resolution: int, faces: int) -> Int32[np.ndarray, "texels"]:
    """The hemicube's texel that each texel of a map, row by row, looks up.

    The hemicube is kept flat: the top (rows y, columns x), then the sides about +x, -x (columns y),
    +y and -y (columns x) with rows from the horizon up; columns run from -1 to 1.
    """
    x, y, z = np.moveaxis(texel_directions(resolution).astype(np.float64), -1, 0)
    ax, ay = np.abs(x), np.abs(y)
    top = (z >= ax) & (z >= ay)
    sideways = ax >= ay
    depth = np.where(top, z, np.where(sideways, ax, ay))
    along = np.where(top | ~sideways, x, y) / depth
    up = np.where(top, y, z) / depth
    column = np.clip(np.floor((along + 1.0) * (faces / 2)), 0, faces - 1)
    row = np.where(top, np.floor((up + 1.0) * (faces / 2)), np.floor(up * (faces / 2)))
    row = np.clip(row, 0, np.where(top, faces, faces // 2) - 1)
    side = np.where(sideways, np.where(x > 0.0, 0, 1), np.where(y > 0.0, 2, 3))
    first = np.where(top, 0, faces * faces + side * (faces // 2) * faces)
    texels = (first + row * faces + column).astype(np.int32).reshape(-1)
    texels.flags.writeable = False
    return texels


def _in_threads(draw: Callable[[slice], int], blocks: list[slice], threads: int) -> Iterator[int]:
    """Samples drawn in each block, in order."""
    if threads == 1 or len(blocks) < 2:
        yield from map(draw, blocks)
        return
    with ThreadPoolExecutor(threads, thread_name_prefix="jaxvis-shadow-maps") as pool:
        yield from pool.map(draw, blocks)


@compiled
def _draw(positions, triangles, origins, frames, faces, texels, maps):
    """Fills the map of each sample."""
    vertices = len(positions)
    local = np.empty((vertices, 3))
    place = np.empty((vertices, 2))
    signs = np.empty(vertices, np.uint16)
    seen_in = np.empty(vertices, np.uint8)
    covered = np.empty(3 * faces * faces, np.uint8)
    for sample in range(len(origins)):
        _project(positions, origins[sample], frames[sample], faces, local, place, signs, seen_in)
        covered[:] = 0
        for t in range(len(triangles)):
            i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            either = signs[i] | signs[j] | signs[k]
            if not either & Z:
                continue  # below the horizon
            face = seen_in[i]
            if face == seen_in[j] and face == seen_in[k] and face != NONE:
                low = np.ceil(min(place[i, 0], place[j, 0], place[k, 0]) - ROUNDING)
                if low > max(place[i, 0], place[j, 0], place[k, 0]) + ROUNDING:
                    continue  # between two columns of texel centres
                first = np.ceil(min(place[i, 1], place[j, 1], place[k, 1]) - ROUNDING)
                last = np.floor(max(place[i, 1], place[j, 1], place[k, 1]) + ROUNDING)
                if first <= last:
                    _fill(local, i, j, k, face, faces, int(first), int(last), covered)
                continue
            every = signs[i] & signs[j] & signs[k]
            for face in range(NONE):
                if either & NEEDED[face] == NEEDED[face] and not every & EXCLUDED[face]:
                    first, last = _rows(local, i, j, k, face, faces)
                    _fill(local, i, j, k, face, faces, first, last, covered)
        for texel in range(len(texels)):
            maps[sample, texel] = covered[texels[texel]] == 0


@compiled
def _project(positions, origin, frame, faces, local, place, signs, seen_in):
    """Vertices in the sample's frame; signs; the face each is seen in and (column, row) there."""
    ox, oy, oz = np.float64(origin[0]), np.float64(origin[1]), np.float64(origin[2])
    half = 0.5 * faces
    for v in range(len(positions)):
        dx, dy, dz = positions[v, 0] - ox, positions[v, 1] - oy, positions[v, 2] - oz
        x = frame[0, 0] * dx + frame[0, 1] * dy + frame[0, 2] * dz
        y = frame[1, 0] * dx + frame[1, 1] * dy + frame[1, 2] * dz
        z = frame[2, 0] * dx + frame[2, 1] * dy + frame[2, 2] * dz
        local[v, 0], local[v, 1], local[v, 2] = x, y, z
        signs[v] = (
            (x > 0.0) * X
            | (y > 0.0) * Y
            | (z > 0.0) * Z
            | (x > z) * X_MINUS_Z
            | (x > -z) * X_PLUS_Z
            | (y > z) * Y_MINUS_Z
            | (y > -z) * Y_PLUS_Z
            | (x > y) * X_MINUS_Y
            | (x > -y) * X_PLUS_Y
        )
        ax, ay = abs(x), abs(y)
        if z <= 0.0:
            seen_in[v] = NONE
        elif z >= ax and z >= ay:
            seen_in[v] = TOP
            scale = half / z
            place[v, 0] = x * scale + half - 0.5
            place[v, 1] = y * scale + half - 0.5
        elif ax >= ay:
            seen_in[v] = RIGHT if x > 0.0 else LEFT
            scale = half / ax
            place[v, 0] = y * scale + half - 0.5
            place[v, 1] = z * scale - 0.5
        else:
            seen_in[v] = FRONT if y > 0.0 else BACK
            scale = half / ay
            place[v, 0] = x * scale + half - 0.5
            place[v, 1] = z * scale - 0.5


@compiled
def _rows(local, i, j, k, face, faces):
    """First and last row of texel centres that a triangle may cover on a face."""
    last = faces - 1 if face == TOP else faces // 2 - 1
    up, depth, sign = UP_AXES[face], DEPTH_AXES[face], DEPTH_SIGNS[face]
    a, b, c = sign * local[i, depth], sign * local[j, depth], sign * local[k, depth]
    if min(a, b, c) <= 0.0:
        return 0, last  # it reaches behind the sample: its projection goes through infinity
    a, b, c = local[i, up] / a, local[j, up] / b, local[k, up] / c
    half = 0.5 * faces
    shift = half - 0.5 if face == TOP else -0.5
    low = np.ceil(min(a, b, c) * half + shift - ROUNDING)
    high = np.floor(max(a, b, c) * half + shift + ROUNDING)
    return int(min(max(low, 0.0), last + 1.0)), int(max(min(high, np.float64(last)), -1.0))


@compiled
def _fill(local, i, j, k, face, faces, first, last, covered):
    """Draws a triangle on the rows of a face: between its edges where they cross each row."""
    ax, ay, az = local[i, 0], local[i, 1], local[i, 2]
    bx, by, bz = local[j, 0], local[j, 1], local[j, 2]
    cx, cy, cz = local[k, 0], local[k, 1], local[k, 2]
    # Normals of the planes through the sample and an edge. Two triangles that share an edge find
    # exactly opposite ones, so that no texel falls between them.
    px, py, pz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    qx, qy, qz = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
    rx, ry, rz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    volume = ax * px + ay * py + az * pz
    if abs(volume) <= EDGE_ON * (abs(ax * px) + abs(ay * py) + abs(az * pz)):
        return  # seen from its edge
    side = 1.0 if volume > 0.0 else -1.0
    kind_p, start_p, step_p = _edge(side * px, side * py, side * pz, face, faces)
    kind_q, start_q, step_q = _edge(side * qx, side * qy, side * qz, face, faces)
    kind_r, start_r, step_r = _edge(side * rx, side * ry, side * rz, face, faces)
    base = 0 if face == TOP else faces * faces + (face - 1) * (faces // 2) * faces
    for row in range(first, last + 1):
        low, high = 0.0, faces - 1.0
        low, high = _narrow(low, high, kind_p, start_p + row * step_p)
        low, high = _narrow(low, high, kind_q, start_q + row * step_q)
        low, high = _narrow(low, high, kind_r, start_r + row * step_r)
        if low <= high:
            begin = base + row * faces
            for texel in range(begin + int(np.ceil(low)), begin + int(np.floor(high)) + 1):
                covered[texel] = 1


@compiled
def _edge(x, y, z, face, faces):
    """How the inner half space of a plane through the sample cuts a face's rows of texel centres.

    Returns its kind and a linear function of the row: for RISING and FALLING the column from which
    on, or up to which, texels are inside; for LEVEL a number, negative where the row is outside.
    """
    if face == TOP:
        along, up, deep = x, y, z
    elif face == RIGHT:
        along, up, deep = y, z, x
    elif face == LEFT:
        along, up, deep = y, z, -x
    elif face == FRONT:
        along, up, deep = x, z, y
    else:
        along, up, deep = x, z, -y
    first = 1.0 / faces - 1.0 if face == TOP else 1.0 / faces
    at_first, step = up * first + deep, up * (2.0 / faces)
    size = max(abs(up), abs(deep))
    if abs(along) <= ROUNDING * size:
        return LEVEL, at_first + ROUNDING * size, step
    half = 0.5 * faces
    columns = half / along
    kind = RISING if along > 0.0 else FALLING
    return kind, half - 0.5 - at_first * columns, -step * columns


@compiled
def _narrow(low, high, kind, value):
    """The columns that an edge leaves of a span."""
    if kind == RISING:
        return max(low, value - ROUNDING), high
    if kind == FALLING:
        return low, min(high, value + ROUNDING)
    return (low, high) if value >= 0.0 else (1.0, 0.0)
