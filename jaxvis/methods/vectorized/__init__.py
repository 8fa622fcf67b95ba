"""Vectorized visibility (paper 000): polygons of position vectors at every vertex."""

from jaxvis.methods.vectorized.correspondence.method import VisibilityCorrespondence
from jaxvis.methods.vectorized.method import VectorizedVisibility
from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.methods.vectorized.precompute import precompute_polygons, trace_polygons

__all__ = [
    "VectorizedVisibility",
    "VisibilityCorrespondence",
    "VisibilityPolygons",
    "precompute_polygons",
    "trace_polygons",
]
