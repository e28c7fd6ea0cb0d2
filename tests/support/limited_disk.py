"""Commands with a limit on file size, as on a full disk, in a separate process.

The process reads limits and command lines as JSON from standard input. It runs each line with each
limit in an empty folder, and prints the outcomes as JSON. `run` starts the process.
"""

import contextlib
import hashlib
import io
import json
import resource
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from xfrustum.cli.main import main


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Outcome of a command with a limit: hashes of the files that it left, by name."""

    limit: int
    status: int
    error: str
    files: dict[str, str]


def run(arguments: Sequence[str], limits: Sequence[int], folder: Path) -> list[Outcome]:
    """Run a command once with each limit; it writes to the subfolder `out` of `folder`."""
    request = json.dumps({"arguments": list(arguments), "limits": list(limits)})
    program = [sys.executable, "-m", "tests.support.limited_disk", str(folder)]
    checkout = Path(__file__).resolve().parents[2]
    process = subprocess.run(
        program, input=request, capture_output=True, text=True, check=True, cwd=checkout
    )
    return [Outcome(**outcome) for outcome in json.loads(process.stdout)]


def hashes(folder: Path) -> dict[str, str]:
    """Return the hash of every file in a folder; subfolders count, as they may be left over too."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        if path.is_file()
        else ""
        for path in sorted(folder.rglob("*"))
    }


def _outcome(arguments: list[str], limit: int, folder: Path) -> Outcome:
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    error = io.StringIO()
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stderr(error),
        contextlib.redirect_stdout(io.StringIO()),
    ):
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
        try:
            status = main(arguments)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    return Outcome(limit=limit, status=status, error=error.getvalue(), files=hashes(out))


if __name__ == "__main__":
    # A truncated compiled module would go unnoticed, and could not be imported again.
    sys.dont_write_bytecode = True
    request = json.load(sys.stdin)
    outcomes = [
        _outcome(request["arguments"], limit, Path(sys.argv[1])) for limit in request["limits"]
    ]
    json.dump([vars(outcome) for outcome in outcomes], sys.stdout)
