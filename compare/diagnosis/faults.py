"""The faults of a renderer, in words with figures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from xfrustum.compare.diagnosis.geometry_fit import CORNER_PITCHES, GeometryFit
from xfrustum.compare.renderer_model import parameters
from xfrustum.compare.renderer_model.drawn_model import Culled, DrawnModel, Front, OneCamera, Recentering
from xfrustum.compare.renderer_model.parameters import Kind
from xfrustum.scenes.model.scene import Scene

ORIENTATION, ORDER, NEAR, PIVOT, FIT = "orientation", "aperture-order", "near", "pivot", "fit"
SHIFT, FOV, PITCH = ("shift-x", "shift-y"), ("fov-x", "fov-y"), ("pitch-x", "pitch-y")
APERTURE_OFFSET = ("aperture-offset-x", "aperture-offset-y")
SCENE_OFFSET = ("scene-offset-x", "scene-offset-y", "scene-offset-z")
SCENE_SCALE = "scene-scale"
SCREEN_CENTER, SCREEN_HEIGHT = ("screen-center-x", "screen-center-y"), "screen-height"
NOT_RECENTERED, SHEAR_SIGN = "not-recentered", "shear-sign"
BACK_NAMES, FRONT_NAMES = (
    tuple(
        f"{side}-{fault}"
        for fault in ("near-offset", "fov-x", "fov-y", "shift-x", "shift-y", "mirrored", "unturned")
    )
    for side in ("back", "front")
)
"""Faults of C alone (the half behind the plate), and of C* alone (the half before it)."""
TOGETHER = "together"
"""Several numbers none of which explains anything without the others."""
FRONT_MISSING, BACK_MISSING, FRONT_NEAREST, NOT_OVERLAID, CULLING, LIGHTS = (
    "front-missing",
    "back-missing",
    "front-nearest",
    "not-overlaid",
    "culling",
    "lights",
)

MISTAKEN_UNITS = {
    10.0: "millimeters taken for centimeters",
    0.1: "centimeters taken for millimeters",
    25.4: "millimeters taken for inches",
    1 / 25.4: "inches taken for millimeters",
    2.54: "centimeters taken for inches",
    1 / 2.54: "inches taken for centimeters",
    100.0: "centimeters taken for meters",
    0.01: "meters taken for centimeters",
    1000.0: "millimeters taken for meters",
    0.001: "meters taken for millimeters",
}
"""Common mistakes of units by the factor by which they enlarge a scene."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One fault that was found; its fields are those of the JSON object, in this order.

    Attributes
    ----------
    fault
        Short name of the fault.
    value
        Size of the fault as a number, or words.
    low, high
        Ends of the interval of a number; None where they are unknown.
    unit
        Unit of `value`, `low` and `high`; None for words.
    words
        One sentence about the fault, with its size.
    alternatives
        Names of faults that show the same images, or nearly the same, so that images cannot tell them apart.
    explains
        Share of the wrong pixels that the whole diagnosis explains; None where none is wrong.
    """

    fault: str
    value: float | str
    low: float | None = None
    high: float | None = None
    unit: str | None = None
    words: str
    alternatives: tuple[str, ...] = ()
    explains: float | None = None

    def summary(self) -> dict[str, Any]:
        """Return it as `verify --json` prints it."""
        return {**asdict(self), "alternatives": list(self.alternatives)}


def faults_of(scene: Scene, nominal: DrawnModel, found: DrawnModel, fit: GeometryFit) -> tuple[Fault, ...]:
    """Return the differences between a guess and the nominal model as faults.

    Parameters
    ----------
    scene
        Scene that was drawn; its units are named.
    nominal, found
        Model that was asked for, and the guess.
    fit
        Intervals of the numbers, and guesses that explain the images as well. A number is a fault if its
        interval leaves out the nominal value, and if it is large enough to have a name.
    """
    return (
        *_conventions(nominal, found),
        *_flipped(found),
        *_shear(scene, nominal, found, fit),
        *_numbers(scene, nominal, found, fit),
        *_halves(found, fit.alternatives),
    )


def with_joint_numbers(
    faults: Sequence[Fault], groups: Sequence[str], model: DrawnModel
) -> tuple[Fault, ...]:
    """Return faults with the numbers of some groups as one finding, for none explains anything alone."""
    names = [
        one_camera_name(name, model)
        for group in parameters.GROUPS
        if group.name in groups
        for name in group.faults
    ]
    joint = [fault for fault in faults if fault.fault in names]
    if len(joint) < 2:
        return tuple(faults)
    numbers = ", ".join(f"{fault.fault} {fault.value:.4g}" for fault in joint)
    words = "; ".join(fault.words for fault in joint)
    together = Fault(
        fault=TOGETHER,
        value=numbers,
        words=f"only together these numbers explain, and may stand for something else: {words}",
        alternatives=tuple(dict.fromkeys(other for fault in joint for other in fault.alternatives)),
    )
    return (*(fault for fault in faults if fault not in joint), together)


def lights_fault(back: float, front: float) -> Fault:
    """Return the fault of a light that is not conjugated, given both halves' correlations with the truth."""
    return Fault(
        fault=LIGHTS,
        value=front,
        unit="correlation",
        words=(
            "lights are not conjugated: on the viewer's side bright and dark are exchanged (correlation "
            f"with the truth {front:.2f}, behind the plate {back:.2f}); C* needs L* = -L"
        ),
    )


