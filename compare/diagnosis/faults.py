"""The faults of a renderer: the table of mistakes without numbers, and the words of all.

A `Hypothesis` says which fields of `RendererModel` differ, and the fault in words. Every one is
tried on the images by itself (`find_composition`), and found again in a guess (`found_in`). Faults
with numbers are the groups of `xfrustum.compare.renderer_model.drawn_model`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from xfrustum.compare.diagnosis.geometry_fit import (
    CORNER_PITCHES,
    UNSEEN_NEAR_PER_REACH,
    GeometryFit,
)
from xfrustum.compare.renderer_model.drawn_model import (
    CAMERA_GROUPS,
    FAULT_NAMES,
    FLIPPED,
    KINDS,
    Back,
    Culled,
    Film,
    Front,
    Kind,
    Normals,
    OneCamera,
    Recentering,
    RendererModel,
    places,
    smallest_named,
)
from xfrustum.scenes.model.scene import Scene

ORIENTATION, ORDER, NEAR, PIVOT, FIT = "orientation", "aperture-order", "near", "pivot", "fit"
NOT_RECENTERED, SHEAR_SIGN, VIEW_SHEAR = "not-recentered", "shear-sign", "view-shear"
EQUAL_ANGLES, WRAPPED, RESAMPLED = "equal-angles", "wrapped", "resampled"
TOGETHER = "together"  # Several numbers none of which explains anything without the others

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
class Defect:
    """One fault that was found; its fields are those of the JSON object, in this order."""

    fault: str
    value: float | str  # its size as a number, or words
    low: float | None = None  # ends of the interval of a number; None where they are unknown
    high: float | None = None
    unit: str | None = None  # of `value`, `low` and `high`; None for words
    words: str  # one sentence, with its size
    alternatives: tuple[str, ...] = ()  # faults that show the same images, or nearly the same
    explains: float | None = None  # share of the wrong pixels that the whole diagnosis explains

    def summary(self) -> dict[str, Any]:
        """Return it as `verify --json` prints it."""
        return {**asdict(self), "alternatives": list(self.alternatives)}


@dataclass(frozen=True)
class Hypothesis:
    """One mistake: the fault's name, value and words, and the fields of `RendererModel` by which it draws."""

    fault: str
    value: str
    words: str
    fields: Mapping[str, Any] = field(hash=False)

    def of(self, model: RendererModel) -> RendererModel:
        """Return a guess with this mistake."""
        fields = dict(self.fields)
        if "one_camera" in fields:
            fields["one_camera"] = replace(fields["one_camera"], other_near=model.near)
        return replace(model, **fields)


def _flipped(one: OneCamera) -> Hypothesis:
    half, where = ("back", "behind") if one.side > 0 else ("front", "before")
    kind, value = "mirrored", f"mirrored {'left to right' if one.flip_x else 'upside down'}"
    if one.flip_x and one.flip_y:
        kind, value = "unturned", "turned by 180 degrees"
    words = f"the half {where} the plate is {value}"
    if (half, kind) == ("front", "unturned"):
        words += ": C* looks back, so that its picture is to be turned by 180 degrees, and is not"
    return Hypothesis(f"{half}-{kind}", value, words, {"one_camera": one})


def _culled(culled: Culled) -> Hypothesis:
    words = f"faces whose corners run {culled} as the viewer sees them are left out"
    return Hypothesis("culling", str(culled), words, {"culled": culled})


NEAREST = Hypothesis(
    "front-nearest",
    "nearest wins",
    "on the viewer's side the surface nearest to the plate wins; C* must keep the farthest",
    {"front": Front.NEAREST},
)
NOT_OVERLAID = Hypothesis(
    "not-overlaid",
    "back over front",
    "C is drawn over C*; the viewer's half must cover the other",
    {"overlaid": False},
)
LIGHTS = Hypothesis(
    "lights",
    "not conjugated",
    "lights are not conjugated: on the viewer's side bright and dark are exchanged; C* needs L* = -L",
    {"conjugated": False},
)
FLAT = Hypothesis(
    "flat-normals",
    "flat",
    "triangles are shaded with their own normals: the scene's are interpolated between vertices",
    {"normals": Normals.FLAT},
)
INVERTED = Hypothesis(
    "inverted-normals",
    "inverted",
    "surfaces are lit from the wrong side: normals point away from the viewer, or all lights are reversed",
    {"normals": Normals.INVERTED},
)
FRONT_MISSING = Hypothesis(
    "front-missing",
    "missing",
    "the half on the viewer's side is missing: only C is drawn",
    {"front": Front.MISSING},
)
BACK_MISSING = Hypothesis(
    "back-missing",
    "missing",
    "the half behind the plate is missing: only C* is drawn",
    {"back": Back.MISSING},
)
BACK_FARTHEST = Hypothesis(
    "back-farthest",
    "farthest wins",
    "behind the plate the surface farthest from it wins; C must keep the nearest",
    {"back": Back.FARTHEST},
)

