"""The first answer: what every line through an aperture meets first, traced, certified and lit.

certify/     Who is first along each line: proven, decided exactly, or named a tie
devices/     What the reference computes on: LLVM through Dr.Jit, threads, bands of rows
lines/       The lines through an aperture, and triangles as these lines see them
shading/     The color of true hits
tracers/     Ray tracers as second opinions, and as judges of what is hidden
transport/   Light transport: shadows and interreflection, by light paths
averages     Color averaged over the boxes of pixels and over apertures; every line of it is certified
convergence  The integral over a hogel's aperture, converged to a stated tolerance (paper, section 6:
             band limiting)
pictures     What is decided along lines, as the image of an aperture: points, normals, objects, light
truth        The reference: true images, every pixel proven, decided exactly or named a tie
"""

from xfrustum.reference.convergence import Converged
from xfrustum.reference.tracers.visibility import SurfacePoints
from xfrustum.reference.transport.transport import PathTracer, RadianceEstimate
from xfrustum.reference.truth import TRACERS, Reference

__all__ = ["TRACERS", "Converged", "PathTracer", "RadianceEstimate", "Reference", "SurfacePoints"]
