"""Group of all commands, ordered by use; a command is loaded from its module when it is called."""

import os
import re
import sys
from collections.abc import Sequence
from importlib import import_module

import click

from xfrustum.cli.options import COUNT_FROM_1, Read

#: Module of `commands` and names of commands by use, in the usual order of work.
USES = {
    "Begin with a scene": ("scenes", "scenes new check"),
    "Trace or draw one aperture": ("pictures", "trace raster"),
    "Compare and explain": ("comparing", "report compare budget"),
    "Plan settings": ("scenes", "plan cost"),
    "Whole plates": ("plates", "plate survey"),
    "Verify another renderer": ("verifying", "verify camera convert"),
    "Certify a renderer": ("verifying", "conformance"),
    "The viewer's eye": ("pictures", "view"),
    "Studies and benchmarks": ("studies", "study bench"),
    "Checks of xfrustum itself": ("studies", "selfcheck device"),
}

#: Commands of earlier versions, and the command that replaces each.
REPLACED = {"recommend": "plan", "explain": "check", "figure7": "study figure7"}

#: Module of each command.
MODULES = {name: module for module, names in USES.values() for name in names.split()}


class Commands(click.Group):
    """Group of commands, each loaded on use; the help lists them by use."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all listed commands; commands added by another program come last."""
        return [*MODULES, *(name for name, entry in self.commands.items() if not entry.hidden)]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command by name, or None."""
        # A renamed command fails and prints its new name; it never runs, because options differ.
        if cmd_name in REPLACED:
            instead = REPLACED[cmd_name]
            raise click.UsageError(
                f"`xfrustum {cmd_name}` is replaced by `xfrustum {instead}`: use that, see its "
                "--help"
            )
        # Commands that a program adds to the group take precedence over our own.
        if cmd_name in self.commands or cmd_name not in MODULES:
            return self.commands.get(cmd_name)
        module = import_module(f"xfrustum.cli.{MODULES[cmd_name]}")
        command: click.Command = getattr(module, cmd_name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands by use, each with the first sentence of its help."""
        for title, (_, names) in USES.items():
            commands = [(name, self.get_command(ctx, name)) for name in names.split()]
            with formatter.section(title):
                formatter.write_dl(
                    [(name, entry.get_short_help_str(150)) for name, entry in commands if entry]
                )


def _size(text: str) -> int:
    """Return the number of bytes of a size such as 800M or 4GiB, in units of 1024."""
    match = re.fullmatch(r"(\d{1,15}(?:\.\d{1,15})?)\s*([kmgt]?)(?:i?b)?", text.lower())
    # Fifteen digits bound the number: a longer number is a typing error and would overflow.
    size = 0 if match is None else int(float(match[1]) * 1024 ** " kmgt".index(match[2] or " "))
    if not size:
        raise ValueError
    return size


@click.group(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
    invoke_without_command=True,
    epilog="`xfrustum COMMAND --help` lists the options of a command and ends with an example.",
)
@click.version_option(package_name="xfrustum", message="%(version)s")
@click.option(
    "--max-input-memory",
    type=Read("SIZE", _size, "a size such as 800M or 4G"),
    help="Largest memory for reading one file, such as 4G.  "
    "[default: 1G, or 64 times the file's size]",
)
@click.option(
    "--max-hogels",
    type=COUNT_FROM_1,
    help="Largest number of hogels of a plate.  [default: 20000000]",
)
@click.option(
    "--arrays",
    type=click.Choice(["auto", "llvm", "cuda"]),
    help="Compute the truth on processors (llvm) or an NVIDIA card (cuda).  "
    "[default: XFRUSTUM_DEVICE, or auto]",
)
@click.option(
    "--traceback", is_flag=True, help="Show the traceback of an unexpected error, and warnings."
)
@click.pass_context
def cli(
    context: click.Context,
    *,
    max_input_memory: int | None,
    max_hogels: int | None,
    arrays: str | None,
    traceback: bool,
) -> None:
    """Measure how far renderers of full-parallax spatial displays are from the truth.

    SCENE is the path of a scene file (TOML) or the name of a built-in scene.
    """
    # `main` has read this option already, before anything else could fail.
    del traceback
    if arrays is not None:
        # Worker processes inherit this variable.
        os.environ["XFRUSTUM_DEVICE"] = arrays
    if context.invoked_subcommand is None:
        click.echo(context.get_help())
    elif max_input_memory is not None or max_hogels is not None:
        from xfrustum.scenes import disk

        if max_input_memory is not None:
            # Limits end with the command: programs may call several commands in one process.
            context.with_resource(disk.input_memory(max_input_memory))
        if max_hogels is not None:
            context.with_resource(disk.largest_plate(max_hogels))


@cli.command(hidden=True)
@click.argument("name", required=False)
def schema(name: str | None) -> None:
    """Print the JSON schema of the record NAME, or the names of all records."""
    from xfrustum.reports.common import outputs

    click.echo("\n".join(outputs.schema_names()) if name is None else outputs.schema_text(name))


#: Environment variable in which a shell passes its instruction, such as `bash_source`
#: (docs/commands/index.md).
COMPLETION_VARIABLE = "_XFRUSTUM_COMPLETE"


def invoke(arguments: Sequence[str]) -> int:
    """Run a command and return its exit status; exceptions pass, unlike in click's `main`."""
    for argument in arguments:
        try:
            # Surrogates of undecodable bytes would fail later, in the middle of a written file.
            argument.encode()
        except UnicodeEncodeError as error:  # image files and JSON cannot hold surrogates
            raise click.UsageError(f"{argument} is not UTF-8; use another name") from error
    shell = os.environ.get(COMPLETION_VARIABLE)
    if shell is not None:
        from click.shell_completion import shell_complete

        # The environment variable marks a call by the completion script of a shell.
        if shell_complete(cli, {}, "xfrustum", COMPLETION_VARIABLE, shell) == 0:
            return 0
        shells = "bash_source, zsh_source or fish_source"
        raise click.UsageError(f"{COMPLETION_VARIABLE} is {shell!r}: set it to {shells}")
    try:
        # Click's `main` converts exceptions to exits; a bare context does not.
        with cli.make_context("xfrustum", list(arguments)) as context:
            status = cli.invoke(context)
    except click.exceptions.Exit as ended:
        status = ended.exit_code
    if sys.stdout is not None:
        # Buffered output fails here, under the handlers of `main`, and not at exit.
        sys.stdout.flush()
    return status if isinstance(status, int) else 0
