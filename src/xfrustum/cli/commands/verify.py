"""`verify`: foreign renderers are diagnosed and judged."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.commands.checks import LIMIT_EXCEEDED
from xfrustum.cli.commands.convert import layout_option
from xfrustum.cli.numbers import Positive
from xfrustum.cli.tev import check_tev, send_to_tev, tev_option
from xfrustum.cli.where import Where, engine_options
from xfrustum.terminal import say
from xfrustum.tolerances import TOLERANCE_PX

if TYPE_CHECKING:
    from xfrustum.reports.verification.baseline import Baseline, Stated
    from xfrustum.reports.verification.verdict import Verification
    from xfrustum.scenes.model.scene import Scene


class Share(click.ParamType[float]):
    """A share such as 1% or 0.01."""

    name = "SHARE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the share as a number from 0 to 1."""
        text = str(value).strip()
        try:
            share = float(text[:-1]) / 100 if text.endswith("%") else float(text)
        except ValueError:
            share = -1.0
        if not 0 <= share <= 1:
            self.fail(f"{value!r} is not a share such as 1% or 0.01", param, ctx)
        return share


class Conventions(click.ParamType[tuple[str, ...]]):
    """Names of conventions separated by commas."""

    name = "NAME,NAME,.."

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """Return the names."""
        from xfrustum.compare.renderer_model.conventions import ACCEPTABLE

        names = tuple(part.strip() for part in str(value).split(","))
        if names == ("all",):
            return ACCEPTABLE
        for name in names:
            if name not in ACCEPTABLE:
                self.fail(f"{name!r} is not one of {', '.join(ACCEPTABLE)}, all", param, ctx)
        return names


class LimitInPixels(click.ParamType["float | None"]):
    """A number of pixels, or none for no limit."""

    name = "PX|none"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | None:
        """Return the limit, None where there is none."""
        if str(value).strip() == "none":
            return None
        try:
            return float(value)
        except ValueError:
            self.fail(f"{value!r} is neither a number of pixels nor none", param, ctx)


LIMITS_NOT_STATED = (
    "exit status 0: nothing is worse than accepted, and limits that hogels exceed were not stated"
)
"""Line for the terminal where hogels exceed limits that are not the user's, as they did when accepted."""


class BaselineTolerance(click.ParamType["Stated"]):
    """A share such as 5%, or amounts such as wrong_surfaces=3,displacement_p99_px=0.01."""

    name = "SHARE|NAME=AMOUNT,.."

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Stated:
        """Return the tolerances."""
        from xfrustum.reports.verification.baseline import Stated
        from xfrustum.scenes.errors import InputError

        try:
            return Stated.of(str(value))
        except InputError as error:
            self.fail(str(error), param, ctx)


_BASELINE_OPTIONS = (
    click.option(
        "--baseline",
        type=click.Path(path_type=Path),
        help="Folder of accepted measures: fail on what got worse.",
    ),
    click.option("--approve", is_flag=True, help="Accept the present measures in --baseline."),
    click.option(
        "--repeated",
        is_flag=True,
        help="With --approve: the renderer is unchanged, so that differences are its noise.",
    ),
    click.option(
        "--baseline-tolerance",
        type=BaselineTolerance(),
        help="What counts as noise, such as 5% or wrong_surfaces=3.  [default: the spread of accepted runs]",
    ),
    click.option("--renderer", help="Name of the renderer in --baseline.  [default: SOURCE or the command]"),
    click.option("--device", help="Name of its device in --baseline.  [default: this machine's processor]"),
)


@dataclass(frozen=True, kw_only=True)
class BaselineAsked:
    """What the options of a baseline ask for; see `reports.verification.baseline.BaselineOptions`."""

    folder: Path
    approve: bool
    repeated: bool
    tolerance: Stated | None
    renderer: str | None
    device: str | None


