"""Wrong surfaces at displaced silhouettes: predictions, closed forms, measurements."""

import itertools
import math
from typing import Any

import numpy as np
import pytest

from tests.support.long_tail import thinned
from tests.support.views import at, view
from xfrustum.compare.comparison import compare_images
from xfrustum.compare.prediction.predict import traced_settings
from xfrustum.compare.prediction.silhouettes import (
    Kind,
    Silhouettes,
    contours,
)
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import (
    Camera,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Frustum,
    HogelImage,
    Plate,
    Scene,
    SceneObject,
)
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate import Fit, Offset

FOV = math.radians(60)
SLOPE = math.tan(FOV / 2)
HEIGHT = 50.0
AXIS = at(0.0, 0.0)

STAIRS = 0.02
"""Largest relative error of a contour's length. Where a contour leans by less than 1 in 4, the
normals of its steps are off by up to 1/5 of a radian; their cosines are at most 2 % wrong.
"""

FACTOR = 2.0
"""Largest ratio of the predicted to the measured error, and the reverse. A contour along pixel rows
or columns changes whole rows of pixels at once: the measured error is a whole number of rows. The
predicted error is the mean over all positions of the contour on the grid.
"""


def wrong_inside(truth: HogelImage, raster: HogelImage, reference: Reference) -> int:
    """Return the number of wrong surfaces, except for points from outside the film."""
    maps = compare_images(truth, raster, reference).maps
    return int((maps.surface & ~maps.outside).sum())


def part(corners: Any) -> SceneObject:
    """Return a convex polygon, corners (N, 3), as a fan."""
    count = len(corners)
    faces = np.stack((np.zeros(count - 2), np.arange(1, count - 1), np.arange(2, count)), axis=-1)
    return SceneObject(
        name="polygon", vertices=np.asarray(corners, dtype=float), faces=faces.astype(int)
    )


def scene_of(*parts: SceneObject) -> Scene:
    return Scene(
        name="polygons",
        plate=Plate(size=(1, 1), hogels=(1, 1)),
        frustum=Frustum(resolution=(256, 256), reach=(200.0, 200.0), fov=(FOV, FOV)),
        objects=parts,
    )


def on_film(points: Floats, height: float) -> Floats:
    """Return the points at a height that the true frustum images at film positions (N, 2)."""
    xy = -height * SLOPE * np.asarray(points)
    return np.concatenate((xy, np.full((len(xy), 1), height)), axis=1)


def traced(scene: Scene) -> HogelImage:
    return Reference(scene).trace(AXIS)


def wrong_pixels(silhouettes: Silhouettes, settings: DoubleFrustum, scene: Scene) -> float:
    return sum(silhouettes.charged_pixels(traced_settings(settings, scene.frustum)))


def two_sheets(
    front: float, back: float, turned: float, *, single: bool = False, edge: float = 0.31
) -> Scene:
    """Return a sheet over about half of the film, with a straight edge, before a full sheet."""
    angle = math.radians(turned)
    axes = np.array([(math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))])
    half = np.array([(-3, edge), (3, edge), (3, edge + 4), (-3, edge + 4)]) @ axes
    whole = 3 * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    a, b = part(on_film(half, front)), part(on_film(whole, back))
    if not single:
        return scene_of(a, b)
    vertices = np.concatenate((a.vertices, b.vertices))
    faces = np.concatenate((a.faces, b.faces + len(a.vertices)))
    return scene_of(SceneObject(name="both", vertices=vertices, faces=faces))


SHEETS = [
    (60, 30),
    (60, -30),
    (-30, -60),
    (30, -60),
    (90, 80),
]  #: heights of the front sheet and the back sheet


PLACED = itertools.product(SHEETS, (20, 165, 255), (0.31, -0.2), (False, True))


@pytest.mark.parametrize(
    ("front", "back", "turned", "edge", "single"),
    thinned(((*both, *rest) for both, *rest in PLACED), 11),
)
def test_a_sheet_before_another_is_wrong_where_the_certified_cameras_predict_it(
    front: float, back: float, turned: float, edge: float, single: bool
) -> None:
    """A displaced edge, before and behind the plate, hides and uncovers the predicted area."""
    scene, settings = (
        two_sheets(front, back, turned, single=single, edge=edge),
        DoubleFrustum(near=1.0),
    )
    reference = Reference(scene)
    truth = reference.trace(AXIS)
    assert set(contours(truth).kind) == {Kind.OCCLUSION if single else Kind.OBJECTS}
    measured = wrong_inside(truth, reference.trace_model(AXIS, settings), reference)
    predicted = wrong_pixels(Silhouettes(truth, scene.frustum), settings, scene)
    # Each row of a strip is counted to within a pixel at each end. Over 256 rows the error grows to
    # about sqrt(256).
    assert abs(predicted - measured) <= (STAIRS + 1 / 30) * measured + math.sqrt(256)


