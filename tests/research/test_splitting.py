"""Study of splitting: measurements, resumption, and a page made only from the data."""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import CHECKOUT
from tests.support.commands import Command
from xfrustum import Camera, DepthFormat, DepthMapping, Offset, Pivot
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.research import splitting
from xfrustum.research.depth_family import FARTHEST
from xfrustum.research.splitting import (
    ASKED_SEPARATION,
    FULL,
    QUICK,
    Cell,
    DepthBuffer,
    Family,
    Grid,
    Row,
    Suitability,
    document,
    figures,
    helps,
    least_near,
    make_study,
    outcomes,
    part_of,
    sentence,
    suitability,
    unbroken,
)
from xfrustum.research.sweep import StudyFiles, read_rows
from xfrustum.tolerances import TOLERANCE_PX

D16 = (DepthFormat.D16, DepthMapping.STANDARD)
D24 = (DepthFormat.D24, DepthMapping.STANDARD)
EXACT = (DepthFormat.D32F, DepthMapping.REVERSED)
CELL = Cell(
    Family.ONE_SIDE, Camera.C, 10.0, 48, *EXACT, Pivot.APERTURE, None, Offset.PLATE, near=1e-3
)

TINY = (
    (1e-2, 1e-3, 1e-6),
    (
        Grid(
            family=Family.ONE_SIDE,
            sides=(Camera.C,),
            ratios=(10.0,),
            buffers=(D16, EXACT),
            resolutions=(64,),
        ),
    ),
)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> StudyFiles:
    result = make_study(tmp_path_factory.mktemp("tiny"), TINY)
    assert result is not None
    return result


@pytest.fixture(scope="module")
def published() -> tuple[Row, ...]:
    return read_rows(Row, CHECKOUT / "docs" / "when-to-split.parquet")[0]


@pytest.mark.slow
def test_the_bent_edge_of_a_window_follows_the_closed_form(tiny: StudyFiles) -> None:
    """The film's corner is off by e = W n / (sqrt(2) |z|): p99 lies between e / 10 and e."""
    for row in (row for row in tiny.rows if not row.slabs):
        in_corner = row.resolution / math.sqrt(2) * row.near / (FARTHEST / 1000 / row.ratio)
        if in_corner <= TOLERANCE_PX:
            assert suitability(row) in {Suitability.ENOUGH, Suitability.STARVED}
        if in_corner > 10 * TOLERANCE_PX:
            assert suitability(row) in {Suitability.BENT, Suitability.BOTH}
        # Depth buffers do not displace pixels that keep their surface.
        if row.depth_wrong == 0:
            assert row.displacement_p99 == pytest.approx(row.predicted_p99, rel=0.2)


@pytest.mark.slow
def test_the_starved_edge_of_a_window_follows_the_closed_form(tiny: StudyFiles) -> None:
    """Sheets are ordered at twice the smallest separation, and not at half of it."""
    decided = [
        r
        for r in tiny.rows
        if not r.slabs and not 0.5 <= r.predicted_separation / ASKED_SEPARATION <= 2
    ]
    assert {row.misordered > MAX_MISORDERED_FRACTION for row in decided} == {True, False}
    for row in decided:
        assert (row.misordered > MAX_MISORDERED_FRACTION) == (
            row.predicted_separation > ASKED_SEPARATION
        )


def test_splitting_off_empty_space_leaves_only_rounding(tiny: StudyFiles) -> None:
    """Cameras in the aperture draw points in place, up to the rounding of 32-bit positions."""
    cut = [row for row in tiny.rows if row.slabs]
    assert cut
    for row in cut:
        assert row.displacement_p99 is not None
        assert row.displacement_p99 < 1e-3
        assert row.predicted_p99 == 0
    assert all(outcome.nears or outcome.slabs for outcome in outcomes(tiny.rows).values())


