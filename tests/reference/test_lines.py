"""Lines of pixels: the geometry of CONVENTIONS.md and of the paper's sections 3 to 5."""

import itertools

import numpy as np
import pytest

from tests.support.views import at, lines_by_definition, view
from xfrustum.raster.cameras import clip_from_scene, slab_cameras
from xfrustum.reference.lines import RayBundle, crossed_frustum, model_cameras
from xfrustum.scenes import Aperture, DoubleFrustum, Frustum, Screen
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate import Fit, Offset, Pivot

SCREENS = [
    Screen(height=120.0, center=(9.0, -6.0), size=(160.0, 120.0)),
    Screen(height=-60.0, center=(-4.0, 8.0), size=(100.0, 80.0)),
]
SETTINGS = [
    DoubleFrustum(near=3.0),
    DoubleFrustum(near=3.0, pivot=Pivot.CAMERA),
    DoubleFrustum(near=3.0, fit=40.0),
    DoubleFrustum(near=3.0, fit=Fit.ANGLE, slabs=(10.0, 50.0)),
    DoubleFrustum(near=3.0, slabs=(7.0,), pivot=Pivot.CAMERA),
    DoubleFrustum(near=3.0, offset=Offset.NONE, slabs=(20.0,)),
]
APERTURES = [at(0.0, 0.0), at(-39.5, 29.5), at(11.0, -23.0)]


def recentered(screen: Screen, resolution: tuple[int, int] = (64, 48)) -> Frustum:
    return Frustum(resolution=resolution, reach=(150.0, 130.0), screen=screen)


def film_corner(bundle: RayBundle, u: int, v: int, s: float) -> Floats:
    """Return the point at s on the line through the film's outer corner (u, v)."""
    dx, dy = bundle.dx, bundle.dy
    x = dx[-1] + (dx[-1] - dx[-2]) / 2 if u > 0 else dx[0] - (dx[1] - dx[0]) / 2
    y = dy[0] + (dy[0] - dy[1]) / 2 if v > 0 else dy[-1] - (dy[-2] - dy[-1]) / 2
    return np.array(bundle.center) + s * np.array([x, y, -1.0])


@pytest.mark.parametrize("name", ["car", "asymmetric-recentered", "car-recentered"])
def test_every_line_passes_through_the_aperture_with_the_slopes_of_the_design(name: str) -> None:
    scene = view(name, (33, 20))
    aperture = scene.plate.corners[1]
    bundle = crossed_frustum(scene.frustum, aperture)
    assert bundle.center == (aperture.x, aperture.y, 0.0)
    assert bundle.s_range == (-scene.frustum.reach[0], scene.frustum.reach[1])
    expected = lines_by_definition(scene, aperture)
    np.testing.assert_allclose(bundle.directions(), expected, rtol=1e-15, atol=1e-16)
    np.testing.assert_array_equal(bundle.directions(slice(3, 7)), bundle.directions()[3:7])


@pytest.mark.parametrize("aperture", APERTURES)
@pytest.mark.parametrize("screen", SCREENS)
@pytest.mark.parametrize("near", [40.0, 0.5, 1e-6])
def test_the_offset_cameras_near_planes_coincide_at_the_plate(
    screen: Screen, aperture: Aperture, near: float
) -> None:
    """The paper's condition (section 4): C and C* step back until their near planes coincide.

    Recentered, both near planes have the same window about the aperture, mirrored in both axes: the
    lines of C* pass through it in the opposite direction.
    """
    frustum = recentered(screen)
    c, c_star = (
        camera.bundle for camera in model_cameras(frustum, aperture, DoubleFrustum(near=near))
    )
    window = near * np.array(screen.size) / 2 / abs(screen.height)
    for u, v in itertools.product((-1, 1), repeat=2):
        corner = [*(np.array([aperture.x, aperture.y]) + window * [u, v]), 0.0]
        for on_plate in (film_corner(c, u, v, near), film_corner(c_star, -u, -v, -near)):
            np.testing.assert_allclose(on_plate, corner, rtol=0, atol=1e-12)
    assert c.center[2] == near and c_star.center[2] == -near
    viewer, back = frustum.reach
    ends = [film_corner(c, 1, 1, c.s_range[1])[2], film_corner(c_star, 1, 1, c_star.s_range[0])[2]]
    np.testing.assert_allclose(ends, [-back, viewer], rtol=1e-15)
    # The point farthest from C* is the nearest to the viewer: it has the smallest s and comes
    # first.
    assert c_star.s_range[0] < c_star.s_range[1] == -near and c.s_range[0] == near


@pytest.mark.parametrize("frustum", [*map(recentered, SCREENS), view("car", (64, 48)).frustum])
@pytest.mark.parametrize("aperture", APERTURES)
@pytest.mark.parametrize("settings", SETTINGS, ids=str)
def test_reference_and_rasterizer_put_a_point_into_the_same_pixel(
    frustum: Frustum, aperture: Aperture, settings: DoubleFrustum
) -> None:
    """Exact lines of C and C* against OpenGL matrices, derived independently."""
    bundles = [camera.bundle for camera in model_cameras(frustum, aperture, settings)]
    c, c_star = (slab_cameras(frustum, settings, orthoscopic=side) for side in (True, False))
    matrices = [
        clip_from_scene(frustum, aperture, camera, settings.pivot, (0.0, 1.0))
        for camera in (*reversed(c), *c_star)
    ]
    width, height = frustum.resolution
    u = (2 * np.arange(width) + 1) / width - 1
    v = 1 - (2 * np.arange(height) + 1) / height
    film = np.stack(np.meshgrid(u, v), axis=-1)
    for bundle, matrix in zip(bundles, matrices, strict=True):
        nearest, farthest = sorted(map(abs, bundle.s_range))
        for s in np.linspace(*bundle.s_range, 5):
            points = np.array(bundle.center) + s * bundle.directions()
            clip = np.append(points, np.ones((height, width, 1)), axis=2) @ matrix.T
            np.testing.assert_allclose(clip[..., 3], abs(s), rtol=1e-12)
            np.testing.assert_allclose(clip[..., :2] / clip[..., 3:], film, atol=1e-12)
            if abs(s) in (nearest, farthest):
                depth = clip[..., 2] / clip[..., 3]
                np.testing.assert_allclose(depth, float(abs(s) == farthest), atol=1e-11)
