"""Commands that study: answers over many scenes and settings, not about one."""

# ruff: noqa: PLC0415 - commands import what they need when they run

from __future__ import annotations

from pathlib import Path

import click

from xfrustum import cli_options as options


@click.group()
def study() -> None:
    """Measure maps over many scenes and settings."""


@study.command()
@click.option("--out", type=click.Path(path_type=Path), help="Folder.  [default: study/splitting]")
@click.option("--quick", is_flag=True, help="A small part of the maps, in less than a minute.")
@options.quiet_option
@options.json_option
def splitting(out: Path | None, quick: bool, quiet: bool, as_json: bool) -> None:
    """Map where one pair of frusta is enough; write when-to-split.md, its figures and its data.

    What is measured is kept at once in measurements.sqlite: a run that was stopped goes on from there.
    """
    from xfrustum.reports.study import make_study
    from xfrustum.reports.study_grid import FULL, QUICK

    files = make_study(out, QUICK if quick else FULL, progress=not quiet)
    if as_json:
        options.print_json(files.content)
    else:
        click.echo(f"{files.sentence}\n{files.document}")
