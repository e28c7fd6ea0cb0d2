"""What a scene calls for, and why: decided before anything runs, from the scene alone.

These are the local effects, whose omission does not change the picture where nothing calls for them.
Light transport and band limiting change it: they are settings of the scene (`Sampling`, `Transport`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from xfrustum.scenes.double_frustum import Camera
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.scene import Scene


class Effect(StrEnum):
    """What can be simulated or left out."""

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
    """Return what a scene calls for, effect by effect.

    Parameters
    ----------
    camera
        Which of the two cameras is asked for.
    """
    facts = (
        _camera(scene, Effect.C, camera),
        _camera(scene, Effect.C_STAR, camera),
        _attribute(Effect.SMOOTH_NORMALS, _smooth(scene), "normals of its own"),
        _attribute(Effect.VERTEX_COLORS, scene.surface.vertex_colors is not None, "vertex colors"),
        _attribute(Effect.TEXTURES, scene.surface.texture_of_triangle is not None, "a texture"),
        *(_term(scene, term) for term in (Effect.AMBIENT, Effect.DIFFUSE, Effect.SPECULAR)),
        _reflection(scene),
    )
    return tuple(facts)


def needed(scene: Scene, camera: Camera = Camera.BOTH) -> frozenset[Effect]:
    """Return the effects that `decide` says are used."""
    return frozenset(decision.effect for decision in decide(scene, camera) if decision.used)


def chosen(scene: Scene, names: str, camera: Camera = Camera.BOTH) -> frozenset[Effect]:
    """Return the effects that people ask for: `auto`, `all`, or names between commas.

    Raises
    ------
    InputError
        No such effect.
    """
    if names == "auto":
        return needed(scene, camera)
    if names == "all":
        return ALL_EFFECTS
    return frozenset(_named(name.strip()) for name in names.split(","))


def _named(name: str) -> Effect:
    try:
        return Effect(name)
    except ValueError as error:
        raise InputError(f"no effect is called {name!r}; there are auto, all, {', '.join(Effect)}") from error


def _camera(scene: Scene, effect: Effect, camera: Camera) -> Decision:
    """C draws what is behind the plate, C* what is before it."""
    behind = effect is Effect.C
    reach_viewer, reach_back = scene.frustum.reach
    low, high = (-reach_back, 0.0) if behind else (0.0, reach_viewer)
    lowest, highest = scene.height_ranges
    count = int(np.count_nonzero((highest >= low) & (lowest <= high)))
    asked = camera is Camera.BOTH or camera.value == effect.value
    side = "behind" if behind else "before"
    reason = f"{count:,} triangles lie {side} the plate within the reach" if count else (
        f"nothing lies {side} the plate within the reach"
    )
    return Decision(
        effect=effect, used=asked and count > 0, reason=reason if asked else f"camera {camera} is asked for"
    )


def _smooth(scene: Scene) -> bool:
    normals = scene.surface.vertex_normals
    return normals is not None and bool(np.isfinite(normals).any())


def _attribute(effect: Effect, present: bool, what: str) -> Decision:
    reason = f"a mesh has {what}" if present else f"no mesh has {what}"
    return Decision(effect=effect, used=present, reason=reason)


def _term(scene: Scene, term: Effect) -> Decision:
    """A term of the Phong model is used where a material has a coefficient, and something to light it."""
    shows = _objects(index for index, m in enumerate(scene.materials) if max(getattr(m, term.value)) > 0)
    if not shows:
        return Decision(effect=term, used=False, reason=f"no object's material has a {term} coefficient")
    lit = term is Effect.AMBIENT or any(max(light.color) > 0 for light in scene.appearance.lights)
    reason = f"{shows} a {term} coefficient" if lit else "there is no light"
    return Decision(effect=term, used=lit, reason=reason)


def _reflection(scene: Scene) -> Decision:
    environment = scene.appearance.environment
    mirrors = _objects(index for index, m in enumerate(scene.materials) if max(m.reflectivity) > 0)
    if environment is None or environment.strength == 0 or not environment.radiance.any():
        return Decision(effect=Effect.REFLECTION, used=False, reason="there is no environment to reflect")
    if not mirrors:
        return Decision(effect=Effect.REFLECTION, used=False, reason="no object's material is reflective")
    return Decision(effect=Effect.REFLECTION, used=True, reason=f"{mirrors} a reflectivity")


def _objects(indices: Iterable[int]) -> str:
    """Say how many objects: `one object's material has`, or nothing."""
    count = sum(1 for _ in indices)
    return "" if not count else "one object's material has" if count == 1 else f"{count} objects' materials have"
