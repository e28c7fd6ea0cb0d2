"""The limits of a scene's display for a viewer, in words and beside a near offset."""

from __future__ import annotations

import math
from dataclasses import dataclass

from xfrustum.compare.eye.limits import DisplayLimits, Viewer, display_limits
from xfrustum.compare.eye.noticeable import (
    Display,
    require_before_viewer,
    resolved_crack,
    surface_content,
)
from xfrustum.compare.planning.viewer import CRACK, STEREO, EyeRequirement, NearLimit, binding
from xfrustum.reports.common.formatting import digits
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum


@dataclass(frozen=True, kw_only=True)
class ViewerRecord:
    """What `explain --viewer` adds: the key `viewer` of the JSON object.

    Attributes
    ----------
    limits
        The display's limits for this viewer.
    near
        Near offset that is asked about, scene units.
    near_limits
        What the viewer may notice of a near with the same cuts, and how large near may be for each.
    largest_unseen_near
        Largest near offset that the viewer cannot see, scene units; infinite where he can see none.
    stereo_change_arcsec
        Largest change of disparity that the near offset asked about makes; None where the length of the
        scene's unit is not known.
    crack_arcmin
        Width of the crack that it opens; None where no surface runs through the plate.
    seen
        Whether the viewer can see the near offset that is asked about.
    bent
        Whether the pivot bends what is replayed besides: the frustum is recentered.
    """

    limits: DisplayLimits
    near: float
    near_limits: tuple[NearLimit, ...]
    largest_unseen_near: float
    stereo_change_arcsec: float | None
    crack_arcmin: float | None
    seen: bool
    bent: bool


def viewer_record(scene: Scene, distance: float, settings: DoubleFrustum) -> ViewerRecord:
    """Return what a display can show to a viewer at a distance, and whether a near offset is seen there.

    All surfaces within the reach count, as if every one were seen.

    Raises
    ------
    InputError
        A surface within the reach lies behind the viewer.
    """
    viewer, display, content = Viewer(distance=distance), Display.of(scene), surface_content(scene)
    require_before_viewer(scene, content, viewer)
    requirement = EyeRequirement(viewer=viewer, display=display, content=content)
    found = requirement.limits_with(settings)
    binds = binding(found)
    change = None if display.millimeters is None else requirement.stereo_change(settings)
    crack, hidden = None, math.inf
    if content.through:
        _, hidden, crack = resolved_crack(viewer, display, settings)
    return ViewerRecord(
        limits=display_limits(scene, viewer),
        near=settings.near,
        near_limits=found,
        largest_unseen_near=math.inf if binds is None or binds.largest_near is None else binds.largest_near,
        stereo_change_arcsec=change,
        crack_arcmin=crack,
        seen=(change or 0.0) > viewer.stereo_acuity_arcsec or (crack or 0.0) > hidden,
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
    largest = record.largest_unseen_near
    unseen = f"not seen up to n = {digits(largest)} {units}" if largest else "seen at every n"
    unseen = "not seen at any n" if math.isinf(largest) else unseen
    lines.append(f"  a near offset n is a gap of 2 n at the plate: {unseen}")
    if record.bent:
        lines.append("  (the shear of the recentered frustum is in it, with pivot aperture)")
    if record.stereo_change_arcsec is None:
        lines.append(f"  (whether two eyes see it is not known: how long is one of the scene's {units}?)")
    word = "seen" if record.seen else "not seen"
    lines.append(f"  n = {digits(record.near)} {units} is {word}")
    return "\n".join([*lines, *_noticed(record)])


def _noticed(record: ViewerRecord) -> list[str]:
    """Say what a near offset does to depth and at the plate, beside what is not noticed of either."""
    allowed = {one.name: one.allowed for one in record.near_limits}
    lines = []
    if record.stereo_change_arcsec is not None:
        lines.append(
            f"    depths change by {digits(record.stereo_change_arcsec)} arc seconds of disparity; up to "
            f"{digits(allowed[STEREO])} are not noticed"
        )
    if record.crack_arcmin is not None:
        lines.append(
            f"    surfaces through the plate have a crack of {digits(record.crack_arcmin)}'; up to "
            f"{digits(allowed[CRACK])}' is not noticed"
        )
    return lines


def _length(value: float, units: str) -> str:
    return "any depth" if math.isinf(value) else f"{digits(value)} {units}"
