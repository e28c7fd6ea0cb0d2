"""The effects that a scene calls for, and why: decided from the scene alone.

A scene that does not call for an effect has the same picture without it; surfaces that no image can show
(`region`) call for none. Light paths have all effects, for surfaces out of sight cast shadows and light.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from xfrustum.scenes.appearance.appearance import Material
from xfrustum.scenes.arguments import choice
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.region import Region
from xfrustum.scenes.model.scene import Scene, SceneObject
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

#: What an object has that calls for an effect; the effects without are cameras.
_HAVE = {
    Effect.SMOOTH_NORMALS: "normals at {} vertices",
    Effect.VERTEX_COLORS: "colors at {} vertices",
    Effect.TEXTURES: "a texture",
    Effect.AMBIENT: "a material with an ambient coefficient",
    Effect.DIFFUSE: "a material with a diffuse coefficient",
    Effect.SPECULAR: "a material with a specular coefficient",
    Effect.REFLECTION: "a reflective material",
}


@dataclass(frozen=True, kw_only=True)
class Decision:
    """One effect, used or left out, and the fact in the scene that decided it, in words."""

    effect: Effect
    used: bool
    reason: str
    objects: tuple[int, ...] = ()  #: numbers of those that call for the effect and may be shown
    out_of_sight: tuple[int, ...] = ()  #: of those that would, but lie beyond the reach or beside the frusta


@dataclass(frozen=True, kw_only=True)
class Question:
    """The images whose effects are decided on."""

    camera: Camera = Camera.BOTH  #: cameras that draw
    apertures: tuple[Aperture, ...] | None = None  #: None for all of the plate
    settings: tuple[DoubleFrustum, ...] = ()  #: none are needed unless a near is tiny, see `Region.of`


def decide(scene: Scene, question: Question | None = None) -> tuple[Decision, ...]:
    """Return the decision about every effect, for some images or all of the whole plate."""
    asked = question or Question()
    region = Region.of(scene, asked.apertures, asked.settings)
    shown = [region.shows(part) for part in scene.objects]
    decisions = []
    for effect in Effect:
        inside: list[int] = []
        outside: list[int] = []
        refused = _refused(scene, effect, asked.camera)
        for number, part in enumerate(() if refused else scene.objects):
            faces = _calling_faces(effect, part, scene.materials[number])
            if faces is not None and faces.any():
                seen = shown[number] and (bool(faces.all()) or region.shows(part, part.faces[faces]))
                (inside if seen else outside).append(number)
        reason = refused or _reason(scene, effect, len(inside), len(outside))
        seen_or_not = {"objects": tuple(inside), "out_of_sight": tuple(outside)}
        decisions.append(Decision(effect=effect, used=bool(inside), reason=reason, **seen_or_not))
    return tuple(decisions)


def _refused(scene: Scene, effect: Effect, camera: Camera) -> str | None:
    """Return why an effect changes no picture, whatever the objects are; None where objects decide."""
    environment = scene.appearance.environment
    if effect not in _HAVE and camera not in (Camera.BOTH, effect.value):
        return f"camera {camera} alone is asked for"
    if effect is Effect.REFLECTION:
        if environment is None:
            return "there is no environment to reflect"
        return None if environment.strength and environment.radiance.any() else "the environment is black"
    if effect in (Effect.DIFFUSE, Effect.SPECULAR):
        wanted = any(max(getattr(one, effect.value)) > 0 for one in scene.materials)
        if wanted and not any(max(one.color) > 0 for one in scene.appearance.lights):
            return "there is no light"
    return None


def _calling_faces(effect: Effect, part: SceneObject, material: Material) -> Mask | None:
    """Return (F,) which triangles of an object call for an effect; None for no triangle."""
    faces, found = part.faces, None
    if effect not in _HAVE:
        heights = part.vertices[:, 2]
        found = (heights <= 0 if effect is Effect.C else heights >= 0)[faces].any(axis=1)
    elif effect is Effect.SMOOTH_NORMALS and part.vertex_normals is not None:
        found = np.asarray(np.isfinite(part.vertex_normals).all(axis=1))[faces].all(axis=1)
    elif effect is Effect.VERTEX_COLORS and part.vertex_colors is not None:
        found = (part.vertex_colors != 1).any(axis=1)[faces].any(axis=1)
    elif effect is Effect.TEXTURES and part.texture_of_triangle is not None and part.uv is not None:
        found = (part.texture_of_triangle >= 0) & np.isfinite(part.uv[faces]).all(axis=(1, 2))
    elif effect in (Effect.AMBIENT, Effect.DIFFUSE, Effect.SPECULAR, Effect.REFLECTION):
        name = "reflectivity" if effect is Effect.REFLECTION else effect.value
        found = np.full(len(faces), max(getattr(material, name)) > 0)
    return None if found is None else np.asarray(found)


def _reason(scene: Scene, effect: Effect, inside: int, outside: int) -> str:
    """Return the fact that decided an effect, in words."""
    if effect not in _HAVE:
        behind = effect is Effect.C
        count = _slab(scene, Camera(effect.value), (0.0, scene.frustum.reach[behind])).triangles
        subject = {0: "nothing lies", 1: "one triangle lies"}.get(count, f"{count:,} triangles lie")
        aside = ", and nothing of it lies in the frusta" if count and not inside else ""
        return f"{subject} {'behind' if behind else 'before'} the plate within the reach{aside}"
    what, count = _HAVE[effect], inside or outside
    if count == 0:
        return f"no object has {what.format('its')}"
    subject = "one object has" if count == 1 else f"{count} objects have"
    them = "it" if "a " in what else "them"
    aside = f", but what has {them} lies beyond the reach or beside the frusta" if not inside else ""
    return f"{subject} {what.format('its' if count == 1 else 'their')}{aside}"


def needed(scene: Scene, question: Question | None = None) -> frozenset[Effect]:
    """Return the effects that `decide` says are used."""
    return frozenset(decision.effect for decision in decide(scene, question) if decision.used)


def chosen(scene: Scene, names: str, question: Question | None = None) -> frozenset[Effect]:
    """Return the effects that a text names: `auto`, `all`, or names between commas; InputError for others."""
    if names == "auto":
        return needed(scene, question)
    if names == "all":
        return ALL_EFFECTS
    asked = {name.strip() for name in names.split(",")}
    if asked & {"auto", "all"}:
        raise InputError(f"effects are auto, or all, or names between commas, and no mixture: not {names!r}")
    for name in sorted(asked - set(Effect)):
        raise InputError(
            f"no effect is called {name!r}; use auto, or all, or names out of {', '.join(Effect)}"
        )
    return frozenset(map(Effect, asked))


def checked(effects: object) -> frozenset[Effect]:
    """Return effects that are given as members or names as members; InputError where they are no such."""
    if isinstance(effects, str) or not isinstance(effects, Iterable):
        raise InputError(f"effects must be a collection such as {{'c', 'diffuse'}}, not {effects!r}")
    return frozenset(choice(Effect, effect, "an effect") for effect in effects)


@dataclass(frozen=True, kw_only=True)
class SlabContent:
    """The content of one slab of C or C*: how many triangles reach into it; one without is not drawn."""

    camera: Camera
    heights: tuple[float, float]  #: |z| between which the slab lies
    triangles: int


def slab_contents(scene: Scene, settings: DoubleFrustum) -> tuple[SlabContent, ...]:
    """Return the content of every slab that is asked for, from the back: C's inward, C*'s outward."""
    reach_viewer, reach_back = scene.frustum.reach
    behind = [_slab(scene, Camera.C, heights) for heights in reversed(settings.sections(reach_back))]
    before = [_slab(scene, Camera.C_STAR, heights) for heights in settings.sections(reach_viewer)]
    return tuple(one for one in (*behind, *before) if settings.camera in (Camera.BOTH, one.camera))


def _slab(scene: Scene, camera: Camera, heights: tuple[float, float]) -> SlabContent:
    near, far = heights
    low, high = (-far, -near) if camera is Camera.C else (near, far)
    lowest, highest = scene.height_ranges
    count = int(np.count_nonzero((highest >= low) & (lowest <= high)))
    return SlabContent(camera=camera, heights=heights, triangles=count)
