"""Samples between the vertices where polygons at the vertices alone interpolate badly."""
