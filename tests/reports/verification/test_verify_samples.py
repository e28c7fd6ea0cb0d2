"""Samples of another renderer's plate: the verdict of `verify` on each hogel, and a bound on the
rest.
"""

import json
import shutil
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests.support.scene_file import film, named, part
from xfrustum import DoubleFrustum, Rasterizer, open_scene, verify, write_image
from xfrustum.cli.main import main
from xfrustum.compare.sampling import risk_of_claim, share_beyond

HOGELS = (5, 4)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene, and its plate as images; in the folder `bad` the files of a column are missing."""
    folder = tmp_path_factory.mktemp("drawn")
    objects = part("box", 12, (4, 0, -14)) + part("box", 6, (-5, 2, 16))
    scene = folder / "boxes.toml"
    scene.write_text(
        named("boxes") + film((40, 32), HOGELS, (16, 16), (60, 60), (60, 60)) + objects
    )
    opened = open_scene(scene)
    (folder / "bad").mkdir()
    with Rasterizer(opened) as rasterizer:
        for here in opened.plate.apertures():
            name = f"{here.column}x{here.row}.exr"
            write_image(folder / name, rasterizer.render(here, DoubleFrustum(near=0.001)))
            if here.column != 2:
                shutil.copy(folder / name, folder / "bad")
    return folder


def verified(drawn: Path, capsys: pytest.CaptureFixture[str], *more: str) -> dict[str, Any]:
    """Run the command on the good images, or on a folder's, and return its JSON object."""
    words = ["verify", str(drawn / "boxes.toml"), *more, "--quiet", "--json"]
    status = main(words)
    printed = capsys.readouterr()
    return {"status": status, **json.loads(printed.out or "{}"), "errors": printed.err}


def test_a_sample_has_the_verdicts_of_verify_and_bounds_the_plate(
    drawn: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pattern = str(drawn / "bad" / "{i}x{j}.exr")
    plate = verify(open_scene(drawn / "boxes.toml"), pattern).hogels
    whole = {hogel.aperture.index: hogel for hogel in plate}
    verification = verified(
        drawn, capsys, pattern, "--sample", "9", "--seed", "3", "--out", str(tmp_path)
    )
    assert len(verification["hogels"]) == 9 and verification["sample"]["hogels"] == 20
    for hogel in verification["hogels"]:
        assert hogel["verdict"] == whole[tuple(hogel["aperture"])].verdict
    failed = sum(hogel["verdict"] != "pass" for hogel in verification["hogels"])
    assert verification["sample"]["beyond"] == failed > 0 and verification["status"] == 1
    assert verification["share_beyond_at_most"] == share_beyond(failed, 9, 20, risk_of_claim(1))
    assert (
        verification["share_beyond_at_most"]
        >= sum(not entry.passed for entry in whole.values()) / 20
    )
    assert verification["confidence"] == 0.95
    rows = pq.read_table(tmp_path / "hogels.parquet").to_pylist()
    assert sum(row["beyond"] for row in rows) == failed
    for row in rows:
        hogel = whole[row["column"], row["row"]]
        assert (row["verdict"], row["problem"]) == (hogel.verdict, hogel.problem)
        assert row["shown"] == (hogel.as_found and hogel.as_found.shown)
    assert "of the plate&#39;s 20 hogels" in (tmp_path / "index.html").read_text()


def test_all_hogels_in_the_sample_are_facts(
    drawn: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    verification = verified(drawn, capsys, str(drawn / "{i}x{j}.exr"), "--sample", "20")
    assert (
        verification["share_beyond_at_most"],
        verification["confidence"],
        verification["status"],
    ) == (0.0, 1.0, 0)


@pytest.mark.parametrize("workers", [(), pytest.param(("--workers", "2"), marks=pytest.mark.slow)])
def test_until_stops_at_the_bound_or_where_it_cannot_be_reached(
    workers: tuple[str, ...], drawn: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = ("--until", "40%", *workers)
    good = verified(drawn, capsys, str(drawn / "{i}x{j}.exr"), *more)
    judged = len(good["hogels"])
    assert good["status"] == 0 and judged < 20
    assert good["share_beyond_at_most"] == share_beyond(0, judged, 20, risk_of_claim(look=0)) <= 0.4
    bad = verified(drawn, capsys, str(drawn / "bad" / "{i}x{j}.exr"), "--until", "5%", *workers)
    assert bad["status"] == 1 and bad["share_beyond_at_most"] > 0.05


def test_until_is_a_stated_limit_where_measures_are_accepted(
    drawn: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Accepted measures excuse limits that were not stated; a bound above --until they do not."""
    accepted = (str(drawn / "bad" / "{i}x{j}.exr"), "--baseline", str(tmp_path), "--approve")
    assert verified(drawn, capsys, *accepted, "--sample", "9")["status"] == 0
    assert verified(drawn, capsys, *accepted, "--until", "5%")["status"] == 1
    assert verified(drawn, capsys, *accepted, "--until", "90%")["status"] == 0


def test_a_sample_is_of_the_whole_plate(drawn: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pattern = str(drawn / "{i}x{j}.exr")
    for more, text in (
        (("--sample", "3", "--apertures", "0,0"), "omit --apertures"),
        (("--sample", "3", "--until", "1%"), "exclude each other"),
        (("--until", "40%", "--part", "1/2", "--out", "nowhere"), "use --sample"),
    ):
        verification = verified(drawn, capsys, pattern, *more)
        assert verification["status"] == 2 and text in verification["errors"]
