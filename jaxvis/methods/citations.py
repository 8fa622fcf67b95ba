"""Whose work a method is, as BibTeX."""

from collections.abc import Callable

from jaxvis import specs
from jaxvis.methods import registry
from jaxvis.methods.base import Method
from jaxvis.methods.cones import HybridCones, VoxelCones
from jaxvis.methods.denoised import SUFFIX, Denoised
from jaxvis.methods.distance_field import AdaptiveVisibility, DistanceField, ShadowMaps
from jaxvis.methods.monte_carlo import (
    AdaptiveEnvironment,
    ImportanceDriven,
    LocalImportanceDriven,
    MonteCarlo,
)
from jaxvis.methods.reference import Reference
from jaxvis.methods.vectorized import VectorizedVisibility, VisibilityCorrespondence
from jaxvis.methods.visibility_field import Unculled, VisibilityField

WORKS: dict[str, tuple[str, dict[str, str]]] = {
    "leung2021correspondence": (
        "article",
        {
            "author": "Leung, Ho Chun and Wang, Zhenni and Ho, Tze Yui and Leung, Chi Sing and "
            "Wong, Eric Wing Ming",
            "title": "All Frequency Direct Illumination Using Visibility Correspondence Generated "
            "With Spherical {Voronoi} Diagrams",
            "journal": "IEEE Access",
            "volume": "9",
            "pages": "81296--81313",
            "year": "2021",
            "doi": "10.1109/ACCESS.2021.3084611",
        },
    ),
    "ho2015vectorized": (
        "article",
        {
            "author": "Ho, Tze-Yui and Xiao, Yi and Feng, Rui-Bin and Leung, Chi-Sing and "
            "Wong, Tien-Tsin",
            "title": "All-Frequency Direct Illumination with Vectorized Visibility",
            "journal": "IEEE Transactions on Visualization and Computer Graphics",
            "volume": "21",
            "number": "8",
            "pages": "945--958",
            "year": "2015",
        },
    ),
    "xu2022visibility": (
        "inproceedings",
        {
            "author": "Xu, Yang and Jiang, Yuanfa and Wang, Chenhao and Li, Kang and "
            "Zhou, Pengbo and Geng, Guohua",
            "title": "Precomputed Discrete Visibility Fields for Real-Time Ray-Traced Environment "
            "Lighting",
            "booktitle": "Eurographics Symposium on Rendering",
            "publisher": "The Eurographics Association",
            "year": "2022",
            "doi": "10.2312/sr.20221158",
        },
    ),
    "wang2014adaptive": (
        "article",
        {
            "author": "Wang, Rui and Pan, Minghao and Han, Xiang and Chen, Weifeng and Bao, Hujun",
            "title": "Parallel and Adaptive Visibility Sampling for Rendering Dynamic Scenes with "
            "Spatially Varying Reflectance",
            "journal": "Computers \\& Graphics",
            "volume": "38",
            "pages": "374--381",
            "year": "2014",
            "doi": "10.1016/j.cag.2013.10.036",
        },
    ),
    "wang2009allfrequency": (
        "article",
        {
            "author": "Wang, Jiaping and Ren, Peiran and Gong, Minmin and Snyder, John and "
            "Guo, Baining",
            "title": "All-Frequency Rendering of Dynamic, Spatially-Varying Reflectance",
            "journal": "ACM Transactions on Graphics",
            "volume": "28",
            "number": "5",
            "pages": "133:1--133:10",
            "year": "2009",
        },
    ),
    "cohen1985hemicube": (
        "inproceedings",
        {
            "author": "Cohen, Michael F. and Greenberg, Donald P.",
            "title": "The Hemi-Cube: A Radiosity Solution for Complex Environments",
            "booktitle": "Computer Graphics (Proceedings of SIGGRAPH '85)",
            "pages": "31--40",
            "year": "1985",
        },
    ),
    "liu2020hybrid": (
        "article",
        {
            "author": "Liu, Tao and Gao, Jin and Lei, Zhengling",
            "title": "An Approach to Global Illumination Calculation Based on Hybrid Cone Tracing",
            "journal": "IEEE Access",
            "volume": "8",
            "year": "2020",
            "doi": "10.1109/ACCESS.2020.2994597",
        },
    ),
    "crassin2011interactive": (
        "article",
        {
            "author": "Crassin, Cyril and Neyret, Fabrice and Sainz, Miguel and Green, Simon and "
            "Eisemann, Elmar",
            "title": "Interactive Indirect Illumination Using Voxel Cone Tracing",
            "journal": "Computer Graphics Forum",
            "volume": "30",
            "number": "7",
            "pages": "1921--1930",
            "year": "2011",
        },
    ),
    "veach1995optimally": (
        "inproceedings",
        {
            "author": "Veach, Eric and Guibas, Leonidas J.",
            "title": "Optimally Combining Sampling Techniques for {Monte Carlo} Rendering",
            "booktitle": "Proceedings of SIGGRAPH '95",
            "pages": "419--428",
            "year": "1995",
            "doi": "10.1145/218380.218498",
        },
    ),
    "karlik2019mis": (
        "article",
        {
            "author": "Karl{\\'i}k, Ond{\\v{r}}ej and {\\v{S}}ik, Martin and V{\\'e}voda, Petr and "
            "Sk{\\v{r}}ivan, Tom{\\'a}{\\v{s}} and K{\\v{r}}iv{\\'a}nek, Jaroslav",
            "title": "{MIS} Compensation: Optimizing Sampling Techniques in Multiple Importance "
            "Sampling",
            "journal": "ACM Transactions on Graphics",
            "volume": "38",
            "number": "6",
            "pages": "151:1--151:12",
            "year": "2019",
        },
    ),
    "vose1991linear": (
        "article",
        {
            "author": "Vose, Michael D.",
            "title": "A Linear Algorithm for Generating Random Numbers with a Given Distribution",
            "journal": "IEEE Transactions on Software Engineering",
            "volume": "17",
            "number": "9",
            "pages": "972--975",
            "year": "1991",
        },
    ),
    "bashford2014importance": (
        "article",
        {
            "author": "Bashford-Rogers, Thomas and Debattista, Kurt and Chalmers, Alan",
            "title": "Importance Driven Environment Map Sampling",
            "journal": "IEEE Transactions on Visualization and Computer Graphics",
            "volume": "20",
            "number": "6",
            "pages": "907--918",
            "year": "2014",
            "doi": "10.1109/TVCG.2013.258",
        },
    ),
    "lawrence2005adaptive": (
        "inproceedings",
        {
            "author": "Lawrence, Jason and Rusinkiewicz, Szymon and Ramamoorthi, Ravi",
            "title": "Adaptive Numerical Cumulative Distribution Functions for Efficient "
            "Importance Sampling",
            "booktitle": "Rendering Techniques 2005: Eurographics Symposium on Rendering",
            "pages": "11--20",
            "year": "2005",
        },
    ),
    "oidn": (
        "misc",
        {
            "author": "{\\'A}fra, Attila T.",
            "title": "{Intel Open Image Denoise}",
            "howpublished": "\\url{https://www.openimagedenoise.org}",
        },
    ),
    "jaxvis": (
        "misc",
        {
            "author": "{The authors of jaxvis}",
            "title": "{jaxvis}: lighting scenes with environment maps through precomputed or "
            "sampled visibility, in {JAX}",
        },
    ),
}
"""Entries by key: kind and fields. DOIs stand only where they have been looked up."""


