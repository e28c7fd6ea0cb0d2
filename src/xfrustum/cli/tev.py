"""The option `--tev`: what an inspection page holds, sent to a running viewer."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import click

from xfrustum.terminal import say

USUAL_ADDRESS = "localhost:14158"
"""Address at which tev listens unless it is told otherwise."""


MAX_PORT = 65535
"""Largest number of a TCP port: it has 16 bits."""


class Address(click.ParamType[str]):
    """A host and a port."""

    name = "HOST:PORT"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the address, checked."""
        found = re.fullmatch(r"[\w.-]+:(\d{1,5})", str(value), re.ASCII)
        if found is None or not 0 < int(found[1]) <= MAX_PORT:
            self.fail(
                f"{value!r} is no HOST:PORT with a port up to {MAX_PORT}; write --tev alone as the last "
                f"word, or --tev {USUAL_ADDRESS}",
                param,
                ctx,
            )
        return str(value)


tev_option = click.option(
    "--tev",
    type=Address(),
    is_flag=False,
    flag_value=USUAL_ADDRESS,
    help=f"Send the images of inspect.html to a running tev viewer too.  [without a value: {USUAL_ADDRESS}]",
)


def check_tev(address: str | None) -> None:
    """Refuse, before any work, what needs a package that is not installed."""
    if address is not None:
        from xfrustum.reports.inspection.tev import check_tev as check

        check()


def send_to_tev(address: str | None, page: Path, title: str) -> None:
    """Send the images of a page that was written, where asked for; none answering is a note, and no error."""
    if address is not None:
        from xfrustum.reports.inspection.tev import send_page
        from xfrustum.scenes.errors import InputError

        try:
            say(f"note: {send_page(page, title, address)} images sent to tev at {address}")
        except InputError as error:
            say(f"note: {error}")
