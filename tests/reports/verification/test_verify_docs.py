"""The examples of docs/verify.md run, and say what they say they say."""

import itertools
import re
import shlex
import string
import textwrap
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from click import Context

from xfrustum.cli.app import cli
from xfrustum.compare.diagnosis import faults
from xfrustum.compare.diagnosis.encodings import ENCODING_FAULTS
from xfrustum.compare.diagnosis.faults import HYPOTHESES
from xfrustum.compare.renderer_model import drawn_model
from xfrustum.compare.renderer_model.drawn_model import DrawnModel, OneCamera

# This library is untyped, and needed here only.
yaml: Any = import_module("yaml")

DOCS = Path(__file__).resolve().parents[3] / "docs" / "verify.md"


@pytest.mark.slow
def test_the_examples_in_python_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.DOTALL)
    assert len(blocks) == 3
    names: dict[str, Any] = {}
    results = []
    for block in blocks:
        exec(compile(block, str(DOCS), "exec"), names)
        results.append(names["found"])
    function, files, command = results
    assert not function.passed
    assert [fault.fault for fault in function.diagnosis.faults] == ["near"]
    assert files.passed
    assert command.passed


def test_every_fault_is_in_the_table() -> None:
    text = DOCS.read_text()
    known = {value for name, value in vars(faults).items() if name.isupper() and isinstance(value, str)}
    known |= {one.fault for one in HYPOTHESES} | set(drawn_model.FAULT_NAMES)
    for side, name in itertools.product((-1, 1), drawn_model.FAULT_NAMES):
        known.add(faults.one_camera_name(name, DrawnModel(one_camera=OneCamera(side))))
    assert len(known) == 50
    assert [name for name in (*known, *ENCODING_FAULTS) if f"`{name}`" not in text] == []


def test_the_job_gives_verify_a_command_line_that_it_takes() -> None:
    """The job's pip fetches a checkout; tests/test_wheel.py tests that a checkout installs and runs."""
    (block,) = re.findall(r"^    verify-renderer:\n(?:(?:      .*)?\n)+", DOCS.read_text(), re.MULTILINE)
    (job,) = yaml.safe_load(textwrap.dedent(block)).values()
    install, line = [step["run"].strip() for step in job["steps"] if "run" in step][-2:]
    words = shlex.split(string.Template(install).substitute(job["env"]))
    assert words[:3] == ["pip", "install", f"git+{job['env']['XFRUSTUM_URL']}@main"]
    program, name, *words = shlex.split(line.replace("\\\n", " "))
    command = cli.get_command(Context(cli), name)
    assert (program, name) == ("xfrustum", "verify") and command is not None
    asked = command.make_context("verify", words).params
    (kept,) = [step["with"]["path"] for step in job["steps"] if "upload-artifact" in step.get("uses", "")]
    assert kept.split() == [str(asked["out"]), str(asked["junit"])]
