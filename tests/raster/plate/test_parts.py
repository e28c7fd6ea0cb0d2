"""Parts of films have the pixels of whole films, whatever lies beside them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.scenes import DoubleFrustum
from xfrustum.scenes.model.plate_content import ColorType, FilmPart, PlateContent

RESOLUTION = (96, 80)


@pytest.mark.parametrize("name", ["car-studio", "asymmetric-recentered", "large-triangles"])
def test_a_part_has_the_pixels_of_the_whole_film_bit_for_bit(name: str) -> None:
    scene = view(name, RESOLUTION)
    random = np.random.default_rng(7)
    parts = {}
    for column, row in ((40, 30), (3, 58), (77, 12), (41, 30), (42, 31)):
        left, right = np.sort(random.integers(0, RESOLUTION[0], 2)).tolist()
        top, bottom = np.sort(random.integers(0, RESOLUTION[1], 2)).tolist()
        parts[column, row] = FilmPart(columns=(left, right), rows=(top, bottom))
    # One pixel, in a corner of the film.
    parts[60, 44] = FilmPart(columns=(95, 95), rows=(0, 0))
    apertures = [scene.plate.aperture(*index) for index in parts]
    content = PlateContent(color=ColorType.FLOAT32, ids=True)
    with PlateRenderer(scene, DoubleFrustum(near=1.0), content) as renderer:
        some, whole = list(renderer.hogels(apertures, parts)), list(renderer.hogels(apertures))
    shown = 0
    for one, other in zip(some, whole, strict=True):
        (left, right), (top, bottom) = parts[one.aperture.index].columns, parts[one.aperture.index].rows
        here = slice(top, bottom + 1), slice(left, right + 1)
        assert one.triangle is not None
        assert other.triangle is not None
        np.testing.assert_array_equal(one.triangle[here], other.triangle[here])
        np.testing.assert_array_equal(one.color[here], other.color[here])
        shown += int((one.triangle[here] >= 0).sum())
    assert shown > 100
