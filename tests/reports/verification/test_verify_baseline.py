"""`verify --baseline` over the commits of a toy renderer, from the command line."""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from click import Context

from tests.reports.verification.synthetic import commit, repository, verification
from tests.support.scene_file import film, named, part
from xfrustum.cli.app import cli
from xfrustum.cli.main import main

# This library is untyped, and needed here only.
yaml: Any = import_module("yaml")

ACTION = Path(__file__).resolve().parents[3] / "action.yml"

TETRAHEDRON = "v 0 0 1\nv 0.9 0 -0.4\nv -0.5 0.8 -0.4\nv -0.5 -0.8 -0.4\nf 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n"
CENTERS, SCALE = ((4.0, 2.0, 22.0), (-5.0, -3.0, -30.0)), 14.0
SCENE = (
    named("two tetrahedra", "mm")
    + film((40.0, 40.0), hogels=(3, 2), resolution=(40, 40), fov_deg=(60.0, 60.0), reach=(50.0, 60.0))
    + "".join(
        part("x", SCALE, center).replace('shape = "x"', 'mesh = "tetrahedron.obj"') for center in CENTERS
    )
)

RENDERER = '''
"""A toy renderer: every line of every hogel against every triangle; the viewer's first wins."""
import numpy as np
from PIL import Image

NUMBERS = [line.split() for line in open("tetrahedron.obj")]
CORNERS = np.array([line[1:] for line in NUMBERS if line[0] == "v"], dtype=float)
FACES = np.array([line[1:] for line in NUMBERS if line[0] == "f"], dtype=int) - 1
CENTERS, SCALE = ((4.0, 2.0, 22.0), (-5.0, -3.0, -30.0)), 14.0
TRIANGLES = np.concatenate([SCALE * CORNERS[FACES] + center for center in CENTERS])
N, COLUMNS, ROWS, PITCH = 40, 3, 2, (40 / 3, 20.0)
SHIFT = {}

def hogel(i, j):
    shift = SHIFT.get((i, j), 0.0)
    a = np.array([(i + 0.5) * PITCH[0] - 20, 20 - (j + 0.5) * PITCH[1], 0.0])
    place = (2 * np.arange(N) + 1) / N - 1
    u, v = np.meshgrid(place + 2 * shift / N, -place)
    d = np.stack((u * np.tan(np.pi / 6), v * np.tan(np.pi / 6), -np.ones_like(u)), -1)
    first, number = np.full((N, N), np.inf), np.zeros((N, N), dtype=int)
    for index, (p, q, r) in enumerate(TRIANGLES):
        normal = np.cross(q - p, r - p)
        s = (p - a) @ normal / (d @ normal)
        point = a + s[..., None] * d
        inside = np.ones((N, N), dtype=bool)
        for one, two in ((p, q), (q, r), (r, p)):
            inside &= np.cross(two - one, point - one) @ normal >= 0
        seen = inside & (s < first)
        first[seen], number[seen] = s[seen], index + 1
    return number

for j in range(ROWS):
    for i in range(COLUMNS):
        number = hogel(i, j)
        pixels = np.stack((number >> 16, number >> 8 & 255, number & 255), -1).astype(np.uint8)
        Image.fromarray(pixels).save(f"hogels/{i}x{j}.png")
'''

REGRESSION = RENDERER.replace("SHIFT = {}", "SHIFT = {(2, 1): 1.5}")
SUBJECTS = ("A renderer", "Say more", "Sample pixels faster", "Read the mesh once", "Tidy up")


def drawn(folder: Path, program: str, subject: str) -> str:
    """Commit a renderer and let it draw."""
    (folder / "render.py").write_text(f"# {subject}\n{program}")
    name = commit(folder, subject)
    (folder / "hogels").mkdir(exist_ok=True)
    subprocess.run([sys.executable, "render.py"], cwd=folder, check=True)
    return name


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
    repository(tmp_path)
    (tmp_path / ".gitignore").write_text("hogels\n")
    (tmp_path / "tetrahedron.obj").write_text(TETRAHEDRON)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


