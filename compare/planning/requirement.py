"""Limits that a plan must keep: of pixels, of depth buffers, and of a viewer's eyes.

Lengths of a plan have three digits, so that they are easy to read and type. Another advantage:
meshes that differ only by rounding, such as a mesh and its refinement, have equal plans.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from itertools import product

import numpy as np

from xfrustum.compare import noticeable
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.compare.sampling import is_beyond
from xfrustum.compare.scout import PlateScan
from xfrustum.reference.lines import film_window
from xfrustum.scenes.arguments import InputError, real, settle
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import DepthFormat, DepthMapping, DoubleFrustum, Frustum
from xfrustum.tolerances import MAX_DEPTH_WRONG, MAX_WRONG, TOLERANCE_PX

#: default separation of ordered sheets, share of the longest reach
SEPARATION_PER_REACH = 1e-3

#: Smallest near and cut, share of the longest reach: float32 sums of a smaller near and the reach
#: would equal the reach.
SMALLEST_PER_REACH = 1e-8

#: Names of visible effects of near: change of disparity, and the crack at the plate.
STEREO, CRACK = "stereo", "crack"

DepthBuffer = tuple[DepthFormat, DepthMapping]
Interval = tuple[float, float]


def depth_buffers(
    depth: DepthFormat | None = None, mapping: DepthMapping | None = None
) -> tuple[DepthBuffer, ...]:
    """Return the depth buffers of a format and a mapping; None for all formats, or all mappings."""
    return tuple(product([depth] if depth else DepthFormat, [mapping] if mapping else DepthMapping))


# Lengths of three digits
# -------------------------------------------------------------------------------------------------


def round_number(index: int) -> float:
    """Return the length of three digits with an index: 1.00 for 0, 1.01 for 1, 0.999 for -1."""
    decade, place = divmod(index, 900)
    # Parse the digits instead of multiplying, to get the nearest float.
    return float(f"{100 + place}e{decade - 2}")


def index_below(length: float, *, strictly: bool = False) -> int:
    """Return the index of the largest three-digit length that is at most, or below, a length."""
    decade = math.floor(math.log10(length))
    # Logarithms and quotients are rounded: begin above, then decrease.
    index = decade * 900 + int(length / float(f"1e{decade}") * 100) - 98
    while round_number(index) > length or (strictly and round_number(index) == length):
        index -= 1
    return index


def indices_of(frustum: Frustum) -> tuple[int, int]:
    """Return the indices of the smallest and the largest length allowed for near and for cuts."""
    reach = frustum.longest_reach
    return index_below(SMALLEST_PER_REACH * reach), index_below(reach, strictly=True)


def largest_index(low: int, high: int, holds: Callable[[float], bool]) -> int | None:
    """Return the last index in low..high up to which a condition holds; None if it fails at low."""
    first_failure = bisect_left(
        range(low, high + 1), True, key=lambda index: not holds(round_number(index))
    )
    return low + first_failure - 1 if first_failure else None


def smallest_index(low: int, high: int, holds: Callable[[float], bool]) -> int:
    """Return the smallest index in low..high at and above which a condition holds; else `high`."""
    return low + bisect_left(range(low, high), True, key=lambda index: holds(round_number(index)))


# Errors and limits
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Measured errors, or predicted bounds, of settings at a hogel or at the worst of several."""

    #: 0 without displacement, infinite where displacement is undefined
    displacement_p99_px: float
    #: share of judged pixels with the wrong surface
    surface_fraction: float
    #: share of pixels with a wrong surface by depth, for the worst draw order
    depth_wrong: float

    def beyond(self, tolerance_px: float) -> bool:
        """Return whether a hogel is beyond a tolerance; see `compare.sampling`."""
        return is_beyond(self.displacement_p99_px, self.surface_fraction, tolerance_px)


def worst_errors(results: Iterable[Errors]) -> dict[str, float]:
    """Return the largest value of each error over some hogels, by the name of its field."""
    some, names = list(results), (field.name for field in fields(Errors))
    return {name: max(getattr(errors, name) for errors in some) for name in names}


@dataclass(frozen=True, kw_only=True)
class Quality(Errors):
    """Errors at the worst of some apertures, and of sheets at the farthest visible surface."""

    #: share of pixels that show the wrong sheet, of two sheets a separation apart
    misordered: float
    #: smallest separation at which at most `MAX_MISORDERED_FRACTION` of the pixels are wrong, scene
    #: units; 0 if no two surfaces can be misordered
    separation: float


@dataclass(frozen=True, kw_only=True)
class NearLimit:
    """Largest near offset whose effect of one kind stays unnoticed."""

    #: `STEREO` or `CRACK`
    name: str
    #: scene units, three digits; None if no near is noticed, 0 if every near is noticed
    largest_near: float | None
    #: arc seconds of disparity, or arc minutes of a crack's width
    allowed: float
    #: `stereo acuity` for disparity; `acuity`, `pitch`, `pixel` or `diffraction` for a crack
    hidden_by: str


