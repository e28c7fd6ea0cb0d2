"""First surfaces along lines, compared with brute force in rational numbers."""

import numpy as np
import pytest

from tests.support.exact_brute_force import exact_pixels
from tests.support.long_tail import thinned
from tests.support.views import lines_by_definition, view
from xfrustum.reference import Reference
from xfrustum.scenes import NOTHING, Certainty

#: Largest error of a point relative to the reach: a dozen roundings of doubles
POSITION = 1e-12

PIXELS = 60  #: random pixels of each image that are compared with rational numbers

CASES = [
    ("car", (36, 48), (17, 52)),
    ("asymmetric", (95, 64), (80, 7)),
    ("crossing", (64, 64), (29, 12)),
    ("sheets", (96, 96), (38, 33)),
    ("asymmetric-recentered", (96, 72), (3, 55)),
    ("large-triangles", (96, 96), (40, 30)),
    ("beetle", (48, 36), (11, 44)),
    ("teapot-recentered", (72, 96), (77, 60)),
]


@pytest.mark.parametrize(("name", "resolution", "aperture"), thinned(CASES, 3, 1))
def test_every_line_shows_what_brute_force_shows(
    name: str, resolution: tuple[int, int], aperture: tuple[int, int]
) -> None:
    scene = view(name, resolution)
    where = scene.plate.aperture(*aperture)
    image = Reference(scene).trace(where)
    random, reach = np.random.default_rng(3), scene.frustum.longest_reach
    number, pixels = image.triangle.ravel(), random.permutation(image.triangle.size)
    some = np.concatenate(
        [pixels[number[pixels] == NOTHING][: PIXELS // 3], pixels[number[pixels] != NOTHING]]
    )
    some = some[:PIXELS]
    expected = exact_pixels(scene, where, some)
    assert number[some].tolist() == [min(winners, default=NOTHING) for winners, _ in expected]
    tied = image.certainty.ravel()[some] == Certainty.TIE
    np.testing.assert_array_equal(tied, [len(item.winners) > 1 for item in expected])
    s = np.array([item.s for item in expected])[:, None]
    points = (
        np.array([where.x, where.y, 0.0])
        + s * lines_by_definition(scene, where).reshape(-1, 3)[some]
    )
    np.testing.assert_allclose(
        image.position.reshape(-1, 3)[some], points, rtol=0, atol=POSITION * reach
    )

    np.testing.assert_array_equal(image.height, image.position[..., 2])
    shown = image.covered
    assert shown.mean() > 0.01
    corners = scene.triangles[image.triangle[shown]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    np.testing.assert_allclose(image.normal[shown], normal, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(
        image.object[shown], scene.object_of_triangle[image.triangle[shown]]
    )
    assert np.isnan(image.position[~shown]).all() and np.isnan(image.normal[~shown]).all()
    assert not (image.certainty == Certainty.UNEXAMINED).any()
