"""`plan`: the settings that keep what is required."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import option
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping
from xfrustum.tolerances import MAX_DEPTH_WRONG, SAMPLED_HOGELS

if TYPE_CHECKING:
    from xfrustum.compare.eye.noticeable import Viewer
    from xfrustum.compare.planning.search import DepthBuffer
    from xfrustum.compare.planning.views import Requirement
    from xfrustum.compare.sampling import RandomSample
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
        option = next(iter(said)).replace("_", "-")
        raise click.UsageError(f"--{option} describes a viewer: give --viewer too")
    for name in ("aperture", "apertures", "tolerance_px") if said else ():
        if options.is_given(name):
            option = name.replace("_", "-")
            raise click.UsageError(
                f"--{option} is about hogels, and a viewer sees all of them at once: leave out "
                f"--{option} or --viewer"
            )
    return said


_viewer_options = options.gathered(
    "eyes",
    _eyes,
    option("--viewer", options.LENGTH, "Distance of a viewer, such as 600mm: plan to what eyes see there."),
    option("--acuity", options.POSITIVE, "Arc minutes that the viewer resolves.  [default: 1]"),
    option("--stereo-acuity", options.POSITIVE, "Arc seconds of disparity that he tells.  [default: 20]"),
    option("--ipd", options.POSITIVE, "Millimeters between his eyes.  [default: 65]"),
    option("--pupil", options.POSITIVE, "Millimeters of his pupils.  [default: 4]"),
)


@options.command("xfrustum plan asymmetric --apertures 3")
@options.scene_argument
@option("--aperture", options.INDEX, "Column,row: plan for this aperture alone.  [default: the plate]")
@option(
    "--apertures",
    options.or_auto(options.COUNT),
    "Plan for so many: middle, corners, then between; auto: the worst.",
)
@option(
    "--sample", click.IntRange(1), "Random hogels that a plate's plan is measured at.", default=SAMPLED_HOGELS
)
@options.seed_option
@options.tolerance_option
@option("--separation", options.POSITIVE, "Least distance of ordered sheets.  [default: reach/1000]")
@option("--max-wrong", options.BELOW_1, "Largest share of pixels wrong by depth.", default=MAX_DEPTH_WRONG)
@option("--depth", options.member(DepthFormat), "Depth buffer format.  [default: any]")
@option("--mapping", options.member(DepthMapping), "Depth mapping.  [default: any]")
@_viewer_options
@options.quiet_and_json
def plan(
    *,
    scene: str,
    aperture: tuple[int, int] | None,
    apertures: int | str | None,
    sample: int,
    seed: int,
    depth: DepthFormat | None,
    mapping: DepthMapping | None,
    eyes: dict[str, Any],
    quiet: bool,
    as_json: bool,
    **required: float,
) -> None:
    """Find the fewest slabs and the most robust near that keep what is required, all over the plate.

    The plan is made from the worst apertures of the plate, and measured at these and at a random sample.
    With --aperture or --apertures it is made for these alone. With --viewer near may be as large as eyes at
    that distance do not notice, whatever becomes of hogels' pixels.
    """
    if aperture is not None and apertures is not None:
        raise click.UsageError(
            "--aperture names one aperture and --apertures asks for many: give one of them"
        )
    opened = options.open_scene(scene)
    from xfrustum.compare.eye.noticeable import Viewer, scene_length
    from xfrustum.compare.planning.plan import depth_buffers
    from xfrustum.compare.planning.views import Requirement
    from xfrustum.compare.sampling import RandomSample
    from xfrustum.compare.scout import AutoApertures
    from xfrustum.raster import require_room
    from xfrustum.reports.planning import make_plan, table

    requirement = Requirement(**required)
    # The plan is measured by drawing it, but only after a search that traces and predicts for long.
    require_room(opened)
    random, buffers = RandomSample(hogels=sample, seed=seed), depth_buffers(depth, mapping)
    if eyes:
        distance = scene_length(eyes.pop("viewer"), opened)
        viewer = Viewer(distance=distance, **{_VIEWER_FIELDS[name]: value for name, value in eyes.items()})
        _plan_for_eyes(opened, viewer, requirement, buffers, random, quiet=quiet, as_json=as_json)
        return
    chosen = _chosen(opened, aperture, apertures, quiet=quiet)
    made = make_plan(opened, chosen, requirement, buffers, sample=random, progress=not quiet)
    if chosen is None:
        # The middle may see nothing of what other hogels do. The plan's scout refuses what no hogel sees.
        options.warn_of(opened)
    drawn = chosen.apertures if isinstance(chosen, AutoApertures) else (chosen or [opened.plate.middle])
    options.tell(as_json, made.summary, lambda: table(made, opened, drawn, requirement))


def _chosen(
    scene: Scene, aperture: tuple[int, int] | None, apertures: int | str | None, *, quiet: bool
) -> Sequence[Aperture] | AutoApertures | None:
    """Return the apertures to plan for; None for the whole plate."""
    from xfrustum.reports.planning import spread_apertures

    if isinstance(apertures, str):
        return options.auto_apertures(scene, quiet=quiet)
    if aperture is None and apertures is None:
        return None
    asked = options.chosen_aperture(scene, aperture)
    chosen = [asked] if apertures is None else spread_apertures(scene.plate, apertures)
    options.look_at(scene, chosen)
    return chosen


def _plan_for_eyes(
    scene: Scene,
    viewer: Viewer,
    requirement: Requirement,
    buffers: Sequence[DepthBuffer],
    sample: RandomSample,
    *,
    quiet: bool,
    as_json: bool,
) -> None:
    from xfrustum.reports.eye.plan_replay import planned_record, planned_table, replayed_plan
    from xfrustum.reports.planning import make_viewer_plan, table

    made, seen = make_viewer_plan(scene, viewer, requirement, buffers, sample=sample, progress=not quiet)
    options.warn_of(scene)
    record = planned_record(scene, made, seen, progress=not quiet)
    made = replayed_plan(made, record)

    def text() -> str:
        # The last line is the command that draws so, as in all plans.
        planned = table(made, scene, [scene.plate.middle], seen, record.exceeded)
        return f"{planned_table(record, scene.units)}\n\n{planned}"

    options.tell(as_json, lambda: {**made.summary(), "viewer": record}, text)
