"""`study`: many scenes and settings instead of one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options

if TYPE_CHECKING:
    from xfrustum.reports.blocks import Engine
    from xfrustum.reports.studies.sweep import StudyFiles

_EXAMPLE = "\b\nExample:\n  xfrustum study splitting --quick --out splitting"


@click.group(no_args_is_help=False, epilog=_EXAMPLE)
def study() -> None:
    """Measure maps over many scenes and settings."""


@study.command(epilog=_EXAMPLE)
@options.out_option("Folder.  [default: study/splitting]")
@click.option("--quick", is_flag=True, help="A small part of the maps, in less than a minute.")
@options.engine_options("this process")
@options.quiet_and_json
def splitting(*, out: Path | None, quick: bool, engine: Engine | None, quiet: bool, as_json: bool) -> None:
    """Map where one pair of frusta is enough; write when-to-split.md, its figures and its data.

    Every picture is kept as soon as it is measured: a run that was stopped goes on from there.
    """
    from xfrustum.reports.studies.splitting import DEFAULT_FOLDER, make_study
    from xfrustum.reports.studies.splitting_cells import FULL, QUICK
    from xfrustum.reports.studies.splitting_facts import record, sentence
    from xfrustum.reports.studies.sweep import HERE

    asked = QUICK if quick else FULL
    files = make_study(out or DEFAULT_FOLDER, asked, engine or HERE, progress=not quiet)
    _tell(as_json, files, record, sentence)


@study.command(epilog=_EXAMPLE.replace("splitting", "noticeable"))
@options.out_option("Folder.  [default: study/noticeable]")
@click.option("--quick", is_flag=True, help="One scene and a few settings, in less than a minute.")
@options.engine_options("this process")
@options.quiet_and_json
def noticeable(*, out: Path | None, quick: bool, engine: Engine | None, quiet: bool, as_json: bool) -> None:
    """Ask what viewers notice of near and depth buffer; write noticeable.md and its data.

    Closed forms answer for all settings, and replays to two eyes for some of them. Every seat that was
    replayed is kept: a run that was stopped goes on from there.
    """
    from xfrustum.reports.studies import noticeable as own
    from xfrustum.reports.studies.sweep import HERE

    asked = own.QUICK if quick else own.FULL
    files = own.make_study(out or own.DEFAULT_FOLDER, asked, engine or HERE, progress=not quiet)
    _tell(as_json, files, own.record, own.sentence)


def _tell(
    as_json: bool,
    files: StudyFiles | None,
    record: Callable[[StudyFiles], dict[str, Any]],
    sentence: Callable[[Sequence[Any]], str],
) -> None:
    """Print what a study found; files are None where other parts of a job array are not measured yet."""
    if files is None:
        options.note("this part is measured; the last one to be finished writes the study")
    else:
        options.tell(as_json, lambda: record(files), lambda: f"{sentence(files.rows)}\n{files.document}")
