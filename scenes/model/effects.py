"""The effects that a scene calls for, and why; and a bound of the space that images can show.

A scene that does not call for an effect has the same picture without it. What lies outside of the
bound is in no image and calls for none, but for light paths: surfaces out of sight cast shadows and
send light.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import reduce

import numpy as np

from xfrustum.scenes.appearance.appearance import Material
from xfrustum.scenes.arguments import choice
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.double_frustum import Camera, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

#: Smallest near, as a share of the longest reach, for which images are known to end at
#: `FAR_MARGIN`.
SMALLEST_NEAR_SHARE = 2.0**-16
#: Roundings of 2^-24 w in w - z, where clip depth z runs up to w at the far plane: two in z, one in
#: w, one in the difference, and four times as many for vertices and matrices that are rounded to
#: float32 before.
FAR_ROUNDINGS = 16
#: Factor by which a drawn image may reach farther than asked for. With `standard` and `gl` depth w
#: - z = n (f
#: - w) / (f - n) is a small difference of large numbers: a rounding of 2^-24 w moves the far plane
#: by a share 2^-24 f/n of w. At `SMALLEST_NEAR_SHARE` all are a sixteenth; twice that is allowed.
FAR_MARGIN = 1 / (1 - 2 * FAR_ROUNDINGS * 2.0**-24 / SMALLEST_NEAR_SHARE)
#: Margin of all lateral bounds, as a share of the largest term: a transform in float32 is off by at
#: most eight roundings of 2^-24 of the sum of its terms (raster/plate/clusters), and 2^-16 is 32
#: times as much.
ROUNDING_MARGIN = 2.0**-16
#: Triangles that are tried together: most objects are shown by one among the first.
TRIANGLES_AT_ONCE = 1 << 12


@dataclass(frozen=True, kw_only=True)
class Region:
    """The bound: all crossed frusta of a rectangle of apertures, widened by a near offset."""

    scene: Scene
    #: lowest and highest x, and y, of the points that lines run through
    apertures: tuple[tuple[float, float], ...]
    step: float  #: largest distance by which cameras step back, scene units; 0 for the true frusta
    unbounded: bool = False  #: whether near is so small that float32 knows no far plane

    @classmethod
    def from_scene(
        cls,
        scene: Scene,
        apertures: Iterable[Aperture] | None = None,
        settings: Sequence[DoubleFrustum] = (),
    ) -> Region:
        """Return the region of drawn images of some apertures with their cells; None for all of the plate.

        It is that of every near from `SMALLEST_NEAR_SHARE` of the reach up; only smaller ones need
        settings.
        """
        unbounded, step = (
            any(loses_far_plane(scene, one) for one in settings),
            scene.frustum.longest_reach,
        )
        return cls(scene=scene, apertures=_cells(scene, apertures), step=step, unbounded=unbounded)

    @classmethod
    def true(cls, scene: Scene, apertures: Iterable[Aperture] | None = None) -> Region:
        """Return the region of the true frusta of some apertures with their cells; None for all."""
        return cls(scene=scene, apertures=_cells(scene, apertures), step=0.0)

    def holds(self, low: Floats, high: Floats) -> Mask:
        """Return which axis-parallel boxes may have a part in the region; False is certain.

        `low` and `high` are (N, 3) lowest and highest coordinates of each box, scene units. At a
        distance d from the plate the lines of an aperture at a span the interval a + (m - a) z/Z -+
        t (d + n), where the screen has its middle m at the height Z. It is linear in d and in a
        each, so that over ranges of both its ends are extreme at the ranges' own ends.
        """
        held: Mask = np.zeros(len(low), dtype=np.bool_)
        for side, reach in zip((1.0, -1.0), self.scene.frustum.reach, strict=True):
            distances = side * low[:, 2], side * high[:, 2]
            nearest, farthest = np.minimum(*distances), np.maximum(*distances)
            end = math.inf if self.unbounded else FAR_MARGIN * reach
            inside = (farthest >= 0) & (nearest <= end)
            begin, stop = np.maximum(nearest, 0.0), np.minimum(np.maximum(farthest, 0.0), end)
            for axis in (0, 1):
                ends = [
                    self._interval(axis, a, d, side)
                    for a in self.apertures[axis]
                    for d in (begin, stop)
                ]
                lowest = np.minimum.reduce([middle - half for middle, half, _ in ends])
                highest = np.maximum.reduce([middle + half for middle, half, _ in ends])
                slack = ROUNDING_MARGIN * np.maximum.reduce([size for _, _, size in ends])
                inside &= (high[:, axis] >= lowest - slack) & (low[:, axis] <= highest + slack)
            held |= inside
        return held

    def _interval(
        self, axis: int, a: float, d: Floats, side: float
    ) -> tuple[Floats, Floats, Floats]:
        """Return middle and half width of the lines of an aperture at distances d, and their largest term."""
        frustum = self.scene.frustum
        if frustum.screen is None:
            assert frustum.fov is not None
            half = math.tan(frustum.fov[axis] / 2) * (d + self.step)
            return np.full_like(d, a), half, abs(a) + half
        slope = (frustum.screen.center[axis] - a) / frustum.screen.height
        # The shear of pivot `camera` is fixed at the camera, which moves the frustum aside by up to
        # a step.
        half = frustum.screen.size[axis] / 2 / abs(frustum.screen.height) * (d + self.step)
        half = half + abs(slope) * self.step
        return a + slope * side * d, half, abs(a) + abs(slope) * d + half

    def shows(self, part: SceneObject, faces: Indices | None = None) -> bool:
        """Return whether images may show one of an object's triangles, or of some; False is certain."""
        counted = part.faces if faces is None else faces
        if not self.holds(part.vertices.min(axis=0)[None], part.vertices.max(axis=0)[None])[0]:
            return False
        for start in range(0, len(counted), TRIANGLES_AT_ONCE):
            # Corner by corner, because numpy reduces over so short an axis several times slower.
            corners = part.vertices[counted[start : start + TRIANGLES_AT_ONCE]].transpose(1, 0, 2)
            if self.holds(reduce(np.minimum, corners), reduce(np.maximum, corners)).any():
                return True
        return False


