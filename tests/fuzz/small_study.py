"""`xfrustum study`, with one more command: `small FOLDER NOTES`, of so few cells that it can be killed often.

Every measurement is noted in a file once it is kept, so that one that is made twice is seen.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

# Signals are taken over before anything else is imported, as in the program itself.
from xfrustum import __main__ as program
from xfrustum.cli import termination as cli_termination


def _noted(notes: Path) -> None:
    """Let the store note every measurement that it has kept."""
    from xfrustum.reports.studies.store import Store

    put = Store.put
    descriptor = os.open(notes, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o666)

    def noted(self: Store, kind: str, key: str, result: Mapping[str, Any]) -> None:
        put(self, kind, key, result)
        os.write(descriptor, f"{kind} {key}\n".encode())

    Store.put = noted  # type: ignore[method-assign]


def small(out: Path, notes: Path) -> None:
    """Measure two pictures, one of each side, with two nears and one depth buffer."""
    from xfrustum.reports.splitting_study.grid import QUICK
    from xfrustum.reports.splitting_study.study import make_study

    _noted(notes)
    make_study(
        out,
        replace(
            QUICK,
            nears=QUICK.nears[:2],
            buffers=QUICK.buffers[1:2],
            resolutions=(16,),
            ratios=(1.5,),
            families=(),
        ),
    )


if __name__ == "__main__":
    cli_termination.of_process()
    import click

    from xfrustum.cli.commands import study as cli_study

    parameters: list[click.Parameter] = [
        click.Argument([name], type=click.Path(path_type=Path)) for name in ("out", "notes")
    ]
    cli_study.study.add_command(click.Command("small", callback=small, params=parameters))
    sys.exit(program.run())
