"""The report: swept settings, numbers in its files, and files that are complete or absent."""

import base64
import io
import json
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from tests.support.views import view
from xfrustum import (
    DepthFormat,
    DepthMapping,
    Fit,
    InputError,
    Offset,
    Pivot,
    Reference,
    ReportFiles,
    ReportOptions,
    make_report,
    open_scene,
)
from xfrustum.cli.main import main
from xfrustum.compare.prediction.predict import LINKS
from xfrustum.compare.rounding.triangles import largest_tolerance
from xfrustum.reports.common import pictures
from xfrustum.reports.error_report import report
from xfrustum.reports.error_report.report import FILES
from xfrustum.reports.error_report.sweep import default_nears, geometry_grid, settings_of
from xfrustum.scenes.appearance import Appearance, DirectionalLight, Material, Sampling, Transport

NEARS = (15.0, 0.015, 1.5e-4)
DEPTHS = ((DepthFormat.D24, DepthMapping.STANDARD), (DepthFormat.D32F, DepthMapping.REVERSED))
QUICK = ReportOptions(nears=[1.0], depths=DEPTHS[:1])


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> ReportFiles:
    """Return a report of a sheared frustum, hence with three apertures and both pivots."""
    out = tmp_path_factory.mktemp("report") / "new" / "folder"
    options = ReportOptions(nears=NEARS, depths=DEPTHS)
    return make_report(view("asymmetric-recentered", (64, 48)), out, options)


def page_data(page: Path) -> dict[str, Any]:
    """Return the data of the page's script."""
    match = re.search(r'<script type="application/json" id="data">(.*?)</script>', page.read_text())
    data: dict[str, Any] = json.loads(match[1], parse_constant=pytest.fail)
    return data


def decoded(encoded: bytes) -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
    return np.asarray(Image.open(io.BytesIO(encoded)).convert("RGBA"))


def test_json_is_the_returned_record_and_its_best_setting_is_at_its_worst_aperture(
    files: ReportFiles,
) -> None:
    content, best = files.content, files.content["best"]
    assert json.loads(files.json.read_text(), parse_constant=pytest.fail) == content
    apertures = [(a["column"], a["row"]) for a in content["apertures"]]
    assert apertures == [(40, 30), (0, 0), (80, 60)]
    assert len(content["rows"]) == 3 * 2 * len(NEARS) * len(DEPTHS)
    assert [(b["depth"], b["mapping"]) for b in content["best_per_depth"]] == [*DEPTHS]
    assert content["shading"] is None and content["rows"][0]["comparison"]["radiance"] is None
    own = [row for row in content["rows"] if row["settings"].items() <= best.items()]
    worst = max(own, key=lambda row: row["comparison"]["surface"]["fraction"])
    assert len(own) == 3 and best["aperture"] == worst["aperture"] != [20, 15]
    column, row = best["aperture"]
    options = f"--near {best['near']:g} --depth {best['depth']} --mapping {best['mapping']}"
    assert f"--aperture {column},{row} {options}" in files.command == best["command"]
    for stage in ("raster", "compare"):
        spent = sum(row["times_s"][stage] for row in content["rows"])
        assert spent == pytest.approx(content["times_s"][stage])


def test_parquet_has_a_row_per_aperture_and_setting_with_predictions_and_causes(
    files: ReportFiles,
) -> None:
    table = pq.read_table(files.parquet).to_pylist()
    for columns, row in zip(table, files.content["rows"], strict=True):
        comparison, ratios = row["comparison"], row["measured_over_predicted"]
        assert [columns["aperture_column"], columns["aperture_row"]] == row["aperture"]
        assert row["settings"].items() <= columns.items()
        assert columns["surface_wrong"] == comparison["surface"]["wrong"]
        assert columns["time_raster_s"] == row["times_s"]["raster"]
        assert columns["version_numpy"] == np.__version__ and columns["device_opengl_renderer"]
        assert [cause["name"] for cause in row["causes"]] == list(LINKS)
        for cause in row["causes"]:
            stem = f"cause_{cause['name'].replace(' ', '_')}_"
            assert columns[stem + "surface"] == cause["surface"]
            assert columns[stem + "displacement_rms_px"] == cause["displacement_rms_px"]
        for kind in ("surface", "triangle"):
            assert sum(cause[kind] for cause in row["causes"]) == comparison[kind]["wrong"]
        assert row["unexplained"] == 0
        share = comparison["surface"]["fraction"] / row["predicted_surface"]["fraction"]
        assert ratios["surface"] == columns["measured_over_predicted_surface"] == share
        predicted, measured = row["predicted_displacement_px"], comparison["displacement_px"]
        assert ratios["displacement_rms"] == measured["rms"] / predicted["rms"]
        if row["settings"]["near"] == 0.015:
            # Above the limit of float32, the closed form and the pixels agree (docs/method.md).
            assert predicted["rms"] == pytest.approx(measured["rms"], rel=0.05)


