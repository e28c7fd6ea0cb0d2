"""`verify`: foreign renderers are diagnosed and judged."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.commands.checks import LIMIT_EXCEEDED
from xfrustum.cli.commands.convert import layout_option
from xfrustum.cli.numbers import Positive
from xfrustum.cli.streams import say
from xfrustum.cli.where import Where, engine_options
from xfrustum.tolerances import TOLERANCE_PX

if TYPE_CHECKING:
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
@click.option("--out", type=click.Path(path_type=Path), help="Folder for index.html and verification.json.")
@click.option("--junit", type=click.Path(path_type=Path), help="JUnit XML file for continuous integration.")
@options.quiet_option
@options.json_option
def verify(
    *,
    scene: str,
    accept: tuple[str, ...] | None,
    where: Where,
    out: Path | None,
    junit: Path | None,
    quiet: bool,
    as_json: bool,
    **asked: Any,
) -> int:
    """Judge the hogel images of any renderer, and say what is wrong with it.

    SOURCE is a pattern of files, {i} the column and {j} the row: 'DIR/hogel_{i}x{j}.png'; or a folder or a
    picture in one of the layouts (docs/layouts.md). Exit status 1 if any hogel is missing or exceeds a limit.
    """
    opened = options.open_scene(scene)
    from xfrustum.reports.common.outputs import check_writable_file, check_writable_folder
    from xfrustum.reports.verification.files import FILES, table, write_junit, write_verification
    from xfrustum.reports.verification.verification import verify as verified

    if junit is not None:
        check_writable_file(junit, "--junit")
    if out is not None:
        check_writable_folder(out, FILES)
    if where.asked:
        on_engine = _verified_on(opened, where, out, accept=accept or (), progress=not quiet, **asked)
        if on_engine is None:
            say("note: this part is judged; the last one to be finished writes the verification")
            return 0
        found = on_engine
    else:
        found = verified(opened, accept=accept or (), progress=not quiet, **asked)
    options.warn_of(opened)
    if out is not None:
        write_verification(found, out)
    if junit is not None:
        write_junit(found, junit)
    options.tell(as_json, found.summary, lambda: table(found))
    return 0 if found.passed else LIMIT_EXCEEDED


def _verified_on(
    scene: Scene,
    where: Where,
    out: Path | None,
    *,
    layout: str | None,
    max_wrong: float,
    max_displacement_px: float | None,
    compare: str,
    max_color: float | None,
    apertures: Sequence[tuple[int, int]] | None,
    progress: bool,
    **renderer: Any,
) -> Verification | None:
    """Judge where the options say; None where other parts are not finished yet."""
    from xfrustum.reports.verification.on_engine import ForeignRenderer, verify_on
    from xfrustum.reports.verification.verification import limits_of
    from xfrustum.scenes.files.foreign_images import Encoding

    if layout is not None:
        raise click.UsageError("--layout is read by this process: leave out --workers and the like")
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
