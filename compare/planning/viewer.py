"""What a viewer requires of a plan: nothing that eyes can see, whatever hogels' pixels show."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

from xfrustum.compare.eye import noticeable
from xfrustum.compare.planning.search import index_below, indices_of, largest_index, round_number
from xfrustum.compare.planning.views import Errors, Requirement
from xfrustum.compare.scout import PlateScan
from xfrustum.reference.lines.lines import film_window
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.tolerances import MAX_DEPTH_WRONG

STEREO, CRACK = "stereo", "crack"
"""Names of what a viewer may notice of near: disparity, and the crack at the plate."""

_MEASURES = {
    STEREO: "arc seconds of disparity",
    CRACK: "arc minutes of a crack at the plate's corners",
}
"""Measures of what may be noticed, in words."""

_HIDING = {
    "acuity": "the eye's acuity",
    "stereo acuity": "stereo acuity",
    "pitch": "the pitch of the hogels",
    "pixel": "the angle of a hogel's pixels",
    "diffraction": "diffraction at a hogel",
}
"""What limits the eyes, in words."""


@dataclass(frozen=True, kw_only=True)
class NearLimit:
    """One of the things that a viewer may notice of a near offset."""

    name: str
    largest_near: float | None  #: three digits; None where every near is unnoticed, 0 where none is
    allowed: (
        float  #: arc seconds of disparity, or arc minutes of a crack's width, that are not noticed
    )
    hidden_by: str  #: `stereo acuity`, or of a crack `acuity`, `pitch`, `pixel` or `diffraction`


@dataclass(frozen=True, kw_only=True)
class ViewerRequirement(Requirement):
    """Requirement of a viewer straight before the plate: pixels may be displaced by any length.

    Sheets must be ordered where the viewer, or the display, tells them apart. `separation_limit` is
    what limits the depths that can be told apart there, and their height z; None where a separation
    was asked for.
    """

    SEEN_BY_EYES: ClassVar[bool] = True

    tolerance_px: float = math.inf
    viewer: noticeable.Viewer
    display: noticeable.Display
    content: noticeable.Content
    separation_limit: tuple[str, float] | None = None
    #: Width on the plate of a pixel of the eyes that replay the plan, scene units: a plan keeps the
    #: noise of that replay as a margin; None for no margin
    eye_pixel: float | None = None

    def noticed(self, settings: DoubleFrustum) -> dict[str, tuple[float, float, str]]:
        """Return what may be noticed by name: how much there is, how much is not noticed, and what masks it.

        Depth is left out where the scene's unit has no known length, the crack where no surface
        meets the plate.
        """
        found = {}
        if self.display.millimeters is not None:
            change = noticeable.stereo_change_arcsec(
                self.content, self.viewer, self.display, settings
            )
            found[STEREO] = change, self.viewer.stereo_acuity_arcsec, "stereo acuity"
        if self.content.through:
            hidden_by, allowed, width = noticeable.resolved_crack(
                self.viewer, self.display, settings
            )
            found[CRACK] = width, allowed, hidden_by
        return found

    def by_pixels(self, found: Errors) -> float:
        """Return 0: eyes judge what near does."""
        return 0.0

    def by_eyes(self, settings: DoubleFrustum) -> float:
        """Return the ratio of what settings do to depth and at the plate to what is not noticed."""
        found, margin = self.noticed(settings).items(), self._margin(settings)
        parts = ((there + margin.get(name, 0.0)) / allowed for name, (there, allowed, _) in found)
        return max(parts, default=0.0)

    def _margin(self, settings: DoubleFrustum) -> dict[str, float]:
        """Return by how much a replay of settings may be off, by the name of what may be noticed."""
        if self.eye_pixel is None or self.display.millimeters is None:
            return {}
        seen = self.content, self.viewer, self.display
        return {STEREO: noticeable.replay_noise_arcsec(*seen, settings, self.eye_pixel)}

    def limit_of_near(self, larger: DoubleFrustum, units: str) -> str:
        """Say what a viewer would notice of a larger near."""
        margin = self._margin(larger)
        for name, (there, allowed, hidden_by) in self.noticed(larger).items():
            noise = margin.get(name, 0.0)
            if there + noise > allowed:
                said = (
                    f"eyes at {self.viewer.distance:g} {units} see {there:.3g} {_MEASURES[name]}, "
                )
                said += (
                    "and with the noise of a replay, which is kept as a margin, " if noise else ""
                )
                return f"{said}more than the {allowed:.3g} that {_HIDING[hidden_by]} hides"
        return "depth would be worse off"

    def separation_reason(self, units: str) -> str:
        """Say why sheets must be ordered that are so far apart."""
        if self.separation_limit is None:
            return ""
        name, height = self.separation_limit
        side = "before" if height > 0 else "behind"
        return (
            f"Depths {abs(height):.3g} {units} {side} the plate are told apart from "
            f"{self.separation:.3g} {units} on, by {_HIDING[name]}."
        )

    @property
    def limits(self) -> tuple[NearLimit, ...]:
        """What a viewer may notice of a near without cuts: how large near may be for each."""
        return self.limits_with(DoubleFrustum(near=self.display.frustum.longest_reach / 2))

    def limits_with(self, settings: DoubleFrustum) -> tuple[NearLimit, ...]:
        """Return what a viewer may notice of a near with the cuts and the pivot of some settings."""
        low, high = indices_of(self.display.frustum)
        # Near makes sense up to the first cut, or to less than the reach.
        end = settings.slabs[0] if settings.slabs else round_number(high)

        def unnoticed(name: str, near: float) -> bool:
            there, allowed, _ = self.noticed(replace(settings, near=near))[name]
            return there / allowed <= 1

        found = []
        for name in self.noticed(settings):
            near, at = None, end
            if not unnoticed(name, end):
                index = largest_index(low, index_below(end), partial(unnoticed, name))
                near = 0.0 if index is None else round_number(index)
                at = near or round_number(low)
            _, allowed, hidden_by = self.noticed(replace(settings, near=at))[name]
            found.append(
                NearLimit(name=name, largest_near=near, allowed=allowed, hidden_by=hidden_by)
            )
        return tuple(found)


Interval = tuple[float, float]  #: lower and upper end, scene units


@dataclass(frozen=True, kw_only=True)
class ViewZone:
    """Places along x and y, at a distance before the plate, to which films of hogels send rays.

    Rays leave from the centers of hogels: from the edges of their cells they come half a pitch
    farther.
    """

    distance: float  #: from the plate, scene units
    some: tuple[Interval, Interval]  #: x and y of eyes that see at least one hogel
    every: (
        tuple[Interval, Interval] | None
    )  #: x and y of eyes that see every hogel; None without any

    @property
    def some_eyes_apart(self) -> float:
        """Upper limit of the distance of two eyes that see some hogels; 0 without any."""
        return _eyes_within(self.some)

    @property
    def all_eyes_apart(self) -> float:
        """Upper limit of the distance of two eyes that see every hogel; 0 without any."""
        return 0.0 if self.every is None else _eyes_within(self.every)


def _eyes_within(zone: tuple[Interval, Interval]) -> float:
    """Return the largest distance of two eyes straight before the middle of the plate within a zone."""
    (left, right), (low, high) = zone
    return max(0.0, 2 * min(-left, right)) if low < 0 < high else 0.0


def view_zone(scene: Scene, distance: float) -> ViewZone:
    """Return the view zone of a plate at a distance; its ends are linear in the aperture's place."""
    columns, rows = scene.plate.hogels
    some, every = [], []
    for axis in range(2):
        ends = []
        for aperture in (scene.plate.aperture(0, 0), scene.plate.aperture(columns - 1, rows - 1)):
            shear, half_extent = film_window(scene.frustum, aperture)
            middle = (aperture.x, aperture.y)[axis] - distance * shear[axis]
            ends.append(
                (middle - distance * half_extent[axis], middle + distance * half_extent[axis])
            )
        (first, last), (other_first, other_last) = ends
        some.append((min(first, other_first), max(last, other_last)))
        every.append((max(first, other_first), min(last, other_last)))
    seen = all(low < high for low, high in every)
    return ViewZone(
        distance=distance, some=(some[0], some[1]), every=(every[0], every[1]) if seen else None
    )


