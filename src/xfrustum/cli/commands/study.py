"""`study`: many scenes and settings instead of one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import FOLDER, flag, option

if TYPE_CHECKING:
    from xfrustum.reports.studies.sweep import StudyFiles


@click.group(no_args_is_help=False, epilog="\b\nExample:\n  xfrustum study splitting --quick --out splitting")
def study() -> None:
    """Measure maps over many scenes and settings."""


class _Study(options.Measured):
    engine = options.engine_options("this process")

    def told(
        self,
        files: StudyFiles | None,
        record: Callable[[StudyFiles], dict[str, Any]],
        sentence: Callable[[Sequence[Any]], str],
    ) -> None:
        """Print what a study found; files are None where other parts of a job array are not measured yet."""
        if files is None:
            options.note("this part is measured; the last one to be finished writes the study")
        else:
            self.tell(lambda: record(files), lambda: f"{sentence(files.rows)}\n{files.document}")


class _Splitting(_Study):
    out = option(FOLDER, "Folder.  [default: study/splitting]")
    quick = flag("A small part of the maps, in less than a minute.")


@options.command("xfrustum study splitting --quick --out splitting", study)
def splitting(asked: _Splitting) -> None:
    """Map where one pair of frusta is enough; write when-to-split.md, its figures and its data.

    Every picture is kept as soon as it is measured: a run that was stopped goes on from there.
    """
    from xfrustum.reports.blocks import HERE
    from xfrustum.reports.studies.splitting import DEFAULT_FOLDER, make_study
    from xfrustum.reports.studies.splitting_cells import FULL, QUICK, record, sentence

    cells = QUICK if asked.quick else FULL
    files = make_study(asked.out or DEFAULT_FOLDER, cells, asked.engine or HERE, progress=asked.progress)
    asked.told(files, record, sentence)


class _Noticeable(_Study):
    out = option(FOLDER, "Folder.  [default: study/noticeable]")
    quick = flag("One scene and a few settings, in less than a minute.")


@options.command("xfrustum study noticeable --quick --out noticeable", study)
def noticeable(asked: _Noticeable) -> None:
    """Ask what viewers notice of near and depth buffer; write noticeable.md and its data.

    Closed forms answer for all settings, and replays to two eyes for some of them. Every seat that was
    replayed is kept: a run that was stopped goes on from there.
    """
    from xfrustum.reports.blocks import HERE
    from xfrustum.reports.studies import noticeable as own

    cells = own.QUICK if asked.quick else own.FULL
    files = own.make_study(
        asked.out or own.DEFAULT_FOLDER, cells, asked.engine or HERE, progress=asked.progress
    )
    asked.told(files, own.record, own.sentence)