def baseline_options(command: options.Command) -> options.Command:
    """Add the options of a baseline; the command receives one `baseline`, None where there is none."""

    @functools.wraps(command)
    def with_one(
        *,
        baseline: Path | None,
        approve: bool,
        repeated: bool,
        baseline_tolerance: Stated | None,
        renderer: str | None,
        device: str | None,
        **rest: Any,
    ) -> Any:
        if baseline is None:
            for name in ("approve", "repeated", "baseline_tolerance", "renderer", "device"):
                if options.is_given(name):
                    raise click.UsageError(f"--{name.replace('_', '-')} is about --baseline DIR: give it too")
            return command(baseline=None, **rest)
        if repeated and not approve:
            raise click.UsageError("--repeated says of what is accepted that it is noise: give --approve too")
        asked = BaselineAsked(
            folder=baseline,
            approve=approve,
            repeated=repeated,
            tolerance=baseline_tolerance,
            renderer=renderer,
            device=device,
        )
        return command(baseline=asked, **rest)

    wrapped: options.Command = with_one  # type: ignore[assignment]  # wraps() keeps the name, not the type
    for option in reversed(_BASELINE_OPTIONS):
        wrapped = option(wrapped)
    return wrapped


def _held(
    found: Verification,
    asked: BaselineAsked,
    near: float | None,
    accept: tuple[str, ...],
    encoding: str | None,
) -> Baseline:
    """Hold a verification to a baseline, and append the summary that GitHub shows."""
    from xfrustum.reports.verification.baseline import BaselineOptions, append_step_summary
    from xfrustum.reports.verification.baseline import baseline as held_to

    chosen = BaselineOptions(
        renderer=asked.renderer,
        device=asked.device,
        near=near,
        accept=accept,
        encoding=encoding,
        tolerance=asked.tolerance,
        approve=asked.approve,
        repeated=asked.repeated,
    )
    held = held_to(found, asked.folder, chosen)
    problem = append_step_summary(held)
    if problem is not None:
        say(f"note: {problem}")
    return held


def _summary(found: Verification, held: Baseline | None) -> dict[str, Any]:
    """Return the JSON object, with the answer of the baseline where there is one."""
    return found.summary() | ({} if held is None else {"baseline": held.summary()})


def _text(found: Verification, held: Baseline | None) -> str:
    """Return the lines for the terminal, with those of the baseline where there is one."""
    from xfrustum.reports.verification.files import table

    if held is None:
        return table(found)
    from xfrustum.reports.verification.baseline import lines

    decided = "" if found.passed or _status(found, held) else f"\n{LIMITS_NOT_STATED}"
    return f"{table(found)}\n{lines(held)}{decided}"


def _status(found: Verification, held: Baseline | None) -> int:
    """Return the exit status: where measures are accepted, limits count only if they were stated."""
    limited = any(options.is_given(name) for name in ("max_wrong", "max_displacement_px", "max_color"))
    if held is None or limited or not (held.compared or held.approved):
        passed = found.passed and (held is None or held.passed)
    else:
        passed = held.passed
    return 0 if passed else LIMIT_EXCEEDED


