"""What a depth format and a mapping mean for the two cameras (design, section 3).

C keeps the nearest surface and starts from its far value; C* keeps the farthest and starts
from its near value (paper, section 3). Tests are strict: equal depths keep what was drawn first.
"""

from __future__ import annotations

from dataclasses import dataclass

from OpenGL import GL

from xfrustum.scenes.double_frustum import DepthFormat, DepthMapping

INTERNAL_FORMAT: dict[DepthFormat, int] = {
    DepthFormat.D16: GL.GL_DEPTH_COMPONENT16,
    DepthFormat.D24: GL.GL_DEPTH_COMPONENT24,
    DepthFormat.D32F: GL.GL_DEPTH_COMPONENT32F,
}
"""How the depth buffer is stored."""


@dataclass(frozen=True, kw_only=True)
class DepthEnds:
    """Stored depth at a camera's near and far plane."""

    near: float
    far: float


ENDS: dict[DepthMapping, DepthEnds] = {
    DepthMapping.STANDARD: DepthEnds(near=0.0, far=1.0),
    DepthMapping.REVERSED: DepthEnds(near=1.0, far=0.0),
}
"""Both mappings use clip control to hand 0..1 through; reversed swaps the ends."""


@dataclass(frozen=True, kw_only=True)
class DepthTest:
    """Where the depth buffer starts, and which comparison lets a fragment in."""

    clear: float
    function: str


def nearest_wins(mapping: DepthMapping) -> DepthTest:
    """Return C's test: an orthoscopic camera."""
    ends = ENDS[mapping]
    return DepthTest(clear=ends.far, function="<" if ends.near < ends.far else ">")


def farthest_wins(mapping: DepthMapping) -> DepthTest:
    """Return C*'s test: a pseudoscopic camera."""
    ends = ENDS[mapping]
    return DepthTest(clear=ends.near, function=">" if ends.near < ends.far else "<")
