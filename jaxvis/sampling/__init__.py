"""Drawing samples: each ``sample`` has its ``pdf``, and an ``inverse`` where one exists."""

from jaxvis.sampling import cone, hemisphere, microfacet, mis, phong, random, sequences
from jaxvis.sampling.adaptive_cdf import AdaptiveCdfs
from jaxvis.sampling.alias import AliasTable
from jaxvis.sampling.cell_texels import CellTexels
from jaxvis.sampling.latlong_alias import EnvironmentSample, EnvironmentSampler
from jaxvis.sampling.piecewise import LatLongDistribution
from jaxvis.sampling.sequences import hammersley, radical_inverse

__all__ = [
    "AdaptiveCdfs",
    "AliasTable",
    "CellTexels",
    "EnvironmentSample",
    "EnvironmentSampler",
    "LatLongDistribution",
    "cone",
    "hammersley",
    "hemisphere",
    "microfacet",
    "mis",
    "phong",
    "radical_inverse",
    "random",
    "sequences",
]
