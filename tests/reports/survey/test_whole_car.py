"""What surveys claim of the built-in car, beside the whole plate: 4,941 hogels that were all judged once.

car-81x61.parquet has the columns of `xfrustum survey car --resolution 128,128 --near 0.15 --all` that decide
what is beyond, as recorded in November 2026. The environment variable XFRUSTUM_SURVEYED names a folder of
another such survey of the car (its --out), whose rows are then taken instead.
"""

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from xfrustum.compare.sampling import GrowingSample, aperture_at, risk_of_claim, share_beyond
from xfrustum.reports.survey.answer import Extent
from xfrustum.reports.survey.rows import Tally, add_rows
from xfrustum.reports.survey.survey import Chosen, Hogels
from xfrustum.scenes import Scene, open_scene

RECORDED = Path(__file__).parent / "car-81x61.parquet"

VARIABLE = "XFRUSTUM_SURVEYED"

SEEDS, MIN_HOLDING = 100, 93
"""Number of surveys, and how many bounds must hold: of bounds that hold with 95 % exactly, fewer do in 13 of
100 tests; ours are conservative."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    car = open_scene("car")
    return replace(car, frustum=replace(car.frustum, resolution=(128, 128)))


@pytest.fixture(scope="module")
def rows(scene: Scene) -> pa.Table:
    """One row for each hogel, at the place of its column and row."""
    surveyed = os.environ.get(VARIABLE)
    paths = [RECORDED] if surveyed is None else sorted(Path(surveyed).glob("survey.parquet/part-*"))
    names = ["column", "row", "setting", "beyond", "displacement_px_p99", "surface_fraction"]
    table = pa.concat_tables(pq.ParquetFile(path).read(columns=names) for path in paths)
    table = table.filter(pc.equal(table["setting"], 0))
    table = table.sort_by([("row", "ascending"), ("column", "ascending")])
    assert len(table) == math.prod(scene.plate.hogels) == 4941
    return table


CLAIMS = {
    "beyond": lambda rows: rows["beyond"],
    "displaced by more than 6 px": lambda rows: pc.fill_null(
        pc.greater(rows["displacement_px_p99"], 6.0), False
    ),
    "displaced by more than 30 px": lambda rows: pc.fill_null(
        pc.greater(rows["displacement_px_p99"], 30.0), False
    ),
    "more than 10 % of it wrong": lambda rows: pc.greater(rows["surface_fraction"], 0.1),
}
"""Properties of hogels: the one that a survey counts, and others that other tolerances would make it count,
so that frequent and rare ones are sampled."""


def claimed(rows: pa.Table, claim: str) -> pa.Table:
    """Return the rows with another property in the place of `beyond`."""
    place = rows.column_names.index("beyond")
    return rows.set_column(place, "beyond", CLAIMS[claim](rows))


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


@pytest.mark.slow
@pytest.mark.parametrize("claim", CLAIMS)
def test_bounds_of_three_hundred_hogels_hold_for_the_whole_plate(
    scene: Scene, rows: pa.Table, claim: str
) -> None:
    asked = claimed(rows, claim)
    truth = float(np.mean(asked["beyond"].to_numpy()))
    bounds = [bound_of(scene, asked, Chosen(seed=seed))[0] for seed in range(SEEDS)]
    held = sum(bound >= truth for bound in bounds)
    assert 0.001 < truth < 0.999
    assert held >= MIN_HOLDING
    # They say something, too.
    assert np.median(bounds) < truth + 0.1


@pytest.mark.slow
@pytest.mark.parametrize(("claim", "limit"), [("beyond", 0.75), ("displaced by more than 30 px", 0.03)])
def test_bounds_hold_wherever_a_survey_of_the_car_stops(
    scene: Scene, rows: pa.Table, claim: str, limit: float
) -> None:
    asked = claimed(rows, claim)
    truth = float(np.mean(asked["beyond"].to_numpy()))
    found = [bound_of(scene, asked, Chosen(until=limit, seed=seed)) for seed in range(SEEDS)]
    held = sum(bound >= truth for bound, _ in found)
    assert held >= MIN_HOLDING


def test_the_recorded_survey_and_a_sample_of_it_agree(scene: Scene, rows: pa.Table) -> None:
    truth = float(np.mean(rows["beyond"].to_numpy()))
    bound, judged = bound_of(scene, rows, Chosen(seed=1))
    assert judged == 300
    assert truth <= bound < truth + 0.1


def test_bounds_on_several_settings_hold_together(scene: Scene, rows: pa.Table) -> None:
    claims = [claimed(rows, claim)["beyond"].to_numpy(zero_copy_only=False) for claim in CLAIMS]
    columns = scene.plate.hogels[0]
    path = [aperture_at(scene.plate, place) for place in range(len(rows))]
    order = np.array([one.row * columns + one.column for one in path])
    held = 0
    for seed in range(SEEDS):
        drawn = order[GrowingSample(plate=scene.plate, first=150, seed=seed).places(0)]
        risk = risk_of_claim(len(claims))
        held += all(
            share_beyond(int(wrong[drawn].sum()), 150, len(rows), risk) >= wrong.mean() for wrong in claims
        )
    assert held >= MIN_HOLDING
