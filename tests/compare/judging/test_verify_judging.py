"""No false pass: what does not exist is wrong, figures name their counts, displacements are
measured.
"""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

import xfrustum
from tests.support.long_tail import examples
from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main
from xfrustum.compare.judging.outlines import outline_displacement, steps_of
from xfrustum.raster import Rasterizer
from xfrustum.reports.verification.verdict import Verification
from xfrustum.reports.verification.words import check_words
from xfrustum.scenes import (
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    HogelImage,
    open_scene,
)
from xfrustum.scenes.arrays import Bytes
from xfrustum.scenes.files.foreign_images import Encoding, Reading

FILM = film(
    (40.0, 40.0), hogels=(2, 2), resolution=(64, 64), fov_deg=(60.0, 60.0), reach=(50.0, 60.0)
)


def scene_text() -> str:
    """Return a torus before the plate and a sphere behind it, in mm."""
    torus = part("torus", 12.0, (6.0, 3.0, 25.0), rotate_deg=(20.0, 30.0, 0.0))
    return named("three parts", "mm") + FILM + torus + part("sphere", 30.0, (-4.0, 2.0, -35.0))


RIGHT = DoubleFrustum(near=1e-4, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED)
OTHER_NEAR = replace(RIGHT, near=3.0)

Paint = Callable[[HogelImage], Bytes]
Hogels = dict[str, list[HogelImage]]


@pytest.fixture(scope="module")
def hogels(tmp_path_factory: pytest.TempPathFactory) -> Hogels:
    """The scene's four hogels drawn rightly, and with another near."""
    place = tmp_path_factory.mktemp("scenes")
    result = {}
    for name, settings_ in (("right", RIGHT), ("near", OTHER_NEAR)):
        file = place / f"{name}.toml"
        file.write_text(scene_text())
        scene = open_scene(str(file))
        with Rasterizer(scene) as rasterizer:
            result[name] = [
                rasterizer.render(scene.plate.aperture(i, j), settings_)
                for j in (0, 1)
                for i in (0, 1)
            ]
    return result


@pytest.fixture(autouse=True)
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(scene_text())


def packed(numbers: NDArray[np.integer]) -> Bytes:
    return np.stack((numbers >> 16 & 255, numbers >> 8 & 255, numbers & 255), axis=-1).astype(
        np.uint8
    )


def ids(image: HogelImage) -> Bytes:
    return packed(image.triangle + 1)


def objects(image: HogelImage) -> Bytes:
    return packed(image.object + 1)


def headlight(image: HogelImage) -> Bytes:
    """Gray by the angle between surface and line: a shading that the scene does not have."""
    assert image.normal is not None
    toward = np.nan_to_num(image.position) - (image.camera.aperture.x, image.camera.aperture.y, 0.0)
    toward /= np.maximum(np.linalg.norm(toward, axis=-1, keepdims=True), 1e-9)
    gray = 0.2 + 0.8 * np.abs((np.nan_to_num(image.normal) * toward).sum(axis=-1))
    return np.repeat(np.where(image.covered, 255 * gray, 0).astype(np.uint8)[..., None], 3, axis=-1)


def stored(images: list[HogelImage], paint: Paint, ending: str = "png") -> str:
    """Write pictures of the four hogels; return their pattern."""
    for image in images:
        aperture = image.camera.aperture
        Image.fromarray(paint(image)).save(f"{aperture.column}-{aperture.row}.{ending}")
    return f"{{i}}-{{j}}.{ending}"


def verified(images: list[HogelImage], paint: Paint, **options: Any) -> Verification:
    return xfrustum.verify("scene.toml", stored(images, paint), **options)


def white(image: HogelImage) -> Bytes:
    return np.full((*image.triangle.shape, 3), 255, np.uint8)


@pytest.mark.parametrize("paint", [headlight, pytest.param(white, marks=pytest.mark.slow)])
def test_what_claims_nothing_that_exists_fails_whatever_the_limits(
    paint: Paint, hogels: Hogels
) -> None:
    result = verified(
        hogels["right"], paint, encoding="triangle-id", max_wrong=1.0, max_displacement_px=None
    )
    assert not result.passed
    for hogel in result.hogels:
        assert hogel.as_found is not None and hogel.as_found.surface is not None
        assert hogel.as_found.invalid > 0.9 * hogel.as_found.surface.wrong


@pytest.mark.slow
def test_nothing_is_named_of_numbers_stored_rightly_and_an_accepted_order_is_undone(
    hogels: Hogels,
) -> None:
    assert verified(hogels["right"], ids, encoding="triangle-id").diagnosis.faults == ()
    accepted = verified(
        hogels["right"],
        lambda image: ids(image)[..., ::-1],
        encoding="triangle-id",
        accept=("encoding",),
    )
    assert accepted.passed
    assert [fault.fault for fault in accepted.diagnosis.faults] == ["channel-order"]
    lost = verified(
        hogels["right"],
        lambda image: packed((image.triangle + 1) & 255),
        encoding="triangle-id",
        accept=("encoding",),
    )
    assert not lost.passed


def test_orders_of_channels_that_cannot_be_told_apart_are_said_to_be(hogels: Hogels) -> None:
    result = verified(
        hogels["right"], lambda image: objects(image)[..., ::-1], encoding="object-id"
    )
    (order,) = [defect for defect in result.defects() if defect["fault"] == "channel-order"]
    assert order["value"] == "BGR"
    assert "or as GBR" in order["words"]
    assert not result.passed


