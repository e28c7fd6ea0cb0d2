"""Limits of a viewer's eyes on the near offset, and the view zone of a plate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from xfrustum.compare.eye import noticeable
from xfrustum.compare.planning.requirement import Requirement
from xfrustum.compare.planning.search import index_below, indices_of, largest_index, round_number
from xfrustum.compare.scout import PlateScan
from xfrustum.reference.lines.lines import film_window
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

#: Names of visible effects of near: change of disparity, and the crack at the plate.
STEREO, CRACK = "stereo", "crack"


@dataclass(frozen=True, kw_only=True)
class NearLimit:
    """Largest near offset whose effect of one kind stays unnoticed."""

    #: `STEREO` or `CRACK`
    name: str
    #: three digits; None where every near is unnoticed, 0 where none is
    largest_near: float | None
    #: arc seconds of disparity, or arc minutes of a crack's width
    allowed: float
    #: `stereo acuity`, or of a crack `acuity`, `pitch`, `pixel` or `diffraction`
    hidden_by: str


@dataclass(frozen=True, kw_only=True)
class ViewerRequirement:
    """Limits of a viewer straight before the plate."""

    viewer: noticeable.Viewer
    display: noticeable.Display
    content: noticeable.Content
    #: cause of the limit on depth resolution, and its height z; None where the separation was
    #: stated
    separation_limit: tuple[str, float] | None = None

    def noticed(self, settings: DoubleFrustum) -> dict[str, tuple[float, float, str]]:
        """Return amount, limit and masking cause of each visible effect of settings, by its name.

        Disparity is left out where the scene's unit has no known length, the crack where no surface
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
        return max(
            (there / allowed for there, allowed, _ in self.noticed(settings).values()), default=0.0
        )

    @property
    def limits(self) -> tuple[NearLimit, ...]:
        """Largest unnoticed near of each visible effect, without cuts."""
        return self.limits_with(DoubleFrustum(near=self.display.frustum.longest_reach / 2))

    def limits_with(self, settings: DoubleFrustum) -> tuple[NearLimit, ...]:
        """Return the largest unnoticed near of each effect, with the cuts and pivot of settings."""
        low, high = indices_of(self.display.frustum)
        # Near makes sense up to the first cut, or to less than the reach.
        end = settings.slabs[0] if settings.slabs else round_number(high)

        def unnoticed(name: str, near: float) -> bool:
            there, allowed, _ = self.noticed(replace(settings, near=near))[name]
            return there / allowed <= 1

        limits = []
        for name in self.noticed(settings):
            near, at = None, end
            if not unnoticed(name, end):
                index = largest_index(low, index_below(end), partial(unnoticed, name))
                near = 0.0 if index is None else round_number(index)
                at = near or round_number(low)
            _, allowed, cause = self.noticed(replace(settings, near=at))[name]
            limits.append(NearLimit(name=name, largest_near=near, allowed=allowed, hidden_by=cause))
        return tuple(limits)


def binding(limits: Sequence[NearLimit]) -> NearLimit | None:
    """Return the limit with the smallest near; None where every near is unnoticed."""
    pairs = [(limit.largest_near, limit) for limit in limits if limit.largest_near is not None]
    return min(pairs, key=lambda pair: pair[0])[1] if pairs else None


#: lower and upper end, scene units
Interval = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class ViewZone:
    """Places along x and y, at a distance before the plate, to which films of hogels send rays.

    Rays leave from the centers of hogels; from the edges of their cells they reach half a pitch
    farther.
    """

    #: from the plate, scene units
    distance: float
    #: x and y of eyes that see at least one hogel
    some: tuple[Interval, Interval]
    #: x and y of eyes that see every hogel; None for none
    every: tuple[Interval, Interval] | None

    @property
    def some_eyes_apart(self) -> float:
        """Largest distance of two eyes that see some hogels, scene units; 0 for none."""
        return _eyes_within(self.some)

    @property
    def all_eyes_apart(self) -> float:
        """Largest distance of two eyes that see every hogel, scene units; 0 for none."""
        return 0.0 if self.every is None else _eyes_within(self.every)


def _eyes_within(zone: tuple[Interval, Interval]) -> float:
    """Return the largest distance of two eyes straight before the plate's middle within a zone."""
    (left, right), (low, high) = zone
    return max(0.0, 2 * min(-left, right)) if low < 0 < high else 0.0


def view_zone(scene: Scene, distance: float) -> ViewZone:
    """Return the view zone of a plate at a distance; its ends are linear in aperture position."""
    columns, rows = scene.plate.hogels
    some, every = [], []
    for axis in range(2):
        ends = []
        for aperture in (scene.plate.aperture(0, 0), scene.plate.aperture(columns - 1, rows - 1)):
            shear, half_extent = film_window(scene.frustum, aperture)
            middle = (aperture.x, aperture.y)[axis] - distance * shear[axis]
            half = distance * half_extent[axis]
            ends.append((middle - half, middle + half))
        lows, highs = zip(*ends, strict=True)
        some.append((min(lows), max(highs)))
        every.append((max(lows), min(highs)))
    seen = all(low < high for low, high in every)
    return ViewZone(
        distance=distance, some=(some[0], some[1]), every=(every[0], every[1]) if seen else None
    )


def seen_content(scan: PlateScan) -> noticeable.Content:
    """Return the depths that a plate shows, as a scan has seen them."""
    sides: list[tuple[float, float] | None] = []
    for sign in (1.0, -1.0):
        seen = [sign * look.height[sign * look.height >= 0] for look in scan.looks]
        ends = [(float(heights.min()), float(heights.max())) for heights in seen if heights.size]
        sides.append((min(low for low, _ in ends), max(high for _, high in ends)) if ends else None)
    through = noticeable.runs_through_plate(scan.scene)
    return noticeable.Content(before=sides[0], behind=sides[1], through=through)


def with_viewer(
    requirement: Requirement, scan: PlateScan, viewer: noticeable.Viewer
) -> Requirement:
    """Return a requirement with the limits of a viewer's eyes at a scanned plate.

    Without a stated separation, the smallest separation that viewer or display resolves is
    required. InputError for a length unit without a physical size, or for a surface behind the
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
