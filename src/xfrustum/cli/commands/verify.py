"""`verify`: foreign renderers are diagnosed and judged."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import option
from xfrustum.tolerances import TOLERANCE_PX

if TYPE_CHECKING:
    from xfrustum.reports.blocks import Engine
    from xfrustum.reports.verification.baseline import Baseline
    from xfrustum.reports.verification.verdict import Verification
    from xfrustum.scenes.model.scene import Scene

LIMITS_NOT_STATED = (
    "exit status 0: nothing is worse than accepted, and limits that hogels exceed were not stated"
)
"""Line for the terminal where hogels exceed limits that are not the user's, as they did when accepted."""


def _tolerance(text: str) -> Any:
    from xfrustum.reports.verification.baseline import Stated

    return Stated.of(text)


def _baseline(baseline: Path | None, **asked: Any) -> dict[str, Any] | None:
    """Return what options ask of a baseline, its folder among it; None where there is none."""
    if baseline is not None:
        if asked.get("repeated") and not asked["approve"]:
            raise click.UsageError("--repeated says of what is accepted that it is noise: give --approve too")
        return {"folder": baseline, **asked}
    for name in asked:
        if options.is_given(name):
            raise click.UsageError(f"--{name.replace('_', '-')} is about --baseline DIR: give it too")
    return None


_baseline_options = options.gathered(
    "baseline",
    _baseline,
    option("--baseline", options.FOLDER, "Folder of accepted measures: fail on what got worse."),
    click.option("--approve", is_flag=True, help="Accept the present measures in --baseline."),
    click.option("--repeated", is_flag=True, help="With --approve: differences are the renderer's noise."),
    option(
        "--baseline-tolerance",
        options.Read("SHARE|NAME=AMOUNT,..", _tolerance, "a tolerance such as 5% or wrong_surfaces=3"),
        "What counts as noise.  [default: the spread of accepted runs]",
    ),
    click.option("--renderer", help="Name of the renderer in --baseline.  [default: SOURCE or the command]"),
    click.option("--device", help="Name of its device in --baseline.  [default: this machine's processor]"),
)

_PIXELS = options.Read(
    "PX|none", lambda text: None if text == "none" else float(text), "a number of pixels or none"
)


@options.command(
    "xfrustum verify asymmetric --apertures '20,20;60,40' --command 'xfrustum raster asymmetric "
    "--near 0.001 --depth d32f --mapping reversed --aperture {i},{j} --out {out}'"
)
@options.scene_argument
@click.argument("source", required=False)
@click.option(
    "--command", help="In place of SOURCE, run for each aperture: 'my-renderer --x {x} --y {y} --out {out}'."
)
@options.encoding_option
@options.layout_option("--layout", "Layout of SOURCE.  [default: what it looks like]")
@option("--apertures", options.INDICES, "Column,row of each.  [default: the whole plate]")
@option("--near", float, "Near offset that the renderer is known to have.  [default: 0]")
@options.accept_option("Conventions that are no faults, such as orientation,order; or all.")
@option(
    "--compare", click.Choice(["color", "geometry"]), "What plain pictures are judged by.", default="color"
)
@option(
    "--max-wrong",
    options.SHARE,
    "Share of wrong surfaces (colors, outlines) in the pixels that show something.",
    default="1%",
)
@option(
    "--max-displacement-px",
    _PIXELS,
    "How far 99 of 100 points or outlines may be off; unknown exceeds all but none.",
    default=str(TOLERANCE_PX),
)
@option("--max-color", float, "Difference that makes a color wrong.  [default: 0.009, of 8 bits]")
@option("--timeout", "timeout_s", options.POSITIVE, "Seconds that one run may take.", default=60.0)
@options.engine_options("this process", draws=False)
@options.out_option("Folder for index.html, inspect.html, verification.json.")
@option("--junit", options.FOLDER, "JUnit XML file for continuous integration.")
@_baseline_options
@options.quiet_and_json
def verify(
    *,
    scene: str,
    near: float | None,
    accept: tuple[str, ...] | None,
    engine: Engine | None,
    out: Path | None,
    junit: Path | None,
    baseline: dict[str, Any] | None,
    quiet: bool,
    as_json: bool,
    **asked: Any,
) -> int:
    """Judge the hogel images of any renderer, and say what is wrong with it.

    SOURCE is a pattern of files, {i} the column and {j} the row: 'DIR/hogel_{i}x{j}.png'; or a folder or a
    picture in one of the layouts (docs/layouts.md). Exit status 1 if any hogel is missing or exceeds a limit;
    with --baseline, once measures are accepted, if any got worse or a stated limit is exceeded.
    """
    opened = options.open_scene(scene)
    from xfrustum.reports.verification.files import table, write_junit, write_verification
    from xfrustum.reports.verification.verification import verify as verified

    _check_places(out, junit, baseline)
    judged: dict[str, Any] = {"near": near, "accept": accept or (), "progress": not quiet, **asked}
    if engine is not None:
        on_engine = _verified_on(opened, engine, out, **judged)
        if on_engine is None:
            options.note("this part is judged; the last one to be finished writes the verification")
            return 0
        found = on_engine
    else:
        found = verified(opened, channels=out is not None, **judged)
    options.warn_of(opened)
    if asked["encoding"] in ("triangle-id", "object-id") and found.judged.startswith("colors"):
        options.note(
            f"files without numbers (OpenEXR without id.*): --encoding {asked['encoding']} is not used"
        )
    if out is not None:
        write_verification(found, out)
    if junit is not None:
        write_junit(found, junit)
    if baseline is None:
        options.tell(as_json, found.summary, lambda: table(found))
        return 0 if found.passed else options.LIMIT_EXCEEDED
    # What is stated although it is the default judges the same.
    encoding = None if asked["encoding"] == "rgb" and asked["command"] is None else asked["encoding"]
    held = _held(found, near=near, accept=accept or (), encoding=encoding, **baseline)
    status = _status(found, held)
    options.tell(
        as_json, lambda: {**found.summary(), "baseline": held.summary()}, lambda: _text(found, held, status)
    )
    return status


