"""Samples bound the share of wrong hogels; blocks of several processes equal blocks of one."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests.support.scene_file import film, named, part
from xfrustum import (
    DoubleFrustum,
    InputError,
    Rasterizer,
    Reference,
    VerifyOptions,
    open_scene,
    verify,
    write_image,
)
from xfrustum.cli.main import main
from xfrustum.compare.sampling import risk_of_claim, share_beyond
from xfrustum.reports.verification.jobs import QUESTION
from xfrustum.reports.verification.request import Request
from xfrustum.reports.verification.sources import opened, require_state, state_of

Capture = pytest.CaptureFixture[str]


def drawn(folder: Path, hogels: tuple[int, int], near: float = 0.001) -> Path:
    """Write a scene and the images of its plate; return the scene file's path."""
    path = folder / "boxes.toml"
    objects = part("box", 12, (4, 0, -14)) + part("box", 6, (-5, 2, 16))
    path.write_text(named("boxes") + film((40, 32), hogels, (16, 16), (60, 60), (60, 60)) + objects)
    scene = open_scene(path)
    with Rasterizer(scene) as rasterizer:
        for aperture in scene.plate.apertures():
            image = rasterizer.render(aperture, DoubleFrustum(near=near))
            write_image(path.with_name(f"{aperture.column}x{aperture.row}.exr"), image)
    return path


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a plate of 3 x 2 hogels with right images, so that nothing is diagnosed."""
    return drawn(tmp_path_factory.mktemp("right"), (3, 2))


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a plate of 5 x 4 hogels; the folder `bad` lacks the files of one column."""
    path = drawn(tmp_path_factory.mktemp("large"), (5, 4))
    (path.parent / "bad").mkdir()
    for file in path.parent.glob("[0134]x*.exr"):
        shutil.copy(file, path.parent / "bad")
    return path


def verified(scene: Path, capsys: Capture, *words: str, out: Path | None = None) -> dict[str, Any]:
    """Run the command; return its JSON object with exit status and messages."""
    place = [] if out is None else ["--out", str(out)]
    capsys.readouterr()
    status = main(["verify", str(scene), *words, *place, "--quiet", "--json"])
    printed = capsys.readouterr()
    return {**json.loads(printed.out or "{}"), "status": status, "errors": printed.err}


def files_of(out: Path) -> dict[str, bytes]:
    names = ("index.html", "verification.json")
    return {name: (out / name).read_bytes() for name in names if (out / name).exists()}


def times_of(out: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in out.glob("*.parquet/part-*")}


def test_a_sample_has_the_verdicts_of_verify_and_bounds_the_plate(
    large: Path, tmp_path: Path, capsys: Capture
) -> None:
    pattern = str(large.parent / "bad" / "{i}x{j}.exr")
    whole = {hogel.aperture.index: hogel for hogel in verify(open_scene(large), pattern).hogels}
    result = verified(large, capsys, pattern, "--sample", "9", "--seed", "3", out=tmp_path)
    assert len(result["hogels"]) == 9 and result["sample"]["hogels"] == 20
    for hogel in result["hogels"]:
        assert hogel["verdict"] == whole[tuple(hogel["aperture"])].verdict
    failed = sum(hogel["verdict"] != "pass" for hogel in result["hogels"])
    assert result["sample"]["beyond"] == failed > 0 and result["status"] == 1
    assert result["share_beyond_at_most"] == share_beyond(failed, 9, 20, risk_of_claim(1)) >= 0.2
    rows = pq.read_table(tmp_path / "hogels.parquet").to_pylist()
    assert sum(row["beyond"] for row in rows) == failed
    for row in rows:
        hogel = whole[row["column"], row["row"]]
        assert (row["verdict"], row["problem"]) == (hogel.verdict, hogel.problem)
        assert row["shown"] == (hogel.as_found and hogel.as_found.shown)
    every = verified(large, capsys, str(large.parent / "{i}x{j}.exr"), "--sample", "20")
    assert (every["share_beyond_at_most"], every["confidence"], every["status"]) == (0.0, 1.0, 0)


@pytest.mark.parametrize("workers", [(), pytest.param(("--workers", "2"), marks=pytest.mark.slow)])
def test_until_stops_at_the_bound_or_where_it_cannot_be_reached(
    workers: tuple[str, ...], large: Path, tmp_path: Path, capsys: Capture
) -> None:
    bad = str(large.parent / "bad" / "{i}x{j}.exr")
    good = verified(large, capsys, str(large.parent / "{i}x{j}.exr"), "--until", "40%", *workers)
    judged = len(good["hogels"])
    assert good["status"] == 0 and judged < 20
    assert good["share_beyond_at_most"] == share_beyond(0, judged, 20, risk_of_claim(look=0)) <= 0.4
    failed = verified(large, capsys, bad, "--until", "5%", *workers)
    assert failed["status"] == 1 and failed["share_beyond_at_most"] > 0.05
    # Accepted measures excuse only default limits; a bound above --until stays a failure.
    accepted = (bad, "--baseline", str(tmp_path), "--approve")
    for words, status in ((("--sample", "9"), 0), (("--until", "5%"), 1)):
        assert verified(large, capsys, *accepted, *words)["status"] == status


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--sample", "3", "--apertures", "0,0"), "omit --apertures"),
        (("--sample", "3", "--until", "1%"), "exclude each other"),
        (("--until", "40%", "--part", "1/2", "--out", "verified"), "use --sample"),
    ],
)
def test_a_sample_is_of_the_whole_plate(
    words: tuple[str, ...], message: str, large: Path, capsys: Capture
) -> None:
    result = verified(large, capsys, str(large.parent / "{i}x{j}.exr"), *words)
    assert result["status"] == 2 and message in result["errors"]


