"""No false pass: nonexistent surfaces fail, outputs agree, displaced outlines are measured."""

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

import xfrustum
from tests.support.commands import Command
from tests.support.foreign_renderers import small
from tests.support.long_tail import examples
from tests.support.records import problems
from tests.support.scene_file import film, named, part
from tests.support.views import reversed_d32f
from tests.support.worlds import World
from xfrustum.compare.error_maps import surface_errors
from xfrustum.compare.judging.judged import MeasuredBy, judge
from xfrustum.compare.judging.outlines import outline_displacement, steps_of
from xfrustum.compare.judging.verdict import Check, Limits, Outcome
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.compare.renderer_model.pictures import reference_colors
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.verification.verdict import Verification
from xfrustum.reports.verification.words import sentence
from xfrustum.scenes import (
    DoubleFrustum,
    HogelImage,
    Scene,
    open_scene,
)
from xfrustum.scenes.arrays import Bytes, Mask
from xfrustum.scenes.files.pictures import Encoding, Reading, bytes_of
from xfrustum.scenes.model.images import NOTHING
from xfrustum.tolerances import MAX_WRONG

RIGHT, BENT = reversed_d32f(1e-4), reversed_d32f(3.0)
SOME = [(0, 0), (4, 1), (1, 3), (3, 2)]

Paint = Callable[[HogelImage], Bytes]


def ids(image: HogelImage) -> Bytes:
    return bytes_of(image.triangle + 1)


def headlight(image: HogelImage) -> Bytes:
    """Shade by the angle between surface and line; the scene has other lights."""
    assert image.normal is not None
    toward = np.nan_to_num(image.position) - (image.camera.aperture.x, image.camera.aperture.y, 0.0)
    toward /= np.maximum(np.linalg.norm(toward, axis=-1, keepdims=True), 1e-9)
    gray = 0.2 + 0.8 * np.abs((np.nan_to_num(image.normal) * toward).sum(axis=-1))
    return np.repeat(np.where(image.covered, 255 * gray, 0).astype(np.uint8)[..., None], 3, axis=-1)


@pytest.fixture
def stored(tiny: World, tmp_path: Path) -> Callable[..., str]:
    """Return a function that writes pictures of some hogels and returns their path pattern."""

    def write(paint: Paint, settings: DoubleFrustum = RIGHT) -> str:
        for index in SOME:
            image = tiny.raster(settings, index)
            Image.fromarray(paint(image)).save(tmp_path / "{}-{}.png".format(*index))
        return str(tmp_path / "{i}-{j}.png")

    return write


def verified(world: World, pattern: str, encoding: str, **options: Any) -> Verification:
    return xfrustum.verify(world.scene, pattern, apertures=SOME, encoding=encoding, **options)


def test_claims_of_nonexistent_surfaces_fail_with_any_limits(
    tiny: World, stored: Callable[..., str]
) -> None:
    limits: dict[str, Any] = {"max_wrong": 1.0, "max_displacement_px": None}
    result = verified(tiny, stored(headlight), "triangle-id", **limits)
    assert not result.passed
    for hogel in result.hogels:
        assert hogel.as_found is not None and hogel.as_found.surface is not None
        assert hogel.as_found.invalid > 0.9 * hogel.as_found.surface.wrong


@pytest.mark.slow
def test_an_accepted_order_of_channels_is_undone_and_lost_numbers_are_not(
    tiny: World, stored: Callable[..., str]
) -> None:
    pattern = stored(lambda image: ids(image)[..., ::-1])
    accepted = verified(tiny, pattern, "triangle-id", accept=("encoding",))
    assert accepted.passed
    assert [fault.fault for fault in accepted.diagnosis.faults] == ["channel-order"]
    pattern = stored(lambda image: bytes_of((image.triangle + 1) & 255))
    assert not verified(tiny, pattern, "triangle-id", accept=("encoding",)).passed


def test_orders_of_channels_that_cannot_be_distinguished_are_stated(
    tiny: World, stored: Callable[..., str]
) -> None:
    pattern = stored(lambda image: bytes_of(image.object + 1)[..., ::-1])
    result = verified(tiny, pattern, "object-id")
    (order,) = [defect for defect in result.defects() if defect["fault"] == "channel-order"]
    assert order["value"] == "BGR" and "or as GBR" in order["words"]
    assert not result.passed


