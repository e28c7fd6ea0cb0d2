"""The first answer: the surface that every line through an aperture meets first, certified and lit.

Read it in this order, beside docs/truth.md:

lines/       The lines through an aperture: the definition of truth certify/     Where a pixel is
proven, decided exactly, or named a tie; and the occlusion query shading/     The color of true hits
pictures     The image of an aperture, made of decisions along its lines: points, normals, objects,
light truth        True images: asks `certify` for each pixel, then adds points, normals and color
alone        What ray tracers in single precision show alone, and what they would have got wrong
averages     Color averaged over the boxes of pixels and over apertures, and to convergence (paper,
section 6) eye/         What an eye before the plate sees, truly and replayed, certified tracers/
Ray tracers as second opinions transport    Light transport: shadows and interreflection, by light
paths llvm         The LLVM under Dr.Jit, Mitsuba's variant, and the number of threads backend
Where Dr.Jit's arrays lie, and the border between them and NumPy's memory       Bands of rows, which
bound what an image takes, and arrays that kernels may read in place
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from xfrustum.reference.averages import Converged as Converged
    from xfrustum.reference.certify.occlusion import SurfacePoints as SurfacePoints
    from xfrustum.reference.tracers.tracer import TRACERS as TRACERS
    from xfrustum.reference.transport import PathTracer as PathTracer
    from xfrustum.reference.transport import RadianceEstimate as RadianceEstimate
    from xfrustum.reference.truth import Reference as Reference

# They are imported when first used: `explain` answers from the scene alone, and must not load ray
# tracers.
__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "averages": ["Converged"],
        "certify.occlusion": ["SurfacePoints"],
        "tracers.tracer": ["TRACERS"],
        "transport": ["PathTracer", "RadianceEstimate"],
        "truth": ["Reference"],
    },
)
