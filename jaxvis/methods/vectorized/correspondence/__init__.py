"""Correspondence between the visibility polygons of triangles' corners (paper 000, III-B to D)."""

from jaxvis.methods.vectorized.correspondence.triples import CorrespondingPolygons

__all__ = ["CorrespondingPolygons"]
