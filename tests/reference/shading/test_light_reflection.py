"""Mirrors in the reference show the closed forms of their reflections."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.support.lit import CENTERED, PLATE, ROUNDING, ball, eyes, lit, quad, sky, sky_radiance
from xfrustum.reference import Reference
from xfrustum.scenes import Scene
from xfrustum.scenes.appearance.appearance import Environment, Material
from xfrustum.scenes.arrays import Floats

APERTURE = PLATE.aperture(3, 12)
MIRROR = Material(ambient=(0.0,) * 3, diffuse=(0.0,) * 3, reflectivity=(0.9, 0.6, 0.4))


class TestSphere:
    """A mirror-like sphere under an environment, against its closed form, before and behind the plate.

    With the true sphere's normals at the vertices, the normal at a point Q of a facet is the sum of
    w_i (V_i - C) / r made a unit vector, which is Q - C made one: exactly radial. So R is known in closed
    form. The map of `sky` is a linear function f of the direction: between texels in latitude by dy and in
    longitude by dx, bilinear interpolation is off by at most (dx^2 + dy^2) / 8 times the largest second
    derivative, which is the length of f's gradient; beyond the last row's centers, by dy / 2 times it.
    """

    SLOPE = 0.75 * np.linalg.norm([(0.5, 0.1, 0.0), (0.2, 0.5, -0.2), (-0.1, 0.2, 0.6)], axis=0)
    REFLECTIVITY = np.array(MIRROR.reflectivity)

    @staticmethod
    def seen(center: tuple[float, float, float], subdivisions: int) -> tuple[Scene, Floats, Floats, Floats]:
        """Scene, hit points relative to the sphere's center, eye vectors and colors (N, 3)."""
        part = ball(center, 12.0, "mirror", subdivisions)
        scene = lit(part, lights=(), environment=sky(), mirror=MIRROR)
        image = Reference(scene).trace(APERTURE)
        covered = image.covered
        assert np.count_nonzero(covered) > 100
        return (
            scene,
            np.asarray(image.position[covered] - center, dtype=np.float64),
            eyes(scene, APERTURE)[covered],
            image.color[covered].astype(np.float64),
        )

    def closed_form(self, normal: Floats, eye: Floats) -> Floats:
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        mirrored = 2 * np.sum(normal * eye, axis=1, keepdims=True) * normal - eye
        return np.asarray(0.75 * self.REFLECTIVITY * sky_radiance(mirrored))

    def map_error(self, normal: Floats, eye: Floats) -> Floats:
        """Return the bound on bilinear interpolation, larger within the half row around each pole."""
        step = math.pi / 32
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        height = (2 * np.sum(normal * eye, axis=1, keepdims=True) * normal - eye)[:, 1]
        inner = np.abs(height) < math.cos(step / 2)
        error = np.where(inner, 2 * step**2 / 8, step)
        return np.asarray(self.REFLECTIVITY * self.SLOPE * error[:, None])

    @pytest.mark.parametrize("center", [(-3.0, 5.0, -55.0), (9.0, 0.0, 45.0)], ids=["behind", "before"])
    def test_the_mirrored_direction_is_that_of_the_radial_normal(
        self, center: tuple[float, float, float]
    ) -> None:
        _, point, eye, color = self.seen(center, subdivisions=3)
        assert np.all(np.abs(color - self.closed_form(point, eye)) <= self.map_error(point, eye) + ROUNDING)

    def test_it_is_the_true_spheres_within_the_tessellation(self) -> None:
        """A facet of longest edge e has its circle within e / sqrt(3), and lies so much below its sphere.

        Seen along a line at an angle t to the normal, the point moves aside by tan t times that, by less than
        1 / cos^2 t times it to the second order too; and R turns twice as far as the normal.
        """
        for subdivisions in (2, 3, 4):
            scene, point, eye, color = self.seen((-3.0, 5.0, -55.0), subdivisions)
            edges = scene.triangles - np.roll(scene.triangles, 1, axis=1)
            inside = 12.0 - math.sqrt(144.0 - np.linalg.norm(edges, axis=2).max() ** 2 / 3)
            # The line through the point in closed form: the nearest meeting with the sphere.
            along = np.sum(point * eye, axis=1)
            rest = along**2 - np.sum(point**2, axis=1) + 144.0
            exact = point + (-along + np.sqrt(rest))[:, None] * eye
            cosine = np.sum(exact * eye, axis=1) / 12.0
            clear = cosine > 0.5
            turned = 2 * inside / 12.0 / cosine**2
            bound = self.map_error(exact, eye) + self.REFLECTIVITY * self.SLOPE * turned[:, None]
            assert clear.mean() > 0.5
            error = np.abs(color - self.closed_form(exact, eye))
            assert np.all(error[clear] <= bound[clear])


def test_a_flat_mirror_and_the_corners_of_the_map() -> None:
    """Each direction finds the texel that lies there: -z in the middle, +x to its right, +y on top."""
    height, width = 8, 16
    radiance = np.zeros((height, width, 3), dtype=np.float32)
    radiance[..., 0] = np.arange(width)
    radiance[..., 1] = np.arange(height)[:, None]
    environment = Environment(radiance=radiance)
    for row, column in ((0, 3), (2, 8), (4, 15), (7, 0)):
        longitude, from_top = (column + 0.5) / width * 2 * math.pi - math.pi, (row + 0.5) / height * math.pi
        aim = np.array(
            (
                math.sin(from_top) * math.sin(longitude),
                math.cos(from_top),
                -math.sin(from_top) * math.cos(longitude),
            )
        )
        frustum = replace(CENTERED, resolution=(1, 1))
        normal = aim + np.array((0.0, 0.0, 1.0))
        normal /= np.linalg.norm(normal)
        aside = np.cross(normal, (0.3, 0.5, 0.1))
        up = np.cross(normal, aside)
        corners = [
            (0.0, 0.0, -50.0) + 5 * (x * aside + y * up) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
        scene = lit(
            quad(corners, "mirror"), frustum=frustum, lights=(), environment=environment,
            mirror=replace(MIRROR, reflectivity=(1.0, 1.0, 1.0)),
        )  # fmt: skip
        color = Reference(scene).trace(PLATE.middle).color
        np.testing.assert_allclose(color[0, 0], (column, row, 0.0), atol=1e-5)
