"""`scenes`: the built-in scenes."""

from __future__ import annotations

import click

from xfrustum.cli import options


@options.command("xfrustum scenes")
@click.option("--hard", is_flag=True, help="List the hard cases instead.")
@options.json_option
def scenes(hard: bool, as_json: bool) -> None:
    """List the built-in scenes, each with what it is for."""
    if hard:
        from xfrustum.scenes.library.hard_cases import listing as listed
    else:
        from xfrustum.scenes.library.builtin import listing as listed

    found = listed()
    width = max(len(one.name) for one in found)
    options.tell(
        as_json,
        lambda: {"scenes": [{"name": s.name, "purpose": s.purpose, "triangles": s.triangles} for s in found]},
        lambda: "\n".join(f"{s.name:<{width}}  {s.triangles:>7,} triangles  {s.purpose}" for s in found),
    )
