"""Help: every command has a use and an example, every example parses, and in their order they run."""

import os
import shlex
import sys
from pathlib import Path

import click
import pytest
import trimesh

from xfrustum import reference
from xfrustum.cli.app import COMPLETION_VARIABLE, MODULES, USES, cli
from xfrustum.cli.main import main
from xfrustum.cli.options import TRACERS

CHEAP = ("scenes", "new", "check", "camera", "explain")
"""Examples that take about a second together; all others run with the slow tests."""

NOT_RUN = ("study", "bench", "conformance")
"""Examples that measure speed, whole maps or a renderer, which tests of these commands run smaller."""


def commands() -> dict[str, click.Command]:
    """Return every command and, of groups, every command in them."""
    context = click.Context(cli)
    found: dict[str, click.Command] = {}
    for name in cli.list_commands(context):
        command = cli.get_command(context, name)
        found[name] = command
        for inner, one in getattr(command, "commands", {}).items():
            found[f"{name} {inner}"] = one
    return found


EXAMPLES = {name: (command.epilog or "").rpartition("\n")[2].strip() for name, command in commands().items()}
"""One line for each command that a shell takes as it is.

Run from top to bottom in a folder that has beetle.obj, each finds what it needs.
"""


def words(name: str) -> list[str]:
    """Return the arguments of an example as a shell splits them."""
    program, *arguments = shlex.split(EXAMPLES[name])
    assert program == "xfrustum"
    return arguments


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_help_of_every_command_ends_with_an_example_of_it_that_parses(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*name.split(), "--help"]) == 0
    heading, example = capsys.readouterr().out.rstrip().splitlines()[-2:]
    assert heading == "  Example:"
    assert f"{example} ".startswith(f"    xfrustum {name} ")
    command, arguments = commands()[name], words(name)[len(name.split()) :]
    if isinstance(command, click.Group):
        inner = commands()[f"{name} {arguments[0]}"]
        inner.make_context(name, arguments[1:])
    else:
        command.make_context(name, arguments)


def test_the_list_of_commands_has_all_of_them_under_their_uses(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    told = capsys.readouterr().out
    assert all(f"\n{use}:\n" in told for use in USES)
    assert set(MODULES) == {name for name in EXAMPLES if " " not in name}
    assert all(f"\n  {name} " in told for name in MODULES)


def test_the_names_of_tracers_are_those_of_the_reference() -> None:
    assert tuple(reference.TRACERS) == TRACERS


def run_examples(names: list[str], folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """Run examples in their order in one folder that has a mesh, and return their exit statuses."""
    monkeypatch.chdir(folder)
    trimesh.creation.torus(2.0, 0.7).export("beetle.obj")
    # The example of `verify` starts the program by its name, as a shell does.
    program = folder / "bin" / "xfrustum"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m xfrustum "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=os.pathsep)
    return {name: main([*words(name)]) for name in names}


def test_cheap_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert set(run_examples(list(CHEAP), tmp_path, monkeypatch).values()) == {0}
    assert {"beetle.toml", "views", "cameras"} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.slow
def test_examples_run_one_after_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = [name for name in EXAMPLES if name.split()[0] not in NOT_RUN]
    assert set(run_examples(names, tmp_path, monkeypatch).values()) == {0}


@pytest.mark.parametrize(
    ("line", "offered"),
    [("", "report"), ("re", "report"), ("report asym", "asymmetric"), ("report car --ti", "")],
)
def test_a_shell_is_told_commands_and_scenes(
    line: str, offered: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(COMPLETION_VARIABLE, "bash_complete")
    monkeypatch.setenv("COMP_WORDS", f"xfrustum {line}")
    monkeypatch.setenv("COMP_CWORD", str(max(1, len(line.split()))))
    assert main([]) == 0
    told = capsys.readouterr().out.splitlines()
    assert (f"plain,{offered}" in told) is bool(offered)


def test_a_shell_that_nobody_knows_is_bad_input(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(COMPLETION_VARIABLE, "nosuch_source")
    assert main([]) == 2
    assert "bash_source" in capsys.readouterr().err
