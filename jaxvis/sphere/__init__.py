"""The mathematics of directions; knows no scene and no light."""

from jaxvis.sphere import (
    angles,
    components,
    contours,
    frames,
    gaussians,
    harmonics,
    hemisphere,
    latlong,
    octahedral,
    polygons,
    visibility_integrals,
)
from jaxvis.sphere.gaussians import SphericalGaussians
from jaxvis.sphere.summed_area import SummedAreaTable

__all__ = [
    "SphericalGaussians",
    "SummedAreaTable",
    "angles",
    "components",
    "contours",
    "frames",
    "gaussians",
    "harmonics",
    "hemisphere",
    "latlong",
    "octahedral",
    "polygons",
    "visibility_integrals",
]
