"""Help: every command has a use and an example; all examples parse and run in order."""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import click
import pytest
import trimesh

from tests.support.commands import Command
from tests.support.scene_file import film, named, part
from xfrustum import reference
from xfrustum.cli.app import COMPLETION_VARIABLE, MODULES, USES, cli
from xfrustum.cli.main import main
from xfrustum.cli.options import TRACERS

CHEAP = ("scenes", "new", "check", "camera")
"""Examples that together take about a second; the slow tests run all others."""

NOT_RUN = ("study", "bench", "conformance")
"""Examples that measure speed, whole maps or a renderer; other tests run smaller versions."""


def commands() -> dict[str, click.Command]:
    """Return every command by name, including the commands in groups."""
    context = click.Context(cli)
    listed: dict[str, click.Command] = {}
    for name in cli.list_commands(context):
        command = cli.get_command(context, name)
        listed[name] = command
        for inner, subcommand in getattr(command, "commands", {}).items():
            listed[f"{name} {inner}"] = subcommand
    return listed


EXAMPLES = {
    name: (command.epilog or "").rpartition("\n")[2].strip() for name, command in commands().items()
}
"""Command lines of a shell, one for each command. Run in this order in a folder with beetle.obj,
they create the files that later lines need.
"""


def words(name: str) -> list[str]:
    """Return the arguments of an example, split as by a shell."""
    program, *arguments = shlex.split(EXAMPLES[name])
    assert program == "xfrustum"
    return arguments


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_help_of_every_command_ends_with_an_example_of_it_that_parses(
    name: str, command: Command
) -> None:
    printed = command(f"{name} --help").out
    # Defaults are values of the option, not names of enumeration members.
    assert re.search(r"\[default: [A-Z_]+\]", printed) is None
    heading, example = printed.rstrip().splitlines()[-2:]
    assert heading == "  Example:"
    assert f"{example} ".startswith(f"    xfrustum {name} ")
    own, arguments = commands()[name], words(name)[len(name.split()) :]
    if isinstance(own, click.Group):
        own, arguments = commands()[f"{name} {arguments[0]}"], arguments[1:]
    own.make_context(name, arguments)


def test_the_list_groups_all_commands_by_use(command: Command) -> None:
    printed = command("--help").out
    assert all(f"\n{use}:\n" in printed for use in USES)
    assert set(MODULES) == {name for name in EXAMPLES if " " not in name}
    assert all(f"\n  {name} " in printed for name in MODULES)


def test_the_names_of_tracers_are_those_of_the_reference() -> None:
    assert tuple(reference.TRACERS) == TRACERS


def run_examples(names: list[str], folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """Run examples in order in a folder with a mesh; return their exit statuses."""
    monkeypatch.chdir(folder)
    trimesh.creation.torus(2.0, 0.7).export("beetle.obj")
    # The example of `verify` starts the program by name, as a shell does.
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
    [("re", "report"), ("report asym", "asymmetric"), ("report car --ti", "")],
)
def test_a_shell_completes_commands_and_scenes(
    line: str, offered: str, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    monkeypatch.setenv(COMPLETION_VARIABLE, "bash_complete")
    monkeypatch.setenv("COMP_WORDS", f"xfrustum {line}")
    monkeypatch.setenv("COMP_CWORD", str(max(1, len(line.split()))))
    assert (f"plain,{offered}" in command("").out.splitlines()) is bool(offered)


def test_an_unknown_shell_is_bad_input(monkeypatch: pytest.MonkeyPatch, command: Command) -> None:
    monkeypatch.setenv(COMPLETION_VARIABLE, "nosuch_source")
    assert "bash_source" in command("", status=2).err


# Help, listings and error messages must appear at once: drawing, tracing and mesh libraries stay
# unloaded.

HEAVY = (
    "trimesh", "scipy", "mitsuba", "drjit", "embreex", "moderngl", "OpenGL", "pyarrow", "plotly",
    "zarr", "jinja2", "PIL", "OpenEXR", "skimage", "matplotlib", "xarray", "distributed",
)  # fmt: skip
"""Libraries that take from a tenth of a second to several seconds to load."""

SCENE = named("boxes", "mm") + film(
    (40.0, 30.0), hogels=(5, 3), resolution=(48, 32), fov_deg=(60.0, 40.0), reach=(50.0, 60.0)
)
FILES = {
    "broken.toml": SCENE.replace("fov_deg", "fovdeg"),
    "none.toml": "= =",
    "meshless.toml": SCENE
    + part("box", 1.0, (0.0, 0.0, 9.0)).replace('shape = "box"', 'mesh = "nosuch.obj"'),
    "unlit.toml": SCENE + '[environment]\nmap = "nosuch.exr"\n',
    "strange.toml": SCENE + '[[object]]\nshape = "bax"\nmaterial = "gold"\n',
}

STRANGE_VALUES = [
    line.split()
    for line in (
        "raster car --near 0.1 --depth d99 --out x.exr",
        "trace car --tracer strange --out x.exr",
        "plate car --near 0.1 --apertures a,b --out x.zarr",
        "verify car x.png --accept strange",
        "compare nosuch.exr nosuch.exr",
        "new nosuch.obj",
        "strange",
    )
]


def loaded_by(lines: Sequence[Sequence[str]], folder: Path, watched: Sequence[str]) -> list[str]:
    """Run command lines in a new process; return the first that loads a watched module."""
    program = f"""
import contextlib, io, sys
from xfrustum.cli.main import main
for line in {[list(line) for line in lines]!r}:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        status = main(line)
    assert status == (0 if "--help" in line or line[0] == "scenes" else 2), (line, status)
    loaded = [name for name in {list(watched)!r} if name in sys.modules]
    if loaded:
        print(*line, *loaded)
        break
"""
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=folder, check=False
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.splitlines()


def of_scene(scene: str) -> list[tuple[str, ...]]:
    """Return the examples of all commands that open a scene, applied to another scene."""
    lines = []
    for name, command in commands().items():
        if any(parameter.name in ("scene", "scenes") for parameter in command.params):
            before = len(name.split())
            lines.append((*name.split(), scene, *words(name)[before + 1 :]))
    return lines


def test_help_listings_and_complaints_load_nothing_heavy_not_even_numpy(tmp_path: Path) -> None:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    files = [line for name in (*FILES, "nosuch.toml") for line in of_scene(name)]
    helped = [(*name.split(), "--help") for name in commands()]
    lines = [("--help",), ("scenes",), *helped, *STRANGE_VALUES, *files]
    assert loaded_by(lines, tmp_path, (*HEAVY, "numpy")) == []
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)


def test_unknown_names_and_the_list_of_hard_cases_load_numpy_alone(tmp_path: Path) -> None:
    lines = [("scenes", "--hard"), *of_scene("nosuch"), *of_scene("hard/nosuch")]
    assert loaded_by(lines, tmp_path, HEAVY) == []
