"""The effects that a scene calls for, and why: decided from the scene alone.

These are local effects: a scene that does not call for one has the same picture without it. Light transport
and band limiting change every picture: they are settings of the scene (`Sampling`, `Transport`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from xfrustum.scenes.appearance.material import Material
from xfrustum.scenes.arguments import choice
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import NormalsMade, Scene, SceneObject
from xfrustum.scenes.model.slabs import slab_content
from xfrustum.scenes.plate.double_frustum import Camera


class Effect(StrEnum):
    """A part of the simulation that can be left out."""

    C = "c"
    C_STAR = "c-star"
    SMOOTH_NORMALS = "smooth-normals"
    VERTEX_COLORS = "vertex-colors"
    TEXTURES = "textures"
    AMBIENT = "ambient"
    DIFFUSE = "diffuse"
    SPECULAR = "specular"
    REFLECTION = "reflection"


ALL_EFFECTS = frozenset(Effect)


@dataclass(frozen=True, kw_only=True)
class Decision:
    """One effect, used or left out, and the fact in the scene that decided it."""

    effect: Effect
    used: bool
    reason: str


def decide(scene: Scene, camera: Camera = Camera.BOTH) -> tuple[Decision, ...]:
    """Return the decision about every effect.

    Parameters
    ----------
    scene
        Scene that is asked about.
    camera
        Cameras that draw.
    """
    facts = (
        _camera(scene, Effect.C, camera),
        _camera(scene, Effect.C_STAR, camera),
        _smooth_normals(scene),
        _attribute(Effect.VERTEX_COLORS, _has_colors(scene), "colors at its vertices"),
        _attribute(Effect.TEXTURES, scene.surface.texture_of_triangle is not None, "a texture"),
        *(_term(scene, term) for term in (Effect.AMBIENT, Effect.DIFFUSE, Effect.SPECULAR)),
        _reflection(scene),
    )
    return tuple(facts)


def needed(scene: Scene, camera: Camera = Camera.BOTH) -> frozenset[Effect]:
    """Return the effects that `decide` says are used."""
    return frozenset(decision.effect for decision in decide(scene, camera) if decision.used)


def chosen(scene: Scene, names: str, camera: Camera = Camera.BOTH) -> frozenset[Effect]:
    """Return the effects that a text names: `auto`, `all`, or names between commas.

    Raises
    ------
    InputError
        There is no such effect.
    """
    if names == "auto":
        return needed(scene, camera)
    if names == "all":
        return ALL_EFFECTS
    asked = [name.strip() for name in names.split(",")]
    if {"auto", "all"} & set(asked):
        raise InputError(f"effects are auto, or all, or names between commas, and no mixture: not {names!r}")
    return frozenset(_named(name) for name in asked)


def checked(effects: object) -> frozenset[Effect]:
    """Return effects that are given as members or names as members.

    Raises
    ------
    InputError
        The effects are no collection, or one of them is no effect.
    """
    if isinstance(effects, str) or not isinstance(effects, Iterable):
        raise InputError(f"effects must be a collection such as {{'c', 'diffuse'}}, not {effects!r}")
    return frozenset(choice(Effect, effect, "an effect") for effect in effects)


def _named(name: str) -> Effect:
    try:
        return Effect(name)
    except ValueError as error:
        raise InputError(
            f"no effect is called {name!r}; use auto, or all, or names out of {', '.join(Effect)}"
        ) from error


def _camera(scene: Scene, effect: Effect, camera: Camera) -> Decision:
    """Decide on a camera: C draws surfaces behind the plate, C* those before it."""
    if camera is not Camera.BOTH and camera.value != effect.value:
        return Decision(effect=effect, used=False, reason=f"camera {camera} alone is asked for")
    reach_viewer, reach_back = scene.frustum.reach
    behind = effect is Effect.C
    side = Camera.C if behind else Camera.C_STAR
    count = slab_content(scene, side, (0.0, reach_back if behind else reach_viewer)).triangles
    subject = {0: "nothing lies", 1: "one triangle lies"}.get(count, f"{count:,} triangles lie")
    where = f"{'behind' if behind else 'before'} the plate within the reach"
    return Decision(effect=effect, used=count > 0, reason=f"{subject} {where}")


MAX_LISTED_OBJECTS = 4
"""Objects that a reason lists by number; more are counted."""


def _smooth_normals(scene: Scene) -> Decision:
    """Decide on smooth normals: the reason names the objects that have them, and their origin."""
    smooth = [(number, part) for number, part in enumerate(scene.objects) if _has_smooth_triangle(part)]
    numbers_of = {
        made: [number for number, part in smooth if part.normals_made is made] for made in NormalsMade
    }
    reasons = [f"{_numbered(numbers)} {_NORMALS[made]}" for made, numbers in numbers_of.items() if numbers]
    if not reasons:
        return Decision(
            effect=Effect.SMOOTH_NORMALS, used=False, reason="no object has normals at its vertices"
        )
    return Decision(effect=Effect.SMOOTH_NORMALS, used=True, reason="; ".join(reasons))


_NORMALS = {
    NormalsMade.NONE: "normals of its own",
    NormalsMade.SOME: "normals of its own and, at vertices without, those that smooth = true made",
    NormalsMade.ALL: "normals that smooth = true made",
}


def _numbered(numbers: list[int]) -> str:
    """Return the beginning of a sentence about some objects, up to its verb."""
    if len(numbers) == 1:
        return f"object {numbers[0]} has"
    if len(numbers) > MAX_LISTED_OBJECTS:
        return f"each of {len(numbers)} objects has"
    return f"each of objects {', '.join(map(str, numbers[:-1]))} and {numbers[-1]} has"


def _has_smooth_triangle(part: SceneObject) -> bool:
    if part.vertex_normals is None:
        return False
    has_normal = np.asarray(np.isfinite(part.vertex_normals).all(axis=1))
    return bool(has_normal[part.faces].all(axis=1).any())


def _has_colors(scene: Scene) -> bool:
    colors = scene.surface.vertex_colors
    return colors is not None and bool((colors != 1).any())


def _attribute(effect: Effect, present: bool, what: str) -> Decision:
    return Decision(effect=effect, used=present, reason=f"{'a' if present else 'no'} mesh has {what}")


def _term(scene: Scene, term: Effect) -> Decision:
    """Decide on one term of the Phong model: it needs a coefficient and, unless it is ambient, a light."""
    owners = _owners(scene, lambda material: max(getattr(material, term.value)) > 0)
    if not owners:
        return Decision(effect=term, used=False, reason=f"no object's material has {_A[term]} coefficient")
    if term is not Effect.AMBIENT and not any(max(light.color) > 0 for light in scene.appearance.lights):
        return Decision(effect=term, used=False, reason="there is no light")
    return Decision(effect=term, used=True, reason=f"{owners} {_A[term]} coefficient")


_A = {Effect.AMBIENT: "an ambient", Effect.DIFFUSE: "a diffuse", Effect.SPECULAR: "a specular"}


def _reflection(scene: Scene) -> Decision:
    environment = scene.appearance.environment
    if environment is None:
        return Decision(effect=Effect.REFLECTION, used=False, reason="there is no environment to reflect")
    if environment.strength == 0 or not environment.radiance.any():
        return Decision(effect=Effect.REFLECTION, used=False, reason="the environment is black")
    owners = _owners(scene, lambda material: max(material.reflectivity) > 0)
    if not owners:
        return Decision(effect=Effect.REFLECTION, used=False, reason="no object's material is reflective")
    return Decision(effect=Effect.REFLECTION, used=True, reason=f"{owners} a reflectivity")


def _owners(scene: Scene, shows: Callable[[Material], bool]) -> str:
    """Return the beginning of a sentence about the number of objects with such a material; empty if none."""
    count = sum(1 for material in scene.materials if shows(material))
    return {0: "", 1: "one object's material has"}.get(count, f"{count} objects' materials have")
