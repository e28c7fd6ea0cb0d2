"""Light as the rasterizer draws it: against its definition, with every flip, term by term, pass by pass."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.light import (
    LIGHTS,
    PLAIN,
    decoded,
    device_at_hand,
    dressed_scene,
    moved_by_snapping,
    patterned_environment,
    radiance_by_definition,
    unit,
)
from tests.support.long_tail import thinned
from tests.support.views import SHARED_SCENES, at, lines_by_definition, reversed_d32f, view
from xfrustum.raster import Rasterizer
from xfrustum.raster.device import programs
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference import Reference
from xfrustum.scenes import (
    Camera,
    DepthMapping,
    DoubleFrustum,
    Frustum,
    HogelImage,
    Plate,
    Scene,
    SceneObject,
)
from xfrustum.scenes.appearance.appearance import Appearance, DirectionalLight, Environment, Material
from xfrustum.scenes.arrays import Bytes, Floats, Singles
from xfrustum.scenes.geometry.shapes import lathe
from xfrustum.scenes.library import builtin, hard_cases
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, needed

RESOLUTION = (160, 120)

ONE_CODE = 1 / 255
"""Largest error of any pixel: a step of a display with 8 bits."""

INTERPOLATED = 8 * 160 * 2.0**-23
"""Largest error of nearly all pixels: attributes are float32 plane equations over up to 160 pixels, evaluated
with an error of about 160 2^-23 of their range; textures and highlights change up to eight times as fast."""

DRESSED = ("asymmetric", "asymmetric-recentered", "car", "crossing", "large-triangles")


def drawn(
    scene: Scene, settings: DoubleFrustum, effects: frozenset[Effect] | None = None, **how: Any
) -> HogelImage:
    with Rasterizer(scene, effects) as raster:
        return raster.render(scene.default_apertures()[-1], settings, **how)


def beyond_snapping(scene: Scene, image: HogelImage, *, reflections: bool = True) -> Floats:
    """Return by how much (H, W, 3) radiance is off beyond what the device's snapping of vertices explains."""
    off = np.abs(color_of(image) - radiance_by_definition(scene, image, reflections=reflections))
    moved = moved_by_snapping(scene, image, device_at_hand(), reflections=reflections)
    return np.maximum(off - moved, 0.0)


def color_of(image: HogelImage) -> Singles:
    return image.color


@pytest.mark.parametrize(
    ("name", "settings"),
    thinned(
        [
            *((name, reversed_d32f(near)) for name in DRESSED for near in (2.0, 1e-4)),
            ("asymmetric", DoubleFrustum(near=1.0, mapping=DepthMapping.LOGARITHMIC)),
            ("asymmetric", DoubleFrustum(near=1.0, mapping=DepthMapping.GL)),
        ],
        3,
    ),
)
def test_radiance_is_that_of_the_definition_on_both_sides(name: str, settings: DoubleFrustum) -> None:
    """A scene smooth and flat, colored and not, textured and not, with three lights and an environment."""
    scene = dressed_scene(name, RESOLUTION)
    image = drawn(scene, settings)
    error = beyond_snapping(scene, image).max(axis=-1)
    for side in (image.height > 0, image.height < 0):
        assert side.sum() > 50
        assert error[side].max() < ONE_CODE
        assert np.quantile(error[side], 0.999) < INTERPOLATED
    assert (error[~image.covered] == 0).all()
    assert color_of(image).max() > 1


@pytest.mark.parametrize("name", thinned(DRESSED, 2))
def test_traced_radiance_is_that_of_the_definition_too(name: str) -> None:
    scene = dressed_scene(name, RESOLUTION)
    truth = Reference(scene).trace(scene.default_apertures()[-1])
    expected = radiance_by_definition(scene, truth)
    np.testing.assert_allclose(color_of(truth), expected, rtol=2.0**-22, atol=1e-9)


FLIPS = {
    "N*": ("return gl_FrontFacing ? normal", "return gl_FrontFacing == (conjugate > 0.0) ? normal"),
    "C*": ("return -unit(away)", "return -conjugate * unit(away)"),
    "L*": ("conjugate * lights[i].toward", "lights[i].toward"),
    "R*": ("vec3 R = conjugate *", "vec3 R ="),
}
"""Each flip of C* as the shaders have it, and as they would without it."""


