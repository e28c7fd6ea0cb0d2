"""Effects that only surfaces out of sight have: left out, with the same bits, whatever the near."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.light import patterned_environment
from tests.support.long_tail import examples
from xfrustum.raster import Rasterizer
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference import Reference
from xfrustum.scenes import DoubleFrustum, Frustum, Pivot, Plate, Scene, SceneObject, Screen
from xfrustum.scenes.appearance.appearance import Appearance, DirectionalLight, Material
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.geometry.shapes import lathe
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, Question, Region, decide, needed
from xfrustum.scenes.model.plate_content import ColorType, PlateContent

MIRRORED = frozenset({Effect.REFLECTION, Effect.SMOOTH_NORMALS, Effect.VERTEX_COLORS, Effect.SPECULAR})
"""Effects that the ball has, and nothing else in the scene."""

CENTERED = Frustum(resolution=(24, 18), reach=(100.0, 150.0), fov=(radians(40), radians(40)))
RECENTERED = Frustum(
    resolution=(24, 18),
    reach=(100.0, 150.0),
    screen=Screen(height=-120.0, center=(10.0, 5.0), size=(80.0, 60.0)),
)


def ball(center: tuple[float, float, float], radius: float) -> SceneObject:
    """A smooth, colored mirror ball."""
    polar = np.linspace(0, np.pi, 13)
    outward, faces = lathe(radius * np.sin(polar), -radius * np.cos(polar), sectors=24)
    return SceneObject(
        name="ball",
        vertices=outward + np.array(center),
        faces=faces,
        material="mirror",
        vertex_normals=outward,
        vertex_colors=np.full(outward.shape, 0.5),
    )


def scene(*parts: SceneObject, frustum: Frustum = CENTERED) -> Scene:
    """A plain gray square at z = -60, and other objects."""
    corners = np.array([[-20.0, -20, -60], [20, -20, -60], [20, 20, -60], [-20, 20, -60]])
    square = SceneObject(
        name="square", vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]), material="plain"
    )
    return Scene(
        name="mirror ball somewhere",
        plate=Plate(size=(40.0, 30.0), hogels=(5, 3)),
        frustum=frustum,
        objects=(square, *parts),
        appearance=Appearance(
            materials={
                "plain": Material(),
                "mirror": Material(specular=(0.3,) * 3, reflectivity=(0.9,) * 3),
            },
            lights=(DirectionalLight(direction=(0, 0, 1)),),
            environment=patterned_environment(),
        ),
    )


def assert_same_bits(asked: Scene, how: DoubleFrustum) -> None:
    """Assert that everything drawn and traced is the same with all effects and with those called for."""
    apertures = (asked.plate.middle, *asked.plate.corners)
    content = PlateContent(color=ColorType.FLOAT32, ids=True)
    with (
        Rasterizer(asked) as auto,
        Rasterizer(asked, ALL_EFFECTS) as everything,
        PlateRenderer(asked, how, content) as plate,
    ):
        for aperture, hogel in zip(apertures, plate.hogels(apertures), strict=True):
            one, other = auto.render(aperture, how), everything.render(aperture, how)
            for name in ("color", "triangle", "position"):
                assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
            np.testing.assert_array_equal(hogel.color, one.color)
    one, other = (Reference(asked, effects=some).trace(asked.plate.middle) for some in (None, ALL_EFFECTS))
    assert one.color is not None and other.color is not None
    np.testing.assert_array_equal(one.color, other.color)


def test_a_mirror_ball_beyond_the_reach_calls_for_nothing() -> None:
    """It lies 5 m behind a reach of 150 mm."""
    asked = scene(ball((0.0, 0.0, -5000.0), 300.0))
    assert needed(asked) == needed(scene())
    [reflection] = [d for d in decide(asked) if d.effect is Effect.REFLECTION]
    assert reflection.out_of_sight == (1,) and reflection.objects == ()
    assert reflection.reason == (
        "one object has a reflective material, but what has it lies beyond the reach or beside the frusta"
    )
    assert_same_bits(asked, DoubleFrustum(near=0.15))


@pytest.mark.parametrize("frustum", [CENTERED, RECENTERED], ids=["centered", "recentered"])
@pytest.mark.parametrize("center", [(900.0, 0.0, -60.0), (0.0, -900.0, 50.0)])
def test_a_mirror_ball_beside_the_frusta_calls_for_nothing(
    frustum: Frustum, center: tuple[float, float, float]
) -> None:
    asked = scene(ball(center, 30.0), frustum=frustum)
    assert not needed(asked) & (MIRRORED | {Effect.C_STAR})
    assert_same_bits(asked, DoubleFrustum(near=20.0, pivot=Pivot.CAMERA))


def test_a_mirror_ball_in_sight_calls_for_its_effects() -> None:
    assert needed(scene(ball((0.0, 0.0, 50.0), 5.0))) >= MIRRORED | {Effect.C_STAR}


def test_one_aperture_calls_for_less_than_the_plate() -> None:
    """From the right edge of the plate the ball lies beside the frustum, stepped back or not."""
    asked = scene(ball((-165.0, 0.0, -60.0), 60.0))
    left, right = (asked.plate.aperture(column, 1) for column in (0, 4))
    assert needed(asked) >= MIRRORED
    assert needed(asked, question=Question(apertures=(left,))) >= MIRRORED
    assert not needed(asked, question=Question(apertures=(right,))) & MIRRORED


def test_effects_that_a_tiny_near_shows_beyond_the_reach_are_drawn() -> None:
    """Where float32 knows no far plane, C* shows the farthest of all surfaces: the ball beyond the reach."""
    asked = scene(ball((0.0, 0.0, 40.0), 1.0), ball((0.0, 0.0, 2000.0), 600.0))
    plain = replace(asked.objects[1], material="plain", vertex_normals=None, vertex_colors=None)
    hidden = replace(asked, objects=(asked.objects[0], plain, asked.objects[2]))
    assert not needed(hidden) & MIRRORED
    tiny = DoubleFrustum(near=1e-7)
    assert needed(hidden, question=Question(settings=(tiny,))) >= MIRRORED
    with Rasterizer(hidden) as rasterizer:
        assert (rasterizer.render(hidden.plate.middle, tiny).object == 2).any()
    assert_same_bits(hidden, tiny)


def test_color_alone_is_drawn_by_the_cameras_that_a_tiny_near_calls_for() -> None:
    """Within the reach C* sees nothing: the small ball lies beside its frusta. It shows the ball beyond."""
    asked = scene(ball((900.0, 0.0, 50.0), 1.0), ball((0.0, 0.0, 2000.0), 600.0))
    assert Effect.C_STAR not in needed(asked)
    tiny = DoubleFrustum(near=1e-7)
    with Rasterizer(asked) as rasterizer:
        whole = rasterizer.render(asked.plate.middle, tiny)
        assert (whole.object == 2).any()
        np.testing.assert_array_equal(rasterizer.render_color(asked.plate.middle, tiny), whole.color)


@examples(25)
@given(
    center=st.tuples(st.integers(-300, 300), st.integers(-300, 300), st.integers(-250, 200)),
    radius=st.integers(1, 40),
    near=st.sampled_from([1e-3, 0.3, 20.0, 140.0]),
    pivot=st.sampled_from(list(Pivot)),
    recentered=st.booleans(),
)
def test_what_a_camera_shows_lies_in_the_region(
    center: tuple[float, float, float], radius: float, near: float, pivot: Pivot, recentered: bool
) -> None:
    """The region that decides is never smaller than what any aperture's cameras draw, by their definition."""
    asked = scene(ball(center, radius), frustum=RECENTERED if recentered else CENTERED)
    points = asked.objects[1].vertices[asked.objects[1].faces].mean(axis=1)
    for aperture in (asked.plate.middle, *asked.plate.corners):
        shown = shown_by_definition(
            asked, points, (aperture.x, aperture.y), DoubleFrustum(near=near, pivot=pivot)
        )
        held = Region.of(asked).holds(points, points)
        assert held[shown].all()


def shown_by_definition(
    asked: Scene, points: Floats, aperture: tuple[float, float], how: DoubleFrustum
) -> Mask:
    """Return which points C or C* has on its film (CONVENTIONS.md, "The two cameras")."""
    toward, back = asked.frustum.reach
    z = points[:, 2]
    w = np.abs(z) + how.near
    shown = (z >= -back) & (z <= toward)
    screen = asked.frustum.screen
    for axis in (0, 1):
        if screen is None:
            k, t = 0.0, np.tan(asked.frustum.fov[axis] / 2)
        else:
            k = (screen.center[axis] - aperture[axis]) / -screen.height
            t = screen.size[axis] / 2 / abs(screen.height)
        fixed = np.sign(z) * -how.near if how.pivot is Pivot.CAMERA else 0.0
        shown &= np.abs(points[:, axis] - aperture[axis] + k * (z - fixed)) <= t * w
    return np.asarray(shown)
