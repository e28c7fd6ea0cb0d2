"""`view` from the command line: what it prints, what it writes, and where hogels may come from."""

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main
from xfrustum.raster import Rasterizer
from xfrustum.reports.view import _sentences, eyes_on_path
from xfrustum.scenes import DoubleFrustum, InputError, open_scene
from xfrustum.scenes.files.exr import write_image
from xfrustum.scenes.model.eye import Eye
from xfrustum.scenes.notebook import percent

EYES, EYE, RESOLUTION, NEAR = (
    "--eye=-20,3,300;25,3,300",
    "--eye=0,0,300",
    "--resolution=24,18",
    "--near=0.5",
)
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
    """A scene, its plate, its hogels as OpenEXR and as pictures of triangle numbers, and a view of it."""
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
    run("plate", here, NEAR, "--ids", "--out", str(here / "plate.zarr"))
    run("view", here, EYES, RESOLUTION, NEAR, "--out", str(here / "fly"))
    return here


def run(command: str, folder: Path, *arguments: str) -> None:
    assert main([command, str(folder / "two.toml"), *arguments, "--quiet"]) == 0


def told(capfd: pytest.CaptureFixture[str], folder: Path, *arguments: str) -> dict[str, Any]:
    """Run `view --json` and return the object that it prints."""
    capfd.readouterr()
    run("view", folder, *arguments, "--json")
    found: dict[str, Any] = json.loads(capfd.readouterr().out)
    return found


def drawn_anew(folder: Path) -> list[dict[str, Any]]:
    eyes: list[dict[str, Any]] = json.loads((folder / "fly" / "view.json").read_text())["eyes"]
    return eyes


def test_view_tells_the_contract_and_writes_all_its_files(folder: Path) -> None:
    eyes, out = drawn_anew(folder), folder / "fly"
    assert [eye["eye"] for eye in eyes] == [[-20.0, 3.0, 300.0], [25.0, 3.0, 300.0]]
    for eye in eyes:
        for loss in (eye["display"], eye["renderer"]):
            assert loss["fraction"] == loss["wrong"] / loss["judged"]
            assert set(loss["displacement_arcmin"]) == {"p50", "p99", "max"}
            assert loss["depth_error"]["p50"] <= loss["depth_error"]["p99"]
        assert (
            eye["display"]["displacement_arcmin"]["p50"]
            > eye["renderer"]["displacement_arcmin"]["p50"]
        )
    kinds = [f"{k}.{kind}" for k in "01" for kind in ("exr", "png")]
    pictures = [f"{name}_{kind}" for name in ("true", "replayed", "drawn") for kind in kinds]
    names = sorted(path.name for path in out.iterdir())
    assert names == sorted(["index.html", "view.json", "views.gif", *pictures])
    page = (out / "index.html").read_text()
    assert "http://" not in page.replace("http://www.w3.org", "") and "https://" not in page
    header = OpenEXR.InputFile(str(out / "true_0.exr")).header()
    assert json.loads(header["xfrustum:eye"])["position"] == [-20.0, 3.0, 300.0]
    assert {"R", "P.X", "Z", "id.triangle", "certainty"} <= set(header["channels"])
    with Image.open(out / "views.gif") as animation:
        assert getattr(animation, "n_frames", 1) == 2