class TestFlips:
    """Each of the paper's three flips is needed; all together they are the viewer's own light."""

    scene = dressed_scene("asymmetric", RESOLUTION)
    settings = reversed_d32f(1e-3)

    def drawn_without(self, monkeypatch: pytest.MonkeyPatch, *flips: str) -> Singles:
        original = programs.shader
        found: set[str] = set()

        def undone(name: str) -> str:
            text = original(name)
            for flip in flips:
                right, wrong = FLIPS[flip]
                found.update({flip} if right in text or wrong in text else ())
                text = text.replace(right, wrong)
            return text

        monkeypatch.setattr(programs, "shader", undone)
        image = drawn(self.scene, self.settings)
        assert found == set(flips)
        return color_of(image)

    @pytest.mark.parametrize("flip", FLIPS)
    def test_with_one_undone_the_side_of_c_star_is_wrong(
        self, flip: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        right = drawn(self.scene, self.settings)
        wrong = self.drawn_without(monkeypatch, flip)
        front, behind = right.height > 0, right.height < 0
        difference = np.abs(wrong - color_of(right)).max(axis=-1)
        assert (difference[front] > 5 * ONE_CODE).mean() > 0.1
        assert (difference[behind] == 0).all()

    def test_with_all_undone_it_is_the_viewer_s_own_calculation(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """N, E and L with the true eye are mathematically the same (paper, section 3)."""
        right = color_of(drawn(self.scene, self.settings))
        same = self.drawn_without(monkeypatch, *FLIPS)
        np.testing.assert_allclose(same, right, atol=1e-6)  # signs are exact; dot products keep their bits


def square_scene(height: float, texture: Bytes, repeats: int, side: int) -> Scene:
    """Return a textured square parallel to the plate that fills the film of `side` pixels exactly."""
    half = abs(height) * math.tan(math.radians(25))
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half + [0, 0, height]
    part = SceneObject(
        name="square",
        vertices=corners,
        faces=np.array([[0, 1, 2], [0, 2, 3]]),
        material="paper",
        uv=np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]) * repeats,
        textures=(texture,),
        texture_of_triangle=np.zeros(2, np.int32),
    )
    paper = Material(ambient=(1, 1, 1), diffuse=(0, 0, 0))
    fov = math.radians(50)
    return Scene(
        name="square",
        plate=Plate(size=(1.0, 1.0), hogels=(1, 1)),
        frustum=Frustum(resolution=(side, side), reach=(100.0, 100.0), fov=(fov, fov)),
        objects=(part,),
        appearance=Appearance(materials={"paper": paper}, lights=()),
    )


@pytest.mark.parametrize("height", [-40.0, 25.0])
@pytest.mark.parametrize(("repeats", "points"), [(1, 1), (3, 1), (1, 2), (2, 5)])
def test_a_textured_square_shows_its_texels(height: float, repeats: int, points: int) -> None:
    """Texel centers show the texel; between them lies the weighted mean; C* sees it turned around."""
    texture = np.random.default_rng(3).integers(0, 256, (6, 6, 4)).astype(np.uint8)
    side = 6 * repeats * points
    scene = square_scene(height, texture, repeats, side)
    image = drawn(scene, replace(reversed_d32f(1e-2), fit=abs(height)))
    assert image.covered.all()
    if height > 0:
        image = replace(image, color=color_of(image)[::-1, ::-1])
    # By rows, then by columns: linear interpolation at (k + 1/2) / points texels, around the edge.
    expected = np.tile(decoded(texture[..., :3]), (repeats, repeats, 1))
    for axis in (0, 1):
        at_texel = (np.arange(side) + 0.5) / points - 0.5
        below = np.floor(at_texel).astype(int)
        share = (at_texel - below).reshape([-1 if a == axis else 1 for a in range(3)])
        count = 6 * repeats
        low, high = (np.take(expected, (below + k) % count, axis=axis) for k in (0, 1))
        expected = low * (1 - share) + high * share
    # Coordinates are off by a few 2^-24 of their largest, in texels 6 times that, and texels by up to one;
    # where snapping moves them, by half a subpixel step along each axis, in texels 1 / points of that.
    model = device_at_hand()
    snapped = 2 * model.half_step / points if model.snaps_depth else 0.0
    np.testing.assert_allclose(color_of(image), expected, atol=6 * repeats * 2.0**-20 + snapped)


