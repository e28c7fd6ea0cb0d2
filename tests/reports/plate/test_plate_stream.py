"""A plate on disk: every hogel once, the same bytes however often the process was killed."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from tests.support.views import view
from xfrustum.cli.main import main
from xfrustum.raster import Rasterizer
from xfrustum.reports.plate.plate import blocks_of_apertures, write_plate
from xfrustum.scenes import DoubleFrustum, InputError, Plate, Scene
from xfrustum.scenes.appearance.appearance import Appearance, Environment, Material
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.geometry.shapes import smoothed
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect
from xfrustum.scenes.model.plate_content import ColorType, PlateContent
from xfrustum.scenes.model.scene import look_hash

SETTINGS = DoubleFrustum(near=0.15)
EVERYTHING = PlateContent(color=ColorType.FLOAT32, ids=True)


def small(name: str = "asymmetric-recentered") -> Scene:
    return replace(view(name, (20, 12)), plate=Plate(size=(80.0, 60.0), hogels=(7, 5)))


def tree(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def array(group: zarr.Group, name: str) -> zarr.Array[Any]:
    found = group[name]
    assert isinstance(found, zarr.Array)
    return found


def finished(folder: Path) -> dict[str, tuple[int, int]]:
    """Every block that has finished hogels, with what changes when it is written again."""
    found = {}
    for path in folder.glob("finished/c/*/*"):
        if not path.name.endswith(".partial"):
            status = path.stat()
            found[str(path)] = (status.st_ino, status.st_mtime_ns)
    return found


def test_the_group_says_what_was_drawn_and_how(tmp_path: Path) -> None:
    scene = small()
    out = write_plate(scene, SETTINGS, tmp_path / "x.zarr", [scene.plate.middle]).out
    said = json.loads(json.dumps(zarr.open_group(out, mode="r").attrs["xfrustum"]))
    assert said["scene"]["hash"] == scene.content_hash
    assert said["plate"] == {"size": [80.0, 60.0], "hogels": [7, 5]}
    assert said["frustum"]["resolution"] == [20, 12] and said["frustum"]["screen"]["height"] == 120.0
    assert said["settings"]["near"] == 0.15 and said["content"] == {"color": "float16", "ids": False}


def test_parts_add_up_to_the_whole_and_nothing_is_drawn_twice(tmp_path: Path) -> None:
    scene = small()
    whole = write_plate(scene, SETTINGS, tmp_path / "whole.zarr", content=EVERYTHING, block=(1, 1)).out
    out = tmp_path / "parts.zarr"
    blocks = [(((1, 3), (0, 2)), 9), (((2, 6), (2, 2)), 3), ((None, (4, 4)), 7), ((None, None), 16)]
    before: dict[str, tuple[int, int]] = {}
    for block, drawn in blocks:
        apertures = list(blocks_of_apertures(scene.plate, [block, block]))
        files = write_plate(scene, SETTINGS, out, apertures, EVERYTHING, block=(1, 1))
        assert (files.drawn, files.found) == (drawn, len(set(apertures)) - drawn)
        after = finished(out)
        assert before.items() <= after.items() and len(after) == len(before) + drawn
        before = after
    assert tree(out) == tree(whole)


def test_hogels_that_show_nothing_are_finished_too(tmp_path: Path) -> None:
    assert [write_plate(small("empty"), SETTINGS, tmp_path / "x.zarr").drawn for _ in range(2)] == [35, 0]


def test_rows_come_first_and_blocks_in_the_order_given_each_aperture_once() -> None:
    plate = Plate(size=(1.0, 1.0), hogels=(3, 2))
    assert [a.index for a in plate.apertures()] == [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
    found = blocks_of_apertures(plate, [((1, 1), None), ((0, 1), (0, 0))])
    assert [a.index for a in found] == [(1, 0), (1, 1), (0, 0)]


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plate of one hogel."""
    out = tmp_path_factory.mktemp("begun") / "x.zarr"
    return write_plate(small(), SETTINGS, out, [small().plate.middle], EVERYTHING).out


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda s: (s, replace(SETTINGS, near=0.2), EVERYTHING), "other settings .near was 0.15, now 0.2"),
        (lambda s: (s, SETTINGS, PlateContent(ids=True)), "other content .color was"),
        (lambda s: (small("crossing"), SETTINGS, EVERYTHING), "another scene .name was"),
        (lambda s: (replace(s, objects=s.objects[1:]), SETTINGS, EVERYTHING), "another scene;"),
        (lambda s: (replace(s, appearance=Appearance(lights=())), SETTINGS, EVERYTHING), "another scene"),
        (
            lambda s: (s, SETTINGS, replace(EVERYTHING, effects=ALL_EFFECTS - {Effect.DIFFUSE})),
            "other effects",
        ),
    ],
)
def test_going_on_with_anything_else_is_refused(
    change: Callable[[Scene], tuple[Scene, DoubleFrustum, PlateContent]], named: str, begun: Path
) -> None:
    before = tree(begun)
    scene, settings, content = change(small())
    with pytest.raises(InputError, match=f"was drawn with .*{named}"):
        write_plate(scene, settings, begun, content=content)
    assert tree(begun) == before


