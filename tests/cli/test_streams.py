"""Messages of commands are one escaped line each, with any kind of standard stream."""

import os
import shlex
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.commands import Command
from tests.support.processes import signals_by_default
from xfrustum.process import one_line, printable

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


LETTERS = st.one_of(st.integers(0, 0x2FF), st.integers(0, 0x10FFFF)).map(chr)
"""Characters with surrogates. `st.text` would first sort all letters, for two seconds."""


@given(st.lists(LETTERS).map("".join))
def test_printed_text_moves_no_cursor_and_reverses_no_text(text: str) -> None:
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


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_control_characters_in_names_are_escaped_in_errors(command: Command) -> None:
    messages = [
        command(shlex.join(line), status=2).err
        for line in (
            ["trace", f"{HOSTILE}.toml", "--out", "x.exr"],
            ["trace", "car", f"--{HOSTILE}", "--out", "x.exr"],
        )
    ]
    assert all(message.count("\n") == 1 for message in messages)
    assert r"\x1b]0;owned\x07\x1b[31m\u202e\x9b\x7f.toml" in messages[0]
    assert not set("".join(messages)) & set(HOSTILE) - set("]0;owned[31m")


def test_control_characters_in_a_renderers_output_are_escaped_in_the_table(
    command: Command,
) -> None:
    Path("renderer").write_text("import sys\nsys.exit('\\x07all is well \\x7f')\n")
    renderer = f"{sys.executable} renderer {{out}}"
    line = f"verify hard/only-behind --command '{renderer}' --apertures 0,0 --quiet"
    assert r"\x07all is well \x7f" in command(line, status=1).out
    answer = command(f"{line} --json", status=1).record
    assert "\x07all is well \x7f" in answer["hogels"][0]["problem"]


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
def test_a_full_standard_output_is_status_2_and_one_line(tmp_path: Path) -> None:
    for command in ("scenes --json", "--help"):
        done = run(f"X {command} > /dev/full", tmp_path)
        assert done.returncode == 2
        assert done.stderr.startswith("xfrustum: error: standard output: No space left")
        assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("closed", ["2>/dev/full", "2>&- >&- <&-"])
def test_without_standard_error_the_status_remains(closed: str, tmp_path: Path) -> None:
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
    assert last.startswith(
        "xfrustum: unexpected error: KeyError: 'unexpected'; its traceback is in "
    )
    assert "KeyError: 'unexpected'" in Path(last.split()[-1]).read_text()
    shown = run('"$PYTHON" x.py --traceback work', tmp_path)
    assert shown.returncode == 70
    assert all(words in shown.stderr for words in ("deprecated", "a log line", "in work"))


@pytest.mark.parametrize(
    "ending",
    [
        "os.dup2(2, 2); faulthandler._sigsegv()",
        # a library has redirected standard error for its own text
        "os.dup2(1, 2); faulthandler._sigsegv()",
    ],
)
def test_a_crash_leaves_its_traces_on_standard_error(ending: str, tmp_path: Path) -> None:
    (tmp_path / "x.py").write_text(LIBRARIES.format(ending=ending))
    done = run('"$PYTHON" x.py work; exit $?', tmp_path)
    assert "Fatal Python error: Segmentation fault" in done.stderr and "words from C" in done.stderr
    assert done.returncode == 128 + 11 and "in work" in done.stderr


def test_no_message_is_longer_than_500_characters(command: Command) -> None:
    long = "x" * 3000
    Path("long.toml").write_text(f'{long} = 1\n["{long}"]\n{long} = [')
    Path("keys.toml").write_text(f"name = 'a'\nunits = 'mm'\n{long} = 1\n")
    for line in (
        f"trace {long}",
        long,
        f"report car --depth {long}",
        "trace long.toml --out x.exr",
        "trace keys.toml --out x.exr",
    ):
        message = command(line, status=2).err
        assert message.count("\n") == 1 and len(message) <= 501


# Ctrl-C and SIGTERM at any moment: exit status 130 or 143, one line, no files left.

ENDED = {
    signal.SIGINT: (130, "xfrustum: interrupted\n"),
    signal.SIGTERM: (143, "xfrustum: terminated\n"),
}


