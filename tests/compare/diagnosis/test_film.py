"""Classic mistakes of film and color are named from the images; other mistakes do not get their names."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import xfrustum
from tests.support.foreign_renderers import oblong, saying
from tests.support.light import with_smooth_normals
from xfrustum.compare.diagnosis.diagnosis import Evidence, diagnose
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.renderer_model.drawn_model import RADIUS, DrawnModel, Film, Normals
from xfrustum.compare.renderer_model.pictures import COLOR_TOLERANCE, colored, trace_drawn
from xfrustum.reference import Reference
from xfrustum.reports.verification.verdict import Verification
from xfrustum.scenes import Aperture, HogelImage, Scene
from xfrustum.scenes.appearance.appearance import Material
from xfrustum.scenes.appearance.display import decoding_curve, encoding_curve
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.files.foreign_images import Encoding, StoredPixels, Transfer, of_stored

FEW = [(0, 0), (4, 1), (2, 3)]
DECODED = "linear values that were decoded once more, as if they were sRGB"


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
        (encoding_curve, Encoding.RGB, ("srgb-read-as-linear", "srgb")),
        pytest.param(linear, Encoding.SRGB, ("linear-read-as-srgb", "rgb"), marks=pytest.mark.slow),
        pytest.param(gamma, Encoding.RGB, ("gamma", "gamma 2.2"), marks=pytest.mark.slow),
        pytest.param(twice, Encoding.SRGB, ("wrong-transfer", "sRGB, encoded twice"), marks=pytest.mark.slow),
        # Dark levels lose what they mean: a level of the file is many of the radiance.
        pytest.param(decoding_curve, Encoding.RGB, ("wrong-transfer", DECODED), marks=pytest.mark.slow),
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


@pytest.mark.parametrize(
    ("transfer", "written"), [(Transfer.DECODED, decoding_curve), (Transfer.TWICE, twice)]
)
def test_a_level_of_the_file_bounds_what_rounding_loses(
    transfer: Transfer, written: Callable[[Floats], Floats]
) -> None:
    radiance = np.linspace(0, 1, 10_001)
    levels = (np.rint(255 * written(radiance)) / 255).astype(np.float32)
    lost, step = np.abs(transfer.linear(levels) - radiance), transfer.step(levels)
    assert (lost <= step).all()
    assert lost.max() > 0.4 * step.max(), "the bound is far from what is lost"
    assert (lost > COLOR_TOLERANCE).any()


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
        (Film(distortion=-0.07), "distortion", -0.07),
        pytest.param(Film(angles="y"), "equal-angles", "y", marks=pytest.mark.slow),
        pytest.param(Film(angles=RADIUS), "equal-angles", "radius", marks=pytest.mark.slow),
        pytest.param(Film(distortion=0.02), "distortion", 0.02, marks=pytest.mark.slow),
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
        (Film(rolled=(5, -2)), "object", "wrapped"),
        (Film(rolled=(5, 0)), "color", "wrapped"),
        (Film(size=0.75), "object", "resampled"),
        (Film(angles="xy"), "object", "equal-angles"),
        (Film(distortion=0.05), "object", "distortion"),
        # The search of triangle numbers and of plain pictures takes seconds.
        pytest.param(Film(rolled=(5, -2)), "triangle", "wrapped", marks=pytest.mark.slow),
        pytest.param(Film(size=0.75), "color", "resampled", marks=pytest.mark.slow),
        pytest.param(Film(distortion=0.05), "color", "distortion", marks=pytest.mark.slow),
    ],
)
def test_films_are_found_from_pictures(film: Film, said: str, name: str) -> None:
    found = of_film(film, said)
    assert [fault.fault for fault in found.diagnosis.faults] == [name]
    assert found.diagnosis.model.film == film or name == "distortion"


@pytest.mark.parametrize("said", ["object", pytest.param("triangle", marks=pytest.mark.slow)])
def test_pictures_that_are_rolled_and_not_sheared_are_named(said: str) -> None:
    found = of_film(Film(unsheared=True), said, oblong("asymmetric-recentered"))
    assert [fault.fault for fault in found.diagnosis.faults] == ["wrapped"]
    assert "in place of the frustum's shear" in found.diagnosis.faults[0].words


@pytest.mark.parametrize("said", ["color", pytest.param("triangle color", marks=pytest.mark.slow)])
def test_inverted_normals_are_named_of_smooth_and_of_flat_objects(said: str) -> None:
    first, *others = (scene := oblong()).objects
    mixed = replace(scene, objects=(with_smooth_normals(first), *others))
    found = of_model(DrawnModel(normals=Normals.INVERTED), said, mixed)
    assert [fault.fault for fault in found.diagnosis.faults] == ["inverted-normals"]


def test_inverted_normals_are_lit_as_by_reversed_lights_where_nothing_is_glossy() -> None:
    plain = oblong()
    objects = tuple(replace(one, material="dull") for one in plain.objects)
    dull = replace(plain.appearance, materials={"dull": Material()})
    reversed_lights = tuple(
        replace(one, direction=(-x, -y, -z)) for one, (x, y, z) in ((of, of.direction) for of in dull.lights)
    )
    scene = replace(plain, objects=objects, appearance=dull)
    turned = replace(scene, appearance=replace(dull, lights=reversed_lights))
    answer = trace_drawn(Reference(scene), DrawnModel(), scene.plate.middle)
    inverted = colored(scene, DrawnModel(normals=Normals.INVERTED), answer)
    expected = colored(turned, DrawnModel(), answer)
    assert inverted.color is not None and expected.color is not None and np.ptp(inverted.color) > 0.3
    np.testing.assert_allclose(inverted.color, expected.color, atol=1e-6)


@pytest.mark.slow
def test_a_near_offset_is_named_from_colors_beside_flat_normals() -> None:
    scene = oblong()
    smooth = replace(scene, objects=tuple(with_smooth_normals(part) for part in scene.objects))
    found = of_model(DrawnModel(normals=Normals.FLAT, near=3.0), "color", smooth)
    named = {fault.fault: fault.value for fault in found.diagnosis.faults}
    assert named == {"near": pytest.approx(3.0, rel=0.03), "flat-normals": "flat"}


@pytest.mark.parametrize("said", [pytest.param("color", marks=pytest.mark.slow), "triangle color"])
def test_flat_normals_are_named_where_the_scene_has_smooth_ones(said: str) -> None:
    scene = oblong()
    smooth = replace(scene, objects=tuple(with_smooth_normals(part) for part in scene.objects))
    found = of_model(DrawnModel(normals=Normals.FLAT), said, smooth)
    assert [fault.fault for fault in found.diagnosis.faults] == ["flat-normals"]
    assert not of_model(DrawnModel(), said, smooth).diagnosis.faults
