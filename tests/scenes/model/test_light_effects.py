"""The effects that a scene needs: one fact turns each of them on and off."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.long_tail import examples
from xfrustum.compare.prediction.depth import smallest_separation
from xfrustum.reports.common.outputs import json_object
from xfrustum.reports.scene_check.effects import effect_reason, scene_effects
from xfrustum.scenes import Camera, DoubleFrustum, Frustum, InputError, Plate, Scene, SceneObject
from xfrustum.scenes.appearance import (
    Appearance,
    DirectionalLight,
    Environment,
    Material,
    Sampling,
    Transport,
)
from xfrustum.scenes.model.effects import (
    ALL_EFFECTS,
    Effect,
    Question,
    chosen,
    decide,
    needed,
    slab_contents,
)

DARK = Material(ambient=(0,) * 3, diffuse=(0,) * 3)
MIRROR = Material(reflectivity=(0, 0.1, 0))
SKY = Environment(radiance=np.ones((2, 4, 3), dtype=np.float32))
LAMP = DirectionalLight(direction=(0, 0, 1))
BASE = frozenset({Effect.C, Effect.AMBIENT, Effect.DIFFUSE})


def sheet(z: float = -5.0, **attributes: Any) -> SceneObject:
    corners = np.array([[-3.0, -3, z], [3, -3, z], [0, 3, z]])
    faces = np.array([[0, 1, 2]])
    return SceneObject(name="sheet", vertices=corners, faces=faces, material="m", **attributes)


def scene(*parts: SceneObject, material: Material | None = None, **look: Any) -> Scene:
    look = {"lights": (LAMP,), "materials": {"m": material or Material()}} | look
    return Scene(
        name="one",
        plate=Plate(size=(8, 8), hogels=(8, 8)),
        frustum=Frustum(resolution=(16, 16), reach=(10.0, 20.0), fov=(1.0, 1.0)),
        objects=parts or (sheet(),),
        appearance=Appearance(**look),
    )


def textured() -> SceneObject:
    pictures = (np.zeros((1, 1, 4), dtype=np.uint8),)
    chosen = np.zeros(1, dtype=np.int32)
    return sheet(uv=np.zeros((3, 2)), textures=pictures, texture_of_triangle=chosen)


def test_each_fact_turns_on_its_own_effect_and_no_other() -> None:
    assert needed(scene()) == BASE
    for effect, world in {
        Effect.SMOOTH_NORMALS: scene(sheet(vertex_normals=np.tile([0.0, 0, 1], (3, 1)))),
        Effect.VERTEX_COLORS: scene(sheet(vertex_colors=np.full((3, 3), 0.5))),
        Effect.TEXTURES: scene(textured()),
        Effect.SPECULAR: scene(material=Material(specular=(0, 0, 0.1))),
        Effect.REFLECTION: scene(material=MIRROR, environment=SKY),
        Effect.C_STAR: scene(sheet(), sheet(z=5.0)),
    }.items():
        assert needed(world) == BASE | {effect}
    assert needed(scene(sheet(z=0.0))) == BASE | {Effect.C_STAR}, "both cameras draw the plate"


def test_each_missing_fact_turns_it_off_again() -> None:
    flat = np.array([[0.0, 0, 1], [np.nan] * 3, [0, 0, 1]])
    black = Environment(radiance=np.zeros((2, 4, 3), dtype=np.float32))
    off = replace(LAMP, color=(0, 0, 0))
    for effect, world, reason in (
        ("smooth-normals", scene(sheet(vertex_normals=flat)), "has normals at vertices"),
        ("vertex-colors", scene(sheet(vertex_colors=np.ones((3, 3)))), "has colors at"),
        ("ambient", scene(material=DARK), "no object has a material with an ambient coefficient"),
        ("diffuse", scene(material=DARK), "no object has a material with a diffuse coefficient"),
        ("diffuse", scene(lights=()), "there is no light"),
        ("diffuse", scene(lights=(off,)), "there is no light"),
        ("reflection", scene(material=MIRROR), "there is no environment to reflect"),
        ("reflection", scene(material=MIRROR, environment=black), "environment is black"),
        (
            "reflection",
            scene(material=MIRROR, environment=replace(SKY, strength=0)),
            "environment is black",
        ),
        ("reflection", scene(environment=SKY), "no object has a reflective material"),
        ("c", scene(sheet(z=-30.0)), "nothing lies behind the plate within the reach"),
        ("c-star", scene(sheet(z=15.0)), "nothing lies before the plate within the reach"),
    ):
        [decision] = [each for each in decide(world, Question()) if each.effect == effect]
        assert not decision.used and reason in effect_reason(world, decision, Camera.BOTH)


def test_effects_are_chosen_by_name() -> None:
    assert chosen(scene(), "auto") == BASE
    assert chosen(scene(), "all") == ALL_EFFECTS
    assert chosen(scene(), "c, diffuse") == {Effect.C, Effect.DIFFUSE}
    with pytest.raises(
        InputError, match="no effect is called 'shine'; use auto, or all, or names out of c, c"
    ):
        chosen(scene(), "c,shine")
    with pytest.raises(InputError, match="no mixture: not 'auto,specular'"):
        chosen(scene(), "auto,specular")


@examples(50)
@given(
    heights=st.lists(
        # Nonzero coordinates below 1e-75 are refused.
        st.floats(-25, 15).map(lambda z: z if abs(z) > 1e-30 else 0.0),
        min_size=1,
        max_size=4,
    ),
    cuts=st.lists(st.integers(1, 9), max_size=3, unique=True).map(sorted),
)
def test_slabs_follow_each_other_and_together_have_every_triangle_within_the_reach(
    heights: list[float], cuts: list[int]
) -> None:
    world = scene(*(sheet(z=z) for z in heights))
    contents = slab_contents(
        world, DoubleFrustum(near=0.1, slabs=tuple(float(cut) for cut in cuts))
    )
    signed = [
        sorted(h * (-1 if slab.camera is Camera.C else 1) for h in slab.heights)
        for slab in contents
    ]
    assert (signed[0][0], signed[-1][1]) == (-20.0, 10.0)
    assert [high for _, high in signed[:-1]] == [low for low, _ in signed[1:]]
    for slab, (low, high) in zip(contents, signed, strict=True):
        assert slab.triangles == sum(low <= z <= high for z in heights)


def test_the_plan_lists_cameras_slabs_passes_samples_and_tracer() -> None:
    world = replace(
        scene(material=MIRROR, environment=SKY),
        sampling=Sampling(supersample=3, aperture=5),
        transport=Transport(shadows=True, samples=7),
    )
    plan = json_object(
        scene_effects(world, settings=DoubleFrustum(near=0.1, slabs=(4.0, 6.0))).summary()
    )
    assert plan["cameras"] == ["c"]
    assert [slab["triangles"] for slab in plan["slabs"]] == [0, 1, 0, 0, 0, 0]
    assert plan["slabs"][1]["heights"] == [4.0, 6.0]
    assert [(p["camera"], p["heights"], p["draws"]) for p in plan["passes"]] == [
        ("c", [4.0, 6.0], "surfaces"),
        ("c", [4.0, 6.0], "reflections"),
    ]
    assert plan["samples"] == {"pixel": 9, "multisample": 1, "aperture": 5}
    assert plan["transport"] == {"shadows": True, "interreflection": False, "samples": 7}
    used = {row["name"] for row in plan["effects"] if row["used"]}
    assert used == {*BASE, "reflection", "antialiasing", "band-limiting", "shadows"}


def test_effects_state_the_binding_error_bounds_at_each_depth() -> None:
    """A sheet 5 behind the plate, an aperture of pitch 1, and 16 pixels over 1 radian."""
    plan = scene_effects(scene(), settings=DoubleFrustum(near=0.1))
    depths = plan.depths
    blur = 1 / 5 * 16 / (2 * np.tan(0.5))
    # The sheet lies between two bins, and belongs to the inner one.
    [row] = depths["rows"]
    assert (row["side"], row["heights"], row["share"]) == ("behind", (2.5, 5.0), 1.0)
    assert (row["nearest"], row["farthest"], row["shear_px"]) == (5.0, 5.0, 0.0)
    assert row["near_px"] == pytest.approx(8 * 2**0.5 * 0.1 / 5.1)
    np.testing.assert_allclose(row["blur_px"], blur)
    # The second slab displaces nothing; its camera in the aperture orders depths up to the reach.
    cut = DoubleFrustum(near=0.1, slabs=(4.0,))
    [row] = scene_effects(scene(), settings=cut).depths["rows"]
    separation = smallest_separation(np.array([5.0]), 4.0, 20.0, cut.depth, cut.mapping)
    assert (row["near_px"], row["separation"]) == (0.0, separation[0])
    moved = 8 * 2**0.5 * depths["largest_near"] / (5 + depths["largest_near"])
    assert moved == pytest.approx(depths["tolerance_px"])
    assert depths["contrast"] == pytest.approx(0.7) and depths["sub_apertures"] == 8192
    levels = {entry["sub_apertures"]: entry["levels"] for entry in depths["band_errors"]}
    # Blur exceeds a pixel: the error is half the contrast without band limiting, and else the
    # contrast times the points' discrepancy.
    assert levels[1] == pytest.approx(0.7 * 255 / 2) and levels[256] == pytest.approx(
        0.7 * 255 * 0.0329
    )
    assert "8,192 keep them under one" in plan.table()
    inside = [row["side"] for row in scene_effects(scene(sheet(z=0.0))).depths["rows"]]
    assert inside == ["behind", "before"]
    rows = {row.name: row for row in scene_effects(scene(sheet(), sheet(z=-500.0))).rows}
    assert rows["diffuse"].objects == (0,) and rows["diffuse"].out_of_sight == (1,)
