"""The command that plans the settings that keep what is required."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.numbers import Length, Positive
from xfrustum.cli.options import Command
from xfrustum.tolerances import MAX_DEPTH_WRONG, SAMPLED_HOGELS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from xfrustum.compare.eye.limits import Viewer
    from xfrustum.compare.planning.search import DepthBuffer
    from xfrustum.compare.planning.views import Requirement
    from xfrustum.compare.scouting.automatic import AutoApertures
    from xfrustum.compare.scouting.sample import RandomSample
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping
    from xfrustum.scenes.plate.plate import Aperture


_VIEWER_OPTIONS = (
    click.option(
        "--viewer",
        type=Length(),
        help="Distance of a viewer, such as 600mm: plan to what eyes see there, not to pixels.",
    ),
    click.option("--acuity", type=Positive(), help="Arc minutes that the viewer resolves.  [default: 1]"),
    click.option(
        "--stereo-acuity", type=Positive(), help="Arc seconds of disparity that he tells.  [default: 20]"
    ),
    click.option("--ipd", type=Positive(), help="Millimeters between his eyes.  [default: 65]"),
    click.option("--pupil", type=Positive(), help="Millimeters of his pupils.  [default: 4]"),
)


@dataclass(frozen=True, kw_only=True)
class _Eyes:
    """Options that describe a viewer."""

    viewer: tuple[float, str | None] | None
    acuity: float | None
    stereo_acuity: float | None
    ipd: float | None
    pupil: float | None

    def check(self, *others: str) -> None:
        """Raise UsageError where a viewer is described without a distance, or asked about single hogels."""
        given = [name for name, value in vars(self).items() if value is not None]
        if given and self.viewer is None:
            raise click.UsageError(f"--{given[0].replace('_', '-')} describes a viewer: give --viewer too")
        for name in others if given else ():
            if options.is_given(name):
                option = name.replace("_", "-")
                raise click.UsageError(
                    f"--{option} is about hogels, and a viewer sees all of them at once: leave out "
                    f"--{option} or --viewer"
                )

    def viewer_of(self, scene: Scene) -> Viewer | None:
        """Return the viewer; None where none is asked about."""
        from xfrustum.compare.eye.limits import Viewer, scene_length

        if self.viewer is None:
            return None
        given = {
            "acuity_arcmin": self.acuity,
            "stereo_acuity_arcsec": self.stereo_acuity,
            "eyes_apart_mm": self.ipd,
            "pupil_mm": self.pupil,
        }
        known = {name: value for name, value in given.items() if value is not None}
        return Viewer(distance=scene_length(self.viewer, scene), **known)


def _viewer_options(command: Command) -> Command:
    """Add the options of a viewer; the command receives them as one `eyes`."""

    @functools.wraps(command)
    def with_eyes(**others: Any) -> Any:
        given = {name: others.pop(name) for name in ("viewer", "acuity", "stereo_acuity", "ipd", "pupil")}
        return command(eyes=_Eyes(**given), **others)

    for option in reversed(_VIEWER_OPTIONS):
        with_eyes = option(with_eyes)
    return with_eyes  # type: ignore[return-value]  # wraps() keeps the name, not the type


@click.command()
@options.scene_argument
@click.option(
    "--aperture",
    type=options.Index(),
    help="Column,row on the plate: plan for this aperture alone.  [default: the whole plate]",
)
@click.option(
    "--apertures",
    type=options.CountOrAuto(),
    help="Instead of the plate: the middle, the corners, then between; auto: the middle and the worst.",
)
@click.option(
    "--sample",
    type=click.IntRange(1),
    default=SAMPLED_HOGELS,
    show_default=True,
    help="Hogels drawn at random to measure the plan at, for the whole plate.",
)
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Start of the random numbers."
)
@options.tolerance_option
@click.option(
    "--separation",
    type=Positive(),
    help="Distance of two sheets that must be ordered.  [default: reach/1000]",
)
@click.option(
    "--max-wrong",
    type=Positive(below=1),
    default=MAX_DEPTH_WRONG,
    show_default=True,
    help="Largest share of pixels that are wrong by depth.",
)
@click.option("--depth", type=options.Name("DepthFormat"), help="Depth buffer format.  [default: any]")
@click.option("--mapping", type=options.Name("DepthMapping"), help="Depth mapping.  [default: any]")
@_viewer_options
@options.quiet_option
@options.json_option
def plan(
    *,
    scene: str,
    aperture: tuple[int, int] | None,
    apertures: int | str | None,
    sample: int,
    seed: int,
    tolerance_px: float,
    separation: float | None,
    max_wrong: float,
    depth: DepthFormat | None,
    mapping: DepthMapping | None,
    eyes: _Eyes,
    quiet: bool,
    as_json: bool,
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
    eyes.check("aperture", "apertures", "tolerance_px")
    opened = options.open_scene(scene)
    from xfrustum.compare.planning.plan import depth_buffers
    from xfrustum.compare.planning.views import Requirement
    from xfrustum.compare.scouting.automatic import AutoApertures
    from xfrustum.compare.scouting.sample import RandomSample
    from xfrustum.raster import require_room
    from xfrustum.reports.commands.planning import make_plan, table

    requirement = Requirement(tolerance_px=tolerance_px, separation=separation, max_wrong=max_wrong)
    # The plan is measured by drawing it, but only after a search that traces and predicts for long.
    require_room(opened)
    random, buffers = RandomSample(hogels=sample, seed=seed), depth_buffers(depth, mapping)
    viewer = eyes.viewer_of(opened)
    if viewer is not None:
        _plan_for_eyes(opened, viewer, requirement, buffers, random, quiet=quiet, as_json=as_json)
        return
    chosen = _chosen(opened, aperture, apertures, quiet=quiet)
    made = make_plan(
        opened,
        chosen,
        requirement,
        buffers,
        sample=random,
        progress=not quiet,
    )
    if chosen is None:
        # The middle may see nothing of what other hogels do. The plan's scout refuses what no hogel sees.
        options.warn_of(opened)
    drawn = chosen.apertures if isinstance(chosen, AutoApertures) else (chosen or [opened.plate.middle])
    options.tell(as_json, made.summary, lambda: table(made, opened, drawn, requirement))


def _chosen(
    scene: Scene, aperture: tuple[int, int] | None, apertures: int | str | None, *, quiet: bool
) -> Sequence[Aperture] | AutoApertures | None:
    """Return the apertures to plan for; None for the whole plate."""
    from xfrustum.reports.commands.planning import spread_apertures

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
    from xfrustum.reports.commands.planning import make_viewer_plan, table
    from xfrustum.reports.common.json_ready import json_object
    from xfrustum.reports.eye.planned import planned_record, planned_table, replayed_plan

    made, seen = make_viewer_plan(scene, viewer, requirement, buffers, sample=sample, progress=not quiet)
    options.warn_of(scene)
    record = planned_record(scene, made, seen, progress=not quiet)
    made = replayed_plan(made, record)

    def text() -> str:
        # The last line is the command that draws so, as in all plans.
        planned = table(made, scene, [scene.plate.middle], seen, record.exceeded)
        return f"{planned_table(record, scene.units)}\n\n{planned}"

    options.tell(as_json, lambda: {**made.summary(), "viewer": json_object(record)}, text)
