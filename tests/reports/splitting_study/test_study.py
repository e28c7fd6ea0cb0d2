"""Where one pair of frusta is enough: measured, resumed, and written down from the data alone."""

from __future__ import annotations

import json
import math
import os
import signal
import sqlite3
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import CHECKOUT
from xfrustum.cli.main import main
from xfrustum.compare.planning.plan import plan
from xfrustum.compare.planning.views import SEPARATION_PER_REACH, Requirement
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.raster.cameras.passes import drawing_order
from xfrustum.reference import Reference
from xfrustum.reports.splitting_study import grid as study_grid
from xfrustum.reports.splitting_study.document import document
from xfrustum.reports.splitting_study.facts import buffer_facts, by_the_rule, least_near
from xfrustum.reports.splitting_study.figures import maps, svg
from xfrustum.reports.splitting_study.grid import BUFFERS, FULL, QUICK, Family, Grid
from xfrustum.reports.splitting_study.measure import SEPARATIONS, CellResult, PictureWorkbench
from xfrustum.reports.splitting_study.rows import ASKED_SEPARATION, StudyRow, read_parquet
from xfrustum.reports.splitting_study.run import PICTURES
from xfrustum.reports.splitting_study.study import (
    DATA,
    DOCUMENT,
    StudyFiles,
    make_study,
)
from xfrustum.reports.splitting_study.suitability import (
    Case,
    Suitability,
    case_of,
    outcomes,
    suitability,
    unbroken,
)
from xfrustum.reports.studies.folder import IMAGES, RESULTS
from xfrustum.reports.studies.origin import Origin, origin_hash
from xfrustum.reports.studies.store import Store
from xfrustum.scenes import Camera, DepthFormat, DepthMapping, InputError
from xfrustum.scenes.library.depth_family import CAR_RATIO, FARTHEST, cars
from xfrustum.scenes.plate.double_frustum import Offset
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX

TINY = Grid(
    nears=(1e-2, 1e-3, 1e-4, 1e-6),
    buffers=(
        (DepthFormat.D16, DepthMapping.STANDARD),
        (DepthFormat.D24, DepthMapping.STANDARD),
        (DepthFormat.D32F, DepthMapping.REVERSED),
    ),
    resolutions=(64,),
    ratios=(10.0,),
)

ONE_SIDE = replace(TINY, sides=(Camera.C,))

PUBLISHED = CHECKOUT / "docs"


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> StudyFiles:
    return make_study(tmp_path_factory.mktemp("tiny"), TINY)


@pytest.fixture(scope="module")
def published() -> tuple[tuple[StudyRow, ...], Origin]:
    return read_parquet(PUBLISHED / DATA)


def without_times(rows: tuple[StudyRow, ...]) -> list[StudyRow]:
    return [replace(row, seconds=0.0) for row in rows]


def single(rows: tuple[StudyRow, ...]) -> list[StudyRow]:
    return [row for row in rows if not row.slabs]


# The scenes.


@pytest.mark.parametrize("camera", [Camera.C, Camera.C_STAR])
@pytest.mark.parametrize("ratio", [CAR_RATIO, 30.0, 1000.0])
def test_surfaces_reach_from_the_nearest_to_the_farthest_height_of_their_side(
    ratio: float, camera: Camera
) -> None:
    heights = cars(ratio, camera, (8, 8)).vertices[:, 2] * (-1 if camera is Camera.C else 1)
    assert heights.max() == pytest.approx(FARTHEST, rel=1e-12)
    assert heights.max() / heights.min() == pytest.approx(ratio, rel=1e-12)


def test_scenes_of_every_depth_show_the_same_picture() -> None:
    """Scaled about the aperture, a car stays where it is on the film, up to rounding at its edges."""
    shown = []
    for ratio in (CAR_RATIO, 1000.0):
        scene = cars(ratio, Camera.C, (96, 96))
        shown.append(Reference(scene).trace(scene.plate.middle).triangle)
    assert (shown[0] >= 0).mean() > 0.3
    assert (shown[0] != shown[1]).mean() < 1e-3


def test_a_scene_shallower_than_one_car_is_refused() -> None:
    with pytest.raises(InputError, match=r"at least 1\.5"):
        cars(1.2, Camera.C, (8, 8))


# What is measured.


