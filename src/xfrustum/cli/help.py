"""The text of `--help`: commands by their use, and an example that ends the help of each command."""

from __future__ import annotations

from dataclasses import dataclass

import click

SHORT_HELP_LENGTH = 150
"""Largest number of characters of a command's line in the list of commands: one sentence, on two lines."""


@dataclass(frozen=True, kw_only=True)
class Use:
    """One use of the program, and the commands that serve it.

    Attributes
    ----------
    title
        Use, as the heading of the list of its commands.
    commands
        Names of the commands, in the order in which people need them.
    """

    title: str
    commands: tuple[str, ...]


USES = (
    Use(title="Begin with a scene", commands=("scenes", "new", "check")),
    Use(title="Answer for one aperture", commands=("trace", "raster", "figure7")),
    Use(title="Compare and explain", commands=("report", "compare", "budget")),
    Use(title="Plan settings", commands=("plan", "explain", "cost")),
    Use(title="Verify another renderer", commands=("verify", "camera", "convert")),
    Use(title="Whole plates", commands=("plate", "survey")),
    Use(title="The viewer's eye", commands=("view",)),
    Use(title="Studies and benchmarks", commands=("study", "bench")),
    Use(title="Checks of xfrustum itself", commands=("selfcheck",)),
)
"""All commands by use; a command that is missing here is listed under OTHERS."""

OTHERS = "Others"
"""Heading over commands that belong to no use yet."""

EXAMPLES: dict[str, str] = {
    "scenes": "xfrustum scenes",
    "new": "xfrustum new beetle.obj --size 100 --units mm",
    "check": "xfrustum check car --out views",
    "trace": "xfrustum trace car --out truth.exr",
    "raster": "xfrustum raster car --near 0.1 --out raster.exr",
    "compare": "xfrustum compare truth.exr raster.exr --out compared",
    "figure7": "xfrustum figure7 car --out figure7",
    "report": "xfrustum report car --near 1,0.1,0.01 --depth d24,d32f:reversed --out report",
    "budget": "xfrustum budget car --near 0.1 --out budget",
    "plan": "xfrustum plan asymmetric --apertures 3",
    "explain": "xfrustum explain car --viewer 600 --near 0.1",
    "cost": "xfrustum cost asymmetric --repeat 1 --out cost",
    "verify": "xfrustum verify asymmetric --apertures '20,20;60,40' --command 'xfrustum raster asymmetric "
    "--near 0.001 --depth d32f --mapping reversed --aperture {i},{j} --out {out}'",
    "camera": "xfrustum camera asymmetric --for json --near 0.1 --out cameras",
    "plate": "xfrustum plate hard/only-behind --near 0.1 --out plate.zarr",
    "convert": "xfrustum convert plate.zarr plate.png --to mosaic",
    "survey": "xfrustum survey asymmetric --near 0.1 --sample 40 --resolution 64,64 --out survey",
    "view": "xfrustum view asymmetric --eye 0,0,600 --near 0.1 --resolution 160,120 --out seen",
    "study": "xfrustum study splitting --quick --out splitting",
    "bench": "xfrustum bench plate asymmetric --resolution 64 --repeat 1",
    "bench truth": "xfrustum bench truth asymmetric --resolution 128 --repeat 1",
    "bench judge": "xfrustum bench judge asymmetric --resolution 64 --hogels 2 --repeat 1",
    "bench table1": "xfrustum bench table1 --resolution 128 --repeat 1",
    "selfcheck": "xfrustum selfcheck asymmetric --quick",
}
"""One line for each command that a shell takes as it is; subcommands without one show that of their group.

Run from top to bottom in a folder that has beetle.obj, each finds what it needs (tests/cli/test_help.py).
"""


class CommandsByUse(click.Group):
    """Group whose help lists commands by use, and whose commands end their help with an example."""

    def add_command(self, cmd: click.Command, name: str | None = None) -> None:
        """Add a command, with its example as the end of its help."""
        super().add_command(cmd, name)
        called = name or cmd.name or ""
        _end_with_example(cmd, (called,))
        for inner, command in getattr(cmd, "commands", {}).items():
            _end_with_example(command, (f"{called} {inner}", called))

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands by use, each with its first sentence."""
        used = {name for use in USES for name in use.commands}
        others = Use(title=OTHERS, commands=tuple(sorted(set(self.commands) - used)))
        for use in (*USES, others):
            rows = [
                (name, self.commands[name].get_short_help_str(SHORT_HELP_LENGTH))
                for name in use.commands
                if name in self.commands
            ]
            if rows:
                with formatter.section(use.title):
                    formatter.write_dl(rows)


def _end_with_example(command: click.Command, names: tuple[str, ...]) -> None:
    """Let a command's help end with the example of the first of these names that has one."""
    example = next((EXAMPLES[name] for name in names if name in EXAMPLES), None)
    if example is not None and command.epilog is None:
        command.epilog = f"\b\nExample:\n  {example}"
