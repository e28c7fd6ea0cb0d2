"""One input in a separate process, forked after all imports, with limits and checks.

The child runs the users' program, `xfrustum.__main__.run`, with the input's command line. Standard
streams are captured, output of libraries is discarded, and the exit status is the program's.
"""

import os
import re
import resource
import select
import signal
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

HANG_S = 120.0
"""Seconds after which a command for one small input counts as hanging. Some commands take six
seconds of CPU time, and many run side by side.
"""

WRITTEN_BYTES = 1 << 26  # bytes of the largest file that a command may write for an input
FORKED, CRASHED = 99, 98
"""Exit statuses that no command has: the child failed to run its command, or it raised."""


STATUSES = frozenset({0, 1, 2})  # exit statuses of a command that no signal ends
MEMORY_BYTES = 2 << 30  # memory limit for small inputs
PREFIX = b"xfrustum: "  # beginning of every line that a command writes to standard error


BAR = re.compile(rb"[a-z0-9 ]+: +\d+%\|.*")  # a progress bar, which is not a message


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The outcome of one command."""

    status: int  #: exit status, or minus the number of the signal that ended the command
    errors: bytes  #: Text on standard error
    peak_bytes: int  #: Largest memory of the process, bytes
    hung: bool  #: whether the command was ended after `HANG_S`
    left: frozenset[str]  #: names of new files and folders at the top of the command's folder


def outcome_of(command: tuple[str, ...], files: Mapping[str, bytes]) -> Outcome:
    """Run a command of `xfrustum` in a folder with some files, in a forked process."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        folder = Path(name) / "here"
        logs = Path(name)
        for file, data in files.items():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).write_bytes(data)
        before = set(os.listdir(folder))
        process = os.fork()
        if process == 0:
            _become(command, folder, logs)
        ended = os.pidfd_open(process)
        hung = not select.select([ended], [], [], HANG_S)[0]
        os.close(ended)
        if hung:
            os.killpg(process, signal.SIGKILL)
        _, status, usage = os.wait4(process, 0)
        return Outcome(
            status=os.waitstatus_to_exitcode(status),
            errors=(logs / "stderr").read_bytes(),
            peak_bytes=usage.ru_maxrss * 1024,
            hung=hung,
            left=frozenset(set(os.listdir(folder)) - before),
        )


def _become(command: tuple[str, ...], folder: Path, logs: Path) -> None:
    """Run a command in this child process, and end the process."""
    status = FORKED
    try:
        os.setsid()
        os.chdir(folder)
        for descriptor, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(os.open(logs / name, os.O_CREAT | os.O_WRONLY, 0o600), descriptor)
        sys.stdin.close()
        resource.setrlimit(resource.RLIMIT_FSIZE, (WRITTEN_BYTES, WRITTEN_BYTES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        sys.argv = ["xfrustum", *command]
        # Import in the child, so that an import error ends it with the status `FORKED`.
        from tests.fuzz.entries import ENTRIES
        from xfrustum.cli.app import cli
        from xfrustum.cli.main import run

        of_program, own = cli.get_command, {entry.name: entry for entry in ENTRIES}
        cli.get_command = (  # type: ignore[method-assign]
            lambda ctx, cmd_name: own.get(cmd_name) or of_program(ctx, cmd_name)
        )
        status = CRASHED
        status = run()
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else 1
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def findings(outcome: Outcome, outputs: frozenset[str], *, named: bool) -> Iterator[str]:
    """Yield the defects of an outcome, one word each.

    `outputs` are the files that the command may leave if it ends with 0 or 1. They are compared by
    name if the command line is unchanged (`named`).
    """
    if outcome.hung:
        yield "hang"
    elif outcome.status < 0:
        yield f"signal-{-outcome.status}"
    elif outcome.status not in STATUSES:
        yield f"status-{outcome.status}"
    if b"Traceback" in outcome.errors:
        yield "traceback"
    lines = [
        line
        for line in re.split(rb"[\r\n]+", outcome.errors)
        if line.strip() and not BAR.fullmatch(line)
    ]
    if any(not line.startswith(PREFIX) for line in lines) and b"Traceback" not in outcome.errors:
        yield "foreign-words"
    if outcome.status == 2 and sum(line.startswith(PREFIX + b"error") for line in lines) != 1:
        yield "not-one-line"
    if any(byte < 32 for line in lines for byte in line):
        yield "control-characters"
    if outcome.peak_bytes > MEMORY_BYTES:
        yield "memory"
    left = outcome.left - (outputs if outcome.status in (0, 1) else frozenset())
    if any(name.startswith(".") for name in left) or (left and named):
        yield "leftovers"
