"""Depth formats and mappings as the two cameras use them (docs/method.md, "The two cameras").

C keeps the nearest surface and starts from its far value; C* keeps the farthest and starts
from its near value (paper, section 3). Tests are strict: of equal depths the first drawn stays.
"""

from dataclasses import dataclass

from OpenGL import GL

from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping

INTERNAL_FORMAT: dict[DepthFormat, int] = {
    DepthFormat.D16: GL.GL_DEPTH_COMPONENT16,
    DepthFormat.D24: GL.GL_DEPTH_COMPONENT24,
    DepthFormat.D32F: GL.GL_DEPTH_COMPONENT32F,
}
"""OpenGL's name of each format of the depth buffer."""


@dataclass(frozen=True, kw_only=True)
class ClipEnds:
    """Clip depth over w at a camera's near and far plane."""

    near: float
    far: float


@dataclass(frozen=True, kw_only=True)
class Mapping:
    """A depth mapping in the terms of OpenGL."""

    ends: ClipEnds  #: Clip depth over w at both planes
    clip_control: int = GL.GL_ZERO_TO_ONE  #: The range of clip depth that OpenGL keeps
    #: Expression for the shader's `FRAGMENT_DEPTH`; empty where the hardware interpolates depth
    fragment_depth: str = ""
    #: stored_near, stored_far: Values that the buffer holds at the near and at the far plane
    stored_near: float = 0.0
    stored_far: float = 1.0


_HYPERBOLIC = ClipEnds(near=0.0, far=1.0)

_REVERSED = ClipEnds(near=1.0, far=0.0)
"""Clip depth of the reversed mapping, and of fragments that write a depth of their own, where it only has to
clip. With `_HYPERBOLIC` instead, f / (f - n) rounded to float32 would clip surfaces before the far plane, or
keep some behind it."""


MAPPINGS = {
    DepthMapping.STANDARD: Mapping(ends=_HYPERBOLIC),
    DepthMapping.GL: Mapping(ends=ClipEnds(near=-1.0, far=1.0), clip_control=GL.GL_NEGATIVE_ONE_TO_ONE),
    DepthMapping.REVERSED: Mapping(ends=_REVERSED, stored_near=1.0, stored_far=0.0),
    DepthMapping.LOGARITHMIC: Mapping(ends=_REVERSED, fragment_depth="log(w / near) / log(far / near)"),
    DepthMapping.LINEAR: Mapping(ends=_REVERSED, fragment_depth="(w - near) / (far - near)"),
}
"""OpenGL's terms of each depth mapping."""


@dataclass(frozen=True, kw_only=True)
class DepthTest:
    """The value that the depth buffer is cleared to, and the comparison that a fragment must pass."""

    clear: float
    function: str


def nearest_wins(mapping: Mapping) -> DepthTest:
    """Return the depth test of C, the orthoscopic camera."""
    return DepthTest(
        clear=mapping.stored_far, function="<" if mapping.stored_near < mapping.stored_far else ">"
    )


def farthest_wins(mapping: Mapping) -> DepthTest:
    """Return the depth test of C*, the pseudoscopic camera."""
    return DepthTest(
        clear=mapping.stored_near, function=">" if mapping.stored_near < mapping.stored_far else "<"
    )
