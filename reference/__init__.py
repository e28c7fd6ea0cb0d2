"""The first answer: what every line through an aperture meets first, traced, certified and lit."""

from xfrustum.reference.convergence import Converged
from xfrustum.reference.tracers.visibility import SurfacePoints
from xfrustum.reference.transport.transport import PathTracer, RadianceEstimate
from xfrustum.reference.truth import TRACERS, Reference

__all__ = ["TRACERS", "Converged", "PathTracer", "RadianceEstimate", "Reference", "SurfacePoints"]
