"""The effects that a scene calls for, and why: decided from the scene alone.

These are local effects: a scene that does not call for one has the same picture without it. An effect that
only surfaces out of sight have, beyond the reach or beside the frusta, is not called for (`region`). Light
transport and band limiting change every picture: they are settings of the scene (`Sampling`, `Transport`).
Light paths have all effects, because surfaces out of sight cast shadows, send light and stand in mirrors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np

from xfrustum.scenes.appearance.material import Material
from xfrustum.scenes.arguments import choice
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.region import Region
from xfrustum.scenes.model.scene import NormalsMade, Scene, SceneObject
from xfrustum.scenes.model.slabs import slab_content
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


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
    """One effect, used or left out, and the fact in the scene that decided it.

    Attributes
    ----------
    effect, used
        The effect, and whether images are made with it.
    reason
        The fact, in words.
    objects
        Numbers of the objects that call for the effect and may be shown.
    out_of_sight
        Numbers of the objects that would call for it, but lie beyond the reach or beside the frusta.
    """

    effect: Effect
    used: bool
    reason: str
    objects: tuple[int, ...] = ()
    out_of_sight: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Question:
    """The images whose effects are decided on.

    Attributes
    ----------
    camera
        Cameras that draw.
    apertures
        Apertures of the images; None for all of the plate.
    settings
        Settings that images are drawn with; none are needed unless a near is tiny, see `Region.of`.
    """

    camera: Camera = Camera.BOTH
    apertures: tuple[Aperture, ...] | None = None
    settings: tuple[DoubleFrustum, ...] = ()


def decide(
    scene: Scene, camera: Camera = Camera.BOTH, question: Question | None = None
) -> tuple[Decision, ...]:
    """Return the decision about every effect.

    Parameters
    ----------
    scene
        Scene that is asked about.
    camera
        Cameras that draw.
    question
        Images that are asked for, instead of those of the whole plate by `camera`.
    """
    asked = question or Question(camera=camera)
    sight = _Sight(scene, Region.of(scene, asked.apertures, asked.settings))
    facts = (
        _camera(sight, Effect.C, asked.camera),
        _camera(sight, Effect.C_STAR, asked.camera),
        _smooth_normals(sight),
        _attribute(sight, Effect.VERTEX_COLORS, _colored_faces, "colors at its vertices"),
        _attribute(sight, Effect.TEXTURES, _textured_faces, "a texture"),
        *(_term(sight, term) for term in (Effect.AMBIENT, Effect.DIFFUSE, Effect.SPECULAR)),
        _reflection(sight),
    )
    return tuple(facts)


def needed(scene: Scene, camera: Camera = Camera.BOTH, question: Question | None = None) -> frozenset[Effect]:
    """Return the effects that `decide` says are used."""
    if camera is not Camera.BOTH or question is not None:
        return _used(decide(scene, camera, question))
    # Each renderer of a scene asks for all of its images.
    if scene not in _NEEDED:
        _NEEDED[scene] = _used(decide(scene))
    return _NEEDED[scene]


_NEEDED: WeakKeyDictionary[Scene, frozenset[Effect]] = WeakKeyDictionary()
"""Effects that all images of a scene need, by the scene, which does not change."""


def _used(decisions: Iterable[Decision]) -> frozenset[Effect]:
    return frozenset(decision.effect for decision in decisions if decision.used)


def chosen(
    scene: Scene, names: str, camera: Camera = Camera.BOTH, question: Question | None = None
) -> frozenset[Effect]:
    """Return the effects that a text names: `auto`, `all`, or names between commas.

    Raises
    ------
    InputError
        There is no such effect.
    """
    if names == "auto":
        return needed(scene, camera, question)
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


@dataclass(frozen=True)
class _Sight:
    """A scene, and which of its objects images may show."""

    scene: Scene
    region: Region

    @cached_property
    def shown(self) -> tuple[bool, ...]:
        """Whether each object may be shown."""
        return tuple(self.region.shows(part) for part in self.scene.objects)

    def split(self, has: Callable[[SceneObject], Mask | None]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return the numbers of the objects some of whose triangles have something, in sight and out of it.

        Parameters
        ----------
        has
            Function that returns (F,) which triangles of an object have it; None for no triangle.
        """
        inside: list[int] = []
        outside: list[int] = []
        for number, part in enumerate(self.scene.objects):
            triangles = has(part)
            if triangles is None or not triangles.any():
                continue
            seen = self.shown[number] and self.region.shows(part, part.faces[triangles])
            (inside if seen else outside).append(number)
        return tuple(inside), tuple(outside)

    def split_materials(self, shows: Callable[[Material], bool]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return the numbers of the objects with such a material, in sight and out of it."""
        owners = [number for number, material in enumerate(self.scene.materials) if shows(material)]
        return (
            tuple(number for number in owners if self.shown[number]),
            tuple(number for number in owners if not self.shown[number]),
        )


OUT_OF_SIGHT = "lies beyond the reach or beside the frusta"
"""Why something calls for no effect, in words."""


def _camera(sight: _Sight, effect: Effect, camera: Camera) -> Decision:
    """Decide on a camera: C draws surfaces behind the plate, C* those before it."""
    if camera is not Camera.BOTH and camera.value != effect.value:
        return Decision(effect=effect, used=False, reason=f"camera {camera} alone is asked for")
    reach_viewer, reach_back = sight.scene.frustum.reach
    behind = effect is Effect.C
    side = Camera.C if behind else Camera.C_STAR
    count = slab_content(sight.scene, side, (0.0, reach_back if behind else reach_viewer)).triangles
    subject = {0: "nothing lies", 1: "one triangle lies"}.get(count, f"{count:,} triangles lie")
    reason = f"{subject} {'behind' if behind else 'before'} the plate within the reach"
    if not count:
        return Decision(effect=effect, used=False, reason=reason)

    def on_this_side(part: SceneObject) -> Mask:
        heights = part.vertices[:, 2]
        on_side = heights <= 0 if behind else heights >= 0
        return np.asarray(on_side[part.faces].any(axis=1))

    inside, outside = sight.split(on_this_side)
    if not inside:
        reason += ", and nothing of it lies in the frusta"
    return Decision(effect=effect, used=bool(inside), reason=reason, objects=inside, out_of_sight=outside)


MAX_LISTED_OBJECTS = 4
"""Objects that a reason lists by number; more are counted."""


def _smooth_normals(sight: _Sight) -> Decision:
    """Decide on smooth normals: the reason names the objects that have them, and their origin."""
    inside, outside = sight.split(_smooth_faces)
    objects = sight.scene.objects
    numbers_of = {
        made: [number for number in inside if objects[number].normals_made is made] for made in NormalsMade
    }
    reasons = [f"{_numbered(numbers)} {_NORMALS[made]}" for made, numbers in numbers_of.items() if numbers]
    nothing = "no object has normals at its vertices"
    if outside:
        nothing = f"of objects with normals at their vertices all that has them {OUT_OF_SIGHT}"
    return Decision(
        effect=Effect.SMOOTH_NORMALS,
        used=bool(inside),
        reason="; ".join(reasons) or nothing,
        objects=inside,
        out_of_sight=outside,
    )


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


def _smooth_faces(part: SceneObject) -> Mask | None:
    """Return which triangles have a normal at each corner."""
    if part.vertex_normals is None:
        return None
    has_normal = np.asarray(np.isfinite(part.vertex_normals).all(axis=1))
    return np.asarray(has_normal[part.faces].all(axis=1))


def _colored_faces(part: SceneObject) -> Mask | None:
    """Return which triangles have a color other than one at a corner."""
    if part.vertex_colors is None:
        return None
    return np.asarray((part.vertex_colors != 1).any(axis=1)[part.faces].any(axis=1))


def _textured_faces(part: SceneObject) -> Mask | None:
    """Return which triangles show a texture: they have one, and coordinates at each corner."""
    if part.texture_of_triangle is None or part.uv is None or not part.textures:
        return None
    placed = np.isfinite(part.uv[part.faces]).all(axis=(1, 2))
    return np.asarray((part.texture_of_triangle >= 0) & placed)


def _attribute(
    sight: _Sight, effect: Effect, has: Callable[[SceneObject], Mask | None], what: str
) -> Decision:
    inside, outside = sight.split(has)
    reason = f"{'a' if inside else 'no'} mesh has {what}"
    if outside and not inside:
        reason = f"a mesh has {what}, but all of it that does {OUT_OF_SIGHT}"
    return Decision(effect=effect, used=bool(inside), reason=reason, objects=inside, out_of_sight=outside)


def _term(sight: _Sight, term: Effect) -> Decision:
    """Decide on one term of the Phong model: it needs a coefficient and, unless it is ambient, a light."""
    inside, outside = sight.split_materials(lambda material: max(getattr(material, term.value)) > 0)
    if not inside and not outside:
        return Decision(effect=term, used=False, reason=f"no object's material has {_A[term]} coefficient")
    if term is not Effect.AMBIENT and not any(
        max(light.color) > 0 for light in sight.scene.appearance.lights
    ):
        return Decision(effect=term, used=False, reason="there is no light")
    return _of_materials(term, f"{_A[term]} coefficient", inside, outside)


_A = {Effect.AMBIENT: "an ambient", Effect.DIFFUSE: "a diffuse", Effect.SPECULAR: "a specular"}


def _reflection(sight: _Sight) -> Decision:
    environment = sight.scene.appearance.environment
    if environment is None:
        return Decision(effect=Effect.REFLECTION, used=False, reason="there is no environment to reflect")
    if environment.strength == 0 or not environment.radiance.any():
        return Decision(effect=Effect.REFLECTION, used=False, reason="the environment is black")
    inside, outside = sight.split_materials(lambda material: max(material.reflectivity) > 0)
    if not inside and not outside:
        return Decision(effect=Effect.REFLECTION, used=False, reason="no object's material is reflective")
    return _of_materials(Effect.REFLECTION, "a reflectivity", inside, outside)


def _of_materials(effect: Effect, what: str, inside: tuple[int, ...], outside: tuple[int, ...]) -> Decision:
    """Return the decision about an effect for which the materials of some objects call."""
    count = len(inside or outside)
    reason = f"{'one object' if count == 1 else f'{count} objects'}{_HAVE[count > 1]} {what}"
    if not inside:
        reason += f", but {'it' if count == 1 else 'each'} {OUT_OF_SIGHT}"
    return Decision(effect=effect, used=bool(inside), reason=reason, objects=inside, out_of_sight=outside)


_HAVE = {False: "'s material has", True: "' materials have"}