def loses_far_plane(scene: Scene, settings: DoubleFrustum) -> bool:
    """Return whether a drawn image may show surfaces beyond `FAR_MARGIN` times the reach.

    That is so for tiny nears, unless clip depth is zero at the far plane (raster/cameras/cameras).
    """
    hyperbolic = settings.mapping in (DepthMapping.STANDARD, DepthMapping.GL)
    nearest = min((settings.near, *settings.slabs[:1]))
    return hyperbolic and nearest < SMALLEST_NEAR_SHARE * scene.frustum.longest_reach


def _cells(scene: Scene, apertures: Iterable[Aperture] | None) -> tuple[tuple[float, float], ...]:
    """Return the rectangle about the cells of some apertures; None for the plate itself."""
    plate = scene.plate
    if apertures is None:
        return tuple((-size / 2, size / 2) for size in plate.size)
    along = zip(*((aperture.x, aperture.y) for aperture in apertures), strict=True)
    halves = (size / count / 2 for size, count in zip(plate.size, plate.hogels, strict=True))
    return tuple(
        (min(places) - half, max(places) + half) for places, half in zip(along, halves, strict=True)
    )


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
    out_of_sight: tuple[
        int, ...
    ] = ()  #: of those that would, but lie beyond the reach or beside the frusta


@dataclass(frozen=True, kw_only=True)
class Question:
    """The images whose effects are decided on."""

    camera: Camera = Camera.BOTH  #: cameras that draw
    apertures: tuple[Aperture, ...] | None = None  #: None for all of the plate
    settings: tuple[
        DoubleFrustum, ...
    ] = ()  #: none are needed unless a near is tiny, see `Region.from_scene`


def decide(scene: Scene, question: Question | None = None) -> tuple[Decision, ...]:
    """Return the decision about every effect, for some images or all of the whole plate."""
    asked = question or Question()
    region = Region.from_scene(scene, asked.apertures, asked.settings)
    shown = [region.shows(part) for part in scene.objects]
    decisions = []
    for effect in Effect:
        inside: list[int] = []
        outside: list[int] = []
        refused = _refused(scene, effect, asked.camera)
        for number, part in enumerate(() if refused else scene.objects):
            faces = _calling_faces(effect, part, scene.materials[number])
            if faces is not None and faces.any():
                seen = shown[number] and (
                    bool(faces.all()) or region.shows(part, part.faces[faces])
                )
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
        return (
            None
            if environment.strength and environment.radiance.any()
            else "the environment is black"
        )
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
    aside = (
        f", but what has {them} lies beyond the reach or beside the frusta" if not inside else ""
    )
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
        raise InputError(
            f"effects are auto, or all, or names between commas, and no mixture: not {names!r}"
        )
    for name in sorted(asked - set(Effect)):
        raise InputError(
            f"no effect is called {name!r}; use auto, or all, or names out of {', '.join(Effect)}"
        )
    return frozenset(map(Effect, asked))


def checked(effects: object) -> frozenset[Effect]:
    """Return effects that are given as members or names as members; InputError where they are no such."""
    if isinstance(effects, str) or not isinstance(effects, Iterable):
        raise InputError(
            f"effects must be a collection such as {{'c', 'diffuse'}}, not {effects!r}"
        )
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
    behind = [
        _slab(scene, Camera.C, heights) for heights in reversed(settings.sections(reach_back))
    ]
    before = [_slab(scene, Camera.C_STAR, heights) for heights in settings.sections(reach_viewer)]
    return tuple(one for one in (*behind, *before) if settings.camera in (Camera.BOTH, one.camera))


def _slab(scene: Scene, camera: Camera, heights: tuple[float, float]) -> SlabContent:
    near, far = heights
    low, high = (-far, -near) if camera is Camera.C else (near, far)
    lowest, highest = scene.height_ranges
    count = int(np.count_nonzero((highest >= low) & (lowest <= high)))
    return SlabContent(camera=camera, heights=heights, triangles=count)
