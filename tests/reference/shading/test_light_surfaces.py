"""Colors of surfaces in the reference under changes of lights, faces and normals.

tests/raster/test_light_raster.py holds both answers against the definition.
"""

from dataclasses import replace

import numpy as np

from tests.support.lit import PLATE, ROUNDING, card, lit
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import model_cameras
from xfrustum.scenes import DoubleFrustum
from xfrustum.scenes.appearance.appearance import Material

MIDDLE = PLATE.middle

PAINT = Material(
    ambient=(0.02, 0.05, 0.03), diffuse=(0.7, 0.4, 0.2), specular=(0.3, 0.5, 0.6), exponent=12.5
)


def test_a_triangle_whose_corner_has_no_normal_is_flat() -> None:
    part = card((0, 0, -50), (200, 200), "paint")
    normals = np.array([(0.6, 0.0, 0.8), (np.nan,) * 3, (-0.6, 0.0, 0.8), (0.0, 0.6, 0.8)])
    paint = Material(specular=(0.5, 0.5, 0.5))
    image = Reference(lit(replace(part, vertex_normals=normals), paint=paint)).trace(MIDDLE)
    flat = Reference(lit(part, paint=paint)).trace(MIDDLE)
    np.testing.assert_array_equal(image.color[image.triangle == 0], flat.color[flat.triangle == 0])
    assert (image.color != flat.color)[image.triangle == 1].any(axis=-1).all()


class TestModel:
    """The traced model has the colors that offset cameras would draw without rounding."""

    def test_cameras_fitted_to_a_height_see_along_lines_of_their_own(self) -> None:
        scene = lit(card((0, 0, -50), (200, 200), "paint"), paint=Material(specular=(0.5,) * 3))
        fitted = DoubleFrustum(near=5.0, fit=20.0)
        (camera, *_) = model_cameras(scene.frustum, MIDDLE, fitted)
        scene_along = replace(
            scene,
            frustum=replace(scene.frustum, fov=tuple(2 * np.arctan(camera.bundle.half_extent))),
        )
        truth = Reference(scene_along).trace(MIDDLE).color
        model = Reference(scene).trace_model(MIDDLE, fitted).color
        np.testing.assert_allclose(model, truth, rtol=ROUNDING)


def test_a_smooth_normal_is_turned_by_the_side_of_its_triangle() -> None:
    """Seen from the back, all normals turn, even those that already lean toward the viewer."""
    part = card((0, 0, -50), (200, 200), "paint")
    leaning = np.array([(0.6, 0.0, 0.8), (0.0, 0.6, 0.8), (-0.6, 0.0, 0.8), (0.995, 0.0, -0.1)])
    front = replace(part, vertex_normals=leaning)
    back = replace(part, faces=part.faces[:, [0, 2, 1]], vertex_normals=-leaning)
    colors = [Reference(lit(p, paint=PAINT)).trace(PLATE.middle).color for p in (front, back)]
    np.testing.assert_allclose(colors[0], colors[1], rtol=ROUNDING)