def test_the_page_is_one_file_with_pictures_and_curves_of_every_row(files: ReportFiles) -> None:
    html, data = files.html.read_text(), page_data(files.html)
    own = re.sub(r"<script>.*?</script>", "", html, count=1, flags=re.DOTALL)
    assert html.count("* plotly.js v") == 1, "plotly.js is inside"
    assert not re.search(r"https?:|//cdn|@import|url\(", own)
    assert not re.search(r'(src|href)\s*=\s*"(?!data:|inspect\.html")', own)
    assert files.sentence in own.replace("\u00a0", " ") and f"<code>{files.command}</code>" in own
    for (curves, _), aperture in zip(data["curves"], data["apertures"], strict=True):
        numbers = {n for line in curves["surface"]["data"] for n in line.get("customdata", ())}
        assert len(numbers) == len(NEARS) * len(DEPTHS)
        assert all(data["rows"][number]["aperture"] == aperture for number in numbers)
    colors = {name: pictures.rgb(color) for name, color in data["cause_colors"].items()}
    for row in data["rows"]:
        stored = data["pictures"][row["pictures"]["causes"]].split(",")[1]
        pixels = decoded(base64.b64decode(stored)).reshape(-1, 4)
        counts = Counter(map(tuple, pixels[pixels[:, 3] > 0, :3].tolist()))
        charged = {colors[cause["name"]]: cause["surface"] for cause in row["causes"]}
        assert counts == {color: count for color, count in charged.items() if count}
    assert sorted(path.name for path in files.html.parent.iterdir()) == sorted(FILES)


def test_pivots_are_compared_and_the_shear_about_the_cameras_is_a_cause(
    files: ReportFiles,
) -> None:
    content, rows = files.content, files.content["rows"]
    assert page_data(files.html)["geometries"] == ["pivot aperture", "pivot camera"]
    assert [best["pivot"] for best in content["best_per_geometry"]] == ["aperture", "camera"]
    cameras = [row for row in rows if row["settings"]["pivot"] == "camera"]
    assert max(row["causes"][1]["displacement_rms_px"] for row in cameras) > 5
    assert max(row["causes"][1]["surface"] for row in cameras) > 0
    for row in rows:
        if row["settings"]["pivot"] == "aperture":
            assert row["causes"][1]["surface"] == 0


@pytest.mark.parametrize(
    ("name", "pivots", "expected"),
    [
        ("car", None, "aperture plate, aperture none"),
        # Cameras in the aperture draw equal images with both pivots: one pivot is measured.
        ("car-recentered", None, "aperture plate, aperture none, camera plate"),
        ("car-recentered", list(Pivot), "aperture plate, aperture none, camera plate, camera none"),
    ],
)
def test_both_pivots_are_measured_where_they_differ_or_are_requested(
    name: str, pivots: list[Pivot] | None, expected: str
) -> None:
    options = ReportOptions(pivots=pivots, offsets=list(Offset))
    grid = geometry_grid(open_scene(name).frustum, options)
    assert ", ".join(f"{how.pivot} {how.offset}" for how in grid) == expected


def test_usual_nears_of_cameras_without_an_offset_end_before_the_first_cut() -> None:
    frustum, cuts = open_scene("car").frustum, [(5.0,), (20.0,)]
    options = ReportOptions(offsets=[Offset.NONE], slabs=cuts, depths=DEPTHS[:1])
    for cut in cuts:
        nears = {each.near for each in settings_of(frustum, options) if each.slabs == cut}
        assert nears == {near for near in default_nears(frustum) if near < cut[0]}


def test_the_command_line_takes_lists(monkeypatch: pytest.MonkeyPatch) -> None:
    def note(_scene: object, _out: object, options: ReportOptions) -> None:
        requested.append(options)
        raise InputError("enough")

    requested: list[ReportOptions] = []
    monkeypatch.setattr("xfrustum.reports.error_report.report.make_report", note)
    lists = "--pivot aperture,camera --fit angle,screen,15 --slabs 15,40;20;none"
    assert main(f"report car-recentered {lists}".split()) == 2
    (options,) = requested
    assert options.pivots == (Pivot.APERTURE, Pivot.CAMERA)
    assert options.fits == (Fit.ANGLE, Fit.SCREEN, 15.0)
    assert options.slabs == ((15.0, 40.0), (20.0,), ())


def test_an_empty_scene_has_a_report_too(files: ReportFiles, tmp_path: Path) -> None:
    """The empty table has the columns and types of a full one, so that both can be concatenated."""
    made = make_report(view("empty", (16, 16)), tmp_path / "out", QUICK)
    assert "there is nothing to judge" in made.sentence
    (row,) = made.content["rows"]
    assert row["comparison"]["surface"]["wrong"] == 0 == row["predicted_surface"]["fraction"]
    assert row["comparison"]["displacement_px"] is None is row["predicted_displacement_px"]
    assert row["smallest_separation"] == {"c": None, "c_star": None}
    assert set(row["measured_over_predicted"].values()) == {None}
    assert pq.read_schema(made.parquet).equals(pq.read_schema(files.parquet))


