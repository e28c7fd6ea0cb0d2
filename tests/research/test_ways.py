"""The study of ways: plates by two cameras, slabs and directions, and where they cross."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from tests.support.records import problems
from xfrustum.cli.main import main
from xfrustum.compare.planning.ways import PlateWay
from xfrustum.research import ways
from xfrustum.research.ways import QUICK, Row, crossovers, sentence, svg

TINY = replace(QUICK, plates=(6, 30), nears=(1e-2, 1e-4))


@pytest.mark.parametrize(("pass_s", "hogel_s"), [(0.5, 0.25), (0.004, 0.002)])
def test_the_crossover_of_straight_lines_is_that_of_the_formula(
    pass_s: float, hogel_s: float
) -> None:
    """W H (pass + N cell) = N hogel, measured at four plates and on both sides of N."""
    pixels, cell_s = 64 * 64, 1e-7
    expected = pixels * pass_s / (hogel_s - pixels * cell_s)
    common = {"surface_fraction": 0.0, "displacement_p99_px": 0.0, "judged": 1}
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


@pytest.mark.slow
def test_the_command_measures_each_way_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ways, "QUICK", TINY)
    line = ["study", "ways", "--quick", "--quiet", "--json", "--out", str(tmp_path)]
    assert main(line) == 0
    message = json.loads(capsys.readouterr().out)
    assert problems("study-ways", message) == [] and message["cells"] == 8
    files = ways.make_study(tmp_path, TINY)
    assert files is not None and message["sentence"] == sentence(files.rows)
    near, nearer, slabs, turned = files.rows[4:]
    # Displacement is proportional to near, where it is small; by directions there is none.
    assert near.displacement_p99_px > 10 * nearer.displacement_p99_px > 0
    assert turned.way is PlateWay.DIRECTIONS and turned.displacement_p99_px == 0
    assert turned.surface_fraction < near.surface_fraction and slabs.cuts == TINY.cuts[0]
    assert svg(files.rows) == (tmp_path / "images" / "ways.svg").read_text(encoding="utf-8")
    monkeypatch.setattr(ways, "compare_images", lambda *_: pytest.fail("measured again"))
    again = ways.make_study(tmp_path, TINY)
    assert again is not None and again.rows == files.rows
