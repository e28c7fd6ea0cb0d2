"""The reference's light: formulas written a second time, closed forms, and changes without effect."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support.lit import CENTERED, LAMP, PLATE, RECENTERED, ROUNDING, SUN, card, eyes, lit, quad
from xfrustum.reference import Reference
from xfrustum.scenes import Frustum
from xfrustum.scenes.appearance.appearance import DirectionalLight, Material
from xfrustum.scenes.arrays import Floats

APERTURE = PLATE.aperture(3, 12)

PAINT = Material(ambient=(0.02, 0.05, 0.03), diffuse=(0.7, 0.4, 0.2), specular=(0.3, 0.5, 0.6), exponent=12.5)
# Neither parallel to anything nor symmetric: one behind the plate, one before it, seen from its back.
BEHIND = quad([(-30, -25, -40), (28, -20, -60), (33, 30, -52.75), (-25, 25, -32.75)], "paint")
BEFORE = quad([(6, 2, 30), (4, 9, 34), (16, 12, 41), (18, 5, 37)], "paint")


def phong(
    normal: Floats, eye: Floats, material: Material, lights: tuple[DirectionalLight, ...]
) -> list[float]:
    """Return the radiance toward the eye, every vector by hand; R is the light turned about the normal."""
    if float(np.dot(normal, eye)) < 0:
        normal = -normal
    color = list(material.ambient)
    for light in lights:
        cosine = float(np.dot(normal, light.direction))
        if cosine <= 0:
            continue
        # The light is reflected here instead of the eye: (2 (N.L) N - L).E is (2 (N.E) N - E).L.
        reflected = 2 * cosine * normal - np.array(light.direction)
        highlight = max(float(np.dot(reflected, eye)), 0.0) ** material.exponent
        for channel in range(3):
            color[channel] += light.color[channel] * (
                material.diffuse[channel] * cosine + material.specular[channel] * highlight
            )
    return color


@pytest.mark.parametrize("frustum", [CENTERED, RECENTERED], ids=["centered", "recentered"])
def test_both_sides_of_the_plate_are_lit_by_the_formula(frustum: Frustum) -> None:
    scene = lit(BEHIND, BEFORE, frustum=frustum, paint=PAINT)
    image = Reference(scene).trace(APERTURE)
    for part in (0, 1):
        assert np.count_nonzero(image.object == part) > 20
    for row, column in zip(*np.nonzero(image.covered), strict=True):
        expected = phong(image.normal[row, column], eyes(scene, APERTURE)[row, column], PAINT, (SUN, LAMP))
        np.testing.assert_allclose(image.color[row, column], expected, rtol=ROUNDING)
    assert not image.color[~image.covered].any()


def test_an_eye_vector_that_points_the_other_way_would_be_seen() -> None:
    """The highlight before the plate is where the true eye vector puts it, by much more than rounding."""
    scene = lit(BEFORE, paint=PAINT)
    image = Reference(scene).trace(APERTURE)
    row, column = (int(where[0]) for where in np.nonzero(image.covered))
    normal, eye = image.normal[row, column], eyes(scene, APERTURE)[row, column]
    wrong = phong(normal if np.dot(normal, eye) > 0 else -normal, -eye, PAINT, (SUN, LAMP))
    assert np.abs(image.color[row, column] - wrong).max() > 0.01


def test_a_light_from_behind_leaves_the_ambient_term() -> None:
    scene = lit(
        card((0, 0, -50), (200, 200), "paint"),
        lights=(DirectionalLight(direction=(1, 2, -0.1)),),
        paint=PAINT,
    )
    color = Reference(scene).trace(scene.plate.middle).color
    np.testing.assert_array_equal(color, np.broadcast_to(np.array(PAINT.ambient, np.float32), color.shape))


def test_faces_have_no_back() -> None:
    turned = [replace(part, faces=part.faces[:, [0, 2, 1]]) for part in (BEHIND, BEFORE)]
    scene, back = lit(BEHIND, BEFORE, paint=PAINT), lit(*turned, paint=PAINT)
    seen, from_back = (Reference(s).trace(APERTURE) for s in (scene, back))
    np.testing.assert_array_equal(from_back.normal[seen.covered], -seen.normal[seen.covered])
    np.testing.assert_array_equal(from_back.color, seen.color)


def test_a_smooth_normal_is_turned_by_the_side_of_its_triangle() -> None:
    """Seen from the back, all normals turn, even those that already lean toward the viewer."""
    part = card((0, 0, -50), (200, 200), "paint")
    leaning = np.array([(0.6, 0.0, 0.8), (0.0, 0.6, 0.8), (-0.6, 0.0, 0.8), (0.995, 0.0, -0.1)])
    front = replace(part, vertex_normals=leaning)
    back = replace(part, faces=part.faces[:, [0, 2, 1]], vertex_normals=-leaning)
    colors = [Reference(lit(p, paint=PAINT)).trace(PLATE.middle).color for p in (front, back)]
    np.testing.assert_allclose(colors[0], colors[1], rtol=ROUNDING)
