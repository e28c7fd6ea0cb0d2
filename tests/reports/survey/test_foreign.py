"""Surveys of the plates of other renderers say what `verify` says."""

import json
import re
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.support.scene_file import film, named, part
from xfrustum import DoubleFrustum, Rasterizer, Scene, open_scene, verify, write_image, write_plate
from xfrustum.cli.main import main
from xfrustum.reports.exchange.convert import LaidOutPlate
from xfrustum.reports.scout import MAX_MAP_CELLS
from xfrustum.reports.verification.sources import as_given
from xfrustum.reports.verification.verdict import Verification
from xfrustum.scenes.model.plate_content import Channel, PlateContent


def rows_of(out: Path) -> list[dict[str, Any]]:
    parts = sorted(out.glob("survey.parquet/part-*"))
    rows: list[dict[str, Any]] = pa.concat_tables(pq.ParquetFile(path).read() for path in parts).to_pylist()
    return rows


def box(path: Path, hogels: tuple[int, int], resolution: tuple[int, int], size: tuple[float, float]) -> Path:
    """Write a scene of one box behind the plate."""
    text = named("box") + film(size, hogels, resolution, (60, 60), (60, 60)) + part("box", 12, (4, 0, -14))
    path.write_text(text)
    return path


def draw(scene: Scene, near: float, pattern: Path, missing: tuple[int, int] | None = None) -> None:
    """Draw the plate into files, but for one hogel."""
    with Rasterizer(scene) as rasterizer:
        for one in scene.plate.apertures():
            if one.index != missing:
                image = rasterizer.render(one, DoubleFrustum(near=near))
                write_image(Path(str(pattern).format(i=one.column, j=one.row)), image)


def survey_of(scene: Path, pattern: Path, out: Path, *more: str) -> int:
    words = ["survey", str(scene), "--images", str(pattern), "--all", "--out", str(out), "--quiet", *more]
    return main([*words, "--workers", "1"])


def assert_alike(rows: list[dict[str, Any]], verified: Verification) -> None:
    """Compare the rows of a survey with the hogels of a verification, number by number."""
    by_place = {(row["column"], row["row"]): row for row in rows}
    assert len(by_place) == len(rows) == len(verified.hogels)
    for hogel in verified.hogels:
        row = by_place[hogel.aperture.index]
        assert (row["verdict"], row["beyond"]) == (hogel.verdict, not hogel.passed)
        found = hogel.as_found
        if found is None:
            assert (row["problem"], row["wrong"]) == (hogel.problem, None)
            continue
        assert (row["shown"], row["wrong"], row["by"]) == (found.shown, found.wrong, found.by)
        assert row["surface_wrong"] == (found.surface.wrong if found.surface else None)
        assert row["displacement_px_p99"] == (found.displacement_px.p99 if found.displacement_px else None)
        assert hogel.corrected is not None
        assert row["corrected_wrong"] == hogel.corrected.wrong


def test_a_survey_of_images_says_what_verify_says(tmp_path: Path) -> None:
    path, pattern, out = tmp_path / "boxes.toml", tmp_path / "{i}x{j}.exr", tmp_path / "survey"
    box(path, (3, 2), (24, 24), (40, 32)).write_text(path.read_text() + part("box", 6, (-5, 2, 16)))
    scene = open_scene(path)
    draw(scene, 0.5, pattern, missing=(2, 1))
    assert survey_of(path, pattern, out) == 1
    verified = verify(scene, str(pattern))
    rows = rows_of(out)
    assert_alike(rows, verified)
    said = json.loads((out / "survey.json").read_text())
    assert said["beyond"] == sum(not hogel.passed for hogel in verified.hogels) > 1
    # A hogel that is missing is worse than any that is wrong.
    assert said["worst"] == {"aperture": [2, 1], "displacement_p99_px": None, "surface_fraction": None}
    page = (out / "index.html").read_text()
    assert "<b>2,1</b>: missing</summary>" in page
    assert "This hogel is missing" in page


def test_rows_name_files_as_they_were_given_whatever_folder_that_was_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = []
    for folder in (tmp_path / "one", tmp_path / "another" / "folder"):
        folder.mkdir(parents=True)
        monkeypatch.chdir(folder)
        path = box(Path("box.toml"), (2, 1), (8, 8), (40, 32))
        scene = open_scene(path)
        draw(scene, 0.5, Path("{i}x{j}.exr"), missing=(1, 0))
        survey_of(path, Path("{i}x{j}.exr"), Path("out"))
        told.append([row["problem"] for row in rows_of(Path("out"))])
        verified = verify(scene, "{i}x{j}.exr")
        assert told[-1] == [hogel.problem for hogel in verified.hogels]
    assert told[0] == told[1]
    missing = told[0][1]
    assert missing is not None and missing.startswith("1x0.exr: ")


def test_only_the_folder_that_files_were_named_from_is_left_out_of_a_text() -> None:
    folder = Path("/a/b")
    assert as_given("/a/b/c.png: is none, unlike /a/b/d.png", folder) == "c.png: is none, unlike d.png"
    for other in ("/x/a/b/c.png", "/a/bc.png", "../a/b/c.png"):
        assert as_given(other, folder) == other
    assert as_given("/a/b/c.png", None) == as_given("/a/b/c.png", Path("/")) == "/a/b/c.png"


def test_a_wide_plate_of_which_nothing_can_be_read_has_a_small_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "br{a}ce"
    folder.mkdir()
    box(folder / "box.toml", (300, 1), (8, 6), (20, 8))
    (folder / "0x0.exr").write_bytes(b"damaged")
    monkeypatch.chdir(folder)
    words = ("--images", "{i}x{j}.exr", "--sample", "5", "--workers", "1", "--quiet", "--out", "survey")
    assert main(["survey", "box.toml", *words]) == 1
    page = Path("survey/inspect.html").read_text()
    found = re.search(r'id="data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    # A cell for each hogel of a plate of millions would be megabytes of nothing.
    assert [len(row) for row in json.loads(found[1])["cells"]] == [MAX_MAP_CELLS]


def test_a_survey_reads_any_layout_and_says_which_one_it_looks_like(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = box(tmp_path / "box.toml", (3, 2), (8, 6), (20, 8)), tmp_path / "survey"
    scene = open_scene(path)
    views = LaidOutPlate(out=tmp_path / "views", layout="views")
    content = PlateContent(channels=(Channel.TRIANGLE,))
    write_plate(scene, DoubleFrustum(near=0.001), views.group, content=content)
    views.write(scene)
    asked = ("--encoding", "triangle-id")
    assert survey_of(path, views.files, out, *asked) == 0
    assert f"note: {views.files} looks like views (48 of 48 names fit" in capsys.readouterr().err
    verified = verify(scene, str(views.files), layout="views", encoding="triangle-id")
    assert_alike(rows_of(out), verified)
    # The layout that was found is stated to all processes, and may be stated by the user.
    assert survey_of(path, views.files, out, *asked, "--layout", "views") == 0
    assert "looks like" not in capsys.readouterr().err
    (views.files / "3_4.png").touch()
    assert survey_of(path, views.files, out, *asked, "--layout", "views") == 2
    assert "begun with another state of the images" in capsys.readouterr().err
    assert survey_of(path, views.files, tmp_path / "other", *asked, "--layout", "burnett") == 2
    assert "cannot be read in the layout burnett" in capsys.readouterr().err
