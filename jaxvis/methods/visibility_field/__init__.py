"""Discrete visibility fields: octahedral masks in a grid that cull rays (paper 001)."""

from jaxvis.methods.visibility_field.field import FieldVisibility
from jaxvis.methods.visibility_field.method import Unculled, VisibilityField

__all__ = ["FieldVisibility", "Unculled", "VisibilityField"]
