"""Steps of the set-up: one line with a time for each, and what a step printed only where it failed."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

TOP = Path(__file__).resolve().parents[2]
SCRIPTS = TOP / "scripts"


def steps(program: str) -> subprocess.CompletedProcess[str]:
    """Run a program of the shell after the functions of the set-up."""
    script = f"set -euo pipefail; source '{SCRIPTS / 'steps.sh'}'; {program}"
    return subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)


def test_a_step_is_one_line_with_its_time() -> None:
    done = steps("step 'say it' echo nobody reads this")
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(r"  say it +\d+\.\d s\n", done.stdout)


def test_a_step_that_fails_shows_what_it_printed_and_ends_the_script() -> None:
    done = steps("step 'try it' bash -c 'echo the reason; exit 3'; echo never")
    assert done.returncode == 3
    assert done.stderr == "the reason\n"
    assert re.fullmatch(r"  try it +failed\n", done.stdout)


def test_the_tests_that_the_makefile_names_are_there() -> None:
    for path, name in re.findall(r"(tests/[\w./]+)(?:::(\w+))?", (TOP / "Makefile").read_text()):
        assert (TOP / path).exists(), path
        assert not name or f"def {name}(" in (TOP / path).read_text(), name
