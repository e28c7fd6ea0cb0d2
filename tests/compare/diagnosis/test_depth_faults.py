"""A depth buffer that is too coarse, and a reach that cuts surfaces off, are named with their sizes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import xfrustum
from tests.wrong_renderers.ray_caster import Mistakes, picture
from tests.wrong_renderers.worlds import World, harbor
from xfrustum import DepthFormat, DoubleFrustum, HogelImage, Rasterizer, Verification
from xfrustum.compare.renderer_model.conventions import Orientation
from xfrustum.compare.renderer_model.drawn_model import DepthBuffer, DrawnModel
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture


def verified(wrong: Mistakes, folder: Path, encoding: str = "triangle-id") -> Verification:
    """Return what `verify` says of a renderer with these mistakes."""
    world: World = replace(harbor(), resolution=(48, 36), drawn={})
    scene = world.write(folder)
    for i, j in world.apertures:
        Image.fromarray(picture(world, i, j, encoding, wrong)).save(folder / f"{i}-{j}.png")
    return xfrustum.verify(str(scene), str(folder / "{i}-{j}.png"), encoding=encoding)


def test_a_coarse_depth_buffer_is_named_with_its_near_plane(tmp_path: Path) -> None:
    found = verified(Mistakes(near=7e-4, depth_bits=16), tmp_path)
    (fault,) = found.diagnosis.faults
    assert fault.fault == "starved-depth"
    assert fault.low is not None and fault.high is not None
    assert fault.low <= 7e-4 <= fault.high
    assert float(fault.value) == pytest.approx(7e-4, rel=0.02)
    assert found.summary()["corrected"]["causes"]["unexplained"] == 0


def test_depth_fighting_of_a_rasterizer_is_named(tmp_path: Path) -> None:
    """A rasterizer rounds depth before it stores it, and loses what is stored at the clear value."""
    near = 0.002
    scene = xfrustum.open_scene(str(replace(harbor(), resolution=(48, 36), drawn={}).write(tmp_path)))
    with Rasterizer(scene) as rasterizer:

        def draw(_: Scene, aperture: Aperture) -> HogelImage:
            return rasterizer.render(aperture, DoubleFrustum(near=near, depth=DepthFormat.D16))

        found = xfrustum.verify(scene, draw)
    (fault,) = found.diagnosis.faults
    assert fault.fault == "starved-depth"
    assert float(fault.value) == pytest.approx(near, rel=0.05)
    assert found.corrected is not None and found.corrected.wrong < 0.1 * found.as_found.wrong


@pytest.mark.parametrize("encoding", ["triangle-id", pytest.param("rgb", marks=pytest.mark.slow)])
def test_a_shorter_reach_is_named_with_its_height_on_each_side(tmp_path: Path, encoding: str) -> None:
    found = verified(Mistakes(reach=(0.6, 0.5)), tmp_path, encoding)
    faults = {fault.fault: fault for fault in found.diagnosis.faults}
    assert set(faults) == {"reach-front", "reach-back"}
    for name, height in (("reach-front", 36.0), ("reach-back", 35.0)):
        low, high = faults[name].low, faults[name].high
        assert low is not None and high is not None
        assert low <= height <= high
        assert high - low < 1.0


def test_a_buffer_without_steps_to_spare_keeps_the_triangle_that_was_drawn_first_or_last() -> None:
    first = DepthBuffer(near=1e-6)
    distance = np.array([10.0, 20.0, 30.0])
    assert len(set(first.stored(distance, 60.0).tolist())) == 1
    assert len(set(replace(first, near=1.0).stored(distance, 60.0).tolist())) == 3
    assert first.stored(np.array([0.0, 60.0]), 60.0).tolist() == [0.0, 65535.0]


@pytest.mark.parametrize("orientation", [Orientation(False, False, False), Orientation(True, False, True)])
@pytest.mark.parametrize(("axis", "px"), [(0, 1), (0, -2), (1, 2)])
def test_pixels_that_shifted_lines_push_out_are_not_judged(
    orientation: Orientation, axis: int, px: int
) -> None:
    model = DrawnModel(orientation=orientation, odd_lines=(axis, px))
    kept = model.kept(np.ones((6, 8), dtype=np.bool_))
    # Any value may stand where lines begin: upright it lies in the pixels that are not kept, and in no other.
    right = np.arange(48).reshape(6, 8)
    found = model.applied(right)
    odd, gone = slice(1, None, 2), slice(px) if px > 0 else slice(px, None)
    found[(odd, gone) if axis == 0 else (gone, odd)] = -1
    assert np.array_equal(model.upright(found) == right, kept)