@given(
    numbers=st.lists(st.integers(-1, 65000), min_size=1, max_size=30),
    channels=st.permutations(range(3)),
    offset=st.integers(1, 2),
)
def test_reading_undoes_storing(numbers: list[int], channels: list[int], offset: int) -> None:
    reading = Reading(
        encoding=Encoding.TRIANGLE_ID,
        channels=(channels[0], channels[1], channels[2]),
        offset=offset,
    )
    some = np.array([numbers], dtype=np.int32)
    straight = packed(reading.stored(some))
    rgb = np.empty_like(straight)
    rgb[..., channels] = straight
    np.testing.assert_array_equal(reading.numbers(reading.packed(rgb)), some)


@pytest.mark.slow
def test_text_page_junit_and_json_give_the_figures_that_were_limited(
    hogels: Hogels, capsys: pytest.CaptureFixture[str]
) -> None:
    """The worst hogel's wrong surfaces and displacement, each with its limit, are the same four
    times.
    """
    pattern = stored(hogels["near"], ids)
    arguments = ["verify", "scene.toml", pattern, "--encoding", "triangle-id", "--quiet"]
    assert main([*arguments, "--out", "out", "--junit", "junit.xml"]) == 1
    text = capsys.readouterr().out
    data = json.loads(Path("out/verification.json").read_text())
    page = Path("out/index.html").read_text()
    junit = Path("junit.xml").read_text()
    worst = {check["figure"]: check for check in data["checks"]}
    assert set(worst) == {"wrong surfaces", "displacement"}
    surfaces = max(hogel["as_found"]["surface"]["fraction"] for hogel in data["hogels"])
    assert worst["wrong surfaces"]["value"] == surfaces
    words = f"wrong surfaces {100 * surfaces:.3g} % (limit 1 %)"
    displacement = max(hogel["as_found"]["displacement_px"]["p99"] for hogel in data["hogels"])
    moved = f"displacement {displacement:.3g} px (limit 0.5 px)"
    for output in (text, page, junit):
        assert words in output
        assert moved in output
        # No share of wrong pixels stands without its figure.
        assert not re.search(r"\bwrong (pixels )?\(|are wrong", output)
    triangles = data["as_found"]["wrong"]
    for output in (text, page, junit):
        assert f"wrong triangles {triangles:,}" in output
    cases = ElementTree.parse("junit.xml").getroot().findall("testcase")
    assert [case.get("name") for case in cases if case.find("failure") is not None] == [
        f"hogel {i},{j}" for j in (0, 1) for i in (0, 1)
    ]


@pytest.mark.slow
def test_a_displacement_that_nobody_can_measure_keeps_no_limit(hogels: Hogels) -> None:
    def noise(image: HogelImage) -> Bytes:
        random = np.random.default_rng(image.camera.aperture.column)
        return random.integers(1, 255, (64, 64, 3)).astype(np.uint8)

    result = verified(hogels["right"], noise, encoding="rgb", max_wrong=1.0)
    assert not result.passed
    assert result.summary()["as_found"]["displacement_px"] is None
    assert "displacement unknown (limit 0.5 px)" in check_words(result.checks[-1])
    assert verified(
        hogels["right"], noise, encoding="rgb", max_wrong=1.0, max_displacement_px=None
    ).passed


@examples(20)
@given(st.integers(-6, 6), st.integers(-6, 6))
def test_outlines_are_found_where_they_were_moved_to(right: int, down: int) -> None:
    rows, columns = np.mgrid[:80, :80]
    disk = ((columns - 38) ** 2 + (rows - 41) ** 2 < 25**2).astype(np.int32)
    moved = np.roll(disk, (down, right), axis=(0, 1))
    spread = outline_displacement(steps_of(disk), steps_of(moved))
    assert spread is not None
    assert spread.p50 == pytest.approx(np.hypot(right, down), abs=0.3)


@pytest.mark.parametrize("seed", range(5))
def test_noise_has_no_outlines(seed: int) -> None:
    rows, columns = np.mgrid[:80, :80]
    disk = ((columns - 38) ** 2 + (rows - 41) ** 2 < 25**2).astype(np.int32)
    noise = np.random.default_rng(seed).random((80, 80))
    assert outline_displacement(steps_of(disk), steps_of(noise)) is None


@pytest.mark.parametrize("shift", [0, 1, 3])
def test_a_dim_outline_beside_a_strong_one_is_not_taken_for_it(shift: int) -> None:
    """A dim step six pixels beside a strong grid has most contrast on the grid, in a right picture
    too.
    """
    gray = np.zeros((96, 96))
    gray[:, 44:] += 0.02
    gray[:, 50:] += 1.0
    gray[8:90:6, 54:92] = 0
    gray[:, 60:92:8] *= 0.5
    # Contrast counts up to a cap, as in pictures.
    (across, down), (moved_across, moved_down) = (
        steps_of(entry) for entry in (gray, np.roll(gray, shift, axis=1))
    )
    expected = np.minimum(across, 0.2), np.minimum(down, 0.2)
    spread = outline_displacement(
        expected, (np.minimum(moved_across, 0.2), np.minimum(moved_down, 0.2))
    )
    assert spread is not None
    assert spread.max == pytest.approx(shift, abs=0.01)


def test_geometry_passes_another_shading(hogels: Hogels) -> None:
    """Wrong renderers fail in the table, one that rolls its pictures among them."""
    geometry = verified(hogels["right"], headlight, apertures=[(0, 0), (1, 1)], compare="geometry")
    assert geometry.passed
    assert geometry.summary()["compared"] == "geometry"
    assert "where outlines run" in geometry.judged
    assert geometry.checks[0].figure == "wrong outlines"
