"""The mathematics of directions; knows no scene and no light."""

from jaxvis.sphere import angles, components, frames, harmonics, hemisphere, latlong, octahedral
from jaxvis.sphere.summed_area import SummedAreaTable

__all__ = [
    "SummedAreaTable",
    "angles",
    "components",
    "frames",
    "harmonics",
    "hemisphere",
    "latlong",
    "octahedral",
]
