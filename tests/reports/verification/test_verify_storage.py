"""`verify` judges positions in OpenEXR as exactly as files hold them, and names formats that
changed pixels.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray
from PIL import Image

import xfrustum
from xfrustum import DoubleFrustum, Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.verification.verdict import Verification
from xfrustum.scenes import Scene, open_scene

TRIED = Path(__file__).parents[4] / "shared" / "data" / "foreign" / "tried-4" / "exr"
BESIDE_THE_MIDDLE = (1, 3)
#: How a file stores positions: type of numbers, compression, and value of pixels without a surface.
STORED = {
    "float": (np.float32, OpenEXR.ZIP_COMPRESSION, 0.0),
    "half": (np.float16, OpenEXR.ZIP_COMPRESSION, 1e10),
    "dwaa": (np.float32, OpenEXR.DWAA_COMPRESSION, 0.0),
}
#: Positions that are wrong, made of true ones (H, W, 3) and the aperture's center.
WRONG: dict[str, Callable[[NDArray[Any], NDArray[Any]], NDArray[Any]]] = {
    "meters from the aperture": lambda points, center: center + (points - center) / 1000,
    "camera space": lambda points, center: (points - center) * (1, 1, -1),
}


def scene() -> Scene:
    if not TRIED.is_dir():
        pytest.skip("../shared is not beside the checkout")
    return open_scene(str(TRIED / "bench.toml"))


def judged(folder: Path, of: Scene, points: NDArray[Any], stored: str) -> Verification:
    kind, compression, nothing = STORED[stored]
    with np.errstate(over="ignore"):
        values = np.where(np.isfinite(points), points, nothing).astype(kind)
    planes = {f"P.{axis}": np.ascontiguousarray(values[..., at]) for at, axis in enumerate("XYZ")}
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, planes).write(str(folder / "h_{}x{}.exr".format(*BESIDE_THE_MIDDLE)))
    return xfrustum.verify(of, str(folder / "h_{i}x{j}.exr"), apertures=[BESIDE_THE_MIDDLE])


@pytest.mark.parametrize("stored", STORED)
def test_the_truth_is_right_however_exactly_it_is_stored_and_errors_are_not(
    tmp_path: Path, stored: str
) -> None:
    of = scene()
    aperture = of.plate.aperture(*BESIDE_THE_MIDDLE)
    points = Reference(of).trace(aperture).position
    assert judged(tmp_path, of, points, stored).passed
    center = np.array((aperture.x, aperture.y, 0.0))
    for name, wrong in WRONG.items():
        result = judged(tmp_path, of, wrong(points, center), stored)
        assert not result.passed, name
    with Rasterizer(of) as rasterizer:
        offset = judged(
            tmp_path, of, rasterizer.render(aperture, DoubleFrustum(near=1.0)).position, stored
        )
    assert [fault.fault for fault in offset.diagnosis.faults] == ["near"]


@pytest.mark.parametrize(
    ("name", "right"),
    [
        ("b_half_positions", True),
        ("h_camera_space", False),
        ("i_meters", False),
        ("j_infinite_background", True),
        ("m_two_parts", True),
        ("n_overscan", True),
    ],
)
def test_files_of_other_programs_are_read_as_they_are_meant(
    tmp_path: Path, name: str, right: bool
) -> None:
    of = scene()
    (tmp_path / "h_2x2.exr").symlink_to(TRIED / f"{name}.exr")
    # The beauty part of one of them is black all over.
    result = xfrustum.verify(
        of, str(tmp_path / "h_{i}x{j}.exr"), apertures=[(2, 2)], compare="geometry"
    )
    assert result.passed == right
    numbers = result.as_found
    assert numbers is not None and numbers.surface is not None
    assert (numbers.surface.fraction <= 0.002) == right


def test_files_whose_format_changes_pixels_are_said_in_text_and_json(tmp_path: Path) -> None:
    of = open_scene("hard/only-behind")
    Image.new("RGB", of.frustum.resolution, (90, 90, 90)).save(tmp_path / "h_0x0.jpg")
    result = xfrustum.verify(
        of, str(tmp_path / "h_{i}x{j}.jpg"), encoding="srgb", apertures=[(0, 0)]
    )
    assert result.summary()["storage"] == {"JPEG, lossy": 1}
    assert "stored as: JPEG, lossy (1 of 1 hogels)" in result.table()
