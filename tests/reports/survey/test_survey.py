"""Surveys of small plates: rows, JSON objects, pages, and resumption."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

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
    survey,
)
from xfrustum.cli.main import main
from xfrustum.compare.sampling import SampleRequest, risk_of_claim, share_beyond
from xfrustum.reference.truth import TILE_PIXELS, TruthBy, chosen_order
from xfrustum.reports.blocks import Engine, device_index

NEAR, ALL, HERE = 0.8, SampleRequest(sample=None), Engine(workers=1)
COARSE = ("--near", str(NEAR))


@pytest.fixture(scope="module")
def scene_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a scene of two boxes, one on each side of a plate of 5 x 4 hogels."""
    path = tmp_path_factory.mktemp("scene") / "boxes.toml"
    place = named("boxes", "mm") + film((40, 32), (5, 4), (24, 24), (60, 60), (60, 60))
    path.write_text(place + part("box", 12, (4, 0, -14)) + part("box", 6, (-5, 2, 16)))
    return path


@pytest.fixture(scope="module")
def scene(scene_path: Path) -> Scene:
    return open_scene(scene_path)


def surveyed(
    scene_path: Path, out: Path, capsys: pytest.CaptureFixture[str], *more: str
) -> dict[str, Any]:
    """Run the command in this process; return its JSON object and its exit status."""
    words = ["survey", str(scene_path), "--workers", "1", "--out", str(out), "--quiet", "--json"]
    status = main([*words, *more])
    printed = capsys.readouterr()
    return {"status": status, **json.loads(printed.out or "{}"), "errors": printed.err}


