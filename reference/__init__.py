"""The reference renderer: the first surface along every line of an aperture, certified and shaded.

Read it in this order, beside docs/truth.md:

* lines: the lines through an aperture, the definition of truth
* certify: certification of each pixel, as proven, exact or a tie, and the occlusion query
* shading: the color of true hits, and exact shadows of lights
* pictures: the image of an aperture from decisions along its lines, and means of color
* truth: true images of a scene, in bands of rows or tiles of hogels
* alone: images and errors of uncertified ray tracers in single precision
* eye: views of eyes in front of the plate, true and replayed
* tracers: ray tracers as second opinions, and the crossed frustum as a sensor of Mitsuba
* proposals: images of a tracer alone, and second opinions on decisions
* rays: first surfaces along any rays, with trimesh's interface
* transport: interreflection and other light transport by light paths
* llvm: the LLVM that Dr.Jit uses, Mitsuba's variant, and the number of threads
* backend: the device of Dr.Jit's arrays, their conversion from and to NumPy, and bands of rows
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from xfrustum.reference.certify.occlusion import SurfacePoints as SurfacePoints
    from xfrustum.reference.pictures import Converged as Converged
    from xfrustum.reference.tracers import TRACERS as TRACERS
    from xfrustum.reference.transport import PathTracer as PathTracer
    from xfrustum.reference.transport import RadianceEstimate as RadianceEstimate
    from xfrustum.reference.truth import Reference as Reference

# Imported on first use: `check` needs only the scene and must not load ray tracers.
__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "pictures": ["Converged"],
        "certify.occlusion": ["SurfacePoints"],
        "tracers": ["TRACERS"],
        "transport": ["PathTracer", "RadianceEstimate"],
        "truth": ["Reference"],
    },
)