def binding(limits: Iterable[NearLimit]) -> NearLimit | None:
    """Return the limit with the smallest near; None if no near is noticed."""
    noticed = [limit for limit in limits if limit.largest_near is not None]
    return min(noticed, key=lambda limit: limit.largest_near or 0.0, default=None)


@dataclass(frozen=True, kw_only=True)
class ViewerRequirement:
    """Limits of a viewer straight in front of the plate."""

    viewer: noticeable.Viewer
    display: noticeable.Display
    content: noticeable.Content
    #: cause of the limit on depth resolution, and its height z; None if the separation was stated
    separation_limit: tuple[str, float] | None = None

    def noticed(self, settings: DoubleFrustum) -> dict[str, tuple[float, float, str]]:
        """Return amount, limit and masking cause of each visible effect of settings, by its name.

        Disparity is left out if the scene's unit has no known length, and the crack if no surface
        meets the plate.
        """
        effects = {}
        if self.display.millimeters is not None:
            change = noticeable.stereo_change_arcsec(
                self.content, self.viewer, self.display, settings
            )
            effects[STEREO] = change, self.viewer.stereo_acuity_arcsec, "stereo acuity"
        if self.content.through:
            cause, allowed, width = noticeable.resolved_crack(self.viewer, self.display, settings)
            effects[CRACK] = width, allowed, cause
        return effects

    def excess(self, settings: DoubleFrustum) -> float:
        """Return the largest ratio of a visible effect of settings to its limit."""
        effects = self.noticed(settings).values()
        return max((amount / allowed for amount, allowed, _ in effects), default=0.0)

    def limits(self, settings: DoubleFrustum | None = None) -> tuple[NearLimit, ...]:
        """Return the largest unnoticed near of each effect, with the cuts and pivot of settings."""
        low, high = indices_of(self.display.frustum)
        # Near must not exceed the first cut; without cuts, it must be below the reach.
        cuts = () if settings is None else settings.slabs
        end = cuts[0] if cuts else round_number(high)
        usual = settings or DoubleFrustum(near=end)

        def limit(name: str) -> NearLimit:
            def unnoticed(near: float) -> bool:
                amount, allowed, _ = self.noticed(replace(usual, near=near))[name]
                return amount / allowed <= 1

            largest, at = None, end
            if not unnoticed(end):
                index = largest_index(low, index_below(end), unnoticed)
                largest = 0.0 if index is None else round_number(index)
                at = largest or round_number(low)
            _, allowed, cause = self.noticed(replace(usual, near=at))[name]
            return NearLimit(name=name, largest_near=largest, allowed=allowed, hidden_by=cause)

        return tuple(map(limit, self.noticed(usual)))


@dataclass(frozen=True, kw_only=True)
class Requirement:
    """Limits of a plan; InputError for numbers out of range."""

    #: largest 99th percentile of displacement, pixels
    tolerance_px: float = TOLERANCE_PX
    #: whether displacement and wrong surfaces limit near; otherwise only eyes do
    pixels_count: bool = True
    #: separation of ordered sheets, scene units; None for `SEPARATION_PER_REACH` of the reach
    separation: float | None = None
    #: largest share of judged pixels that are wrong by depth
    max_wrong: float = MAX_DEPTH_WRONG
    #: device that draws; None selects the current device
    device: DeviceModel | None = None
    #: limits of a viewer's eyes
    viewer: ViewerRequirement | None = None
    #: depth buffers to choose from; empty for all
    choices: tuple[DepthBuffer, ...] = ()

    def __post_init__(self) -> None:
        tolerance, share = real(self.tolerance_px), real(self.max_wrong)
        separation = None if self.separation is None else real(self.separation)
        if not 0 < tolerance < math.inf:
            raise InputError(
                f"tolerance must be a positive number of pixels, not {self.tolerance_px!r}"
            )
        if separation is not None and not 0 < separation < math.inf:
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
        """Tolerance of displacement, pixels; infinite if only eyes limit near."""
        return self.tolerance_px if self.pixels_count else math.inf

    def separation_in(self, frustum: Frustum) -> float:
        """Return the separation in scene units."""
        return self.separation or SEPARATION_PER_REACH * frustum.longest_reach

    def ratios(self, errors: Errors) -> dict[str, float]:
        """Return the ratio of each error to its limit, by the name of its field."""
        ratios = {
            "displacement_p99_px": errors.displacement_p99_px / self.tolerance_px,
            "surface_fraction": errors.surface_fraction / MAX_WRONG,
        }
        # Without a limit in pixels, even an infinite displacement is not an excess.
        counted = ratios if self.pixels_count else dict.fromkeys(ratios, 0.0)
        return {**counted, "depth_wrong": errors.depth_wrong / self.max_wrong}

    def worst_measure(self, errors: Errors) -> str:
        """Return the name of the error with the largest ratio to its limit."""
        ratios = self.ratios(errors)
        return max(ratios, key=ratios.__getitem__) if any(ratios.values()) else "surface_fraction"

    def near_excess(self, errors: Errors, settings: DoubleFrustum) -> float:
        """Return the largest ratio of error to limit among the errors that grow with near."""
        pixels = self.ratios(errors)
        eyes = 0.0 if self.viewer is None else self.viewer.excess(settings)
        return max(pixels["displacement_p99_px"], pixels["surface_fraction"], eyes)

    def excess(self, errors: Errors) -> float:
        """Return the largest ratio of an error to its limit; infinite if an error is undefined."""
        return max(self.ratios(errors).values())

    def missed_by(self, errors: Errors) -> bool:
        """Return whether a hogel exceeds a limit."""
        return self.excess(errors) > 1

    def met_by(self, quality: Quality) -> bool:
        """Return whether measured errors are within all limits."""
        return not self.missed_by(quality) and quality.misordered <= MAX_MISORDERED_FRACTION


