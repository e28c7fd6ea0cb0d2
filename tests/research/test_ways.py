"""The study of ways: plates by two cameras, by slabs and by directions, and their crossovers."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from tests.conftest import CHECKOUT
from tests.support.commands import Command
from xfrustum.compare.planning.ways import PlateWay
from xfrustum.research import ways
from xfrustum.research.sweep import read_rows
from xfrustum.research.ways import FULL, QUICK, Cell, Row, crossovers, document, sentence, svg

DOCS = CHECKOUT / "docs"
TINY = replace(QUICK, plates=(6, 30), nears=(1e-2, 1e-4))


def test_the_crossover_of_straight_lines_is_that_of_the_formula() -> None:
    """W H (pass + N cell) = N hogel, measured with four plates on both sides of N."""
    pixels, pass_s, hogel_s, cell_s = 64 * 64, 0.004, 0.002, 1e-7
    expected = pixels * pass_s / (hogel_s - pixels * cell_s)
    common = {"surface_fraction": 0.0, "displacement_p99_px": None, "judged": 1}
    rows = []
    for hogels in (expected / 50, expected / 3, expected * 4, expected * 90):
        by_hogels, turned = hogels * hogel_s, pixels * (pass_s + hogels * cell_s)
        for way, seconds in ((PlateWay.TWO_CAMERAS, by_hogels), (PlateWay.DIRECTIONS, turned)):
            times = {"hogels": hogels, "seconds": seconds, "predicted_s": seconds}
            longest = math.isqrt(round(hogels))
            rows.append(Row("car", longest, way, **times, **common))  # type: ignore[arg-type]
    (crossed,) = crossovers(rows)
    assert crossed.measured == pytest.approx(expected) and crossed.ratio == pytest.approx(1)
    (never,) = crossovers(rows[:4])
    assert never.measured is None and never.ratio is None
    assert f"{expected:,.0f} hogels</text>" in svg(rows)
    assert "hogels</text>" not in svg(rows[:4])


def test_the_published_page_and_figure_follow_from_the_data() -> None:
    rows, origin = read_rows(Row, DOCS / "ways.parquet")
    cells = [Cell(**{name: getattr(row, name) for name in Cell.__annotations__}) for row in rows]
    assert cells == [cell for block in FULL.blocks() for cell in block]
    page = (DOCS / "ways.md").read_text(encoding="utf-8")
    written = [line for line in document(rows, origin).splitlines() if line.startswith("| ")]
    assert len(written) == 3 + 3 * 4 + 4 and "\n".join(written[:5]) in page
    assert "\n".join(written[5:]) in page
    drawn = (DOCS / "images" / "ways.svg").read_text(encoding="utf-8")
    assert drawn == svg(rows)
    for crossed in crossovers(rows):
        assert crossed.measured is not None and f"{crossed.measured:,.0f} hogels" in drawn
        # Rule on the page, and the bar of the prediction
        assert 1.7 < crossed.measured / (64 * 64) < 4
        assert crossed.ratio is not None and 1 / 1.5 < crossed.ratio < 1.5


@pytest.mark.slow
def test_the_command_measures_each_way_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    monkeypatch.setattr(ways, "QUICK", TINY)
    message = command(f"study ways --quick --quiet --json --out {tmp_path}").record
    assert message["cells"] == 8
    files = ways.make_study(tmp_path, TINY)
    assert files is not None and message["sentence"] == sentence(files.rows)
    near, nearer, slabs, turned = files.rows[4:]
    # A small near offset displaces in proportion to it; images by direction have no displacement.
    assert near.displacement_p99_px is not None and nearer.displacement_p99_px is not None
    assert near.displacement_p99_px > 10 * nearer.displacement_p99_px > 0
    assert turned.way is PlateWay.DIRECTIONS and turned.displacement_p99_px is None
    assert turned.surface_fraction < near.surface_fraction and slabs.cuts == TINY.cuts[0]
    assert svg(files.rows) == (tmp_path / "images" / "ways.svg").read_text(encoding="utf-8")
    monkeypatch.setattr(ways, "compare_images", lambda *_: pytest.fail("measured again"))
    again = ways.make_study(tmp_path, TINY)
    assert again is not None and again.rows == files.rows