SHADINGS = (LIGHTS, FLAT, INVERTED)
"""Mistakes of shading, which only colors show."""

HYPOTHESES = (
    *(FRONT_MISSING, BACK_MISSING, NEAREST, NOT_OVERLAID),
    *map(_culled, (Culled.COUNTERCLOCKWISE, Culled.CLOCKWISE)),
    # Of a convex body faces away from the viewer are the farthest ones; who culls is more common.
    BACK_FARTHEST,
    *map(_flipped, FLIPPED),
    *SHADINGS,
)
"""All of them; of those that images cannot tell apart, the one that comes first here is named first."""

FIELDS = tuple(
    dict.fromkeys(name for one in HYPOTHESES for name in one.fields if name != "one_camera")
)
"""Fields of `RendererModel` that say how the halves are put together and lit."""


def found_in(model: RendererModel) -> list[Hypothesis]:
    """Return the mistakes that a guess has."""
    one = model.one_camera
    # The near offset of the camera that is right is no mistake.
    plain = replace(model, one_camera=one and replace(one, other_near=0.0))
    return [
        one
        for one in HYPOTHESES
        if all(getattr(plain, name) == value for name, value in one.fields.items())
    ]


def faults_of(scene: Scene, nominal: RendererModel, fit: GeometryFit) -> tuple[Defect, ...]:
    """Return the differences between a guess and the nominal model as faults.

    A number is a fault if its interval leaves out the nominal value, and if it is large enough to
    have a name.
    """
    found, names = fit.model, [_names(scene, nominal, model) for model in fit.alternatives]
    witnesses = ("object numbers" if fit.by_objects else "colors") if fit.by_color else "images"
    faults = []
    if found.orientation != nominal.orientation:
        words = found.orientation.words[0]
        faults.append(Defect(fault=ORIENTATION, value=words, words=f"images are {words}"))
    if found.order != nominal.order:
        words = found.order.words[1]
        faults.append(
            Defect(fault=ORDER, value=words, words=f"apertures are in another order: {words}")
        )
    if found.near and found.pivot is not nominal.pivot:
        words = f"the shear is centered in the {found.pivot}, not in the {nominal.pivot}"
        faults.append(Defect(fault=PIVOT, value=str(found.pivot), words=words))
    if found.near and found.fit is not nominal.fit:
        words = f"the film is fitted to the {found.fit}, not to the {nominal.fit}"
        faults.append(Defect(fault=FIT, value=str(found.fit), words=words))
    if found.recentering is not nominal.recentering:
        name, words = _shear_words(found.recentering)
        shears = dict.fromkeys(model.recentering for model in fit.alternatives)
        reversed_too = [
            f"of {one}" for one in shears if one not in (nominal.recentering, found.recentering)
        ]
        if reversed_too:
            words += (
                f" (or the shear {', or '.join(reversed_too)} is reversed: {witnesses} cannot tell)"
            )
        # A guess that has this fault too is no alternative to it; so it is below.
        others = tuple(dict.fromkeys(other for of in names if name not in of for other in of))
        words += f"; or {', '.join(others)}: {witnesses} cannot tell" if others else ""
        value = "no shear" if name == NOT_RECENTERED else str(found.recentering)
        faults.append(Defect(fault=name, value=value, words=words, alternatives=others))
    if found.film != nominal.film:
        faults += _of_film(found.film)
    faults += _numbers(scene, nominal, fit, witnesses)
    for one in found_in(found):
        of_ways = [[other.fault for other in found_in(model)] for model in fit.alternatives]
        others = tuple(
            dict.fromkeys(other for of in of_ways if one.fault not in of for other in of)
        )
        also = f"; or {', '.join(others)}: images cannot tell" if others else ""
        faults.append(
            Defect(fault=one.fault, value=one.value, words=one.words + also, alternatives=others)
        )
    return tuple(faults)