def row_of(**changed: Any) -> Row:
    plain = Row(
        **vars(CELL), judged=10_000, covered=4_000, nearest=0.1, farthest=1.0,
        surface_wrong=0, outside=0, depth_wrong=0, lost=0, displacement_rms=0.1,
        displacement_p99=0.1,
        displacement_max=0.1, displaced=0, predicted_rms=0.1, predicted_p99=0.1, misordered=0.0,
        ordered_separation=1e-6, predicted_separation=1e-6,
    )  # fmt: skip
    return replace(plain, **changed)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, Suitability.ENOUGH),
        ({"displacement_p99": 0.51}, Suitability.BENT),
        ({"depth_wrong": 11}, Suitability.STARVED),
        ({"misordered": 0.02}, Suitability.STARVED),
        ({"misordered": 0.02, "displacement_p99": 9.0}, Suitability.BOTH),
        ({"predicted_p99": 0.51}, Suitability.BENT),
        ({"offset": Offset.NONE, "nearest": 0.0009}, Suitability.BENT),
    ],
)
def test_a_verdict_names_the_exceeded_limit(changed: dict[str, Any], expected: Suitability) -> None:
    assert suitability(row_of(**changed)) is expected


def test_the_fewest_slabs_that_are_enough_are_the_outcome_and_a_window_ends_at_its_first_gap() -> (
    None
):
    rows = [
        row_of(misordered=1.0),
        row_of(slabs=(0.1,), misordered=1.0),
        row_of(slabs=(0.1, 0.2, 0.5)),
    ]
    (outcome,) = outcomes([*rows, row_of(slabs=(0.1, 0.3))]).values()
    assert outcome == ((), (0.1, 0.3))
    measured = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
    assert unbroken({1e-2, 1e-3, 1e-5}, measured) == (1e-2, 1e-3)
    assert unbroken((), measured) == ()


@pytest.mark.parametrize("buffer", FULL[1][0].buffers)
def test_the_least_near_orders_the_separation_and_half_of_it_does_not(buffer: DepthBuffer) -> None:
    near = least_near(buffer)
    hyperbolic = buffer[1] in {DepthMapping.STANDARD, DepthMapping.GL, DepthMapping.REVERSED}
    # Reversed float depth, and depth written by fragments, resolve the separation at the smallest
    # near that is tried.
    assert (near is None) == (not hyperbolic or buffer == EXACT)
    if near is not None:
        # One step of b bits is w^2 / (n 2^b); roundings only increase the error.
        bits = 16 if buffer[0] is DepthFormat.D16 else 24
        assert 1 <= near * ASKED_SEPARATION * 2.0**bits < 6


def test_the_command_prints_one_object_that_names_every_case(
    tiny: StudyFiles, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    """Finished measurements are not repeated."""
    monkeypatch.setattr(splitting, "QUICK", TINY)
    monkeypatch.setattr(splitting, "compare_images", lambda *_: pytest.fail("measured again"))
    line = f"study splitting --quick --quiet --json --out {tiny.data.parent}"
    message = command(line).record
    assert message["cells"] == len(tiny.rows) and message["sentence"] == sentence(tiny.rows)
    assert len(message["cases"]) == len(outcomes(tiny.rows))
    assert {Path(file).stem for file in message["files"]["figures"]} == figures(tiny.rows).keys()


def test_the_published_data_are_the_full_map_and_a_quick_one_is_part_of_it(
    published: tuple[Row, ...],
) -> None:
    def cells(study: Any) -> list[Cell]:
        nears, grids = study
        return [
            part_of(item, Cell) for grid in grids for block in grid.blocks(nears) for item in block
        ]

    def rounded(some: Iterable[Cell]) -> set[Cell]:
        """Round nears: the last digit of a power of ten depends on the processor."""
        return {replace(item, near=float(f"{item.near:.12g}")) for item in some}

    made = rounded(part_of(row, Cell) for row in published if not row.slabs)
    assert made == rounded(cells(FULL)) >= rounded(cells(QUICK))


def test_the_published_page_has_the_tables_that_follow_from_its_data(
    published: tuple[Row, ...],
) -> None:
    page = (CHECKOUT / "docs" / "when-to-split.md").read_text(encoding="utf-8")
    origin = read_rows(Row, CHECKOUT / "docs" / "when-to-split.parquet")[1]
    advice = document(published, origin).split("## Content on one side")[1]
    lines = [line for line in advice.splitlines() if line.startswith("| ") and "---" not in line]
    assert len(lines) == 13
    for line in lines:
        assert line in page
    for item in helps(published):
        assert (
            f"| {item['one_pair']} of {item['cases']} | {item['cases'] - item['one_pair']} |"
            in page
        )
    enough, cases = (
        int(word)
        for word in sentence(published).split("enough in ")[1].split(" cases")[0].split(" of ")
    )
    assert f"| {enough} of {cases} |" in page
