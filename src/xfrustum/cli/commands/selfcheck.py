"""`selfcheck`: the truth against integer brute force."""

from __future__ import annotations

import click

from xfrustum.cli import options


@options.command("xfrustum selfcheck asymmetric --quick")
@click.argument("scenes", metavar="[SCENE]...", nargs=-1)
@click.option("--quick", is_flag=True, help="Fewer scenes and pixels, in less than a minute.")
@options.quiet_and_json
def selfcheck(scenes: tuple[str, ...], quick: bool, quiet: bool, as_json: bool) -> int:
    """Compare the truth with integer brute force; exit status 1 if anything disagrees.

    Without SCENE: all built-in scenes, all hard cases but the giants, a sphere through all its vertices
    and edges, and the scene files in the folder of test data beside the checkout.
    """
    from xfrustum.scenes.opening import check_scene

    for name in scenes:
        check_scene(name)
    from xfrustum.compare.selfcheck.selfcheck import selfcheck as compare_with_integers
    from xfrustum.compare.selfcheck.selfcheck import table

    found = compare_with_integers(scenes, quick=quick, progress=not quiet)
    options.tell(as_json, found.summary, lambda: table(found))
    return 0 if found.agrees else options.LIMIT_EXCEEDED