def _conventions(nominal: DrawnModel, found: DrawnModel) -> Iterator[Fault]:
    if found.orientation != nominal.orientation:
        words = found.orientation.words
        yield Fault(fault=ORIENTATION, value=words, words=f"images are {words}")
    if found.order != nominal.order:
        words = found.order.order_words
        yield Fault(fault=ORDER, value=words, words=f"apertures are in another order: {words}")
    if found.near and found.pivot is not nominal.pivot:
        words = f"the shear is centered in the {found.pivot}, not in the {nominal.pivot}"
        yield Fault(fault=PIVOT, value=str(found.pivot), words=words)
    if found.near and found.fit is not nominal.fit:
        words = f"the film is fitted to the {found.fit}, not to the {nominal.fit}"
        yield Fault(fault=FIT, value=str(found.fit), words=words)


def one_camera_name(name: str, model: DrawnModel) -> str:
    """Return the name of a fault of a guess's number: that of one camera alone says so."""
    one = model.one_camera
    if one is None or name not in (NEAR, *FOV, *SHIFT):
        return name
    return f"{_half(one)}-{'near-offset' if name == NEAR else name}"


def _half(one: OneCamera) -> str:
    return "back" if one.side > 0 else "front"


def _flipped(found: DrawnModel) -> Iterator[Fault]:
    """Yield the fault of one camera whose film is mirrored, if there is one."""
    one = found.one_camera
    if one is None or not one.flipped:
        return
    half = "behind" if one.side > 0 else "before"
    if one.flip_x and one.flip_y:
        how = "C* looks back, so that its picture is to be turned by 180 degrees, and is not"
        words = f"the half {half} the plate is turned by 180 degrees" + (f": {how}" if one.side < 0 else "")
        yield Fault(fault=f"{_half(one)}-unturned", value="turned by 180 degrees", words=words)
        return
    axis = "left to right" if one.flip_x else "upside down"
    words = f"the half {half} the plate is mirrored {axis}"
    yield Fault(fault=f"{_half(one)}-mirrored", value=f"mirrored {axis}", words=words)


def _shear(scene: Scene, nominal: DrawnModel, found: DrawnModel, fit: GeometryFit) -> Iterator[Fault]:
    """Yield the fault in the way cameras are sheared, if there is one."""
    if found.recentering is nominal.recentering:
        return
    name, words = _shear_words(found.recentering)
    value = "no shear" if name == NOT_RECENTERED else str(found.recentering)
    others: dict[str, None] = {}
    reversed_too: dict[str, None] = {}
    for model in fit.alternatives:
        if model.recentering is nominal.recentering:
            others |= dict.fromkeys(_odd(scene, nominal, model))
        elif model.recentering is not found.recentering:
            reversed_too[f"of {model.recentering}"] = None
    if reversed_too:
        words += f" (or the shear {', or '.join(reversed_too)} is reversed: {_witnesses(fit)} cannot tell)"
    if others:
        words += f"; or {', '.join(others)}: {_witnesses(fit)} cannot tell"
    yield Fault(fault=name, value=value, words=words, alternatives=tuple(others))


def _shear_words(recentering: Recentering) -> tuple[str, str]:
    """Return name and words of the fault of a wrong shear."""
    if recentering is Recentering.NONE:
        words = "frusta are not recentered: every aperture looks straight ahead, not at the projection screen"
        return NOT_RECENTERED, words
    if recentering is Recentering.BOTH_REVERSED:
        return SHEAR_SIGN, "C and C* are sheared the wrong way, as for a screen on the plate's other side"
    other = "C" if recentering is Recentering.C_STAR_REVERSED else "C*"
    words = f"{recentering} is sheared the way of {other}; with respect to the plate the two are sheared in "
    return SHEAR_SIGN, words + "opposite directions"


