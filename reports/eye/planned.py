"""What a viewer notices of a plan: what its requirement promises, and what a replay shows to two eyes."""

from __future__ import annotations

from dataclasses import dataclass

from xfrustum.compare.eye.limits import Viewer
from xfrustum.compare.eye.noticeable import blur_arcmin
from xfrustum.compare.planning.plan import Plan
from xfrustum.compare.planning.viewer import CRACK, EyeRequirement, NearLimit
from xfrustum.reports.common.formatting import digits, percent
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.eye.replayed import Replayed, ReplayWorkbench
from xfrustum.scenes.model.scene import Scene


@dataclass(frozen=True, kw_only=True)
class PlannedRecord:
    """What `plan --viewer` adds: the key `viewer` of the JSON object.

    Attributes
    ----------
    viewer
        The viewer.
    pitch_arcmin, pixel_arcmin, diffraction_arcmin
        Blurs of the display: of pitch, and of pixels and diffraction at the farthest surface.
    rays_per_pupil
        Pixels of a hogel that a pupil catches along an axis.
    limits
        What the viewer may notice of a near without cuts, and how large near may be for each.
    binding
        Name of the limit that leaves the smallest near; None where no near is noticed.
    stereo_change_arcsec, crack_arcmin
        Predicted of the plan: change of disparity, and width of the crack in a surface that runs through the
        plate. None without a plan, and without such a surface.
    separation
        Distance of sheets that must be ordered, scene units.
    separation_limited_by
        What decides it; None where it was asked for.
    measured
        What a replay of the plan shows to two eyes; None without a plan.
    """

    viewer: Viewer
    pitch_arcmin: float
    pixel_arcmin: float
    diffraction_arcmin: float
    rays_per_pupil: float | None
    limits: tuple[NearLimit, ...]
    binding: str | None
    stereo_change_arcsec: float | None
    crack_arcmin: float | None
    separation: float | None
    separation_limited_by: str | None
    measured: Replayed | None


def planned_record(
    scene: Scene, made: Plan, requirement: EyeRequirement, *, progress: bool = False
) -> PlannedRecord:
    """Return what a viewer notices of a plan that was made for his eyes, measured by a replay."""
    settings, viewer, display = made.settings, requirement.viewer, requirement.display
    farthest = max(requirement.content.farthest, key=abs, default=0.0)
    blurs, binding, limit = (
        blur_arcmin(farthest, viewer, display),
        requirement.binding,
        requirement.separation_limit,
    )
    rays = None
    if display.millimeters is not None:
        rays = viewer.pupil_mm / display.millimeters / (viewer.distance * display.pixel)
    measured = None
    if settings is not None:
        with progress_bar(None, "eyes", "hogel", shown=progress) as bar:
            measured = ReplayWorkbench(scene, viewer).measure(settings, bar.update)
    return PlannedRecord(
        viewer=viewer,
        pitch_arcmin=blurs["pitch"],
        pixel_arcmin=blurs["pixel"],
        diffraction_arcmin=blurs["diffraction"],
        rays_per_pupil=rays,
        limits=requirement.limits,
        binding=None if binding is None else binding.name,
        stereo_change_arcsec=None if settings is None else requirement.stereo_change(settings),
        crack_arcmin=None if settings is None else requirement.crack_width(settings),
        separation=requirement.separation,
        separation_limited_by=None if limit is None else limit[0],
        measured=measured,
    )


def planned_table(record: PlannedRecord, units: str) -> str:
    """Return the same as lines of text."""
    viewer = record.viewer
    lines = [
        f"for a viewer at {digits(viewer.distance)} {units}, eyes {digits(viewer.eyes_apart_mm)} mm apart:"
    ]
    for limit in record.limits:
        largest = "any near" if limit.largest_near is None else f"near up to {limit.largest_near:g} {units}"
        if limit.name == CRACK:
            what = f"the crack at the plate, {digits(limit.allowed)} arc minutes ({limit.hidden_by})"
        else:
            what = f"change of depth, {digits(limit.allowed)} arc seconds of disparity"
        binds = "  <- binds" if limit.name == record.binding else ""
        lines.append(f"  {what:<66}  {largest}{binds}")
    found = record.measured
    if found is None:
        return "\n".join(lines)
    if record.stereo_change_arcsec is not None and found.disparity_change_arcsec is not None:
        lines.append(
            f"  two eyes see depths off by {digits(record.stereo_change_arcsec)} arc seconds of disparity; "
            f"replayed, {digits(found.disparity_change_arcsec)} ({found.matched:,} points)"
        )
    lines.append(
        f"  replayed, {percent(found.depth_wrong)} of what both eyes are shown is wrong by depth "
        f"({found.hogels:,} hogels)"
    )
    return "\n".join(lines)
