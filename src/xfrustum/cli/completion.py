"""Completion of commands, options and scenes by the shell (bash, zsh, fish), as click offers it.

A shell asks by running the program with the variable VARIABLE; docs/commands.md says how to switch it on.
"""

from __future__ import annotations

import os

import click
from click.shell_completion import CompletionItem, shell_complete

VARIABLE = "_XFRUSTUM_COMPLETE"
"""Environment variable that holds the instruction of a shell, such as `bash_source`."""


def instruction() -> str | None:
    """Return what a shell asks for, None where the program was started by a person."""
    return os.environ.get(VARIABLE)


def answer(command: click.Command, asked: str) -> int:
    """Print what a shell asks for, and return the exit status.

    Parameters
    ----------
    command
        Command of the whole program.
    asked
        Instruction as `instruction` returns it.

    Raises
    ------
    click.UsageError
        No shell asks so.
    """
    status = shell_complete(command, {}, "xfrustum", VARIABLE, asked)
    if status != 0:
        raise click.UsageError(f"{VARIABLE} is {asked!r}: set it to bash_source, zsh_source or fish_source")
    return status


def scenes(context: click.Context, parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Return a wish for names of files, and the built-in scenes whose names begin like a word."""
    del context, parameter  # click hands over both, and neither matters
    from xfrustum.scenes.library import builtin

    named = [CompletionItem(name) for name in builtin.names() if name.startswith(begun)]
    # Files come first: at their turn click's script for bash forgets the names that it has.
    return [CompletionItem(begun, type="file"), *named]
