"""Light on the command line: effects, numbers of samples, transport, and the paper's figure 7."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.support.commands import Command
from tests.support.scene_file import film, named, part
from xfrustum import Reference, open_scene, read_image
from xfrustum.scenes.appearance import Sampling, Transport
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect
from xfrustum.scenes.model.images import Rendering

MATERIAL = """
[material.shiny]
diffuse = [0.4, 0.3, 0.2]
specular = [0.5, 0.5, 0.5]
exponent = 30.0
[[light]]
direction = [-1.0, 2.0, 3.0]
"""
SCENE = (
    named("two boxes")
    + film((8.0, 6.0), hogels=(5, 3), resolution=(40, 30), fov_deg=(50.0, 40.0), reach=(50.0, 50.0))
    + MATERIAL
    + part("box", 9.0, (2.0, 0.0, -24.0), rotate_deg=(20.0, 30.0, 0.0), material="shiny")
    + part("sphere", 4.0, (-3.0, 1.0, -14.0))
)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "boxes.toml").write_text(SCENE)
    return tmp_path


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (
            "raster boxes.toml --near 0.1 --effects diffuse,c --supersample 2 --aperture-samples 3",
            ((Effect.C, Effect.DIFFUSE), Sampling(supersample=2, aperture=3)),
        ),
        (
            "trace boxes.toml --tracer mitsuba --shadows --samples 2 --quiet",
            (ALL_EFFECTS, Sampling(), Transport(shadows=True, samples=2)),
        ),
    ],
)
def test_the_header_names_the_origin_of_the_picture(
    line: str, expected: tuple[Any, ...], command: Command
) -> None:
    command(f"{line} --out made.exr")
    assert read_image("made.exr").rendering == Rendering.from_effects(*expected)


def test_light_transport_of_a_scene_chooses_the_tracer_that_can_do_it(
    folder: Path, command: Command
) -> None:
    transport = "[transport]\ninterreflection = true\nsamples = 2\n"
    (folder / "boxes.toml").write_text(SCENE + transport)
    command("trace boxes.toml --quiet --out paths.exr")
    assert read_image("paths.exr").camera.light_paths == 2


def test_a_selected_tracer_or_effects_replace_the_scenes_transport(
    folder: Path, command: Command
) -> None:
    (folder / "boxes.toml").write_text(SCENE + "[transport]\nshadows = true\n")
    for option, value in (("--tracer", "embree"), ("--effects", "diffuse")):
        message = command(f"trace boxes.toml {option} {value} --quiet --out local.exr").err
        assert message.startswith(f"xfrustum: note: {option}") and message.count("\n") == 1
        assert "leaves out" in message
        assert read_image("local.exr").camera.light_paths is None


def test_compare_uses_the_variance_of_light_paths(command: Command) -> None:
    command("trace boxes.toml --interreflection --samples 8 --quiet --out noisy.exr")
    noisy = read_image("noisy.exr")
    assert noisy.camera.light_paths == 8
    assert noisy.variance is not None and noisy.variance.max() > 0 and noisy.variance.min() == 0
    command("raster boxes.toml --near 1e-4 --depth d32f --mapping reversed --out r.exr")
    noise = command("compare noisy.exr r.exr --json").record["radiance"]["noise"]
    assert noise["tests"] == 3 * 40 * 30
    assert noise["bias"] < 0, "the raster lacks light"
    command("trace boxes.toml --quiet --out exact.exr")
    assert command("compare exact.exr r.exr --json").record["radiance"]["noise"] is None


def test_figure_7_shows_c_star_as_an_upright_camera_sees_it_that_looks_back_at_the_viewer(
    command: Command,
) -> None:
    """Expected projection about the aperture: -x/|z| to the right and y/|z| upward."""
    printed = command("study figure7 asymmetric --near 1e-4 --other 0,0 --out seven")
    assert Path(printed.out.strip()).read_text().count("data:image/png;base64,") == 5
    c, c_star, both = (
        np.asarray(Image.open(f"seven/{name}.png")) for name in ("c", "c-star", "both")
    )
    # `both` overlays C* on C: it shows C* where C* has a surface, else C.
    np.testing.assert_array_equal(np.where(c_star[..., 3:] > 0, c_star, c), both)
    assert (c[..., 3] > 0).any() and (c_star[..., 3] > 0).any()
    scene = open_scene("asymmetric")
    width, height = scene.frustum.resolution
    fov = scene.frustum.fov
    for name, aperture in (
        ("c-star-as-seen", scene.plate.middle),
        ("c-star-other", scene.plate.aperture(0, 0)),
    ):
        picture = np.asarray(Image.open(f"seven/{name}.png"))
        truth = Reference(scene).trace(aperture)
        points = truth.position[truth.height > 0]
        right = (aperture.x - points[:, 0]) / points[:, 2] / math.tan(fov[0] / 2)
        up = (points[:, 1] - aperture.y) / points[:, 2] / math.tan(fov[1] / 2)
        seen = np.zeros((height, width), dtype=np.bool_)
        rows = np.floor((1 - up) * height / 2).astype(int)
        seen[rows, np.floor((1 + right) * width / 2).astype(int)] = True
        assert seen.sum() > 500
        # Except at outlines, which the near offset moves by less than a pixel.
        assert (seen != (picture[..., 3] > 0)).mean() < 0.005
