"""Sphinx directive `command-help`: the help of a command as the program prints it.

With no argument it shows the list of commands; with `all`, one section for each command.
"""

from __future__ import annotations

from typing import Any, ClassVar

import click
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from xfrustum.cli.app import cli

WIDTH = 100
"""Characters in a line of the help texts."""


def help_of(words: list[str]) -> str:
    """Return the help of a command; `words` are its name and, if any, that of a subcommand."""
    command: click.Command = cli
    context = click.Context(
        cli, info_name="xfrustum", terminal_width=WIDTH, max_content_width=WIDTH
    )
    for word in words:
        assert isinstance(command, click.Group)
        found = command.get_command(context, word)
        assert found is not None
        command = found
        context = click.Context(
            command, info_name=word, parent=context, terminal_width=WIDTH, max_content_width=WIDTH
        )
    return command.get_help(context)


def all_commands() -> list[list[str]]:
    """Return the words of all commands in the order of the help; subcommands follow their group."""
    found: list[list[str]] = []
    context = click.Context(cli)
    for name in cli.list_commands(context):
        command = cli.get_command(context, name)
        found += [[name], *([name, inner] for inner in getattr(command, "commands", {}))]
    return found


class CommandHelp(SphinxDirective):
    """Directive that shows the help of one command, or of all commands."""

    optional_arguments: ClassVar[int] = 4

    def run(self) -> list[nodes.Node]:
        """Return the text as a literal block, or a section for each command."""
        if self.arguments != ["all"]:
            return [_block(help_of(self.arguments))]
        sections: list[nodes.Node] = []
        for words in all_commands():
            name = " ".join(words)
            section = nodes.section(ids=[nodes.make_id(f"options-{name}")], names=[])
            section += nodes.title(name, name)
            section += _block(help_of(words))
            sections.append(section)
        return sections


def _block(text: str) -> nodes.literal_block:
    return nodes.literal_block(text, text, language="none")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True}
