"""Visibility polygons evaluated slowly and exactly (float64)."""

import numpy as np


def unit(v):
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-30)


def seen_from(vectors, places):
    """Unit directions [polygons, vectors, 3] of vectors [polygons, 4, vectors]."""
    q = np.moveaxis(np.asarray(vectors, np.float64), 1, -1)
    return unit(q[..., :3] - q[..., 3:] * np.asarray(places, np.float64)[:, None])


def clamped(directions, normals):
    """Directions below the planes of the normals moved up to them."""
    normals = np.asarray(normals, np.float64)[:, None]
    height = np.sum(directions * normals, axis=-1, keepdims=True)
    return np.where(height < 0.0, unit(directions - height * normals), directions)


def irradiance(directions, normals):
    """Of polygons with geodesic edges under a uniform sky of radiance 1 / pi (Lambert 1760)."""
    following = np.roll(directions, -1, axis=1)
    cross = np.cross(directions, following)
    sine = np.linalg.norm(cross, axis=-1)
    angle = np.arctan2(sine, np.sum(directions * following, axis=-1))
    weights = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-30), 0.0)
    vector = np.sum(weights[..., None] * cross, axis=1)
    return np.sum(vector * normals, axis=-1) / (2.0 * np.pi)


def own_irradiance(polygons):
    """Of every sample's polygon at its own place, under its own normal."""
    directions = seen_from(polygons.vectors, polygons.positions)
    normals = np.asarray(polygons.normals, np.float64)
    return irradiance(clamped(directions, normals), normals)
