"""The report of a shaded scene: color in rows, pictures and the page, and what light costs and misses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.reports.error_report.test_reports import page_alone, page_data
from tests.support.views import view
from xfrustum.reports.error_report.best import ReportOptions
from xfrustum.reports.error_report.report import ReportFiles, make_report
from xfrustum.scenes import DepthFormat, DepthMapping, Scene
from xfrustum.scenes.appearance.appearance import Appearance, DirectionalLight, Material
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.model.effects import Effect, needed

NEARS = (1.5, 0.15, 0.015)
DEPTHS = ((DepthFormat.D32F, DepthMapping.REVERSED),)
SHINY = Material(diffuse=(0.5, 0.4, 0.3), specular=(0.3, 0.3, 0.3), exponent=10.0)


def shiny(name: str = "asymmetric") -> Scene:
    scene = view(name, (64, 48))
    light = DirectionalLight(direction=(-1.0, 1.5, 2.0))
    looks = Appearance(materials={"all": SHINY}, lights=(light,))
    return replace(
        scene,
        appearance=looks,
        objects=tuple(replace(o, material="all") for o in scene.objects),
        sampling=Sampling(aperture=3),
        transport=Transport(shadows=True, samples=4),
    )


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> ReportFiles:
    return make_report(shiny(), tmp_path_factory.mktemp("report"), ReportOptions(nears=NEARS, depths=DEPTHS))


def test_every_row_says_how_far_colors_are_off_and_how_different_they_look(files: ReportFiles) -> None:
    errors = [row["comparison"]["radiance"] for row in files.content["rows"]]
    for name in ("rms", "flip"):
        assert errors[0][name] > errors[1][name] > errors[2][name] > 0
    assert errors[0]["ssim"] < errors[1]["ssim"] < errors[2]["ssim"] < 1
    rows = pq.read_table(files.parquet).to_pylist()
    for flat, error in zip(rows, errors, strict=True):
        assert flat["radiance_rms"] == error["rms"] and flat["radiance_flip"] == error["flip"]
        assert flat["radiance_channels_rms"] == error["channels"]["rms"]
        assert flat["radiance_away_from_edges_max"] == error["away_from_edges"]["max"]


def test_effects_are_explained_and_leave_the_same_bits(files: ReportFiles) -> None:
    shading = files.content["shading"]
    used = {decision["effect"] for decision in shading["decisions"] if decision["used"]}
    assert used == {str(effect) for effect in needed(shiny())} != {str(effect) for effect in Effect}
    assert shading["same_bits"] is True
    assert 0 < files.content["times_s"]["light"] < files.content["cost"]["wall_s"]


def test_the_bent_eye_vector_is_predicted_and_measured_at_every_near(files: ReportFiles) -> None:
    errors = files.content["shading"]["eye_vector"]
    assert [error["near"] for error in errors] == list(NEARS)
    last = errors[-1]
    assert last["measured"] == pytest.approx(last["predicted"], rel=0.1)
    assert errors[0]["measured"] > 30 * last["measured"]


def test_what_the_raster_misses_is_counted(files: ReportFiles) -> None:
    (missed,) = files.content["shading"]["left_out"]
    assert missed["shadows"] and not missed["interreflection"]
    assert 0 < missed["pixels"] <= 64 * 48 and missed["darker"] == missed["pixels"]
    assert missed["mean"] < 0 < missed["rms"] and missed["light_paths"] == 4
    assert any("light transport changes" in note for note in files.notes)


def test_the_page_has_light(files: ReportFiles) -> None:
    own = page_alone(files.html)
    for part in (
        "<h2>Light</h2>",
        "What the raster misses",
        "of white</tt>",
        "All three scales of errors are logarithmic",
        "fraction of display white",
        "scale of the right one is logarithmic",
        'id="plot-eye"',
        'id="plot-flip"',
        'data-layer="radiance"',
    ):
        assert part in own
    data = page_data(files.html)
    assert {"radiance", "flip"} <= set(data["curves"][0][0]) and data["eye"]["data"]
    assert all("radiance" in row["pictures"] for row in data["rows"])
    # Colors are part of what is recommended.
    best, html = files.content["best"], files.html.read_text()
    row = next(row for row in files.content["rows"] if row["settings"]["near"] == best["near"])
    assert best["radiance_fraction"] == row["comparison"]["radiance"]["above_step"]
    assert "off in color by more than a level of 255" in files.sentence and "<dt>wrong color</dt>" in html


def test_an_unshaded_scene_has_none_of_it(tmp_path: Path) -> None:
    scene = view("asymmetric", (32, 24))
    files = make_report(scene, tmp_path, ReportOptions(nears=NEARS[:1], depths=DEPTHS))
    assert files.content["shading"] is None
    assert [note for note in files.notes if not note.startswith("Measured at 1 of ")] == []
    assert files.content["rows"][0]["comparison"]["radiance"] is None
    html = files.html.read_text()
    assert "<h2>Light</h2>" not in html and 'id="plot-flip"' not in html
    assert "Both scales of errors are logarithmic" in html and "display white" not in html
    data = page_data(files.html)
    assert data["eye"] is None and "radiance" not in data["rows"][0]["pictures"]
    assert set(data["curves"][0][0]).isdisjoint({"radiance", "flip"})


def test_a_matte_scene_has_no_curve_of_the_eye_vector(tmp_path: Path) -> None:
    scene = replace(shiny(), sampling=Sampling(), transport=Transport())
    matte = {"all": replace(SHINY, specular=(0.0, 0.0, 0.0))}
    scene = replace(scene, appearance=replace(scene.appearance, materials=matte))
    files = make_report(scene, tmp_path, ReportOptions(nears=NEARS[:1], depths=DEPTHS))
    shading = files.content["shading"]
    assert shading["eye_vector"] == [] == shading["left_out"]
    assert 'id="plot-eye"' not in files.html.read_text()
    assert np.isfinite(files.content["rows"][0]["comparison"]["radiance"]["rms"])