@pytest.fixture(scope="module")
def whole(scene_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a survey of all hogels."""
    out = tmp_path_factory.mktemp("whole") / "survey"
    words = [*COARSE, "--all", "--workers", "1", "--quiet", "--out", str(out)]
    assert main(["survey", str(scene_path), *words]) == 0
    return out


def rows_of(out: Path) -> pa.Table:
    paths = sorted(out.glob("survey.parquet/part-*"))
    return pa.concat_tables(pq.ParquetFile(path).read() for path in paths)


def parts_of(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in out.glob("survey.parquet/part-*")}


def assert_same(out: Path, whole: Path) -> None:
    assert parts_of(out) == parts_of(whole)
    assert (out / "index.html").read_bytes() == (whole / "index.html").read_bytes()


def test_every_hogel_of_a_whole_plate_has_a_row_and_the_answer_is_a_fact(
    whole: Path, scene: Scene
) -> None:
    table, answer = rows_of(whole).to_pylist(), json.loads((whole / "survey.json").read_text())
    indices = sorted(aperture.index for aperture in scene.plate.apertures())
    assert sorted((row["column"], row["row"]) for row in table) == indices
    assert {row["device_index"] for row in table} == {device_index()}
    beyond = [
        (row["displacement_px_p99"] or 0) > 0.5 or row["surface_fraction"] > 0.01 for row in table
    ]
    assert (answer["hogels"], answer["judged"], answer["beyond"]) == (20, 20, sum(beyond))
    empty = [row["covered"] == 0 and not bad for row, bad in zip(table, beyond, strict=True)]
    assert 0 < answer["beyond"] < 20 and answer["empty"] == sum(empty)
    assert (answer["share_beyond_at_most"], answer["confidence"]) == (answer["beyond"] / 20, 1.0)
    worst = max(table, key=lambda row: row["displacement_px_p99"] or 0.0)
    assert answer["worst"]["aperture"] == [worst["column"], worst["row"]]
    assert answer["sentence"].startswith(f"{answer['beyond']} of the 20 hogels (")
    page = (whole / "index.html").read_text()
    assert answer["sentence"][1:] in page and 'id="map-0"' in page


def test_a_row_has_the_numbers_and_the_causes_of_its_hogel(whole: Path, scene: Scene) -> None:
    settings, reference = DoubleFrustum(near=NEAR), Reference(scene)
    worst = max(rows_of(whole).to_pylist(), key=lambda row: row["displacement_px_p99"] or 0.0)
    aperture = scene.plate.aperture(worst["column"], worst["row"])
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


def test_samples_are_of_hogels_that_can_show_something(tmp_path: Path) -> None:
    """Other hogels are empty: the bound counts them as within the limits, like a full survey."""
    place = named("corner", "mm") + film((60, 40), (12, 8), (8, 8), (40, 40), (40, 40))
    (tmp_path / "corner.toml").write_text(place + part("box", 3, (-26, 17, -6)))
    scene, settings = open_scene(tmp_path / "corner.toml"), DoubleFrustum(near=2.0)
    most, whole, few = (
        survey(scene, settings, tmp_path / str(size), SampleRequest(sample=size), engine=HERE)
        for size in (75, None, 3)
    )
    seeing = len(most.extent.sample.population)
    assert most.extent.judged == seeing < 40 and most.extent.everything
    assert whole.extent.judged == len(whole.extent.sample.population) == 96
    judged = {(row["column"], row["row"]) for row in rows_of(tmp_path / "75").to_pylist()}
    for row in rows_of(tmp_path / "None").to_pylist():
        if (row["column"], row["row"]) not in judged:
            assert not (row["covered"] or row["beyond"] or row["unexplained"])
    sampled, everything, share = (result.summary() for result in (most, whole, few))
    assert sampled["beyond"] == everything["beyond"] > 0
    assert sampled["share_beyond_at_most"] == everything["share_beyond_at_most"]
    bound = share_beyond(share["beyond"], 3, seeing, risk_of_claim(1))
    assert (share["judged"], share["share_beyond_at_most"]) == (3, bound * seeing / 96)


def test_an_interrupted_survey_resumes_to_the_same_bytes(
    whole: Path, scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = Path(shutil.copytree(whole, tmp_path / "survey"))
    before = {path: path.stat().st_mtime_ns for path in out.glob("survey.parquet/part-*")}
    first, second, *_ = sorted(before)
    first.unlink()
    second.write_bytes(second.read_bytes()[:-1])
    again = surveyed(scene_path, out, capsys, *COARSE, "--all")
    assert again["status"] == 0 and "1 of 10 blocks" in again["errors"]
    assert "are damaged, and are made again" in again["errors"]
    assert {p for p, time in before.items() if p.stat().st_mtime_ns != time} == {first, second}
    assert_same(out, whole)
    other = surveyed(scene_path, out, capsys, "--near", "0.5", "--all")
    assert other["status"] == 2 and f"(near was {NEAR}, now 0.5);" in other["errors"]


def test_a_part_without_blocks_that_ends_first_counts_nothing(
    scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A job array may have more tasks than the plate has blocks."""
    out, words = tmp_path / "survey", (*COARSE, "--sample", "2", "--part", "4/4")
    part = surveyed(scene_path, out, capsys, *words)
    assert (part["status"], part["judged"], part["complete"]) == (0, 0, False)


def test_a_sample_gives_a_bound_that_holds_for_the_whole_plate(
    scene_path: Path, whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    facts, words = json.loads((whole / "survey.json").read_text()), ("--sample", "6", "--seed", "4")
    answer = surveyed(scene_path, tmp_path / "s", capsys, "--nears", f"{NEAR},0.001", *words)
    assert (answer["status"], answer["judged"], answer["confidence"]) == (0, 6, 0.95)
    coarse, fine = answer["settings"]
    assert facts["beyond"] / 20 <= coarse["share_beyond_at_most"]
    # The best setting is reported; with two settings each bound is wider (Bonferroni).
    assert fine["beyond"] == 0 == answer["beyond"]
    bound = share_beyond(0, 6, 20, risk_of_claim(settings=2))
    assert answer["share_beyond_at_most"] == fine["share_beyond_at_most"] == bound
    assert (
        share_beyond(0, 6, 20, risk_of_claim(settings=1)) < bound < coarse["share_beyond_at_most"]
    )


@pytest.mark.slow
def test_limits_decide_the_exit_status(
    scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fine = ("--near", "0.001")
    good = surveyed(scene_path, tmp_path / "good", capsys, *fine, "--until", "40%")
    # The risk of a false bound is divided among all looks; the first look sufficed.
    bound = share_beyond(0, good["judged"], 20, risk_of_claim(look=0))
    assert good["status"] == 0 and good["share_beyond_at_most"] == bound <= 0.4
    bad = surveyed(scene_path, tmp_path / "bad", capsys, *COARSE, "--until", "40%")
    assert bad["status"] == 1 and bad["share_beyond_at_most"] > 0.4
    # No tolerance of displacement permits wrong surfaces.
    cases = [(fine, "0.00001", 1), (fine, "50", 0), (COARSE, "50", 1)]
    for number, (setting, tolerance, status) in enumerate(cases):
        more = (*setting, "--sample", "3", "--tolerance-px", tolerance)
        assert surveyed(scene_path, tmp_path / str(number), capsys, *more)["status"] == status


def test_a_survey_without_settings_is_refused(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one setting"):
        survey(scene, [], tmp_path)


def test_truths_by_directions_give_the_same_rows(
    scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = scene_path.read_text().replace("[5, 4]", "[4, 3]").replace("[24, 24]", "[10, 8]")
    (tmp_path / "small.toml").write_text(small)
    # A few hogels of many pixels need fewer passes hogel by hogel.
    for by, chosen in (("auto", "hogels"), ("directions", "directions")):
        more = (*COARSE, "--all", "--truth-by", by)
        answer = surveyed(tmp_path / "small.toml", tmp_path / by, capsys, *more)
        assert answer["truth_by"] == chosen and 0 < answer["beyond"] < 12
    assert rows_of(tmp_path / "auto").equals(rows_of(tmp_path / "directions"))
    other = surveyed(tmp_path / "small.toml", tmp_path / "auto", capsys, *more)
    assert other["status"] == 2 and '--truth-by was "hogels", now "directions"' in other["errors"]


def test_plates_of_many_small_hogels_are_decided_by_directions(scene: Scene) -> None:
    def many(hogels: tuple[int, int], pixels: int) -> Scene:
        plate = replace(scene.plate, hogels=hogels)
        return replace(scene, plate=plate, frustum=replace(scene.frustum, resolution=(pixels,) * 2))

    assert chosen_order(TruthBy.AUTO, many((500, 500), 32)) is TruthBy.DIRECTIONS
    assert chosen_order(TruthBy.AUTO, many((500, 500), 32), rows=2) is TruthBy.HOGELS
    assert chosen_order(TruthBy.AUTO, many((81, 61), 128)) is TruthBy.HOGELS
    # A row of such hogels does not fit a tile.
    assert TILE_PIXELS < 1024**2 * 81
    assert chosen_order(TruthBy.AUTO, many((81, 61), 1024)) is TruthBy.HOGELS
    with pytest.raises(InputError, match="whole rows of hogels"):
        chosen_order(TruthBy.DIRECTIONS, many((81, 61), 1024))
