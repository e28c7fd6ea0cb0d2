"""Defects of a renderer: records of codes and numbers, and the table of discrete defects.

A `Hypothesis` holds the fields of `RendererModel` that a discrete defect changes. Each hypothesis
is tested on the images by itself (`enumeration.compositions`); `hypotheses_in` lists the hypotheses
that hold in a candidate model. Defects that have a size, such as a shift, are the groups of
`xfrustum.compare.renderer_model.drawn_model`. `xfrustum.reports.verification.words` makes the
sentences about defects.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Any

import numpy as np

from xfrustum.compare.diagnosis.geometry_fit import GeometryFit
from xfrustum.compare.renderer_model.drawn_model import (
    CAMERA_GROUPS,
    FAULT_NAMES,
    FLIPPED,
    KINDS,
    Back,
    Culled,
    Film,
    Front,
    Index,
    Kind,
    Normals,
    OneCamera,
    Recentering,
    RendererModel,
    smallest_named,
)
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.representation import counted

ORIENTATION, ORDER, NEAR, PIVOT, FIT = "orientation", "aperture-order", "near", "pivot", "fit"
NOT_RECENTERED, SHEAR_SIGN, VIEW_SHEAR = "not-recentered", "shear-sign", "view-shear"
EQUAL_ANGLES, Z_NEGATED, AXES_EXCHANGED = "equal-angles", "z-negated", "axes-exchanged"
OBJECT_MISSING, STALE, EXCHANGED = "object-missing", "stale-hogel", "hogels-exchanged"

MISTAKEN_UNITS = tuple(
    factor for ratio in (10.0, 25.4, 2.54, 100.0, 1000.0) for factor in (ratio, 1 / ratio)
)
"""Factors by which common unit mistakes scale a scene."""


@dataclass(frozen=True, kw_only=True)
class Defect:
    """Difference between a renderer and its nominal model, as codes and numbers."""

    fault: str  #: name, a code of `verify --json`
    value: float | str  #: size of the defect as a number, or a code
    low: float | None = None  #: ends of the interval of `value`; None if unknown
    high: float | None = None
    unit: str | None = None  #: unit of `value`, `low` and `high`; None for codes
    alternatives: tuple[str, ...] = ()  #: names of defects with (nearly) the same images
    explains: float | None = None  #: share of the wrong pixels that the whole diagnosis explains
    stated: float | str | None = None  #: nominal value, if the report prints it
    #: other values that produce the same images, or codes that the report prints
    details: tuple[str, ...] = ()
    #: hogels that show another aperture's image, each with that aperture; with several apertures if
    #: their images are equal
    hogels: tuple[tuple[Index, tuple[Index, ...]], ...] = ()
    refuted: bool = False  #: whether hogels fail after correction for this defect


@dataclass(frozen=True)
class Hypothesis:
    """One discrete defect: name, code, and the fields of `RendererModel` that it changes."""

    fault: str
    value: str
    fields: Mapping[str, Any] = field(hash=False)

    def of(self, model: RendererModel) -> RendererModel:
        """Return a model with this defect."""
        fields = dict(self.fields)
        if "one_camera" in fields:
            fields["one_camera"] = replace(fields["one_camera"], other_near=model.near)
        return replace(model, **fields)


def _flipped(camera: OneCamera) -> Hypothesis:
    half, kind = "back" if camera.side > 0 else "front", "mirrored"
    value = f"mirrored {'left to right' if camera.flip_x else 'upside down'}"
    if camera.flip_x and camera.flip_y:
        kind, value = "unturned", "turned by 180 degrees"
    return Hypothesis(f"{half}-{kind}", value, {"one_camera": camera})


NEAREST = Hypothesis("front-nearest", "nearest wins", {"front": Front.NEAREST})
NOT_OVERLAID = Hypothesis("not-overlaid", "back over front", {"overlaid": False})
FLAT = Hypothesis("flat-normals", "flat", {"normals": Normals.FLAT})

SHADINGS = (
    Hypothesis("lights", "not conjugated", {"conjugated": False}),
    FLAT,
    Hypothesis("inverted-normals", "inverted", {"normals": Normals.INVERTED}),
)
"""Defects of shading, which are visible only in colors."""

HYPOTHESES = (
    Hypothesis("front-missing", "missing", {"front": Front.MISSING}),
    Hypothesis("back-missing", "missing", {"back": Back.MISSING}),
    *(NEAREST, NOT_OVERLAID),
    *(
        Hypothesis("culling", str(culled), {"culled": culled})
        for culled in (Culled.COUNTERCLOCKWISE, Culled.CLOCKWISE)
    ),
    # On a convex body, culling gives the same image as this depth test, because the faces turned
    # away from the viewer are also the farthest. Culling is the more common mistake.
    Hypothesis("back-farthest", "farthest wins", {"back": Back.FARTHEST}),
    *map(_flipped, FLIPPED),
    *SHADINGS,
)
"""All discrete defects; of defects that produce the same images, the first is reported first."""


def hypotheses_in(model: RendererModel) -> list[Hypothesis]:
    """Return the discrete defects of a model."""
    camera = model.one_camera
    # The near offset of the correct camera is not a defect.
    plain = replace(model, one_camera=camera and replace(camera, other_near=0.0))
    return [
        hypothesis
        for hypothesis in HYPOTHESES
        if all(getattr(plain, name) == value for name, value in hypothesis.fields.items())
    ]


def defects_of(scene: Scene, nominal: RendererModel, fit: GeometryFit) -> tuple[Defect, ...]:
    """Return the differences between a candidate and the nominal model.

    A parameter counts as a defect if its interval excludes the nominal value, and its deviation is
    large enough to be reported (`smallest_named`).
    """
    model, names = fit.model, [_names(scene, nominal, other) for other in fit.alternatives]
    defects = []
    if model.orientation != nominal.orientation:
        defects.append(Defect(fault=ORIENTATION, value=model.orientation.labels[0]))
    if model.order != nominal.order:
        defects.append(Defect(fault=ORDER, value=model.order.labels[1]))
    for name in (PIVOT, FIT) if model.near else ():
        value, stated = getattr(model, name), getattr(nominal, name)
        if value is not stated:
            defects.append(Defect(fault=name, value=str(value), stated=str(stated)))
    if model.recentering is not nominal.recentering:
        name = _shear_name(model.recentering)
        shears = dict.fromkeys(other.recentering for other in fit.alternatives)
        known = (nominal.recentering, model.recentering)
        defects.append(
            Defect(
                fault=name,
                value="no shear" if name == NOT_RECENTERED else str(model.recentering),
                # Here and below, an alternative to a defect is a candidate without this defect.
                alternatives=_others(name, names),
                details=tuple(str(shear) for shear in shears if shear not in known),
            )
        )
    if model.film is not nominal.film:
        value = "x and y" if model.film is Film.XY else str(model.film)
        defects.append(Defect(fault=EQUAL_ANGLES, value=value))
    defects += _numbers(scene, nominal, fit)
    compositions = [[defect.fault for defect in hypotheses_in(of)] for of in fit.alternatives]
    for hypothesis in hypotheses_in(model):
        others = _others(hypothesis.fault, compositions)
        defect = Defect(fault=hypothesis.fault, value=hypothesis.value, alternatives=others)
        defects.append(defect)
    if model.axes != nominal.axes:
        name = Z_NEGATED if model.axes == "x, y, -z" else AXES_EXCHANGED
        defects.append(Defect(fault=name, value=model.axes))
    for number in model.missing:
        name = PurePath(scene.objects[number].name).stem
        defects.append(Defect(fault=OBJECT_MISSING, value=f"object {number} ({name})"))
    return *defects, *_of_hogels(model)


def _of_hogels(model: RendererModel) -> Iterator[Defect]:
    """Yield defects of hogels with another hogel's image: stale hogels and exchanged pairs."""
    first = {index: others[0] for index, others in model.shows}
    pairs = {index for index, other in first.items() if first.get(other) == index}
    for name, chosen in ((STALE, first.keys() - pairs), (EXCHANGED, pairs)):
        hogels = tuple(entry for entry in model.shows if entry[0] in chosen)
        if hogels:
            yield Defect(fault=name, value=counted(len(hogels), "hogel"), hogels=hogels)


