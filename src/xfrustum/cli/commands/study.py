"""`study`: many scenes and settings instead of one."""

from __future__ import annotations

from typing import Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import FOLDER, flag, option


@click.group(no_args_is_help=False, epilog="\b\nExample:\n  xfrustum study splitting --quick --out splitting")
def study() -> None:
    """Measure maps over many scenes and settings."""


class _Study(options.Measured):
    engine = options.engine_options("this process")
    out: Any = None
    quick = False

    def made(self, own: Any) -> None:
        """Make the study of a module, and print what it found."""
        from xfrustum.reports.blocks import HERE

        out, engine = self.out or own.DEFAULT_FOLDER, self.engine or HERE
        files = own.make_study(out, own.QUICK if self.quick else own.FULL, engine, progress=self.progress)
        if files is None:  # other parts of a job array are not measured yet
            options.note("this part is measured; the last one to be finished writes the study")
        else:
            self.tell(lambda: own.record(files), lambda: f"{own.sentence(files.rows)}\n{files.document}")


class _Splitting(_Study):
    out = option(FOLDER, "Folder.  [default: study/splitting]")
    quick = flag("A small part of the maps, in less than a minute.")


@options.command("xfrustum study splitting --quick --out splitting", study)
def splitting(asked: _Splitting) -> None:
    """Map where one pair of frusta is enough; write when-to-split.md, its figures and its data.

    Every picture is kept as soon as it is measured: a run that was stopped goes on from there.
    """
    from xfrustum.reports.studies import splitting as own

    asked.made(own)


class _Noticeable(_Study):
    out = option(FOLDER, "Folder.  [default: study/noticeable]")
    quick = flag("One scene and a few settings, in less than a minute.")


@options.command("xfrustum study noticeable --quick --out noticeable", study)
def noticeable(asked: _Noticeable) -> None:
    """Ask what viewers notice of near and depth buffer; write noticeable.md and its data.

    Closed forms answer for all settings, and replays to two eyes for some of them. Every seat that was
    replayed is kept: a run that was stopped goes on from there.
    """
    from xfrustum.reports.studies import noticeable as own

    asked.made(own)