def _of_monte_carlo(method: MonteCarlo) -> tuple[str, ...]:
    tables = ("vose1991linear",)
    found = {"environment": tables, "mis": ("veach1995optimally", *tables)}.get(
        method.strategy, ("jaxvis",)
    )
    if method.strategy == "mis" and method.compensation:
        found += ("karlik2019mis",)
    return found


IDES = ("bashford2014importance", "veach1995optimally")
SIGNED_DISTANCES = "wang2009allfrequency"

KEYS: dict[type[Method], tuple[str, ...] | Callable[..., tuple[str, ...]]] = {
    Reference: ("jaxvis",),
    MonteCarlo: _of_monte_carlo,
    ImportanceDriven: IDES,
    LocalImportanceDriven: (*IDES, "lawrence2005adaptive"),
    AdaptiveEnvironment: ("jaxvis", "veach1995optimally"),
    VectorizedVisibility: ("ho2015vectorized", "leung2021correspondence"),
    VisibilityCorrespondence: ("leung2021correspondence", "ho2015vectorized"),
    DistanceField: (SIGNED_DISTANCES, "wang2014adaptive"),
    AdaptiveVisibility: ("wang2014adaptive", SIGNED_DISTANCES),
    ShadowMaps: ("wang2014adaptive", "cohen1985hemicube", SIGNED_DISTANCES),
    VisibilityField: ("xu2022visibility",),
    Unculled: ("xu2022visibility",),
    HybridCones: ("liu2020hybrid",),
    VoxelCones: ("crassin2011interactive", "liu2020hybrid"),
}
"""Keys of WORKS for each class, the method's own work first."""


def citation(method: str | Method) -> str:
    """BibTeX of the works that a method is taken from, its own first.

    What has no publication of its own (the reference, plain Monte Carlo) is cited as jaxvis.

    Args:
        method: a registered name, also with parameters (``mc-mis:compensation=true``) or
            ``+denoise``; or a Method.

    Returns:
        Entries with a blank line between them.

    Raises:
        ValueError: there is no such method, or it is one that is not jaxvis' own.
    """
    return "\n\n".join(_entry(key) for key in dict.fromkeys(_keys(method)))


def _keys(method: str | Method) -> tuple[str, ...]:
    if isinstance(method, Denoised):
        return (*_keys(method.method), "oidn")
    if isinstance(method, str):
        if specs.name_of(method).endswith(SUFFIX):
            # Its works can be named where the denoiser is not installed, too.
            return (*_keys(method.replace(SUFFIX, "", 1)), "oidn")
        method = registry.create(method)
    found = KEYS.get(type(method))
    if found is None:
        known = ", ".join(registry.names())
        raise ValueError(
            f"no citation is known for {type(method).__name__}, a method of your own; "
            f"there are those of {known}"
        )
    return found(method) if callable(found) else found


def _entry(key: str) -> str:
    """One work as BibTeX."""
    kind, fields = WORKS[key]
    lines = [f"  {name} = {{{value}}}," for name, value in fields.items()]
    return "\n".join([f"@{kind}{{{key},", *lines, "}"])
