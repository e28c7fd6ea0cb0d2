"""The first answer: what every line through an aperture meets first, traced and certified."""

from xfrustum.reference.truth import TRACERS, Reference
from xfrustum.reference.visibility import SurfacePoints

__all__ = ["TRACERS", "Reference", "SurfacePoints"]
