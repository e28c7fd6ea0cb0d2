"""What a viewer requires of a plan: nothing that eyes can see, whatever hogels' pixels show."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from xfrustum.compare.eye.noticeable import (
    Content,
    Display,
    Viewer,
    finest_separation,
    require_before_viewer,
    resolved_crack,
    runs_through_plate,
    stereo_change_arcsec,
)
from xfrustum.compare.planning.search import SMALLEST_PER_REACH, index_below, largest_index, round_number
from xfrustum.compare.planning.views import Errors, Requirement
from xfrustum.compare.scout import Scout
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum
from xfrustum.tolerances import MAX_DEPTH_WRONG

STEREO, CRACK = "stereo", "crack"
"""Names of what a viewer may notice of near: disparity, and the crack at the plate."""


@dataclass(frozen=True, kw_only=True)
class NearLimit:
    """One of the things that a viewer may notice of a near offset.

    Attributes
    ----------
    largest_near
        Largest near that stays below it, three digits, scene units; None where every near does, and 0 where
        not even the smallest does.
    allowed
        What the viewer does not notice: arc seconds of disparity, or arc minutes of a crack's width.
    hidden_by
        What decides that: `stereo acuity`, or of a crack `acuity`, `pitch`, `pixel` or `diffraction`.
    """

    name: str
    largest_near: float | None
    allowed: float
    hidden_by: str


@dataclass(frozen=True, kw_only=True)
class EyeRequirement(Requirement):
    """Requirement of a viewer straight before the plate.

    Pixels may be displaced by any length; sheets must be ordered where the viewer, or the display, tells
    them apart.

    Attributes
    ----------
    separation_limit
        What limits the depths that can be told apart where sheets must be ordered, and the height z there;
        None where a separation was asked for.
    """

    SEEN_BY_EYES: ClassVar[bool] = True

    tolerance_px: float = math.inf
    viewer: Viewer
    display: Display
    content: Content
    separation_limit: tuple[str, float] | None = None

    def stereo_change(self, settings: DoubleFrustum) -> float:
        """Return the largest change of disparity between two things that the viewer sees, arc seconds."""
        return stereo_change_arcsec(self.content, self.viewer, self.display, settings)

    def crack_width(self, settings: DoubleFrustum) -> float | None:
        """Return the width of the crack, arc minutes; None where no surface meets the plate."""
        return resolved_crack(self.viewer, self.display, settings)[2] if self.content.through else None

    def stereo_excess(self, settings: DoubleFrustum) -> float:
        """Return the change of disparity over stereo acuity."""
        return self.stereo_change(settings) / self.viewer.stereo_acuity_arcsec

    def crack_excess(self, settings: DoubleFrustum) -> float:
        """Return the width of the crack over what can be told apart; 0 where no surface meets the plate."""
        if not self.content.through:
            return 0.0
        _, allowed, width = resolved_crack(self.viewer, self.display, settings)
        return width / allowed

    def missed_by(self, found: Errors) -> bool:
        """Return whether a hogel has more wrong by depth than is allowed: eyes judge everything else."""
        return found.depth_wrong > self.max_wrong

    def excess(self, found: Errors) -> float:
        """Return the ratio of a hogel's errors by depth to what is allowed."""
        return found.depth_wrong / self.max_wrong

    def near_excess(self, found: Errors | None, settings: DoubleFrustum) -> float:
        """Return the ratio of what settings do to depth and at the plate to what is not noticed."""
        return max(self.stereo_excess(settings), self.crack_excess(settings))

    def allows(self, settings: DoubleFrustum) -> bool:
        """Return whether a viewer notices nothing of a near."""
        return self.near_excess(None, settings) <= 1

    def limit_of_near(self, larger: DoubleFrustum, units: str) -> str:
        """Say what a viewer would notice of a larger near."""
        if self.stereo_excess(larger) > 1:
            return (
                f"two eyes at {self.viewer.distance:g} {units} would see depths that are off by "
                f"{self.stereo_change(larger):.3g} arc seconds of disparity, beyond their stereo acuity of "
                f"{self.viewer.stereo_acuity_arcsec:g}"
            )
        if self.crack_excess(larger) > 1:
            name, allowed, width = resolved_crack(self.viewer, self.display, larger)
            return (
                f"surfaces that run through the plate would have a crack of {width:.3g} arc minutes there, "
                f"seen at its corners, which {_HIDING[name]} of {allowed:.3g} no longer hides"
            )
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
        return self.limits_with(DoubleFrustum(near=self._smallest))

    def limits_with(self, settings: DoubleFrustum) -> tuple[NearLimit, ...]:
        """Return what a viewer may notice of a near with the cuts and the pivot of some settings.

        Change of depth is left out where the length of the scene's unit is not known.
        """
        found = []
        if self.display.millimeters is not None:
            found.append(
                NearLimit(
                    name=STEREO,
                    largest_near=self._largest(self.stereo_excess, settings),
                    allowed=self.viewer.stereo_acuity_arcsec,
                    hidden_by="stereo acuity",
                )
            )
        if self.content.through:
            near = self._largest(self.crack_excess, settings)
            at = self._end(settings) if near is None else near or self._smallest
            name, allowed, _ = resolved_crack(self.viewer, self.display, replace(settings, near=at))
            found.append(NearLimit(name=CRACK, largest_near=near, allowed=allowed, hidden_by=name))
        return tuple(found)

    @property
    def binding(self) -> NearLimit | None:
        """The limit that leaves the smallest near; None where no near is noticed."""
        return binding(self.limits)

    @property
    def _smallest(self) -> float:
        return round_number(index_below(SMALLEST_PER_REACH * self.display.frustum.longest_reach))

    def _end(self, settings: DoubleFrustum) -> float:
        """Return the largest near that makes sense: up to the first cut, or less than the reach."""
        if settings.slabs:
            return settings.slabs[0]
        return round_number(index_below(self.display.frustum.longest_reach, strictly=True))

    def _largest(self, excess: Callable[[DoubleFrustum], float], settings: DoubleFrustum) -> float | None:
        """Return the largest near that is not noticed; None where that is any, 0 where it is none."""

        def unnoticed(near: float) -> bool:
            return excess(replace(settings, near=near)) <= 1

        end = self._end(settings)
        if unnoticed(end):
            return None
        found = largest_index(index_below(self._smallest), index_below(end), unnoticed)
        return 0.0 if found is None else round_number(found)