def test_the_sheets_are_ordered_alike_by_c_and_by_c_star(tiny: StudyFiles) -> None:
    """At the same distance both cameras store the same depths, and only the test is turned around."""
    by_side: dict[Camera, dict[Any, StudyRow]] = {Camera.C: {}, Camera.C_STAR: {}}
    for row in single(tiny.rows):
        by_side[row.side][row.near, row.buffer] = row
    assert by_side[Camera.C].keys() == by_side[Camera.C_STAR].keys()
    for key, row in by_side[Camera.C].items():
        other = by_side[Camera.C_STAR][key]
        assert row.predicted_separation == other.predicted_separation
        assert (row.misordered > MAX_MISORDERED_FRACTION) == (other.misordered > MAX_MISORDERED_FRACTION)


def test_no_depth_buffer_moves_the_picture(tiny: StudyFiles) -> None:
    """Displacement is of near and geometry alone, wherever depth leaves the surfaces as they are."""
    for row in single(tiny.rows):
        if row.depth_wrong == 0:
            assert row.displacement_p99 == pytest.approx(row.predicted_p99, rel=0.2)


def test_the_bent_edge_of_a_window_follows_the_closed_form(tiny: StudyFiles) -> None:
    """The film's corner is off by W n / (sqrt(2) |z|): that much at most, and not a tenth of it at p99."""
    for row in single(tiny.rows):
        in_corner = row.resolution / math.sqrt(2) * row.near / (FARTHEST / 1000 / row.ratio)
        if in_corner <= TOLERANCE_PX:
            assert suitability(row) in {Suitability.ENOUGH, Suitability.STARVED}
        if in_corner > 10 * TOLERANCE_PX:
            assert suitability(row) in {Suitability.BENT, Suitability.BOTH}


def test_the_starved_edge_of_a_window_follows_the_closed_form(tiny: StudyFiles) -> None:
    """Twice the smallest separation is ordered, half of it is not; between them anything may happen."""
    decided = [r for r in single(tiny.rows) if not 0.5 <= r.predicted_separation / ASKED_SEPARATION <= 2]
    assert {row.misordered > MAX_MISORDERED_FRACTION for row in decided} == {True, False}
    for row in decided:
        assert (row.misordered > MAX_MISORDERED_FRACTION) == (row.predicted_separation > ASKED_SEPARATION)


def test_splitting_off_what_is_empty_leaves_rounding_alone(tiny: StudyFiles) -> None:
    """Cameras in the aperture draw every point where it belongs: within 32-bit surface positions."""
    cut = [row for row in tiny.rows if row.slabs]
    assert cut
    for row in cut:
        assert row.displacement_p99 is not None
        assert row.displacement_p99 < 1e-3
        assert row.predicted_p99 == 0
    assert all(outcome.one_pair or outcome.slabs for outcome in outcomes(tiny.rows).values())


def test_the_study_asks_what_the_planner_asks() -> None:
    requirement = Requirement()
    assert (requirement.tolerance_px, requirement.max_wrong) == (TOLERANCE_PX, MAX_DEPTH_WRONG)
    assert SEPARATION_PER_REACH == ASKED_SEPARATION


@pytest.mark.slow
@pytest.mark.parametrize(
    "buffer", [TINY.buffers[0], *(pytest.param(each, marks=pytest.mark.slow) for each in TINY.buffers[1:])]
)
def test_the_planner_cuts_as_often_and_draws_no_fewer_slabs(
    buffer: tuple[DepthFormat, DepthMapping], tiny: StudyFiles
) -> None:
    (ratio,), (resolution,) = TINY.ratios, TINY.resolutions
    scene = cars(ratio, Camera.C, (resolution, resolution))
    planned = plan(scene, [scene.plate.middle], choices=[buffer])
    assert planned.within
    assert planned.settings is not None
    case = Case(side=Camera.C, ratio=ratio, resolution=resolution, buffer=buffer)
    found = outcomes(tiny.rows)[case].slabs or ()
    assert len(planned.slabs) == len(found)
    # The first cut may lie a little above the nearest surface; then the first slab is drawn too.
    drawn = drawing_order(scene, scene.plate.middle, replace(planned.settings, camera=Camera.C))
    assert len(drawn) >= max(1, len(found))