def _held(found: Verification, folder: Path, baseline_tolerance: Any, **asked: Any) -> Baseline:
    """Hold a verification to a baseline, and append the summary that GitHub shows."""
    from xfrustum.reports.verification.baseline import BaselineOptions, append_step_summary
    from xfrustum.reports.verification.baseline import baseline as held_to

    held = held_to(found, folder, BaselineOptions(tolerance=baseline_tolerance, **asked))
    problem = append_step_summary(held)
    if problem is not None:
        options.note(problem)
    return held


def _text(found: Verification, held: Baseline, status: int) -> str:
    """Return the lines for the terminal, with those of the baseline."""
    from xfrustum.reports.verification.baseline import lines
    from xfrustum.reports.verification.files import table

    decided = "" if found.passed or status else f"\n{LIMITS_NOT_STATED}"
    return f"{table(found)}\n{lines(held)}{decided}"


def _status(found: Verification, held: Baseline) -> int:
    """Return the exit status: where measures are accepted, limits count only if they were stated."""
    stated = any(options.is_given(name) for name in ("max_wrong", "max_displacement_px", "max_color"))
    limited = stated or not (held.compared or held.approved)
    passed = held.passed and (found.passed or not limited)
    return 0 if passed else options.LIMIT_EXCEEDED


def _check_places(out: Path | None, junit: Path | None, baseline: dict[str, Any] | None) -> None:
    """Refuse places that cannot be written, before anything is judged."""
    from xfrustum.reports.common.outputs import check_writable_file, check_writable_folder
    from xfrustum.reports.verification.files import FILES

    if junit is not None:
        check_writable_file(junit, "--junit")
    if out is not None:
        check_writable_folder(out, FILES)
    if baseline is not None:
        from xfrustum.reports.verification.baseline import accepted_runs, check_folder

        check_folder(baseline["folder"])
        accepted_runs(baseline["folder"])


def _verified_on(
    scene: Scene, engine: Engine, out: Path | None, *, layout: str | None, progress: bool, **asked: Any
) -> Verification | None:
    """Judge where the options say; None where other parts are not finished yet."""
    from xfrustum.reports.verification.verification import limits_of
    from xfrustum.reports.verification.workers import ForeignRenderer, verify_on
    from xfrustum.scenes.files.foreign_images import Encoding

    if layout is not None:
        raise click.UsageError("--layout is for this process: leave out --workers and the like")
    limits = limits_of(
        *(asked.pop(name) for name in ("max_wrong", "max_displacement_px", "compare", "max_color"))
    )
    apertures, encoding = asked.pop("apertures"), asked.pop("encoding")
    renderer = ForeignRenderer(encoding=None if encoding is None else Encoding(encoding), **asked)
    return verify_on(
        engine, scene, renderer, limits, apertures=apertures, out=out, told=options.note, progress=progress
    )