@given(
    numbers=st.lists(st.integers(-1, 65000), min_size=1, max_size=30),
    channels=st.permutations(range(3)),
    offset=st.integers(1, 2),
)
def test_reading_undoes_storing(numbers: list[int], channels: list[int], offset: int) -> None:
    order = (channels[0], channels[1], channels[2])
    reading = Reading(encoding=Encoding.TRIANGLE_ID, channels=order, offset=offset)
    some = np.array([numbers], dtype=np.int32)
    straight = bytes_of(reading.stored(some))
    rgb = np.empty_like(straight)
    rgb[..., channels] = straight
    np.testing.assert_array_equal(reading.numbers(reading.packed(rgb)), some)


@pytest.mark.slow
def test_text_page_junit_and_json_state_the_worst_values_and_their_limits(
    tiny: World, stored: Callable[..., str], tmp_path: Path, command: Command
) -> None:
    """Each output has the worst hogel's wrong surfaces and displacement, with their limits."""
    out, junit = tmp_path / "out", tmp_path / "junit.xml"
    some = ";".join(f"{i},{j}" for i, j in SOME)
    line = f"verify {tiny.scene_file} {stored(ids, BENT)} --encoding triangle-id --quiet"
    text = command(f"{line} --apertures '{some}' --out {out} --junit {junit}", status=1).out
    data = json.loads((out / "verification.json").read_text())
    worst = {check["figure"]: check["value"] for check in data["checks"]}
    hogels = [hogel["as_found"] for hogel in data["hogels"]]
    surfaces = max(hogel["surface"]["fraction"] for hogel in hogels)
    moved = max(hogel["displacement_px"]["p99"] for hogel in hogels)
    assert worst == {"wrong surfaces": surfaces, "displacement": moved}
    for output in (text, (out / "index.html").read_text(), junit.read_text()):
        assert f"wrong surfaces {100 * surfaces:.3g} % (limit 1 %)" in output
        assert f"displacement {moved:.3g} px (limit 0.5 px)" in output
        assert f"wrong triangles {data['as_found']['wrong']:,}" in output
    cases = ElementTree.parse(junit).getroot().findall("testcase")
    failed = [case.get("name") for case in cases if case.find("failure") is not None]
    assert failed == [f"hogel {i},{j}" for i, j in SOME]


# Registration of outlines

ROWS, COLUMNS = np.mgrid[:80, :80]
DISK = ((COLUMNS - 38) ** 2 + (ROWS - 41) ** 2 < 25**2).astype(np.int32)


@examples(20)
@given(st.integers(-6, 6), st.integers(-6, 6))
def test_outlines_are_registered_where_they_were_moved_to(right: int, down: int) -> None:
    spread = outline_displacement(steps_of(DISK), steps_of(np.roll(DISK, (down, right), (0, 1))))
    assert spread is not None
    assert spread.p50 == pytest.approx(np.hypot(right, down), abs=0.3)


def test_noise_has_no_outlines() -> None:
    for seed in range(5):
        noise = np.random.default_rng(seed).random((80, 80))
        assert outline_displacement(steps_of(DISK), steps_of(noise)) is None


@pytest.mark.parametrize("shift", [0, 1, 3])
def test_a_dim_outline_is_not_registered_with_a_strong_one_beside_it(shift: int) -> None:
    """The strongest contrast lies on a grid, six pixels beside the dim step."""
    gray = np.zeros((96, 96))
    gray[:, 44:] += 0.02
    gray[:, 50:] += 1.0
    gray[8:90:6, 54:92] = 0
    gray[:, 60:92:8] *= 0.5
    # Contrast is capped as in pictures.
    true, shown = (
        (np.minimum(across, 0.2), np.minimum(down, 0.2))
        for across, down in (steps_of(gray), steps_of(np.roll(gray, shift, axis=1)))
    )
    spread = outline_displacement(true, shown)
    assert spread is not None
    assert spread.max == pytest.approx(shift, abs=0.01)


# Objects and colors without outlines

SIDE = 32
FILLED = np.ones((SIDE, SIDE), dtype=np.bool_)