LINE = ["verify", "scene.toml", "hogels/{i}x{j}.png", "--encoding", "triangle-id", "--quiet"]
KEPT = [*LINE, "--baseline", "kept", "--device", "toy"]


@pytest.mark.slow
def test_over_five_commits_of_a_toy_renderer_one_regression_is_found_named_and_approved(
    toy: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", "summary.md")
    statuses, told, commits = [], [], []
    programs = (RENDERER, RENDERER, REGRESSION, REGRESSION, REGRESSION)
    for subject, program, approved in zip(SUBJECTS, programs, (True, False, False, True, False), strict=True):
        commits.append(drawn(toy, program, subject))
        statuses.append(main([*KEPT, "--json", *(["--approve"] if approved else [])]))
        told.append(json.loads(capsys.readouterr().out)["baseline"])
    assert statuses == [0, 0, 1, 0, 0]
    assert [one["change"] for one in told] == ["new", "same", "worse", "worse", "same"]
    assert [one["commit"] for one in told] == commits
    named_first = told[2]["changes"][0]
    assert (named_first["measure"], named_first["aperture"]) == ("wrong_surfaces", [2, 1])
    assert named_first["now"] > named_first["accepted"] == 0
    assert {tuple(one["aperture"]) for one in told[2]["changes"] if one["aperture"]} == {(2, 1)}
    assert Path("summary.md").read_text().count("### xfrustum verify: two tetrahedra") == 5


def test_the_first_run_says_so_and_the_exit_status_follows_what_was_accepted(
    toy: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The verification is a stand-in, so that nothing is traced; one hogel in three exceeds a limit."""
    wrong: dict[tuple[int, int], int | None] = {(0, 0): 0, (1, 0): 90, (2, 0): 3}
    monkeypatch.setattr(
        "xfrustum.reports.verification.verification.verify", lambda *_, **__: verification(wrong)
    )

    def told(*more: str) -> tuple[int, str]:
        status = main([*KEPT, *more])
        return status, capsys.readouterr().out

    status, text = told()
    assert status == 1
    assert "Baseline: nothing is accepted yet that could be compared; --approve accepts" in text
    status, text = told("--approve")
    assert status == 0
    assert "these measures are the first that are accepted" in text
    status, text = told()
    assert status == 0
    assert "Baseline: as accepted (compared exactly, with one accepted run)." in text
    assert "Not right" in text and "exit status 0: nothing is worse" in text
    assert told("--max-wrong", "1%")[0] == 1
    wrong[2, 0] = None
    status, text = told("--json")
    assert status == 1
    assert json.loads(text)["baseline"]["changes"][0]["measure"] == "missing"
    wrong[2, 0] = 4
    assert told("--baseline-tolerance", "50%")[0] == 0
    assert told("--baseline-tolerance", "10%")[0] == 1


@pytest.mark.parametrize("largest", [0, 512, 64 << 10])
def test_what_fails_on_a_full_disk_leaves_no_approval(
    toy: Path, monkeypatch: pytest.MonkeyPatch, largest: int
) -> None:
    """No file may be larger, as on a full disk: whatever could not be written, nothing is accepted then."""
    monkeypatch.setattr(
        "xfrustum.reports.verification.verification.verify", lambda *_, **__: verification({(0, 0): 0})
    )
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, limits[1]))
    try:
        status = main([*KEPT, "--approve"])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    kept = [path for path in (toy / "kept").rglob("*") if path.is_file()]
    assert status in (0, 2)
    assert len(kept) == (status == 0)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ([*LINE, "--approve"], "--approve is about --baseline DIR"),
        ([*LINE, "--device", "x"], "--device is about --baseline DIR"),
        ([*KEPT, "--repeated"], "give --approve too"),
        ([*KEPT, "--baseline-tolerance", "wrong=3"], "'wrong' is not one of missing, wrong_surfaces"),
        ([*LINE, "--baseline", "scene.toml"], "--baseline scene.toml"),
    ],
)
def test_options_that_mean_nothing_are_refused_before_any_work(
    line: list[str], words: str, toy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line) == 2
    printed = capsys.readouterr()
    assert words in " ".join(printed.err.split())
    assert not (toy / "kept").exists()


def action() -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load(ACTION.read_text())
    return found


def inputs_used(value: Any) -> set[str]:
    """Return the names of the inputs that expressions in an action ask for."""
    return set(re.findall(r"inputs\.([\w-]+)", json.dumps(value)))


def test_the_action_declares_every_input_that_it_uses_and_uses_every_one() -> None:
    found = action()
    assert inputs_used([found["runs"], found["outputs"]]) == set(found["inputs"])
    assert found["runs"]["using"] == "composite"
    assert all(("uses" in step) != ("shell" in step and "run" in step) for step in found["runs"]["steps"])
    assert all("${{" not in step.get("run", "") for step in found["runs"]["steps"])


def test_every_option_of_baselines_is_an_input_of_the_action() -> None:
    verify = cli.get_command(Context(cli), "verify")
    assert verify is not None
    options = {one.name for one in verify.params if "--baseline" in f"{one.opts} {getattr(one, 'help', '')}"}
    assert {"baseline", "approve", "renderer", "device"} <= options
    assert {str(name).removeprefix("baseline_") for name in options} <= set(action()["inputs"])


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"source": "hogels/{i}x{j}.png", "encoding": "triangle-id"}, {"source": "hogels/{i}x{j}.png"}),
        # Nothing is approved, and so nothing is noise.
        ({"source": "hogels/{i}x{j}.png", "repeated": "true"}, {"approve": False, "repeated": False}),
        (
            {
                "command": "build/r --x {x} --y {y} --out {out}",
                "apertures": "0,0;2,1",
                "accept": "orientation",
                "tolerance": "5%",
                "approve": "true",
                "repeated": "true",
                "renderer": "mine; rm -rf",
                "arguments": "--max-wrong 0.5% --timeout '20'",
            },
            {
                "command": "build/r --x {x} --y {y} --out {out}",
                "approve": True,
                "repeated": True,
                "renderer": "mine; rm -rf",
                "max_wrong": 0.005,
                "apertures": ((0, 0), (2, 1)),
                "timeout_s": 20.0,
            },
        ),
    ],
)
def test_the_command_line_of_the_action_is_one_that_verify_accepts(
    given: dict[str, str], expected: dict[str, object], tmp_path: Path
) -> None:
    found = action()
    (step,) = [step for step in found["runs"]["steps"] if step.get("name") == "Verify"]
    defaults = {name: str(one.get("default", "")) for name, one in found["inputs"].items()}
    values = {**defaults, "scene": "scene.toml", "device": "Linux-X64", **given}
    asked = {variable: values[inputs_used(text).pop()] for variable, text in step["env"].items()}
    stand_in = tmp_path / "xfrustum"
    told = "import json, sys\njson.dump(sys.argv[1:], open('words.json', 'w'))\nsys.exit(1)\n"
    stand_in.write_text(f"#!{sys.executable}\n{told}")
    stand_in.chmod(0o755)
    assert step["shell"] == "python"
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        [sys.executable, "-c", step["run"]],
        env={**os.environ, **asked, "PATH": path},
        cwd=tmp_path,
        check=False,
    )
    assert done.returncode == 1, "the exit status of verify is that of the step"
    words = json.loads((tmp_path / "words.json").read_text())
    assert words[0] == "verify"
    verify = cli.get_command(Context(cli), "verify")
    assert verify is not None
    context = verify.make_context("verify", words[1:])
    assert context.params["scene"] == "scene.toml"
    assert (context.params["device"], str(context.params["baseline"])) == ("Linux-X64", "xfrustum-baseline")
    assert {name: context.params[name] for name in expected} == expected