def test_the_display_alone_is_judged_where_no_hogels_are_named(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """An eye within the scene's depth is told that numbers say little."""
    (eye,) = told(capfd, folder, EYE, RESOLUTION)["eyes"]
    assert eye["renderer"] is None and eye["display"]["flip"] > 0
    run("view", folder, "--eye=0,0,10;0,0,300", RESOLUTION)
    assert (
        "At 1 of 2 eyes the numbers say little: these lie within the scene's depth"
        in capfd.readouterr().out
    )


def test_a_stored_plate_and_one_made_on_the_fly_show_the_same_pixels(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    stored = told(
        capfd,
        folder,
        EYES,
        RESOLUTION,
        f"--plate={folder / 'plate.zarr'}",
        f"--out={tmp_path / 'out'}",
    )
    pixels = [
        [path.read_bytes() for path in sorted(one.glob("drawn_*.exr"))]
        for one in (folder / "fly", tmp_path / "out")
    ]
    assert len(pixels[0]) == 2 and pixels[0] == pixels[1]
    assert stored["eyes"] == drawn_anew(folder)
    assert json.loads((tmp_path / "out" / "view.json").read_text()) == stored


@pytest.mark.parametrize("encoding", ["rgb", "triangle-id"])
def test_anybodys_images_are_judged_by_what_they_say(
    encoding: str, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pattern = folder / ("{i}x{j}.exr" if encoding == "rgb" else "{i}x{j}.png")
    files = told(capfd, folder, EYES, RESOLUTION, f"--images={pattern}", f"--encoding={encoding}")
    for one, other in zip(files["eyes"], drawn_anew(folder), strict=True):
        found, expected = one["renderer"], other["renderer"]
        if encoding == "rgb":
            assert found["wrong"] == expected["wrong"]
            # Positions in files are single precision.
            p99 = expected["displacement_arcmin"]["p99"]
            assert found["displacement_arcmin"]["p99"] == pytest.approx(p99, rel=1e-3)
        else:
            # Pictures of numbers do not say where on a triangle their points lie.
            assert found["wrong"] <= expected["wrong"] and found["displacement_arcmin"] is None


def test_colors_name_no_surfaces_and_wrong_ones_are_unknown(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    run("plate", folder, NEAR, "--out", str(tmp_path / "plate.zarr"))
    images = f"--images={folder / '{i}x{j}.png'}"
    for source in (
        (images, "--encoding=rgb"),
        (images, "--encoding=srgb"),
        (f"--plate={tmp_path}/plate.zarr",),
    ):
        (eye,) = told(capfd, folder, EYE, RESOLUTION, *source, f"--out={tmp_path / 'out'}")["eyes"]
        assert eye["renderer"]["wrong"] is None and eye["renderer"]["fraction"] is None
    page = (tmp_path / "out" / "index.html").read_text()
    assert eye["renderer"]["flip"] < 0.1 and "wrong surfaces unknown" in page
    assert (
        f"Its colors differ in {percent(eye['renderer']['color_fraction'])} of the pixels" in page
    )


def test_images_that_name_surfaces_are_charged_with_wrong_ones(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for column, row in np.ndindex(8, 6):
        Image.new("RGB", (32, 24)).save(tmp_path / f"{column}x{row}.png")
    source = f"--images={tmp_path / '{i}x{j}.png'}"
    (eye,) = told(capfd, folder, EYE, RESOLUTION, source, "--encoding=object-id")["eyes"]
    assert eye["renderer"]["fraction"] > 0.1


def test_a_pair_of_eyes_tells_at_which_depth_things_are_seen(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    found = told(capfd, folder, EYE, "--resolution=96,72", "--near=2", "--stereo=65")
    assert [eye["eye"][0] for eye in found["eyes"]] == [-32.5, 32.5]
    (pair,) = found["stereo"]
    # One object lies behind the plate and is seen 2 too far, the other before it and is seen 2 too
    # near.
    assert pair["renderer"]["depth"]["p1"] == pytest.approx(-2, abs=0.5)
    assert pair["renderer"]["depth"]["p99"] == pytest.approx(2, abs=0.5)


def test_a_quilt_is_the_views_of_eyes_from_left_to_right_and_from_the_bottom_up(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out, single = tmp_path / "quilt", tmp_path / "single"
    found = told(
        capfd, folder, "--eye=1,0,300", "--resolution=12,9", NEAR, "--quilt=3x2", f"--out={out}"
    )
    places = [eye["eye"] for eye in found["eyes"]]
    angles = [math.degrees(math.atan2(x - 1.0, 300)) for x, _, _ in places]
    assert angles == pytest.approx([-20, -12, -4, 4, 12, 20])
    names = [f"{name}_qs3x2a1.333.png" for name in ("drawn", "replayed", "true")]
    assert sorted(path.name for path in out.iterdir()) == [*names, "view.json"]
    # The fourth view is the first tile of the second row from the bottom.
    fourth = ",".join(str(value) for value in places[3])
    run("view", folder, f"--eye={fourth}", "--resolution=12,9", NEAR, f"--out={single}")
    with Image.open(out / names[0]) as quilt, Image.open(single / "drawn_0.png") as alone:
        assert quilt.size == (3 * 12, 2 * 9)
        np.testing.assert_array_equal(np.asarray(quilt)[:9, :12], np.asarray(alone))


def test_eyes_on_a_path_are_evenly_spaced() -> None:
    ends = [
        Eye(position=place)
        for place in ((0.0, 0.0, 100.0), (30.0, 0.0, 100.0), (30.0, 10.0, 100.0))
    ]
    found = [eye.position for eye in eyes_on_path(ends, 5)]
    assert found == [(0, 0, 100), (10, 0, 100), (20, 0, 100), (30, 0, 100), (30, 10, 100)]
    with pytest.raises(InputError, match="two eyes"):
        eyes_on_path(ends[:1], 3)


def test_a_plate_of_another_scene_or_with_holes_is_refused(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    stored, other = tmp_path / "row.zarr", tmp_path / "other.toml"
    run("plate", folder, NEAR, "--apertures=*,2", "--out", str(stored))
    other.write_text(SCENE.replace("scale = 6.0", "scale = 7.0"))
    for scene, said in ((folder / "two.toml", "40 of 48 hogels"), (other, "another scene")):
        assert main(["view", str(scene), EYE, "--plate", str(stored), "--quiet"]) == 2
        assert said in capfd.readouterr().err


@pytest.mark.parametrize(
    ("p50", "said"),
    [
        (0.05, "At every eye the renderer moves things by less than the display itself does."),
        (
            0.137,
            "At 0 of 1 eyes the renderer moves things by more than the display does, by p99, and at 1",
        ),
    ],
)
def test_the_renderer_is_said_to_lose_less_only_where_median_and_99th_percentile_agree(
    p50: float, said: str
) -> None:
    def lost(p50: float, p99: float) -> SimpleNamespace:
        moved = SimpleNamespace(p50=p50, p99=p99)
        return SimpleNamespace(
            fraction=0.0, displacement_arcmin=moved, flip=None, color_fraction=None
        )

    losses = {"display": lost(0.0801, 1.5), "renderer": lost(p50, 0.3)}
    eye = SimpleNamespace(eye=(0.0, 0.0, 600.0), losses=losses, display=losses["display"])
    record = SimpleNamespace(eyes=[eye], units="mm", stereo=[])
    scene = SimpleNamespace(vertices=np.zeros((1, 3)))
    found: Any = SimpleNamespace(record=record, renderer=(eye,), gap=None, scene=scene)
    assert any(one.startswith(said) for one in _sentences(found))