def binding(limits: Sequence[NearLimit]) -> NearLimit | None:
    """Return the limit that leaves the smallest near; None where no near is noticed."""
    found = [one for one in limits if one.largest_near is not None]
    return min(found, key=lambda one: one.largest_near or 0.0) if found else None


_HIDING = {
    "acuity": "the eye's acuity",
    "stereo acuity": "stereo acuity",
    "pitch": "the pitch of the hogels",
    "pixel": "the angle of a hogel's pixels",
    "diffraction": "diffraction at a hogel",
}
"""What hides something from eyes, in words."""


def seen_content(scouted: Scout) -> Content:
    """Return the depths that a plate shows, as a scout has seen them."""
    sides: dict[Camera, tuple[float, float] | None] = {}
    for camera, sign in ((Camera.C_STAR, 1.0), (Camera.C, -1.0)):
        seen = [sign * look.height[sign * look.height >= 0] for look in scouted.looks]
        ends = [(float(one.min()), float(one.max())) for one in seen if one.size]
        sides[camera] = (min(low for low, _ in ends), max(high for _, high in ends)) if ends else None
    return Content(
        before=sides[Camera.C_STAR],
        behind=sides[Camera.C],
        through=runs_through_plate(scouted.scene),
    )


def eye_requirement(
    scouted: Scout, viewer: Viewer, separation: float | None = None, max_wrong: float = MAX_DEPTH_WRONG
) -> EyeRequirement:
    """Return what a viewer requires of a plan for a scene whose plate was scouted.

    A separation of None is what can be told apart. `max_wrong` is the largest share of pixels wrong by depth:
    eyes take a pixel of each hogel, so that the share is theirs.

    Raises
    ------
    InputError
        The length of the scene's unit is not known, or something is seen behind the viewer.
    """
    display, content = Display.of(scouted.scene), seen_content(scouted)
    require_before_viewer(scouted.scene, content, viewer)
    reach, limit = scouted.scene.frustum.longest_reach, None
    if separation is None:
        found = finest_separation(content.farthest, viewer, display)
        if found is not None:
            limit, separation = (found[0], found[2]), min(found[1], reach)
    return EyeRequirement(
        separation=separation,
        max_wrong=max_wrong,
        viewer=viewer,
        display=display,
        content=content,
        separation_limit=limit,
    )