def _numbers(scene: Scene, nominal: DrawnModel, found: DrawnModel, fit: GeometryFit) -> Iterator[Fault]:
    units = {Kind.PIXELS: "px", Kind.FACTOR: "ratio", Kind.SIZE: "ratio"}
    places = (*SCREEN_CENTER, SCREEN_HEIGHT)
    values = zip(
        parameters.FAULT_NAMES,
        parameters.KINDS,
        parameters.smallest_named(scene),
        nominal.parameters,
        found.parameters,
        fit.low,
        fit.high,
        strict=True,
    )
    named: dict[str, tuple[str | None, float, float, float, float]] = {}
    for name, kind, smallest, should, value, least, most in values:
        if abs(value - should) > smallest and not least <= should <= most:
            stated, nominally, *ends = (
                _written(name, scene, float(number)) for number in (value, should, least, most)
            )
            unit_of = scene.units if name in places else units.get(kind, scene.units)
            named[name] = unit_of, stated, nominally, min(ends), max(ends)
    for name, (unit, value, should, least, most) in named.items():
        own = one_camera_name(name, found)
        named_so = frozenset(one_camera_name(one, found) for one in named)
        others = _alternatives(own, scene, nominal, fit.alternatives, named_so)
        words = _number_words(name, scene, value, should)
        if own != name:
            camera = "C" if own.startswith("back") else "C*"
            words = words.replace("both cameras step", f"{camera} alone steps")
            words = words if name == NEAR else f"by {camera} alone, {words}"
        if name == SCENE_SCALE:
            words += _unit_words(value, least, most)
        yield Fault(
            fault=own,
            value=value,
            low=least if math.isfinite(least) else None,
            high=most if math.isfinite(most) else None,
            unit=unit,
            words=words + _others_words(others, scene, nominal, fit),
            alternatives=others,
        )


def _written(name: str, scene: Scene, number: float) -> float:
    """Return a parameter as a fault states it: the place of a screen in scene units, others as they are."""
    screen = scene.frustum.screen
    if screen is None:
        return number
    if name in SCREEN_CENTER:
        return screen.center[SCREEN_CENTER.index(name)] + number
    return screen.height * number if name == SCREEN_HEIGHT else number


def _witnesses(fit: GeometryFit) -> str:
    if fit.by_color:
        return "object numbers" if fit.by_objects else "colors"
    return "images"


def _alternatives(
    name: str, scene: Scene, nominal: DrawnModel, models: Sequence[DrawnModel], named: frozenset[str]
) -> tuple[str, ...]:
    """Return the faults that other guesses have instead of the named one, preferably along the same axis."""
    kind: dict[str, Kind] = dict(zip(parameters.FAULT_NAMES, parameters.KINDS, strict=True))
    kind |= {f"{half}-{fault}": kind[fault] for half in ("front", "back") for fault in (*FOV, *SHIFT)}
    kind |= {"front-near-offset": Kind.NEAR, "back-near-offset": Kind.NEAR}
    ratios = (Kind.FACTOR, Kind.SIZE)
    found: dict[str, None] = {}
    for model in models:
        other = _odd(scene, nominal, model)
        # A guess that has this fault too is no alternative to it.
        if name in other:
            continue
        other = [fault for fault in other if fault not in named]
        # If a guess has several, a ratio replaces a ratio, and a length a length along the same axis.
        alike = [fault for fault in other if (kind.get(fault) in ratios) == (kind[name] in ratios)] or other
        along = [fault for fault in alike if _axis(fault) in ("", _axis(name)) or not _axis(name)]
        found |= dict.fromkeys(along or alike)
    return tuple(found)


def _others_words(others: tuple[str, ...], scene: Scene, nominal: DrawnModel, fit: GeometryFit) -> str:
    """Return words for the alternatives of a fault; a near offset with another pivot is named with both."""
    if not others:
        return ""
    pivots = {model.pivot for model in fit.alternatives if NEAR in _odd(scene, nominal, model)}
    also = f" with the shear centered in the {', or '.join(pivots)}" if nominal.pivot not in pivots else ""
    said = [other + (also if other == NEAR else "") for other in others]
    return f"; or {', '.join(said)}: {_witnesses(fit)} cannot tell"


def _odd(scene: Scene, nominal: DrawnModel, model: DrawnModel) -> list[str]:
    """Return the names of the faults of a guess in its shear and in its numbers."""
    off = np.abs(model.parameters - nominal.parameters) > parameters.smallest_named(scene)
    names = [
        one_camera_name(fault, model) for fault, odd in zip(parameters.FAULT_NAMES, off, strict=True) if odd
    ]
    names = [*(fault.fault for fault in _flipped(model)), *names]
    if model.recentering is nominal.recentering:
        return names
    return [_shear_words(model.recentering)[0], *names]


def _axis(fault: str) -> str:
    return fault[-1] if fault[-2:] in ("-x", "-y", "-z") else ""


