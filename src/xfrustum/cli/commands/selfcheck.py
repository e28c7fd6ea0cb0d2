"""`selfcheck`: the truth against integer brute force."""

from __future__ import annotations

from xfrustum.cli import options
from xfrustum.cli.options import flag


class _Asked(options.Measured):
    scenes: tuple[str, ...] = options.argument(metavar="[SCENE]...", nargs=-1)
    quick = flag("Fewer scenes and pixels, in less than a minute.")


@options.command("xfrustum selfcheck asymmetric --quick")
def selfcheck(asked: _Asked) -> int:
    """Compare the truth with integer brute force; exit status 1 if anything disagrees.

    Without SCENE: all built-in scenes, all hard cases but the giants, a sphere through all its vertices
    and edges, and the scene files in the folder of test data beside the checkout.
    """
    from xfrustum.scenes.opening import check_scene

    for name in asked.scenes:
        check_scene(name)
    from xfrustum.compare.selfcheck import selfcheck as checking

    found = checking.selfcheck(asked.scenes, quick=asked.quick, progress=asked.progress)
    asked.tell(found.summary, lambda: checking.table(found))
    return 0 if found.agrees else options.LIMIT_EXCEEDED
