"""Colors of surfaces in the reference: textures, vertex colors; and changes that must not change a bit."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from tests.support.lit import CENTERED, GLOW, LAMP, PLATE, ROUNDING, SUN, ball, card, lit, quad, sky
from tests.support.views import view
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import model_cameras
from xfrustum.scenes import DoubleFrustum, Scene, SceneObject
from xfrustum.scenes.appearance.appearance import DirectionalLight, Environment, Material
from xfrustum.scenes.arrays import Bytes, Floats, Singles
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, needed

WIDTH, HEIGHT = CENTERED.resolution
MIDDLE = PLATE.middle
UV_ROUNDING = 1e-9
"""Positions are good to 1e-12 of the reach, and no picture here has more than 1e3 texels across it."""


def filling(z: float) -> Floats:
    """Return the corners of the rectangle at a height that fills the film, from the viewer's lower left."""
    x, y = (abs(z) * np.tan(angle / 2) for angle in CENTERED.fov)
    ax, ay = MIDDLE.x, MIDDLE.y
    return np.array([(ax - x, ay - y, z), (ax + x, ay - y, z), (ax + x, ay + y, z), (ax - x, ay + y, z)])


def picture(height: int, width: int, seed: int = 5) -> Bytes:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 4), dtype=np.uint8)


def decoded(texture: Bytes) -> Floats:
    """Return linear RGB of sRGB by the standard's formula."""
    value = texture[..., :3] / 255
    return np.asarray(np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4))


def textured(corners: Floats, uv: Floats, *textures: Bytes, numbers: tuple[int, int] = (0, 0)) -> SceneObject:
    part = quad(corners, "glow", uv=uv)
    return replace(part, textures=textures, texture_of_triangle=np.array(numbers, dtype=np.int32))


def color_of(scene: Scene) -> Singles:
    return Reference(scene).trace(MIDDLE).color


UNIT = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


class TestTextures:
    def test_behind_the_plate_a_filling_picture_is_the_image(self) -> None:
        """Every pixel's center falls on the center of a texel: row 0 at the top, v up, alpha ignored."""
        texture = picture(HEIGHT, WIDTH)
        color = color_of(lit(textured(filling(-50.0), UNIT, texture), glow=GLOW))
        np.testing.assert_allclose(color, decoded(texture), rtol=ROUNDING, atol=UV_ROUNDING)

    def test_before_the_plate_it_is_upside_down_and_mirrored(self) -> None:
        texture = picture(HEIGHT, WIDTH)
        color = color_of(lit(textured(filling(50.0), UNIT, texture), glow=GLOW))
        np.testing.assert_allclose(color, decoded(texture)[::-1, ::-1], rtol=ROUNDING, atol=UV_ROUNDING)

    def test_between_texels_the_decoded_light_is_mixed_and_edges_repeat(self) -> None:
        """Another implementation, a spline of order one on a periodic grid, gives the same colors."""
        texture = picture(7, 5)
        uv = UNIT * (2.3, -1.7) + (0.37, 12.4)
        color = color_of(lit(textured(filling(-50.0), uv, texture), glow=GLOW))
        across, down = (np.arange(WIDTH) + 0.5) / WIDTH, 1 - (np.arange(HEIGHT) + 0.5) / HEIGHT
        u, v = np.meshgrid(across * 2.3 + 0.37, down * -1.7 + 12.4)
        where = [(1 - v) * 7 - 0.5, u * 5 - 0.5]
        for channel in range(3):
            expected = ndimage.map_coordinates(
                decoded(texture)[..., channel], where, order=1, mode="grid-wrap"
            )
            np.testing.assert_allclose(color[..., channel], expected, rtol=ROUNDING, atol=UV_ROUNDING)

    def test_mixing_encoded_values_would_be_seen(self) -> None:
        black_and_white = np.array([[(0, 0, 0, 255), (255, 255, 255, 255)]], dtype=np.uint8)
        color = color_of(lit(textured(filling(-50.0), UNIT * 0 + 0.5, black_and_white), glow=GLOW))
        np.testing.assert_allclose(color, 0.5, rtol=ROUNDING)

    def test_triangles_have_pictures_of_their_own_or_none(self) -> None:
        white = np.full((1, 1, 4), 255, dtype=np.uint8)
        gray = np.full((3, 2, 4), 99, dtype=np.uint8)
        first = textured(filling(-50.0), UNIT, white, gray, numbers=(1, -1))
        second = textured(filling(-60.0), UNIT, gray, numbers=(0, 0))
        scene = lit(first, second, glow=GLOW)
        image = Reference(scene).trace(MIDDLE)
        np.testing.assert_allclose(image.color[image.triangle == 0], decoded(gray)[0, 0, 0], rtol=ROUNDING)
        np.testing.assert_allclose(image.color[image.triangle == 1], 1.0, rtol=ROUNDING)
        behind = color_of(lit(second, glow=GLOW))
        np.testing.assert_allclose(behind, decoded(gray)[0, 0, 0], rtol=ROUNDING)


def test_vertex_colors_are_linear_in_space() -> None:
    """A vertex color that is linear in space is the same linear function of each visible point."""
    corners = np.array([(-40, -25, -35), (38, -20, -80), (43, 30, -75), (-35, 25, -30)], dtype=float)
    corners[3] = corners[0] + corners[2] - corners[1]
    linear = np.array([(0.004, 0.001, 0.0), (0.0, 0.006, -0.002), (-0.003, 0.0, 0.002)])
    part = quad(corners, "paint", vertex_colors=0.6 + corners @ linear)
    scene = lit(part, paint=Material(ambient=(1.0, 0.5, 0.25), diffuse=(0.0,) * 3))
    image = Reference(scene).trace(MIDDLE)
    covered = image.covered
    assert np.count_nonzero(covered) > 500
    expected = (0.6 + image.position[covered] @ linear) * (1.0, 0.5, 0.25)
    np.testing.assert_allclose(image.color[covered], expected, rtol=ROUNDING, atol=1e-12)


