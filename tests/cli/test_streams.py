"""A command's message is one line of ours, escaped, whatever the standard streams are connected to."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.scene_file import film, part
from xfrustum.cli.main import main
from xfrustum.terminal import one_line, printable

FULL = Path("/dev/full")

HOSTILE = "\x1b]0;owned\x07\x1b[31m\u202e\x9b\x7f"


def run(line: str, folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a line of shell in which X stands for xfrustum."""
    return subprocess.run(
        ["bash", "-c", f'X() {{ "$PYTHON" -m xfrustum "$@"; }}; {line}'],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHON": sys.executable, "TMPDIR": str(folder), **variables},
    )


@given(st.text())
def test_what_is_printed_moves_no_cursor_and_turns_no_text(text: str) -> None:
    shown = printable(text)
    assert not [letter for letter in shown if letter not in "\t\n" and ord(letter) < 0x20]
    assert not set(shown) & set("\x7f\x9b\u202e\u2066\u2028\u200b\udc80")
    shown.encode()
    assert printable(shown) == shown
    assert "\n" not in one_line(text)


def test_plain_text_in_any_language_is_printed_as_it_is_and_other_bytes_as_such() -> None:
    text = "Hologramm für 3 µm, 全息图, здравствуй\n\tzwei"
    assert printable(text) == text
    assert printable(os.fsdecode(b"caf\xe9.exr")) == r"caf\xe9.exr"


def test_control_characters_in_names_are_escaped_in_errors_and_tables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["trace", f"{HOSTILE}.toml", "--out", "x.exr"]) == 2
    assert main(["trace", "car", f"--{HOSTILE}", "--out", "x.exr"]) == 2
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 2
    assert r"\x1b]0;owned\x07\x1b[31m\u202e\x9b\x7f.toml" in printed.err
    assert not set(printed.err) & set(HOSTILE) - set("]0;owned[31m")


def test_control_characters_in_what_a_renderer_says_are_escaped_in_the_table(
    verify_scene: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("0x0.png").write_text("no picture")
    Path("renderer").write_text("import sys\nsys.exit('\\x07all is well \\x7f')\n")
    command = f"{sys.executable} renderer {{out}}"
    line = ["verify", verify_scene, "--command", command, "--apertures", "0,0", "--quiet"]
    assert main(line) == 1
    assert r"\x07all is well \x7f" in capsys.readouterr().out
    assert main([*line, "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert "\x07all is well \x7f" in told["hogels"][0]["problem"]


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
def test_a_full_standard_output_is_status_2_and_one_line(tmp_path: Path) -> None:
    for command in ("scenes", "scenes --json", "--help"):
        done = run(f"X {command} > /dev/full", tmp_path)
        assert done.returncode == 2
        assert done.stderr.startswith("xfrustum: error: standard output: No space left")
        assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("closed", ["2>&-", "2>/dev/full", "2>&- >&- <&-"])
def test_without_standard_error_the_status_still_tells(closed: str, tmp_path: Path) -> None:
    done = run(f"X scenes --no-such-option {closed}; echo $?", tmp_path)
    assert (done.stdout, done.stderr) == ("2\n", "")


def test_a_reader_that_stops_reading_or_a_closed_output_is_no_error(tmp_path: Path) -> None:
    done = run("X scenes --json >&-", tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    done = run("X scenes --json | true; echo ${PIPESTATUS[0]}", tmp_path)
    assert (done.stdout, done.stderr) == ("0\n", "")
    limit = run("X verify no-such-scene x 2>&1 | true; echo ${PIPESTATUS[0]}", tmp_path)
    assert limit.stdout == "2\n"


LIBRARIES = """
import faulthandler, logging, os, sys, warnings
import click, xfrustum.cli.app

def work():
    warnings.warn("deprecated")
    logging.getLogger("trimesh").error("a log line")
    os.write(2, b"words from C\\n")
    {ending}

xfrustum.cli.app.cli.add_command(click.Command("work", callback=work))
from xfrustum.cli.main import run
sys.exit(run())
"""


def test_warnings_and_logs_of_libraries_are_shown_on_request(tmp_path: Path) -> None:
    (tmp_path / "x.py").write_text(LIBRARIES.format(ending="raise KeyError('unexpected')"))
    done = run('"$PYTHON" x.py work', tmp_path)
    first, last = done.stderr.splitlines()
    assert (done.returncode, first) == (70, "words from C")
    assert last.startswith("xfrustum: unexpected error: KeyError: 'unexpected'; its traceback is in ")
    assert "KeyError: 'unexpected'" in Path(last.split()[-1]).read_text()
    shown = run('"$PYTHON" x.py --traceback work', tmp_path)
    assert shown.returncode == 70
    assert all(words in shown.stderr for words in ("deprecated", "a log line", "in work"))


@pytest.mark.parametrize(
    "ending",
    [
        "os.dup2(2, 2); faulthandler._sigsegv()",
        "os.dup2(1, 2); faulthandler._sigsegv()",  # a library has taken standard error for its own text
        "import subprocess; subprocess.run([sys.executable, 'child.py'])",
    ],
)
def test_a_crash_leaves_its_traces_on_standard_error(ending: str, tmp_path: Path) -> None:
    (tmp_path / "child.py").write_text("import faulthandler; faulthandler._sigsegv()")
    (tmp_path / "x.py").write_text(LIBRARIES.format(ending=ending))
    done = run('"$PYTHON" x.py work; exit $?', tmp_path)
    assert "Fatal Python error: Segmentation fault" in done.stderr and "words from C" in done.stderr
    assert "child.py" in ending or (done.returncode == 128 + 11 and "in work" in done.stderr)


def test_no_message_is_longer_than_500_characters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    long = "x" * 3000
    Path("long.toml").write_text(f'{long} = 1\n["{long}"]\n{long} = [')
    Path("keys.toml").write_text(f"name = 'a'\nunits = 'mm'\n{long} = 1\n")
    for command in (
        f"trace {long}",
        f"trace car --aperture {long} --out x.exr",
        f"--{long}",
        long,
        f"verify car {long}",
        f"convert {long} {long}",
        f"report car --depth {long}",
        f"plan car --apertures {long}",
        "trace long.toml --out x.exr",
        "trace keys.toml --out x.exr",
    ):
        assert main(command.split()) == 2, command
        said = capsys.readouterr().err
        assert said.count("\n") == 1 and len(said) <= 501, command


def test_a_mesh_with_a_comment_that_is_no_utf_8_and_a_3mf_mesh_are_read(
    verify_scene: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    import trimesh  # noqa: PLC0415 - heavy

    box = trimesh.creation.box()
    latin = "# gezählt von Müller\n".encode("latin-1")
    Path("box.obj").write_bytes(latin + trimesh.exchange.obj.export_obj(box).encode())
    Path("late.obj").write_bytes(b"#" * 3000 + b"\n" + latin + trimesh.exchange.obj.export_obj(box).encode())
    box.export("box.3mf")
    text = Path(verify_scene).read_text()
    for mesh in ("box.obj", "late.obj", "box.3mf"):
        Path(verify_scene).write_text(text.replace('shape = "box"', f'mesh = "{mesh}"'))
        assert main(["trace", verify_scene, "--quiet", "--out", "x.exr"]) == 0
    assert capfd.readouterr().err == ""


@pytest.fixture
def verify_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    size = film((40.0, 30.0), hogels=(2, 1), resolution=(12, 8), fov_deg=(60.0, 40.0), reach=(50.0, 60.0))
    Path("boxes.toml").write_text(size + part("box", 12.0, (3.0, 1.0, 25.0)))
    return "boxes.toml"
