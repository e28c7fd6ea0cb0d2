"""The command `view`: output, files, and sources of hogels."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from tests.support.commands import Command
from tests.support.scene_file import film, named, part
from xfrustum import DoubleFrustum, Rasterizer, open_scene, write_image
from xfrustum.cli.main import main

EYES, EYE, NEAR = "--eye=-20,3,300;25,3,300", "--eye=0,0,300", "--near=0.5"
RESOLUTION = "--resolution=24,18"
SCENE = (
    named("two", "mm")
    + film(
        (40.0, 30.0), hogels=(8, 6), resolution=(32, 24), fov_deg=(50.0, 40.0), reach=(40.0, 40.0)
    )
    + part("sphere", 16.0, (-3.0, 1.0, -15.0))
    + part("box", 6.0, (6.0, -3.0, 12.0))
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a scene, its plate, hogels as OpenEXR and pictures, and a view."""
    here = tmp_path_factory.mktemp("scene")
    (here / "two.toml").write_text(SCENE)
    scene = open_scene(str(here / "two.toml"))
    with Rasterizer(scene) as rasterizer:
        for aperture in scene.plate.apertures():
            image = rasterizer.render(aperture, DoubleFrustum(near=0.5))
            name = "{}x{}".format(*aperture.index)
            write_image(here / f"{name}.exr", image)
            number = (image.triangle + 1).astype(np.uint32)
            rgb = np.stack((number >> 16 & 255, number >> 8 & 255, number & 255), axis=-1)
            Image.fromarray(rgb.astype(np.uint8)).save(here / f"{name}.png")
    scene_file = str(here / "two.toml")
    for line in (
        ["plate", scene_file, NEAR, "--ids", "--out", str(here / "plate.zarr")],
        ["view", scene_file, EYES, RESOLUTION, NEAR, "--out", str(here / "fly")],
    ):
        assert main([*line, "--quiet"]) == 0
    return here


@pytest.fixture
def viewed(folder: Path, command: Command) -> Callable[..., Any]:
    """Return a function that runs `view` with options and returns its JSON object."""
    return lambda *options: (
        command(" ".join(["view", f"{folder}/two.toml", *options, "--quiet", "--json"])).record
    )


@pytest.fixture
def drawn(folder: Path) -> list[dict[str, Any]]:
    """Return the losses of two eyes, with hogels drawn on demand."""
    eyes: list[dict[str, Any]] = json.loads((folder / "fly" / "view.json").read_text())["eyes"]
    return eyes


def test_view_keeps_the_contract_and_writes_all_its_files(
    folder: Path, drawn: list[dict[str, Any]]
) -> None:
    out = folder / "fly"
    assert [eye["eye"] for eye in drawn] == [[-20.0, 3.0, 300.0], [25.0, 3.0, 300.0]]
    for eye in drawn:
        display, renderer = eye["display"], eye["renderer"]
        for loss in (display, renderer):
            assert loss["fraction"] == loss["wrong"] / loss["judged"]
        moved, by_renderer = (loss["displacement_arcmin"]["p50"] for loss in (display, renderer))
        assert moved > by_renderer
    kinds = [f"{k}.{kind}" for k in "01" for kind in ("exr", "png")]
    pictures = [f"{name}_{kind}" for name in ("true", "replayed", "drawn") for kind in kinds]
    assert {path.name for path in out.iterdir()} == {"index.html", "view.json", *pictures}
    assert "moves every point 0.5 mm away from the plate" in (out / "index.html").read_text()
    header = OpenEXR.InputFile(str(out / "true_0.exr")).header()
    assert json.loads(header["xfrustum:eye"])["position"] == [-20.0, 3.0, 300.0]
    assert {"R", "P.X", "Z", "id.triangle", "certainty"} <= set(header["channels"])


def test_only_the_display_is_judged_without_hogels(folder: Path, command: Command) -> None:
    line = f"view {folder}/two.toml '--eye=0,0,10;0,0,300' {RESOLUTION} --quiet"
    (eye, _) = command(f"{line} --json").record["eyes"]
    assert eye["renderer"] is None and eye["display"]["flip"] > 0
    assert "1 of 2 eyes lie within the scene" in command(line).out


