"""`xfrustum study` with an extra command `small FOLDER`: a study of few cells to interrupt."""

import sys
from dataclasses import replace
from pathlib import Path

from xfrustum.cli.main import run


def small(out: Path) -> None:
    """Measure two pictures, one for each side of the plate, with two nears and one depth buffer."""
    from xfrustum.research.splitting import QUICK, make_study

    nears, (first, *_) = QUICK
    make_study(
        out,
        (
            nears[:2],
            (replace(first, buffers=first.buffers[1:2], resolutions=(16,), ratios=(1.5,)),),
        ),
    )


if __name__ == "__main__":
    import click

    from xfrustum.cli import studies

    parameters: list[click.Parameter] = [click.Argument(["out"], type=click.Path(path_type=Path))]
    studies.study.add_command(click.Command("small", callback=small, params=parameters))
    sys.exit(run())
