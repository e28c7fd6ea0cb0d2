"""What is found for a pixel depends on no other: images judged beside one another, and pixels one by one."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.compare.attribution.budget import make_budget
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.compare.metrics.error_maps import (
    ErrorMaps,
    differing_pixels,
    pixel_errors,
    wrong_surface,
)
from xfrustum.compare.prediction.chain import make_chain
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum

NEARS_PER_REACH = (1e-4, 1e-6, 1e-8)
"""Nears at which D16 swaps few surfaces, at which it loses many, and at which it loses all of them."""


class Drawn:
    """The chain of an aperture with a starved depth buffer, and the same cameras' exact one."""

    def __init__(self, near_per_reach: float) -> None:
        scene = view("car", (96, 96))
        near = near_per_reach * scene.frustum.longest_reach
        settings = DoubleFrustum(near=near, depth=DepthFormat.D16, mapping=DepthMapping.STANDARD)
        self.reference = Reference(scene)
        with Rasterizer(scene) as rasterizer:
            self.chain = make_chain(self.reference, rasterizer, scene.plate.middle, settings)
        self.truth, *_, self.exact, self.starved = self.chain.images


@pytest.fixture(scope="module", params=NEARS_PER_REACH)
def drawn(request: pytest.FixtureRequest) -> Drawn:
    return Drawn(request.param)


def test_a_picture_judged_beside_another_is_judged_as_alone(drawn: Drawn) -> None:
    alone = compare_images(drawn.truth, drawn.starved, drawn.reference, radiance=False)
    judged = pixel_errors(drawn.truth, drawn.exact, drawn.reference)
    beside = compare_images(drawn.truth, drawn.starved, drawn.reference, radiance=False, beside=judged)
    assert (drawn.starved.triangle != drawn.exact.triangle).any()
    assert beside.numbers == alone.numbers
    for item in fields(ErrorMaps):
        np.testing.assert_array_equal(getattr(beside.maps, item.name), getattr(alone.maps, item.name))


@pytest.mark.parametrize("axis", range(3))
def test_a_pixel_differs_if_one_coordinate_does(drawn: Drawn, axis: int) -> None:
    moved = np.array(drawn.exact.position)
    row, column = np.argwhere(drawn.exact.triangle >= 0)[0]
    moved[row, column, axis] += 1
    found = differing_pixels(drawn.exact, replace(drawn.exact, position=moved))
    assert found.tolist() == [row * moved.shape[1] + column]


def test_a_pixel_is_charged_to_the_last_link_that_changed_it(drawn: Drawn) -> None:
    budget = make_budget(drawn.reference, drawn.chain)
    images = drawn.chain.images
    wrong = np.argwhere(budget.charge >= 0)
    assert len(wrong)
    for row, column in wrong[:: max(1, len(wrong) // 200)]:
        numbers = [image.triangle[row, column] for image in images]
        last = max(link for link in range(len(numbers) - 1) if numbers[link] != numbers[link + 1])
        assert budget.charge[row, column] == last


def test_a_wrong_surface_is_charged_to_the_link_from_which_on_it_is_wrong(drawn: Drawn) -> None:
    budget = make_budget(drawn.reference, drawn.chain)
    images = drawn.chain.images
    right = np.stack([~wrong_surface(drawn.truth, image, drawn.reference) for image in images])
    last_right = len(images) - 1 - np.argmax(right[::-1], axis=0)
    wrong = ~right[-1] & budget.start.judged
    assert wrong.any()
    np.testing.assert_array_equal(budget.surface_charge, np.where(wrong, last_right, -1))
