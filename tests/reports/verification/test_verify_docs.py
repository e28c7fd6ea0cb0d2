"""The examples of docs/verify.md run, and say what they say they say."""

import itertools
import os
import re
import shlex
import string
import subprocess
import sys
import textwrap
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from tests.support.scene_file import film, named, part
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


RENDERER = """#!{python}
import sys, numpy as np
from PIL import Image
from xfrustum import DoubleFrustum, Rasterizer, open_scene

assert sys.argv[1::2] == ["--x", "--y", "--out"]
x, y, out = sys.argv[2::2]
scene = open_scene("tests/scene.toml")
index = [(i, j) for j in (0,) for i in (0, 1)
         if (scene.plate.aperture(i, j).x, scene.plate.aperture(i, j).y) == (float(x), float(y))][0]
with Rasterizer(scene) as rasterizer:
    number = rasterizer.render(scene.plate.aperture(*index), DoubleFrustum(near=1e-4)).triangle + 1
Image.fromarray(np.stack((number >> 16, number >> 8 & 255, number & 255), -1).astype(np.uint8)).save(out)
"""
SCENE = (
    named("ball", "mm")
    + film((40.0, 40.0), hogels=(2, 1), resolution=(32, 32), fov_deg=(60.0, 60.0), reach=(50.0, 60.0))
    + part("sphere", 30.0, (-4.0, 2.0, -35.0))
)


@pytest.mark.slow
def test_the_job_judges_a_renderer(tmp_path: Path) -> None:
    """The job's pip fetches a checkout; tests/test_wheel.py tests that a checkout installs and runs."""
    (block,) = re.findall(r"^    verify-renderer:\n(?:(?:      .*)?\n)+", DOCS.read_text(), re.MULTILINE)
    (job,) = yaml.safe_load(textwrap.dedent(block)).values()
    install, verify = [step["run"].strip() for step in job["steps"] if "run" in step][-2:]
    words = shlex.split(string.Template(install).substitute(job["env"]))
    assert words[:3] == ["pip", "install", f"git+{job['env']['XFRUSTUM_URL']}@main"]
    (tmp_path / "build").mkdir()
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "scene.toml").write_text(SCENE)
    renderer = tmp_path / "build" / "my-renderer"
    renderer.write_text(RENDERER.format(python=sys.executable))
    renderer.chmod(0o755)
    # The command of this checkout, under the name that an installation gives it.
    command = tmp_path / "xfrustum"
    command.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m xfrustum "$@"\n')
    command.chmod(0o755)
    env = {**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        verify, shell=True, cwd=tmp_path, env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Right: all 2 hogels" in done.stdout
    (kept,) = [step["with"]["path"] for step in job["steps"] if "upload-artifact" in step.get("uses", "")]
    assert kept == "verification\nverify.xml"
    assert all((tmp_path / name).exists() for name in kept.split())