def test_a_report_replaces_its_files_and_keeps_others_and_a_failure_touches_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "report.json").write_text("old")
    (tmp_path / "notes.txt").write_text("mine")
    with monkeypatch.context() as failing:
        failing.setattr(report, "table_of", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            make_report(view("empty", (8, 8)), tmp_path, QUICK)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.txt", "report.json"]
    assert (tmp_path / "report.json").read_text() == "old"
    make_report(view("empty", (8, 8)), tmp_path, QUICK)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*FILES, "notes.txt"])
    with pytest.raises(InputError, match="nothing to measure"):
        make_report(view("empty", (8, 8)), tmp_path / "out", ReportOptions(nears=[]))
    assert not (tmp_path / "out").exists()


def test_height_errors_within_rounding_are_not_tinted() -> None:
    scene = open_scene("asymmetric")
    reach = scene.frustum.longest_reach
    heights = pictures.height_range(scene, reach)
    rounding = max(largest_tolerance(scene), 1e-6 * reach)
    shown = decoded(pictures.height_map(np.array([[0.0, rounding, 1e-3 * reach]]), reach, heights))
    white, same, tinted = shown[0, :, :3].astype(int)
    np.testing.assert_array_equal(white, same)
    assert np.ptp(tinted) > 50 and heights[0] >= 1e-6


def test_a_reduced_picture_keeps_the_worst_pixel_of_a_block() -> None:
    wrong = np.zeros((4, 6), dtype=np.bool_)
    wrong[3, 1] = True
    reduced = decoded(pictures.mask(wrong, pictures.SURFACE_COLOR, 2))
    np.testing.assert_array_equal(reduced[..., 3], [[0, 0, 0], [255, 0, 0]])
    height = np.array([[0.5, -1.0, np.nan], [0.0, np.nan, np.nan]])
    shown = decoded(pictures.height_map(height, 100.0, (1e-6, 1e-2), 2))
    lowest = decoded(pictures.height_map(height[:1, 1:2], 100.0, (1e-6, 1e-2)))
    np.testing.assert_array_equal(shown[0, 0], lowest[0, 0])


def test_without_causes_numbers_are_the_same_and_nothing_more_is_traced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = view("asymmetric-recentered", (32, 24))
    options = ReportOptions(apertures=[scene.plate.middle], nears=(10.0, 0.1), depths=DEPTHS[:1])
    charged = make_report(scene, tmp_path / "charged", options)
    for name in ("trace_model", "gaps"):
        monkeypatch.setattr(Reference, name, None)  # causes alone call it
    plain = make_report(scene, tmp_path / "plain", replace(options, causes=False))
    assert charged.content["left_out"] == [] != plain.content["left_out"]
    for row, other in zip(plain.content["rows"], charged.content["rows"], strict=True):
        assert all(row[key] == other[key] for key in ("settings", "aperture", "comparison"))
        assert row["causes"] == [] and set(row["measured_over_predicted"].values()) == {None}
        assert row["unexplained"] is row["predicted_surface"] is None
    assert pq.read_schema(plain.parquet).equals(pq.read_schema(charged.parquet))
    assert 'id="plot-causes"' in charged.html.read_text()
    assert 'id="plot-causes"' not in plain.html.read_text()


def test_a_shaded_scene_has_errors_of_color_the_bent_eye_and_missed_light(
    files: ReportFiles, tmp_path: Path
) -> None:
    scene, nears = view("asymmetric", (64, 48)), (1.5, 0.15, 0.015)
    shiny = Material(diffuse=(0.5, 0.4, 0.3), specular=(0.3, 0.3, 0.3), exponent=10.0)
    light = DirectionalLight(direction=(-1.0, 1.5, 2.0))
    scene = replace(
        scene,
        appearance=Appearance(materials={"all": shiny}, lights=(light,)),
        objects=tuple(replace(part, material="all") for part in scene.objects),
        sampling=Sampling(aperture=3),
        transport=Transport(shadows=True, samples=4),
    )
    lit = make_report(scene, tmp_path, ReportOptions(nears=nears, depths=DEPTHS[1:]))
    errors = [row["comparison"]["radiance"] for row in lit.content["rows"]]
    for name in ("rms", "flip"):
        assert errors[0][name] > errors[1][name] > errors[2][name] > 0
    assert errors[0]["ssim"] < errors[1]["ssim"] < errors[2]["ssim"] < 1
    table = pq.read_table(lit.parquet)
    assert table.schema.equals(pq.read_schema(files.parquet))
    assert table["radiance_rms"].to_pylist() == [error["rms"] for error in errors]
    shading = lit.content["shading"]
    assert shading["same_bits"] is True
    bent = shading["eye_vector"]
    assert [error["near"] for error in bent] == list(nears)
    assert bent[-1]["measured"] == pytest.approx(bent[-1]["predicted"], rel=0.1)
    (missed,) = shading["left_out"]
    assert missed["shadows"] and not missed["interreflection"]
    assert 0 < missed["pixels"] <= 64 * 48 and missed["darker"] == missed["pixels"]
    assert missed["mean"] < 0 < missed["rms"] and missed["light_paths"] == 4
    data = page_data(lit.html)
    assert data["eye"]["data"] and all("radiance" in row["pictures"] for row in data["rows"])