def test_parts_of_a_right_plate_make_the_verification_between_them(
    right: Path, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    images, out = shutil.copytree(right.parent, tmp_path / "images"), tmp_path / "verified"
    pattern, question = str(images / "{i}x{j}.exr"), out / "verification.parquet" / QUESTION

    def part_of(part: str) -> dict[str, Any]:
        return verified(right, capsys, pattern, "--part", part, out=out)

    verified(right, capsys, pattern, out=tmp_path / "alone")
    first = part_of("2/2")
    assert first["status"] == 0 and "this part is judged" in first["errors"] and not files_of(out)
    # Blocks with different diagnoses are not merged.
    content = question.read_bytes()
    question.write_bytes(content + b" ")
    assert "was judged by another diagnosis than the rest" in part_of("1/2")["errors"]
    question.write_bytes(content)
    # Only lost blocks are judged again.
    for path in out.glob("*.parquet/part-*[024].parquet"):
        path.unlink()
    times = times_of(out)
    again = part_of("1/1")
    assert again["status"] == 0 and "3 of 6 blocks were judged before" in again["errors"]
    assert len(times) == 3 and times.items() <= times_of(out).items()
    assert files_of(out) == files_of(tmp_path / "alone") != {}
    # Absolute paths are valid in every folder.
    monkeypatch.chdir(tmp_path)
    assert "blocks were judged before" in part_of("1/1")["errors"]
    # Redrawn images make another verification.
    shutil.copy(images / "0x0.exr", images / "2x1.exr")
    other = part_of("1/6")
    assert other["status"] == 2 and "another state of the images" in other["errors"]


def command_of(path: Path, folder: Path) -> tuple[Path, tuple[str, str]]:
    """Return a renderer's module, and the arguments of a command that runs the renderer."""
    module, script = folder / "module", folder / "render"
    module.write_text("")
    script.write_text(f"#!/bin/sh\n. {module}\nexec cp {path.parent}/$1x$2.exr $3\n")
    script.chmod(0o755)
    return module, ("--command", f"{script} {{i}} {{j}} {{out}}")


def test_a_command_is_judged_again_where_hogels_were_missing_and_anew_when_all_is_there(
    right: Path, tmp_path: Path, capsys: Capture
) -> None:
    module, command = command_of(right, tmp_path)
    out = tmp_path / "verified"

    def part_of(part: str, script: str) -> dict[str, Any]:
        module.write_text(script)
        return verified(right, capsys, *command, "--part", part, out=out)

    part_of("2/3", 'case "$1x$2" in 1x0) exit 3;; esac\n')
    before = times_of(out)
    part_of("2/3", "")
    after = times_of(out)
    assert [name for name in before if after[name] != before[name]] == ["part-0000001.parquet"]
    part_of("1/3", "")
    assert part_of("3/3", "")["status"] == 0
    result = part_of("1/1", "exit 3\n")
    assert result["status"] == 1
    assert [hogel["verdict"] for hogel in result["hogels"]] == ["missing"] * 6


def test_growing_samples_of_a_command_go_on_where_they_were_stopped(
    right: Path, tmp_path: Path, capsys: Capture
) -> None:
    """The first sample is complete and undecided; a later one lacks an interrupted block."""
    module, command = command_of(right, tmp_path)
    # Two of the first sample's four hogels show another hogel.
    module.write_text('case "$1" in 2) set 0 "$2" "$3";; esac\n')
    out, more = tmp_path / "verified", ("--until", "60%", "--part", "1/1")
    assert verified(right, capsys, *command, *more, out=out)["status"] == 0
    *kept, last = sorted(out.glob("*.parquet/part-*"))
    assert len(kept) == 5
    last.unlink()
    times = times_of(out)
    again = verified(right, capsys, *command, *more, out=out)
    assert again["status"] == 0 and "is judged anew" not in again["errors"]
    assert times.items() <= times_of(out).items() and last.exists()


def test_a_command_runs_in_the_folder_of_the_caller(
    right: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, _ = command_of(right, tmp_path)
    scene = open_scene(right)
    monkeypatch.chdir(tmp_path)
    options = VerifyOptions(command="./render {i} {j} {out}")
    request = replace(Request.from_options(scene, None, options), folder=Path.cwd())
    before = state_of(request)
    monkeypatch.chdir("/")
    require_state(request, before)
    with opened(request, Reference(scene)) as source:
        assert source.image(scene.plate.aperture(0, 0)).covered.any()
    module.with_name("render").write_text("another\n")
    with pytest.raises(InputError, match="the command, or another program"):
        require_state(request, before)


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", [("--workers", "2"), ("--part", "1/1", "--apertures", "4,3;0,0;2,1")]
)
def test_workers_and_single_hogels_equal_one_process(
    words: tuple[str, ...], tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Images are displaced, which needs a diagnosis, and one is missing; paths are relative."""
    scene = drawn(tmp_path, (5, 4), near=0.5)
    scene.with_name("2x1.exr").unlink()
    monkeypatch.chdir(tmp_path)
    for name, more in (("one", words[2:]), ("several", words)):
        result = verified(scene, capsys, "{i}x{j}.exr", *more, out=tmp_path / name)
        assert result["status"] == 1
        assert [h["problem"] for h in result["hogels"] if h["problem"]] == ["2x1.exr: no such file"]
    assert files_of(tmp_path / "several") == files_of(tmp_path / "one") != {}
