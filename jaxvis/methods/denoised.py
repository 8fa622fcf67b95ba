"""A stochastic method whose image is denoised: the suffix ``+denoise`` of its name."""

from dataclasses import dataclass
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Bool, Float

from jaxvis.image.denoise import denoise, denoiser
from jaxvis.lighting import Environment
from jaxvis.methods.base import Method
from jaxvis.scene import Scene, Surface

SUFFIX = "+denoise"


@dataclass(frozen=True)
class Denoised(Method):
    """``method`` with Open Image Denoise on its image, guided by albedo and normal (paper 000,
    section IV-D, figs. 16 to 18). The image is biased.

    Everything but the last step of ``shade`` is the method's own.

    Raises:
        ValueError: the method has no noise, or the extra ``denoise`` is not installed.
    """

    method: Method

    stochastic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if isinstance(self.method, Denoised):
            raise ValueError(f"{type(self.method.method).__name__} is denoised already")
        if not self.method.stochastic:
            raise ValueError(
                f"{type(self.method).__name__} has no noise to remove: {SUFFIX} is for methods "
                "that take samples, such as mc-mis"
            )
        denoiser()

    def precompute(self, scene: Scene, progress: bool = True) -> Any:
        return self.method.precompute(scene, progress)

    def precompute_for(
        self, scene: Scene, surface: Surface, previous: Any = None, progress: bool = True
    ) -> Any:
        return self.method.precompute_for(scene, surface, previous, progress)

    def light(self, environment: Environment) -> Any:
        return self.method.light(environment)

    def shade(
        self,
        visibility: Any,
        light: Any,
        surface: Surface,
        *,
        key: jax.Array | None = None,
        progress: bool = False,
    ) -> Float[Array, "height width 3"]:
        """The method's image without its noise; 0 where no pixel sees the scene."""
        noisy = self.method.shade(visibility, light, surface, key=key, progress=progress)
        albedo, normal, covered = map(np.asarray, _guides(surface))
        if not covered.any():
            return noisy
        images = (continued(np.asarray(image), covered) for image in (noisy, albedo, normal))
        clean = denoise(*images)
        return jnp.asarray(np.where(covered[..., None], clean, np.float32(0.0)))

    def evaluations(self, visibility: Any, light: Any, surface: Surface) -> int:
        return self.method.evaluations(visibility, light, surface)

    def parameters(self) -> dict[str, Any]:
        return {**self.method.parameters(), "denoise": True}

    @property
    def spp(self) -> int:
        """The method's samples per pixel, if it has such a parameter."""
        # getattr's error makes hasattr say that there is none.
        return getattr(self.method, "spp")  # noqa: B009


def continued(
    image: Float[np.ndarray, "height width 3"], covered: Bool[np.ndarray, "height width"]
) -> Float[np.ndarray, "height width 3"]:
    """Every pixel that sees no scene as the nearest one that does.

    Denoisers let the black beside an outline darken what is inside of it.
    """
    nearest: Any = scipy.ndimage.distance_transform_edt(
        ~covered, return_distances=False, return_indices=True
    )
    return image[tuple(nearest)]


@jax.jit
def _guides(surface: Surface) -> tuple[Array, Array, Array]:
    """Albedo and normal, means over each pixel's rays, and which pixels see the scene."""
    material = surface.material
    albedo = jnp.clip(material.base_colour + material.specular, 0.0, 1.0)
    covered = surface.coverage > 0.0
    return surface.to_image(albedo), surface.to_image(surface.normal), covered