def test_a_cut_opens_a_gap_where_the_slabs_do_not_fit() -> None:
    """A tilted sheet is cut at 40: fit `angle` shrinks the inner part, a fit at 40 does not."""
    points = on_film(np.array([[-3.0, -3], [3, -3], [3, 3], [-3, 3]]), -HEIGHT)
    # The edge crosses pixel rows at an irregular slope: otherwise whole rows would change at once.
    points[:, 2] += 16.0 + 0.31 * points[:, 0] + 0.173 * points[:, 1]
    scene = scene_of(part(points))
    reference = Reference(scene)
    truth = reference.trace(AXIS)
    silhouettes = Silhouettes(truth, scene.frustum)
    apart = DoubleFrustum(near=1.0, slabs=(40.0,), fit=Fit.ANGLE)
    measured = wrong_inside(truth, reference.trace_model(AXIS, apart), reference)
    assert measured > 300
    assert wrong_pixels(silhouettes, apart, scene) == pytest.approx(measured, rel=STAIRS + 1 / 30)
    fitted = DoubleFrustum(near=1.0, slabs=(40.0,))
    assert wrong_pixels(silhouettes, fitted, scene) < 1
    assert wrong_pixels(silhouettes, DoubleFrustum(near=1.0), scene) == 0


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("asymmetric", DoubleFrustum(near=1e-6, camera=Camera.C)),
        ("asymmetric", DoubleFrustum(near=1e-6, camera=Camera.C_STAR)),
        ("asymmetric", DoubleFrustum(near=27.0, offset=Offset.NONE)),
        # A surface passes through the aperture itself.
        ("crossing", DoubleFrustum(near=1e-1)),
        ("crossing", DoubleFrustum(near=1e-4)),
    ],
)
def test_surfaces_that_no_camera_draws_are_wrong_pixel_by_pixel(
    name: str, settings: DoubleFrustum
) -> None:
    scene = view(name, (128, 96))
    reference, middle = Reference(scene), scene.plate.middle
    truth = reference.trace(middle)
    drawn = reference.trace_model(middle, settings)
    measured = compare_images(truth, drawn, reference).surface_wrong
    assert measured > 10
    predicted = wrong_pixels(Silhouettes(truth, scene.frustum), settings, scene)
    assert predicted == pytest.approx(measured, rel=STAIRS if name == "crossing" else 1e-2)


@pytest.mark.parametrize("near", [15.0, 1.5])
def test_pixels_that_two_contours_sweep_are_counted_once(near: float) -> None:
    """Each sheet is displaced by many times the distance between the sheets on the film."""
    scene = view("sheets", (128, 128))
    reference, settings = Reference(scene), DoubleFrustum(near=near)
    truth = reference.trace(scene.plate.middle)
    drawn = reference.trace_model(scene.plate.middle, settings)
    measured = wrong_inside(truth, drawn, reference)
    assert measured > 5000
    predicted = wrong_pixels(Silhouettes(truth, scene.frustum), settings, scene)
    assert measured / FACTOR <= predicted <= min(truth.triangle.size, measured * FACTOR)


@pytest.mark.parametrize("name", thinned(["asymmetric", "car"], 2))
def test_snapping_edges_to_subpixels_costs_about_as_many_pixels_as_predicted(name: str) -> None:
    """The sum over five images agrees within chance: a few dozen pixels at most."""
    scene = view(name)
    reference, aperture = Reference(scene), scene.plate.middle
    truth = reference.trace(aperture)
    silhouettes = Silhouettes(truth, scene.frustum)
    measured, predicted = 0, 0.0
    with Rasterizer(scene) as rasterizer:
        bits = int(rasterizer.device["subpixel_bits"])
        for near in (1e-5, 2e-5, 3e-5, 4e-5, 5e-5):
            settings = DoubleFrustum(near=near, depth=DepthFormat.D32F, mapping=DepthMapping.LINEAR)
            drawn = rasterizer.render(aperture, settings, normals=False, color=False)
            measured += wrong_inside(truth, drawn, reference)
            predicted += silhouettes.snapped_pixels(settings, bits)
    chance = 3 * math.sqrt(predicted)
    assert predicted / FACTOR - chance <= measured <= predicted * FACTOR + chance
