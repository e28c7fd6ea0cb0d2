"""`verify`: foreign renderers are diagnosed and judged."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import (
    ACCEPTED,
    FOLDER,
    INDICES,
    LAYOUT,
    POSITIVE,
    SHARE,
    TEXT,
    flag,
    group,
    option,
    several,
)
from xfrustum.tolerances import TOLERANCE_PX

if TYPE_CHECKING:
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


_TOLERANCE = options.Read("SHARE|NAME=AMOUNT,..", _tolerance, "a tolerance such as 5% or wrong_surfaces=3")
_PIXELS = options.Read(
    "PX|none", lambda text: None if text == "none" else float(text), "a number of pixels or none"
)


class _Asked(options.Measured):
    scene = options.scene_argument
    judged = several(
        source=options.argument(required=False),
        command=option(
            TEXT, "In place of SOURCE, run for each aperture: 'my-renderer --x {x} --y {y} --out {out}'."
        ),
        encoding=options.encoding_option,
        layout=option(LAYOUT, "Layout of SOURCE.  [default: what it looks like]"),
        apertures=option(INDICES, "Column,row of each.  [default: the whole plate]"),
        near=option(click.FLOAT, "Near offset that the renderer is known to have.  [default: 0]"),
        accept=option(
            ACCEPTED, "Conventions that are no faults, such as orientation,order; or all.", default=()
        ),
        compare=option(
            click.Choice(["color", "geometry"]), "What plain pictures are judged by.", default="color"
        ),
        max_wrong=option(
            SHARE,
            "Share of wrong surfaces (colors, outlines) in the pixels that show something.",
            default="1%",
        ),
        max_displacement_px=option(
            _PIXELS,
            "How far 99 of 100 points or outlines may be off; unknown exceeds all but none.",
            default=str(TOLERANCE_PX),
        ),
        max_color=option(click.FLOAT, "Difference that makes a color wrong.  [default: 0.009, of 8 bits]"),
        timeout_s=option(POSITIVE, "Seconds that one run may take.", "--timeout", default=60.0),
    )
    engine = options.engine_options("this process", draws=False)
    out = option(FOLDER, "Folder for index.html, inspect.html, verification.json.")
    junit = option(FOLDER, "JUnit XML file for continuous integration.")
    baseline = group(
        _baseline,
        baseline=option(FOLDER, "Folder of accepted measures: fail on what got worse."),
        approve=flag("Accept the present measures in --baseline."),
        repeated=flag("With --approve: differences are the renderer's noise."),
        baseline_tolerance=option(
            _TOLERANCE, "What counts as noise.  [default: the spread of accepted runs]"
        ),
        renderer=option(TEXT, "Name of the renderer in --baseline.  [default: SOURCE or the command]"),
        device=option(TEXT, "Name of its device in --baseline.  [default: this machine's processor]"),
    )

    def found(self, scene: Scene) -> Verification | None:
        """Judge here or where the options say; None where other parts are not finished yet."""
        from xfrustum.reports.verification.verification import VerifyOptions, verify
        from xfrustum.reports.verification.workers import verify_on

        fields = dict(self.judged)
        source = fields.pop("source")
        judged = VerifyOptions(channels=self.out is not None, progress=self.progress, **fields)
        if self.engine is None:
            return verify(scene, source, judged)
        if judged.layout is not None:
            raise click.UsageError("--layout is for this process: leave out --workers and the like")
        return verify_on(self.engine, scene, source, judged, self.out, options.note)


@options.command(
    "xfrustum verify asymmetric --apertures '20,20;60,40' --command 'xfrustum raster asymmetric "
    "--near 0.001 --depth d32f --mapping reversed --aperture {i},{j} --out {out}'"
)
def verify(asked: _Asked) -> int:
    """Judge the hogel images of any renderer, and say what is wrong with it.

    SOURCE is a pattern of files, {i} the column and {j} the row: 'DIR/hogel_{i}x{j}.png'; or a folder or a
    picture in one of the layouts (docs/layouts.md). Exit status 1 if any hogel is missing or exceeds a limit;
    with --baseline, once measures are accepted, if any got worse or a stated limit is exceeded.
    """
    opened = options.open_scene(asked.scene)
    from xfrustum.reports.common.outputs import check_writable_file
    from xfrustum.reports.verification.verdict import FILES, table, write_junit, write_verification

    if asked.junit is not None:
        check_writable_file(asked.junit, "--junit")
    options.check_out(asked.out, FILES)
    if asked.baseline is not None:
        from xfrustum.reports.verification.baseline import accepted_runs, check_folder

        check_folder(asked.baseline["folder"])
        accepted_runs(asked.baseline["folder"])
    found = asked.found(opened)
    if found is None:
        options.note("this part is judged; the last one to be finished writes the verification")
        return 0
    options.warn_of(opened)
    encoding = asked.judged["encoding"]
    if encoding in ("triangle-id", "object-id") and found.judged.startswith("colors"):
        options.note(f"files without numbers (OpenEXR without id.*): --encoding {encoding} is not used")
    if asked.out is not None:
        write_verification(found, asked.out)
    if asked.junit is not None:
        write_junit(found, asked.junit)
    if asked.baseline is None:
        asked.tell(found.summary, lambda: table(found))
        return 0 if found.passed else options.LIMIT_EXCEEDED
    from xfrustum.reports.verification.baseline import BaselineOptions, append_step_summary, baseline, lines

    said = {name: asked.judged[name] for name in ("near", "accept", "encoding")}
    if encoding == "rgb" and asked.judged["command"] is None:
        said["encoding"] = None  # what is stated although it is the default judges the same
    how = {**asked.baseline}
    folder, tolerance = how.pop("folder"), how.pop("baseline_tolerance")
    held = baseline(found, folder, BaselineOptions(tolerance=tolerance, **said, **how))
    problem = append_step_summary(held)
    if problem is not None:
        options.note(problem)
    # Where measures are accepted, limits count only if they were stated.
    stated = any(map(options.is_given, ("max_wrong", "max_displacement_px", "max_color")))
    limited = stated or not (held.compared or held.approved)
    passed = held.passed and (found.passed or not limited)
    decided = f"\n{LIMITS_NOT_STATED}" if passed and not found.passed else ""
    asked.tell(
        lambda: {**found.summary(), "baseline": held.summary()},
        lambda: f"{table(found)}\n{lines(held)}{decided}",
    )
    return 0 if passed else options.LIMIT_EXCEEDED
