"""Hybrid cone tracing: 3D voxel lightmaps and 2D height-field lightmaps (paper 003)."""

from jaxvis.methods.cones.method import HybridCones, VoxelCones
from jaxvis.methods.cones.visibility import ConeVisibility

__all__ = ["ConeVisibility", "HybridCones", "VoxelCones"]
