"""Study of viewers: its data and its page agree, and no replay is repeated."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from tests.conftest import CHECKOUT
from xfrustum.cli.main import main
from xfrustum.research import noticeable
from xfrustum.research.noticeable import FULL, QUICK, Cell, Row
from xfrustum.research.replays import ReplayWorkbench
from xfrustum.research.sweep import read_rows

DATA = CHECKOUT / "docs" / "noticeable.parquet"


@pytest.fixture(scope="module")
def rows() -> tuple[Row, ...]:
    return read_rows(Row, DATA)[0]


def cell_of(row: Row) -> Cell:
    return Cell(**{name: getattr(row, name) for name in vars(next(FULL.cells()))})


def test_the_data_are_those_of_the_whole_grid_and_the_nears_that_decide_are_replayed(
    rows: tuple[Row, ...],
) -> None:
    cells = list(FULL.cells())
    assert [cell_of(row) for row in rows] == cells
    replayed = [index for index, row in enumerate(rows) if row.replayed_points is not None]
    assert replayed == FULL.replayed(cells, rows)
    assert {cells[index].case for index in replayed} == {cell.case for cell in cells}


def test_the_published_page_has_the_numbers_that_follow_from_its_data(
    rows: tuple[Row, ...],
) -> None:
    page = (CHECKOUT / "docs" / "noticeable.md").read_text(encoding="utf-8")
    written = noticeable.document(rows, read_rows(Row, DATA)[1])
    for line in (line for line in written.splitlines() if line.startswith("| car")):
        name, *stereo, _, _ = line.strip("| ").split(" | ")
        assert " | ".join((f"| {name}", *stereo)) in page
    apart = noticeable.disagreement(rows)
    assert f"these are {apart['pixels_only']} of {sum(apart.values())} pairs" in " ".join(
        page.split()
    )
    for quarter in noticeable.quarters(rows):
        assert f"{quarter['failed']} of {quarter['kept']} from {quarter['distance']:g} mm" in page


def test_a_threshold_lies_where_a_power_law_reaches_its_limit(rows: tuple[Row, ...]) -> None:
    line = [replace(rows[0], near=near, stereo_arcsec=3.0 * near**2) for near in (0.1, 1.0, 10.0)]

    def largest(limit: float) -> float | None:
        return noticeable.largest_near(line, "stereo_arcsec", limit)

    assert largest(27.0) == pytest.approx(3.0, rel=1e-12)
    assert largest(0.01) is None
    assert largest(1e9) == math.inf
    # Beyond the last known row there is no prediction.
    passed = [replace(row, pixels_worst=None if row.near > 1 else 0.5) for row in line]
    assert noticeable.largest_near(passed, "pixels_worst", 1.0) == 1.0


@pytest.mark.slow
def test_a_study_that_was_stopped_replays_nothing_again(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["study", "noticeable", "--quick", "--json", "--quiet", "--out", str(tmp_path)]
    assert main(arguments) == 0
    record = json.loads(capfd.readouterr().out)
    assert record["cells"] == len(list(QUICK.cells())) and 0 < record["replays"] <= record["cells"]
    before = (tmp_path / "noticeable.md").read_bytes()
    monkeypatch.setattr(ReplayWorkbench, "measure", lambda *_: pytest.fail("replayed again"))
    assert main(arguments) == 0
    assert (tmp_path / "noticeable.md").read_bytes() == before