def sphere_about(center: tuple[float, float, float], radius: float, bands: int) -> SceneObject:
    polar = np.linspace(0, np.pi, bands + 1)
    vertices, faces = lathe(np.sin(polar), -np.cos(polar), sectors=2 * bands)
    return SceneObject(
        name="mirror",
        vertices=vertices * radius + center,
        faces=faces,
        vertex_normals=unit(vertices),
        material="mirror",
    )


def smooth_radiance(direction: Floats) -> Floats:
    x, y, z = np.moveaxis(direction, -1, 0)
    return np.stack((1 + 0.5 * x + 0.2 * y, 1 + 0.4 * y - 0.3 * z, 1 + 0.6 * x * z + 0.2 * x), axis=-1)


def smooth_environment(rows: int) -> Environment:
    """Return `smooth_radiance` as a map: longitude from behind the plate to the right, top above."""
    longitude = ((np.arange(2 * rows) + 0.5) / (2 * rows) - 0.5) * 2 * np.pi
    latitude = (0.5 - (np.arange(rows) + 0.5) / rows)[:, None] * np.pi
    ring = np.cos(latitude)
    up = np.broadcast_to(np.sin(latitude), (rows, 2 * rows))
    direction = np.stack((ring * np.sin(longitude), up, -ring * np.cos(longitude)), axis=-1)
    return Environment(radiance=smooth_radiance(direction).astype(np.float32))


def test_a_mirror_sphere_shows_the_environment_on_both_sides_of_the_plate() -> None:
    """The pictures agree with the closed form of a true sphere, computed without mesh and map."""
    bands, rows, radius, steepest = 96, 128, 12.0, 3.0
    centers = ((-9.0, 6.0, -42.0), (9.0, 7.0, 38.0))
    mirror = Material(ambient=(0, 0, 0), diffuse=(0, 0, 0), reflectivity=(1.0, 0.5, 0.25))
    scene = Scene(
        name="mirrors",
        plate=Plate(size=(2.0, 2.0), hogels=(1, 1)),
        frustum=Frustum(resolution=(140, 110), reach=(60.0, 60.0), fov=(math.radians(70), math.radians(60))),
        objects=tuple(sphere_about(center, radius, bands) for center in centers),
        appearance=Appearance(materials={"mirror": mirror}, lights=(), environment=smooth_environment(rows)),
    )
    assert needed(scene) == {Effect.C, Effect.C_STAR, Effect.SMOOTH_NORMALS, Effect.REFLECTION}
    image = drawn(scene, reversed_d32f(1e-6))
    d = unit(lines_by_definition(scene, at(0.0, 0.0)))
    # A normal interpolated on a facet is off by its sagitta, angle^2 / 8, times the slope at which it
    # is seen; a reflection by twice that. A map in steps is off by step^2 / 8 times its curvature.
    step = np.pi / bands
    tolerance = 1.5 * (2 * (2 * step) ** 2 / 8 * steepest) + 2 * (np.pi / rows) ** 2 / 8
    assert tolerance < 3 * ONE_CODE
    for center, side in zip(centers, (image.height < 0, image.height > 0), strict=True):
        middle = d @ center
        under = middle**2 - (np.dot(center, center) - radius**2)
        met = (middle - np.sqrt(np.maximum(under, 0)))[..., None] * d  # the first, from the viewer's end
        normal = unit(met - center)
        facing = -np.einsum("...i,...i->...", normal, d)
        judged = side & (under > 0) & (facing > 1 / math.hypot(1, steepest))
        assert judged.sum() > 500
        reflection = d + 2 * facing[..., None] * normal
        expected = smooth_radiance(reflection) * mirror.reflectivity
        error = np.abs(color_of(image) - expected)[judged].max(axis=-1)
        assert error.max() < tolerance
        assert np.median(error) < ONE_CODE / 4


