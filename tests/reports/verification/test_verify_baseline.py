"""`verify --baseline` from the command line, and the action; the verification itself is a stand-in."""

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

from tests.conftest import CHECKOUT
from tests.reports.verification.synthetic import verification
from tests.support.scene_file import film, part
from xfrustum.cli.app import cli
from xfrustum.cli.main import main

# This library is untyped, and needed here only.
yaml: Any = import_module("yaml")


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
    sphere = part("sphere", 14.0, (4.0, 2.0, 22.0))
    (tmp_path / "scene.toml").write_text(film((40, 40), (3, 2), (40, 40), (60, 60), (50, 60)) + sphere)
    return tmp_path


LINE = ["verify", "scene.toml", "hogels/{i}x{j}.png", "--encoding", "triangle-id", "--quiet"]
KEPT = [*LINE, "--baseline", "kept", "--device", "toy"]


def test_the_first_run_says_so_and_the_exit_status_follows_what_was_accepted(
    toy: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The verification is a stand-in, so that nothing is traced; one hogel in three exceeds a limit."""
    wrong: dict[tuple[int, int], int | None] = {(0, 0): 0, (1, 0): 90, (2, 0): 3}
    monkeypatch.setattr(
        "xfrustum.reports.verification.verification.verify", lambda *_, **__: verification(wrong)
    )

    def told(status: int, *more: str) -> str:
        assert main([*KEPT, *more]) == status
        return capsys.readouterr().out

    assert "Baseline: nothing is accepted yet that could be compared; --approve accepts" in told(1)
    assert "these measures are the first that are accepted" in told(0, "--approve")
    text = told(0)
    assert "Baseline: as accepted (compared exactly, with one accepted run)." in text
    assert "Not right" in text and "exit status 0: nothing is worse" in text
    told(1, "--max-wrong", "1%")
    wrong[2, 0] = None
    assert json.loads(told(1, "--json"))["baseline"]["changes"][0]["measure"] == "missing"
    wrong[2, 0] = 4
    told(0, "--baseline-tolerance", "50%")
    told(1, "--baseline-tolerance", "10%")


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


ACTION: dict[str, Any] = yaml.safe_load((CHECKOUT / "action.yml").read_text())
verify = cli.get_command(Context(cli), "verify")


def inputs_used(value: Any) -> set[str]:
    """Return the names of the inputs that expressions in an action ask for."""
    return set(re.findall(r"inputs\.([\w-]+)", json.dumps(value)))


def test_the_action_has_every_input_that_it_uses_and_every_option_of_baselines() -> None:
    runs = ACTION["runs"]
    assert inputs_used([runs, ACTION["outputs"]]) == set(ACTION["inputs"])
    assert runs["using"] == "composite"
    assert all(("uses" in step) != ("shell" in step and "run" in step) for step in runs["steps"])
    assert all("${{" not in step.get("run", "") for step in runs["steps"])
    assert verify is not None
    options = {one.name for one in verify.params if "--baseline" in f"{one.opts} {getattr(one, 'help', '')}"}
    assert {"baseline", "approve", "renderer", "device"} <= options
    assert {str(name).removeprefix("baseline_") for name in options} <= set(ACTION["inputs"])


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"source": "hogels/{i}x{j}.png", "encoding": "triangle-id"}, {"source": "hogels/{i}x{j}.png"}),
        # Nothing is approved, and so nothing is noise.
        ({"source": "hogels/{i}x{j}.png", "repeated": "true"}, {"approve": False, "repeated": False}),
        (
            {"command": "build/r --x {x} --y {y} --out {out}", "renderer": "mine; rm -rf", "tolerance": "5%"}
            | {"apertures": "0,0;2,1", "accept": "orientation", "approve": "true", "repeated": "true"}
            | {"arguments": "--max-wrong 0.5% --timeout '20'"},
            {"command": "build/r --x {x} --y {y} --out {out}", "renderer": "mine; rm -rf", "timeout_s": 20.0}
            | {"approve": True, "repeated": True, "max_wrong": 0.005, "apertures": ((0, 0), (2, 1))},
        ),
    ],
)
def test_the_command_line_of_the_action_is_one_that_verify_accepts(
    given: dict[str, str], expected: dict[str, object], tmp_path: Path
) -> None:
    (step,) = [step for step in ACTION["runs"]["steps"] if step.get("name") == "Verify"]
    defaults = {name: str(one.get("default", "")) for name, one in ACTION["inputs"].items()}
    values = {**defaults, "scene": "scene.toml", "device": "Linux-X64", **given}
    asked = {variable: values[inputs_used(text).pop()] for variable, text in step["env"].items()}
    stand_in = tmp_path / "xfrustum"
    told = "import json, sys\njson.dump(sys.argv[1:], open('words.json', 'w'))\nsys.exit(1)\n"
    stand_in.write_text(f"#!{sys.executable}\n{told}")
    stand_in.chmod(0o755)
    assert step["shell"] == "python"
    env = {**os.environ, **asked, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run([sys.executable, "-c", step["run"]], env=env, cwd=tmp_path, check=False)
    assert done.returncode == 1, "the exit status of verify is that of the step"
    words = json.loads((tmp_path / "words.json").read_text())
    assert words[0] == "verify" and verify is not None
    context = verify.make_context("verify", words[1:])
    assert context.params["scene"] == "scene.toml"
    assert (context.params["device"], str(context.params["baseline"])) == ("Linux-X64", "xfrustum-baseline")
    assert {name: context.params[name] for name in expected} == expected
