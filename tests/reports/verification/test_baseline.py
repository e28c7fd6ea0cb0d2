"""A baseline names measures that are worse than the accepted ones, and loses no data."""

import json
import shutil
import subprocess
import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from click import Context

from tests.conftest import CHECKOUT
from tests.reports.verification.synthetic import commit, git, verification
from tests.support.worlds import World
from xfrustum import Baseline, BaselineOptions, InputError, baseline
from xfrustum.cli.app import cli
from xfrustum.cli.main import main
from xfrustum.reports.verification.baseline import (
    ACCEPTED,
    Change,
    Stated,
    append_step_summary,
    commit_of,
    lines,
    sentence,
)

RIGHT = {(0, 0): 3, (1, 0): 0, (2, 0): 5}
WORSE = {(0, 0): 3, (1, 0): 8, (2, 0): 5}


def held(
    folder: Path, wrong: Mapping[tuple[int, int], int | None], p99: float = 0.1, **options: Any
) -> Baseline:
    if "tolerance" in options:
        options["tolerance"] = Stated.from_text(options["tolerance"])
    stated = BaselineOptions(**{"device": "toy", "repository": folder, **options})
    return baseline(verification(wrong, p99), folder / "kept", stated)


def test_over_five_commits_a_regression_is_named_and_approved(tmp_path: Path) -> None:
    runs, commits = [], []
    for wrong, approve in zip(
        (RIGHT, RIGHT, WORSE, WORSE, WORSE), (True, False, False, True, False), strict=True
    ):
        commits.append(commit(tmp_path, "Another"))
        runs.append(held(tmp_path, wrong, approve=approve))
    assert [run.change for run in runs] == ["new", "same", "worse", "worse", "same"]
    assert [run.passed for run in runs] == [True, True, False, True, True]
    assert [run.run.commit for run in runs] == commits
    assert "wrong surfaces of hogel 1,0: 0 accepted, 8 now; and 1 more" in sentence(runs[2])
    assert len(list((tmp_path / "kept" / ACCEPTED).iterdir())) == 1
    assert held(tmp_path, {**WORSE, (1, 0): 7}).change is Change.BETTER


def test_a_repository_of_a_stranger_runs_none_of_its_programs(tmp_path: Path) -> None:
    """`git status` is the control: it runs monitor, hook and filter of the same repository."""
    folder, ran = tmp_path / "repository", tmp_path / "ran"
    folder.mkdir()
    (folder / ".gitattributes").write_text("*.txt filter=foreign\n")
    (folder / "a.txt").write_text("1\n")
    name = commit(folder, "First")
    programs = folder / ".git" / "programs"
    programs.mkdir()
    for program in ("monitor", "filter", "fetch", "post-index-change"):
        (programs / program).write_text(f"#!/bin/sh\necho {program} >> {ran}\ncat\n")
        (programs / program).chmod(0o700)
    for setting, value in (
        ("core.fsmonitor", programs / "monitor"),
        ("core.hooksPath", programs),
        ("filter.foreign.clean", programs / "filter"),
        ("core.sshCommand", programs / "fetch"),
        ("remote.origin.url", "ssh://example.invalid/a"),
        ("remote.origin.promisor", "true"),
    ):
        git(folder, "config", setting, str(value))
    # Equal sizes make git compare the content through the filter.
    (folder / "a.txt").write_text("2\n")
    assert held(folder, RIGHT, approve=True).run.commit == name
    control = shutil.copytree(folder, tmp_path / "control", symlinks=True)
    # As in a partial clone, which fetches missing objects
    shutil.rmtree(folder / ".git" / "objects")
    (folder / ".git" / "objects").mkdir()
    assert commit_of(folder) == name and not ran.exists()
    (control / "a.txt").touch()
    git(control, "status")
    assert {"monitor", "filter", "post-index-change"} <= set(ran.read_text().split())