def test_the_environment_reaches_around_and_to_the_poles() -> None:
    """A sphere seen from within looks the map up in every direction."""
    scene = dressed_scene("asymmetric", RESOLUTION)
    mirrors = {
        name: Material(ambient=(0, 0, 0), diffuse=(0, 0, 0), reflectivity=(1, 1, 1))
        for name in ("shiny", "plain")
    }
    for size in ((1, 1), (2, 1), (3, 2), (64, 32)):
        environment = patterned_environment(7, size)
        look = replace(scene.appearance, materials=mirrors, lights=(), environment=environment)
        reflective = replace(scene, appearance=look)
        image = drawn(reflective, reversed_d32f(1e-2))
        assert beyond_snapping(reflective, image).max() < ONE_CODE, size


def test_surfaces_that_tie_reflect_once() -> None:
    """Only one of two surfaces at equal depth is seen; the other adds nothing."""
    scene = view("hard/coincident-copies")
    mirror = Material(ambient=(0.1, 0.1, 0.1), diffuse=(0, 0, 0), reflectivity=(1, 1, 1))
    look = Appearance(materials={"mirror": mirror}, lights=(), environment=patterned_environment())
    scene = replace(
        scene, appearance=look, objects=tuple(replace(part, material="mirror") for part in scene.objects)
    )
    image = drawn(scene, reversed_d32f(scene.frustum.longest_reach * 1e-3))
    assert image.covered.sum() > 500
    assert beyond_snapping(scene, image).max() < ONE_CODE


def reduced(scene: Scene, **look: Any) -> Scene:
    return replace(scene, appearance=replace(scene.appearance, **look))


def materials(**changes: Any) -> dict[str, Material]:
    return {"shiny": replace(PLAIN, **changes), "plain": replace(PLAIN, **changes)}


NONE = (0.0, 0.0, 0.0)
LOOKS: dict[str, Callable[[Scene], Scene]] = {
    "everything": lambda scene: scene,
    "no light": lambda scene: reduced(scene, lights=()),
    "black lights": lambda scene: reduced(scene, lights=(replace(LIGHTS[0], color=NONE),)),
    "no environment": lambda scene: reduced(scene, environment=None),
    "black environment": lambda scene: reduced(
        scene, environment=replace(patterned_environment(), strength=0)
    ),
    "no mirror": lambda scene: reduced(scene, materials=materials()),
    "no ambient": lambda scene: reduced(scene, materials=materials(ambient=NONE)),
    "no diffuse": lambda scene: reduced(scene, materials=materials(diffuse=NONE)),
    "no specular": lambda scene: reduced(scene, materials=materials(specular=NONE)),
    "nothing but color": lambda scene: reduced(scene, materials=materials(diffuse=NONE, specular=NONE)),
    "flat": lambda s: replace(s, objects=tuple(replace(part, vertex_normals=None) for part in s.objects)),
    "uncolored": lambda s: replace(s, objects=tuple(replace(part, vertex_colors=None) for part in s.objects)),
    "white vertices": lambda s: replace(
        s, objects=tuple(replace(part, vertex_colors=np.ones_like(part.vertices)) for part in s.objects)
    ),
    "untextured": lambda s: replace(
        s, objects=tuple(replace(part, textures=(), texture_of_triangle=None) for part in s.objects)
    ),
    "bare": lambda s: replace(view("asymmetric", RESOLUTION)),
}


def assert_same_picture(scene: Scene, settings: DoubleFrustum) -> None:
    auto, everything = drawn(scene, settings), drawn(scene, settings, ALL_EFFECTS)
    for name in ("triangle", "position", "color"):
        assert getattr(auto, name).tobytes() == getattr(everything, name).tobytes(), name
    assert np.isfinite(color_of(auto)).all()


@pytest.mark.parametrize("look", thinned(LOOKS, 4))
def test_what_a_scene_does_not_call_for_changes_no_bit(look: str) -> None:
    scene = LOOKS[look](dressed_scene("asymmetric", RESOLUTION))
    assert look == "everything" or needed(scene) < ALL_EFFECTS
    assert_same_picture(scene, reversed_d32f(0.5))


