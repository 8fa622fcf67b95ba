"""What each pixel sees of a scene: the input of every method's ``shade``."""

from dataclasses import dataclass, field
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxvis.reflectance import Lambert, MaterialValues, Reflectance


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Surface:
    """The first hit of one camera ray per pixel (n x n rays per pixel with supersampling n).

    Shapes are [rows, columns, ...] with rows = supersampling * height, columns likewise. Positions
    are in the scene's centred coordinates, whose zero lies at ``origin`` in the world; normals are
    unit and on the viewer's side; ``view`` points to the camera, which is at ``eye``. ``mask`` is
    true where a shadeable front was hit: misses are false, and so are the backs of one-sided faces,
    which are black (``backs`` marks them).
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
    origin: Float[Array, "3"] = field(default_factory=lambda: jnp.zeros(3))
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
        return _coverage(self.mask | self.backs, n=self.supersampling)

    def to_image(self, radiance: Float[Array, "rows columns 3"]) -> Float[Array, "height width 3"]:
        """Per-pixel mean of the radiance over the rays that hit the scene; 0 where none did."""
        return _pixel_means(radiance, self.mask, self.backs, n=self.supersampling)


@partial(jax.jit, static_argnames="n")
def _coverage(hit: Bool[Array, "rows columns"], *, n: int) -> Float[Array, "height width"]:
    return _pixel_sums(hit.astype(jnp.float32)[..., None], n)[..., 0] / n**2


@partial(jax.jit, static_argnames="n")
def _pixel_means(
    radiance: Float[Array, "rows columns 3"],
    mask: Bool[Array, "rows columns"],
    backs: Bool[Array, "rows columns"],
    *,
    n: int,
) -> Float[Array, "height width 3"]:
    hit = (mask | backs).astype(radiance.dtype)[..., None]
    shaded = jnp.where(mask[..., None], radiance, 0.0)
    return _pixel_sums(shaded, n) / jnp.maximum(_pixel_sums(hit, n), 1.0)


def _pixel_sums(
    values: Float[Array, "rows columns channels"], n: int
) -> Float[Array, "height width channels"]:
    rows, columns, channels = values.shape
    return values.reshape(rows // n, n, columns // n, n, channels).sum(axis=(1, 3))
