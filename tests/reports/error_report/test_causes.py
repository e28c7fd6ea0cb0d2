"""Causes over near: what dominates where, said and drawn."""

from __future__ import annotations

import json
from dataclasses import replace

import pyarrow.parquet as pq
import pytest

from tests.support.rows import NO_CAUSES, comparison_numbers, measured_row
from xfrustum.compare.prediction.chain import LINKS
from xfrustum.reports.error_report.best import cause_sentences, reigns
from xfrustum.reports.error_report.figures import cause_figure
from xfrustum.reports.error_report.measurement import Measurement
from xfrustum.reports.error_report.report import ReportFiles, make_report
from xfrustum.reports.error_report.settings import ReportOptions
from xfrustum.scenes import DepthFormat, DoubleFrustum, Offset, Pivot, open_scene

JUDGED = 10_000


def row(near: float, buffer: DepthFormat = DepthFormat.D24, **surface: int) -> Measurement:
    """Return a made-up row whose causes have numbers of wrong surfaces; _ stands for a space."""
    named = {name.replace("_", " "): count for name, count in surface.items()}
    causes = tuple(replace(cause, surface=named.get(cause.name, 0)) for cause in NO_CAUSES)
    comparison = comparison_numbers(JUDGED, JUDGED, sum(surface.values()) / JUDGED, 0.1)
    return replace(measured_row(DoubleFrustum(near=near, depth=buffer), comparison), causes=causes)


def test_each_cause_reigns_where_it_makes_most_surfaces_wrong() -> None:
    rows = [
        row(1.0, near_offset=500),
        row(1e-6, depth=900, near_offset=3),
        row(1e-2, rasterization=1),
        row(0.1, near_offset=50, depth=20),
        row(1e-4, depth=40),
    ]
    assert [(one.cause, one.low, one.high) for one in reigns(rows)] == [
        ("the depth buffer", 1e-6, 1e-4),
        (None, 1e-2, 1e-2),
        ("the near offset", 0.1, 1.0),
    ]
    (said,) = cause_sentences(rows, "mm")
    assert said == (
        "D24 standard: from n = 1e-6 to 0.0001 mm the depth buffer dominates; at n = 0.01 mm hardly a "
        "surface is wrong; from n = 0.1 to 1 mm the near offset dominates."
    )


def test_without_an_offset_the_first_link_is_the_gap_at_the_plate() -> None:
    stays = row(1.0, near_offset=500)
    (said,) = cause_sentences([replace(stays, settings=replace(stays.settings, offset=Offset.NONE))], "mm")
    assert said == "D24 standard: at n = 1 mm the gap at the plate dominates."


def test_areas_are_shares_of_the_wrong_pixels_and_add_up() -> None:
    rows = [row(1.0, near_offset=30, pivot=60, depth=10), row(0.1, near_offset=1), row(0.01)]
    figure = cause_figure(list(enumerate(rows)), 10.0)
    assert figure is not None
    stacked = {trace.name: dict(zip(trace.x, trace.y, strict=True)) for trace in figure.data}
    assert stacked["near offset"] == {0.01: 100.0, 0.1: 30.0}
    assert stacked["pivot"] == {0.01: 0.0, 0.1: 60.0}
    assert sum(area[0.1] for area in stacked.values()) == pytest.approx(100.0)
    assert cause_figure([(0, row(1.0))], 10.0) is None


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> ReportFiles:
    scene = open_scene("asymmetric-recentered")
    scene = replace(scene, frustum=replace(scene.frustum, resolution=(64, 48)))
    return make_report(
        scene,
        tmp_path_factory.mktemp("report"),
        ReportOptions(
            nears=[1e-5, 0.1, 10.0], apertures=[scene.plate.aperture(3, 4)], pivots=[Pivot.APERTURE]
        ),
    )


def test_causes_add_up_to_the_wrong_pixels_in_every_row(files: ReportFiles) -> None:
    rows = json.loads(files.json.read_text())["rows"]
    assert len(rows) == 15
    for one in rows:
        assert [cause["name"] for cause in one["causes"]] == list(LINKS)
        for kind in ("surface", "triangle"):
            assert sum(cause[kind] for cause in one["causes"]) == one["comparison"][kind]["wrong"]
        assert one["unexplained"] == 0
    assert any(cause["surface"] for one in rows for cause in one["causes"])


def test_what_tracers_alone_would_have_got_wrong_is_told_for_every_aperture(files: ReportFiles) -> None:
    content = json.loads(files.json.read_text())
    (alone,) = content["tracers_alone"]
    assert alone["aperture"] == [3, 4]
    assert alone["judged"] == content["rows"][0]["comparison"]["judged"]
    assert 0 <= alone["mitsuba"] <= alone["judged"] and 0 <= alone["embree"] <= alone["judged"]
    assert "by Embree alone" in files.html.read_text()


def test_causes_are_columns_of_the_table(files: ReportFiles) -> None:
    rows = json.loads(files.json.read_text())["rows"]
    flat = pq.read_table(files.parquet).to_pylist()
    for one, columns in zip(rows, flat, strict=True):
        for cause in one["causes"]:
            stem = "cause_" + cause.pop("name").replace(" ", "_")
            assert {name: columns[f"{stem}_{name}"] for name in cause} == cause


def test_near_offset_moves_what_its_closed_form_says(files: ReportFiles) -> None:
    """The paper's shear has no error of its own: of these links only the near offset displaces."""
    for one in json.loads(files.json.read_text())["rows"]:
        causes = {cause["name"]: cause for cause in one["causes"]}
        for name in ("pivot", "fit", "slabs"):
            assert causes[name]["displacement_rms_px"] in (0.0, None)
        if one["settings"]["near"] == 0.1 and one["settings"]["depth"] == "d32f":
            moved = causes["near offset"]
            expected = moved["predicted_displacement_rms_px"]
            assert moved["displacement_rms_px"] == pytest.approx(expected, rel=0.1)
