"""The faults of a renderer, in words with figures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from xfrustum.compare.diagnosis.geometry_fit import CORNER_PITCHES, GeometryFit
from xfrustum.compare.diagnosis.hypotheses import found_in
from xfrustum.compare.renderer_model import parameters
from xfrustum.compare.renderer_model.drawn_model import DrawnModel, Recentering
from xfrustum.compare.renderer_model.parameters import Kind
from xfrustum.scenes.model.scene import Scene

ORIENTATION, ORDER, NEAR, PIVOT, FIT = "orientation", "aperture-order", "near", "pivot", "fit"
NOT_RECENTERED, SHEAR_SIGN = "not-recentered", "shear-sign"
LIGHTS, VIEW_SHEAR = "lights", "view-shear"
TOGETHER = "together"
"""Several numbers none of which explains anything without the others."""

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


def faults_of(scene: Scene, nominal: DrawnModel, fit: GeometryFit) -> tuple[Fault, ...]:
    """Return the differences between a guess and the nominal model as faults.

    Parameters
    ----------
    scene
        Scene that was drawn; its units are named.
    nominal
        Model that was asked for.
    fit
        The guess, intervals of its numbers, and guesses that explain the images as well. A number is a fault
        if its interval leaves out the nominal value, and if it is large enough to have a name.
    """
    return (
        *_conventions(nominal, fit.model),
        *_shear(scene, nominal, fit),
        *_numbers(scene, nominal, fit),
        *_halves(fit),
    )


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


def with_joint_numbers(
    faults: Sequence[Fault], groups: Sequence[str], model: DrawnModel
) -> tuple[Fault, ...]:
    """Return faults with the numbers of some groups as one finding, for none explains anything alone."""
    names = [one_camera_name(parameters.FAULT_NAMES[place], model) for place in parameters.places(*groups)]
    joint = [fault for fault in faults if fault.fault in names]
    if len(joint) < 2:
        return tuple(faults)
    together = Fault(
        fault=TOGETHER,
        value=", ".join(f"{fault.fault} {fault.value:.4g}" for fault in joint),
        words="only together these numbers explain, and may stand for something else: "
        + "; ".join(fault.words for fault in joint),
        alternatives=tuple(dict.fromkeys(other for fault in joint for other in fault.alternatives)),
    )
    return (*(fault for fault in faults if fault not in joint), together)


def one_camera_name(name: str, model: DrawnModel) -> str:
    """Return the name of a fault of a guess's number: that of one camera alone says so."""
    one = model.one_camera
    if one is None or name.removesuffix("-x").removesuffix("-y") not in parameters.CAMERA_GROUPS:
        return name
    return f"{'back' if one.side > 0 else 'front'}-{'near-offset' if name == NEAR else name}"


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


def _shear(scene: Scene, nominal: DrawnModel, fit: GeometryFit) -> Iterator[Fault]:
    """Yield the fault in the way cameras are sheared, if there is one."""
    found = fit.model
    if found.recentering is nominal.recentering:
        return
    name, words = _shear_words(found.recentering)
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
    value = "no shear" if name == NOT_RECENTERED else str(found.recentering)
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


def _halves(fit: GeometryFit) -> Iterator[Fault]:
    """Yield the mistakes without numbers, such as the way in which the halves are put together."""
    named = [[one.fault for one in found_in(model)] for model in fit.alternatives]
    for one in found_in(fit.model):
        # A guess that has this fault too is no alternative to it.
        others = dict.fromkeys(other for names in named if one.fault not in names for other in names)
        also = f"; or {', '.join(others)}: images cannot tell" if others else ""
        yield Fault(fault=one.fault, value=one.value, words=one.words + also, alternatives=tuple(others))


def _numbers(scene: Scene, nominal: DrawnModel, fit: GeometryFit) -> Iterator[Fault]:
    """Yield the faults of numbers that are off, with their intervals."""
    found, asked, least, most = fit.model.parameters, nominal.parameters, fit.low, fit.high
    off = np.abs(found - asked) > parameters.smallest_named(scene)
    odd = np.flatnonzero(off & ~((least <= asked) & (asked <= most)))
    named = [one_camera_name(parameters.FAULT_NAMES[place], fit.model) for place in odd]
    for place, own in zip(odd.tolist(), named, strict=True):
        name, kind = parameters.FAULT_NAMES[place], parameters.KINDS[place]
        value, should, *ends = (
            _written(name, scene, float(numbers[place])) for numbers in (found, asked, least, most)
        )
        low, high = min(ends), max(ends)
        words = _number_words(name, scene, value, should)
        if own != name:
            camera = "C" if own.startswith("back") else "C*"
            alone = words.replace("both cameras step", f"{camera} alone steps")
            words = alone if name == NEAR else f"by {camera} alone, {words}"
        if name == "scene-scale":
            words += _unit_words(value, low, high)
        others = _alternatives(own, scene, nominal, fit.alternatives, frozenset(named))
        yield Fault(
            fault=own,
            value=value,
            low=low if math.isfinite(low) else None,
            high=high if math.isfinite(high) else None,
            unit=_unit(name, kind, scene),
            words=words + _others_words(others, scene, nominal, fit),
            alternatives=others,
        )


def _unit(name: str, kind: Kind, scene: Scene) -> str:
    if name.startswith("screen-"):
        return scene.units
    return {Kind.PIXELS: "px", Kind.FACTOR: "ratio", Kind.SIZE: "ratio"}.get(kind, scene.units)


