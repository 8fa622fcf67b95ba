"""Materials on the host, and their values at points."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32, Int

from jaxvis.reflectance.texture import Texture
from jaxvis.reflectance.values import MaterialValues


def checked_albedo(albedo: float | int) -> float:
    """The share of light that a surface reflects, in [0, 1]."""
    if not 0.0 <= albedo <= 1.0:
        raise ValueError(f"albedo must lie in [0, 1], got {albedo}")
    return float(albedo)


@dataclass(frozen=True)
class Material:
    """Base colour, specular colour and roughness, each a constant times an optional texture.

    Colours are linear Rec. 709 in [0, 1], roughness is perceptual in [0, 1]
    (:class:`MaterialValues` says what they mean); colours are kept as tuples. Colour textures have
    one or three channels, roughness textures one. ``model`` numbers the material's model where a
    scene has several (:class:`~jaxvis.reflectance.mixed.Mixed`).
    """

    base_colour: Sequence[float | int] = (0.8, 0.8, 0.8)
    specular: Sequence[float | int] = (0.0, 0.0, 0.0)
    roughness: float | int = 1.0
    base_colour_texture: Texture | None = None
    specular_texture: Texture | None = None
    roughness_texture: Texture | None = None
    two_sided: bool = False
    name: str = ""
    model: int = 0

    def __post_init__(self) -> None:
        for field in ("base_colour", "specular"):
            colour = tuple(float(channel) for channel in getattr(self, field))
            if len(colour) != 3 or not all(0.0 <= channel <= 1.0 for channel in colour):
                raise ValueError(
                    f"{self._label}: {field} must be three numbers in [0, 1], got {colour}"
                )
            object.__setattr__(self, field, colour)
        object.__setattr__(self, "roughness", float(self.roughness))
        if not 0.0 <= self.roughness <= 1.0:
            raise ValueError(f"{self._label}: roughness must lie in [0, 1], got {self.roughness}")
        if isinstance(self.model, bool) or not isinstance(self.model, int) or self.model < 0:
            raise ValueError(
                f"{self._label}: model must be a whole number of at least 0, got {self.model!r}"
            )
        for field, allowed in (
            ("base_colour_texture", (1, 3)),
            ("specular_texture", (1, 3)),
            ("roughness_texture", (1,)),
        ):
            texture = getattr(self, field)
            if texture is not None and texture.channels not in allowed:
                raise ValueError(
                    f"{self._label}: {field} must have {' or '.join(map(str, allowed))} channels, "
                    f"got {texture.channels}"
                )

    @property
    def _label(self) -> str:
        return f"material {self.name!r}" if self.name else "material"

    @property
    def textured(self) -> bool:
        """Whether the values depend on texture coordinates."""
        return any((self.base_colour_texture, self.specular_texture, self.roughness_texture))


def evaluate_materials(
    materials: tuple[Material, ...],
    material_ids: Int[np.ndarray, "points"],
    uv: Float[np.ndarray, "points 2"] | None = None,
    colours: Float[np.ndarray, "points 3"] | None = None,
) -> MaterialValues:
    """The values of ``materials[material_ids]`` at points, in float32.

    Args:
        materials: what the ids count.
        material_ids: one per point, in [0, number of materials).
        uv: texture coordinates; needed only where a material is textured.
        colours: linear vertex colours, which multiply the base colour.
    """
    count = len(material_ids)
    if count and not (material_ids.min() >= 0 and material_ids.max() < len(materials)):
        raise ValueError(
            f"material ids must lie in [0, {len(materials) - 1}], got "
            f"{material_ids.min()} to {material_ids.max()}"
        )
    base_colour = np.empty((count, 3), np.float32)
    specular = np.empty((count, 3), np.float32)
    roughness = np.empty((count, 1), np.float32)
    for index, material in enumerate(materials):
        here = material_ids == index
        if not here.any():
            continue
        if uv is None and material.textured:
            raise ValueError(f"{material._label} is textured: texture coordinates are needed")
        at = None if uv is None else uv[here]
        base_colour[here] = _product(material.base_colour, material.base_colour_texture, at)
        specular[here] = _product(material.specular, material.specular_texture, at)
        roughness[here] = _product((material.roughness,), material.roughness_texture, at)
    if colours is not None:
        base_colour *= colours
    models = np.array([material.model for material in materials], np.int32)
    # None unless needed, so that scenes of one model carry and compile nothing more.
    model = jnp.asarray(models[material_ids]) if models.any() else None
    return MaterialValues(
        jnp.asarray(base_colour), jnp.asarray(specular), jnp.asarray(roughness[:, 0]), model
    )


def _product(
    constant: Sequence[float | int],
    texture: Texture | None,
    uv: Float[np.ndarray, "points 2"] | None,
) -> Float32[np.ndarray, "..."]:
    """The constant, times the texture where there is one."""
    value = np.asarray(constant, np.float32)
    return value if texture is None or uv is None else value * texture.sample(uv)
