"""`plan`, `cost`: settings that keep a requirement, and error against time of all settings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import group, option, or_auto, several
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping
from xfrustum.tolerances import MAX_DEPTH_WRONG, SAMPLED_HOGELS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from xfrustum.compare.scout import AutoApertures
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate.plate import Aperture


def _eyes(**given: Any) -> dict[str, Any]:
    """Return what options say of a viewer; they are refused without a distance, or beside single hogels."""
    said = options.present(**given)
    if said and "viewer" not in said:
        raise click.UsageError(
            f"{options.flag_of(next(iter(said)))} describes a viewer: give --viewer too"
        )
    for own in map(
        options.flag_of, filter(options.is_given, ("aperture", "apertures", "tolerance_px"))
    ):
        if said:
            about = f"{own} is about hogels, and a viewer sees all of them at once"
            raise click.UsageError(f"{about}: leave out {own} or --viewer")
    return said


class _Planned(options.Measured):
    scene = options.scene_argument
    depth = option(options.one_of(DepthFormat), "Depth buffer format.  [default: any]")
    mapping = option(options.one_of(DepthMapping), "Depth mapping.  [default: any]")
    sample = option(
        options.COUNT_FROM_1,
        "Random hogels that a plate's plan is measured at.",
        default=SAMPLED_HOGELS,
    )
    seed = options.seed_option

    def how(self) -> dict[str, Any]:
        """Return what may be chosen from, and how the plan is measured."""
        from xfrustum.compare.planning.plan import depth_buffers
        from xfrustum.compare.sampling import RandomSample

        sample = RandomSample(hogels=self.sample, seed=self.seed)
        choices = depth_buffers(self.depth, self.mapping)
        return {"choices": choices, "sample": sample, "progress": self.progress}


class _Plan(_Planned):
    aperture = option(
        options.INDEX, "Column,row: plan for this aperture alone.  [default: the plate]"
    )
    apertures = option(
        or_auto(options.COUNT), "Plan for so many: middle, corners, then between; auto: the worst."
    )
    required = several(
        tolerance_px=options.tolerance_option,
        separation=option(
            options.POSITIVE, "Least distance of ordered sheets.  [default: reach/1000]"
        ),
        max_wrong=option(
            options.BELOW_1, "Largest share of pixels wrong by depth.", default=MAX_DEPTH_WRONG
        ),
        device=options.device_option,
    )
    eyes = group(
        _eyes,
        viewer=option(
            options.LENGTH, "Distance of a viewer, such as 600mm: plan to what eyes see there."
        ),
        acuity_arcmin=option(
            options.POSITIVE, "Arc minutes that the viewer resolves.  [default: 1]", "--acuity"
        ),
        stereo_acuity_arcsec=option(
            options.POSITIVE,
            "Arc seconds of disparity that he tells.  [default: 20]",
            "--stereo-acuity",
        ),
        eyes_apart_mm=option(
            options.POSITIVE, "Millimeters between his eyes.  [default: 65]", "--ipd"
        ),
        pupil_mm=option(options.POSITIVE, "Millimeters of his pupils.  [default: 4]", "--pupil"),
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
def plan(asked: _Plan) -> None:
    """Find the fewest slabs and the most robust near that keep what is required, all over the plate.

    The plan is made from the worst apertures of the plate, and measured at these and at a random
    sample. With --aperture or --apertures it is made for these alone. With --viewer near may be as
    large as eyes at that distance do not notice, whatever becomes of hogels' pixels.
    """
    if asked.aperture is not None and asked.apertures is not None:
        raise click.UsageError(options.ONE_OR_MANY)
    opened = options.open_scene(asked.scene)
    from xfrustum.compare.planning.views import Requirement
    from xfrustum.compare.scout import AutoApertures
    from xfrustum.raster import require_room
    from xfrustum.reports.planning import make_plan, table

    requirement = Requirement(**asked.required)
    # The plan is measured by drawing it, but only after a search that traces and predicts for long.
    require_room(opened)
    if asked.eyes:
        from xfrustum.compare.eye.noticeable import Viewer, scene_length
        from xfrustum.reports.planning import make_viewer_plan, planned_table, scouted_plate

        distance = scene_length(asked.eyes.pop("viewer"), opened)
        viewer, scouted = (
            Viewer(distance=distance, **asked.eyes),
            scouted_plate(opened, asked.progress),
        )
        options.warn_of(opened)
        seen = make_viewer_plan(scouted, viewer, requirement, **asked.how())
        # The last line is the command that draws so, as in all plans.
        planned = table(
            seen.plan, opened, [opened.plate.middle], seen.requirement, seen.record.exceeded
        )
        asked.tell(seen.summary, lambda: f"{planned_table(seen.record, opened.units)}\n\n{planned}")
        return
    chosen = asked.chosen(opened)
    made = make_plan(opened, chosen, requirement, **asked.how())
    if chosen is None:
        # The middle may see nothing of what other hogels do. The plan's scout refuses what no hogel
        # sees.
        options.warn_of(opened)
    drawn = (
        chosen.apertures if isinstance(chosen, AutoApertures) else (chosen or [opened.plate.middle])
    )
    asked.tell(made.summary, lambda: table(made, opened, drawn, requirement))


class _Recommend(_Planned):
    viewer = option(options.LENGTH, "Distance of who looks at the display, such as 600mm.")
    display = option(
        options.LENGTH, "Pitch of the display, such as 0.5mm.  [default: that of the scene]"
    )
    tolerance_px = option(
        options.POSITIVE, "Displacement allowed.  [default: 0.5; with --viewer, any]"
    )
    out = option(options.FOLDER, "Folder for the page and recommend.json.")


@options.command("xfrustum recommend asymmetric --viewer 400mm --out recommend")
def recommend(asked: _Recommend) -> None:
    """Say how to draw a plate, and what decides it: the depth buffer, the pixels or the eye.

    Joins what `plan` finds for hogels' pixels and for a viewer with what depth buffers ask for,
    says which of them binds, whether to split, and what a coarser choice costs, and draws the map
    of the largest near that each hogel allows.
    """
    opened = options.open_scene(asked.scene)
    from xfrustum.compare.eye.noticeable import Viewer, scene_length
    from xfrustum.reports import recommend as recommending

    options.check_out(asked.out, recommending.FILES)
    if asked.display is not None:
        opened = recommending.for_display(opened, scene_length(asked.display, opened))
    viewer = None if asked.viewer is None else Viewer(distance=scene_length(asked.viewer, opened))
    found = recommending.recommend(opened, viewer, asked.tolerance_px, **asked.how())
    options.warn_of(opened)
    if asked.out is not None:
        recommending.write_recommendation(found, asked.out)
    asked.tell(found.summary, lambda: recommending.table(found))


class _Cost(options.OneOrAuto):
    tolerance_px = options.tolerance_option
    repeat = option(options.COUNT_FROM_1, "Timed pictures of each, after a warm-up.", default=5)
    out = option(options.FOLDER, "Folder for the page and cost.json.")


@options.command("xfrustum cost asymmetric --repeat 1 --out cost")
def cost(asked: _Cost) -> None:
    """Measure error against time of every configuration; name the cheapest within a tolerance.

    The answer is given for the tolerance and for a fifth of it. With --apertures auto, pictures are
    judged at several apertures, the worst of which counts.
    """
    opened = options.open_scene(asked.scene)
    from xfrustum.reports import cost as costs

    options.check_out(asked.out, costs.FILES)
    chosen = asked.chosen(opened)
    measured = costs.cost(
        opened, chosen, asked.tolerance_px, repeat=asked.repeat, progress=asked.progress
    )
    if asked.out is not None:
        costs.write_cost(measured, asked.out)
    asked.tell(measured.summary, measured.table)
