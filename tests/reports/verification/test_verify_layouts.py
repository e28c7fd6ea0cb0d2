"""`verify` reads layouts by name, and names common misreadings of them."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.brute_force import meetings
from tests.support.views import view
from xfrustum import (
    Aperture,
    HogelImage,
    InputError,
    Reference,
    Scene,
    Verification,
    verify,
    write_image,
)
from xfrustum.scenes import Plate, Screen
from xfrustum.scenes.files.layouts import Target, layouts_named
from xfrustum.scenes.files.pictures import bytes_of
from xfrustum.scenes.files.plate_files import PlateRows, write_files


def scene_of(resolution: tuple[int, int], hogels: tuple[int, int] = (3, 3)) -> Scene:
    scene = view("asymmetric-recentered", resolution)
    return replace(scene, plate=Plate(size=scene.plate.size, hogels=hogels))


def plate_of(scene: Scene, image: Callable[[Aperture], HogelImage]) -> PlateRows:
    columns, rows = scene.plate.hogels
    apertures = [[scene.plate.aperture(i, j) for i in range(columns)] for j in range(rows)]
    pixels = np.asarray([[bytes_of(image(a).triangle + 1) for a in row] for row in apertures])
    return PlateRows.from_pixels(pixels)


SHAPES = {
    "full": ((16, 16), (3, 3)),
    "horizontal": ((48, 1), (7, 7)),
}
"""Resolution of the hogels, and columns and rows of hogels, by name."""


@cache
def plated(name: str) -> tuple[Scene, PlateRows]:
    scene = scene_of(*SHAPES[name])
    return scene, plate_of(scene, Reference(scene).trace)


def written(plate: PlateRows, name: str, folder: Path) -> Path:
    write_files(plate, Target(layout=layouts_named(name)[0]), folder)
    return folder


def verified(scene: Scene, place: Path, layout: str | None = None) -> Verification:
    return verify(scene, str(place), encoding="triangle-id", layout=layout)


def faults(result: Verification) -> set[str]:
    return {fault.fault for fault in result.diagnosis.faults}


slow = pytest.mark.slow


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        *(("hogels", "full"), ("views", "full")),
        *(pytest.param(name, "full", marks=slow) for name in ("burnett", "hocking", "mosaic")),
        *(pytest.param(name, "horizontal", marks=slow) for name in ("hocking-columns", "quilt")),
    ],
)
def test_a_true_plate_is_right_in_every_layout(name: str, shape: str, tmp_path: Path) -> None:
    scene, plate = plated(shape)
    result = verified(
        scene, written(plate, name, tmp_path), name if shape == "horizontal" else None
    )
    assert result.passed
    assert f"layout {name}" in result.source


def exchanged(plate: PlateRows) -> PlateRows:
    return PlateRows.from_pixels(plate.pixels.swapaxes(2, 3).copy())


MISREAD: dict[str, tuple[str, str, Any, str | None, set[str], str]] = {
    # Plate, layout, change of the plate, stated reading, faults, and words of the faults
    "columns before rows, upright": (
        *("full", "burnett", None, "hogels"),
        *({"orientation", "aperture-order"}, "turned by 180 degrees"),
    ),
    # With as many rows as columns, a transposed picture is an equally good explanation.
    "s before t": (
        *("full", "views", exchanged, None, {"orientation"}),
        "transposed (rows and columns exchanged)",
    ),
}


@pytest.mark.parametrize(
    "case", [pytest.param(name, marks=slow if name != "s before t" else ()) for name in MISREAD]
)
def test_a_wrong_reading_is_named(case: str, tmp_path: Path) -> None:
    shape, layout, change, read, named, words = MISREAD[case]
    scene, plate = plated(shape)
    written(change(plate) if change else plate, layout, tmp_path)
    result = verified(scene, tmp_path, read)
    assert not result.passed and faults(result) == named
    assert words in "; ".join(f"{d['words']}; {d['value']}" for d in result.defects())


def test_views_read_as_hogels_fail_without_a_name(tmp_path: Path) -> None:
    scene, plate = plated("full")
    result = verified(scene, written(plate, "views", tmp_path), "hogels")
    assert not result.passed and faults(result) == set()


def sheared_views(scene: Scene, factor: float) -> PlateRows:
    """Return a plate of views from the screen, sheared by `factor` times the required shear."""
    screen = scene.frustum.screen
    assert screen is not None
    (columns, rows), width = scene.plate.hogels, scene.frustum.resolution[0]
    apertures = [scene.plate.aperture(i, j) for j in range(rows) for i in range(columns)]
    centers = np.array([(aperture.x, aperture.y, 0.0) for aperture in apertures])
    pixels = np.zeros((rows, columns, 1, width, 3), dtype=np.uint8)
    for c in range(width):
        # On a screen before the plate, the film is mirrored.
        eye = np.array([-((2 * c + 1) / width - 1) * screen.size[0] / 2, 0.0, screen.height])
        lines = centers + (1 - factor) * np.array([eye[0], 0.0, 0.0]) - eye
        s = meetings(scene.triangles, eye, lines, (1e-9, 1e3))
        hits = np.where(np.isfinite(s.min(axis=1)), s.argmin(axis=1), -1).reshape(rows, columns)
        pixels[:, :, 0, c] = bytes_of(hits + 1)
    return PlateRows.from_pixels(pixels)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, 0.83])
def test_a_quilt_with_too_little_shear(factor: float, tmp_path: Path) -> None:
    """A vendor's sample shears by 0.83 of the required shear at its default angle, 45 degrees."""
    scene = scene_of((48, 1), (7, 7))
    screen = Screen(height=150.0, center=(0.0, 0.0), size=(80.0, 2.0))
    scene = replace(scene, frustum=replace(scene.frustum, screen=screen))
    result = verified(scene, written(sheared_views(scene, factor), "quilt", tmp_path))
    assert result.passed == (factor == 1.0)
    named = [(fault.fault, round(float(fault.value), 2)) for fault in result.diagnosis.faults]
    assert named == ([] if factor == 1.0 else [("view-shear", factor)])


def test_openexr_files_keep_their_numbers_points_and_turns(tmp_path: Path) -> None:
    scene, _ = plated("full")
    truth = Reference(scene).trace(scene.plate.aperture(2, 0))
    arrays = {name: getattr(truth, name)[::-1, ::-1] for name in ("triangle", "object", "position")}
    write_image(tmp_path / "Hogel_0x2.exr", HogelImage(camera=truth.camera, **arrays))
    result = verify(scene, str(tmp_path), layout="burnett", apertures=[(2, 0)])
    assert result.passed and result.as_found is not None and result.as_found.wrong == 0


def test_a_missing_view_is_missing_in_every_hogel_and_files_must_fit_a_stated_layout(
    tmp_path: Path,
) -> None:
    scene, plate = plated("full")
    (written(plate, "views", tmp_path) / "3_4.png").unlink()
    with pytest.raises(InputError, match="cannot be read in the layout hocking"):
        verified(scene, tmp_path, "hocking")
    result = verified(scene, tmp_path)
    assert {hogel.problem for hogel in result.hogels} == {
        f"{tmp_path}: has no file such as 3_4.png"
    }
