"""Primary rays: from a scene and a camera to the Surface that methods shade."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32

from jaxvis.reflectance import evaluate_materials
from jaxvis.scene.camera import Camera
from jaxvis.scene.scene import Scene
from jaxvis.scene.surface import Surface

RAYS_AT_ONCE = 1 << 18
"""Camera rays traced and interpolated together: bounds the float64 temporaries to about 100 MB."""

GRAZING = 1e-3
"""Cosine at which a shading normal still faces the viewer."""

LARGEST_SUPERSAMPLING = 16
"""256 rays per pixel; more is a slip."""


def trace_surface(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    *,
    supersampling: int = 1,
) -> Surface:
    """What each pixel sees of the scene.

    Args:
        scene: the scene.
        camera: the view, in world coordinates.
        size: (width, height) of the image in pixels.
        supersampling: n for n x n rays per pixel, through the centres of its n x n cells.

    Returns:
        A :class:`Surface` with [n height, n width] points; misses hold zeros, triangle -1 and the
        view direction.

    Raises:
        ValueError: the size or the supersampling is out of range.
    """
    width, height = _checked_size(size)
    if int(supersampling) != supersampling or not 1 <= supersampling <= LARGEST_SUPERSAMPLING:
        raise ValueError(
            f"supersampling must be an integer from 1 to {LARGEST_SUPERSAMPLING}, "
            f"got {supersampling}"
        )
    n = int(supersampling)
    columns, rows = width * n, height * n
    eye = np.subtract(camera.eye, scene.origin)
    step = max(1, RAYS_AT_ONCE // columns)
    bands = [
        _trace_rows(scene, eye, camera.directions(columns, rows, slice(row, row + step)))
        for row in range(0, rows, step)
    ]
    return _assemble(bands, (rows, columns), n, eye, scene)


def _checked_size(size: tuple[int, int]) -> tuple[int, int]:
    if len(size) != 2 or any(int(side) != side or side < 1 for side in size):
        raise ValueError(f"size must be (width, height) in whole pixels, got {size}")
    return int(size[0]), int(size[1])


def _trace_rows(
    scene: Scene,
    eye: Float[np.ndarray, "3"],
    directions: Float[np.ndarray, "rows columns 3"],
) -> dict:
    """The Surface's leaves for some rows of the image, flat: [points, ...]."""
    away = directions.reshape(-1, 3)
    origins = np.broadcast_to(eye.astype(np.float32), away.shape)
    hits = scene.tracer.closest_hit(origins, away)
    hit = hits.triangle >= 0
    triangle = np.where(hit, hits.triangle, 0)
    # Barycentrics are float32 and sum to 1 only nearly; the position must lie in its triangle.
    weights = hits.barycentrics.astype(np.float64)
    corners = scene.triangles[triangle]
    position = _interpolate(scene.positions[corners], weights)
    view = np.where(hit[:, None], _unit(eye - position), -away)
    geometric = np.where(hit[:, None], scene.geometric_normals[triangle], 0.0)
    behind = np.sum(geometric * view, axis=-1) < 0.0
    side = np.where(behind, -1.0, 1.0)[:, None]
    normal = _facing(side * _unit(_interpolate(scene.normals[corners], weights)), view)
    normal = normal * hit[:, None]
    material = scene.material_ids[triangle]
    two_sided = np.array([m.two_sided for m in scene.materials])[material]
    uv = None if scene.uvs is None else _interpolate(scene.uvs[triangle], weights)
    colour = None if scene.colours is None else _interpolate(scene.colours[triangle], weights)
    single = _as_float32
    return {
        "position": single(position),
        "normal": single(normal),
        "geometric_normal": single(side * geometric),
        "view": single(view),
        "triangle": hits.triangle,
        "barycentrics": hits.barycentrics,
        "uv": np.zeros((len(away), 2), np.float32) if uv is None else single(uv),
        "material": evaluate_materials(scene.materials, material, uv, colour),
        "mask": hit & (two_sided | ~behind),
        "backs": hit & behind & ~two_sided,
    }


def _assemble(
    bands: list[dict], shape: tuple[int, int], n: int, eye: Float[np.ndarray, "3"], scene: Scene
) -> Surface:
    def join(*leaves: np.ndarray | jax.Array) -> jax.Array:
        whole = np.concatenate([np.asarray(leaf) for leaf in leaves])
        return jnp.asarray(whole.reshape(shape + whole.shape[1:]))

    leaves = jax.tree.map(join, *bands)
    leaves["eye"], leaves["origin"] = (
        jnp.asarray(place, jnp.float32) for place in (eye, scene.origin)
    )
    return Surface(**leaves, supersampling=n, reflectance=scene.reflectance)


def _interpolate(
    corners: Float[np.ndarray, "points 3 channels"], weights: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, "points channels"]:
    return np.einsum("pk,pkc->pc", weights, corners)


def _facing(
    normal: Float[np.ndarray, "points 3"], view: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, "points 3"]:
    """Interpolated normals that face away from the viewer, as happens along the silhouettes of
    coarse meshes, turned towards the view until they face it barely. No model reflects light
    towards a viewer behind its normal: those pixels would be black.
    """
    lacking = np.maximum(GRAZING - np.sum(normal * view, axis=-1, keepdims=True), 0.0)
    return np.where(lacking > 0.0, _unit(normal + lacking * view), normal)


def _unit(vectors: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)


def _as_float32(values: Float[np.ndarray, "points channels"]) -> Float32[np.ndarray, "points c"]:
    return values.astype(np.float32)