def binding(limits: Sequence[NearLimit]) -> NearLimit | None:
    """Return the limit that leaves the smallest near; None where no near is noticed."""
    found = [(one.largest_near, one) for one in limits if one.largest_near is not None]
    return min(found, key=lambda pair: pair[0])[1] if found else None


def seen_content(scouted: PlateScan) -> noticeable.Content:
    """Return the depths that a plate shows, as a scout has seen them."""
    sides: list[tuple[float, float] | None] = []
    for sign in (1.0, -1.0):
        seen = [sign * look.height[sign * look.height >= 0] for look in scouted.looks]
        ends = [(float(one.min()), float(one.max())) for one in seen if one.size]
        sides.append((min(low for low, _ in ends), max(high for _, high in ends)) if ends else None)
    through = noticeable.runs_through_plate(scouted.scene)
    return noticeable.Content(before=sides[0], behind=sides[1], through=through)


def eye_requirement(
    scouted: PlateScan,
    viewer: noticeable.Viewer,
    separation: float | None = None,
    max_wrong: float = MAX_DEPTH_WRONG,
    eye_pixel: float | None = None,
) -> ViewerRequirement:
    """Return what a viewer requires of a plan for a scene whose plate was scouted.

    A separation of None is what can be told apart. `max_wrong` is the largest share of pixels wrong
    by depth: eyes take a pixel of each hogel, so that the share is theirs. Raises InputError where
    the length of the scene's unit is not known, or something is seen behind the viewer.
    """
    display, content = noticeable.Display.from_scene(scouted.scene), seen_content(scouted)
    noticeable.eyes_apart(viewer, display)
    noticeable.require_before_viewer(scouted.scene, content, viewer)
    found, limit = noticeable.finest_separation(content.farthest, viewer, display), None
    if separation is None and found is not None:
        limit = found[0], found[2]
        separation = min(found[1], scouted.scene.frustum.longest_reach)
    return ViewerRequirement(
        separation=separation,
        max_wrong=max_wrong,
        viewer=viewer,
        display=display,
        content=content,
        separation_limit=limit,
        eye_pixel=eye_pixel,
    )
