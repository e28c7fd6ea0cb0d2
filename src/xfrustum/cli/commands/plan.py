"""`plan`: the settings that keep what is required."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import BELOW_1, COUNT, INDEX, LENGTH, POSITIVE, group, option, several
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping
from xfrustum.tolerances import MAX_DEPTH_WRONG, SAMPLED_HOGELS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from xfrustum.compare.scout import AutoApertures
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate.plate import Aperture

_VIEWER_FIELDS = {
    "acuity": "acuity_arcmin",
    "stereo_acuity": "stereo_acuity_arcsec",
    "ipd": "eyes_apart_mm",
    "pupil": "pupil_mm",
}
"""Fields of a viewer by the options that say them."""


def _eyes(**given: Any) -> dict[str, Any]:
    """Return what options say of a viewer; they are refused without a distance, or beside single hogels."""
    said = {name: value for name, value in given.items() if value is not None}
    if said and "viewer" not in said:
        flag = next(iter(said)).replace("_", "-")
        raise click.UsageError(f"--{flag} describes a viewer: give --viewer too")
    hogels = filter(options.is_given, ("aperture", "apertures", "tolerance_px"))
    if said and (name := next(hogels, None)):
        flag = f"--{name.replace('_', '-')}"
        about = f"{flag} is about hogels, and a viewer sees all of them at once"
        raise click.UsageError(f"{about}: leave out {flag} or --viewer")
    return said


class _Asked(options.Measured):
    scene = options.scene_argument
    aperture = option(INDEX, "Column,row: plan for this aperture alone.  [default: the plate]")
    apertures = option(
        options.or_auto(COUNT), "Plan for so many: middle, corners, then between; auto: the worst."
    )
    sample = option(
        click.IntRange(1), "Random hogels that a plate's plan is measured at.", default=SAMPLED_HOGELS
    )
    seed = options.seed_option
    required = several(
        tolerance_px=options.tolerance_option,
        separation=option(POSITIVE, "Least distance of ordered sheets.  [default: reach/1000]"),
        max_wrong=option(BELOW_1, "Largest share of pixels wrong by depth.", default=MAX_DEPTH_WRONG),
    )
    depth = option(options.member(DepthFormat), "Depth buffer format.  [default: any]")
    mapping = option(options.member(DepthMapping), "Depth mapping.  [default: any]")
    eyes = group(
        _eyes,
        viewer=option(LENGTH, "Distance of a viewer, such as 600mm: plan to what eyes see there."),
        acuity=option(POSITIVE, "Arc minutes that the viewer resolves.  [default: 1]"),
        stereo_acuity=option(POSITIVE, "Arc seconds of disparity that he tells.  [default: 20]"),
        ipd=option(POSITIVE, "Millimeters between his eyes.  [default: 65]"),
        pupil=option(POSITIVE, "Millimeters of his pupils.  [default: 4]"),
    )

    def chosen(self, scene: Scene) -> Sequence[Aperture] | AutoApertures | None:
        """Return the apertures to plan for; None for the whole plate."""
        from xfrustum.reports.planning import spread_apertures

        if isinstance(self.apertures, str):
            return options.auto_apertures(scene, progress=self.progress)
        if self.aperture is None and self.apertures is None:
            return None
        one = options.chosen_aperture(scene, self.aperture)
        chosen = [one] if self.apertures is None else spread_apertures(scene.plate, self.apertures)
        options.look_at(scene, chosen)
        return chosen


@options.command("xfrustum plan asymmetric --apertures 3")
def plan(asked: _Asked) -> None:
    """Find the fewest slabs and the most robust near that keep what is required, all over the plate.

    The plan is made from the worst apertures of the plate, and measured at these and at a random sample.
    With --aperture or --apertures it is made for these alone. With --viewer near may be as large as eyes at
    that distance do not notice, whatever becomes of hogels' pixels.
    """
    if asked.aperture is not None and asked.apertures is not None:
        raise click.UsageError(options.ONE_OR_MANY)
    opened = options.open_scene(asked.scene)
    from xfrustum.compare.planning.plan import depth_buffers
    from xfrustum.compare.planning.views import Requirement
    from xfrustum.compare.sampling import RandomSample
    from xfrustum.compare.scout import AutoApertures
    from xfrustum.raster import require_room
    from xfrustum.reports.planning import make_plan, table

    requirement = Requirement(**asked.required)
    # The plan is measured by drawing it, but only after a search that traces and predicts for long.
    require_room(opened)
    sample = RandomSample(hogels=asked.sample, seed=asked.seed)
    buffers = depth_buffers(asked.depth, asked.mapping)
    if asked.eyes:
        from xfrustum.compare.eye.noticeable import Viewer, scene_length
        from xfrustum.reports.eye.plan_replay import planned_record, planned_table, replayed_plan
        from xfrustum.reports.planning import make_viewer_plan

        said = {_VIEWER_FIELDS[name]: value for name, value in asked.eyes.items() if name != "viewer"}
        viewer = Viewer(distance=scene_length(asked.eyes["viewer"], opened), **said)
        made, seen = make_viewer_plan(
            opened, viewer, requirement, buffers, sample=sample, progress=asked.progress
        )
        options.warn_of(opened)
        record = planned_record(opened, made, seen, progress=asked.progress)
        made = replayed_plan(made, record)
        # The last line is the command that draws so, as in all plans.
        planned = table(made, opened, [opened.plate.middle], seen, record.exceeded)
        asked.tell(
            lambda: {**made.summary(), "viewer": record},
            lambda: f"{planned_table(record, opened.units)}\n\n{planned}",
        )
        return
    chosen = asked.chosen(opened)
    made = make_plan(opened, chosen, requirement, buffers, sample=sample, progress=asked.progress)
    if chosen is None:
        # The middle may see nothing of what other hogels do. The plan's scout refuses what no hogel sees.
        options.warn_of(opened)
    drawn = chosen.apertures if isinstance(chosen, AutoApertures) else (chosen or [opened.plate.middle])
    asked.tell(made.summary, lambda: table(made, opened, drawn, requirement))