def test_a_stored_plate_has_the_pixels_of_hogels_drawn_on_demand(
    folder: Path, drawn: list[dict[str, Any]], tmp_path: Path, viewed: Callable[..., Any]
) -> None:
    source, out = f"--plate={folder / 'plate.zarr'}", tmp_path / "out"
    stored = viewed(f"'{EYES}'", RESOLUTION, source, f"--out={out}")
    pixels = [
        [path.read_bytes() for path in sorted(item.glob("drawn_*.exr"))]
        for item in (folder / "fly", out)
    ]
    assert len(pixels[0]) == 2 and pixels[0] == pixels[1]
    assert stored["eyes"] == drawn


@pytest.mark.parametrize("encoding", ["rgb", "triangle-id"])
def test_image_files_are_judged_by_the_channels_that_they_have(
    encoding: str, folder: Path, drawn: list[dict[str, Any]], viewed: Callable[..., Any]
) -> None:
    pattern = folder / ("{i}x{j}.exr" if encoding == "rgb" else "{i}x{j}.png")
    files = viewed(f"'{EYES}'", RESOLUTION, f"--images={pattern}", f"--encoding={encoding}")
    for item, other in zip(files["eyes"], drawn, strict=True):
        result, expected = item["renderer"], other["renderer"]
        if encoding == "rgb":
            assert result["wrong"] == expected["wrong"]
            # Files store positions in single precision.
            p99 = expected["displacement_arcmin"]["p99"]
            assert result["displacement_arcmin"]["p99"] == pytest.approx(p99, rel=1e-3)
        else:
            # Triangle numbers do not determine the visible point of a triangle.
            assert result["wrong"] <= expected["wrong"] and result["displacement_arcmin"] is None


@pytest.mark.parametrize("encoding", ["srgb", "object-id"])
def test_colors_name_no_surfaces_and_black_object_pictures_name_wrong_ones(
    encoding: str, tmp_path: Path, viewed: Callable[..., Any]
) -> None:
    for column, row in np.ndindex(8, 6):
        Image.new("RGB", (32, 24)).save(tmp_path / f"{column}x{row}.png")
    source = f"--images={tmp_path / '{i}x{j}.png'}"
    (eye,) = viewed(EYE, RESOLUTION, source, f"--encoding={encoding}")["eyes"]
    if encoding == "srgb":
        assert eye["renderer"]["wrong"] is None and eye["renderer"]["flip"] > 0.01
    else:
        assert eye["renderer"]["fraction"] > 0.1


def test_a_quilt_has_the_views_from_left_to_right_and_from_the_bottom_up(
    tmp_path: Path, viewed: Callable[..., Any]
) -> None:
    out, single = tmp_path / "quilt", tmp_path / "single"
    result = viewed("--eye=1,0,300", "--resolution=12,9", NEAR, "--quilt=3x2", f"--out={out}")
    places = [eye["eye"] for eye in result["eyes"]]
    angles = [math.degrees(math.atan2(x - 1.0, 300)) for x, _, _ in places]
    assert angles == pytest.approx([-20, -12, -4, 4, 12, 20])
    # The fourth view is the first tile of the second row from the bottom.
    fourth = ",".join(str(value) for value in places[3])
    viewed(f"--eye={fourth}", "--resolution=12,9", NEAR, f"--out={single}")
    quilt = np.asarray(Image.open(out / "drawn_qs3x2a1.333.png"))
    assert quilt.shape[:2] == (2 * 9, 3 * 12)
    np.testing.assert_array_equal(quilt[:9, :12], np.asarray(Image.open(single / "drawn_0.png")))


def test_a_plate_of_another_scene_or_with_holes_is_refused(
    folder: Path, tmp_path: Path, command: Command
) -> None:
    stored, other = tmp_path / "row.zarr", tmp_path / "other.toml"
    command(f"plate {folder}/two.toml {NEAR} --apertures=*,2 --quiet --out {stored}")
    other.write_text(SCENE.replace("scale = 6.0", "scale = 7.0"))
    for scene, message in ((folder / "two.toml", "40 of 48 hogels"), (other, "another scene")):
        assert message in command(f"view {scene} {EYE} --plate {stored} --quiet", status=2).err


def test_pictures_that_name_triangles_beyond_the_scene_are_refused(
    folder: Path, tmp_path: Path, command: Command
) -> None:
    fewer = tmp_path / "fewer.toml"
    fewer.write_text(SCENE.removesuffix(part("box", 6.0, (6.0, -3.0, 12.0))))
    images = f"--images '{folder}/{{i}}x{{j}}.png' --encoding triangle-id"
    error = command(f"view {fewer} {EYE} {images} --quiet", status=2).err
    assert "names a triangle that the scene does not have" in error
