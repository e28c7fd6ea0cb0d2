"""Frames recorded on a graphics card: every difference from exact cameras is explained."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.light import radiance_by_definition
from tests.support.long_tail import thinned
from tests.support.views import SHARED, reversed_d32f, view
from xfrustum.compare.attribution import explain
from xfrustum.compare.error_maps import judged_pixels, surface_errors
from xfrustum.compare.prediction.depth import DepthLayers, depth_wrong_shares
from xfrustum.compare.prediction.reasons import MIN_PIXELS
from xfrustum.compare.recorded import RecordedFrame, read_frames, recorded_image, replay
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DoubleFrustum, InputError
from xfrustum.scenes.model.device_model import H100, LLVMPIPE, DeviceModel, safe_model
from xfrustum.scenes.model.effects import Effect, needed

RECORDED = SHARED / "data" / "devices"
STAYS_UNEXPLAINED = 0.9

Recording = tuple[dict[str, str], list[RecordedFrame]]


@pytest.fixture(scope="module")
def h100() -> Recording:
    path = RECORDED / "h100-frames.npz"
    if not path.exists():
        pytest.skip("needs ../shared/data/devices/h100-frames.npz, beside the checkout")
    return read_frames(path)


def some(recording: Recording, *names: str) -> Recording:
    device, frames = recording
    return device, [frame for frame in frames if any(name in frame.name for name in names)]


@pytest.mark.parametrize(
    ("names", "frames", "wrong"),
    [
        (("large-triangles|1e-06", "crossing|1e-08"), 18, 50_000),
        pytest.param(("",), 294, 850_000, marks=pytest.mark.slow),
    ],
    ids=["starved", "all"],
)
def test_nothing_that_the_card_drew_is_unexplained(
    h100: Recording, names: tuple[str, ...], frames: int, wrong: int
) -> None:
    outcome = replay(some(h100, *names))
    assert (outcome.device_model, outcome.frames) == (H100.name, frames)
    assert outcome.unexplained == 0
    assert outcome.wrong > wrong and outcome.order > 10_000


def test_a_model_without_snapped_depth_leaves_a_pixel_of_the_card_unexplained(
    h100: Recording,
) -> None:
    """Devices differ in few pixels: depth tests mostly swap triangles that are many steps apart."""
    frames = some(h100, "car|0.0001|d32f|reversed")
    assert replay(frames).unexplained == 0
    assert replay(frames, LLVMPIPE).unexplained > 0


@pytest.mark.parametrize("model", [LLVMPIPE, H100, safe_model(8)], ids=lambda model: model.name)
@pytest.mark.parametrize("axis", [0, 1])
def test_pictures_shifted_by_one_pixel_stay_unexplained(
    h100: Recording, model: DeviceModel, axis: int
) -> None:
    names = "car|0.01|d24|standard|40,30", "asymmetric|0.01|d32f|reversed|40,30"
    for device, frames in (some(h100, name) for name in names):
        shifted = [replace(frame, triangle=np.roll(frame.triangle, 1, axis)) for frame in frames]
        outcome = replay((device, shifted), model)
        assert outcome.wrong > 500
        assert outcome.unexplained >= STAYS_UNEXPLAINED * outcome.wrong


def test_a_far_plane_below_clip_precision_may_cut_before_half_the_reach() -> None:
    """The triangle is 25,000 units long and the reach 150: rounding decides where it is cut."""
    scene = view("large-triangles", (192, 144))
    settings, aperture = DoubleFrustum(near=1.5e-4), scene.plate.aperture(0, 0)
    model = Reference(scene).trace_model(aperture, settings)
    with Rasterizer(scene) as raster:
        drawn = raster.render(aperture, settings, normals=False, color=False)
        explanation = explain(scene, model, drawn, raster.model)
    gone = (model.triangle == 2) & ~drawn.covered & (model.height < scene.frustum.reach[0] / 2)
    assert gone.sum() > 1000
    assert not explanation.unexplained.any()
    assert explanation.masks["edge"][gone].mean() > 0.99


def test_files_that_are_no_recordings_are_refused(tmp_path: Path) -> None:
    path, device = tmp_path / "frames.npz", '{"renderer": "x", "subpixel_bits": "8"}'
    numbers = np.zeros((2, 2), np.int32)
    for message, arrays in (
        ("is no recording of frames", {"car": numbers}),
        ("triangle numbers", {"device": device, "car": numbers.astype(float)}),
        ("names no frame", {"device": device, "car": numbers}),
    ):
        np.savez(path, **arrays)
        with pytest.raises(InputError, match=message):
            replay(read_frames(path))


def shares(recording: Recording, scene_name: str) -> list[tuple[str, int, float]]:
    """Return frames with their numbers of pixels wrong by depth alone, recorded and predicted."""
    scene, counted = view(scene_name, (192, 144)), []
    reference, middle = Reference(scene), scene.plate.middle
    truth = reference.trace(middle)
    judged = judged_pixels(truth)
    layers = DepthLayers.from_truth(truth, reference.gaps(middle), reference.gaps(middle, truth))
    for frame in recording[1]:
        place, settings = frame.question(scene)
        if frame.scene != scene_name or place != middle:
            continue
        exact = reference.trace_model(middle, settings, shaded=False)
        images = exact, recorded_image(scene, exact, frame, H100)
        without, wrong = (surface_errors(truth, image, reference).wrong for image in images)
        (share,) = depth_wrong_shares(layers, scene.frustum, [settings], H100)
        counted.append((frame.name, int((wrong & ~without & judged).sum()), share * layers.judged))
    return counted


@pytest.mark.parametrize(
    "name",
    thinned(["asymmetric-recentered", "car", "asymmetric", "car-recentered", "crossing"], 5),
)
def test_the_card_shows_the_predicted_share_wrongly(h100: Recording, name: str) -> None:
    """Allow a factor of two from `MIN_PIXELS` on; omit `large-triangles` and parallel sheets."""
    rows = shares(some(h100, f"{name}|1e-0"), name)
    counted = [row for row in rows if row[2] >= MIN_PIXELS]
    assert len(counted) >= 3
    assert [row for row in counted if not row[1] / 2 <= row[2] <= row[1] * 2] == []
    assert all(row in counted or row[1] <= 2 * MIN_PIXELS for row in rows)


COSINE_ROUNDINGS = 70
"""Roundings of 2^-24 in the cosine of a highlight. The direction to the camera has 20: 3 in the
place on the film, 12 in the pixel's line, 5 in its length. The reflection doubles them and adds 18.
Light and normal have one each, and the last product 10.
"""

LIGHT_ROUNDINGS = 16
"""Roundings of 2^-24 in the light of a pixel without its highlights, relative to the sum."""


def test_colors_that_the_card_drew_are_those_of_the_definition() -> None:
    """The pictures have neither textures nor mirrors: filter and varyings have no effect."""
    path = RECORDED / "h100-colors.npz"
    if not path.exists():
        pytest.skip("needs ../shared/data/devices/h100-colors.npz, beside the checkout")
    with np.load(path) as colors, np.load(RECORDED / "h100-frames.npz") as frames:
        for name in [name for name in colors.files if name != "device"][::3]:
            of_scene, near = name.split("|")
            scene = view(of_scene, (192, 144))
            assert not needed(scene) & {Effect.TEXTURES, Effect.VERTEX_COLORS, Effect.REFLECTION}
            settings = reversed_d32f(float(near) * scene.frustum.longest_reach)
            middle = scene.plate.middle
            with Rasterizer(scene) as raster:
                image = raster.render(middle, settings, normals=False)
            shown = frames[f"{name}|d32f|reversed|{middle.column},{middle.row}"]
            same = image.covered & (shown == image.triangle)
            assert same.sum() > 0.999 * image.covered.sum()
            exact = radiance_by_definition(scene, image)[same]
            lit = sum(max(light.color) for light in scene.appearance.lights)
            slope = max(max(material.specular) * material.exponent for material in scene.materials)
            bound = 2.0**-24 * (COSINE_ROUNDINGS * slope * lit + LIGHT_ROUNDINGS * exact.max())
            # A filter weight is off by up to 2^-9, which is a much larger error.
            assert bound < H100.filter_rounding / 20
            assert np.abs(colors[name][same] - exact).max() <= bound, name
            assert np.abs(image.color[same] - exact).max() <= bound, name
