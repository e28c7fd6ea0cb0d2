"""Frames recorded on a graphics card: nothing that it drew otherwise than exact cameras is unexplained."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.views import SHARED, view
from xfrustum.compare.attribution.budget import explain
from xfrustum.compare.attribution.recorded import RecordedFrame, read_frames, replay
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DepthFormat, DoubleFrustum, InputError
from xfrustum.scenes.model.device_model import H100, LLVMPIPE, DeviceModel, safe_model

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


def test_nothing_that_the_card_drew_where_depth_is_starved_is_unexplained(h100: Recording) -> None:
    found = replay(some(h100, "large-triangles|1e-06", "crossing|1e-08"))
    assert found.model == H100
    assert found.frames == 18
    assert found.wrong > 50_000
    assert found.counts["unexplained"] == 0
    assert found.counts["order"] > 10_000


@pytest.mark.slow
def test_nothing_in_any_of_the_294_frames_is_unexplained(h100: Recording) -> None:
    found = replay(h100)
    assert (found.frames, found.counts["unexplained"]) == (294, 0)
    assert found.wrong > 850_000


def test_a_model_without_snapped_depth_leaves_a_pixel_of_the_card_unexplained(h100: Recording) -> None:
    """Few pixels tell devices apart: most triangles that a depth test swaps are many steps of it apart."""
    frames = some(h100, "car|0.0001|d32f|reversed")
    assert replay(frames).counts["unexplained"] == 0
    assert replay(frames, LLVMPIPE).counts["unexplained"] > 0


@pytest.mark.parametrize("model", [LLVMPIPE, H100, safe_model(8)], ids=lambda model: model.name)
@pytest.mark.parametrize("name", ["car|0.01|d24|standard", "asymmetric|0.01|d32f|reversed"])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_card_that_drew_one_pixel_beside_would_stay_unexplained(
    h100: Recording, name: str, model: DeviceModel, axis: int
) -> None:
    device, frames = some(h100, f"{name}|40,30", f"{name}|30,40")
    shifted = [replace(frame, triangle=np.roll(frame.triangle, 1, axis)) for frame in frames]
    found = replay((device, shifted), model)
    assert found.wrong > 500
    assert found.counts["unexplained"] >= STAYS_UNEXPLAINED * found.wrong


@pytest.mark.parametrize("depth", list(DepthFormat))
def test_a_far_plane_that_clip_depth_hardly_knows_may_cut_before_half_the_reach(depth: DepthFormat) -> None:
    """The triangle is 25,000 units long, the reach 150: where it is cut is nothing but rounding."""
    scene = view("large-triangles", (192, 144))
    settings = DoubleFrustum(near=1.5e-4, depth=depth)
    aperture = scene.plate.aperture(0, 0)
    model = Reference(scene).trace_model(aperture, settings)
    with Rasterizer(scene) as raster:
        drawn = raster.render(aperture, settings, normals=False, color=False)
        found = explain(scene, model, drawn, raster.model)
    gone = (model.triangle == 2) & ~drawn.covered & (model.height < scene.frustum.reach[0] / 2)
    assert gone.sum() > 1000
    assert not found.unexplained.any()
    assert found.masks["edge"][gone].mean() > 0.99


def test_what_is_no_recording_is_said_to_be_none(tmp_path: Path) -> None:
    path = tmp_path / "frames.npz"
    with pytest.raises(InputError, match="No such file"):
        read_frames(path)
    np.savez(path, car=np.zeros((2, 2)))
    with pytest.raises(InputError, match="is no recording of frames"):
        read_frames(path)
    np.savez(path, device='{"renderer": "x", "subpixel_bits": "8"}', car=np.zeros((2, 2)))
    with pytest.raises(InputError, match="triangle numbers"):
        read_frames(path)
    np.savez(path, device='{"renderer": "x", "subpixel_bits": "8"}', car=np.zeros((2, 2), np.int32))
    with pytest.raises(InputError, match="names no frame"):
        replay(read_frames(path))
