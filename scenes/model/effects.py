"""Effects that a scene needs, with reasons.

A scene that does not need an effect has the same picture without it. Surfaces that are not visible
in any image (`scenes.model.visibility`) need no effect. Light paths still need such surfaces,
because the surfaces cast shadows and reflect light.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from xfrustum.scenes.appearance import Material
from xfrustum.scenes.arguments import InputError, choice
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.model.visibility import Region
from xfrustum.scenes.plate import Aperture, Camera, DoubleFrustum


class Effect(StrEnum):
    """Part of the simulation that can be omitted."""

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

CAMERAS = frozenset((Effect.C, Effect.C_STAR))


class Refusal(StrEnum):
    """Reason why an effect changes no picture, whatever the objects."""

    CAMERA = "camera"  #: only the other camera draws
    NO_ENVIRONMENT = "no-environment"
    BLACK_ENVIRONMENT = "black-environment"
    NO_LIGHT = "no-light"


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Decision about one effect, with the objects that require it."""

    effect: Effect
    refusal: Refusal | None = None
    objects: tuple[int, ...] = ()  #: numbers of objects that need the effect and may be visible
    out_of_sight: tuple[int, ...] = ()  #: numbers of objects that need it, but are not visible

    @property
    def used(self) -> bool:
        """True if any object uses the effect."""
        return bool(self.objects)


@dataclass(frozen=True, kw_only=True)
class Question:
    """Set of images for which effects are selected."""

    camera: Camera = Camera.BOTH  #: cameras that draw
    apertures: tuple[Aperture, ...] | None = None  #: None for all apertures of the plate
    settings: tuple[
        DoubleFrustum, ...
    ] = ()  #: settings are needed only for a tiny near, see `Region.from_scene`


def decide(scene: Scene, question: Question | None = None) -> tuple[Decision, ...]:
    """Return the decision about every effect, for a set of images or the whole plate."""
    question = question or Question()
    region = Region.from_scene(scene, question.apertures, question.settings)
    shown = [region.shows(part) for part in scene.objects]
    decisions = []
    for effect in Effect:
        inside: list[int] = []
        outside: list[int] = []
        refusal = _refusal(scene, effect, question.camera)
        for number, part in enumerate(() if refusal else scene.objects):
            faces = _calling_faces(effect, part, scene.materials[number])
            if faces is not None and faces.any():
                seen = shown[number] and (
                    bool(faces.all()) or region.shows(part, part.faces[faces])
                )
                (inside if seen else outside).append(number)
        decision = Decision(
            effect=effect, refusal=refusal, objects=tuple(inside), out_of_sight=tuple(outside)
        )
        decisions.append(decision)
    return tuple(decisions)


def _refusal(scene: Scene, effect: Effect, camera: Camera) -> Refusal | None:
    environment = scene.appearance.environment
    if effect in CAMERAS and camera not in (Camera.BOTH, effect.value):
        return Refusal.CAMERA
    if effect is Effect.REFLECTION and environment is None:
        return Refusal.NO_ENVIRONMENT
    if effect is Effect.REFLECTION and environment is not None:
        lit = environment.strength and environment.radiance.any()
        return None if lit else Refusal.BLACK_ENVIRONMENT
    if effect in (Effect.DIFFUSE, Effect.SPECULAR):
        called = any(max(getattr(material, effect.value)) > 0 for material in scene.materials)
        if called and not any(max(light.color) > 0 for light in scene.appearance.lights):
            return Refusal.NO_LIGHT
    return None


def _calling_faces(effect: Effect, part: SceneObject, material: Material) -> Mask | None:
    """Return the mask (F,) of an object's triangles that need an effect; None without any."""
    faces, calling = part.faces, None
    if effect in CAMERAS:
        heights = part.vertices[:, 2]
        calling = (heights <= 0 if effect is Effect.C else heights >= 0)[faces].any(axis=1)
    elif effect is Effect.SMOOTH_NORMALS and part.vertex_normals is not None:
        calling = np.asarray(np.isfinite(part.vertex_normals).all(axis=1))[faces].all(axis=1)
    elif effect is Effect.VERTEX_COLORS and part.vertex_colors is not None:
        calling = (part.vertex_colors != 1).any(axis=1)[faces].any(axis=1)
    elif effect is Effect.TEXTURES and part.texture_of_triangle is not None and part.uv is not None:
        calling = (part.texture_of_triangle >= 0) & np.isfinite(part.uv[faces]).all(axis=(1, 2))
    elif effect in (Effect.AMBIENT, Effect.DIFFUSE, Effect.SPECULAR, Effect.REFLECTION):
        name = "reflectivity" if effect is Effect.REFLECTION else effect.value
        calling = np.full(len(faces), max(getattr(material, name)) > 0)
    return None if calling is None else np.asarray(calling)


def needed(scene: Scene, question: Question | None = None) -> frozenset[Effect]:
    """Return the effects that `decide` marks as used."""
    return frozenset(decision.effect for decision in decide(scene, question) if decision.used)


def chosen(scene: Scene, names: str, question: Question | None = None) -> frozenset[Effect]:
    """Return the effects of `auto`, `all`, or names separated by commas; else InputError."""
    if names == "auto":
        return needed(scene, question)
    if names == "all":
        return ALL_EFFECTS
    requested = {name.strip() for name in names.split(",")}
    if requested & {"auto", "all"}:
        raise InputError(
            f"effects are auto, or all, or names separated by commas, and no mixture: not {names!r}"
        )
    for name in sorted(requested - set(Effect)):
        raise InputError(
            f"no effect is called {name!r}; use auto, or all, or names out of {', '.join(Effect)}"
        )
    return frozenset(map(Effect, requested))


def checked(effects: object) -> frozenset[Effect]:
    """Return effects from members or names; InputError for any other value."""
    if isinstance(effects, str) or not isinstance(effects, Iterable):
        raise InputError(
            f"effects must be a collection such as {{'c', 'diffuse'}}, not {effects!r}"
        )
    return frozenset(choice(Effect, effect, "an effect") for effect in effects)


@dataclass(frozen=True, kw_only=True)
class SlabContent:
    """Content of one slab of C or C*; a slab without triangles is not drawn."""

    camera: Camera
    heights: tuple[float, float]  #: |z| between which the slab lies
    triangles: int


def slab_contents(scene: Scene, settings: DoubleFrustum) -> tuple[SlabContent, ...]:
    """Return the content of every slab from back to front: of C inward, then of C* outward."""
    reach_viewer, reach_back = scene.frustum.reach
    behind = [
        slab_content(scene, Camera.C, heights)
        for heights in reversed(settings.sections(reach_back))
    ]
    before = [
        slab_content(scene, Camera.C_STAR, heights) for heights in settings.sections(reach_viewer)
    ]
    return tuple(
        content
        for content in (*behind, *before)
        if settings.camera in (Camera.BOTH, content.camera)
    )


def slab_content(scene: Scene, camera: Camera, heights: tuple[float, float]) -> SlabContent:
    """Return the content of one slab between two distances |z| on the side of a camera."""
    near, far = heights
    low, high = (-far, -near) if camera is Camera.C else (near, far)
    lowest, highest = scene.height_ranges
    count = int(np.count_nonzero((highest >= low) & (lowest <= high)))
    return SlabContent(camera=camera, heights=heights, triangles=count)