@pytest.mark.parametrize(
    "name", thinned([*builtin.names(), *SHARED_SCENES, *hard_cases.names(giants=False)], 11)
)
def test_auto_and_all_are_the_same_bits_on_every_scene(name: str) -> None:
    scene = dressed_scene(name, RESOLUTION) if name.startswith("hard") else view(name, RESOLUTION)
    assert_same_picture(scene, reversed_d32f(scene.frustum.longest_reach * 1e-3))


def test_no_highlight_is_so_small_that_a_device_may_flush_it() -> None:
    scene = dressed_scene("asymmetric", RESOLUTION)
    alone = reduced(scene, environment=None, materials=materials(ambient=NONE, diffuse=NONE))
    color = color_of(drawn(alone, reversed_d32f(0.5)))
    darkest = min(PLAIN.specular) * min(min(light.color) for light in LIGHTS)
    assert color[color > 0].min() >= 2.0**-100 * darkest * (1 - 1e-6)
    assert color[color > 0].min() < 1e-20


@pytest.mark.parametrize("effect", thinned(Effect, 4, 1))
def test_what_a_scene_calls_for_is_seen_to_be_missing(effect: Effect) -> None:
    scene = dressed_scene("asymmetric", RESOLUTION)
    assert needed(scene) == ALL_EFFECTS
    whole = drawn(scene, reversed_d32f(0.5))
    without = drawn(scene, reversed_d32f(0.5), ALL_EFFECTS - {effect})
    difference = np.abs(color_of(without) - color_of(whole)).max(axis=-1)
    assert (difference[whole.covered] > ONE_CODE).mean() > 0.05
    geometry = effect in (Effect.C, Effect.C_STAR)
    assert np.array_equal(whole.triangle, without.triangle) is not geometry


def test_light_is_linear_and_nothing_is_clipped() -> None:
    """Much more light is as much more radiance, to the bit, far beyond one; and lights add up."""
    scene = LOOKS["no ambient"](dressed_scene("asymmetric", RESOLUTION))

    def lit(*lights: DirectionalLight) -> Singles:
        return color_of(drawn(reduced(scene, lights=lights, environment=None), reversed_d32f(0.5)))

    once = lit(*LIGHTS)
    assert once.max() > 0.3
    brighter = [
        replace(one, color=(1024 * one.color[0], 1024 * one.color[1], 1024 * one.color[2])) for one in LIGHTS
    ]
    np.testing.assert_array_equal(lit(*brighter), once * 1024)
    np.testing.assert_allclose(sum(lit(light) for light in LIGHTS), once, atol=2.0**-21)


def test_a_picture_is_the_same_whatever_was_drawn_before() -> None:
    """Far from its mirror direction a highlight is too small to be a normal float32. A software renderer was
    seen to flush such numbers to zero until it had drawn a plate, and to keep them from then on."""
    scene = LOOKS["no diffuse"](dressed_scene("asymmetric", RESOLUTION))
    pictures = []
    for _ in range(3):
        pictures.append(color_of(drawn(scene, reversed_d32f(0.5))).tobytes())
        with PlateRenderer(view("asymmetric", RESOLUTION), DoubleFrustum(near=0.5)) as plate:
            assert len(list(plate.hogels(scene.plate.corners))) == len(scene.plate.corners)
    assert pictures.count(pictures[0]) == len(pictures)


@pytest.mark.parametrize(("effect", "camera"), [(Effect.C, Camera.C_STAR), (Effect.C_STAR, Camera.C)])
def test_without_one_camera_the_other_draws_alone(effect: Effect, camera: Camera) -> None:
    scene = dressed_scene("asymmetric", RESOLUTION)
    one = drawn(scene, reversed_d32f(0.5), ALL_EFFECTS - {effect})
    alone = drawn(scene, replace(reversed_d32f(0.5), camera=camera))
    for name in ("triangle", "position", "color"):
        assert getattr(one, name).tobytes() == getattr(alone, name).tobytes()


def test_without_reflections_the_rest_of_the_light_is_that_of_the_definition() -> None:
    scene = dressed_scene("asymmetric", RESOLUTION)
    image = drawn(scene, reversed_d32f(1e-2), ALL_EFFECTS - {Effect.REFLECTION})
    assert beyond_snapping(scene, image, reflections=False).max() < ONE_CODE
