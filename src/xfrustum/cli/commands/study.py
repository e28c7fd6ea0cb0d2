"""Commands that study many scenes and settings instead of one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from xfrustum.cli import options
from xfrustum.cli.streams import say
from xfrustum.cli.where import Where, engine_options

if TYPE_CHECKING:
    from xfrustum.reports.cluster.run import Engine


@click.group(no_args_is_help=False)
def study() -> None:
    """Measure maps over many scenes and settings."""


@study.command()
@click.option("--out", type=click.Path(path_type=Path), help="Folder.  [default: study/splitting]")
@click.option("--quick", is_flag=True, help="A small part of the maps, in less than a minute.")
@engine_options("this process")
@options.quiet_option
@options.json_option
def splitting(*, out: Path | None, quick: bool, where: Where, quiet: bool, as_json: bool) -> None:
    """Map where one pair of frusta is enough; write when-to-split.md, its figures and its data.

    What is measured is kept at once in measurements.sqlite: a run that was stopped goes on from there, and
    several processes may measure one map at once. Columns of times are those of processes that shared this
    machine.
    """
    from xfrustum.reports.splitting_study.document import sentence
    from xfrustum.reports.splitting_study.grid import FULL, QUICK
    from xfrustum.reports.splitting_study.study import make_study_on

    files = make_study_on(_engine(where), out, QUICK if quick else FULL, told=_note, progress=not quiet)
    if files is None:
        _note("this part is measured; the last one to be finished writes the study")
        return
    options.tell(as_json, files.summary, lambda: f"{sentence(files.rows)}\n{files.document}")


@study.command()
@click.option("--out", type=click.Path(path_type=Path), help="Folder.  [default: study/noticeable]")
@click.option("--quick", is_flag=True, help="One scene and a few settings, in less than a minute.")
@engine_options("this process")
@options.quiet_option
@options.json_option
def noticeable(*, out: Path | None, quick: bool, where: Where, quiet: bool, as_json: bool) -> None:
    """Ask what viewers notice of near and depth buffer; write noticeable.md, its figures and its data.

    Closed forms answer for all settings, and replays to two eyes for some of them. What is replayed is kept
    at once in measurements.sqlite: a run that was stopped goes on from there, and several processes may share
    the replays.
    """
    from xfrustum.reports.noticeable_study.document import sentence
    from xfrustum.reports.noticeable_study.grid import FULL, QUICK
    from xfrustum.reports.noticeable_study.study import make_study_on

    files = make_study_on(_engine(where), out, QUICK if quick else FULL, told=_note, progress=not quiet)
    if files is None:
        _note("this part is replayed; the last one to be finished writes the study")
        return
    options.tell(as_json, files.summary, lambda: f"{sentence(files.rows)}\n{files.document}")


def _note(line: str) -> None:
    say(f"note: {line}")


def _engine(where: Where) -> Engine:
    """Return where cells are measured: by this process alone unless options say otherwise."""
    return (where if where.asked else Where(workers=1)).engine()
