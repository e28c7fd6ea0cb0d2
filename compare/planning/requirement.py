"""Limits that a picture must keep, and errors that are held against them."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from itertools import product
from typing import TYPE_CHECKING

from xfrustum.compare.beyond import is_beyond
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.scenes.arguments import real, settle
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Frustum
from xfrustum.tolerances import MAX_DEPTH_WRONG, MAX_WRONG, TOLERANCE_PX

if TYPE_CHECKING:
    from collections.abc import Iterable

    from xfrustum.compare.planning.viewer import ViewerRequirement

#: default separation of ordered sheets, share of the longest reach
SEPARATION_PER_REACH = 1e-3


DepthBuffer = tuple[DepthFormat, DepthMapping]


def depth_buffers(
    depth: DepthFormat | None = None, mapping: DepthMapping | None = None
) -> tuple[DepthBuffer, ...]:
    """Return the depth buffers of a format and a mapping; None for all formats, or all mappings."""
    return tuple(product([depth] if depth else DepthFormat, [mapping] if mapping else DepthMapping))


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Errors of settings at a hogel, or at the worst of several: measured, or predicted at most."""

    #: 0 where nothing is displaced, infinite where it is undefined
    displacement_p99_px: float
    #: share of judged pixels with the wrong surface
    surface_fraction: float
    #: share whose wrong surface is charged to depth, by the unluckiest order
    depth_wrong: float

    def beyond(self, tolerance_px: float) -> bool:
        """Return whether a hogel is beyond a tolerance; see `compare.beyond`."""
        return is_beyond(self.displacement_p99_px, self.surface_fraction, tolerance_px)


def worst_errors(results: Iterable[Errors]) -> dict[str, float]:
    """Return the worst of each error of some hogels, by the name of its field."""
    some = list(results)
    return {
        measure.name: max(getattr(errors, measure.name) for errors in some)
        for measure in fields(Errors)
    }


@dataclass(frozen=True, kw_only=True)
class Quality(Errors):
    """Errors at the worst of some apertures and of sheets at the farthest visible surface."""

    #: share of pixels that show the wrong one of two sheets a separation apart
    misordered: float
    #: smallest separation of which at most `MAX_MISORDERED_FRACTION` is wrong, scene units; 0
    #: where no two surfaces can be misordered
    separation: float


@dataclass(frozen=True, kw_only=True)
class Requirement:
    """Limits of a plan; InputError for numbers out of range."""

    #: largest 99th percentile of displacement, pixels
    tolerance_px: float = TOLERANCE_PX
    #: whether displacement and wrong surfaces limit near, or eyes alone
    pixels_count: bool = True
    #: distance of ordered sheets, scene units; None for `SEPARATION_PER_REACH` of the reach
    separation: float | None = None
    #: largest share of judged pixels that are wrong by depth
    max_wrong: float = MAX_DEPTH_WRONG
    #: device that draws; None for the one at hand
    device: DeviceModel | None = None
    #: limits of a viewer's eyes
    viewer: ViewerRequirement | None = None
    #: depth buffers to choose from; empty for all
    choices: tuple[DepthBuffer, ...] = ()

    def __post_init__(self) -> None:
        tolerance, share = real(self.tolerance_px), real(self.max_wrong)
        separation = None if self.separation is None else real(self.separation)
        if not (math.isfinite(tolerance) and tolerance > 0):
            raise InputError(
                f"tolerance must be a positive number of pixels, not {self.tolerance_px!r}"
            )
        if separation is not None and not (math.isfinite(separation) and separation > 0):
            raise InputError(f"separation must be a positive length, not {self.separation!r}")
        if not 0 < share < 1:
            raise InputError(
                f"the largest share of wrong pixels must lie between 0 and 1, not {share!r}"
            )
        settle(self, tolerance_px=tolerance, separation=separation, max_wrong=share)

    @property
    def buffers(self) -> tuple[DepthBuffer, ...]:
        """Depth buffers to choose from."""
        return self.choices or depth_buffers()

    @property
    def limit_px(self) -> float:
        """Tolerance of displacement, pixels; infinite where eyes alone limit near."""
        return self.tolerance_px if self.pixels_count else math.inf

    def separation_in(self, frustum: Frustum) -> float:
        """Return the separation in scene units."""
        return self.separation or SEPARATION_PER_REACH * frustum.longest_reach

    def ratios(self, errors: Errors) -> dict[str, float]:
        """Return the ratio of each error to its limit, by the name of its field."""
        return {
            "displacement_p99_px": errors.displacement_p99_px / self.tolerance_px
            if self.pixels_count
            else 0.0,
            "surface_fraction": errors.surface_fraction / MAX_WRONG if self.pixels_count else 0.0,
            "depth_wrong": errors.depth_wrong / self.max_wrong,
        }

    def worst_measure(self, errors: Errors) -> str:
        """Return the name of the error with the largest ratio to its limit."""
        ratios = self.ratios(errors)
        return max(ratios, key=ratios.__getitem__) if any(ratios.values()) else "surface_fraction"

    def near_excess(self, errors: Errors, settings: DoubleFrustum) -> float:
        """Return the largest ratio to their limits of the errors that grow with near."""
        pixels = self.ratios(errors)
        eyes = 0.0 if self.viewer is None else self.viewer.excess(settings)
        return max(pixels["displacement_p99_px"], pixels["surface_fraction"], eyes)

    def excess(self, errors: Errors) -> float:
        """Return the largest ratio of errors to their limits; infinite where one is undefined."""
        return max(self.ratios(errors).values())

    def missed_by(self, errors: Errors) -> bool:
        """Return whether a hogel exceeds a limit."""
        return self.excess(errors) > 1

    def met_by(self, quality: Quality) -> bool:
        """Return whether measured errors keep all limits."""
        return not self.missed_by(quality) and quality.misordered <= MAX_MISORDERED_FRACTION
