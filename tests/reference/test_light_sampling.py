"""Colors of the reference: means, their convergence, any division into bands, fitted cameras.

tests/raster/test_light_raster.py compares the light of reference and rasterizer with its
definition.
"""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.support.light import dressed_scene
from tests.support.lit import PLATE, RECENTERED, ROUNDING, SUN, card, lit
from xfrustum.reference import Reference
from xfrustum.reference.lines import model_cameras
from xfrustum.reference.pictures import BOX_SIDE
from xfrustum.scenes import DoubleFrustum, Scene
from xfrustum.scenes.appearance import Material, Sampling
from xfrustum.scenes.arrays import Floats, Singles

MIDDLE = PLATE.middle
SMALL = replace(RECENTERED, resolution=(16, 12))


def color(scene: Scene, sampling: Sampling | None = None) -> Singles:
    return Reference(scene).trace(MIDDLE, sampling).color


def test_multisampling_is_replaced_by_the_mean_over_the_same_box() -> None:
    scene = dressed_scene("asymmetric-recentered", (16, 12))
    box = color(scene, Sampling(supersample=BOX_SIDE))
    np.testing.assert_array_equal(color(scene, Sampling(multisample=4)), box)
    np.testing.assert_array_equal(color(scene, Sampling(multisample=4, supersample=2)), box)


def test_bands_change_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    sampling = Sampling(supersample=3, aperture=2)
    whole = color(dressed_scene("asymmetric-recentered", (16, 12)), sampling)
    monkeypatch.setattr("xfrustum.reference.pictures.BAND_PIXELS", 150)
    monkeypatch.setattr("xfrustum.reference.truth.AVERAGED_PIXELS", 60)
    np.testing.assert_array_equal(
        color(dressed_scene("asymmetric-recentered", (16, 12)), sampling), whole
    )


def test_cameras_fitted_to_a_height_see_along_lines_of_their_own() -> None:
    """The traced model has the colors of offset cameras without rounding."""
    scene = lit(card((0, 0, -50), (200, 200), "paint"), paint=Material(specular=(0.5,) * 3))
    fitted = DoubleFrustum(near=5.0, fit=20.0)
    (camera, *_) = model_cameras(scene.frustum, MIDDLE, fitted)
    fov = tuple(2 * np.arctan(camera.bundle.half_extent))
    truth = color(replace(scene, frustum=replace(scene.frustum, fov=fov)))
    model = Reference(scene).trace_model(MIDDLE, fitted).color
    np.testing.assert_allclose(model, truth, rtol=ROUNDING)


class TestSmoothPicture:
    """A highlight on a card that fills a recentered film: radiance is smooth over the aperture."""

    #: Apertures so wide that slopes of their lines differ by about 0.3
    COARSE = replace(PLATE, size=(60.0, 60.0), hogels=(3, 3))

    PAINT = Material(
        ambient=(0.0,) * 3, diffuse=(0.0,) * 3, specular=(1.0, 1.0, 1.0), exponent=40.0
    )

    def scene(self) -> Scene:
        scene = lit(
            card((0, 0, -50), (900, 900), "paint"), frustum=SMALL, lights=(SUN,), paint=self.PAINT
        )
        return replace(scene, plate=self.COARSE)

    def integral(self) -> Floats:
        """Return the mean over the middle aperture by 20-point Gauss quadrature along each axis."""
        rule = np.column_stack(np.polynomial.legendre.leggauss(20)) * (10.0, 0.5)
        screen, (width, height) = SMALL.screen, SMALL.resolution
        u, v = (2 * np.arange(width) + 1) / width - 1, 1 - (2 * np.arange(height) + 1) / height
        total = np.zeros((height, width))
        for (x, of_x), (y, of_y) in itertools.product(rule, repeat=2):
            dx = (x - screen.center[0] + u * screen.size[0] / 2) / screen.height
            dy = (y - screen.center[1] + v * screen.size[1] / 2) / screen.height
            # Reflection keeps the eye vector's component along the card's normal, and negates the
            # rest.
            mirrored = np.stack(np.broadcast_arrays(dx, dy[:, None], 1.0), axis=-1)
            along = mirrored @ np.array(SUN.direction) / np.linalg.norm(mirrored, axis=-1)
            total += of_x * of_y * np.maximum(along, 0.0) ** self.PAINT.exponent
        return np.asarray(total[..., None] * SUN.color)

    def test_the_error_of_sub_apertures_falls_as_one_over_their_number(self) -> None:
        """The error falls as 1/N, up to a logarithm; with random points it would fall as N^-1/2."""
        exact, reference = self.integral(), Reference(self.scene())
        counts = [8, 32, 128, 512]
        errors = []
        for count in counts:
            image = reference.trace(self.COARSE.middle, Sampling(aperture=count)).color
            errors.append(float(np.sqrt(np.mean((image - exact) ** 2))))
        slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
        assert -1.4 < slope < -0.85
        assert errors[-1] < 2e-3 * np.abs(exact).max()

    @pytest.mark.slow
    def test_convergence_reaches_its_stated_error(self) -> None:
        """For a picture as smooth as this one, the error of scrambled points falls as N^-1.5."""
        exact, reference = self.integral(), Reference(self.scene())
        result = [reference.converged(self.COARSE.middle, tolerance) for tolerance in (1e-3, 3e-5)]
        errors = [float(np.sqrt(np.mean((item.color - exact) ** 2))) for item in result]
        for item, error, tolerance in zip(result, errors, (1e-3, 3e-5), strict=True):
            assert item.error <= tolerance
            # The error is estimated from 8 samples, partly shared by pixels: Student's t with 7
            # degrees of freedom, at a level of 1e-4.
            assert error <= 7.1 * item.error
        order = np.log(errors[1] / errors[0]) / np.log(result[1].points / result[0].points)
        assert order < -1.1
