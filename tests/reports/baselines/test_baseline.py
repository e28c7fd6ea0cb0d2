"""A baseline keeps every run, tells what got worse since what was accepted, and loses nothing."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.reports.baselines.synthetic import commit, repository, scene, verification
from xfrustum.reports.baselines.baseline import Baseline, BaselineOptions, baseline, key_of
from xfrustum.reports.baselines.changes import Change
from xfrustum.reports.baselines.page import write_page
from xfrustum.reports.baselines.records import AcceptedRun, Run, read_accepted, read_run, read_told
from xfrustum.reports.baselines.repository import commit_of
from xfrustum.reports.baselines.store import ACCEPTED, HISTORY, Store
from xfrustum.reports.baselines.summary import append_step_summary, lines, markdown, sentence
from xfrustum.reports.baselines.tolerance import Stated
from xfrustum.scenes.errors import InputError

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

RIGHT = {(0, 0): 3, (1, 0): 0, (2, 0): 5}
WORSE = {(0, 0): 3, (1, 0): 8, (2, 0): 5}


@pytest.fixture
def pictured() -> None:
    """Draw the history page in this test."""


@pytest.fixture(autouse=True)
def _quickly(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no history page where a test does not look at it: that takes most of the time."""
    if "pictured" not in request.fixturenames:
        monkeypatch.setattr("xfrustum.reports.baselines.baseline.write_page", lambda _: None)


def held(
    folder: Path,
    wrong: Mapping[tuple[int, int], int | None],
    p99: float = 0.1,
    *,
    approve: bool = False,
    repeated: bool = False,
    device: str = "toy",
    tolerance: str | None = None,
) -> Baseline:
    options = BaselineOptions(
        device=device,
        approve=approve,
        repeated=repeated,
        tolerance=None if tolerance is None else Stated.of(tolerance),
        repository=folder,
    )
    return baseline(verification(wrong, p99), folder / "kept", options)


def test_over_five_commits_a_regression_is_found_named_and_approved(tmp_path: Path) -> None:
    repository(tmp_path)
    subjects = ("First", "Faster", "Simpler", "Comments", "Faster still")
    runs = []
    commits = []
    for subject, wrong, approve in zip(
        subjects, (RIGHT, RIGHT, WORSE, WORSE, WORSE), (True, False, False, True, False), strict=True
    ):
        commits.append(commit(tmp_path, subject))
        runs.append(held(tmp_path, wrong, approve=approve))
    assert [one.run.change for one in runs] == ["new", "same", "worse", "worse", "same"]
    assert [one.passed for one in runs] == [True, True, False, True, True]
    assert [one.run.edition for one in runs] == [1, None, None, 2, None]
    assert [one.run.commit for one in runs] == commits
    assert sentence(runs[2]) == (
        "Baseline: worse than accepted: wrong surfaces of hogel 1,0: 0 accepted, 8 now; and 3 more "
        "(compared exactly, with one accepted run)."
    )
    write_page(Store(folder=tmp_path / "kept"))
    page = runs[-1].page.read_text()
    assert all(name[:7] in page for name in commits) and "Simpler" in page
    assert "wrong surfaces of hogel 1,0: 0 accepted, 8 now" in page
    assert len(list((tmp_path / "kept" / HISTORY).iterdir())) == 5
    assert len(list((tmp_path / "kept" / ACCEPTED).iterdir())) == 2


