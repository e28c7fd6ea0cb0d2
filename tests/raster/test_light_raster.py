"""Light of the rasterizer, compared with its definition: every flip, term and pass."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.light import (
    device_at_hand,
    dressed_scene,
    moved_by_snapping,
    radiance_by_definition,
    unit,
)
from tests.support.lit import ball, lit, sky, sky_radiance
from tests.support.long_tail import thinned
from tests.support.views import at, lines_by_definition, reversed_d32f
from xfrustum.raster import Rasterizer
from xfrustum.raster.device import mesh
from xfrustum.reference import Reference
from xfrustum.scenes import (
    DepthMapping,
    DoubleFrustum,
    Frustum,
    HogelImage,
    Plate,
    Scene,
)
from xfrustum.scenes.appearance import Material
from xfrustum.scenes.arrays import Floats, Singles
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, needed

RESOLUTION = (160, 120)

#: Largest error of any pixel: a step of a display with 8 bits
ONE_CODE = 1 / 255

#: Largest error of nearly all pixels: attributes are float32 plane equations over up to 160 pixels,
#: with an error of about 160 * 2^-23 of their range; textures and highlights change up to eight
#: times as fast as attributes
INTERPOLATED = 8 * 160 * 2.0**-23

DRESSED = ("asymmetric", "asymmetric-recentered", "car", "crossing", "large-triangles")


def drawn(
    scene: Scene, settings: DoubleFrustum, effects: frozenset[Effect] | None = None, **how: Any
) -> HogelImage:
    with Rasterizer(scene, effects) as raster:
        return raster.render(scene.default_apertures()[-1], settings, **how)


def beyond_snapping(scene: Scene, image: HogelImage) -> Floats:
    """Return the error of radiance (H, W, 3) beyond effects of vertex snapping."""
    off = np.abs(image.color - radiance_by_definition(scene, image))
    return np.maximum(off - moved_by_snapping(scene, image, device_at_hand()), 0.0)


@pytest.mark.parametrize(
    ("name", "settings"),
    thinned(
        [
            *zip(DRESSED, map(reversed_d32f, (2.0, 1e-4, 2.0, 1e-4, 2.0)), strict=True),
            ("asymmetric", DoubleFrustum(near=1.0, mapping=DepthMapping.LOGARITHMIC)),
            ("asymmetric", DoubleFrustum(near=1.0, mapping=DepthMapping.GL)),
        ],
        3,
    ),
)
def test_radiance_is_that_of_the_definition_on_both_sides(
    name: str, settings: DoubleFrustum
) -> None:
    """The scene has smooth, flat, colored and textured parts, three lights and an environment."""
    scene = dressed_scene(name, RESOLUTION)
    image = drawn(scene, settings)
    error = beyond_snapping(scene, image).max(axis=-1)
    for side in (image.height > 0, image.height < 0):
        assert side.sum() > 50
        assert error[side].max() < ONE_CODE
        assert np.quantile(error[side], 0.999) < INTERPOLATED
    assert (error[~image.covered] == 0).all()
    assert image.color.max() > 1


@pytest.mark.parametrize("name", thinned(DRESSED, 2))
def test_traced_radiance_is_that_of_the_definition_too(name: str) -> None:
    scene = dressed_scene(name, RESOLUTION)
    truth = Reference(scene).trace(scene.default_apertures()[-1])
    expected = radiance_by_definition(scene, truth)
    np.testing.assert_allclose(truth.color, expected, rtol=2.0**-22, atol=1e-9)


#: Flips of C*: the shaders' code with each flip, and without it
FLIPS = {
    "N*": ("return gl_FrontFacing ? normal", "return gl_FrontFacing == (conjugate > 0.0) ? normal"),
    "C*": ("return -unit(away)", "return -conjugate * unit(away)"),
    "L*": ("conjugate * lights[i].toward", "lights[i].toward"),
    "R*": ("vec3 R = conjugate *", "vec3 R ="),
}


class TestFlips:
    """Each of the paper's three flips is needed; together they give the viewer's own light."""

    scene = dressed_scene("asymmetric", RESOLUTION)
    settings = reversed_d32f(1e-3)

    def drawn_without(self, monkeypatch: pytest.MonkeyPatch, *flips: str) -> Singles:
        original = mesh.shader
        result: set[str] = set()

        def undone(name: str) -> str:
            text = original(name)
            for flip in flips:
                right, wrong = FLIPS[flip]
                result.update({flip} if right in text or wrong in text else ())
                text = text.replace(right, wrong)
            return text

        monkeypatch.setattr(mesh, "shader", undone)
        image = drawn(self.scene, self.settings)
        assert result == set(flips)
        return image.color

    @pytest.mark.parametrize("flip", FLIPS)
    def test_with_one_undone_the_side_of_c_star_is_wrong(
        self, flip: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        right = drawn(self.scene, self.settings)
        wrong = self.drawn_without(monkeypatch, flip)
        front, behind = right.height > 0, right.height < 0
        difference = np.abs(wrong - right.color).max(axis=-1)
        assert (difference[front] > 5 * ONE_CODE).mean() > 0.1
        assert (difference[behind] == 0).all()

    def test_without_all_flips_the_light_is_computed_for_the_viewer(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """N, E and L with the true eye give mathematically the same light (paper, section 3)."""
        right = drawn(self.scene, self.settings).color
        same = self.drawn_without(monkeypatch, *FLIPS)
        np.testing.assert_allclose(
            same, right, atol=1e-6
        )  # changes of sign are exact, so that dot products keep their bits


def test_a_mirror_sphere_shows_the_environment_on_both_sides_of_the_plate() -> None:
    """Pictures agree with the closed form for a true sphere, computed without mesh and map."""
    # Edges of an icosphere after five subdivisions are up to 0.041 long on the unit sphere.
    edge, rows, radius, steepest = 0.041, 128, 12.0, 3.0
    centers = ((-9.0, 6.0, -42.0), (9.0, 7.0, 38.0))
    mirror = Material(ambient=(0, 0, 0), diffuse=(0, 0, 0), reflectivity=(1.0, 0.5, 0.25))
    frustum = Frustum(
        resolution=(140, 110), reach=(60.0, 60.0), fov=(math.radians(70), math.radians(60))
    )
    scene = lit(
        *(ball(center, radius, "mirror", 5) for center in centers),
        frustum=frustum,
        lights=(),
        environment=sky(2 * rows, rows),
        mirror=mirror,
    )
    scene = replace(scene, plate=Plate(size=(2.0, 2.0), hogels=(1, 1)))
    assert needed(scene) == {Effect.C, Effect.C_STAR, Effect.SMOOTH_NORMALS, Effect.REFLECTION}
    image = drawn(scene, reversed_d32f(1e-6))
    d = unit(lines_by_definition(scene, at(0.0, 0.0)))
    # A normal interpolated on a facet is off by the facet's sagitta, angle^2 / 8, times the slope
    # to the line of sight; a reflection is off by twice that. A sampled map is off by step^2 / 8
    # times its curvature.
    tolerance = 1.5 * (2 * edge**2 / 8 * steepest) + 2 * (np.pi / rows) ** 2 / 8
    assert tolerance < 3 * ONE_CODE
    for center, side in zip(centers, (image.height < 0, image.height > 0), strict=True):
        middle = d @ center
        under = middle**2 - (np.dot(center, center) - radius**2)
        met = (middle - np.sqrt(np.maximum(under, 0)))[
            ..., None
        ] * d  # first hit, from the viewer's end
        normal = unit(met - center)
        facing = -np.einsum("...i,...i->...", normal, d)
        judged = side & (under > 0) & (facing > 1 / math.hypot(1, steepest))
        assert judged.sum() > 500
        reflection = d + 2 * facing[..., None] * normal
        expected = 0.75 * sky_radiance(reflection) * mirror.reflectivity  # strength of the sky
        error = np.abs(image.color - expected)[judged].max(axis=-1)
        assert error.max() < tolerance
        assert np.median(error) < ONE_CODE / 4


@pytest.mark.parametrize("effect", thinned(Effect, 4, 1))
def test_leaving_out_a_needed_effect_changes_the_picture(effect: Effect) -> None:
    scene = dressed_scene("asymmetric", RESOLUTION)
    assert needed(scene) == ALL_EFFECTS
    whole = drawn(scene, reversed_d32f(0.5))
    without = drawn(scene, reversed_d32f(0.5), ALL_EFFECTS - {effect})
    difference = np.abs(without.color - whole.color).max(axis=-1)
    assert (difference[whole.covered] > ONE_CODE).mean() > 0.05
    geometry = effect in (Effect.C, Effect.C_STAR)
    assert np.array_equal(whole.triangle, without.triangle) is not geometry
    if not geometry:
        item, other = (
            Reference(scene, effects=e).trace(scene.plate.middle)
            for e in (None, ALL_EFFECTS - {effect})
        )
        assert not np.array_equal(item.color, other.color)
