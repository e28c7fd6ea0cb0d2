"""`scenes`: the built-in scenes."""

from __future__ import annotations

from xfrustum.cli import options
from xfrustum.cli.options import flag


class _Asked(options.Printed):
    hard = flag("List the hard cases instead.")


@options.command("xfrustum scenes")
def scenes(asked: _Asked) -> None:
    """List the built-in scenes, each with what it is for."""
    if asked.hard:
        from xfrustum.scenes.library.hard_cases import listing as listed
    else:
        from xfrustum.scenes.library.builtin import listing as listed

    found = listed()
    width = max(len(one.name) for one in found)
    asked.tell(
        lambda: {"scenes": [{"name": s.name, "purpose": s.purpose, "triangles": s.triangles} for s in found]},
        lambda: "\n".join(f"{s.name:<{width}}  {s.triangles:>7,} triangles  {s.purpose}" for s in found),
    )