def _others(name: str, names: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return the names in all alternatives, except alternatives that contain `name`."""
    return tuple(dict.fromkeys(other for of in names if name not in of for other in of))


def one_camera_name(name: str, model: RendererModel) -> str:
    """Return a parameter's defect name, prefixed back- or front- if only one camera deviates."""
    camera = model.one_camera
    if camera is None or name.removesuffix("-x").removesuffix("-y") not in CAMERA_GROUPS:
        return name
    return f"{'back' if camera.side > 0 else 'front'}-{'near-offset' if name == NEAR else name}"


def _shear_name(recentering: Recentering) -> str:
    return NOT_RECENTERED if recentering is Recentering.NONE else SHEAR_SIGN


def _names(scene: Scene, nominal: RendererModel, model: RendererModel) -> list[str]:
    """Return the names of a model's defects: wrong shear, mirrored films, deviating parameters."""
    off = np.abs(model.parameters - nominal.parameters) > smallest_named(scene)
    names = [] if model.recentering is nominal.recentering else [_shear_name(model.recentering)]
    names += [
        hypothesis.fault for hypothesis in hypotheses_in(model) if "one_camera" in hypothesis.fields
    ]
    return names + [one_camera_name(FAULT_NAMES[place], model) for place in np.flatnonzero(off)]


def _numbers(scene: Scene, nominal: RendererModel, fit: GeometryFit) -> Iterator[Defect]:
    """Yield a defect with an interval for each parameter that deviates from nominal."""
    values, stated, screen = fit.model.parameters, nominal.parameters, scene.frustum.screen
    off = np.abs(values - stated) > smallest_named(scene)
    odd = np.flatnonzero(off & ~((fit.low <= stated) & (stated <= fit.high)))
    named = [one_camera_name(FAULT_NAMES[place], fit.model) for place in odd]
    alternatives = [_names(scene, nominal, model) for model in fit.alternatives]
    units = {Kind.PIXELS: "px", Kind.FACTOR: "ratio", Kind.SIZE: "ratio"}
    for place, own in zip(odd.tolist(), named, strict=True):
        name, unit = FAULT_NAMES[place], units.get(KINDS[place], scene.units)
        numbers = np.array([entry[place] for entry in (values, stated, fit.low, fit.high)])
        # Screen positions are converted to scene units; other parameters are unchanged.
        if screen is not None and name == "screen-height":
            numbers, unit = screen.height * numbers, scene.units
        elif screen is not None and name.startswith("screen-center"):
            numbers = screen.center["xy".index(name[-1])] + numbers
        value, should, *ends = numbers.tolist()
        others = [
            other
            for names in alternatives
            if own not in names
            for other in _instead(own, [other for other in names if other not in named])
        ]
        yield Defect(
            fault=own,
            value=value,
            low=min(ends) if math.isfinite(min(ends)) else None,
            high=max(ends) if math.isfinite(max(ends)) else None,
            unit=unit,
            alternatives=tuple(dict.fromkeys(others)),
            stated=should,
        )


def _instead(own: str, names: Sequence[str]) -> Sequence[str]:
    """Return names that can replace a parameter: ratios for a ratio, with the same axis or none."""
    alike = [name for name in names if _is_ratio(name) == _is_ratio(own)] or names
    axis = axis_of(own)
    return [name for name in alike if not axis or axis_of(name) in ("", axis)] or alike


def _is_ratio(name: str) -> bool:
    kinds = dict(zip(FAULT_NAMES, KINDS, strict=True))
    kind = kinds.get(name.removeprefix("front-").removeprefix("back-"))
    return kind in (Kind.FACTOR, Kind.SIZE)


def axis_of(name: str) -> str:
    """Return the axis at the end of a name, else an empty string."""
    return name[-1] if name[-2:] in ("-x", "-y", "-z") else ""
