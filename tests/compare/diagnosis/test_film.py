"""Classic mistakes of film and color are named from the images; other mistakes do not get their names."""

from dataclasses import replace

import numpy as np
import pytest

import xfrustum
from tests.support.foreign_renderers import oblong, saying
from tests.support.light import with_smooth_normals
from xfrustum.compare.diagnosis.diagnosis import Evidence, diagnose
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.renderer_model.drawn_model import RADIUS, DrawnModel, Film
from xfrustum.compare.renderer_model.pictures import colored, trace_drawn
from xfrustum.reference import Reference
from xfrustum.reports.verification.verdict import Verification
from xfrustum.scenes import Aperture, HogelImage, Scene
from xfrustum.scenes.appearance.display import encoding_curve
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.files.foreign_images import Encoding, StoredPixels, of_stored

FEW = [(0, 0), (4, 1), (2, 3)]


def by_name(evidence: Evidence) -> dict[str, Fault]:
    return {fault.fault: fault for fault in diagnose(evidence).diagnosis.faults}


def linear(radiance: Floats) -> Floats:
    return radiance


def gamma(radiance: Floats) -> Floats:
    return radiance ** (1 / 2.2)


def twice(radiance: Floats) -> Floats:
    return np.asarray(encoding_curve(encoding_curve(radiance)))


@pytest.mark.parametrize(
    ("written", "stated", "expected"),
    [
        (encoding_curve, Encoding.RGB, ("wrong-encoding", "srgb")),
        pytest.param(linear, Encoding.SRGB, ("wrong-encoding", "rgb"), marks=pytest.mark.slow),
        pytest.param(gamma, Encoding.RGB, ("wrong-transfer", "gamma 2.2"), marks=pytest.mark.slow),
        pytest.param(twice, Encoding.SRGB, ("wrong-transfer", "sRGB, encoded twice"), marks=pytest.mark.slow),
        # Half as bright is no transfer function.
        pytest.param(lambda radiance: radiance / 2, Encoding.RGB, None, marks=pytest.mark.slow),
    ],
)
def test_colors_through_another_curve_are_read_through_it(
    written: object, stated: Encoding, expected: tuple[str, str] | None
) -> None:
    assert callable(written)
    scene = oblong()
    reference, images = Reference(scene), []
    for index in FEW:
        truth = reference.trace(scene.plate.aperture(*index))
        assert truth.color is not None
        stored = np.rint(255 * written(np.clip(truth.color, 0.0, 1.0))).astype(np.uint8)
        images.append(of_stored(StoredPixels(rgb=stored), truth.camera, stated))
    found = by_name(Evidence(reference=reference, images=images, nominal=DrawnModel()))
    assert [(name, fault.value) for name, fault in found.items()] == ([expected] if expected else [])


def of_film(film: Film, said: str, scene: Scene | None = None) -> Verification:
    """Verify what a renderer with this film draws."""
    return of_model(DrawnModel(film=film), said, scene or oblong())


def of_model(model: DrawnModel, said: str, asked: Scene) -> Verification:
    reference = Reference(asked)

    def draw(_: Scene, aperture: Aperture) -> HogelImage:
        image = trace_drawn(reference, model, aperture)
        return saying(colored(asked, model, image) if "color" in said else image, *said.split())

    return xfrustum.verify(asked, draw, apertures=FEW)


@pytest.mark.parametrize(
    ("film", "name", "value"),
    [
        (Film(angles="xy"), "equal-angles", "x and y"),
        (Film(angles="y"), "equal-angles", "y"),
        (Film(angles=RADIUS), "equal-angles", "radius"),
        (Film(distortion=-0.07), "distortion", -0.07),
        (Film(distortion=0.02), "distortion", 0.02),
    ],
)
def test_lenses_are_found_from_triangles(film: Film, name: str, value: str | float) -> None:
    found = of_film(film, "triangle")
    (fault,) = found.diagnosis.faults
    assert fault.fault == name
    assert fault.value == (value if isinstance(value, str) else pytest.approx(value, abs=2e-4))
    assert fault.explains == 1.0
    assert found.corrected is not None and found.corrected.wrong == 0


@pytest.mark.parametrize(
    ("film", "said", "name"),
    [
        (Film(rolled=(5, -2)), "triangle", "wrapped"),
        (Film(rolled=(5, 0)), "color", "wrapped"),
        (Film(size=0.75), "color", "resampled"),
        (Film(angles="xy"), "object", "equal-angles"),
        (Film(distortion=0.05), "color", "distortion"),
    ],
)
def test_films_are_found_from_pictures(film: Film, said: str, name: str) -> None:
    found = of_film(film, said)
    assert [fault.fault for fault in found.diagnosis.faults] == [name]
    assert found.diagnosis.model.film == film or name == "distortion"


def test_pictures_that_are_rolled_and_not_sheared_are_named() -> None:
    found = of_film(Film(unsheared=True), "triangle", oblong("asymmetric-recentered"))
    assert [fault.fault for fault in found.diagnosis.faults] == ["wrapped"]
    assert "in place of the frustum's shear" in found.diagnosis.faults[0].words


@pytest.mark.parametrize("said", [pytest.param("color", marks=pytest.mark.slow), "triangle color"])
def test_flat_normals_are_named_where_the_scene_has_smooth_ones(said: str) -> None:
    scene = oblong()
    smooth = replace(scene, objects=tuple(with_smooth_normals(part) for part in scene.objects))
    found = of_model(DrawnModel(flat=True), said, smooth)
    assert [fault.fault for fault in found.diagnosis.faults] == ["flat-normals"]
    assert not of_model(DrawnModel(), said, smooth).diagnosis.faults