# Viewers and plates
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ViewZone:
    """Places along x and y, at a distance from the plate, to which films of hogels send rays.

    Rays leave from the centers of hogels. Rays from the edges of the hogels' cells would reach half
    a pitch farther.
    """

    #: distance of the eyes from the plate, scene units
    distance: float
    #: x and y of eyes that see at least one hogel
    some: tuple[Interval, ...]
    #: x and y of eyes that see every hogel; None if no place sees every hogel
    every: tuple[Interval, ...] | None

    @property
    def some_eyes_apart(self) -> float:
        """Largest distance of two eyes that see some hogels, scene units; 0 if impossible."""
        return _eyes_within(self.some)

    @property
    def all_eyes_apart(self) -> float:
        """Largest distance of two eyes that see every hogel, scene units; 0 if impossible."""
        return 0.0 if self.every is None else _eyes_within(self.every)


def _eyes_within(zone: Sequence[Interval]) -> float:
    """Return the largest distance of two eyes in a zone, symmetric about the plate's middle."""
    (left, right), (low, high) = zone
    return max(0.0, 2 * min(-left, right)) if low < 0 < high else 0.0


def view_zone(scene: Scene, distance: float) -> ViewZone:
    """Return the view zone of a plate at a distance, from two corners of the plate.

    Film ends at the distance are linear in aperture position, and therefore extreme at the corners.
    """
    columns, rows = scene.plate.hogels
    lows, highs = [], []
    for aperture in (scene.plate.aperture(0, 0), scene.plate.aperture(columns - 1, rows - 1)):
        shear, half_extent = np.array(film_window(scene.frustum, aperture))
        middle, half = (aperture.x, aperture.y) - distance * shear, distance * half_extent
        lows.append(middle - half)
        highs.append(middle + half)

    def zone(first: np.ufunc, last: np.ufunc) -> tuple[Interval, ...]:
        return tuple(zip(first(*lows).tolist(), last(*highs).tolist(), strict=True))

    every = zone(np.maximum, np.minimum)
    seen = all(low < high for low, high in every)
    some = zone(np.minimum, np.maximum)
    return ViewZone(distance=distance, some=some, every=every if seen else None)


def seen_content(scan: PlateScan) -> noticeable.Content:
    """Return the depths visible through a plate, according to a scan."""
    heights = np.concatenate([look.height.ravel() for look in scan.looks])

    def depths(side: float) -> Interval | None:
        seen = (side * heights)[side * heights >= 0]
        return (float(seen.min()), float(seen.max())) if seen.size else None

    through = noticeable.runs_through_plate(scan.scene)
    return noticeable.Content(before=depths(1.0), behind=depths(-1.0), through=through)


def with_viewer(
    requirement: Requirement, scan: PlateScan, viewer: noticeable.Viewer
) -> Requirement:
    """Return a requirement with the limits of a viewer's eyes at a scanned plate.

    Without a stated separation, the plan must order the smallest separation that viewer and display
    resolve. InputError for a length unit without a physical size, or for a surface behind the
    viewer.
    """
    display, content = noticeable.Display.from_scene(scan.scene), seen_content(scan)
    noticeable.eyes_apart(viewer, display)
    noticeable.require_before_viewer(scan.scene, content, viewer)
    finest = noticeable.finest_separation(content.farthest, viewer, display)
    separation, limit = requirement.separation, None
    if separation is None and finest is not None:
        limit = finest[0], finest[2]
        separation = min(finest[1], scan.scene.frustum.longest_reach)
    eyes = ViewerRequirement(
        viewer=viewer, display=display, content=content, separation_limit=limit
    )
    return replace(requirement, separation=separation, viewer=eyes)
