"""Camera geometries as settings of a report: lists that multiply the sweep, and both pivots."""

import base64
import io
import json
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.reports.error_report.test_reports import page_data
from xfrustum.cli.main import main
from xfrustum.reports.error_report.images import rgb
from xfrustum.reports.error_report.report import ReportFiles, make_report
from xfrustum.reports.error_report.request import ReportOptions, geometry_grid
from xfrustum.scenes import (
    DepthFormat,
    DepthMapping,
    Fit,
    InputError,
    Offset,
    Pivot,
    open_scene,
)

SHEAR_TOLERANCE = 0.01
"""Largest relative error of the shear against its closed form."""

NEARS = (15.0, 0.15, 1.5e-4)
D32F = ((DepthFormat.D32F, DepthMapping.REVERSED),)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> ReportFiles:
    """A report of a recentered scene at a corner of its plate; other options are the usual ones."""
    scene = open_scene("car-recentered")
    scene = replace(scene, frustum=replace(scene.frustum, resolution=(64, 64)))
    corner = scene.plate.aperture(0, 0)
    return make_report(
        scene,
        tmp_path_factory.mktemp("report"),
        ReportOptions(nears=NEARS, depths=D32F, apertures=[corner]),
    )


def rows(files: ReportFiles, pivot: str) -> list[dict[str, Any]]:
    content = json.loads(files.json.read_text())
    return [row for row in content["rows"] if row["settings"]["pivot"] == pivot]


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("car", ReportOptions(), "aperture plate"),
        ("car", ReportOptions(pivots=[Pivot.CAMERA]), "camera plate"),
        # Cameras in the aperture draw the same with both pivots, and are measured with one.
        (
            "car-recentered",
            ReportOptions(offsets=list(Offset)),
            "aperture plate, aperture none, camera plate",
        ),
        (
            "car-recentered",
            ReportOptions(pivots=list(Pivot), offsets=list(Offset)),
            "aperture plate, aperture none, camera plate, camera none",
        ),
    ],
)
def test_both_pivots_are_measured_where_they_differ_or_are_requested(
    name: str, options: ReportOptions, expected: str
) -> None:
    grid = geometry_grid(open_scene(name).frustum, options)
    assert ", ".join(f"{how.pivot} {how.offset}" for how in grid) == expected


def test_cameras_in_the_aperture_are_measured_with_one_pivot_unless_both_are_asked_for() -> None:
    """Their own centers are the aperture, so that both pivots draw the same."""
    frustum = open_scene("car-recentered").frustum
    geometries = geometry_grid(frustum, ReportOptions(offsets=list(Offset)))
    assert [(geometry.pivot, geometry.offset) for geometry in geometries] == [
        (Pivot.APERTURE, Offset.PLATE),
        (Pivot.APERTURE, Offset.NONE),
        (Pivot.CAMERA, Offset.PLATE),
    ]
    assert len(geometry_grid(frustum, ReportOptions(pivots=list(Pivot), offsets=list(Offset)))) == 4


def test_the_shear_moves_each_point_as_its_closed_form_says(files: ReportFiles) -> None:
    for row in rows(files, "camera"):
        shear = row["shear"]
        assert shear["rms_px"] == pytest.approx(shear["closed_form_rms_px"], rel=SHEAR_TOLERANCE)
    assert rows(files, "camera")[0]["shear"]["rms_px"] > 5
    assert {row["shear"] for row in rows(files, "aperture")} == {None}


def test_the_pivots_are_compared(files: ReportFiles) -> None:
    html, data, content = files.html.read_text(), page_data(files.html), files.content
    assert data["geometries"] == ["pivot aperture", "pivot camera"] and "Cameras compared" in html
    assert [best["pivot"] for best in content["best_per_geometry"]] == ["aperture", "camera"]
    assert content["best"]["pivot"] == "aperture" and "pivot aperture" in files.sentence
    charged = {pivot: rows(files, pivot)[0]["causes"][1] for pivot in ("aperture", "camera")}
    assert charged["aperture"]["surface"] == 0 < charged["camera"]["surface"]


def test_the_command_line_takes_lists(monkeypatch: pytest.MonkeyPatch) -> None:
    def note(_scene: object, _out: object, options: ReportOptions) -> None:
        requested.append(options)
        raise InputError("enough")

    requested: list[ReportOptions] = []
    monkeypatch.setattr("xfrustum.reports.error_report.report.make_report", note)
    lists = (
        "--pivot aperture,camera --fit angle,screen,15 --offset plate,none --slabs 15,40;20;none"
    )
    assert (
        main(f"report car-recentered --no-causes {lists}".split()) == main(["report", "car"]) == 2
    )
    first, usual = requested
    assert (first.pivots, first.fits) == (
        (Pivot.APERTURE, Pivot.CAMERA),
        (Fit.ANGLE, Fit.SCREEN, 15.0),
    )
    assert (first.offsets, first.slabs) == (
        (Offset.PLATE, Offset.NONE),
        ((15.0, 40.0), (20.0,), ()),
    )
    assert usual.causes and not first.causes


def test_the_picture_of_causes_has_the_color_of_each_charged_pixel(files: ReportFiles) -> None:
    data = page_data(files.html)
    colors = {name: tuple(rgb(color)) for name, color in data["cause_colors"].items()}
    for row in data["rows"]:
        encoded = base64.b64decode(data["pictures"][row["pictures"]["causes"]].split(",")[1])
        pixels = np.asarray(Image.open(io.BytesIO(encoded)).convert("RGBA")).reshape(-1, 4)
        shown = Counter(map(tuple, pixels[pixels[:, 3] > 0, :3].tolist()))
        assert shown == {colors[name]: count for name, count in row["causes"].items() if count}
