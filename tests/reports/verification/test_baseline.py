"""A baseline tells what got worse since what was accepted, and loses nothing."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from click import Context

from tests.conftest import CHECKOUT
from tests.reports.verification.synthetic import commit, git, verification
from tests.support.scene_file import film, part
from xfrustum.cli.app import cli
from xfrustum.cli.main import main
from xfrustum.reports.verification.baseline import (
    ACCEPTED,
    Baseline,
    BaselineOptions,
    Change,
    Stated,
    accepted_runs,
    append_step_summary,
    baseline,
    commit_of,
    lines,
    measures,
    sentence,
)
from xfrustum.scenes.errors import InputError

RIGHT = {(0, 0): 3, (1, 0): 0, (2, 0): 5}
WORSE = {(0, 0): 3, (1, 0): 8, (2, 0): 5}


def held(
    folder: Path, wrong: Mapping[tuple[int, int], int | None], p99: float = 0.1, **options: Any
) -> Baseline:
    if "tolerance" in options:
        options["tolerance"] = Stated.from_text(options["tolerance"])
    asked = BaselineOptions(**{"device": "toy", "repository": folder, **options})
    return baseline(verification(wrong, p99), folder / "kept", asked)


def test_over_five_commits_a_regression_is_found_named_and_approved(tmp_path: Path) -> None:
    runs, commits = [], []
    for wrong, approve in (
        (RIGHT, True),
        (RIGHT, False),
        (WORSE, False),
        (WORSE, True),
        (WORSE, False),
    ):
        commits.append(commit(tmp_path, "Another"))
        runs.append(held(tmp_path, wrong, approve=approve))
    assert [one.change for one in runs] == ["new", "same", "worse", "worse", "same"]
    assert [one.passed for one in runs] == [True, True, False, True, True]
    assert [one.run.commit for one in runs] == commits
    assert sentence(runs[2]) == (
        "Baseline: worse than accepted: wrong surfaces of hogel 1,0: 0 accepted, 8 now; and 1 more "
        "(compared exactly, with one accepted run)."
    )
    assert len(list((tmp_path / "kept" / ACCEPTED).iterdir())) == 2


def test_a_repository_of_a_stranger_runs_none_of_its_programs(tmp_path: Path) -> None:
    """`git status` is the control: it runs the monitor, the hook and the filter of the same repository."""
    folder, ran = tmp_path / "repository", tmp_path / "ran"
    folder.mkdir()
    (folder / ".gitattributes").write_text("*.txt filter=foreign\n")
    (folder / "a.txt").write_text("one\n")
    name = commit(folder, "One")
    programs = folder / ".git" / "programs"
    programs.mkdir()
    for program in ("monitor", "filter", "fetch", "post-index-change"):
        (programs / program).write_text(f"#!/bin/sh\necho {program} >> {ran}\ncat\n")
        (programs / program).chmod(0o700)
    settings = {
        "core.fsmonitor": programs / "monitor",
        "core.hooksPath": programs,
        "filter.foreign.clean": programs / "filter",
        "core.sshCommand": programs / "fetch",
        "remote.origin.url": "ssh://example.invalid/a",
        "remote.origin.promisor": "true",
    }
    for setting, value in settings.items():
        git(folder, "config", setting, str(value))

    (folder / "a.txt").write_text(
        "two\n"
    )  # of the same size: git compares the content, by way of the filter
    assert held(folder, RIGHT, approve=True).run.commit == name
    control = shutil.copytree(folder, tmp_path / "control", symlinks=True)
    # As in a clone that fetches what it lacks.
    shutil.rmtree(folder / ".git" / "objects")
    (folder / ".git" / "objects").mkdir()
    assert commit_of(folder) == name
    assert not ran.exists()

    (control / "a.txt").touch()
    git(control, "status")
    assert {"monitor", "filter", "post-index-change"} <= set(ran.read_text().split())


def test_runs_kept_at_once_are_all_kept_and_read_as_they_were(tmp_path: Path) -> None:
    with ThreadPoolExecutor(3) as pool:
        found = list(pool.map(lambda _: held(tmp_path, RIGHT, approve=True), range(3)))
    held(tmp_path, WORSE)
    kept = accepted_runs(tmp_path / "kept")
    assert len(kept) == 3 and all(one.run in kept for one in found)
    counts = [measures(one)["wrong_surfaces"] for one in kept[0].hogels.values()]
    assert counts == [3.0, 0.0, 5.0]
    assert held(tmp_path, RIGHT).change is Change.SAME


def test_worse_is_what_exceeds_repeated_runs_by_more_than_their_spread(tmp_path: Path) -> None:
    for wrong in (40, 44, 38, 41, 43):
        held(tmp_path, {(0, 0): wrong}, approve=True, repeated=True)
    same = held(tmp_path, {(0, 0): 50})
    assert same.passed and "beyond the spread of 5 accepted runs" in sentence(same)
    worse = held(tmp_path, {(0, 0): 51})
    assert not worse.passed
    assert worse.of_kind(Change.WORSE)[0].limit == 44 + 6
    assert held(tmp_path, {(0, 0): 31}).change is Change.BETTER
    # What is approved without saying that it is repeated begins anew.
    held(tmp_path, {(0, 0): 90}, approve=True)
    assert held(tmp_path, {(0, 0): 90}).accepted_runs == 1
    assert not held(tmp_path, {(0, 0): 91}).passed


def test_a_hogel_whose_runs_are_alike_by_chance_has_the_spread_of_all(tmp_path: Path) -> None:
    for column in (3, 7):
        held(tmp_path, {(0, 0): 5, (1, 0): column, (2, 0): column}, approve=True, repeated=True)
    # The root of the mean square of 0, 4 and 4 is 3.27.
    for wrong, passed in ((8, True), (9, False)):
        assert held(tmp_path, {(0, 0): wrong, (1, 0): 7, (2, 0): 7}).passed is passed


def test_what_is_worse_at_the_same_commit_is_no_noise_unless_the_user_says_so(
    tmp_path: Path,
) -> None:
    """A clean commit may have been built by another compiler: its 5,000 wrong pixels are not forgiven."""
    commit(tmp_path, "A renderer")
    held(tmp_path, {(0, 0): 40}, approve=True)
    worse = held(tmp_path, {(0, 0): 500}, approve=True)
    assert "a run of this commit is accepted" in lines(worse)
    assert not held(tmp_path, {(0, 0): 501}).passed
    held(tmp_path, {(0, 0): 503}, approve=True, repeated=True)
    noisy = held(tmp_path, {(0, 0): 501})
    assert noisy.passed and noisy.accepted_runs == 2


def test_of_states_that_two_branches_accepted_the_later_one_counts(tmp_path: Path) -> None:
    """After a merge, what differs between the two is no noise."""
    held(tmp_path, {(0, 0): 10}, approve=True)
    shutil.copytree(tmp_path / "kept", tmp_path / "other" / "kept")
    for branch, wrong in ((tmp_path, 12), (tmp_path / "other", 40)):
        held(branch, {(0, 0): wrong}, approve=True)
    for path in (tmp_path / "other" / "kept" / ACCEPTED).iterdir():
        shutil.copy(path, tmp_path / "kept" / ACCEPTED)
    merged = held(tmp_path, {(0, 0): 40})
    assert merged.change is Change.SAME and merged.accepted_runs == 1
    assert not held(tmp_path, {(0, 0): 41}).passed


def test_new_hogels_are_held_to_the_limits_and_all_that_is_not_compared_is_counted(
    tmp_path: Path,
) -> None:
    held(tmp_path, RIGHT, approve=True)
    fine = held(tmp_path, {(0, 0): 3, (1, 0): 0, (3, 0): 2})
    told = "note: Not compared: 1 hogel not accepted before; 1 hogel accepted, and not judged now."
    assert fine.passed and told in lines(fine)
    found = held(tmp_path, {**RIGHT, (3, 0): 900, (4, 0): None, (5, 0): 1})
    assert found.change is Change.SAME and not found.passed
    assert "3 hogels not accepted before, 2 of them beyond the limits" in lines(found)
    counts = [found.summary()[f"{name}_hogels"] for name in ("new", "not_judged")]
    assert (counts, found.summary()["new_beyond_limits"]) == ([3, 0], 2)
    assert held(tmp_path, {**RIGHT, (3, 0): 900}, approve=True).passed


def test_approving_some_hogels_leaves_the_others_accepted(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    held(tmp_path, {(1, 0): 8}, approve=True)
    assert held(tmp_path, WORSE).passed
    again = held(tmp_path, {**WORSE, (2, 0): 6})
    assert [one.aperture for one in again.of_kind(Change.WORSE)] == [(2, 0), (2, 0)]


def test_a_missing_hogel_is_told_and_a_stated_tolerance_holds(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    gone = held(tmp_path, {**RIGHT, (2, 0): None})
    assert "missing hogels of hogel 2,0: 0 accepted, 1 now" in lines(gone)
    assert held(tmp_path, {**RIGHT, (1, 0): 2}, tolerance="wrong_surfaces=2,wrong_pixels=4").passed
    assert not held(
        tmp_path, {**RIGHT, (1, 0): 3}, tolerance="wrong_surfaces=2,wrong_pixels=4"
    ).passed


def test_other_devices_and_options_are_new_and_what_is_accepted_is_named(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    other = held(tmp_path, WORSE, device="other")
    assert other.change is Change.NEW and not other.compared
    told = lines(other)
    assert "measures are accepted for hogels/{i}x{j}.png on toy (compare color" in told
    assert "what is judged now is hogels/{i}x{j}.png on other (compare color" in told
    assert not held(tmp_path, RIGHT, encoding="object-id").compared


@pytest.mark.parametrize("content", [b"", b"PAR1", b'{"run": 1}'])
def test_what_is_no_accepted_run_is_named_and_nothing_is_kept(
    content: bytes, tmp_path: Path
) -> None:
    held(tmp_path, RIGHT, approve=True)
    (tmp_path / "kept" / ACCEPTED / "20260101-damaged.json").write_bytes(content)
    with pytest.raises(
        InputError, match=r"20260101-damaged\.json: is no accepted run of this version"
    ):
        held(tmp_path, RIGHT, approve=True)
    assert len(list((tmp_path / "kept" / ACCEPTED).iterdir())) == 2


def test_the_summary_for_github_is_appended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    summary = tmp_path / "summary.md"
    summary.write_text("what another step wrote\n")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    held(tmp_path, RIGHT, approve=True)
    found = held(tmp_path, WORSE)
    assert append_step_summary(found) is None
    text = summary.read_text()
    assert text.startswith("what another step wrote\n### xfrustum verify\n\n```\nasymmetric: ")
    assert "Baseline: worse than accepted: wrong surfaces of hogel 1,0: 0 accepted, 8 now" in text
    assert "  worse: wrong surfaces of hogel 1,0: 0 accepted, 8 now" in text.splitlines()
    # No name ends the block of code, in which nothing is markup.
    assert append_step_summary(held(tmp_path, WORSE, device="a```b <img src=x>")) is None
    added = summary.read_text().removeprefix(text)
    assert added.count("```") == 2 and added.endswith("\n```\n") and "on ab <img src=x>," in added
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "nowhere" / "summary.md"))
    assert "was not written" in (append_step_summary(found) or "")
    monkeypatch.delenv("GITHUB_STEP_SUMMARY")
    assert append_step_summary(found) is None


def test_the_json_object_names_what_changed(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    told = json.loads(json.dumps(held(tmp_path, WORSE, p99=0.3).summary(), allow_nan=False))
    assert (told["change"], told["approved"], told["accepted_runs"]) == ("worse", False, 1)
    values = {"accepted": 0.0, "limit": 0.0, "now": 8.0}
    what = {"measure": "wrong_surfaces", "aperture": [1, 0], "change": "worse"}
    assert told["changes"][0] == what | values
    displacements = {f"displacement_{name}_px" for name in ("rms", "p99", "max")}
    assert {one["measure"] for one in told["changes"]} == {
        "wrong_surfaces",
        "wrong_pixels",
        *displacements,
    }


# `verify --baseline` from the command line, and the action; the verification itself is a stand-in.

# This library is untyped, and needed here only.
yaml: Any = import_module("yaml")


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
    sphere = part("sphere", 14.0, (4.0, 2.0, 22.0))
    (tmp_path / "scene.toml").write_text(
        film((40, 40), (3, 2), (40, 40), (60, 60), (50, 60)) + sphere
    )
    return tmp_path


LINE = ["verify", "scene.toml", "hogels/{i}x{j}.png", "--encoding", "triangle-id", "--quiet"]
KEPT = [*LINE, "--baseline", "kept", "--baseline-device", "toy"]


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
    options = {
        one.name
        for one in verify.params
        if "--baseline" in f"{one.opts} {getattr(one, 'help', '')}"
    }
    assert {"baseline", "approve", "renderer", "device"} <= options
    assert {str(name).removeprefix("baseline_") for name in options} <= set(ACTION["inputs"])


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        # Nothing is approved, and so nothing is noise.
        (
            {"source": "hogels/{i}x{j}.png", "repeated": "true"},
            {"approve": False, "repeated": False},
        ),
        (
            {
                "command": "build/r --x {x} --y {y} --out {out}",
                "renderer": "mine; rm -rf",
                "tolerance": "5%",
            }
            | {
                "apertures": "0,0;2,1",
                "accept": "orientation",
                "approve": "true",
                "repeated": "true",
            }
            | {"arguments": "--max-wrong 0.5% --timeout '20'"},
            {
                "command": "build/r --x {x} --y {y} --out {out}",
                "renderer": "mine; rm -rf",
                "timeout_s": 20.0,
            }
            | {
                "approve": True,
                "repeated": True,
                "max_wrong": 0.005,
                "apertures": (((0, 0), (0, 0)), ((2, 2), (1, 1))),
            },
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
    assert (context.params["device"], str(context.params["baseline"])) == (
        "Linux-X64",
        "xfrustum-baseline",
    )
    assert {name: context.params[name] for name in expected} == expected