def test_displacement_grows_in_proportion_to_the_resolution() -> None:
    cell = next(TINY.cells())
    cell = replace(cell, near=1e-3, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED)
    found = []
    for resolution in (64, 128):
        cell = replace(cell, resolution=resolution)
        with PictureWorkbench(cell.picture) as bench:
            found.append(bench.measure(cell))
    assert found[0].displacement_rms is not None
    assert found[1].displacement_rms == pytest.approx(2 * found[0].displacement_rms, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("levels", [1, 2])
def test_refined_meshes_leave_the_map_where_it_was(levels: int, tiny: StudyFiles, tmp_path: Path) -> None:
    """The same surfaces in 4 and 16 times as many triangles: the same verdict in every cell."""
    finer = make_study(tmp_path, replace(TINY, refined=levels))
    assert {case: (a.nears, a.slabs) for case, a in outcomes(finer.rows).items()} == {
        case: (a.nears, a.slabs) for case, a in outcomes(tiny.rows).items()
    }


# Verdicts.


def row_of(**changed: Any) -> StudyRow:
    cell = next(TINY.cells())
    plain = StudyRow(
        side=cell.side, ratio=10.0, resolution=64, near=1e-3, depth=cell.depth, mapping=cell.mapping,
        slabs=(), refined=0, judged=10_000, covered=4_000, nearest=0.1, farthest=1.0, surface_wrong=0,
        outside=0, depth_wrong=0, lost=0, displacement_rms=0.1, displacement_p99=0.1,
        displacement_max=0.1, displaced=0, predicted_rms=0.1,
        predicted_p99=0.1, seconds=0.0, misordered=0.0, ordered_separation=1e-6, predicted_separation=1e-6,
    )  # fmt: skip
    return replace(plain, **changed)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, Suitability.ENOUGH),
        ({"displacement_p99": 0.5}, Suitability.ENOUGH),
        ({"displacement_p99": 0.51}, Suitability.BENT),
        ({"depth_wrong": 10}, Suitability.ENOUGH),
        ({"depth_wrong": 11}, Suitability.STARVED),
        ({"misordered": 0.02}, Suitability.STARVED),
        ({"misordered": 0.02, "displacement_p99": 9.0}, Suitability.BOTH),
        ({"displacement_p99": None, "depth_wrong": 4_000}, Suitability.STARVED),
        ({"surface_wrong": 400}, Suitability.ENOUGH),
        ({"predicted_p99": 0.51}, Suitability.BENT),
        ({"offset": Offset.NONE, "nearest": 0.0009}, Suitability.BENT),
        ({"offset": Offset.NONE, "nearest": 0.0011}, Suitability.ENOUGH),
        ({"nearest": 0.0009}, Suitability.ENOUGH),
    ],
)
def test_a_verdict_names_what_was_exceeded(changed: dict[str, Any], expected: Suitability) -> None:
    assert suitability(row_of(**changed)) is expected


def test_the_fewest_slabs_that_are_enough_are_the_outcome() -> None:
    rows = [
        row_of(misordered=1.0),
        row_of(slabs=(0.1,), misordered=1.0),
        row_of(slabs=(0.1, 0.2, 0.5)),
        row_of(slabs=(0.1, 0.3)),
    ]
    outcome = outcomes(rows)[case_of(rows[0])]
    assert not outcome.one_pair
    assert outcome.slabs == (0.1, 0.3)


def test_a_window_ends_at_its_first_gap() -> None:
    measured = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
    assert unbroken({1e-2, 1e-3, 1e-5}, measured) == (1e-2, 1e-3)
    assert unbroken((), measured) == ()


@pytest.mark.parametrize("buffer", BUFFERS)
def test_the_least_near_orders_what_is_asked_and_half_of_it_does_not(
    buffer: tuple[DepthFormat, DepthMapping],
) -> None:
    near = least_near(buffer)
    hyperbolic = buffer[1] in {DepthMapping.STANDARD, DepthMapping.GL, DepthMapping.REVERSED}
    # Reversed float depth resolves the same share of any distance; what fragments write, no less.
    assert (near is None) == (not hyperbolic or buffer == (DepthFormat.D32F, DepthMapping.REVERSED))
    if near is not None:
        # One step of b bits is w^2 / (n 2^b): roundings only add to it.
        bits = 16 if buffer[0] is DepthFormat.D16 else 24
        assert 1 <= near * ASKED_SEPARATION * 2.0**bits < 6


