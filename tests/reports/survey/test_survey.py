"""Surveys of small plates: what their rows, their answer and their page say."""

import io
import json
import os
import shutil
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.support.scene_file import film, named, part
from xfrustum import (
    DoubleFrustum,
    InputError,
    Rasterizer,
    Reference,
    Scene,
    budget,
    compare_images,
    open_scene,
)
from xfrustum.cli.main import main
from xfrustum.compare.sampling import SampleRequest, risk_of_claim, share_beyond
from xfrustum.reports.blocks import Engine, device_index
from xfrustum.reports.heat_map import plate_map
from xfrustum.reports.parts import ParquetParts
from xfrustum.reports.survey import rows
from xfrustum.reports.survey.survey import survey
from xfrustum.scenes import Plate

NEAR = 0.8


@pytest.fixture(scope="module")
def scene_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two boxes, one on each side of a plate of 5 by 4 hogels."""
    path = tmp_path_factory.mktemp("scene") / "boxes.toml"
    objects = part("box", 12, (4, 0, -14)) + part("box", 6, (-5, 2, 16))
    path.write_text(
        named("boxes", "mm") + film((40, 32), (5, 4), (24, 24), (60, 60), (60, 60)) + objects
    )
    return path


@pytest.fixture(scope="module")
def scene(scene_path: Path) -> Scene:
    return open_scene(scene_path)


def surveyed(
    scene_path: Path, out: Path, capsys: pytest.CaptureFixture[str], *more: str
) -> dict[str, Any]:
    """Run the command in this process and return its JSON object, with its exit status."""
    words = [
        "survey",
        str(scene_path),
        "--workers",
        "1",
        "--out",
        str(out),
        "--quiet",
        "--json",
        *more,
    ]
    status = main(words)
    printed = capsys.readouterr()
    return {"status": status, **json.loads(printed.out or "{}"), "errors": printed.err}


@pytest.fixture(scope="module")
def whole(scene_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out, printed = tmp_path_factory.mktemp("whole") / "survey", io.StringIO()
    words = ["--near", str(NEAR), "--all", "--workers", "1", "--quiet", "--out", str(out)]
    with redirect_stdout(printed):
        assert main(["survey", str(scene_path), *words]) == 0
    assert Path(printed.getvalue().splitlines()[-1]) == out / "index.html"
    return out


def rows_of(out: Path) -> pa.Table:
    return pa.concat_tables(
        pq.ParquetFile(path).read() for path in sorted(out.glob("survey.parquet/part-*"))
    )


def parts_of(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in out.glob("survey.parquet/part-*")}


def test_every_hogel_of_a_whole_plate_has_a_row_and_the_answer_is_a_fact(
    whole: Path, scene: Scene
) -> None:
    rows = rows_of(whole)
    assert sorted(zip(rows["column"].to_pylist(), rows["row"].to_pylist(), strict=True)) == sorted(
        aperture.index for aperture in scene.plate.apertures()
    )
    assert set(rows["device_index"].to_pylist()) == {device_index()}
    assert len(set(rows["device_renderer"].to_pylist())) == 1 and rows["device_renderer"][0].as_py()
    said = json.loads((whole / "survey.json").read_text())
    displaced = np.array(rows["displacement_px_p99"].to_pylist(), dtype=float) > 0.5
    beyond = displaced | (np.array(rows["surface_fraction"].to_pylist(), dtype=float) > 0.01)
    assert (said["hogels"], said["judged"], said["beyond"]) == (20, 20, int(beyond.sum()))
    assert 0 < said["beyond"] < 20
    covered = np.array(rows["covered"].to_pylist())
    assert said["empty"] == int(((covered == 0) & ~beyond).sum())
    assert (said["share_beyond_at_most"], said["confidence"]) == (said["beyond"] / 20, 1.0)
    worst = int(np.nanargmax(np.array(rows["displacement_px_p99"].to_pylist(), dtype=float)))
    assert said["worst"]["aperture"] == [rows["column"][worst].as_py(), rows["row"][worst].as_py()]
    assert said["sentence"].startswith(f"{said['beyond']} of the 20 hogels (")
    assert [one["settings"]["near"] for one in said["settings"]] == [NEAR]


def test_samples_are_of_hogels_that_can_show_something(tmp_path: Path) -> None:
    """The others are empty and not beyond where all are judged, and the bound counts them so."""
    place = named("corner", "mm") + film((60, 40), (15, 10), (8, 8), (40, 40), (40, 40))
    (tmp_path / "corner.toml").write_text(place + part("box", 3, (-26, 17, -6)))
    scene, settings, here = (
        open_scene(tmp_path / "corner.toml"),
        DoubleFrustum(near=2.0),
        Engine(workers=1),
    )
    found, whole, few = (
        survey(scene, settings, tmp_path / str(sample), SampleRequest(sample=sample), engine=here)
        for sample in (75, None, 3)
    )
    seeing = len(found.extent.sample.population)
    assert found.extent.judged == seeing < 40 and found.extent.everything
    assert whole.extent.judged == len(whole.extent.sample.population) == 150
    judged = {(row["column"], row["row"]) for row in rows_of(tmp_path / "75").to_pylist()}
    for row in rows_of(tmp_path / "None").to_pylist():
        if (row["column"], row["row"]) not in judged:
            assert not (row["covered"] or row["beyond"] or row["unexplained"])
    (sampled,), (everything,), (share,) = found.answers, whole.answers, few.answers
    assert sampled.beyond == everything.beyond > 0
    assert sampled.share_beyond_at_most == everything.share_beyond_at_most
    assert f"{150 - seeing} hogels see nothing of the scene and are not judged" in found.sentence
    assert (share.judged, share.empty) == (3, 0)
    bound = share_beyond(share.beyond, 3, seeing, risk_of_claim(1))
    assert share.share_beyond_at_most == bound * seeing / 150


def test_a_row_has_the_numbers_and_the_causes_of_its_hogel(whole: Path, scene: Scene) -> None:
    rows, settings = rows_of(whole).to_pylist(), DoubleFrustum(near=NEAR)
    worst = max(rows, key=lambda row: row["displacement_px_p99"] or 0.0)
    aperture = scene.plate.aperture(worst["column"], worst["row"])
    reference = Reference(scene)
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(aperture, settings)
    compared = compare_images(reference.trace(aperture), drawn, reference, radiance=False)
    assert compared.surface and compared.displacement_px
    assert worst["surface_wrong"] == compared.surface.wrong > 0
    assert worst["displacement_px_p99"] == compared.displacement_px.p99
    links = budget(scene, settings, aperture).geometry.causes
    for link in links:
        assert worst[f"cause_{link.name.replace(' ', '_')}_surface"] == link.surface
    assert sum(link.surface for link in links) == worst["surface_wrong"]


def test_displacement_by_depth_adds_up_and_the_page_has_maps(whole: Path) -> None:
    for row in rows_of(whole).to_pylist():
        if pixels := sum(row["depth_pixels"]):
            rms = np.sqrt(sum(row["depth_squares_px2"]) / pixels)
            assert rms == pytest.approx(row["displacement_px_rms"])
    page = (whole / "index.html").read_text()
    said = json.loads((whole / "survey.json").read_text())
    assert said["sentence"][1:] in page
    assert 'id="map-0"' in page and 'id="distribution"' in page and 'id="depth"' in page


def test_a_map_is_blank_where_the_nearest_judged_hogel_shows_nothing() -> None:
    tally, places = rows.SettingStats((10, 1)), {"column": [1, 8], "row": [0, 0]}
    numbers = {
        "beyond": [True, False],
        "covered": [9, 0],
        rows.P99: [2.0, None],
        rows.SURFACE: [0.0, 0.0],
    }
    bins = [[0.0] * (len(rows.DEPTH_ENDS) - 1)] * 2
    depth = {f"depth_{name}": bins for name in ("pixels", "squares_px2", "max_px")}
    tally.add(pa.table(places | numbers | depth))
    assert (tally.judged, tally.beyond, tally.empty) == (2, 1, 1)
    plate = Plate(size=(10.0, 1.0), hogels=(10, 1))
    shown = plate_map(plate, tally.maps[rows.P99], "", known=tally.known)["data"][0]["z"]
    assert np.isfinite(shown).tolist() == [[True] * 5 + [False] * 5]


def test_a_survey_goes_on_where_it_was_and_ends_with_the_same_bytes(
    whole: Path, scene: Scene, tmp_path: Path
) -> None:
    out = Path(shutil.copytree(whole, tmp_path / "survey"))
    before = {path: path.stat().st_mtime_ns for path in out.glob("survey.parquet/part-*")}
    gone = sorted(before)[3]
    gone.unlink()
    (out / "index.html").unlink()
    survey(
        scene, DoubleFrustum(near=NEAR), out, SampleRequest(sample=None), engine=Engine(workers=1)
    )
    assert parts_of(out) == parts_of(whole)
    assert {p for p, time in before.items() if p.stat().st_mtime_ns != time} == {gone}
    assert (out / "index.html").read_bytes() == (whole / "index.html").read_bytes()
    with pytest.raises(
        InputError, match=rf"begun with other settings \(near was {NEAR}, now 0.5\);"
    ):
        survey(
            scene,
            DoubleFrustum(near=0.5),
            out,
            SampleRequest(sample=None),
            engine=Engine(workers=1),
        )


@pytest.mark.slow
def test_parts_of_a_job_array_make_the_survey_between_them(
    scene_path: Path, whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, words = tmp_path / "survey", ("--near", str(NEAR), "--all")
    first = surveyed(scene_path, out, capsys, *words, "--part", "2/2")
    assert (first["complete"], first["share_beyond_at_most"]) == (False, None)
    assert not (out / "index.html").exists()
    second = surveyed(scene_path, out, capsys, *words, "--part", "1/2")
    assert (second["complete"], second["judged"]) == (True, 20)
    assert parts_of(out) == parts_of(whole)
    assert (out / "index.html").read_bytes() == (whole / "index.html").read_bytes()


def test_a_sample_gives_a_bound_that_holds_for_the_whole_plate(
    scene_path: Path, whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    facts = json.loads((whole / "survey.json").read_text())
    said = surveyed(
        scene_path,
        tmp_path / "s",
        capsys,
        "--nears",
        f"{NEAR},0.001",
        "--sample",
        "9",
        "--seed",
        "4",
    )
    assert (said["status"], said["judged"], said["confidence"], said["seed"]) == (0, 9, 0.95, 4)
    coarse, fine = said["settings"]
    assert facts["beyond"] / 20 <= coarse["share_beyond_at_most"]
    # The best setting is told.
    assert fine["beyond"] == 0 == said["beyond"]
    assert (
        said["share_beyond_at_most"]
        == fine["share_beyond_at_most"]
        < coarse["share_beyond_at_most"]
    )
    # Bonferroni: with two settings each bound is wider than with one.
    assert fine["share_beyond_at_most"] == share_beyond(0, 9, 20, risk_of_claim(settings=2))
    assert fine["share_beyond_at_most"] > share_beyond(0, 9, 20, risk_of_claim(settings=1))


@pytest.mark.slow
def test_until_stops_at_the_bound_or_where_it_cannot_be_reached(
    scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = surveyed(scene_path, tmp_path / "good", capsys, "--near", "0.001", "--until", "40%")
    assert good["status"] == 0 and good["share_beyond_at_most"] <= 0.4 and good["judged"] < 20
    # Looks share the risk, and the first one was enough.
    assert good["share_beyond_at_most"] == share_beyond(
        0, good["judged"], 20, risk_of_claim(look=0)
    )
    bad = surveyed(scene_path, tmp_path / "bad", capsys, "--near", str(NEAR), "--until", "40%")
    assert bad["status"] == 1 and bad["share_beyond_at_most"] > 0.4


@pytest.mark.slow
def test_a_stated_tolerance_that_is_exceeded_is_a_no(
    scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--near", "0.001", "--sample", "3")
    assert (
        surveyed(scene_path, tmp_path / "a", capsys, *words, "--tolerance-px", "0.00001")["status"]
        == 1
    )
    assert (
        surveyed(scene_path, tmp_path / "b", capsys, *words, "--tolerance-px", "50")["status"] == 0
    )
    # No displacement that is allowed allows wrong surfaces.
    coarse = ("--near", str(NEAR), "--sample", "3", "--tolerance-px", "50")
    assert surveyed(scene_path, tmp_path / "c", capsys, *coarse)["status"] == 1


@pytest.mark.slow
def test_two_surveys_of_one_folder_are_one(
    whole: Path, scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second begins and ends while the first judges its first block."""
    out, write = tmp_path / "survey", ParquetParts.write

    def run() -> None:
        survey(
            scene,
            DoubleFrustum(near=NEAR),
            out,
            SampleRequest(sample=None),
            engine=Engine(workers=1),
        )

    def overtaken(*first: Any) -> None:
        monkeypatch.setattr(ParquetParts, "write", write)
        run()
        assert parts_of(out) == parts_of(whole)
        write(*first)

    monkeypatch.setattr(ParquetParts, "write", overtaken)
    run()
    assert parts_of(out) == parts_of(whole)
    assert (out / "index.html").read_bytes() == (whole / "index.html").read_bytes()


