"""A method of one's own: openness and bent normals at the vertices, light as nine harmonics."""

import math
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxvis.cache import save_arrays
from jaxvis.methods import Method, register
from jaxvis.methods.vertices import vertex_samples
from jaxvis.sampling import hammersley, hemisphere
from jaxvis.sphere import frames, harmonics


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class BentNormal:
    bent: jax.Array | np.ndarray  # [vertices, 3]: mean free direction, as long as its share
    triangles: jax.Array | np.ndarray  # [triangles, 3]: rows of bent

    @property
    def nbytes(self) -> int:
        return self.bent.nbytes + self.triangles.nbytes

    def save(self, path) -> None:
        save_arrays(path, "bent-normal", {"bent": self.bent, "triangles": self.triangles})


@dataclass(frozen=True)
class BentNormals(Method):
    rays: int = 256  # from each vertex

    def precompute(self, scene, progress=True):
        at = vertex_samples(scene)
        local = np.asarray(hemisphere.sample_cosine(hammersley(self.rays)))
        rays = local @ frames.frames_on_host(at.normals)  # [vertices, rays, 3]
        origins = np.repeat(at.origins, self.rays, axis=0)
        free = ~scene.tracer.occluded(origins, rays.reshape(-1, 3)).reshape(-1, self.rays)
        axis = frames.normalize(jnp.einsum("vr,vrx->vx", free, rays))
        return BentNormal(free.mean(axis=1, keepdims=True) * axis, at.triangles)

    def light(self, environment):
        return harmonics.project(environment.radiance, 3)

    @partial(jax.jit, static_argnums=0)
    def shade(self, visibility, light, surface, *, key=None, progress=False):
        corners = visibility.triangles[surface.triangle]  # [rows, columns, 3]
        bent = jnp.einsum("rck,rckx->rcx", surface.barycentrics, visibility.bent[corners])
        share = jnp.linalg.norm(bent, axis=-1, keepdims=True)
        irradiance = share * harmonics.irradiance(light, frames.normalize(bent))
        return surface.to_image(surface.material.base_colour / math.pi * irradiance)

    def evaluations(self, visibility, light, surface):
        return int(surface.mask.sum())


register("bent-normals", BentNormals, family="examples", summary="openness and bent normals")