def _of_film(film: Film) -> Iterator[Defect]:
    """Yield the faults of a film on which pixels are not spaced evenly."""
    if film.angles:
        value = "x and y" if film.angles == "xy" else film.angles
        words = f"pixels are spaced by equal angles along {value}: a flat film has equal tangents"
        yield Defect(fault=EQUAL_ANGLES, value=value, words=words)
    if film.unsheared or any(film.rolled):
        (x, y), told = film.rolled, "in place of the frustum's shear"
        if not film.unsheared:
            sides = [f"{abs(x)} px to the {'right' if x > 0 else 'left'}"] if x else []
            sides += [f"{abs(y)} px {'down' if y > 0 else 'up'}"] if y else []
            told = "by " + " and ".join(sides)
        words = f"images are rolled {told}: what leaves on one side comes in on the other"
        yield Defect(fault=WRAPPED, value=told, words=words)
    if film.size != 1:
        how = "interpolated" if film.smooth else "the nearest pixel was taken"
        words = f"images were drawn at {film.size:.4g} of their resolution and enlarged: {how}"
        yield Defect(fault=RESAMPLED, value=film.size, unit="ratio", words=words)


def with_joint_numbers(
    faults: Sequence[Defect], groups: Sequence[str], model: RendererModel
) -> tuple[Defect, ...]:
    """Return faults with the numbers of some groups as one finding, for none explains anything alone."""
    names = [one_camera_name(FAULT_NAMES[place], model) for place in places(*groups)]
    joint = [fault for fault in faults if fault.fault in names]
    if len(joint) < 2:
        return tuple(faults)
    together = Defect(
        fault=TOGETHER,
        value=", ".join(f"{fault.fault} {fault.value:.4g}" for fault in joint),
        words="only together these numbers explain, and may stand for something else: "
        + "; ".join(fault.words for fault in joint),
        alternatives=tuple(dict.fromkeys(other for fault in joint for other in fault.alternatives)),
    )
    return (*(fault for fault in faults if fault not in joint), together)


def one_camera_name(name: str, model: RendererModel) -> str:
    """Return the name of a fault of a guess's number: that of one camera alone says so."""
    one = model.one_camera
    if one is None or name.removesuffix("-x").removesuffix("-y") not in CAMERA_GROUPS:
        return name
    return f"{'back' if one.side > 0 else 'front'}-{'near-offset' if name == NEAR else name}"


def _shear_words(recentering: Recentering) -> tuple[str, str]:
    """Return name and words of the fault of a wrong shear."""
    if recentering is Recentering.NONE:
        words = "frusta are not recentered: every aperture looks straight ahead, not at the projection screen"
        return NOT_RECENTERED, words
    if recentering is Recentering.BOTH_REVERSED:
        return (
            SHEAR_SIGN,
            "C and C* are sheared the wrong way, as for a screen on the plate's other side",
        )
    other = "C" if recentering is Recentering.C_STAR_REVERSED else "C*"
    words = f"{recentering} is sheared the way of {other}; with respect to the plate the two are sheared in "
    return SHEAR_SIGN, words + "opposite directions"


def _names(scene: Scene, nominal: RendererModel, model: RendererModel) -> list[str]:
    """Return the names of the faults of a guess in its shear, its mirrored films and its numbers."""
    off = np.abs(model.parameters - nominal.parameters) > smallest_named(scene)
    names = [] if model.recentering is nominal.recentering else [_shear_words(model.recentering)[0]]
    names += [one.fault for one in found_in(model) if "one_camera" in one.fields]
    return names + [one_camera_name(FAULT_NAMES[place], model) for place in np.flatnonzero(off)]