def test_going_on_with_effects_that_change_no_pixel_is_going_on(tmp_path: Path) -> None:
    scene, out = small(), tmp_path / "x.zarr"
    write_plate(scene, SETTINGS, out, [scene.plate.middle], EVERYTHING)
    files = write_plate(scene, SETTINGS, out, content=replace(EVERYTHING, effects=ALL_EFFECTS))
    assert (files.drawn, files.found) == (34, 1)


def mirrored_in(strength: float, material: Material, name: str) -> Scene:
    parts = tuple(replace(part, material=name) for part in small().objects)
    sky = Environment(radiance=np.full((2, 4, 3), 0.5, dtype=np.float32), strength=strength)
    return replace(small(), objects=parts, appearance=Appearance(materials={name: material}, environment=sky))


def test_the_look_is_everything_that_color_depends_on_and_no_name() -> None:
    mirror = Material(reflectivity=(0.5, 0.5, 0.5))
    scene = mirrored_in(1.0, mirror, "mirror")
    smooth = replace(scene, objects=tuple(smoothed(part) for part in scene.objects))
    others = [mirrored_in(0.5, mirror, "mirror"), mirrored_in(1.0, Material(), "mirror"), smooth, small()]
    assert len({look_hash(other) for other in (scene, *others)}) == 5
    assert {other.content_hash for other in others} == {scene.content_hash}
    assert look_hash(mirrored_in(1.0, mirror, "another name")) == look_hash(scene)


def test_finer_sampling_is_drawn_as_raster_draws_it_and_said(tmp_path: Path) -> None:
    scene = replace(small("grating"), sampling=Sampling(supersample=2, multisample=4, aperture=3))
    apertures = [scene.plate.middle, scene.plate.aperture(0, 4)]
    out = write_plate(scene, SETTINGS, tmp_path / "x.zarr", apertures, EVERYTHING).out
    group = zarr.open_group(out, mode="r")
    with Rasterizer(scene) as rasterizer:
        for aperture in apertures:
            image = rasterizer.render(aperture, SETTINGS)
            np.testing.assert_array_equal(array(group, "color")[aperture.row, aperture.column], image.color)
            np.testing.assert_array_equal(
                array(group, "triangle")[aperture.row, aperture.column], image.triangle
            )
    said = group.attrs["xfrustum"]
    assert isinstance(said, dict) and said["sampling"] == {"aperture": 3, "supersample": 2, "multisample": 4}


def test_a_plate_goes_on_with_its_own_sub_apertures_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "x.zarr"
    arguments = ["plate", "sheets", "--near", "0.1", "--apertures", "3,4", "--out", str(out), "--quiet"]
    assert [main([*arguments, "--aperture-samples", "3"]) for _ in range(2)] == [0, 0]
    assert main([*arguments, "--aperture-samples", "car"]) == main(arguments) == 2
    assert "another sampling" in capsys.readouterr().err


def test_what_is_no_plate_is_left_alone(tmp_path: Path) -> None:
    folder, file = tmp_path / "folder", tmp_path / "file"
    folder.mkdir()
    (folder / "mine.txt").write_text("mine")
    file.write_text("mine")
    zarr.create_group(tmp_path / "other.zarr")
    for out in (folder, file, tmp_path / "other.zarr"):
        with pytest.raises(InputError, match="is no plate of xfrustum"):
            write_plate(small(), SETTINGS, out)
    assert tree(folder) == {"mine.txt": b"mine"} and file.read_text() == "mine"
