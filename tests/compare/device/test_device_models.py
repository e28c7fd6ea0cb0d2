"""Frames of a device, recorded or drawn here, lie within the bounds of its own model only."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.views import SHARED
from xfrustum.compare.fingerprints import NEAREST_EVEN, Measured, Within
from xfrustum.compare.rounding.depth import Planes
from xfrustum.raster import Rasterizer
from xfrustum.raster.device.fingerprint import Fingerprint, draw_fingerprint
from xfrustum.scenes import InputError, open_scene
from xfrustum.scenes.model.device_model import H100, LLVMPIPE, DeviceModel, model_of, safe_model
from xfrustum.scenes.plate import DepthFormat

RECORDED = SHARED / "data" / "devices"
MODELS = {"llvmpipe": LLVMPIPE, "h100": H100}


def share(counts: Within) -> float:
    return counts.within / counts.pixels


def measured_on(device: str) -> Measured:
    path = RECORDED / f"{device}-fingerprint.npz"
    if not path.exists():
        pytest.skip(f"needs ../shared/data/devices/{path.name}, beside the checkout")
    return Measured(Fingerprint.read(path))


@pytest.fixture(scope="module", params=sorted(MODELS))
def recorded(request: pytest.FixtureRequest) -> tuple[Measured, DeviceModel]:
    return measured_on(request.param), MODELS[request.param]


def test_a_recorded_fingerprint_measures_the_known_model(
    recorded: tuple[Measured, DeviceModel],
) -> None:
    measured, known = recorded
    assert replace(measured.model, name=known.name) == known
    assert measured.known == known


def test_depths_varyings_and_filter_weights_lie_within_the_bounds_of_their_device(
    recorded: tuple[Measured, DeviceModel],
) -> None:
    measured, known = recorded
    for counts in (
        *(measured.within(known, depth) for depth in DepthFormat),
        measured.varyings_within(known),
    ):
        assert counts.within == counts.pixels > 90_000
        assert counts.share_of_safe <= 1.0
    filtered = measured.filtered_within(known)
    assert filtered.within == filtered.pixels == 4096


def test_a_card_is_out_of_the_bounds_of_a_device_that_rounds_less() -> None:
    """The card snaps vertices before it computes depth planes, and filters on a grid of 2^-8."""
    measured = measured_on("h100")
    for depth in (DepthFormat.D24, DepthFormat.D32F):
        assert 1 - share(measured.within(LLVMPIPE, depth)) > 0.15
    # The card's D16 values are off by more than half a step.
    nearest = replace(H100, d16=(-0.5, 0.5))
    counts = [measured.within(model, DepthFormat.D16) for model in (H100, nearest)]
    assert counts[0].share_of_safe > counts[1].share_of_safe
    assert 1 - share(measured.varyings_within(LLVMPIPE)) > 0.1
    # Exact filter weights are odd multiples of 2^-13, hence never multiples of 2^-8.
    assert measured.filtered_within(LLVMPIPE).within == 0


def test_coverage_reveals_rounding_of_corners_and_tie_rules(
    recorded: tuple[Measured, DeviceModel],
) -> None:
    """The recorded triangles have ties only at their left and right edges."""
    measured, known = recorded
    assert measured.viewport[NEAREST_EVEN] == 0
    assert measured.ties == {"left and bottom": 0, "left and top": 0}
    # llvmpipe clips at the window's border, 32 pixels from its middle; the card does not clip
    # within 40 pixels.
    cut = measured.cut_from_px
    assert cut is None if known == H100 else cut is not None and 32 < cut < 33


def test_this_device_draws_as_its_model_predicts() -> None:
    with Rasterizer(open_scene("car")) as rasterizer, rasterizer._context:
        measured = Measured(draw_fingerprint(rasterizer._context, rasterizer.device))
    # Edges half a subpixel from centers separate half-to-even from half-up rounding; random
    # triangles do not.
    assert [name for name, count in measured.viewport.items() if not count] == [NEAREST_EVEN]
    assert list(measured.ties.values()) == [0]
    for depth in DepthFormat:
        assert share(measured.within(rasterizer.model, depth)) == 1.0
        assert share(measured.within(measured.model, depth)) == 1.0


@pytest.mark.parametrize("snaps", [False, True])
def test_planes_through_corners_that_move_within_the_bounds_stay_within_the_tolerance(
    *, snaps: bool
) -> None:
    """Corners move at random within the bounds of float32 and, with `snaps`, of snapping."""
    rng = np.random.default_rng(7)
    model = replace(LLVMPIPE, snaps_depth=snaps)
    count, which = 20, np.zeros(20, dtype=np.int64)
    for _ in range(60):
        w, film = np.exp(rng.uniform(-3, 3, (3, 1))), rng.uniform(-1, 1, (3, 2))
        corners = np.hstack((film * w, w, rng.uniform(0, 1, (3, 1)) * w))
        rounding = 2.0**-24 * np.abs(corners)
        planes = Planes(
            vertices=corners[None, :, :3],
            value=corners[None, :, 3],
            moved=rounding[None, :, :3],
            moved_value=rounding[None, :, 3],
            uncut=np.ones(1, dtype=np.bool_),
            largest=np.ones(1),
            resolution=(64, 64),
        )
        points = np.column_stack((rng.dirichlet(np.ones(3), count) @ film, np.ones(count)))
        moved = corners + rng.choice((-1, 1), (3, 4)) * rounding
        places = moved[:, :2] / moved[:, 2:3]
        if snaps:
            places += rng.choice((-1, 1), (3, 2)) * model.half_step * 2 / 64
        plane = np.linalg.solve(np.column_stack((places, np.ones(3))), moved[:, 3] / moved[:, 2])
        off = np.abs(points @ plane - planes.exact(which, points))
        # Points near the rim may lie outside the moved triangle; there its plane is extended.
        assert (off <= 1.02 * planes.tolerance(which, points, model)).all()


def test_an_unmeasured_device_has_the_widest_bounds() -> None:
    known = model_of({"renderer": "llvmpipe (LLVM 15.0.6, 256 bits)", "subpixel_bits": "8"})
    foreign = model_of({"renderer": "A card of tomorrow", "subpixel_bits": "6"})
    assert (known, foreign) == (LLVMPIPE, safe_model(6))
    assert foreign.snaps_depth and foreign.half_step == 2.0**-7


def test_a_model_is_read_from_the_file_that_the_command_writes(tmp_path: Path) -> None:
    path = tmp_path / "device.json"
    path.write_text(json.dumps({"model": H100.as_json()}))
    assert DeviceModel.read(path) == H100
    path.write_text('{"model": {"name": "x"}}')
    with pytest.raises(InputError, match=r"no device\.json"):
        DeviceModel.read(path)