# Stopped and resumed.

CHILD = """
import os, signal, sys
from pathlib import Path
from tests.reports.splitting_study.test_study import ONE_SIDE
from xfrustum.reports.splitting_study.study import make_study
from xfrustum.reports.studies.store import Store

left, put = int(sys.argv[2]), Store.put

def killed_in_the_end(*arguments):
    global left
    left -= 1
    if left < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    put(*arguments)

Store.put = killed_in_the_end
make_study(Path(sys.argv[1]), ONE_SIDE)
"""
"""Measures into a folder, and is killed without warning when so many results are kept and one more is not."""


def results(folder: Path) -> dict[tuple[str, str], str]:
    """Return everything on disk by kind and key; the text of a result has its time in it."""
    try:
        with sqlite3.connect(f"file:{folder / RESULTS}?mode=ro", uri=True) as connection:
            rows = connection.execute("SELECT kind, key, result FROM results").fetchall()
    except sqlite3.OperationalError:  # not there yet
        return {}
    return {(kind, key): result for kind, key, result in rows}


def start(folder: Path, results: int) -> subprocess.Popen[bytes]:
    """Run the study in a process of its own."""
    command = [sys.executable, "-c", CHILD, str(folder), str(results)]
    return subprocess.Popen(command, cwd=CHECKOUT, env=os.environ | {"PYTHONPATH": str(CHECKOUT)})


def assert_resumes_without_loss(folder: Path, tiny: StudyFiles, monkeypatch: pytest.MonkeyPatch) -> None:
    """Resume here, and check that nothing kept is lost or measured again and that all comes out the same."""
    kept = results(folder)
    measured = []
    measure = PictureWorkbench.measure

    def counted(bench: PictureWorkbench, cell: study_grid.Cell) -> CellResult:
        measured.append((PICTURES, cell.key))
        return measure(bench, cell)

    monkeypatch.setattr(PictureWorkbench, "measure", counted)
    resumed = make_study(folder, ONE_SIDE)
    uninterrupted = tuple(row for row in tiny.rows if row.side is Camera.C)
    found = results(folder)
    assert kept.items() <= found.items()
    assert set(measured).isdisjoint(kept)
    # Each row has a picture and sheets of its own: in one scene no two rows share theirs.
    assert len(found) == 2 * len(uninterrupted)
    assert without_times(resumed.rows) == without_times(uninterrupted)


