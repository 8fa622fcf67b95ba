"""Polygons and lights that need no precomputation: horizons, walls, rings, and small tables."""

import jax.numpy as jnp
import numpy as np

from jaxvis.lighting import Environment
from jaxvis.methods.vectorized import VisibilityPolygons
from jaxvis.methods.vectorized.light import PolygonLight, texel_moments
from jaxvis.methods.vectorized.lobes import PhongLobes
from jaxvis.sphere import latlong
from jaxvis.sphere.contours import ContourTable

UP = np.array([0.0, 1.0, 0.0])


def frame(normal):
    """Two axes that make a right-handed frame with the normal."""
    axis = np.eye(3)[np.argmin(np.abs(normal))]
    tangent = np.cross(axis, normal)
    tangent /= np.linalg.norm(tangent)
    return tangent, np.cross(normal, tangent)


def horizon(normal, count):
    """The whole sky above a plane: points at infinity, counter-clockwise about the normal."""
    tangent, bitangent = frame(normal)
    angle = 2.0 * np.pi * np.arange(count)[:, None] / count
    around = np.cos(angle) * tangent + np.sin(angle) * bitangent
    return np.concatenate([around, np.zeros((count, 1))], axis=1)


def window(centre, normal, radius, count):
    """The inside of a polygon round a place: finite points."""
    around = horizon(normal, count)[:, :3]
    return np.concatenate([centre + radius * around, np.ones((count, 1))], axis=1)


def polygons(rings, positions, normals, triangles, capacity=64, backs=None, buried=None):
    """VisibilityPolygons of sequences of homogeneous vectors."""
    vectors = np.stack([np.pad(r, ((0, capacity - len(r)), (0, 0)), mode="edge").T for r in rings])
    triangles = np.asarray(triangles, np.int32)
    return VisibilityPolygons(
        vectors=jnp.asarray(vectors, jnp.float32),
        counts=jnp.asarray([len(r) for r in rings], jnp.int32),
        positions=jnp.asarray(positions, jnp.float32),
        normals=jnp.asarray(normals, jnp.float32),
        triangles=jnp.asarray(triangles),
        backs=jnp.asarray(np.full_like(triangles, -1) if backs is None else backs, jnp.int32),
        buried=jnp.zeros(len(rings), bool) if buried is None else jnp.asarray(buried),
    )


def random_polygons(count=40, capacity=64, seed=0, triangles=None):
    """Windows of different sizes and numbers of vectors above random places."""
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(count, 3))
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    rings = []
    for position, normal in zip(positions, normals, strict=True):
        number = int(rng.integers(12, capacity + 1))
        if rng.random() < 0.3:
            rings.append(horizon(normal, number))
        else:
            tilted = normal + 0.5 * rng.normal(size=3) / 2.0
            tilted /= np.linalg.norm(tilted)
            radius = rng.uniform(0.5, 2.0)
            rings.append(window(position + tilted, tilted, radius, number))
    if triangles is None:
        triangles = np.zeros((0, 3), np.int32)
    return polygons(rings, positions, normals, triangles, capacity)


def table_light(radiance, blurred=None, sharpness=5.0, scaled=True) -> PolygonLight:
    """Tables of a map [height, 2 height, 3] as it is, and lobes of nothing. Differentiable."""
    height = radiance.shape[0]
    moments = jnp.asarray(texel_moments(height, 2 * height), jnp.float32)
    solid_angles = jnp.asarray(latlong.row_solid_angles(height, 2 * height), jnp.float32)

    def directed(values):
        return (moments[..., :, None] * values[..., None, :]).reshape(height, 2 * height, 9)

    luminance = radiance @ jnp.asarray([0.2126, 0.7152, 0.0722])
    return PolygonLight(
        vector=ContourTable.build(directed(radiance)),
        scalar=ContourTable.build(radiance * solid_angles[:, None, None]),
        luminous=ContourTable.build(moments * luminance[..., None]),
        blurred=ContourTable.build(directed(radiance if blurred is None else blurred)),
        lobes=PhongLobes(jnp.zeros((0, 3)), ()),
        sharpness=jnp.float32(sharpness),
        scaled=scaled,
    )


def uniform(value=1.0, height=16):
    return jnp.full((height, 2 * height, 3), value, jnp.float32)


def random_map(height=16, seed=0):
    rng = np.random.default_rng(seed)
    return jnp.asarray(rng.uniform(0.1, 2.0, (height, 2 * height, 3)) ** 4, jnp.float32)


def as_environment(radiance) -> Environment:
    return Environment(radiance, "test")
