"""A baseline tells what got worse since what was accepted, and loses nothing."""

import json
import shutil
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.reports.verification.synthetic import commit, verification
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
    sentence,
)
from xfrustum.scenes.errors import InputError

RIGHT = {(0, 0): 3, (1, 0): 0, (2, 0): 5}
WORSE = {(0, 0): 3, (1, 0): 8, (2, 0): 5}


def held(
    folder: Path, wrong: Mapping[tuple[int, int], int | None], p99: float = 0.1, **options: Any
) -> Baseline:
    if "tolerance" in options:
        options["tolerance"] = Stated.of(options["tolerance"])
    asked = BaselineOptions(**{"device": "toy", "repository": folder, **options})
    return baseline(verification(wrong, p99), folder / "kept", asked)


def test_over_five_commits_a_regression_is_found_named_and_approved(tmp_path: Path) -> None:
    runs, commits = [], []
    for wrong, approve in ((RIGHT, True), (RIGHT, False), (WORSE, False), (WORSE, True), (WORSE, False)):
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
    (tmp_path / "renderer.py").write_text("pass")
    name = commit(tmp_path, "One")
    assert commit_of(tmp_path) == (name, False)
    (tmp_path / "renderer.py").write_text("fail")
    assert commit_of(tmp_path) == (name, True)


def test_runs_kept_at_once_are_all_kept_and_read_as_they_were(tmp_path: Path) -> None:
    with ThreadPoolExecutor(3) as pool:
        found = list(pool.map(lambda _: held(tmp_path, RIGHT, approve=True), range(3)))
    held(tmp_path, WORSE)
    kept = accepted_runs(tmp_path / "kept")
    assert len(kept) == 3 and all(one.run in kept for one in found)
    assert [one.measures["wrong_surfaces"] for one in kept[0].hogels] == [3.0, 0.0, 5.0]
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


def test_what_is_worse_at_the_same_commit_is_no_noise_unless_the_user_says_so(tmp_path: Path) -> None:
    """A clean commit may have been built by another compiler: its 5,000 wrong pixels are not forgiven."""
    commit(tmp_path, "A renderer")
    held(tmp_path, {(0, 0): 40}, approve=True)
    worse = held(tmp_path, {(0, 0): 500}, approve=True)
    assert "a run of this very commit is accepted" in lines(worse)
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


def test_new_hogels_are_held_to_the_limits_and_all_that_is_not_compared_is_counted(tmp_path: Path) -> None:
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
    assert not held(tmp_path, {**RIGHT, (1, 0): 3}, tolerance="wrong_surfaces=2,wrong_pixels=4").passed


def test_other_devices_and_options_are_new_and_what_is_accepted_is_named(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    other = held(tmp_path, WORSE, device="other")
    assert other.change is Change.NEW and not other.compared
    told = lines(other)
    assert "measures are accepted for hogels/{i}x{j}.png on toy (compare color" in told
    assert "what is judged now is hogels/{i}x{j}.png on other (compare color" in told
    assert not held(tmp_path, RIGHT, encoding="object-id").compared


@pytest.mark.parametrize("content", [b"", b"PAR1", b'{"run": 1}'])
def test_what_is_no_accepted_run_is_named_and_nothing_is_kept(content: bytes, tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    (tmp_path / "kept" / ACCEPTED / "20260101-damaged.json").write_bytes(content)
    with pytest.raises(InputError, match=r"20260101-damaged\.json: is no accepted run of this version"):
        held(tmp_path, RIGHT, approve=True)
    assert len(list((tmp_path / "kept" / ACCEPTED).iterdir())) == 2


def test_the_summary_for_github_is_appended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    assert {one["measure"] for one in told["changes"]} == {"wrong_surfaces", "wrong_pixels", *displacements}