@pytest.mark.slow
def test_killed_at_any_point_it_loses_nothing_and_measures_nothing_twice(
    tiny: StudyFiles, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: dict[tuple[str, str], str] = {}
    for count in (9, 16):  # among sheets, then among slabs
        with start(tmp_path, count) as child:
            assert child.wait() == -signal.SIGKILL
        found = results(tmp_path)
        assert len(found) == len(kept) + count
        assert kept.items() <= found.items()
        assert not (tmp_path / DOCUMENT).exists()
        kept = found
    assert_resumes_without_loss(tmp_path, tiny, monkeypatch)


@pytest.mark.slow
def test_killed_at_any_time_too(tiny: StudyFiles, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(1997)
    kept: dict[tuple[str, str], str] = {}
    for _ in range(8):
        with start(tmp_path, 10**6) as child:
            time.sleep(random.uniform(1.0, 6.0))
            child.kill()
        assert kept.items() <= results(tmp_path).items()
        kept = results(tmp_path)
    assert_resumes_without_loss(tmp_path, tiny, monkeypatch)


def test_a_result_that_is_there_stays(tmp_path: Path) -> None:
    with Store(tmp_path / "s.sqlite", "here") as store:
        store.put("picture", "a", {"value": 1})
        store.put("picture", "a", {"value": 2})
        assert store.get("picture") == {"a": {"value": 1}}
        assert store.get("sheets") == {}
    with Store(tmp_path / "s.sqlite", "elsewhere") as store:
        assert store.get("picture") == {}


def test_another_library_or_device_is_another_origin() -> None:
    here = Origin(versions={"numpy": "2"}, devices={"OpenGL renderer": "one", "cores": "2"})
    assert origin_hash(here) != origin_hash(replace(here, versions={"numpy": "3"}))
    assert origin_hash(here) != origin_hash(replace(here, devices={"OpenGL renderer": "two", "cores": "2"}))
    # How many cores took part changes times alone.
    assert origin_hash(here) == origin_hash(replace(here, devices={"OpenGL renderer": "one", "cores": "8"}))


def test_a_file_that_holds_no_results_is_refused(tmp_path: Path) -> None:
    (tmp_path / RESULTS).write_text("not a database, but longer than the header of one" * 10)
    with pytest.raises(InputError, match="cannot keep results there"):
        make_study(tmp_path, TINY)


# What is written.


def test_the_command_prints_one_object_that_names_every_case(
    tiny: StudyFiles, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(study_grid, "QUICK", TINY)
    folder = tiny.data.parent
    assert main(["study", "splitting", "--quick", "--quiet", "--json", "--out", str(folder)]) == 0
    said = json.loads(capsys.readouterr().out)
    assert len(said["cases"]) == len(outcomes(tiny.rows))
    assert all(case["one_pair"] == bool(case["nears"]) for case in said["cases"])
    assert {Path(file).stem for file in said["files"]["figures"]} == maps(tiny.rows).keys()
    assert without_times(read_parquet(folder / DATA)[0]) == without_times(tiny.rows)


def test_a_full_map_has_every_depth_buffer_and_a_quick_one_is_part_of_it() -> None:
    assert {cell.buffer for cell in FULL.cells()} == {(f, m) for f in DepthFormat for m in DepthMapping}
    assert {cell.key for cell in QUICK.cells()} <= {cell.key for cell in FULL.cells()}
    assert ASKED_SEPARATION in SEPARATIONS


def test_the_map_shows_the_verdicts_of_its_cells(tiny: StudyFiles) -> None:
    drawn = maps(tiny.rows)["when-to-split-c"]
    colors = dict(zip(Suitability, (color for color, _ in drawn.legend), strict=True))
    rows = [row for row in single(tiny.rows) if row.side is Camera.C]
    expected = [[colors[suitability(row)] for row in rows if row.buffer == buffer] for buffer in TINY.buffers]
    assert [list(line) for line in drawn.panels[0][0].lines] == expected


def test_the_published_document_says_what_its_data_say(
    published: tuple[tuple[StudyRow, ...], Origin],
) -> None:
    assert (PUBLISHED / DOCUMENT).read_text(encoding="utf-8") == document(*published)


def test_the_published_figures_show_what_the_data_say(
    published: tuple[tuple[StudyRow, ...], Origin],
) -> None:
    for name, drawn in maps(published[0]).items():
        assert (PUBLISHED / IMAGES / f"{name}.svg").read_text(encoding="utf-8") == svg(drawn)


def test_the_published_data_are_the_full_map(published: tuple[tuple[StudyRow, ...], Origin]) -> None:
    found = {(row.picture, row.near, row.buffer) for row in single(published[0])}
    assert found == {(cell.picture, cell.near, cell.buffer) for cell in FULL.cells()}


def test_what_the_published_table_calls_enough_was_measured_to_be(
    published: tuple[tuple[StudyRow, ...], Origin],
) -> None:
    found = outcomes(published[0])
    for row in published[0]:
        enough = row.near in found[case_of(row)].nears
        measured = (
            (row.displacement_p99 or 0) <= TOLERANCE_PX
            and (row.predicted_p99 or 0) <= TOLERANCE_PX
            and (row.offset is Offset.PLATE or row.near <= row.nearest)
            and row.depth_wrong <= MAX_DEPTH_WRONG * row.judged
            and row.misordered <= MAX_MISORDERED_FRACTION
        )
        assert row.slabs or enough == measured


def test_the_rule_of_thumb_is_never_too_hopeful_about_hyperbolic_depth(
    published: tuple[tuple[StudyRow, ...], Origin],
) -> None:
    rows = [row for row in published[0] if row.family is Family.ONE_SIDE]
    facts = buffer_facts(rows)
    hopeful = {DepthMapping.STANDARD, DepthMapping.GL, DepthMapping.REVERSED}
    for case, outcome in outcomes(rows).items():
        if case.buffer[1] in hopeful and by_the_rule(case, facts):
            assert outcome.one_pair
