"""Light paths of Mitsuba, compared with double-precision light and closed forms."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from tests.support.lit import (
    CENTERED,
    PLATE,
    RECENTERED,
    ball,
    card,
    eyes,
    lit,
    quad,
    sky,
)
from xfrustum.reference import Reference
from xfrustum.reference.llvm import mitsuba_backend
from xfrustum.reference.transport import PathTracer, RadianceEstimate
from xfrustum.scenes import Aperture, InputError, Scene, SceneObject
from xfrustum.scenes.appearance import DirectionalLight, Material, Sampling, Transport
from xfrustum.scenes.arrays import Floats

APERTURE = PLATE.aperture(3, 12)
SMALL = replace(RECENTERED, resolution=(32, 24))

PAINT = Material(
    ambient=(0.02, 0.05, 0.03),
    diffuse=(0.7, 0.4, 0.2),
    specular=(0.3, 0.5, 0.6),
    exponent=12.5,
    reflectivity=(0.3, 0.2, 0.4),
)

#: Chance that the test of a right picture fails; seeds are fixed
FALSE_ALARM = 1e-4

#: Smallest number of paths that reach a lamp: with fewer, mean and variance are far from normal
SEEN_OFTEN = 100

#: Relative rounding of the reference's colors to float32; all else is double precision
COLOR_ROUNDING = 3 * 2.0**-24


def everything() -> tuple[SceneObject, ...]:
    """Return smooth, flat, textured and colored surfaces on both sides; some are hidden."""
    uv = np.array([(0.0, 0.1), (3.3, 0.0), (3.0, 2.2), (0.0, 2.0)])
    picture = np.random.default_rng(8).integers(0, 256, (5, 7, 4), dtype=np.uint8)
    floor = replace(
        quad(
            [(-40, -35, -70), (38, -30, -90), (43, 40, -82.75), (-35, 35, -62.75)], "paint", uv=uv
        ),
        textures=(picture,),
        texture_of_triangle=np.array([0, -1], dtype=np.int32),
    )
    behind = ball((5.0, 2.0, -45.0), 14.0, "paint", 3)
    before = ball((-4.0, 1.0, 30.0), 5.0, "paint", 2, smooth=False)
    colored = replace(behind, vertex_colors=np.abs(behind.vertices) / 60)
    return floor, colored, before


def farthest(estimate: RadianceEstimate, expected: Floats) -> float:
    """Return the p-value of the worst pixel and channel, with Bonferroni's correction.

    Student's t uses the spread of the samples. Everywhere, mean and expectation may differ by the
    rounding of colors in addition; where samples do not vary, only by this rounding.
    """
    difference = np.maximum(
        np.abs(estimate.mean - expected) - COLOR_ROUNDING * np.abs(expected), 0.0
    )
    error = np.sqrt(estimate.variance_of_mean)
    assert not difference[error == 0].any()
    chance = 2 * stats.t.sf(difference[error > 0] / error[error > 0], estimate.samples - 1)
    return float(chance.min(initial=1.0) * max(chance.size, 1))


def paths(scene: Scene, aperture: Aperture = APERTURE, **transport: Any) -> RadianceEstimate:
    return PathTracer(scene).render(aperture, Transport(**transport), seed=3)


def assert_mean(estimate: RadianceEstimate, expected: Floats) -> None:
    """Assert that the mean of all pixels is right within four deviations, and certain to 1 %."""
    axes = (0, 1)
    error = np.sqrt(estimate.variance_of_mean.sum(axis=axes)) / expected[..., 0].size
    assert np.all(np.abs((estimate.mean - expected).mean(axis=axes)) < 4 * error)
    assert np.all(error < 0.01 * expected.mean(axis=axes))


class TestDirectLight:
    """Without shadows and interreflection, both references compute the same light."""

    def test_at_pixel_centers_it_is_the_same_to_the_rounding_of_colors(self) -> None:
        scene = lit(*everything(), frustum=SMALL, environment=sky(), paint=PAINT)
        truth = Reference(scene).trace(APERTURE)
        estimate = paths(scene, samples=2)
        assert np.count_nonzero(truth.covered) > 300
        assert not estimate.variance_of_mean.any()
        same = ~truth.overruled
        np.testing.assert_allclose(
            estimate.mean[same],
            truth.color[same].astype(np.float64),
            rtol=COLOR_ROUNDING,
            atol=1e-12,
        )

    def test_over_pixel_boxes_it_is_the_same_within_its_noise_and_another_light_is_not(
        self,
    ) -> None:
        sampling = Sampling(supersample=4)
        scene, brighter = (
            lit(*everything(), frustum=SMALL, environment=sky(), sampling=sampling, paint=paint)
            for paint in (PAINT, replace(PAINT, diffuse=(0.73, 0.4, 0.2)))
        )
        estimate = paths(scene, samples=256)
        assert np.count_nonzero(estimate.variance_of_mean > 0) > 1000
        truth, other = (
            Reference(s).trace(APERTURE).color.astype(np.float64) for s in (scene, brighter)
        )
        assert farthest(estimate, truth) > FALSE_ALARM > farthest(estimate, other)

    def test_a_variant_that_traces_one_ray_at_a_time_is_refused(self) -> None:
        mi = mitsuba_backend().mitsuba
        before = mi.variant()
        mi.set_variant("scalar_rgb")
        try:
            with pytest.raises(InputError, match="one ray at a time"):
                paths(lit(*everything(), paint=PAINT), interreflection=True)
        finally:
            mi.set_variant(before)


HIGH = DirectionalLight(direction=(-0.25, 0.15, 1.0), color=(1.0, 0.8, 0.5))


class TestShadows:
    def test_a_card_throws_its_outline_across_the_plate(self) -> None:
        """Points of the floor are dark if the line to the light meets the card."""
        screen = card((3.0, -2.0, 12.0), (9.0, 6.0), "matt")
        floor = card((0.0, 0.0, -40.0), (200.0, 200.0), "matt")
        matt = Material(ambient=(0.1, 0.1, 0.1), diffuse=(0.8, 0.6, 0.4))
        frustum = replace(CENTERED, resolution=(96, 72))
        scene = lit(floor, screen, frustum=frustum, lights=(HIGH,), matt=matt)
        image = Reference(scene).trace(PLATE.middle)
        direct, shadowed = (
            paths(scene, PLATE.middle, shadows=shadows, samples=2).mean for shadows in (False, True)
        )
        shows_floor = image.object == 0
        point = image.position[shows_floor]
        light = np.array(HIGH.direction)
        arrives = point + (12.0 - point[:, 2:]) / light[2] * light
        low, high = screen.vertices.min(axis=0)[:2], screen.vertices.max(axis=0)[:2]
        # Distance by which the line passes inside the card's outline; negative outside
        inside = np.minimum(arrives[:, :2] - low, high - arrives[:, :2]).min(axis=1)
        # `arrives` is rounded some ten times.
        rounding = 16 * 2.0**-53 * np.abs(scene.vertices).max()
        dark, lit_up = inside > rounding, inside < -rounding
        assert np.count_nonzero(dark) > 50
        assert np.count_nonzero(lit_up) > 500
        assert (dark | lit_up).all()
        np.testing.assert_allclose(shadowed[shows_floor][dark], 0.1, rtol=1e-12)
        # Mitsuba computes the direct light.
        lit_floor = shadowed[shows_floor][lit_up], direct[shows_floor][lit_up]
        np.testing.assert_allclose(*lit_floor, rtol=1e-12)
        np.testing.assert_allclose(shadowed[~shows_floor], direct[~shows_floor], rtol=1e-12)

    @pytest.mark.parametrize(
        ("center", "smooth"),
        [((-3.0, 5.0, -55.0), True), ((9.0, 0.0, 45.0), False), ((0.0, 0.0, -1000.0), True)],
    )
    def test_a_convex_surface_casts_no_shadow_on_itself(
        self, center: tuple[float, float, float], smooth: bool
    ) -> None:
        """A convex surface that faces the light is lit all over, however coarse its facets."""
        part = ball(center, 0.3 * abs(center[2]), "paint", 4, smooth=smooth)
        frustum = replace(CENTERED, resolution=(64, 48), reach=(100.0, 2000.0))
        scene = lit(part, frustum=frustum, paint=PAINT)
        plain, shadowed = (paths(scene, shadows=s, samples=2).mean for s in (False, True))
        assert np.count_nonzero(plain) > 500
        # Mitsuba computes this light in doubles too, with other roundings.
        np.testing.assert_allclose(shadowed, plain, rtol=1e-12)


LAMP_COLOR = (3.0, 2.0, 1.0)


class TestInterreflection:
    def test_a_furnace_glows_as_the_sum_of_all_its_bounces(self) -> None:
        """Walls of a closed box that emit e and scatter a share d have radiance e / (1 - d)."""
        wall = Material(ambient=(0.2, 0.3, 0.1), diffuse=(0.5, 0.2, 0.8))
        corners = np.array(
            [(x, y, z) for x in (-30, 34) for y in (-25, 27) for z in (-50, 20)], dtype=float
        )
        sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        box = [quad(corners[list(side)], "wall") for side in sides]
        # The reach cuts the box open, so that lines enter it.
        frustum = replace(CENTERED, resolution=(16, 12), reach=(10.0, 60.0))
        scene = lit(*box, frustum=frustum, lights=(), wall=wall)
        estimate = paths(scene, interreflection=True, samples=512)
        glow = np.array(wall.ambient) / (1 - np.array(wall.diffuse))
        expected = np.broadcast_to(glow, (12, 16, 3))
        assert farthest(estimate, expected) > FALSE_ALARM
        assert_mean(estimate, expected)

    #: A glowing triangle beyond the reach: not visible, but a light source and visible in mirrors
    TRIANGLE = np.array([(-24.0, -18.0, 30.0), (50.0, -8.0, 38.0), (6.0, 40.0, 34.0)])

    def under_the_triangle(self, floor: Material) -> Scene:
        lamp = SceneObject(
            name="lamp", vertices=self.TRIANGLE, faces=np.array([(0, 1, 2)]), material="glow"
        )
        glow = Material(ambient=LAMP_COLOR, diffuse=(0.0,) * 3)
        frustum = replace(CENTERED, resolution=(24, 18), reach=(25.0, 120.0))
        part = card((0.0, 0.0, -40.0), (100.0, 90.0), "floor")
        return lit(
            part, lamp, frustum=frustum, lights=(), environment=sky(), floor=floor, glow=glow
        )

    def share(self, points: NDArray[np.floating]) -> Floats:
        """Return the triangle's cosine-weighted share of the hemisphere (Lambert, 1760).

        Sum over the triangle's edges: 1 / (2 pi) times the angle under which the edge is seen,
        times the cosine between the normal and the normal of the plane through edge and point.
        """
        seen = self.TRIANGLE - points[..., None, :]
        seen = seen / np.linalg.norm(seen, axis=-1, keepdims=True)
        share = np.zeros(points.shape[:-1])
        for k in range(3):
            a, b = seen[..., k, :], seen[..., (k + 1) % 3, :]
            across = np.cross(a, b)
            sine = np.linalg.norm(across, axis=-1)
            share += (
                np.arctan2(sine, np.sum(a * b, axis=-1)) * across[..., 2] / sine / (2 * math.pi)
            )
        return np.abs(share)

    def inside(self, points: NDArray[np.floating], directions: Floats) -> Floats:
        """Return the smallest barycentric coordinate of lines; negative outside the triangle."""
        edges = np.broadcast_arrays(*(self.TRIANGLE[1:] - self.TRIANGLE[0]), -directions)
        offset = points - self.TRIANGLE[0]
        solved = np.linalg.solve(np.stack(edges, axis=-1), offset[..., None])[..., 0]
        b, c = solved[..., 0], solved[..., 1]
        return np.asarray(np.minimum(np.minimum(b, c), 1 - b - c))

    def test_diffuse_light_of_a_triangle_is_lamberts(self) -> None:
        floor = Material(ambient=(0.0,) * 3, diffuse=(0.9, 0.5, 0.7))
        scene = self.under_the_triangle(floor)
        image = Reference(scene).trace(APERTURE)
        assert image.covered.all()
        share = self.share(image.position)
        expected = share[..., None] * np.array(floor.diffuse) * LAMP_COLOR
        estimate = paths(scene, interreflection=True, samples=4096)
        often = share * estimate.samples > SEEN_OFTEN
        some = replace(
            estimate, mean=estimate.mean[often], variance_of_mean=estimate.variance_of_mean[often]
        )
        assert farthest(some, expected[often]) > FALSE_ALARM
        assert_mean(estimate, expected)

    def test_a_mirror_shows_the_mirrored_direction(self) -> None:
        """The mirror shows the lamp or the environment along mirrored lines, without noise."""
        mirror = Material(ambient=(0.0,) * 3, diffuse=(0.0,) * 3, reflectivity=(0.9, 0.5, 0.7))
        scene = self.under_the_triangle(mirror)
        image = Reference(scene).trace(APERTURE)
        inside = self.inside(image.position, eyes(scene, APERTURE) * (-1.0, -1.0, 1.0))
        clear = np.abs(inside) > 1e-4
        lamp = np.array(mirror.reflectivity) * LAMP_COLOR
        shown = np.where((inside > 0)[..., None], lamp, image.color)
        estimate = paths(scene, interreflection=True, samples=4)
        assert np.count_nonzero(inside > 0) > 10
        assert np.count_nonzero(clear) > 0.99 * clear.size
        np.testing.assert_allclose(estimate.mean[clear], shown[clear], rtol=COLOR_ROUNDING)
