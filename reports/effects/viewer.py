"""The limits of a scene's display for a viewer, in words and beside a near offset."""

from __future__ import annotations

import math
from dataclasses import dataclass

from xfrustum.compare.eye.limits import DisplayLimits, Viewer, display_limits
from xfrustum.reports.common.formatting import digits
from xfrustum.scenes.model.scene import Scene


@dataclass(frozen=True, kw_only=True)
class ViewerRecord:
    """What `explain --viewer` adds: the key `viewer` of the JSON object.

    Attributes
    ----------
    limits
        The display's limits for this viewer.
    near
        Near offset that is asked about, scene units.
    largest_unseen_near
        Largest near offset that the viewer cannot see, scene units.
    seen
        Whether the viewer can see the near offset that is asked about.
    bent
        Whether the paper's pivot bends what is replayed besides: the frustum is recentered.
    """

    limits: DisplayLimits
    near: float
    largest_unseen_near: float
    seen: bool
    bent: bool


def viewer_record(scene: Scene, distance: float, near: float) -> ViewerRecord:
    """Return what a display can show to a viewer at a distance, and whether a near offset is seen there."""
    limits = display_limits(scene, Viewer(distance=distance))
    return ViewerRecord(
        limits=limits,
        near=near,
        largest_unseen_near=limits.near,
        seen=near > limits.near,
        bent=scene.frustum.recentered,
    )


def viewer_table(record: ViewerRecord, units: str) -> str:
    """Return the same as lines of text."""
    limits = record.limits
    depths = f"{_length(limits.before, units)} before the plate, {_length(limits.behind, units)} behind it"
    lines = [
        f"for a viewer at {_length(limits.viewer.distance, units)}:",
        f"  a hogel is seen under {digits(limits.pitch_arcmin)}'; the eye resolves "
        f"{digits(limits.viewer.acuity_arcmin)}'",
        f"  pixels of a hogel are {digits(limits.pixel_arcmin)}' apart; depth of field {depths}",
    ]
    if limits.diffraction_arcmin is not None and limits.rays_per_pupil is not None:
        lines.append(
            f"  diffraction at a hogel {digits(limits.diffraction_arcmin)}'; "
            f"{digits(limits.rays_per_pupil)} rays in a pupil along an axis"
        )
    largest = _length(record.largest_unseen_near, units)
    lines.append(f"  a near offset n is a gap of 2 n at the plate: not seen up to n = {largest}")
    if record.bent:
        lines.append(
            "  (with --pivot camera; the pivot aperture bends what recentered frusta replay besides)"
        )
    if limits.near_stereo is None:
        lines.append(f"  (whether two eyes see it is not known: how long is one of the scene's {units}?)")
    word = "seen" if record.seen else "not seen"
    lines.append(f"  n = {_length(record.near, units)} is {word}")
    return "\n".join(lines)


def _length(value: float, units: str) -> str:
    return "any depth" if math.isinf(value) else f"{digits(value)} {units}"
