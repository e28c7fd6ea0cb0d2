"""Detect every flip: one axis of an asymmetric scene, or one of the paper's flips, is wrong."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.views import reversed_d32f, view
from xfrustum.compare.comparison import compare_images
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import Camera, HogelImage

NAMES = ("asymmetric", "asymmetric-recentered")
RESOLUTION = (128, 128)  # square, so that a transposed image still fits
SETTINGS = reversed_d32f(1.5e-4)

RIGHT_SURFACE = 2e-3
"""Largest share of wrong pixels in a right picture, from near-plane error and silhouettes."""
SEEN = 0.05  #: smallest share of pixels that a wrong axis changes; about 0.3 of all show a surface

Picture = Callable[[NDArray[Any]], NDArray[Any]]


@dataclass(frozen=True, kw_only=True)
class Answers:
    """A true image, the raster image of both cameras, and an image of each camera alone."""

    reference: Reference
    truth: HogelImage
    drawn: HogelImage
    c: HogelImage
    c_star: HogelImage

    def surface(self, image: HogelImage) -> float:
        return compare_images(self.truth, image, self.reference).surface.fraction


@pytest.fixture(scope="module", params=NAMES)
def answers(request: pytest.FixtureRequest) -> Answers:
    scene = view(request.param, RESOLUTION)
    aperture, reference = scene.plate.aperture(30, 40), Reference(scene)
    with Rasterizer(scene) as raster:
        drawn = [
            raster.render(aperture, replace(SETTINGS, camera=camera))
            for camera in (Camera.BOTH, Camera.C, Camera.C_STAR)
        ]
    return Answers(
        reference=reference,
        truth=reference.trace(aperture),
        drawn=drawn[0],
        c=drawn[1],
        c_star=drawn[2],
    )


CHANNELS = ("triangle", "object", "position", "normal", "color")


def pictured(image: HogelImage, picture: Picture) -> HogelImage:
    """Return the image with its pixels rearranged."""
    moved: dict[str, Any] = {
        name: picture(values) for name in CHANNELS if (values := getattr(image, name)) is not None
    }
    return replace(image, **moved, certainty=None, tied_triangles=None)


def overlaid(below: HogelImage, above: HogelImage) -> HogelImage:
    """Return the image of one picture laid over another."""

    def choose(name: str) -> NDArray[Any]:
        upper = getattr(above, name)
        on_top = above.covered if upper.ndim == 2 else above.covered[..., None]
        return np.asarray(np.where(on_top, upper, getattr(below, name)))

    arrays: dict[str, Any] = {name: choose(name) for name in CHANNELS}
    return replace(below, **arrays)


PLACES: dict[str, Picture] = {
    "left and right": lambda a: a[:, ::-1],
    "up and down": lambda a: a[::-1],
    "both": lambda a: a[::-1, ::-1],
    "rows and columns": lambda a: np.swapaxes(a, 0, 1),
    "rows and columns, the other diagonal": lambda a: np.swapaxes(a[::-1, ::-1], 0, 1),
}
FLIPS = list(PLACES)[:3]


def test_the_right_picture_is_right_and_one_camera_alone_is_wrong(answers: Answers) -> None:
    assert answers.truth.covered.mean() > 0.15
    for side in (answers.truth.height > 0, answers.truth.height < 0):
        assert side[answers.truth.covered].mean() > 0.2
    assert answers.surface(answers.drawn) < RIGHT_SURFACE
    together = overlaid(answers.c, answers.c_star)
    np.testing.assert_array_equal(together.triangle, answers.drawn.triangle)
    assert min(answers.surface(answers.c), answers.surface(answers.c_star)) > SEEN


@pytest.mark.parametrize("axes", PLACES)
def test_an_image_with_an_axis_mirrored_or_swapped_is_wrong(answers: Answers, axes: str) -> None:
    """Rearrange the whole image, drawn and traced, and the image of one camera alone."""
    c, c_star = answers.c, answers.c_star
    wrong = [pictured(answers.drawn, PLACES[axes]), pictured(answers.truth, PLACES[axes])]
    if axes in FLIPS:
        wrong += [
            overlaid(pictured(c, PLACES[axes]), c_star),
            overlaid(c, pictured(c_star, PLACES[axes])),
        ]
    assert min(map(answers.surface, wrong)) > SEEN


def test_c_over_c_star_is_wrong(answers: Answers) -> None:
    """Pixels with surfaces on both sides of the plate show the wrong surface."""
    both = answers.c.covered & answers.c_star.covered
    assert both.sum() > 100
    wrong = answers.surface(overlaid(answers.c_star, answers.c)) - answers.surface(answers.drawn)
    assert wrong == pytest.approx(both.mean(), abs=2 / both.size + 0.02 * both.mean())
