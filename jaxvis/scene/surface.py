"""What each pixel sees of a scene: the input of every method's ``shade``."""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxvis.reflectance import Lambert, MaterialValues, Reflectance


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Surface:
    """The first hit of one camera ray per pixel (n x n rays per pixel with supersampling n).

    Shapes are [rows, columns, ...] with rows = supersampling * height, columns likewise. Positions
    are in the scene's centred coordinates; normals are unit and on the viewer's side; ``view``
    points to the camera, which is at ``eye``. ``mask`` is true where a shadeable front was hit:
    misses are false, and so are the backs of one-sided faces, which are black (``backs`` marks
    them).
    """

    position: Float[Array, "rows columns 3"]
    normal: Float[Array, "rows columns 3"]
    geometric_normal: Float[Array, "rows columns 3"]
    view: Float[Array, "rows columns 3"]
    triangle: Int[Array, "rows columns"]
    barycentrics: Float[Array, "rows columns 3"]
    uv: Float[Array, "rows columns 2"]
    material: MaterialValues
    mask: Bool[Array, "rows columns"]
    backs: Bool[Array, "rows columns"]
    eye: Float[Array, "3"]
    supersampling: int = field(default=1, metadata={"static": True})
    reflectance: Reflectance = field(default=Lambert(), metadata={"static": True})

    @property
    def height(self) -> int:
        """Rows of the image."""
        return self.mask.shape[0] // self.supersampling

    @property
    def width(self) -> int:
        """Columns of the image."""
        return self.mask.shape[1] // self.supersampling

    @property
    def coverage(self) -> Float[Array, "height width"]:
        """Share of each pixel's rays that hit the scene (backs included)."""
        return self._pixel_sums((self.mask | self.backs).astype(jnp.float32)[..., None])[..., 0] / (
            self.supersampling**2
        )

    def to_image(self, radiance: Float[Array, "rows columns 3"]) -> Float[Array, "height width 3"]:
        """Per-pixel mean of the radiance over the rays that hit the scene; 0 where none did."""
        hit = (self.mask | self.backs).astype(radiance.dtype)[..., None]
        shaded = jnp.where(self.mask[..., None], radiance, 0.0)
        return self._pixel_sums(shaded) / jnp.maximum(self._pixel_sums(hit), 1.0)

    def _pixel_sums(
        self, values: Float[Array, "rows columns channels"]
    ) -> Float[Array, "height width channels"]:
        n = self.supersampling
        return values.reshape(self.height, n, self.width, n, -1).sum(axis=(1, 3))
