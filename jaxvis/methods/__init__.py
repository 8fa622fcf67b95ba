"""The methods, by name (DESIGN §1)."""

from jaxvis.methods.base import Method
from jaxvis.methods.citations import citation
from jaxvis.methods.cones import HybridCones, VoxelCones
from jaxvis.methods.denoised import Denoised
from jaxvis.methods.distance_field import AdaptiveVisibility, DistanceField, ShadowMaps
from jaxvis.methods.monte_carlo import (
    AdaptiveEnvironment,
    ImportanceDriven,
    LocalImportanceDriven,
    MonteCarlo,
)
from jaxvis.methods.reference import Reference
from jaxvis.methods.registry import (
    Entry,
    create,
    names,
    parse_list,
    register,
    representatives,
    table,
)
from jaxvis.methods.vectorized import VectorizedVisibility, VisibilityCorrespondence
from jaxvis.methods.visibility_field import Unculled, VisibilityField

register(
    "reference",
    Reference,
    family="reference",
    summary="ground truth: every environment texel, or a stratified subset with its stated error",
)
for _strategy, _summary in {
    "uniform": "Monte Carlo, uniform hemisphere sampling",
    "environment": "Monte Carlo, importance sampling of the environment",
    "brdf": "Monte Carlo, importance sampling of the BRDF",
    "mis": "Monte Carlo, environment and BRDF sampling with multiple importance sampling",
}.items():
    register(
        f"mc-{_strategy}",
        MonteCarlo,
        family="monte-carlo",
        summary=_summary,
        representative=_strategy == "mis",
        strategy=_strategy,
    )
register(
    "mc-ides",
    ImportanceDriven,
    family="monte-carlo",
    summary="Monte Carlo, MIS of the BRDF with luminance times where the surface's rays leave",
)
register(
    "mc-ides-acdf",
    LocalImportanceDriven,
    family="monte-carlo",
    summary="mc-ides with distributions for each normal, by adaptive cumulative distributions",
)
register(
    "mc-adaptive",
    AdaptiveEnvironment,
    family="monte-carlo",
    summary="Monte Carlo, some rays tell the others which parts of the sky are visible from where",
)
register(
    "vectorized",
    VectorizedVisibility,
    family="vectorized",
    summary="vectorized visibility: polygons at vertices over summed-area tables, tessellated",
    representative=True,
)
register(
    "correspondence",
    VisibilityCorrespondence,
    family="vectorized",
    summary="vectorized visibility with spherical-Voronoi correspondence: one evaluation for three",
)
register(
    "distance-field",
    DistanceField,
    family="distance-field",
    summary="spherical signed distance functions at every vertex, light as spherical Gaussians",
)
register(
    "adaptive",
    AdaptiveVisibility,
    family="distance-field",
    summary="distance functions at adaptively placed samples, carried from frame to frame",
    representative=True,
)
register(
    "shadow-map",
    ShadowMaps,
    family="distance-field",
    summary="adaptive with visibility maps drawn into hemicubes instead of traced",
)
register(
    "visibility-field",
    VisibilityField,
    family="visibility-field",
    summary="discrete visibility field: masks in a grid tell most rays without tracing them",
    representative="visibility-field:lighting=environment,samples=300000",
)
register(
    "unculled",
    Unculled,
    family="visibility-field",
    summary="the estimator of visibility-field without the field: traces every ray",
)
register(
    "hybrid-cones",
    HybridCones,
    family="cones",
    summary="cones through voxels and a height field: diffuse light, one bounce if asked for",
    representative=True,
)
register(
    "voxel-cones",
    VoxelCones,
    family="cones",
    summary="voxel cone tracing: the same with everything in one 3D lightmap",
)

__all__ = [
    "AdaptiveEnvironment",
    "AdaptiveVisibility",
    "Denoised",
    "DistanceField",
    "Entry",
    "HybridCones",
    "ImportanceDriven",
    "LocalImportanceDriven",
    "Method",
    "MonteCarlo",
    "Reference",
    "ShadowMaps",
    "Unculled",
    "VectorizedVisibility",
    "VisibilityCorrespondence",
    "VisibilityField",
    "VoxelCones",
    "citation",
    "create",
    "names",
    "parse_list",
    "register",
    "representatives",
    "table",
]
