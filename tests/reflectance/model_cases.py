"""Directions, materials and quadratures that the tests of the reflectance models share."""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxvis.reflectance import BlinnPhong, CookTorrance, Lambert, MaterialValues, Phong

RECIPROCAL = [Lambert(), Phong(), BlinnPhong(), CookTorrance("ggx"), CookTorrance("beckmann")]
MODELS = [*RECIPROCAL, Phong(foreshortened=False)]
GLOSSY = MODELS[1:]
NORMAL = np.array([2.0, -1.0, 2.0], np.float32) / 3.0


def named(models):
    return {"argvalues": models, "ids": [str(model) for model in models]}


@partial(jax.jit, static_argnames="model")
def jitted_evaluate(model, material, normal, view, light):
    return model.evaluate_and_pdf(material, normal, view, light)


@partial(jax.jit, static_argnames="model")
def jitted_sample(model, material, normal, view, uniforms):
    return model.sample(material, normal, view, uniforms)


def evaluate(model, material, view, light):
    """Value and density about NORMAL, compiled for few shapes."""
    view, light = np.broadcast_arrays(view, light)
    return jitted_evaluate(model, material, NORMAL, view, light)


def sample(model, material, view, uniforms):
    return jitted_sample(model, material, NORMAL, np.broadcast_to(view, uniforms.shape), uniforms)


def material(base, specular, roughness):
    base, specular = (np.broadcast_to(np.float32(c), (3,)) for c in (base, specular))
    return MaterialValues(jnp.asarray(base), jnp.asarray(specular), jnp.float32(roughness))


def orthonormal(axis):
    """Two unit vectors that complete ``axis``."""
    first = np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


def view_at(cosine):
    """Direction at this cosine from the normal."""
    first, _ = orthonormal(NORMAL)
    return (cosine * NORMAL + np.sqrt(1.0 - cosine**2) * first).astype(np.float32)


def polar(axis, theta, phi):
    """Float32 directions at angles ``theta`` from ``axis`` and ``phi`` about it."""
    first, second = orthonormal(axis.astype(np.float64))
    local = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0.0 * phi
    world = sum(c[..., None] * e for c, e in zip(local, (first, second, axis), strict=True))
    return world.astype(np.float32)


def angles(axis, directions):
    """(theta, phi) of directions in :func:`polar`'s coordinates."""
    first, second = orthonormal(axis.astype(np.float64))
    x, y, z = (directions.astype(np.float64) @ e for e in (first, second, axis))
    return np.arctan2(np.hypot(x, y), z), np.mod(np.arctan2(y, x), 2.0 * np.pi)


@lru_cache
def sphere_quadrature(cosine):
    """Directions [200, 200, 3] and weights [200, 200] that add up to 4 pi.

    Dense about the mirror image of the view at ``cosine``, theta = pi t^3, in two panels that meet
    at pi / 2; 500 sectors, because lobes at grazing angles are narrow across.
    """
    node, weight = np.polynomial.legendre.leggauss(40)
    edges = np.array([0.0, 0.5 ** (1 / 3), 1.0])
    half = 0.5 * np.diff(edges)[:, None]
    t, weight = (edges[:-1, None] + half * (1.0 + node)).ravel(), (half * weight).ravel()
    phi = 2.0 * np.pi * (np.arange(500) + 0.5) / 500
    directions = polar(mirror(view_at(cosine)), np.pi * t[:, None] ** 3, phi[None, :])
    weight = weight * 3.0 * np.pi * t**2 * np.sin(np.pi * t**3) * 2.0 * np.pi / 500
    return directions.reshape(200, 200, 3), np.repeat(weight, 500).reshape(200, 200)


def mirror(view):
    """Mirror image of ``view`` about the normal."""
    return (2.0 * np.dot(NORMAL, view) * NORMAL - view).astype(np.float32)


def albedo(model, surface, cosine):
    """Share of the light from the direction at ``cosine`` that is reflected, by quadrature."""
    lights, weights = sphere_quadrature(cosine)
    value, _ = evaluate(model, surface, view_at(cosine), lights)
    return np.einsum("ij,ijc->c", weights, np.asarray(value, np.float64))


def random_directions(generator):
    """Unit vectors [200, 200, 3]."""
    directions = generator.normal(size=(200, 200, 3))
    return (directions / np.linalg.norm(directions, axis=-1, keepdims=True)).astype(np.float32)


def samples(model, surface, view, batches):
    """Light directions [40000 batches, 3]."""
    generator = np.random.default_rng(6)
    uniforms = generator.uniform(size=(batches, 200, 200, 3)).astype(np.float32)
    drawn = [sample(model, surface, view, batch) for batch in uniforms]
    return np.stack(drawn).reshape(-1, 3)
