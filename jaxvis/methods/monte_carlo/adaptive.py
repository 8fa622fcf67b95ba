"""Visibility-aware sampling of the environment, adapted to blocks of pixels within one frame."""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, UInt32

from jaxvis.lighting import Environment
from jaxvis.methods.base import require_key
from jaxvis.methods.estimators import Counts, Draw, Drawn, draws, weighed
from jaxvis.methods.monte_carlo.block_light import (
    BlockLight,
    Blocks,
    Tally,
    blocks_of,
    cumulative_distributions,
)
from jaxvis.methods.monte_carlo.cell_light import CellLight
from jaxvis.methods.monte_carlo.estimate import (
    Estimator,
    balanced_proposals,
    estimate,
    halves,
)
from jaxvis.methods.monte_carlo.path_map import cells_of, traced
from jaxvis.methods.traced import (
    RAYS_PER_CHUNK,
    Proposal,
    Propose,
    RayVisibility,
    ShadingPoints,
    shading_points,
)
from jaxvis.reflectance import Reflectance
from jaxvis.sampling.random import key_words
from jaxvis.scene import Surface
from jaxvis.sphere.frames import dot

CELLS = (16, 32)
"""Rows and columns of cells whose visibility is measured; those of the environment where fewer."""


class Shares(NamedTuple):
    """Rays a pixel: first the pilot's, from the luminance and the BRDF, then the adapted ones."""

    environment: int
    brdf: int
    adapted: int


