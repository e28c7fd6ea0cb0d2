"""Bent eye vector: errors that an offset camera makes in highlights and mirrors."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support.lit import sky
from tests.support.views import reversed_d32f, view
from xfrustum.compare.comparison import away_from_edges
from xfrustum.compare.prediction.displacement import (
    bend,
    drawn_lines,
    measured_eye_error,
    predicted_eye_error,
    true_lines,
)
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.shading import Shader
from xfrustum.scenes import DoubleFrustum, Scene
from xfrustum.scenes.appearance import Appearance, DirectionalLight, Material
from xfrustum.scenes.plate import Pivot

SIZE = (96, 72)
EXPONENT = 12.0


def shiny(name: str, material: Material) -> Scene:
    """Return a scene with one material on all surfaces, under two lights and a gentle sky."""
    scene = view(name, SIZE)
    lights = (
        DirectionalLight(direction=(-1.0, 1.5, 2.0), color=(1.0, 0.8, 0.6)),
        DirectionalLight(direction=(1.0, 0.2, 1.0), color=(0.2, 0.4, 0.6)),
    )
    looks = Appearance(materials={"all": material}, lights=lights, environment=sky(512, 256))
    return replace(
        scene, appearance=looks, objects=tuple(replace(o, material="all") for o in scene.objects)
    )


HIGHLIGHT = Material(
    ambient=(0.1,) * 3, diffuse=(0.3,) * 3, specular=(0.5, 0.4, 0.3), exponent=EXPONENT
)
MIRROR = Material(ambient=(0.0,) * 3, diffuse=(0.0,) * 3, reflectivity=(0.9, 0.8, 0.7))


@pytest.mark.parametrize("name", ["asymmetric", "asymmetric-recentered"])
def test_the_bend_in_closed_form_is_drawn_minus_true_line(name: str) -> None:
    scene = view(name, SIZE)
    aperture = scene.default_apertures()[-1]
    truth = Reference(scene).trace(aperture)
    position = truth.position[truth.covered & (np.abs(truth.height) > 1e-3)].astype(np.float64)
    for near in (0.01, 1.0, 30.0):
        drawn = drawn_lines(position, scene.frustum, aperture, DoubleFrustum(near=near))
        expected = drawn - true_lines(position, aperture)
        np.testing.assert_allclose(bend(position, truth.camera, near), expected, rtol=0, atol=1e-10)
        assert np.abs(expected).max() > 1e-4


def test_the_eye_vector_of_a_pixel_does_not_bend() -> None:
    """With pivot `aperture` and fit `angle`, a pixel's drawn line is parallel to its true line."""
    scene = view("asymmetric-recentered", SIZE)
    aperture = scene.default_apertures()[-1]
    reference, near = Reference(scene), DoubleFrustum(near=1.0)
    model = reference.trace_model(aperture, near)
    through_pixel = true_lines(reference.trace(aperture).position, aperture)
    both = model.covered & (np.abs(model.height) > 1e-3) & np.isfinite(through_pixel[..., 0])
    straight, swerved = (
        drawn_lines(model.position, scene.frustum, aperture, replace(near, pivot=pivot))
        for pivot in (Pivot.APERTURE, Pivot.CAMERA)
    )
    np.testing.assert_allclose(straight[both], through_pixel[both], rtol=0, atol=1e-12)
    assert np.abs(swerved[both] - through_pixel[both]).max() > 1e-4


@pytest.mark.parametrize("material", [HIGHLIGHT, MIRROR])
def test_the_rasterizer_shows_the_bend_that_is_predicted(material: Material) -> None:
    """At drawn points, the device's color minus the true color equals the closed form."""
    scene = shiny("asymmetric", material)
    aperture, near = scene.plate.middle, 4e-3 * 150
    truth = Reference(scene).trace(aperture)
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(aperture, reversed_d32f(near), normals=False)
    where = away_from_edges(truth, drawn) & (np.abs(drawn.height) > 0.05 * 150)
    kept = where[drawn.off_plate]
    measured = measured_eye_error(Shader(scene), drawn)[kept]
    predicted = predicted_eye_error(scene, drawn, near)[kept]
    for side in (drawn.height[where] > 0, drawn.height[where] < 0):
        assert side.sum() > 300
        size = np.sqrt(np.mean(predicted[side] ** 2))
        assert size > 1e-4
        assert np.sqrt(np.mean((measured - predicted)[side] ** 2)) < 0.1 * size