def _numbers(
    scene: Scene, nominal: RendererModel, fit: GeometryFit, witnesses: str
) -> Iterator[Defect]:
    """Yield the faults of numbers that are off, with their intervals."""
    found, asked, least, most = fit.model.parameters, nominal.parameters, fit.low, fit.high
    odd = np.flatnonzero(
        (np.abs(found - asked) > smallest_named(scene)) & ~((least <= asked) & (asked <= most))
    )
    named = [one_camera_name(FAULT_NAMES[place], fit.model) for place in odd]
    others_named = [(model, _names(scene, nominal, model)) for model in fit.alternatives]
    pivots = {model.pivot for model, names in others_named if NEAR in names}
    pivoted = (
        f" with the shear centered in the {', or '.join(pivots)}"
        if nominal.pivot not in pivots
        else ""
    )
    for place, own in zip(odd.tolist(), named, strict=True):
        name, kind, numbers = (
            FAULT_NAMES[place],
            KINDS[place],
            np.array([found, asked, least, most])[:, place],
        )
        # A fault states the place of a screen in scene units, other numbers as they are.
        screen = scene.frustum.screen
        if screen is not None and name == "screen-height":
            numbers = screen.height * numbers
        elif screen is not None and name.startswith("screen-center"):
            numbers = screen.center["xy".index(name[-1])] + numbers
        value, should, *ends = numbers.tolist()
        low, high = min(ends), max(ends)
        words = _number_words(name, scene, value, should)
        if own != name:
            camera = "C" if own.startswith("back") else "C*"
            alone = words.replace("both cameras step", f"{camera} alone steps")
            words = alone if name == NEAR else f"by {camera} alone, {words}"
        if name == "scene-scale":
            within = (low, high) if math.isfinite(low + high) else (value, value)
            units = [
                units
                for factor, units in MISTAKEN_UNITS.items()
                if within[0] <= factor <= within[1]
            ]
            words += "".join(f": {one}" for one in units[:1])
        others: dict[str, None] = {}
        for _, names in others_named:
            if own not in names:
                # If a guess has several, a ratio replaces a ratio, and a length one along the same
                # axis.
                rest = [one for one in names if one not in named]
                rest = [one for one in rest if _is_ratio(one) == _is_ratio(own)] or rest
                along = [one for one in rest if _axis(one) in ("", _axis(own)) or not _axis(own)]
                others |= dict.fromkeys(along or rest)
        if others:
            said = ", or ".join(one + (pivoted if one == NEAR else "") for one in others)
            words += f"; or {said}: {witnesses} cannot tell"
        unit = {Kind.PIXELS: "px", Kind.FACTOR: "ratio", Kind.SIZE: "ratio"}.get(kind, scene.units)
        yield Defect(
            fault=own,
            value=value,
            low=low if math.isfinite(low) else None,
            high=high if math.isfinite(high) else None,
            unit=scene.units if name.startswith("screen-") else unit,
            words=words,
            alternatives=tuple(others),
        )


def _is_ratio(fault: str) -> bool:
    kinds = dict(zip(FAULT_NAMES, KINDS, strict=True))
    return kinds.get(fault.removeprefix("front-").removeprefix("back-")) in (Kind.FACTOR, Kind.SIZE)


def _axis(fault: str) -> str:
    return fault[-1] if fault[-2:] in ("-x", "-y", "-z") else ""


def _number_words(name: str, scene: Scene, value: float, should: float) -> str:
    """Return a number that is off in words; `value` and `should` are as a fault states them."""
    letter, units, sign = _axis(name) or "x", scene.units, value > 0
    axis, group, size = (
        "xyz".index(letter),
        name.removesuffix(f"-{_axis(name)}"),
        f"{abs(value):.5g} {units}",
    )
    sides = (
        ("to the left", "to the right"),
        ("downward", "upward"),
        ("to the back", "toward the viewer"),
    )
    side = sides[axis][sign]
    # The plate has no third side.
    film, plate, hogels = "", (*scene.plate.size, 0.0)[axis], (*scene.plate.hogels, 1)[axis]
    if group == "fov" and scene.frustum.fov is not None:
        angle = scene.frustum.fov[axis]
        made = math.degrees(2 * math.atan(math.tan(angle / 2) * value))
        film = f": {made:.4g} degrees instead of {math.degrees(angle):.4g}"
    at_corner = abs(abs(value) - plate / hogels / 2) <= CORNER_PITCHES * plate / hogels
    corner = (
        ": half a pitch, as at the corners of hogels instead of their centers" if at_corner else ""
    )
    sampled = ("to the left of", "to the right of")[sign] if axis == 0 else ("above", "below")[sign]
    unseen = value < UNSEEN_NEAR_PER_REACH * scene.frustum.longest_reach
    near = (
        "nothing that can be seen" if unseen and should else f"a near offset of {value:.5g} {units}"
    )
    stated = f", not by {should:.5g}" if should else ", which nobody mentioned"
    return {
        "shift": f"pixels are sampled {abs(value):.3f} px {sampled} their centers (images upright)",
        "fov": f"the film is {value:.5g} times as {'high' if axis else 'wide'} as the scene's{film}",
        "pitch": f"apertures are {value:.5g} times as far apart in {letter}: as on a plate of "
        f"{value * plate:.5g} {units} instead of {plate:.5g}",
        "near": f"both cameras step back by {near}{stated}",
        "aperture-offset": f"all apertures are moved by {size} {side}{corner}",
        "scene-offset": f"the scene is moved by {size} {side}",
        "scene-scale": f"the scene is {value:.5g} times as large as asked, about the origin",
        "screen-center": f"the projection screen is centered at {letter} = {value:.5g} {units} instead of "
        f"{should:.5g}",
        "screen-height": f"the projection screen is at height {value:.5g} {units} instead of {should:.5g}",
    }[group]