def test_damage_and_pipes_in_a_store_hang_nothing_and_change_no_number(
    scene_path: Path, whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = Path(shutil.copytree(whole, tmp_path / "survey"))
    path = out / "survey.parquet" / "part-0000002.parquet"
    path.write_bytes(path.read_bytes()[:-1])
    said = surveyed(scene_path, out, capsys, "--near", str(NEAR), "--all")
    assert said["status"] == 0 and "note: 1 of 10 blocks in" in said["errors"]
    assert "are damaged, and are made again" in said["errors"]
    assert parts_of(out) == parts_of(whole)
    path.with_name("_description.json").unlink()
    os.mkfifo(path.with_name("_description.json"))
    said = surveyed(scene_path, out, capsys, "--near", str(NEAR), "--all")
    assert said["status"] == 2 and "was begun with another description" in said["errors"]


def test_images_of_another_renderer_are_verified(
    scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["survey", str(scene_path), "--images", "x", "--out", str(tmp_path)]) == 2
    assert "verify SCENE SOURCE --sample N" in capsys.readouterr().err


def test_a_survey_needs_no_engine_to_be_named(scene_path: Path, tmp_path: Path) -> None:
    words = ["--near", "0.001", "--sample", "1", "--quiet", "--out", str(tmp_path / "survey")]
    assert main(["survey", str(scene_path), *words]) == 0
