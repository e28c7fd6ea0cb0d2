"""Verifications in blocks equal one process's, whichever process judges the blocks."""

import json
import shutil
from pathlib import Path

import pytest

from tests.support.scene_file import film, named, part
from xfrustum import DoubleFrustum, Rasterizer, open_scene, write_image
from xfrustum.cli.main import main
from xfrustum.reference import Reference
from xfrustum.reports.verification.jobs import QUESTION
from xfrustum.reports.verification.sources import ForeignRenderer
from xfrustum.scenes import InputError

FILES = ("index.html", "verification.json")


def images_of(folder: Path, hogels: tuple[int, int], near: float) -> Path:
    """Write a scene and the images of its plate; return the scene's path."""
    path = folder / "boxes.toml"
    objects = part("box", 12, (4, 0, -14)) + part("box", 6, (-5, 2, 16))
    path.write_text(named("boxes") + film((40, 32), hogels, (24, 24), (60, 60), (60, 60)) + objects)
    scene = open_scene(path)
    with Rasterizer(scene) as rasterizer:
        for aperture in scene.plate.apertures():
            image = rasterizer.render(aperture, DoubleFrustum(near=near))
            write_image(path.with_name(f"{aperture.column}x{aperture.row}.exr"), image)
    return path


@pytest.fixture(scope="module")
def right_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plate of 3 by 2 hogels with right images, so that nothing is diagnosed."""
    return images_of(tmp_path_factory.mktemp("right"), (3, 2), 0.001)


def verified(scene_path: Path, out: Path, *words: str) -> int:
    """Run `verify`, and return its exit status."""
    return main(["verify", str(scene_path), "--out", str(out), "--quiet", "--json", *words])


def files_of(out: Path) -> dict[str, bytes]:
    return {name: (out / name).read_bytes() for name in FILES if (out / name).exists()}


def test_parts_of_a_right_plate_make_the_verification_between_them(
    right_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images, out = shutil.copytree(right_path.parent, tmp_path / "images"), tmp_path / "verified"
    pattern, folder = str(images / "{i}x{j}.exr"), out / "verification.parquet"
    assert verified(right_path, tmp_path / "alone", pattern) == 0
    assert verified(right_path, out, pattern, "--part", "2/2") == 0
    assert files_of(out) == {} and "this part is judged" in capsys.readouterr().err
    # Blocks of another diagnosis are not put together.
    question = (folder / QUESTION).read_bytes()
    (folder / QUESTION).write_bytes(question + b" ")
    assert verified(right_path, out, pattern, "--part", "1/2") == 2
    assert "was judged by another diagnosis than the rest" in capsys.readouterr().err
    (folder / QUESTION).write_bytes(question)
    # Lost blocks are judged again, and no others.
    for path in folder.glob("part-*[024].parquet"):
        path.unlink()
    times = {path: path.stat().st_mtime_ns for path in folder.glob("part-*")}
    assert verified(right_path, out, pattern, "--part", "1/1") == 0
    assert "3 of 6 blocks were judged before" in capsys.readouterr().err
    assert len(times) == 3 and all(path.stat().st_mtime_ns == time for path, time in times.items())
    assert files_of(out) == files_of(tmp_path / "alone") != {}
    # Images that were drawn again are another verification.
    shutil.copy(images / "0x0.exr", images / "2x1.exr")
    assert verified(right_path, out, pattern, "--part", "1/6") == 2
    assert "begun with another state of the images" in capsys.readouterr().err


def command_of(path: Path, folder: Path) -> tuple[Path, tuple[str, str]]:
    """Return a module that a renderer needs, and the words of a command that runs this renderer."""
    module, script = folder / "module", folder / "render"
    module.write_text("")
    script.write_text(f"#!/bin/sh\n. {module}\nexec cp {path.parent}/$1x$2.exr $3\n")
    script.chmod(0o755)
    return module, ("--command", f"{script} {{i}} {{j}} {{out}}")


def test_a_command_is_judged_again_where_hogels_were_missing_and_anew_when_all_is_there(
    right_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    module, words = command_of(right_path, tmp_path)
    out = tmp_path / "verified"

    def times() -> dict[str, int]:
        parts = out.glob("verification.parquet/part-*")
        return {path.name: path.stat().st_mtime_ns for path in parts}

    module.write_text('case "$1x$2" in 1x0) exit 3;; esac\n')
    assert verified(right_path, out, *words, "--part", "2/3") == 0
    before = times()
    module.write_text("")
    assert verified(right_path, out, *words, "--part", "2/3") == 0
    after = times()
    assert [name for name in before if after[name] != before[name]] == ["part-0000001.parquet"]
    for part_ in ("1/3", "3/3"):
        assert verified(right_path, out, *words, "--part", part_) == 0
    module.write_text("exit 3\n")
    capsys.readouterr()
    assert verified(right_path, out, *words, "--part", "1/1") == 1
    result = json.loads(capsys.readouterr().out)
    assert [hogel["verdict"] for hogel in result["hogels"]] == ["missing"] * 6


def test_growing_samples_of_a_command_go_on_where_they_were_stopped(
    right_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first sample is whole and decides nothing; a later one lacks an interrupted block."""
    module, words = command_of(right_path, tmp_path)
    # Two of the four hogels of the first sample show another one.
    module.write_text('case "$1" in 2) set 0 "$2" "$3";; esac\n')
    out, more = tmp_path / "verified", ("--until", "60%", "--part", "1/1")
    assert verified(right_path, out, *words, *more) == 0
    *kept, last = sorted(out.glob("verification.parquet/part-*"))
    assert len(kept) == 5
    last.unlink()
    times = [path.stat().st_mtime_ns for path in kept]
    assert verified(right_path, out, *words, *more) == 0
    assert "is judged anew" not in capsys.readouterr().err
    assert [path.stat().st_mtime_ns for path in kept] == times and last.exists()


def test_a_command_runs_in_the_folder_of_the_caller(
    right_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, _ = command_of(right_path, tmp_path)
    scene = open_scene(right_path)
    monkeypatch.chdir(tmp_path)
    renderer = ForeignRenderer(command="./render {i} {j} {out}").placed(scene)
    before = renderer.state(())
    monkeypatch.chdir("/")
    renderer.require_state((), before)
    with renderer.opened(Reference(scene)) as source:
        assert source.image(scene.plate.aperture(0, 0)).covered.any()
    module.with_name("render").write_text("another\n")
    with pytest.raises(InputError, match="the command, or another program"):
        renderer.require_state((), before)


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", [("--workers", "2"), ("--part", "1/1", "--apertures", "4,3;0,0;2,1")]
)
def test_workers_and_single_hogels_equal_one_process(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    """Images are bent, so that a renderer is diagnosed, and one is missing."""
    scene_path = images_of(tmp_path, (5, 4), 0.5)
    scene_path.with_name("2x1.exr").unlink()
    pattern = str(scene_path.with_name("{i}x{j}.exr"))
    assert verified(scene_path, tmp_path / "one", pattern, *words[2:]) == 1
    assert verified(scene_path, tmp_path / "several", pattern, *words) == 1
    assert files_of(tmp_path / "several") == files_of(tmp_path / "one") != {}
