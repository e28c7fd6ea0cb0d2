"""The settings of the paper's double frustum: what is asked of a rasterizer (paper, section 4).

Both answers need them: the rasterizer draws with them, and the reference traces the same offset
cameras as an exact model of what the rasterizer should have drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.frustum import Frustum


class DepthFormat(StrEnum):
    """Storage of the depth buffer."""

    D16 = "d16"
    D24 = "d24"
    D32F = "d32f"


class DepthMapping(StrEnum):
    """How depth along the camera's axis becomes the stored value."""

    STANDARD = "standard"
    REVERSED = "reversed"


class Camera(StrEnum):
    """Which of the two cameras draws (paper, figure 7)."""

    BOTH = "both"
    C = "c"
    C_STAR = "c-star"


@dataclass(frozen=True, kw_only=True)
class DoubleFrustum:
    """One way to draw the two cameras C and C*.

    Attributes
    ----------
    near
        Offset of both cameras from the plate, n > 0, in scene units.
    depth, mapping
        Depth buffer format, and which end of it is near.
    camera
        Both cameras, or one alone.
    """

    near: float
    depth: DepthFormat = DepthFormat.D24
    mapping: DepthMapping = DepthMapping.STANDARD
    camera: Camera = Camera.BOTH

    def __post_init__(self) -> None:
        if not (math.isfinite(self.near) and self.near > 0):
            raise InputError(f"near must be a positive length, not {self.near}")

    def check_against(self, frustum: Frustum) -> None:
        """Raise InputError unless 0 < near < reach (the larger of the two sides)."""
        if not self.near < frustum.longest_reach:
            raise InputError(
                f"near {self.near} must be smaller than the reach, {frustum.longest_reach}; "
                "it is the distance that both cameras step back from the plate"
            )

    @property
    def depth_label(self) -> str:
        """Format and mapping as people write them, such as `D24 standard`."""
        return f"{self.depth.upper()} {self.mapping}"
