"""The study of viewers: what is written follows from the data, and no replay is made twice."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from xfrustum.cli.main import main
from xfrustum.compare.eye.limits import EYES_APART_MM, STEREO_ACUITY_ARCSEC
from xfrustum.reports.eye.replayed import ReplayWorkbench
from xfrustum.reports.noticeable_study import facts
from xfrustum.reports.noticeable_study.document import document
from xfrustum.reports.noticeable_study.figures import figures
from xfrustum.reports.noticeable_study.grid import FULL, QUICK
from xfrustum.reports.noticeable_study.rows import NoticedRow, read_parquet
from xfrustum.reports.noticeable_study.study import DATA, DOCUMENT
from xfrustum.scenes import InputError

DOCS = Path(__file__).resolve().parents[3] / "docs"


@pytest.fixture(scope="module")
def rows() -> tuple[NoticedRow, ...]:
    return read_parquet(DOCS / DATA)[0]


def test_the_document_and_its_figures_follow_from_the_data_beside_them() -> None:
    rows, origin = read_parquet(DOCS / DATA)
    assert document(rows, origin, pictured=True) == (DOCS / DOCUMENT).read_text()
    for name, drawn in figures(rows).items():
        assert (DOCS / "images" / f"{name}.svg").read_text() == drawn
        assert f"images/{name}.svg" in (DOCS / DOCUMENT).read_text()


def test_the_data_are_those_of_the_whole_grid(rows: tuple[NoticedRow, ...]) -> None:
    cells = list(FULL.cells())
    assert [row.settings for row in rows] == [cell.settings for cell in cells]
    places = [(row.scene, row.pitch, row.distance) for row in rows]
    assert places == [(cell.scene, cell.pitch, cell.distance) for cell in cells]
    replayed = [row.replayed_points is not None for row in rows]
    assert replayed == [FULL.is_replayed(cell) for cell in cells]


def test_at_the_limit_of_the_rule_two_eyes_tell_the_gap_from_none() -> None:
    near, distance = facts.rule_near(600.0), 600.0
    change = EYES_APART_MM / (distance - near) - EYES_APART_MM / (distance + near)
    assert math.degrees(change) * 3600 == pytest.approx(STEREO_ACUITY_ARCSEC, rel=1e-9)
    # The short form of the rule leaves out what is of second order in n.
    assert distance**2 / (1000 * facts.rule_metres()) == pytest.approx(near, rel=1e-3)


def test_a_threshold_lies_where_a_power_law_reaches_its_limit(rows: tuple[NoticedRow, ...]) -> None:
    one = rows[0]
    line = [replace(one, near=near, stereo_arcsec=3.0 * near**2) for near in (0.1, 1.0, 10.0)]
    found = facts.largest_near(line, lambda row: row.stereo_arcsec, lambda row: 27.0)
    assert found == pytest.approx(3.0, rel=1e-12)
    assert facts.largest_near(line, lambda row: row.stereo_arcsec, lambda row: 0.01) is None
    assert facts.largest_near(line, lambda row: row.stereo_arcsec, lambda row: 1e9) == math.inf
    # Beyond the last row that is known nothing is promised.
    assert facts.largest_near(line, lambda row: None if row.near > 1 else 0.5, lambda row: 1.0) == 1.0


def test_no_eye_of_a_replay_disagrees_with_the_closed_form_on_what_is_noticed(
    rows: tuple[NoticedRow, ...],
) -> None:
    replayed = [row for row in rows if row.replayed_stereo_arcsec is not None]
    assert len(replayed) > 70
    assert {row.stereo_seen for row in replayed} == {True, False}
    for row in replayed:
        assert ((row.replayed_stereo_arcsec or 0.0) > STEREO_ACUITY_ARCSEC) == row.stereo_seen


def test_a_grid_without_nears_is_refused() -> None:
    with pytest.raises(InputError, match="nothing to study"):
        replace(FULL, nears=())


def written(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.rglob("*.*") if path.suffix != ".sqlite"}


@pytest.mark.slow
def test_a_study_that_was_stopped_replays_nothing_again(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["study", "noticeable", "--quick", "--json", "--quiet", "--out", str(tmp_path)]
    assert main(arguments) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["cells"] == len(list(QUICK.cells()))
    assert told["replays"] == sum(map(QUICK.is_replayed, QUICK.cells()))
    before = written(tmp_path)
    assert {DOCUMENT, DATA} <= set(before)

    def never(*arguments: object) -> None:
        raise AssertionError("replayed again")

    monkeypatch.setattr(ReplayWorkbench, "measure", never)
    assert main(arguments) == 0
    assert before == written(tmp_path)