def _number_words(name: str, scene: Scene, value: float, should: float) -> str:  # noqa: PLR0911 - one per kind
    if name in SHIFT:
        side = (("left", "right"), ("above", "below"))[SHIFT.index(name)][value > 0]
        side = f"{side} their centers" if name == SHIFT[1] else f"to the {side} of their centers"
        return f"pixels are sampled {abs(value):.3f} px {side} (images upright)"
    if name in FOV:
        return _fov_words(FOV.index(name), scene, value)
    if name in PITCH:
        axis = PITCH.index(name)
        size = scene.plate.size[axis]
        return (
            f"apertures are {value:.5g} times as far apart in {'xy'[axis]}: as on a plate of "
            f"{value * size:.5g} {scene.units} instead of {size:.5g}"
        )
    if name in APERTURE_OFFSET:
        return _aperture_words(APERTURE_OFFSET.index(name), scene, value)
    if name in SCENE_OFFSET or name == SCENE_SCALE:
        return _scene_words(name, scene, value)
    if name == SCREEN_HEIGHT or name in SCREEN_CENTER:
        return _screen_words(name, scene, value, should)
    stated = f", not by {should:.5g}" if should else ", which nobody mentioned"
    return f"both cameras step back by a near offset of {value:.5g} {scene.units}{stated}"


def _screen_words(name: str, scene: Scene, value: float, should: float) -> str:
    place = "at height " if name == SCREEN_HEIGHT else f"centered at {'xy'[SCREEN_CENTER.index(name)]} = "
    return f"the projection screen is {place}{value:.5g} {scene.units} instead of {should:.5g}"


def _scene_words(name: str, scene: Scene, value: float) -> str:
    if name in SCENE_OFFSET:
        toward = (("the left", "the right"), ("below", "above"), ("the back", "the viewer"))
        side = toward[SCENE_OFFSET.index(name)][value > 0]
        return f"the scene is moved by {abs(value):.5g} {scene.units} {_to(side)}"
    return f"the scene is {value:.5g} times as large as asked, about the origin"


def _to(side: str) -> str:
    return {"below": "downward", "above": "upward", "the viewer": "toward the viewer"}.get(side, f"to {side}")


def _fov_words(axis: int, scene: Scene, value: float) -> str:
    text = f"the film is {value:.5g} times as {('wide', 'high')[axis]} as the scene's"
    if scene.frustum.fov is None:
        return text
    angle = scene.frustum.fov[axis]
    drawn = math.degrees(2 * math.atan(math.tan(angle / 2) * value))
    return f"{text}: {drawn:.4g} degrees instead of {math.degrees(angle):.4g}"


def _aperture_words(axis: int, scene: Scene, value: float) -> str:
    side = (("to the left", "to the right"), ("downward", "upward"))[axis][value > 0]
    words = f"all apertures are moved by {abs(value):.5g} {scene.units} {side}"
    half = scene.plate.size[axis] / scene.plate.hogels[axis] / 2
    if abs(abs(value) - half) <= CORNER_PITCHES * 2 * half:
        words += ": half a pitch, as at the corners of hogels instead of their centers"
    return words


def _unit_words(value: float, low: float, high: float) -> str:
    """Return words for the mistake of units whose factor lies in an interval; empty where none does."""
    if not math.isfinite(low + high):
        low = high = value
    for factor, mistake in MISTAKEN_UNITS.items():
        if low <= factor <= high:
            return f": {mistake}"
    return ""


def _halves(found: DrawnModel, models: Sequence[DrawnModel]) -> Iterator[Fault]:
    named = [[name for name, _, _ in _of_halves(model)] for model in models]
    for name, value, words in _of_halves(found):
        # A guess that has this fault too is no alternative to it.
        others = list(dict.fromkeys(other for names in named if name not in names for other in names))
        also = f"; or {', '.join(others)}: images cannot tell" if others else ""
        yield Fault(fault=name, value=value, words=words + also, alternatives=tuple(others))


def _of_halves(found: DrawnModel) -> Iterator[tuple[str, str, str]]:
    """Yield name, value and words of each fault in the way the halves are put together."""
    if found.front is Front.MISSING:
        yield FRONT_MISSING, "missing", "the half on the viewer's side is missing: only C is drawn"
    if found.back_missing:
        yield BACK_MISSING, "missing", "the half behind the plate is missing: only C* is drawn"
    if found.front is Front.NEAREST:
        words = "on the viewer's side the surface nearest to the plate wins; C* must keep the farthest"
        yield FRONT_NEAREST, "nearest wins", words
    if not found.overlaid:
        yield NOT_OVERLAID, "back over front", "C is drawn over C*; the viewer's half must cover the other"
    if found.culled is not Culled.NONE:
        words = f"faces whose corners run {found.culled} as the viewer sees them are left out"
        yield CULLING, str(found.culled), words