@dataclass(frozen=True)
class AdaptiveEnvironment(Estimator):
    """A quarter of the rays go ahead as pilots and tell which parts of the sky are visible from
    where; the others are drawn from luminance x cosine x the root of that visibility. Half of the
    pilots are drawn from the luminance, half from the BRDF.

    Visibility is counted for 32 x 16 cells of the sky and for blocks of neighbouring pixels:
    ``tile`` x ``tile`` of them whose normals have the same dominant axis. Each block is split like
    a chequerboard, and the pilots of one half shape what the other half draws from. So the density
    that a pixel's rays are weighed with never depends on those rays, all of them (pilots too) join
    in one balance heuristic, and the estimate is unbiased. ``least`` in (0, 1] is the visibility
    that a cell is taken to have at least.

    One sample a pixel leaves nothing to adapt: it is drawn as ``mc-mis`` draws its only one. In
    large images tiles are doubled until what is counted fits
    :data:`~jaxvis.methods.monte_carlo.block_light.MOST_ENTRIES`.
    """

    spp: int = 64
    tile: int = 16
    least: float = 0.02
    rays_per_chunk: int = RAYS_PER_CHUNK

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.tile < 2:
            raise ValueError(f"tile must be at least 2 pixels, got {self.tile}")
        if not 0.0 < self.least <= 1.0:
            raise ValueError(f"least must be above 0 and at most 1, got {self.least}")

    def light(self, environment: Environment) -> CellLight:
        """The environment's texels by cells, each with a sampling table."""
        return CellLight.of(environment, *CELLS)

    def shade(
        self,
        visibility: RayVisibility,
        light: CellLight,
        surface: Surface,
        *,
        key: jax.Array | None = None,
        progress: bool = False,
    ) -> Float[Array, "height width 3"]:
        """One estimate of each pixel's radiance. Neighbours share pilots: that makes their noise
        alike in strength, and their errors a little."""
        key = require_key(key, self)
        points, reflectance = shading_points(surface), surface.reflectance
        words = key_words(key)
        if self.spp == 1 or len(points.pixel) == 0:
            return estimate(
                *(visibility, light, surface, points),
                balanced_proposals(halves(self.spp), light, words, reflectance),
                *(words, self),
                most=(self.spp + 1) // 2,
                progress=progress,
            )
        shares = self.shares
        blocks = blocks_of(surface, points, self.tile, light.cells.cells)
        pilots = pilot_draws(shares, light, words, reflectance)
        tally, free = _fly(visibility, points, pilots, blocks, light.cells.shape)
        cdfs = cumulative_distributions(tally, blocks, light.cells, self.least)
        among = jnp.float32(shares.adapted / (shares.environment + shares.adapted))
        adapted = BlockLight(light, cdfs, jnp.asarray(blocks.table_of_pixel), among)
        return estimate(
            *(visibility, adapted, surface, points),
            _proposals(shares, adapted, pilots, free, jax.random.fold_in(key, 1), reflectance),
            *(words, self),
            most=max(shares),
            progress=progress,
        )

    @property
    def shares(self) -> Shares:
        """Rays a pixel of each kind, for two samples or more."""
        each = max(1, self.spp // 8)
        environment = each if self.spp > 3 else 0
        return Shares(environment, each, self.spp - environment - each)


def pilot_draws(
    shares: Shares, light: CellLight, words: UInt32[Array, "2"], reflectance: Reflectance
) -> list[tuple[Draw, int]]:
    """How each kind of pilot is drawn, and how many."""
    counts = Counts(environment=shares.environment, brdf=shares.brdf)
    each = [count for count in (shares.environment, shares.brdf) if count]
    return list(zip(draws(counts, light, words, reflectance), each, strict=True))


def _fly(
    visibility: RayVisibility,
    points: ShadingPoints,
    pilots: list[tuple[Draw, int]],
    blocks: Blocks,
    shape: tuple[int, int],
) -> tuple[Tally, list[Bool[Array, "pixels samples"]]]:
    """Traces the pilots: what each block saw, and which of each pixel's pilots are not blocked."""
    tally = Tally.empty(blocks.tables, shape[0] * shape[1])
    found = []
    pixel = np.asarray(points.pixel)
    for draw, samples in pilots:
        free = np.zeros((len(blocks.table_of_pixel), samples), bool)

        def pilot(block: ShadingPoints, draw: Draw = draw) -> Proposal:
            return _pilot(block, draw(block))

        first = 0
        for rays, visible in traced(visibility.tracer, points, pilot, samples):
            inside = min(len(visible), len(pixel) - first)
            rows = pixel[first : first + inside]
            free[rows] = visible[:inside]
            cells = np.asarray(cells_of(rays, shape=shape))[:inside]
            active = np.asarray(rays.active)[:inside]
            tally.add(blocks.table_of_pixel[rows], cells, active, visible[:inside])
            first += inside
        found.append(jnp.asarray(free))
    return tally, found


@jax.jit
def _pilot(points: ShadingPoints, drawn: Drawn) -> Proposal:
    """Rays that may reach the point, whatever they bring."""
    directions = jnp.stack(drawn.directions, axis=-1)
    above = dot(points.geometric_normal[:, None, :], directions) > 0.0
    active = above & (dot(points.normal[:, None, :], directions) > 0.0)
    return Proposal(drawn.directions, drawn.directions, active)


def _proposals(
    shares: Shares,
    light: BlockLight,
    pilots: list[tuple[Draw, int]],
    free: list[Bool[Array, "pixels samples"]],
    key: jax.Array,
    reflectance: Reflectance,
) -> list[Propose]:
    """The pilots once more, which need no tracing, and the adapted rays, by numbers of their own.

    One in ``counts`` for the environment stands for luminance and adapted rays together: the
    light's density is that of both.
    """
    counts = Counts(environment=shares.environment + shares.adapted, brdf=shares.brdf)
    words = key_words(key)

    def again(draw: Draw, free: Bool[Array, "pixels samples"]) -> Propose:
        def propose_rays(points: ShadingPoints) -> Proposal:
            rays = weighed(light, points, draw(points), counts=counts, reflectance=reflectance)
            return rays._replace(known=_known(free, points, rays.active))

        return propose_rays

    def adapted(points: ShadingPoints) -> Proposal:
        drawn = light.draw(words, points, shares.adapted)
        return weighed(light, points, drawn, counts=counts, reflectance=reflectance)

    return [again(draw, seen) for (draw, _), seen in zip(pilots, free, strict=True)] + [adapted]


@jax.jit
def _known(
    free: Bool[Array, "pixels samples"],
    points: ShadingPoints,
    active: Bool[Array, "points samples"],
) -> Bool[Array, "points samples"]:
    return active & jnp.take(free, points.pixel, axis=0, mode="clip")
