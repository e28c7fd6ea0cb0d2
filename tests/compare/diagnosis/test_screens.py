"""Recentered frusta: exchanged screens, films of one row, restored numbers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.scene_file import named, part
from xfrustum.compare.diagnosis.diagnosis import diagnose
from xfrustum.compare.diagnosis.encodings import RESAMPLED, IdRepair
from xfrustum.compare.diagnosis.geometry_fit import claims_of, fit_geometry
from xfrustum.compare.diagnosis.testset import TestSet
from xfrustum.compare.renderer_model.drawn_model import NUMBERS, RendererModel
from xfrustum.compare.renderer_model.pictures import trace_drawn
from xfrustum.reference import Reference
from xfrustum.scenes import HogelImage, Scene, open_scene
from xfrustum.scenes.files.foreign_images import (
    Encoding,
    ForeignImage,
    Reading,
    StoredPixels,
    bytes_of,
)

CENTER_X = -26.0  #: of the screen, mm


def recentered(folder: Path, hogels: tuple[int, int], resolution: tuple[int, int]) -> Scene:
    """Return a torus before the plate and a sphere behind it, seen through a screen beside the
    middle.
    """
    text = named("beside", "mm") + (
        f"[plate]\nsize = [30.0, 30.0]\nhogels = {list(hogels)}\n"
        f"[frustum]\nresolution = {list(resolution)}\n"
        f"screen = {{ height = -100.0, center = [{CENTER_X}, 0.0], size = [200.0, 120.0] }}\n"
        "reach = [40.0, 110.0]\n"
    )
    text += part("torus", 14.0, (6.0, 2.0, 20.0), rotate_deg=(20.0, 30.0, 0.0))
    text += part("sphere", 60.0, (-20.0, 5.0, -70.0))
    (folder / "scene.toml").write_text(text)
    return open_scene(str(folder / "scene.toml"))


def stored(reference: Reference, model: RendererModel) -> list[HogelImage]:
    """Return pictures of triangle numbers of all hogels, as a renderer draws them."""
    result: list[HogelImage] = []
    for aperture in reference.scene.plate.apertures():
        shown = trace_drawn(reference, model, aperture)
        numbers = StoredPixels(rgb=bytes_of(shown.triangle + 1))
        result.append(
            ForeignImage(
                camera=reference.camera(aperture),
                triangle=shown.triangle,
                object=np.full_like(shown.triangle, -1),
                position=np.full_like(shown.position, np.nan),
                stored=numbers,
            )
        )
    return result


def test_the_exchanged_center_of_a_screen_is_named(tmp_path: Path) -> None:
    """A single hogel is all there is: a shear of the other sign would show the same."""
    reference = Reference(recentered(tmp_path, (1, 1), (80, 48)))
    images = stored(reference, RendererModel(screen_center=(-2 * CENTER_X, 0.0)))
    result = diagnose(TestSet(reference=reference, images=images, nominal=RendererModel()))
    (fault,) = result.diagnosis.faults
    assert fault.fault == "screen-center-x"
    assert fault.value == pytest.approx(-CENTER_X, rel=0.02)
    assert fault.explains == 1.0
    assert "shear-sign" in fault.alternatives


def test_vertical_numbers_of_films_of_one_row_are_held(tmp_path: Path) -> None:
    """Images of apertures whose columns are shuffled, which no camera explains."""
    reference = Reference(recentered(tmp_path, (5, 3), (80, 1)))
    images = stored(reference, RendererModel())
    cameras = [image.camera for image in images]
    shuffled = [replace(image, camera=cameras[7 * k % 15]) for k, image in enumerate(images)]
    fit = fit_geometry(claims_of(reference.scene, shuffled), RendererModel())
    vertical = np.array([axis == "y" for _, axis, _ in NUMBERS])
    nominal = RendererModel().parameters
    assert (fit.model.parameters == nominal)[vertical].all()
    assert (fit.low == fit.high)[vertical].all()


def test_numbers_are_restored_from_what_the_renderer_states(tmp_path: Path) -> None:
    """Mixed numbers are restored from offset cameras where their author states them."""
    reference = Reference(recentered(tmp_path, (1, 1), (80, 48)))
    nominal = RendererModel(near=6.0)
    (image,) = stored(reference, nominal)
    aperture = reference.scene.plate.middle
    assert (image.triangle != trace_drawn(reference, RendererModel(), aperture).triangle).any()
    reading = Reading(encoding=Encoding.TRIANGLE_ID)
    restoring = IdRepair(kind=RESAMPLED, reading=reading, nominal=nominal)
    assert (restoring.read(reference, image).triangle == image.triangle).all()
