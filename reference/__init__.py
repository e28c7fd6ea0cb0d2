"""The first answer: what every line through an aperture meets first, traced and certified."""

from xfrustum.reference.truth import TRACERS, Reference

__all__ = ["TRACERS", "Reference"]
