"""What surveys claim of the built-in car, beside the whole plate: 4,941 hogels that were all judged once.

car-81x61.parquet has the columns of `xfrustum survey car --resolution 128,128 --near 0.15 --all` that decide
what is beyond, as recorded in November 2026. That the bounds hold as often as they say, on plates of every
kind, is stated in tests/compare/test_sampling.py.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from xfrustum.compare.sampling import aperture_at
from xfrustum.reports.survey.answer import Extent
from xfrustum.reports.survey.rows import Tally, add_rows
from xfrustum.reports.survey.survey import Chosen, Hogels
from xfrustum.scenes import Scene, open_scene

RECORDED = Path(__file__).parent / "car-81x61.parquet"

SEEDS, MIN_HOLDING = 20, 18
"""Number of surveys, and how many bounds must hold: of bounds that hold with 95 % exactly, fewer do in 8 of
100 tests; ours are conservative."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    car = open_scene("car")
    return replace(car, frustum=replace(car.frustum, resolution=(128, 128)))


@pytest.fixture(scope="module")
def rows(scene: Scene) -> pa.Table:
    """One row for each hogel, at the place of its column and row."""
    table = pq.read_table(RECORDED)
    table = table.filter(pc.equal(table["setting"], 0))
    table = table.sort_by([("row", "ascending"), ("column", "ascending")])
    assert len(table) == math.prod(scene.plate.hogels) == 4941
    return table


def bound_of(scene: Scene, rows: pa.Table, chosen: Chosen) -> tuple[float, int]:
    """Return the bound on the share beyond that a survey would tell, and how many hogels it would judge.

    Hogels are chosen, counted and bounded by the survey's own code; only judging them is left out.
    """
    hogels, tally, count = Hogels.of(scene, chosen, 1), Tally(scene.plate.hogels), 0
    for look in range(hogels.looks):
        blocks = hogels.blocks(look, count)
        count += len(blocks)
        apertures = [aperture_at(scene.plate, place) for block in blocks for place in block.places]
        places = [one.row * scene.plate.hogels[0] + one.column for one in apertures]
        add_rows([tally], [rows.take(places)])
        extent = Extent(
            hogels=len(rows),
            judged=tally.judged,
            look=look if chosen.until is not None else None,
            seed=chosen.seed,
            complete=True,
        )
        if chosen.until is None or extent.decides(tally.beyond, 1, chosen.until):
            break
    bound = extent.bound(tally.beyond, 1)
    assert bound is not None
    return bound, tally.judged


@pytest.mark.parametrize("until", [None, 0.75])
def test_bounds_of_samples_hold_for_the_whole_plate_wherever_a_survey_stops(
    scene: Scene, rows: pa.Table, until: float | None
) -> None:
    truth = float(np.mean(rows["beyond"].to_numpy()))
    found = [bound_of(scene, rows, Chosen(until=until, seed=seed)) for seed in range(SEEDS)]
    assert sum(bound >= truth for bound, _ in found) >= MIN_HOLDING
    if until is None:
        assert {judged for _, judged in found} == {300}
        assert max(bound for bound, _ in found) < truth + 0.15
