"""The first answer: the surface that every line through an aperture meets first, certified and lit.

certify/      The first surface along each line: proven, decided exactly, or named a tie
devices/      The devices that the reference computes on: LLVM through Dr.Jit, threads, bands of rows
eye/          What an eye before the plate sees, truly and replayed, certified
lines/        The lines through an aperture, and triangles as these lines see them
shading/      The color of true hits
sight/        Which surface points a pencil's lines see: certified, by the bounds of the truth
tracers/      Ray tracers as second opinions
transport/    Light transport: shadows and interreflection, by light paths
alone         What ray tracers in single precision would have got wrong alone, without the certificate
averages      Color averaged over the boxes of pixels and over apertures; every line of it is certified
convergence   The integral over a hogel's aperture, converged to a stated tolerance (paper, section 6: band
              limiting)
film_shifts   Shifts of surface points on a film: where they belong, minus where an image shows them
film_shifts_jit
              Shifts of surface points on a film, compiled by Dr.Jit: one lane for each pixel
lane_formulas
              Formulas with one lane for each pixel or point, written once and evaluated by Dr.Jit or NumPy
lane_formulas_jit
              Formulas with one lane for each pixel or point, compiled by Dr.Jit
layers        Layers: what single cameras show, and how they overlay
pictures      The image of an aperture, made of decisions along its lines: points, normals, objects, light
pictures_jit  Points, normals, objects and light of decided pixels, compiled by Dr.Jit: one lane for each
              pixel
plain         What a ray tracer in single precision shows alone, in the place of the truth; nothing of it is
              examined
truth         True images: asks `certify` for each pixel, then adds points, normals and color
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from xfrustum.reference.certify.occlusion import SurfacePoints
    from xfrustum.reference.convergence import Converged
    from xfrustum.reference.tracers.tracer import TRACERS
    from xfrustum.reference.transport.transport import PathTracer, RadianceEstimate
    from xfrustum.reference.truth import Reference

__all__ = ["TRACERS", "Converged", "PathTracer", "RadianceEstimate", "Reference", "SurfacePoints"]

_MODULES = {
    "TRACERS": "tracers.tracer",
    "Converged": "convergence",
    "PathTracer": "transport.transport",
    "RadianceEstimate": "transport.transport",
    "Reference": "truth",
    "SurfacePoints": "certify.occlusion",
}
"""Module of each name. They are imported when first used: `explain` answers from the scene alone, and must
not load ray tracers and statistics for that."""


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module 'xfrustum.reference' has no attribute {name!r}")
    return getattr(import_module(f"xfrustum.reference.{_MODULES[name]}"), name)
