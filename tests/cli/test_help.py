"""Help: every command has a use and an example, every example parses, and in their order they run."""

from __future__ import annotations

import os
import shlex
import sys
from pathlib import Path

import click
import pytest
import trimesh

from xfrustum.cli import completion
from xfrustum.cli.app import cli
from xfrustum.cli.help import EXAMPLES, OTHERS, USES
from xfrustum.cli.main import main

CHEAP = ("scenes", "new", "check", "camera", "explain")
"""Examples that take about a second together; all others run with the slow tests."""

NOT_RUN = ("study", "bench", "bench truth", "bench judge", "bench table1")
"""Examples that measure speed or whole maps, which the tests of these commands run at smaller sizes."""


def words(name: str) -> list[str]:
    """Return the arguments of an example as a shell splits them."""
    program, *arguments = shlex.split(EXAMPLES[name])
    assert program == "xfrustum"
    return arguments


def parsed(arguments: list[str]) -> str:
    """Parse a command line without running it, and return the name of the command."""
    group: click.Command = cli
    context = cli.make_context("xfrustum", list(arguments))
    names = []
    while isinstance(group, click.Group):
        name, found, arguments = group.resolve_command(context, [*context._protected_args, *context.args])
        assert name is not None and found is not None
        group = found
        names.append(name)
        context = group.make_context(name, list(arguments), parent=context)
    return " ".join(names)


def test_every_command_has_one_use_and_an_example() -> None:
    listed = [name for use in USES for name in use.commands]
    assert sorted(listed) == sorted(cli.commands)
    assert set(cli.commands) <= set(EXAMPLES)


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_one_of_its_command_and_parses(name: str) -> None:
    assert parsed(words(name)).startswith(name)


def test_the_help_of_every_command_ends_with_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    for name, command in cli.commands.items():
        for called in ([name], *([name, inner] for inner in getattr(command, "commands", {}))):
            assert main([*called, "--help"]) == 0
            last = capsys.readouterr().out.rstrip().splitlines()[-2:]
            assert last[0] == "  Example:", called
            assert f"{last[1]} ".startswith(f"    xfrustum {name} "), called


def test_the_list_of_commands_has_all_of_them_under_their_uses(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    told = capsys.readouterr().out
    assert [use.title for use in USES] == [use.title for use in USES if f"\n{use.title}:\n" in told]
    assert f"\n{OTHERS}:" not in told
    assert all(f"\n  {name} " in told for name in cli.commands)


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
    names = [name for name in EXAMPLES if name not in NOT_RUN]
    assert set(run_examples(names, tmp_path, monkeypatch).values()) == {0}


@pytest.mark.parametrize(
    ("line", "offered"),
    [("", "report"), ("re", "report"), ("report asym", "asymmetric"), ("report car --ti", "")],
)
def test_a_shell_is_told_commands_and_scenes(
    line: str, offered: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(completion.VARIABLE, "bash_complete")
    monkeypatch.setenv("COMP_WORDS", f"xfrustum {line}")
    monkeypatch.setenv("COMP_CWORD", str(max(1, len(line.split()))))
    assert main([]) == 0
    told = capsys.readouterr().out.splitlines()
    assert (f"plain,{offered}" in told) is bool(offered)


def test_a_shell_that_nobody_knows_is_bad_input(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(completion.VARIABLE, "nosuch_source")
    assert main([]) == 2
    assert "bash_source" in capsys.readouterr().err
