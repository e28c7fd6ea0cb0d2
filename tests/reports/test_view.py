"""`view` from the command line: what it prints, what it writes, and where hogels may come from."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from xfrustum.cli.main import main
from xfrustum.raster import Rasterizer
from xfrustum.reports.view import eyes_on_path
from xfrustum.scenes import DoubleFrustum, InputError, Scene, open_scene
from xfrustum.scenes.files.exr import write_image
from xfrustum.scenes.model.eye import Eye

EYES = "--eye=-20,3,300;25,3,300"
EYE = "--eye=0,0,300"
RESOLUTION = "--resolution=24,18"
NEAR = "--near=0.5"
SCENE = """
name = "two"
units = "mm"
[plate]
size = [40.0, 30.0]
hogels = [8, 6]
[frustum]
resolution = [32, 24]
fov_deg = [50.0, 40.0]
reach = [40.0, 40.0]
[[object]]
shape = "sphere"
scale = 16.0
translate = [-3.0, 1.0, -15.0]
[[object]]
shape = "box"
scale = 6.0
translate = [6.0, -3.0, 12.0]
"""


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "two.toml"
    path.write_text(SCENE)
    return path


def told(capfd: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    """Run `view --json` and return the object that it prints."""
    assert main(["view", *arguments, "--json", "--quiet"]) == 0
    found: dict[str, Any] = json.loads(capfd.readouterr().out)
    return found


def drawn_pixels(folder: Path) -> list[bytes]:
    return [path.read_bytes() for path in sorted(folder.glob("drawn_*.exr"))]


def test_view_prints_the_contract_and_writes_all_its_files(
    scene_file: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    found = told(capfd, str(scene_file), EYES, RESOLUTION, NEAR, "--out", str(out))
    assert [eye["eye"] for eye in found["eyes"]] == [[-20.0, 3.0, 300.0], [25.0, 3.0, 300.0]]
    for eye in found["eyes"]:
        for name in ("display", "renderer"):
            loss = eye[name]
            assert loss["fraction"] == loss["wrong"] / loss["judged"]
            assert set(loss["displacement_arcmin"]) == {"p50", "p99", "max"}
            assert loss["depth_error"]["p50"] <= loss["depth_error"]["p99"]
        assert eye["display"]["displacement_arcmin"]["p50"] > eye["renderer"]["displacement_arcmin"]["p50"]
    kinds = [f"{k}.{kind}" for k in "01" for kind in ("exr", "png")]
    pictures = [f"{name}_{kind}" for name in ("true", "replayed", "drawn") for kind in kinds]
    names = sorted(path.name for path in out.iterdir())
    assert names == sorted(["index.html", "view.json", "views.gif", *pictures])
    assert json.loads((out / "view.json").read_text()) == found
    page = (out / "index.html").read_text()
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "https://" not in page
    header = OpenEXR.InputFile(str(out / "true_0.exr")).header()
    assert json.loads(header["xfrustum:eye"])["position"] == [-20.0, 3.0, 300.0]
    assert {"R", "P.X", "Z", "id.triangle", "certainty"} <= set(header["channels"])
    with Image.open(out / "views.gif") as animation:
        assert getattr(animation, "n_frames", 1) == 2


def test_the_display_alone_is_judged_where_no_hogels_are_named(
    scene_file: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (eye,) = told(capfd, str(scene_file), "--eye=0,0,300", RESOLUTION)["eyes"]
    assert eye["renderer"] is None
    assert eye["display"]["flip"] > 0


def test_a_stored_plate_and_one_made_on_the_fly_show_the_same_pixels(
    scene_file: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    stored, folders = tmp_path / "plate.zarr", [tmp_path / "fly", tmp_path / "stored"]
    fly = told(capfd, str(scene_file), EYES, RESOLUTION, NEAR, "--out", str(folders[0]))
    assert main(["plate", str(scene_file), NEAR, "--ids", "--out", str(stored), "--quiet"]) == 0
    capfd.readouterr()
    again = told(capfd, str(scene_file), EYES, RESOLUTION, "--plate", str(stored), "--out", str(folders[1]))
    assert drawn_pixels(folders[0]) == drawn_pixels(folders[1])
    assert again["eyes"] == fly["eyes"]


def test_anybodys_images_are_judged_by_what_they_say(
    scene_file: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = open_scene(str(scene_file))
    write_hogels(scene, tmp_path)
    fly = told(capfd, str(scene_file), EYES, RESOLUTION, NEAR)
    for pattern, encoding in (("{i}x{j}.exr", "rgb"), ("{i}x{j}.png", "triangle-id")):
        source = (f"--images={tmp_path / pattern}", f"--encoding={encoding}")
        files = told(capfd, str(scene_file), EYES, RESOLUTION, *source)
        for one, other in zip(files["eyes"], fly["eyes"], strict=True):
            # Pictures of numbers do not say where on a triangle their points lie.
            if encoding == "rgb":
                assert one["renderer"]["wrong"] == other["renderer"]["wrong"]
                shift = one["renderer"]["displacement_arcmin"]["p99"]
                # Positions in files are single precision.
                assert shift == pytest.approx(other["renderer"]["displacement_arcmin"]["p99"], rel=1e-3)
            else:
                assert one["renderer"]["wrong"] <= other["renderer"]["wrong"]
                assert one["renderer"]["displacement_arcmin"] is None


def test_colors_name_no_surfaces_and_wrong_ones_are_unknown(
    scene_file: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    stored, pictures, out = tmp_path / "plate.zarr", tmp_path / "pictures", tmp_path / "out"
    assert main(["plate", str(scene_file), NEAR, "--out", str(stored), "--quiet"]) == 0
    assert main(["convert", str(stored), str(pictures), "--to", "hogels", "--quiet"]) == 0
    capfd.readouterr()
    source = f"--images={pictures / 'hogel_{i}x{j}.exr'}"
    found = told(capfd, str(scene_file), EYE, RESOLUTION, source, "--out", str(out))
    same = told(capfd, str(scene_file), EYE, RESOLUTION, "--plate", str(stored))
    assert found["eyes"] == same["eyes"]
    for eye in found["eyes"]:
        assert eye["renderer"]["wrong"] is None
        assert eye["renderer"]["fraction"] is None
        assert eye["renderer"]["flip"] < 0.1
    page = (out / "index.html").read_text()
    assert "The renderer looks different by FLIP" in page
    assert "wrong surfaces unknown" in page
    assert main(["view", str(scene_file), EYE, RESOLUTION, source, "--quiet"]) == 0
    lines = capfd.readouterr().out.splitlines()
    assert sum("renderer  wrong surfaces unknown, FLIP" in line for line in lines) == 1


def test_pictures_read_as_colors_name_no_surfaces(
    scene_file: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    write_hogels(open_scene(str(scene_file)), tmp_path)
    for encoding in ("rgb", "srgb"):
        source = (f"--images={tmp_path / '{i}x{j}.png'}", f"--encoding={encoding}")
        for eye in told(capfd, str(scene_file), EYES, RESOLUTION, *source)["eyes"]:
            assert eye["renderer"]["fraction"] is None


def test_images_that_name_surfaces_are_charged_with_wrong_ones(
    scene_file: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    blank = Image.new("RGB", (32, 24))
    for column, row in np.ndindex(8, 6):
        blank.save(tmp_path / f"{column}x{row}.png")
    source = (f"--images={tmp_path / '{i}x{j}.png'}", "--encoding=object-id")
    for eye in told(capfd, str(scene_file), EYES, RESOLUTION, *source)["eyes"]:
        assert eye["renderer"]["fraction"] > 0.1


def test_an_eye_within_the_scene_is_told_that_numbers_say_little(
    scene_file: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for height, said in ((10, True), (300, False)):
        assert main(["view", str(scene_file), f"--eye=0,0,{height}", RESOLUTION, "--quiet"]) == 0
        assert ("within the scene's depth" in capfd.readouterr().out) == said


def write_hogels(scene: Scene, folder: Path) -> None:
    """Write all hogels as OpenEXR and as pictures of triangle numbers."""
    with Rasterizer(scene) as rasterizer:
        for aperture in scene.plate.apertures():
            image = rasterizer.render(aperture, DoubleFrustum(near=0.5))
            column, row = aperture.index
            write_image(folder / f"{column}x{row}.exr", image)
            packed = (image.triangle + 1).astype(np.uint32)
            rgb = np.stack((packed >> 16 & 255, packed >> 8 & 255, packed & 255), axis=-1).astype(np.uint8)
            Image.fromarray(rgb).save(folder / f"{column}x{row}.png")


def test_a_pair_of_eyes_tells_at_which_depth_things_are_seen(
    scene_file: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    found = told(capfd, str(scene_file), "--eye=0,0,300", "--resolution=96,72", "--near=2", "--stereo=65")
    assert [eye["eye"][0] for eye in found["eyes"]] == [-32.5, 32.5]
    (pair,) = found["stereo"]
    # One object lies behind the plate and is seen 2 too far, the other before it and is seen 2 too near.
    assert pair["renderer"]["depth"]["p1"] == pytest.approx(-2, abs=0.5)
    assert pair["renderer"]["depth"]["p99"] == pytest.approx(2, abs=0.5)


def test_a_quilt_is_the_views_of_eyes_from_left_to_right_and_from_the_bottom_up(
    scene_file: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out, single = tmp_path / "quilt", tmp_path / "single"
    found = told(capfd, str(scene_file), "--eye=1,0,300", RESOLUTION, NEAR, "--quilt=3x2", "--out", str(out))
    places = [eye["eye"] for eye in found["eyes"]]
    angles = [math.degrees(math.atan2(x - 1.0, 300)) for x, _, _ in places]
    assert angles == pytest.approx([-20, -12, -4, 4, 12, 20])
    names = [f"{name}_qs3x2a1.333.png" for name in ("drawn", "replayed", "true")]
    assert sorted(path.name for path in out.iterdir()) == [*names, "view.json"]
    # The fourth view is the first tile of the second row from the bottom.
    fourth = ",".join(str(value) for value in places[3])
    told(capfd, str(scene_file), f"--eye={fourth}", RESOLUTION, NEAR, "--out", str(single))
    with Image.open(out / names[0]) as quilt, Image.open(single / "drawn_0.png") as alone:
        assert quilt.size == (3 * 24, 2 * 18)
        np.testing.assert_array_equal(np.asarray(quilt)[:18, :24], np.asarray(alone))


def test_eyes_on_a_path_are_evenly_spaced() -> None:
    ends = [Eye(position=place) for place in ((0.0, 0.0, 100.0), (30.0, 0.0, 100.0), (30.0, 10.0, 100.0))]
    found = [eye.position for eye in eyes_on_path(ends, 5)]
    assert found == [(0, 0, 100), (10, 0, 100), (20, 0, 100), (30, 0, 100), (30, 10, 100)]
    with pytest.raises(InputError, match="two eyes"):
        eyes_on_path(ends[:1], 3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--eye=0,0,-5"], "before the plate"),
        (["--eye=0,0"], "X,Y,Z"),
        (["--eye=0,0,300", "--near=1", "--plate=x.zarr"], "one of them"),
        (["--eye=0,0,300", "--plate=nowhere.zarr"], "is no plate"),
        (["--eye=0,0,300", "--images=none_{i}x{j}.png"], "none of its files exists"),
        (["--eye=0,0,300", "--depth=d16"], "give --near too"),
        (["--eye=0,0,300", "--encoding=rgb"], "give both"),
        (["--eye=0,0,300", "--path=3"], "two eyes"),
        (["--eye=0,0,300", "--resolution=4"], "W,H"),
        (["--eye=0,0,300", "--quilt=2x2"], "needs --out"),
        (["--eye=0,0,300", "--quilt=2"], "COLUMNSxROWS"),
        (["--eye=1e200,0,1", "--near=0.5"], "bring it nearer"),
    ],
)
def test_bad_input_is_one_line_that_says_what_to_do(
    scene_file: Path, arguments: list[str], said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(scene_file), *arguments, "--quiet"]) == 2
    output = capfd.readouterr()
    assert output.out == ""
    assert said in output.err
    assert output.err.count("\n") == 1


def test_a_plate_of_another_scene_or_with_holes_is_refused(
    scene_file: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    stored = tmp_path / "row.zarr"
    assert main(["plate", str(scene_file), NEAR, "--apertures=*,2", "--out", str(stored), "--quiet"]) == 0
    asked = ["view", str(scene_file), "--eye=0,0,300", "--plate", str(stored), "--quiet"]
    assert main(asked) == 2
    assert "40 of 48 hogels" in capfd.readouterr().err
    other = tmp_path / "other.toml"
    other.write_text(SCENE.replace("scale = 6.0", "scale = 7.0"))
    asked[1] = str(other)
    assert main(asked) == 2
    assert "another scene" in capfd.readouterr().err