def _written(name: str, scene: Scene, number: float) -> float:
    """Return a number as a fault states it: the place of a screen in scene units, others as they are."""
    screen = scene.frustum.screen
    if screen is None or not name.startswith("screen-"):
        return number
    return screen.height * number if name == "screen-height" else screen.center["xy".index(name[-1])] + number


def _witnesses(fit: GeometryFit) -> str:
    if fit.by_color:
        return "object numbers" if fit.by_objects else "colors"
    return "images"


def _odd(scene: Scene, nominal: DrawnModel, model: DrawnModel) -> list[str]:
    """Return the names of the faults of a guess in its shear, its mirrored films and its numbers."""
    off = np.abs(model.parameters - nominal.parameters) > parameters.smallest_named(scene)
    names = [one_camera_name(parameters.FAULT_NAMES[place], model) for place in np.flatnonzero(off)]
    if model.one_camera is not None:
        names = [*(one.fault for one in found_in(model) if "one_camera" in one.fields), *names]
    if model.recentering is nominal.recentering:
        return names
    return [_shear_words(model.recentering)[0], *names]


def _alternatives(
    name: str, scene: Scene, nominal: DrawnModel, models: Sequence[DrawnModel], named: frozenset[str]
) -> tuple[str, ...]:
    """Return the faults that other guesses have instead of the named one, preferably along the same axis."""
    found: dict[str, None] = {}
    for model in models:
        other = _odd(scene, nominal, model)
        # A guess that has this fault too is no alternative to it.
        if name in other:
            continue
        other = [fault for fault in other if fault not in named]
        # If a guess has several, a ratio replaces a ratio, and a length a length along the same axis.
        alike = [fault for fault in other if _is_ratio(fault) == _is_ratio(name)] or other
        along = [fault for fault in alike if _axis(fault) in ("", _axis(name)) or not _axis(name)]
        found |= dict.fromkeys(along or alike)
    return tuple(found)


def _is_ratio(fault: str) -> bool:
    kinds = dict(zip(parameters.FAULT_NAMES, parameters.KINDS, strict=True))
    return kinds.get(fault.removeprefix("front-").removeprefix("back-")) in (Kind.FACTOR, Kind.SIZE)


def _axis(fault: str) -> str:
    return fault[-1] if fault[-2:] in ("-x", "-y", "-z") else ""


def _others_words(others: tuple[str, ...], scene: Scene, nominal: DrawnModel, fit: GeometryFit) -> str:
    """Return words for the alternatives of a fault; a near offset with another pivot is named with both."""
    if not others:
        return ""
    pivots = {model.pivot for model in fit.alternatives if NEAR in _odd(scene, nominal, model)}
    also = f" with the shear centered in the {', or '.join(pivots)}" if nominal.pivot not in pivots else ""
    said = [other + (also if other == NEAR else "") for other in others]
    return f"; or {', '.join(said)}: {_witnesses(fit)} cannot tell"


def _number_words(name: str, scene: Scene, value: float, should: float) -> str:  # noqa: PLR0911 - a group each
    """Return a number that is off in words; `value` and `should` are as `_written`."""
    axis = "xyz".find(_axis(name) or "x")
    group, units, sign = name.removesuffix(f"-{_axis(name)}"), scene.units, value > 0
    size = f"{abs(value):.5g} {units}"
    if group == "shift":
        where = ("to the left of", "to the right of")[sign] if axis == 0 else ("above", "below")[sign]
        return f"pixels are sampled {abs(value):.3f} px {where} their centers (images upright)"
    if group == "fov":
        text = f"the film is {value:.5g} times as {('wide', 'high')[axis]} as the scene's"
        if scene.frustum.fov is None:
            return text
        angle = scene.frustum.fov[axis]
        drawn = math.degrees(2 * math.atan(math.tan(angle / 2) * value))
        return f"{text}: {drawn:.4g} degrees instead of {math.degrees(angle):.4g}"
    if group == "pitch":
        plate = scene.plate.size[axis]
        far = f"apertures are {value:.5g} times as far apart in {'xy'[axis]}"
        return f"{far}: as on a plate of {value * plate:.5g} {units} instead of {plate:.5g}"
    if group == "aperture-offset":
        half = scene.plate.size[axis] / scene.plate.hogels[axis] / 2
        side = (("to the left", "to the right"), ("downward", "upward"))[axis][sign]
        corner = abs(abs(value) - half) <= CORNER_PITCHES * 2 * half
        also = ": half a pitch, as at the corners of hogels instead of their centers" if corner else ""
        return f"all apertures are moved by {size} {side}{also}"
    if group == "scene-offset":
        sides = (
            ("to the left", "to the right"),
            ("downward", "upward"),
            ("to the back", "toward the viewer"),
        )
        return f"the scene is moved by {size} {sides[axis][sign]}"
    if group == "scene-scale":
        return f"the scene is {value:.5g} times as large as asked, about the origin"
    if group.startswith("screen-"):
        place = "at height " if group == "screen-height" else f"centered at {'xy'[axis]} = "
        return f"the projection screen is {place}{value:.5g} {units} instead of {should:.5g}"
    stated = f", not by {should:.5g}" if should else ", which nobody mentioned"
    return f"both cameras step back by a near offset of {value:.5g} {units}{stated}"


def _unit_words(value: float, low: float, high: float) -> str:
    """Return words for the mistake of units whose factor lies in an interval; empty where none does."""
    if not math.isfinite(low + high):
        low = high = value
    return next((f": {words}" for factor, words in MISTAKEN_UNITS.items() if low <= factor <= high), "")