def test_what_is_written_is_what_is_read(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    held(tmp_path, WORSE)
    first, second = sorted((tmp_path / "kept" / HISTORY).iterdir())
    plate, *hogels = read_run(second).rows
    assert (plate.place, plate.now.wrong_surfaces, plate.accepted.wrong_surfaces) == (None, 16.0, 8.0)
    assert [row.worse for row in hogels] == [(), ("wrong_surfaces", "wrong_pixels"), ()]
    told = read_told(second, changes=1)
    assert [(one.measure, one.aperture) for one in told.changes] == [("wrong_surfaces", (1, 0))]
    assert (told.changed, told.worse) == (4, {"wrong_surfaces": 1, "wrong_pixels": 1})
    table = pq.read_table(first)
    assert {"scene_hash", "renderer", "device", "commit", "wrong_surfaces", "limit_wrong_surfaces"} <= set(
        table.schema.names
    )
    assert set(table["scene_hash"].to_pylist()) == {scene().content_hash}


def test_runs_kept_at_once_are_all_kept_and_all_on_the_page(
    tmp_path: Path, pictured: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The curves take most of the time, and are not what is asked here.
    monkeypatch.setattr("xfrustum.reports.baselines.page.measured_names", lambda _: ())
    with ThreadPoolExecutor(3) as pool:
        found = list(pool.map(lambda _: held(tmp_path, RIGHT, approve=True), range(3)))
    store = Store(folder=tmp_path / "kept")
    assert len({one.run.run for one in found}) == 3
    assert {one.run for one in store.accepted()} == {one.run.run for one in found}
    assert {one.run.run for one in store.history()} == {one.run.run for one in found}
    assert "3 runs; each is a Parquet file" in store.page.read_text()
    assert held(tmp_path, RIGHT).run.change is Change.SAME


def test_repeated_runs_teach_the_noise(tmp_path: Path) -> None:
    for wrong in (40, 44, 38, 41, 43):
        kept = held(tmp_path, {(0, 0): wrong}, approve=True, repeated=True)
        assert kept.run.edition == 1
    same = held(tmp_path, {(0, 0): 45})
    assert same.passed and "tolerance learnt from 5 accepted runs" in sentence(same)
    assert not held(tmp_path, {(0, 0): 90}).passed
    assert held(tmp_path, {(0, 0): 90}, approve=True).run.edition == 2


def test_what_is_worse_at_the_same_commit_is_no_noise_unless_the_user_says_so(tmp_path: Path) -> None:
    """A clean commit may have been built by another compiler: its 5,000 wrong pixels are not forgiven."""
    repository(tmp_path)
    commit(tmp_path, "A renderer")
    held(tmp_path, {(0, 0): 40}, approve=True)
    worse = held(tmp_path, {(0, 0): 500}, approve=True)
    assert worse.run.edition == 2
    assert "a run of this very commit is accepted" in lines(worse)
    assert not held(tmp_path, {(0, 0): 501}).passed
    held(tmp_path, {(0, 0): 503}, approve=True, repeated=True)
    noisy = held(tmp_path, {(0, 0): 501})
    assert noisy.passed and noisy.changes.runs == 2
    assert "too few runs: the limits of" in lines(noisy)


def test_outside_a_repository_only_the_user_knows_that_a_renderer_is_unchanged(tmp_path: Path) -> None:
    assert commit_of(tmp_path) is None
    held(tmp_path, {(0, 0): 40}, approve=True)
    assert held(tmp_path, {(0, 0): 42}, approve=True).run.edition == 2
    assert held(tmp_path, {(0, 0): 40}, approve=True, repeated=True).run.edition == 2
    assert held(tmp_path, {(0, 0): 43}).changes.runs == 2


def test_states_that_two_branches_accepted_are_two_and_the_later_one_counts(tmp_path: Path) -> None:
    """After a merge, what differs between the two is no noise."""
    hogels = [(column, 0) for column in range(5)]

    def plate(*wrong: int) -> dict[tuple[int, int], int | None]:
        return dict(zip(hogels, (*wrong, *wrong[-1:] * 5), strict=False))

    held(tmp_path, plate(10), approve=True)
    shutil.copytree(tmp_path / "kept", tmp_path / "other" / "kept")
    for branch, wrong in ((tmp_path, 12), (tmp_path / "other", 40)):
        assert held(branch, plate(wrong), approve=True).run.edition == 2
    for name in (ACCEPTED, HISTORY):
        for path in (tmp_path / "other" / "kept" / name).iterdir():
            shutil.copy(path, tmp_path / "kept" / name)
    merged = held(tmp_path, plate(40))
    assert merged.run.change is Change.SAME and not merged.changes.noisy
    assert "besides the state that counts, another was accepted" in lines(merged)
    assert not held(tmp_path, plate(41)).passed
    assert held(tmp_path, plate(40), approve=True).run.began != merged.beside[0].run
    settled = held(tmp_path, plate(40))
    assert settled.passed and settled.beside == ()


def test_runs_of_versions_that_knew_numbers_of_editions_only_are_repetitions_of_one(tmp_path: Path) -> None:
    for wrong in (40, 44, 38):
        held(tmp_path, {(0, 0): wrong}, approve=True, repeated=True)
    for path in (tmp_path / "kept" / ACCEPTED).iterdir():
        pq.write_table(pq.read_table(path).drop_columns(["began", "follows", "new_hogels"]), path)
    assert held(tmp_path, {(0, 0): 41}).changes.runs == 3
    assert held(tmp_path, {(0, 0): 900}, approve=True).run.edition == 2
    assert held(tmp_path, {(0, 0): 900}).changes.runs == 1


def test_new_hogels_are_held_to_the_limits_and_all_that_is_not_compared_is_counted(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    fine = held(tmp_path, {(0, 0): 3, (1, 0): 0, (3, 0): 2})
    assert fine.passed
    assert "note: Not compared: 1 hogel not accepted before; 1 hogel accepted, and not judged now." in lines(
        fine
    )
    found = held(tmp_path, {**RIGHT, (3, 0): 900, (4, 0): None, (5, 0): 1})
    assert found.run.change is Change.SAME and not found.passed
    words = "3 hogels not accepted before, 2 of them beyond the limits"
    assert words in lines(found) and words in markdown(found, verification(RIGHT))
    told = found.summary()
    assert (told["new_hogels"], told["new_beyond_limits"], told["not_judged_hogels"]) == (3, 2, 0)
    (*_, last) = Store(folder=tmp_path / "kept").history()
    assert words in last.run.hogels_words
    assert held(tmp_path, {**RIGHT, (3, 0): 900}, approve=True).passed


def test_only_comparable_runs_are_read_and_the_history_tells_of_the_newest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("xfrustum.reports.baselines.store.MAX_RUNS", 2)
    read: list[str] = []

    def noted(path: Path, run: Run) -> AcceptedRun:
        read.append(run.key.device)
        return read_accepted(path, run)

    monkeypatch.setattr("xfrustum.reports.baselines.store.read_accepted", noted)
    for device in ("toy", "other", "toy"):
        held(tmp_path, RIGHT, approve=True, device=device)
    assert read == ["toy"]
    store = Store(folder=tmp_path / "kept")
    store.check()
    assert ([one.run.key.device for one in store.history()], store.older()) == (["other", "toy"], 1)


def test_numbers_in_another_encoding_are_not_compared() -> None:
    keys = {
        key_of(verification(RIGHT), BaselineOptions(encoding=encoding)).judged
        for encoding in (None, "triangle-id", "object-id")
    }
    assert len(keys) == 3


def test_approving_some_hogels_leaves_the_others_accepted(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    held(tmp_path, {(1, 0): 8}, approve=True)
    assert held(tmp_path, WORSE).passed
    again = held(tmp_path, {**WORSE, (2, 0): 6})
    assert [one.aperture for one in again.changes.of_kind(Change.WORSE)] == [(2, 0), (2, 0)]


def test_a_missing_hogel_is_told_and_a_stated_tolerance_holds(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    gone = held(tmp_path, {**RIGHT, (2, 0): None})
    assert "missing hogels of hogel 2,0: 0 accepted, 1 now" in lines(gone)
    assert held(tmp_path, {**RIGHT, (1, 0): 2}, tolerance="wrong_surfaces=2,wrong_pixels=4").passed
    assert not held(tmp_path, {**RIGHT, (1, 0): 3}, tolerance="wrong_surfaces=2,wrong_pixels=4").passed


def test_measures_of_another_device_are_new_and_the_accepted_one_is_named(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    other = held(tmp_path, WORSE, device="other")
    assert other.run.change is Change.NEW and not other.compared
    assert "measures are accepted for device 'toy', not 'other'" in lines(other)


def test_uncommitted_changes_are_noted(tmp_path: Path) -> None:
    repository(tmp_path)
    (tmp_path / "renderer.py").write_text("pass")
    name = commit(tmp_path, "One")
    clean = commit_of(tmp_path)
    (tmp_path / "renderer.py").write_text("fail")
    changed = commit_of(tmp_path)
    assert clean is not None and changed is not None
    assert (clean.hash, clean.subject, clean.modified, changed.modified) == (name, "One", False, True)


@pytest.mark.parametrize("place", [ACCEPTED, HISTORY])
@pytest.mark.parametrize("content", [b"", b"PAR1 and no more", b"text"])
def test_a_damaged_file_is_named_and_nothing_is_kept(place: str, content: bytes, tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    (tmp_path / "kept" / place / "20260101-damaged.parquet").write_bytes(content)
    with pytest.raises(InputError, match=r"20260101-damaged\.parquet: is no file of measures"):
        held(tmp_path, RIGHT)
    assert len(list((tmp_path / "kept" / HISTORY).iterdir())) == 1 + (place == HISTORY)


def test_a_table_of_something_else_is_refused(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    (path,) = (tmp_path / "kept" / ACCEPTED).iterdir()
    table = pq.read_table(path)
    pq.write_table(table.slice(1), path)
    with pytest.raises(InputError, match="the first row is not that of a plate"):
        read_run(path)
    names = table.schema.names
    pq.write_table(table.set_column(names.index("wrong_surfaces"), "wrong_surfaces", table["scene"]), path)
    with pytest.raises(InputError, match="column wrong_surfaces is string"):
        read_run(path)
    pq.write_table(table.drop_columns(["renderer"]), path)
    with pytest.raises(InputError, match="does not say which run"):
        read_run(path)


def test_files_of_versions_that_measured_less_are_read(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    (path,) = (tmp_path / "kept" / ACCEPTED).iterdir()
    pq.write_table(pq.read_table(path).drop_columns(["unexplained", "limit_unexplained"]), path)
    found = held(tmp_path, RIGHT)
    assert found.run.change is Change.SAME
    assert {one.measure for one in found.changes.of_kind(Change.NEW)} == {"unexplained"}


def test_a_baseline_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("no folder")
    with pytest.raises(InputError, match=r"^--baseline .*kept"):
        held(tmp_path, RIGHT)


def test_the_summary_for_github_is_appended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    summary = tmp_path / "summary.md"
    summary.write_text("what another step wrote\n")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    held(tmp_path, RIGHT, approve=True)
    found = held(tmp_path, WORSE)
    assert append_step_summary(found, verification(WORSE)) is None
    text = summary.read_text()
    assert text.startswith("what another step wrote\n### xfrustum verify: asymmetric\n")
    assert "Baseline: worse than accepted: wrong surfaces of hogel 1,0: 0 accepted, 8 now" in text
    assert "| wrong surfaces | hogel 1,0 | 0 | 0 | 8 | **worse** |" in text.splitlines()
    assert "| wrong surfaces | plate | 8 | 8 | 16 | **worse** |" in text.splitlines()
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "nowhere" / "summary.md"))
    assert "was not written" in (append_step_summary(found, verification(WORSE)) or "")
    monkeypatch.delenv("GITHUB_STEP_SUMMARY")
    assert append_step_summary(found, verification(WORSE)) is None


def test_no_name_becomes_markup(tmp_path: Path, pictured: None) -> None:
    evil = "a|b <img src=x> `c` [d](e)"
    found = held(tmp_path, RIGHT, device=evil)
    assert r"a\|b \<img src=x\> \`c\` \[d\](e)" in markdown(found, verification(RIGHT))
    assert "<img src=x" not in found.page.read_text()


def test_where_nothing_is_wrong_the_table_says_that_in_one_line(tmp_path: Path) -> None:
    right = verification({(0, 0): 0}, p99=1e-15)
    found = baseline(right, tmp_path / "kept", BaselineOptions(device="toy", approve=True))
    assert "| all measures | plate | | | 0 | new |" in markdown(found, right).splitlines()


@pytest.mark.skipif(BROWSER is None, reason="needs Chromium, which is not installed")
@pytest.mark.slow
def test_a_browser_draws_the_curves_of_the_history(tmp_path: Path, pictured: None) -> None:
    held(tmp_path, RIGHT, approve=True)
    page = held(tmp_path, WORSE).page
    quiet = "--disable-quic --no-first-run --disable-background-networking --disable-component-update"
    shown = subprocess.run(
        [
            str(BROWSER),
            *f"--headless --no-sandbox --disable-gpu --virtual-time-budget=8000 {quiet}".split(),
            f"--user-data-dir={tmp_path / 'profile'}",
            "--enable-logging=stderr",
            "--dump-dom",
            page.absolute().as_uri(),
        ],
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    assert "Content Security Policy" not in shown.stderr
    # Surfaces, pixels, and three displacements; the others are zero.
    assert shown.stdout.count('class="js-plotly-plot"') == 5
    assert "<title>History of asymmetric</title>" in shown.stdout


def test_the_json_object_names_what_changed(tmp_path: Path) -> None:
    held(tmp_path, RIGHT, approve=True)
    told = json.loads(json.dumps(held(tmp_path, WORSE, p99=0.3).summary(), allow_nan=False))
    assert (told["change"], told["approved"], told["accepted_runs"]) == ("worse", False, 1)
    assert told["changes"][0] == {
        "measure": "wrong_surfaces",
        "aperture": [1, 0],
        "accepted": 0.0,
        "limit": 0.0,
        "now": 8.0,
        "change": "worse",
    }
    assert {one["measure"] for one in told["changes"]} == {
        "wrong_surfaces", "wrong_pixels", "displacement_rms_px", "displacement_p99_px", "displacement_max_px"
    }  # fmt: skip
