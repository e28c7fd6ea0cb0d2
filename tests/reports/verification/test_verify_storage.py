"""`verify` judges positions in OpenEXR to the precision of the file, and names lossy formats."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image

import xfrustum
from xfrustum import DoubleFrustum, Rasterizer, Reference, Scene, Verification, open_scene

TRIED = Path(__file__).parents[4] / "shared" / "data" / "foreign" / "tried-4" / "exr"
PLACE = (1, 3)
#: Storage of positions: type of numbers, compression, and value of pixels without a surface
STORED = {
    "float": (np.float32, OpenEXR.ZIP_COMPRESSION, 0.0),
    "half": (np.float16, OpenEXR.ZIP_COMPRESSION, 1e10),
    "dwaa": (np.float32, OpenEXR.DWAA_COMPRESSION, 0.0),
}


@pytest.fixture(scope="module")
def bench() -> Scene:
    if not TRIED.is_dir():
        pytest.skip("../shared is not beside the checkout")
    return open_scene(str(TRIED / "bench.toml"))


def half(bench: Scene) -> Scene:
    """Return the scene at half its resolution, which takes a third of the time."""
    return replace(bench, frustum=replace(bench.frustum, resolution=(32, 32)))


@pytest.fixture(scope="module")
def points(bench: Scene) -> dict[str, Any]:
    """Return true positions (H, W, 3), and positions drawn with a near offset."""
    scene, aperture = half(bench), bench.plate.aperture(*PLACE)
    true = Reference(scene).trace(aperture).position
    with Rasterizer(scene) as rasterizer:
        offset = rasterizer.render(aperture, DoubleFrustum(near=1.0)).position
    return {"true": true, "offset": offset}


@pytest.mark.parametrize("stored", [*STORED])
def test_the_truth_passes_in_every_storage_and_errors_fail(
    bench: Scene, points: dict[str, Any], tmp_path: Path, stored: str
) -> None:
    kind, compression, nothing = STORED[stored]

    def judged(name: str) -> Verification:
        with np.errstate(over="ignore"):
            values = np.where(np.isfinite(points[name]), points[name], nothing).astype(kind)
        planes = {f"P.{axis}": values[..., at].copy() for at, axis in enumerate("XYZ")}
        header = {"compression": compression, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, planes).write(str(tmp_path / "h_{}x{}.exr".format(*PLACE)))
        return xfrustum.verify(half(bench), str(tmp_path / "h_{i}x{j}.exr"), apertures=[PLACE])

    assert judged("true").passed
    # Readers differ among the kinds of storage; judging does not.
    if stored == "half":
        assert [fault.fault for fault in judged("offset").diagnosis.faults] == ["near"]


@pytest.mark.parametrize(
    ("name", "right"),
    [
        ("b_half_positions", True),
        ("h_camera_space", False),
        ("j_infinite_background", True),
        ("m_two_parts", True),
        ("n_overscan", True),
    ],
)
def test_files_of_other_programs_are_read_as_they_are_meant(
    bench: Scene, tmp_path: Path, name: str, right: bool
) -> None:
    (tmp_path / "h_2x2.exr").symlink_to(TRIED / f"{name}.exr")
    # One of the files has a black beauty part.
    options: dict[str, Any] = {"apertures": [(2, 2)], "compare": "geometry"}
    result = xfrustum.verify(bench, str(tmp_path / "h_{i}x{j}.exr"), **options)
    assert result.passed == right
    numbers = result.as_found
    assert numbers is not None and numbers.surface is not None
    assert (numbers.surface.fraction <= 0.002) == right


def test_text_and_json_name_formats_that_change_pixels(tmp_path: Path) -> None:
    scene = open_scene("hard/only-behind")
    Image.new("RGB", scene.frustum.resolution, (90, 90, 90)).save(tmp_path / "h_0x0.jpg")
    options: dict[str, Any] = {"encoding": "srgb", "apertures": [(0, 0)]}
    result = xfrustum.verify(scene, str(tmp_path / "h_{i}x{j}.jpg"), **options)
    assert result.summary()["storage"] == {"JPEG, lossy": 1}
    assert "stored as: JPEG, lossy (1 of 1 hogels)" in result.table()
