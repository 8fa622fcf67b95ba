"""The mathematics of directions; knows no scene and no light."""

from jaxvis.sphere import (
    angles,
    components,
    contours,
    frames,
    harmonics,
    hemisphere,
    latlong,
    octahedral,
    polygons,
)
from jaxvis.sphere.summed_area import SummedAreaTable

__all__ = [
    "SummedAreaTable",
    "angles",
    "components",
    "contours",
    "frames",
    "harmonics",
    "hemisphere",
    "latlong",
    "octahedral",
    "polygons",
]