def test_new_missing_and_other_hogels_and_devices_are_not_compared(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    fine = held(tmp_path, {(0, 0): 3, (1, 0): 0, (3, 0): 2})
    assert fine.passed and "note: 1 accepted hogel not judged now" in lines(fine)
    assert (fine.new_hogels, fine.new_beyond_limits, fine.not_judged_hogels) == (1, 0, 1)
    result = held(tmp_path, {**RIGHT, (3, 0): 900, (4, 0): None, (5, 0): 1})
    assert result.change is Change.SAME and not result.passed
    assert (result.new_hogels, result.new_beyond_limits, result.not_judged_hogels) == (3, 2, 0)
    for wrong, passed in ((2, True), (3, False)):
        tolerance = "wrong_surfaces=2,wrong_pixels=4"
        assert held(tmp_path, {**RIGHT, (1, 0): wrong}, tolerance=tolerance).passed is passed
    other = held(tmp_path, WORSE, device="other")
    assert not other.compared and " on toy (" in lines(other)
    # If one hogel is approved, the others stay accepted.
    held(tmp_path, {(1, 0): 8}, approve=True)
    assert held(tmp_path, WORSE).passed


@pytest.mark.parametrize("content", [b"PAR1", b'{"run": 1}'])
def test_a_file_that_is_no_accepted_run_is_named_and_nothing_is_kept(
    content: bytes, tmp_path: Path
) -> None:
    held(tmp_path, RIGHT, approve=True)
    (tmp_path / "kept" / ACCEPTED / "20260101-damaged.json").write_bytes(content)
    with pytest.raises(InputError, match=r"20260101-damaged\.json: is no accepted run"):
        held(tmp_path, RIGHT, approve=True)
    assert len(list((tmp_path / "kept" / ACCEPTED).iterdir())) == 2


def test_json_and_the_summary_for_github_name_the_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    summary = tmp_path / "summary.md"
    summary.write_text("another step\n")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    held(tmp_path, RIGHT, approve=True)
    result = held(tmp_path, WORSE, p99=0.3)
    assert append_step_summary(result) is None
    text = summary.read_text()
    assert text.startswith("another step\n### xfrustum verify\n\n```\n")
    # A name cannot end the code block, in which markup has no effect.
    assert append_step_summary(held(tmp_path, WORSE, device="a```b <img src=x>")) is None
    assert summary.read_text().removeprefix(text).count("```") == 2
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "nowhere" / "summary.md"))
    assert "was not written" in (append_step_summary(result) or "")
    values = {"accepted": 0.0, "limit": 0.0, "now": 8.0, "change": "worse"}
    change = {"measure": "wrong_surfaces", "aperture": [1, 0]} | values
    assert result.summary()["changes"][0] == change


def test_the_exit_status_follows_the_accepted_runs(
    tiny: World, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stand-in replaces the verification, so that nothing is traced; one hogel of three fails."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
    wrong: dict[tuple[int, int], int | None] = {(0, 0): 0, (1, 0): 90, (2, 0): 3}
    monkeypatch.setattr(
        "xfrustum.reports.verification.verification.verify", lambda *_, **__: verification(wrong)
    )

    def output(status: int, *more: str) -> str:
        line = ["verify", str(tiny.scene_file), "{i}x{j}.png", "--quiet", "--baseline", "kept"]
        assert main([*line, *more]) == status
        return capsys.readouterr().out

    output(1)
    output(0, "--approve")
    assert "Not right" in output(0)
    output(1, "--max-wrong", "1%")
    wrong[2, 0] = None
    assert json.loads(output(1, "--json"))["baseline"]["changes"][0]["measure"] == "missing"
    wrong[2, 0] = 4
    output(0, "--baseline-tolerance", "50%")
    output(1, "--baseline-tolerance", "10%")


def test_the_command_line_of_the_action_is_one_that_verify_accepts(tmp_path: Path) -> None:
    yaml: Any = import_module("yaml")  # untyped, and needed only here
    action = yaml.safe_load((CHECKOUT / "action.yml").read_text())
    (step,) = [step for step in action["runs"]["steps"] if step.get("name") == "Verify"]
    assert step["shell"] == "python"
    values = {name: str(entry.get("default", "")) for name, entry in action["inputs"].items()}
    values |= {"scene": "scene.toml", "device": "Linux-X64", "renderer": "mine; rm -rf"}
    values |= {"command": "build/r --x {x} --out {out}", "tolerance": "5%", "apertures": "0,0;2,1"}
    values |= {"approve": "true", "arguments": "--timeout '20'"}
    env = {name: values[text.split("inputs.")[1].split()[0]] for name, text in step["env"].items()}
    stand_in = tmp_path / "xfrustum"
    program = "import json, sys\njson.dump(sys.argv[1:], open('words.json', 'w'))\nsys.exit(1)\n"
    stand_in.write_text(f"#!{sys.executable}\n{program}")
    stand_in.chmod(0o755)
    line, path = [sys.executable, "-c", step["run"]], {"PATH": f"{tmp_path}:/usr/bin:/bin"}
    done = subprocess.run(line, env=env | path, cwd=tmp_path, check=False)
    assert done.returncode == 1, "the exit status of verify is that of the step"
    verify = cli.get_command(Context(cli), "verify")
    words = json.loads((tmp_path / "words.json").read_text())
    assert words[0] == "verify" and verify is not None
    params = verify.make_context("verify", words[1:]).params
    assert (params["scene"], params["renderer"]) == ("scene.toml", "mine; rm -rf")
    assert params["timeout_s"] == 20 and params["approve"] and params["device"] == "Linux-X64"