@click.command()
@options.scene_argument
@click.argument("source", required=False)
@click.option(
    "--command", help="In place of SOURCE, run for each aperture: 'my-renderer --x {x} --y {y} --out {out}'."
)
@click.option(
    "--encoding",
    type=click.Choice(["rgb", "srgb", "triangle-id", "object-id"]),
    help="What pixels of pictures hold; not for OpenEXR.  [default: rgb; with --command, OpenEXR]",
)
@layout_option("--layout", "Layout of SOURCE, a folder or a picture.  [default: what it looks like]")
@click.option("--apertures", type=options.Indices(), help="Column,row of each.  [default: the whole plate]")
@click.option("--near", type=float, help="Near offset that the renderer is known to have.  [default: 0]")
@click.option(
    "--accept",
    type=Conventions(),
    help="Conventions that are no faults: orientation, order, shift, fov, pitch, near, encoding; or all.",
)
@click.option(
    "--compare",
    type=click.Choice(["color", "geometry"]),
    default="color",
    show_default=True,
    help="What plain pictures are judged by; geometry is coverage and outlines, in any shading.",
)
@click.option(
    "--max-wrong",
    type=Share(),
    default="1%",
    show_default=True,
    help="Limit of wrong surfaces, as a share of the pixels of a hogel that show something; for plain "
    "pictures of wrong colors or outlines.",
)
@click.option(
    "--max-displacement-px",
    type=LimitInPixels(),
    default=str(TOLERANCE_PX),
    show_default=True,
    help="Limit of how far 99 of 100 surface points or outlines are off; an unknown displacement exceeds "
    "every limit but none.",
)
@click.option(
    "--max-color",
    type=float,
    help="Difference of linear radiance that makes a color wrong.  [default: 0.009, rounding to 8 bits]",
)
@click.option(
    "--timeout",
    "timeout_s",
    type=Positive(),
    default=60.0,
    show_default=True,
    help="Seconds that one run may take.",
)
@engine_options("this process", draws=False)
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder for index.html, inspect.html, verification.json."
)
@click.option("--junit", type=click.Path(path_type=Path), help="JUnit XML file for continuous integration.")
@baseline_options
@tev_option
@options.quiet_option
@options.json_option
def verify(
    *,
    scene: str,
    near: float | None,
    accept: tuple[str, ...] | None,
    where: Where,
    out: Path | None,
    junit: Path | None,
    baseline: BaselineAsked | None,
    tev: str | None,
    quiet: bool,
    as_json: bool,
    **asked: Any,
) -> int:
    """Judge the hogel images of any renderer, and say what is wrong with it.

    SOURCE is a pattern of files, {i} the column and {j} the row: 'DIR/hogel_{i}x{j}.png'; or a folder or a
    picture in one of the layouts (docs/layouts.md). Exit status 1 if any hogel is missing or exceeds a limit;
    with --baseline, once measures are accepted, if any got worse or a stated limit is exceeded.
    """
    if tev is not None and out is None:
        raise click.UsageError("--tev sends the images of inspect.html: give --out too")
    opened = options.open_scene(scene)
    check_tev(tev)
    from xfrustum.reports.verification.files import INSPECTION, write_junit, write_verification
    from xfrustum.reports.verification.verification import verify as verified

    _check_places(out, junit, baseline)
    accepted = accept or ()
    # What is stated although it is the default judges the same.
    encoding = None if asked["encoding"] == "rgb" and asked["command"] is None else asked["encoding"]
    if where.asked:
        on_engine = _verified_on(
            opened, where, out, near=near, accept=accepted, tev=tev, progress=not quiet, **asked
        )
        if on_engine is None:
            say("note: this part is judged; the last one to be finished writes the verification")
            return 0
        found = on_engine
    else:
        channels = out is not None
        found = verified(opened, near=near, accept=accepted, channels=channels, progress=not quiet, **asked)
    options.warn_of(opened)
    if asked["encoding"] in ("triangle-id", "object-id") and found.judged.startswith("colors"):
        say(f"note: files without numbers (OpenEXR without id.*): --encoding {asked['encoding']} is not used")
    if out is not None:
        write_verification(found, out)
    if junit is not None:
        write_junit(found, junit)
    held = None if baseline is None else _held(found, baseline, near, accepted, encoding)
    options.tell(as_json, lambda: _summary(found, held), lambda: _text(found, held))
    if out is not None and found.inspected:
        send_to_tev(tev, out / INSPECTION, opened.name)
    return _status(found, held)


def _check_places(out: Path | None, junit: Path | None, baseline: BaselineAsked | None) -> None:
    """Refuse places that cannot be written, before anything is judged."""
    from xfrustum.reports.common.outputs import check_writable_file, check_writable_folder
    from xfrustum.reports.verification.files import FILES

    if junit is not None:
        check_writable_file(junit, "--junit")
    if out is not None:
        check_writable_folder(out, FILES)
    if baseline is not None:
        from xfrustum.reports.verification.baseline import accepted_runs, check_folder

        check_folder(baseline.folder)
        accepted_runs(baseline.folder)


def _verified_on(
    scene: Scene,
    where: Where,
    out: Path | None,
    *,
    layout: str | None,
    tev: str | None,
    max_wrong: float,
    max_displacement_px: float | None,
    compare: str,
    max_color: float | None,
    apertures: Sequence[tuple[int, int]] | None,
    progress: bool,
    **renderer: Any,
) -> Verification | None:
    """Judge where the options say; None where other parts are not finished yet."""
    from xfrustum.reports.verification.verification import limits_of
    from xfrustum.reports.verification.workers import ForeignRenderer, verify_on
    from xfrustum.scenes.files.foreign_images import Encoding

    for option, value in (("--layout", layout), ("--tev", tev)):
        if value is not None:
            raise click.UsageError(f"{option} is for this process: leave out --workers and the like")
    encoding = renderer.pop("encoding")
    return verify_on(
        where.engine(),
        scene,
        ForeignRenderer(encoding=None if encoding is None else Encoding(encoding), **renderer),
        limits_of(max_wrong, max_displacement_px, compare, max_color),
        apertures=apertures,
        out=out,
        told=lambda line: say(f"note: {line}"),
        progress=progress,
    )
