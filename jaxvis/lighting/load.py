"""Environments by name, from files, and from arrays."""

import warnings
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxvis.errors import InvalidEnvironment, JaxvisWarning
from jaxvis.lighting import conservative, resampling
from jaxvis.lighting.builtin import built_in, is_built_in
from jaxvis.lighting.environment import Environment
from jaxvis.lighting.layouts import unfold
from jaxvis.lighting.sources import Probe, Source, read_probe
from jaxvis.sphere import latlong

_NEGLIGIBLE = 1e-3  # share of energy that negative values may take


def load_environment(
    source: Source,
    *,
    layout: str = "auto",
    exposure: float = 1.0,
    name: str | None = None,
    height: int | None = None,
) -> Environment:
    """An environment from a built-in name, a data set's name, a file, six files, or an array.

    Args:
        source: ``sky``, ``windows`` or ``uniform``, also with parameters as in
            ``sky:turbidity=4,elevation=0.3``; a data set's name; a .hdr, .exr or .pfm file; a
            folder or a pattern (``sky_{}.hdr``, ``sky_*.hdr``) of six faces; a list of six files
            or arrays in the order px, nx, py, ny, pz, nz; or an array ``[height, width]``,
            ``[height, width, channels]`` or ``[6, size, size, channels]``. Radiance is linear
            and taken as stored; grey counts for all three channels, alpha is dropped.
        layout: ``latlong``, ``vertical-cross``, ``horizontal-cross``, ``faces`` or ``angular``;
            ``auto`` tells them apart by shape. Faces are seen from inside, with px to the right
            of pz, which is in front; in the vertical cross nz hangs head down, as in Debevec's.
            The front of every layout becomes the middle of the panorama, +Z (so px lies at -X).
        exposure: factor on radiance.
        name: the environment's name; by default the source's.
        height: rows of the map; by default as stored (lat-long), twice the face (cube), half the
            picture (angular), or the built-in's own.

    Raises:
        FileNotFoundError: there is no such file.
        InvalidEnvironment: a damaged file, a wrong shape, NaN, infinite or negative radiance.
        ValueError: an unknown name, layout or parameter.
    """
    if not (np.isfinite(exposure) and exposure >= 0.0):
        raise ValueError(f"exposure must be a finite number >= 0, got {exposure}")
    if height is not None and height < 1:
        raise ValueError(f"height must be at least 1, got {height}")
    if is_built_in(source):
        if layout != "auto":
            raise ValueError(f"{source!r} is built in and has no layout, got layout={layout!r}")
        environment = built_in(str(source), height)
    else:
        environment = convert(read_probe(source, layout), height)
    scaled = environment if exposure == 1.0 else environment.scale(exposure)
    return scaled if name is None else replace(scaled, name=name)


def convert(probe: Probe, height: int | None = None) -> Environment:
    """The lat-long map of a probe in any layout.

    Raises:
        InvalidEnvironment: NaN, infinite or negative radiance within the sphere, or a picture that
            is too small.
    """
    if probe.layout == "latlong":
        pixels = probe.pictures[0]
        rows, columns = pixels.shape[:2]
        weights = latlong.row_solid_angles(rows, columns).repeat(columns)
        _check(pixels.reshape(-1, 3), weights, probe.what)
        radiance = jnp.asarray(np.maximum(pixels, 0.0), jnp.float32)
        target = height or rows
        return Environment(resampling.resize(radiance, target, 2 * target), probe.name)
    values, projection = unfold(probe.pictures, probe.layout)
    if projection.size < projection.smallest:
        raise InvalidEnvironment(
            f"{probe.what}: {projection.size} texels across are too few for "
            f"{probe.layout}; give at least {projection.smallest}"
        )
    usable = np.where(np.isfinite(values), np.maximum(values, 0.0), 0.0)
    averages, solid_angles = conservative.to_latlong(
        usable, projection, height or projection.native_height
    )
    _check(values, solid_angles, probe.what)
    return Environment(jnp.asarray(averages, jnp.float32), probe.name)


def _check(
    values: Float[np.ndarray, "texels 3"], solid_angles: Float[np.ndarray, "texels"], what: str
) -> None:
    """Refuses what is no radiance; a few negative values of no weight count as 0, with a warning.

    Texels without solid angle (the corners of an angular map) may hold anything.
    """
    values, solid_angles = values[solid_angles > 0.0], solid_angles[solid_angles > 0.0]
    largest = np.finfo(np.float32).max
    broken = np.count_nonzero(~(np.abs(values) <= largest).all(axis=-1))
    if broken:
        raise InvalidEnvironment(
            f"{what}: {broken} of {len(values)} texels are NaN or infinite; repair the picture"
        )
    negative = np.count_nonzero((values < 0.0).any(axis=-1))
    if not negative:
        return
    lost = -np.minimum(values, 0.0).sum(axis=-1) @ solid_angles
    total = np.maximum(values, 0.0).sum(axis=-1) @ solid_angles
    found = f"{what}: {negative} of {len(values)} texels are negative"
    if lost > _NEGLIGIBLE * total:
        share = f"{100.0 * lost / total:.2g} % of the energy" if total > 0.0 else "no light at all"
        raise InvalidEnvironment(f"{found} ({share}); radiance cannot be negative")
    warnings.warn(
        f"{found} ({100.0 * lost / total:.1g} % of the energy); they count as 0",
        JaxvisWarning,
        stacklevel=4,
    )