def left(columns: int = SIDE // 2) -> Mask:
    """Return a mask of the columns at the left."""
    return np.broadcast_to(np.arange(SIDE) < columns, (SIDE, SIDE))


def box_at(folder: Path, x: float) -> Scene:
    """Return a box of 100 mm behind the plate; at x = 0 it fills the film, from -50 to 50 mm."""
    place = film((40.0, 40.0), (1, 1), (SIDE, SIDE), (60.0, 60.0), (50.0, 60.0))
    (folder / "scene.toml").write_text(named("box", "mm") + place + part("box", 100.0, (x, 0, -70)))
    return open_scene(folder / "scene.toml")


def judged(scene: Scene, shown: Mask | None, color: Any = None, **options: Any) -> Verification:
    """Verify a renderer that names the box in some pixels (H, W), or shows only colors."""
    nothing = np.full((SIDE, SIDE), NOTHING, dtype=np.int32)
    image = HogelImage(
        camera=Reference(scene).camera(scene.plate.middle),
        triangle=nothing,
        object=nothing if shown is None else np.where(shown, 0, nothing).astype(np.int32),
        position=np.full((SIDE, SIDE, 3), np.nan),
        color=color,
    )
    return xfrustum.verify(scene, lambda _, __: image, **options)


def test_an_object_that_fills_the_film_is_neither_right_nor_wrong(tmp_path: Path) -> None:
    """A picture of this box names it in every pixel, whatever the renderer does wrong."""
    scene = box_at(tmp_path, 0.0)
    result = judged(scene, FILLED)
    numbers = result.hogels[0].as_found
    assert numbers is not None
    assert (numbers.wrong, numbers.displacement_px) == (0, None)
    assert numbers.displacement_by is MeasuredBy.NO_OUTLINES
    assert not result.passed and result.summary()["verdict"] == Outcome.NOT_JUDGED
    assert problems("verify", result.summary()) == []
    assert [(check.figure, check.held) for check in result.checks][-1] == ("displacement", None)
    assert sentence(result).startswith("Not judged, neither right nor wrong: in the hogel the")
    assert result.explained is None
    assert judged(scene, ~FILLED).verdict == "fail"
    half = judged(scene, left()).checks[0]
    assert (half.figure, half.value, half.held) == ("wrong surfaces", 0.5, False)


@pytest.mark.parametrize("columns", [0, 1, 3])
def test_a_straight_outline_that_cannot_be_registered_is_right_in_its_place_alone(
    tmp_path: Path, columns: int
) -> None:
    """The edge has 32 steps, fewer than registration needs."""
    result = judged(box_at(tmp_path, -50.0), left(SIDE // 2 + columns), max_wrong=1.0)
    moved = {check.figure: check for check in result.checks}["displacement"]
    assert result.passed == (columns == 0)
    assert (moved.value, moved.held) == ((None, False) if columns else (0.0, True))


def test_a_film_of_one_color_is_judged_by_its_colors_alone(tmp_path: Path) -> None:
    scene = box_at(tmp_path, 0.0)
    reference = Reference(scene)
    true = reference_colors(reference, RendererModel(), reference.trace(scene.plate.middle)).color
    assert true is not None
    assert judged(scene, None, true).passed
    brighter = judged(scene, None, true + np.float32(0.1))
    assert [check.figure for check in brighter.checks if not check.held] == ["wrong colors"]


# Rules

PASS, FAIL, BLIND = (True, True), (True, False), (True, None)
"""Results for two limits: True (kept), False (exceeded), or None (no verdict)."""


@pytest.mark.parametrize(
    ("before", "after", "mended"),
    [
        (FAIL, PASS, True),
        (FAIL, FAIL, False),
        (FAIL, BLIND, False),  # too few pixels remain after the correction, which proves nothing
        (BLIND, BLIND, True),
        (BLIND, PASS, True),
        (BLIND, FAIL, False),
    ],
)
def test_hogels_that_cannot_be_judged_refute_no_defect(
    before: Any, after: Any, mended: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def checks(_: Limits, figures: Any, excused: int = 0) -> tuple[Check, ...]:
        return tuple(
            Check(figure="", value=None, limit=1.0, unit="px", held=held) for held in figures.kept
        )

    monkeypatch.setattr(Limits, "checks", checks)
    as_found: Any = SimpleNamespace(kept=before, rounded=0)
    corrected: Any = SimpleNamespace(kept=after, rounded=0)
    assert Limits().mends(as_found, corrected, RendererModel()) is mended


@pytest.mark.parametrize("name", ["asymmetric", "asymmetric-recentered"])
def test_verify_counts_surfaces_from_outside_the_film_as_a_comparison_does(name: str) -> None:
    scene = small(name, 48)
    reference, aperture = Reference(scene), scene.plate.aperture(1, 3)
    with Rasterizer(scene) as rasterizer:
        image = rasterizer.render(aperture, reversed_d32f(8.0))
    compared = surface_errors(reference.trace(aperture), image, reference)
    points = image.position.astype(np.float64)
    surface = judge(reference, RendererModel(), image, points).numbers.surface
    assert surface is not None and compared.outside.any()
    assert (surface.outside, surface.wrong) == (compared.outside.sum(), compared.wrong.sum())
    # Offset cameras have their own films: in their model nothing lies outside.
    numbers = judge(reference, RendererModel(near=8.0), image, points).numbers
    assert numbers.surface is not None and numbers.surface.outside == 0
    assert numbers.judged_fraction < MAX_WRONG
