"""What a light probe holds, and whether it is usable."""

import warnings
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxvis.errors import InvalidEnvironment, JaxvisWarning
from jaxvis.lighting.builtin import built_in, is_built_in
from jaxvis.lighting.load import convert
from jaxvis.lighting.sources import Source, label, read_probe
from jaxvis.sphere import latlong


def environment_info(source: Source, *, layout: str = "auto") -> dict[str, Any]:
    """What ``source`` (as for ``load_environment``) holds, as a dictionary fit for JSON.

    Keys: ``name``; ``layout``, ``pictures`` and ``size`` ([width, height]) as stored; ``map``
    ([width, height]) as loaded; ``minimum`` and ``maximum`` radiance of any channel; ``mean``
    luminance of the sphere; ``dynamic_range``, the largest over the median luminance (None if the
    median is 0);
    ``brightest_share``, the share of energy from the brightest 0.1 % of the sphere; ``warnings``;
    ``usable``; and ``problem``, why not. What cannot be told is left out.

    Raises:
        FileNotFoundError, ValueError: there is no such file or name.
    """
    info: dict[str, Any] = {"name": source if is_built_in(source) else label(source)}
    usable, problem = True, {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", JaxvisWarning)
        try:
            if is_built_in(source):
                info["layout"] = "built-in"
                environment = built_in(str(source))
            else:
                probe = read_probe(source, layout)
                height, width = probe.pictures[0].shape[:2]
                info["layout"] = probe.layout
                info["pictures"] = len(probe.pictures)
                info["size"] = [width, height]
                environment = convert(probe)
            info["map"] = [environment.width, environment.height]
            info |= _statistics(np.asarray(environment.radiance, np.float64))
        except InvalidEnvironment as error:
            usable, problem = False, {"problem": str(error)}
    messages = [str(w.message) for w in caught if issubclass(w.category, JaxvisWarning)]
    return info | {"warnings": messages, "usable": usable} | problem


def _statistics(radiance: Float[np.ndarray, "height width 3"]) -> dict[str, float | None]:
    height, width = radiance.shape[:2]
    share = latlong.row_solid_angles(height, width).repeat(width) / (4.0 * np.pi)
    luminance = (radiance @ np.array([0.2126, 0.7152, 0.0722])).ravel()
    order = np.argsort(-luminance)
    sphere = np.append(0.0, np.cumsum(share[order]))
    energy = np.append(0.0, np.cumsum((luminance * share)[order]))
    middle = min(int(np.searchsorted(sphere[1:], 0.5)), len(order) - 1)
    median, total = luminance[order[middle]], energy[-1]
    return {
        "minimum": float(radiance.min()),
        "maximum": float(radiance.max()),
        "mean": float(total),
        "dynamic_range": float(luminance.max() / median) if median > 0.0 else None,
        "brightest_share": float(np.interp(1e-3, sphere, energy) / total) if total > 0.0 else 0.0,
    }
