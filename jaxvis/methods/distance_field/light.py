"""What distance fields store of the light."""

from dataclasses import dataclass

import jax

from jaxvis.lighting import SphereLights
from jaxvis.sphere.gaussians import SphericalGaussians


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LobesAndSpheres(SphericalGaussians):
    """An environment as a list of lobes, and the spheres in it (world coordinates)."""

    spheres: SphereLights | None = None

    @property
    def count(self) -> int:
        """Lobes that a pixel meets, one for each sphere among them."""
        spheres = 0 if self.spheres is None else self.spheres.count
        return self.sharpness.shape[-1] + spheres