def start(arguments: Sequence[str], folder: Path) -> subprocess.Popen[str]:
    (folder / "temporary").mkdir(exist_ok=True)
    return subprocess.Popen(
        [sys.executable, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        env={**os.environ, "TMPDIR": str(folder / "temporary")},
        preexec_fn=signals_by_default,  # noqa: PLW1509 - no threads here
    )


def program(body: str) -> list[str]:
    """Return the arguments of a Python process with an additional command, `work`."""
    return [
        "-c",
        "import sys\n"
        "import click, xfrustum.cli.app\n"
        "def work():\n" + textwrap.indent(textwrap.dedent(body), "    ") + "\n"
        "xfrustum.cli.app.cli.add_command(click.Command('work', callback=work))\n"
        "sys.argv[1:] = ['work']\n"
        "from xfrustum.cli.main import run\n"
        "sys.exit(run())\n",
    ]


BODIES = {
    "a library that turns it into another exception": """
        import time
        print("ready", flush=True)
        try:
            time.sleep(60)
        except BaseException:
            raise RuntimeError("loop body failed") from None
        """,
    "a library that swallows it, once": """
        import time
        print("ready", flush=True)
        try:
            time.sleep(60)
        except BaseException:
            pass
        time.sleep(600)
        """,
    "a block that cleans up": """
        import tempfile, time
        with tempfile.TemporaryDirectory():
            try:
                print("ready", flush=True)
                time.sleep(60)
            finally:
                time.sleep(0.3)
        """,
}


@pytest.mark.parametrize(
    ("stop", "times"), [(signal.SIGINT, 1), pytest.param(signal.SIGTERM, 2, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    "body",
    [
        pytest.param(body, id=name, marks=pytest.mark.slow if n else ())
        for n, (name, body) in enumerate(BODIES.items())
    ],
)
def test_a_signal_ends_the_command_even_if_its_exception_is_caught(
    body: str, stop: signal.Signals, times: int, tmp_path: Path
) -> None:
    with start(program(body), tmp_path) as process:
        assert process.stdout.readline() == "ready\n"
        for _ in range(times):
            process.send_signal(stop)
            time.sleep(0.05)
        try:
            _, message = process.communicate(timeout=60)
        finally:
            process.kill()
    assert (process.returncode, message) == ENDED[stop]
    assert list((tmp_path / "temporary").iterdir()) == []
    assert not (tmp_path / "x.exr").exists()


def test_a_resumed_command_reports_it(tmp_path: Path) -> None:
    line = ["plate", "hard/only-behind", "--near", "0.1", "--quiet", "--out", "x.zarr"]
    with start(["-m", "xfrustum", *line], tmp_path) as process:
        assert "hogels to draw" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        try:
            _, message = process.communicate(timeout=60)
        finally:
            process.kill()
    assert (process.returncode, message) == (
        130,
        "xfrustum: interrupted; the same command continues\n",
    )


MAKING = {
    "a folder is made, and not yet noted": """
        import os, signal, time
        from pathlib import Path
        from xfrustum.scenes import disk as durable
        def made(path, mkdir=Path.mkdir, **how):
            mkdir(path, **how)
            os.kill(os.getpid(), signal.SIGTERM)
        Path.mkdir = made
        with durable.TempPath(Path("."), folder=True):
            time.sleep(60)
        """,
    "a folder is noted, and its block not yet entered": """
        import os, signal, time
        from pathlib import Path
        from xfrustum.scenes import disk as durable
        class Made(durable.TempPath):
            def __init__(self):
                super().__init__(Path("."), folder=True)
                os.kill(os.getpid(), signal.SIGTERM)
        with Made():
            time.sleep(60)
        """,
}


@pytest.mark.parametrize("body", MAKING.values(), ids=MAKING)
def test_a_signal_removes_unfinished_outputs(body: str, tmp_path: Path) -> None:
    with start(program(body), tmp_path) as process:
        _, message = process.communicate(timeout=60)
    assert (process.returncode, message) == ENDED[signal.SIGTERM]
    assert [path.name for path in tmp_path.iterdir()] == ["temporary"]


def test_a_signal_while_a_renderer_is_started_ends_the_renderer_too(tmp_path: Path) -> None:
    body = f"""
        import os, signal, subprocess
        from pathlib import Path
        from types import SimpleNamespace
        from xfrustum.reports.verification.sources import Command
        def started(*arguments, start=subprocess.Popen, **options):
            process = start(*arguments, **options)
            print(process.pid, flush=True)
            os.kill(os.getpid(), signal.SIGTERM)
            return process
        subprocess.Popen = started
        template = {sys.executable!r} + " -c 'import time; time.sleep(60)' {{out}}"
        command = Command(
            template=template, reference=None, encoding=None, folder=Path("."), timeout_s=60.0
        )
        command.image(SimpleNamespace(column=0, row=0, x=0.0, y=0.0))
        """
    with start(program(body), tmp_path) as process:
        out, message = process.communicate(timeout=60)
    assert (process.returncode, message) == ENDED[signal.SIGTERM]
    with pytest.raises(ProcessLookupError):
        os.kill(int(out), signal.SIGKILL)


def test_a_signal_while_python_exits_changes_nothing(tmp_path: Path) -> None:
    """The command is done: its exit status stands, and Python exits without an exception."""
    leaving = (
        "import atexit, time\n"
        "atexit.register(lambda: (print('ready', flush=True), time.sleep(0.3)))\n"
    )
    command = "import sys\nsys.argv[1:] = ['scenes']\nfrom xfrustum.cli.main import run\n"
    for stop in ENDED:
        with start(["-c", f"{leaving}{command}sys.exit(run())"], tmp_path) as process:
            while process.stdout.readline() != "ready\n":
                pass
            process.send_signal(stop)
            _, message = process.communicate(timeout=60)
        assert (process.returncode, message) == (0, "")


def test_a_background_job_ignores_ctrl_c_as_its_shell_set(tmp_path: Path) -> None:
    arguments = program(
        "import time\nprint('ready', flush=True)\ntime.sleep(0.3)\nraise KeyError('went on')"
    )
    ignoring = (
        "import os, signal\n"
        "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        f"os.execv({sys.executable!r}, {[sys.executable, *arguments]!r})\n"
    )
    with start(["-c", ignoring], tmp_path) as process:
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGINT)
        _, message = process.communicate(timeout=60)
    assert process.returncode == 70 and "went on" in message
