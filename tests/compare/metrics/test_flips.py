"""Every flip is seen: the asymmetric scenes with one axis or one of the paper's flips wrong."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.views import reversed_d32f, view
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.raster import Rasterizer
from xfrustum.raster.cameras import cameras
from xfrustum.reference import Reference
from xfrustum.scenes import Aperture, Camera, HogelImage, Scene

NAMES = ("asymmetric", "asymmetric-recentered")
RESOLUTION = (128, 128)  # a square, so that a transposed image still fits
SETTINGS = reversed_d32f(1.5e-4)

RIGHT_SURFACE = 2e-3
"""Largest share of wrong pixels in the right picture, from near-plane error and silhouettes."""
SEEN = (
    0.05  #: smallest share of pixels that a wrong axis makes wrong; about 0.3 of all show a surface
)

Picture = Callable[[NDArray[Any]], NDArray[Any]]


@dataclass(frozen=True, kw_only=True)
class Answers:
    scene: Scene
    aperture: Aperture
    reference: Reference
    truth: HogelImage
    drawn: HogelImage
    c: HogelImage
    c_star: HogelImage

    def surface(self, image: HogelImage) -> float:
        return float(
            compare_images(self.truth, image, self.reference).summary()["surface"]["fraction"]
        )


@pytest.fixture(scope="module", params=NAMES)
def answers(request: pytest.FixtureRequest) -> Answers:
    scene = view(request.param, RESOLUTION)
    aperture = scene.plate.aperture(30, 40)
    reference = Reference(scene)
    with Rasterizer(scene) as raster:
        drawn = {
            camera: raster.render(aperture, replace(SETTINGS, camera=camera)) for camera in Camera
        }
    return Answers(
        scene=scene,
        aperture=aperture,
        reference=reference,
        truth=reference.trace(aperture),
        drawn=drawn[Camera.BOTH],
        c=drawn[Camera.C],
        c_star=drawn[Camera.C_STAR],
    )


def pictured(image: HogelImage, picture: Picture) -> HogelImage:
    """Return the same pixels in other places."""
    moved: dict[str, Any] = {
        name: picture(getattr(image, name))
        for name in ("triangle", "object", "position", "normal", "color")
        if getattr(image, name) is not None
    }
    return replace(image, **moved, certainty=None, tied_triangles=None)


def overlaid(below: HogelImage, above: HogelImage) -> HogelImage:
    """Return the picture that results when one picture is laid over another."""
    on_top = above.covered

    def choose(name: str) -> NDArray[Any]:
        upper, other = getattr(above, name), getattr(below, name)
        return np.asarray(np.where(on_top if upper.ndim == 2 else on_top[..., None], upper, other))

    names = ("triangle", "object", "position", "normal", "color")
    arrays: dict[str, Any] = {name: choose(name) for name in names}
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
    """The whole image, drawn and traced; and one camera's, which C* has and C has not."""
    c, c_star = answers.c, answers.c_star
    wrong = [pictured(answers.drawn, PLACES[axes]), pictured(answers.truth, PLACES[axes])]
    if axes in FLIPS:
        wrong += [
            overlaid(pictured(c, PLACES[axes]), c_star),
            overlaid(c, pictured(c_star, PLACES[axes])),
        ]
    assert min(map(answers.surface, wrong)) > SEEN


def test_a_c_star_where_the_nearest_wins_is_wrong(
    answers: Answers, monkeypatch: pytest.MonkeyPatch
) -> None:
    """C* looks back: the surface nearest to it is the one farthest from the viewer."""
    own = cameras.pass_of
    c = own(
        answers.scene,
        answers.aperture,
        SETTINGS,
        cameras.cameras_in_order(answers.scene, SETTINGS)[0],
    )

    def as_c(*arguments: Any) -> cameras.Pass:
        return replace(own(*arguments), clear=c.clear, depth_function=c.depth_function)

    monkeypatch.setattr(cameras, "pass_of", as_c)
    with Rasterizer(answers.scene) as raster:
        assert answers.surface(raster.render(answers.aperture, SETTINGS)) > SEEN


def test_c_over_c_star_is_wrong(answers: Answers) -> None:
    """Pixels that show something on both sides of the plate show the wrong one."""
    both = answers.c.covered & answers.c_star.covered
    assert both.sum() > 100
    wrong = answers.surface(overlaid(answers.c_star, answers.c)) - answers.surface(answers.drawn)
    assert wrong == pytest.approx(both.mean(), abs=2 / both.size + 0.02 * both.mean())
