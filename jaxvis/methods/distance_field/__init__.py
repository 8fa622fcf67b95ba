"""Visibility as spherical signed distances, at vertices or adaptive samples (paper 002)."""

from jaxvis.methods.distance_field.method import AdaptiveVisibility, DistanceField, ShadowMaps

__all__ = ["AdaptiveVisibility", "DistanceField", "ShadowMaps"]