def test_a_triangle_whose_corner_has_no_normal_is_flat() -> None:
    part = card((0, 0, -50), (200, 200), "paint")
    normals = np.array([(0.6, 0.0, 0.8), (np.nan,) * 3, (-0.6, 0.0, 0.8), (0.0, 0.6, 0.8)])
    paint = Material(specular=(0.5, 0.5, 0.5))
    image = Reference(lit(replace(part, vertex_normals=normals), paint=paint)).trace(MIDDLE)
    flat = Reference(lit(part, paint=paint)).trace(MIDDLE)
    np.testing.assert_array_equal(image.color[image.triangle == 0], flat.color[flat.triangle == 0])
    assert (image.color != flat.color)[image.triangle == 1].any(axis=-1).all()


class TestEffects:
    """Only effects that a scene calls for are evaluated, and these are all that show."""

    @pytest.mark.parametrize("name", ["car", "asymmetric-recentered", "crossing", "truck", "beetle"])
    def test_all_effects_give_the_same_bits_as_the_needed_ones(self, name: str) -> None:
        scene = view(name, (48, 36))
        assert_same_bits(scene)

    coefficient = st.sampled_from([(0.0, 0.0, 0.0), (0.5, 0.5, 0.5), (0.2, 0.4, 0.7)])

    @given(
        st.builds(
            Material,
            ambient=coefficient,
            diffuse=coefficient,
            specular=coefficient,
            reflectivity=coefficient,
            exponent=st.sampled_from([0.5, 7.0, 200.0]),
        ),
        st.sampled_from([(), (SUN,), (SUN, LAMP), (replace(SUN, color=(0.0, 0.0, 0.0)),)]),
        st.sampled_from([None, sky(), replace(sky(), strength=0.0)]),
        st.sampled_from(["flat", "smooth", "white vertices", "no normals", "colors"]),
    )
    @settings(max_examples=60, deadline=None)
    def test_whatever_is_in_the_scene(
        self,
        material: Material,
        lights: tuple[DirectionalLight, ...],
        environment: Environment | None,
        kind: str,
    ) -> None:
        part = ball((2.0, 1.0, -45.0), 14.0, "paint", subdivisions=1, smooth=kind == "smooth")
        ones = np.ones_like(part.vertices)
        colors = {"white vertices": ones, "colors": np.abs(part.vertices) / 60}
        part = replace(part, vertex_colors=colors.get(kind))
        if kind == "no normals":
            part = replace(part, vertex_normals=ones * np.nan)
        frustum = replace(CENTERED, resolution=(16, 12))
        gray = card((5.0, 3.0, 40.0), (6.0, 8.0))
        assert_same_bits(
            lit(part, gray, frustum=frustum, lights=lights, environment=environment, paint=material)
        )

    def test_leaving_out_what_shows_changes_the_picture(self) -> None:
        part = ball((2.0, 1.0, -45.0), 14.0, "paint", subdivisions=1)
        part = replace(
            part,
            vertex_colors=np.abs(part.vertices) / 60,
            uv=part.vertices[:, :2] / 7,
            textures=(picture(3, 4),),
            texture_of_triangle=np.zeros(len(part.faces), dtype=np.int32),
        )
        paint = Material(specular=(0.3, 0.3, 0.3), reflectivity=(0.4, 0.4, 0.4))
        scene = lit(part, environment=sky(), paint=paint)
        used = needed(scene)
        whole = Reference(scene).trace(MIDDLE).color
        for effect in used - {Effect.C, Effect.C_STAR}:
            without = Reference(scene, effects=used - {effect}).trace(MIDDLE).color
            assert not np.array_equal(whole, without), effect


def assert_same_bits(scene: Scene) -> None:
    auto, everything = (Reference(scene, effects=e).trace(scene.plate.middle) for e in (None, ALL_EFFECTS))
    np.testing.assert_array_equal(auto.color, everything.color)
    assert auto.color.dtype == np.float32


class TestModel:
    """The traced model has the colors that offset cameras would draw without rounding."""

    def test_flat_surfaces_keep_their_color_where_cameras_step_back(self) -> None:
        """Pivot aperture, fit angle: a pixel's drawn line is parallel to its true one."""
        scene = view("asymmetric-recentered", (96, 72))
        aperture = scene.plate.corners[0]
        reference = Reference(scene, effects=ALL_EFFECTS - {Effect.SMOOTH_NORMALS})
        truth, model = reference.trace(aperture), reference.trace_model(aperture, DoubleFrustum(near=1.0))
        same = (model.triangle == truth.triangle) & truth.covered
        assert 100 < np.count_nonzero(same) < np.count_nonzero(truth.covered)
        np.testing.assert_array_equal(model.color[same], truth.color[same])

    def test_cameras_fitted_to_a_height_see_along_lines_of_their_own(self) -> None:
        scene = lit(card((0, 0, -50), (200, 200), "paint"), paint=Material(specular=(0.5,) * 3))
        fitted = DoubleFrustum(near=5.0, fit=20.0)
        (camera, *_) = model_cameras(scene.frustum, MIDDLE, fitted)
        scene_along = replace(
            scene, frustum=replace(scene.frustum, fov=tuple(2 * np.arctan(camera.pencil.half_extent)))
        )
        truth = Reference(scene_along).trace(MIDDLE).color
        model = Reference(scene).trace_model(MIDDLE, fitted).color
        np.testing.assert_allclose(model, truth, rtol=ROUNDING)
