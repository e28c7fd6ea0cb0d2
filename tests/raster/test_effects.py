"""Images keep every bit if effects that no visible surface needs are left out."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.images import assert_same
from tests.support.light import dressed_scene
from tests.support.lit import LAMP, SUN, ball, card, lit, sky
from tests.support.long_tail import examples, thinned
from tests.support.views import SHARED_SCENES, reversed_d32f, view
from xfrustum.raster import Rasterizer
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference import Reference
from xfrustum.scenes import DoubleFrustum, Frustum, Pivot, Plate, Scene, SceneObject, Screen
from xfrustum.scenes.appearance import DirectionalLight, Environment, Material, Sampling
from xfrustum.scenes.library import builtin, hard_cases
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, Question, needed
from xfrustum.scenes.model.images import ColorType, PlateContent

#: Effects that only the ball needs
MIRRORED = frozenset(
    {Effect.REFLECTION, Effect.SMOOTH_NORMALS, Effect.VERTEX_COLORS, Effect.SPECULAR}
)

CENTERED = Frustum(resolution=(24, 18), reach=(100.0, 150.0), fov=(radians(40), radians(40)))
RECENTERED = Frustum(
    resolution=(24, 18),
    reach=(100.0, 150.0),
    screen=Screen(height=-120.0, center=(10.0, 5.0), size=(80.0, 60.0)),
)


def mirror_ball(center: tuple[float, float, float], radius: float) -> SceneObject:
    """Return a smooth, colored mirror ball."""
    part = ball(center, radius, "mirror", 2)
    return replace(part, vertex_colors=np.full(part.vertices.shape, 0.5))


def scene(*parts: SceneObject, frustum: Frustum = CENTERED) -> Scene:
    """Return a scene with a plain gray square at z = -60, and other objects."""
    whole = lit(
        card((0.0, 0.0, -60.0), (40.0, 40.0), "plain"),
        *parts,
        frustum=frustum,
        lights=(DirectionalLight(direction=(0, 0, 1)),),
        environment=sky(),
        plain=Material(),
        mirror=Material(specular=(0.3,) * 3, reflectivity=(0.9,) * 3),
    )
    return replace(whole, plate=Plate(size=(40.0, 30.0), hogels=(5, 3)))


def assert_same_bits(request: Scene, how: DoubleFrustum) -> None:
    """Assert that all effects and the needed effects give equal drawings and traces."""
    apertures = (request.plate.middle, request.plate.corners[0])
    content = PlateContent(color=ColorType.FLOAT32, ids=True)
    with (
        Rasterizer(request) as auto,
        Rasterizer(request, ALL_EFFECTS) as everything,
        PlateRenderer(request, how, content) as plate,
    ):
        for aperture, hogel in zip(apertures, plate.hogels(apertures), strict=True):
            item, other = auto.render(aperture, how), everything.render(aperture, how)
            assert_same(item, other, "color", "triangle", "position")
            assert_same(hogel, item, "color")
    true, every = (
        Reference(request, effects=e).trace(request.plate.middle) for e in (None, ALL_EFFECTS)
    )
    assert_same(true, every, "color")


@pytest.mark.parametrize(
    "name", thinned([*builtin.names(), *SHARED_SCENES, *hard_cases.names(giants=False)], 11)
)
def test_auto_and_all_are_the_same_bits_on_every_scene(name: str) -> None:
    world = dressed_scene(name, (64, 48)) if name.startswith("hard") else view(name, (64, 48))
    near = 1e-3 * world.frustum.longest_reach
    assert_same_bits(replace(world, sampling=Sampling()), reversed_d32f(near))


COEFFICIENT = st.sampled_from([(0.0, 0.0, 0.0), (0.5, 0.5, 0.5), (0.2, 0.4, 0.7)])
BLACK = replace(SUN, color=(0.0, 0.0, 0.0))


@examples(12)
@given(
    st.builds(
        Material,
        ambient=COEFFICIENT,
        diffuse=COEFFICIENT,
        specular=COEFFICIENT,
        reflectivity=COEFFICIENT,
        exponent=st.sampled_from([0.5, 7.0, 200.0]),
    ),
    st.sampled_from([(), (SUN,), (SUN, LAMP), (BLACK,)]),
    st.sampled_from([None, sky(), replace(sky(), strength=0.0)]),
    st.sampled_from(["flat", "smooth", "white vertices", "no normals", "colors", "textured"]),
)
def test_effects_that_a_scene_does_not_need_change_no_bit(
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
    if kind == "textured":
        picture, which = np.full((2, 2, 4), 99, np.uint8), np.zeros(len(part.faces), np.int32)
        part = replace(
            part, uv=part.vertices[:, :2] / 7, textures=(picture,), texture_of_triangle=which
        )
    gray = card((5.0, 3.0, 40.0), (6.0, 8.0))
    request = lit(
        part, gray, frustum=CENTERED, lights=lights, environment=environment, paint=material
    )
    assert_same_bits(request, DoubleFrustum(near=0.1))


@pytest.mark.parametrize(
    ("frustum", "center"), [(CENTERED, (900.0, 0.0, -60.0)), (RECENTERED, (0.0, -900.0, 50.0))]
)
def test_a_mirror_ball_beside_the_frusta_needs_no_effect(
    frustum: Frustum, center: tuple[float, float, float]
) -> None:
    request = scene(mirror_ball(center, 30.0), frustum=frustum)
    assert not needed(request) & (MIRRORED | {Effect.C_STAR})
    assert_same_bits(request, DoubleFrustum(near=20.0, pivot=Pivot.CAMERA))


def test_one_aperture_needs_fewer_effects_than_the_plate() -> None:
    """Seen from the plate's right edge, the ball lies beside the frustum of any camera."""
    request = scene(mirror_ball((-155.0, 0.0, -60.0), 60.0))
    left, right = (request.plate.aperture(column, 1) for column in (0, 4))
    assert needed(request) >= MIRRORED
    assert needed(request, question=Question(apertures=(left,))) >= MIRRORED
    assert not needed(request, question=Question(apertures=(right,))) & MIRRORED
