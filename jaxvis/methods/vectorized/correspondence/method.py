"""Visibility correspondence as a method (paper 000, III-B to D)."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import jax.numpy as jnp
from jaxtyping import Array

from jaxvis.cache import cached_arrays, content_hash
from jaxvis.methods.vectorized.correspondence import build
from jaxvis.methods.vectorized.correspondence.interpolated import Interpolation
from jaxvis.methods.vectorized.correspondence.triples import (
    FIELDS,
    KIND,
    CorrespondingPolygons,
    own_arrays,
)
from jaxvis.methods.vectorized.irradiance import Quadrature
from jaxvis.methods.vectorized.method import VectorizedVisibility, Visibility
from jaxvis.methods.vectorized.polygons import FIELDS as POLYGON_FIELDS
from jaxvis.scene import Scene

Construction = Literal["relaxed", "paper"]


@dataclass(frozen=True)
class VisibilityCorrespondence(VectorizedVisibility):
    """Vectorized visibility with one integral where :class:`VectorizedVisibility` takes three.

    The position vectors of the polygons at a triangle's corners correspond; at a place inside the
    triangle, they are interpolated to one polygon and the light is integrated over that (eq. 21).
    Triangles in which this would be wrong keep three integrals.

    ``interpolation`` is of position vectors (``"position"``, the paper's), or of the directions in
    which they are seen (``"direction"``, on the whole a little further from the truth).
    ``construction`` says how vectors come to correspond, ``"relaxed"`` or by the ``"paper"``'s
    rules, and ``seed`` in which order triangles take their turns. All else is as for
    :class:`VectorizedVisibility`.
    """

    interpolation: Interpolation = "position"
    construction: Construction = "relaxed"
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, options in (("interpolation", Interpolation), ("construction", Construction)):
            if getattr(self, name) not in get_args(options):
                allowed = ", ".join(get_args(options))
                raise ValueError(f"{name} must be one of {allowed}, got {getattr(self, name)!r}")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, got {self.seed}")

    @property
    def quadrature(self) -> Quadrature:
        """How contours are integrated."""
        return replace(super().quadrature, interpolation=self.interpolation)

    def precompute(self, scene: Scene, progress: bool = True) -> CorrespondingPolygons:
        """Polygons at the vertices and their correspondence, or what earlier calls stored."""
        polygons = super().precompute(scene, progress)
        settings = build.Settings(
            construction=self.construction, seed=self.seed, interpolation=self.interpolation
        )
        contents = tuple(getattr(polygons, name) for name in POLYGON_FIELDS)
        key = content_hash(scene.geometry_hash, contents, tuple(settings), FIELDS)

        def construct() -> dict[str, Array]:
            found = build.build_correspondence(polygons, scene.tracer, settings, progress=progress)
            return own_arrays(found)

        arrays, _ = cached_arrays(KIND, key, construct)
        return CorrespondingPolygons(
            polygons, **{name: jnp.asarray(arrays[name]) for name in FIELDS}
        )

    def _require(self, visibility: Visibility) -> None:
        if not isinstance(visibility, CorrespondingPolygons):
            raise ValueError(
                "correspondence shades CorrespondingPolygons: precompute them with the same method"
            )
