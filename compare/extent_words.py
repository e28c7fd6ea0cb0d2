"""Where a scene lies, in words: why nothing is seen, what the reach cuts off, units that do not fit."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from xfrustum.compare.extent import (
    Point,
    apertures_in_sight,
    aside_of_frusta,
    box,
    in_plate,
    in_sight,
    share_in_reach,
)
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.plate import Aperture

MAX_NAMED_OBJECTS = 3
"""Largest number of objects that one message names, so that it stays one line; the others are counted."""

MAX_SINGLE_APERTURES = 4
"""Largest number of apertures that are examined one by one. With more, the count over the whole plate first
leaves out those that see nothing."""

MIN_SIZE_FRACTION = 0.01
"""Smallest size of an object, as a share of the plate's longer side, that raises no warning. A smaller object
is more likely in other units, meters for millimeters or inches, than made for the plate: a pixel of a hogel
is a hundredth or more of that side."""


def require_seen(scene: Scene, apertures: Sequence[Aperture]) -> None:
    """Raise InputError if a scene has objects and none of the apertures can show any of them.

    A scene without objects passes: the true image of nothing is nothing.

    Raises
    ------
    InputError
        No aperture can show any object; the line says where the objects lie and how far the frusta go.
    """
    sentence = unseen_sentence(scene, apertures)
    if sentence is not None:
        raise InputError(sentence)


def unseen_sentence(scene: Scene, apertures: Sequence[Aperture]) -> str | None:
    """Say why apertures see nothing, as `unseen_facts` does, and what to do about it; None where they see."""
    facts = unseen_facts(scene, apertures)
    command = shlex.join(("xfrustum", "check", scene.source or scene.name))
    advice = "Change the object's scale or translate, or the frustum's reach"
    return None if facts is None else f"{facts}. {advice}; `{command}` shows where everything lies"


def unseen_facts(scene: Scene, apertures: Sequence[Aperture]) -> str | None:
    """Say with sizes why apertures see nothing; None where one sees an object, or where there are none."""
    if not scene.objects or any(_seen(scene, part, apertures) for part in scene.objects):
        return None
    named = [
        f"{_name(number, part)} {_why_unseen(scene, part, apertures)}"
        for number, part in enumerate(scene.objects[:MAX_NAMED_OBJECTS])
    ]
    if more := len(scene.objects) - len(named):
        named.append(f"and {more} more objects are not in sight")
    who = f"none of the {len(apertures)} apertures asked for sees anything"
    if len(apertures) >= np.prod(scene.plate.hogels):
        who = "no aperture of the plate sees anything"
    elif len(apertures) == 1:
        who = f"aperture {apertures[0].column},{apertures[0].row} sees nothing"
    return f"{scene.name}: {who} of the scene: {'; '.join(named)}"


def _seen(scene: Scene, part: SceneObject, apertures: Sequence[Aperture]) -> bool:
    """Return whether any of the apertures can show some of an object."""
    if len(apertures) > MAX_SINGLE_APERTURES:
        flags = apertures_in_sight(part, scene.frustum, scene.plate)
        apertures = [one for one in apertures if flags[one.row, one.column]]
    return any(in_sight(part, scene.frustum, one) for one in apertures)


def warnings(scene: Scene) -> tuple[str, ...]:
    """Return a sentence for each object that the reach cuts, and for each object that is tiny."""
    (toward, back), units, side = scene.frustum.reach, scene.units, max(scene.plate.size)
    cut, tiny = [], []
    for number, part in enumerate(scene.objects):
        name, (low, high) = _name(number, part), box(part)
        if low[2] < -back or high[2] > toward:
            share = share_in_reach(part, scene.frustum)
            gone = (
                "" if share is None else f": {_percent(1 - share)} of its surface is beyond and is not imaged"
            )
            reach = f"{length(back)} {units} behind the plate and {length(toward)} before it"
            cut.append(f"{name} {_spans(low[2], high[2], units)}, and the reach is {reach}{gone}")
        if max(np.subtract(high, low)) < MIN_SIZE_FRACTION * side:
            tiny.append(
                f"{name} is {_size(low, high, units)}, and the plate is {length(side)} {units} wide: give it "
                "a scale if it is in other units"
            )
    return (*_first(cut), *_first(tiny))


def plate_warnings(scene: Scene) -> tuple[str, ...]:
    """Return a sentence for each object with triangles in the plate, where displacement is undefined."""
    counts = [(number, part, in_plate(part)) for number, part in enumerate(scene.objects)]
    told = (
        "lie in the plate, within rounding: displacement is undefined there, and no plan holds for apertures "
        "that show it; move it before or behind the plate"
    )
    return _first(
        [
            f"{_name(number, part)}: {count:,} of its {len(part.faces):,} triangles {told}"
            for number, part, count in counts
            if count
        ]
    )


def _first(found: Sequence[str]) -> tuple[str, ...]:
    """Return the first few sentences; the last one ends with the number of sentences that are left out."""
    named, more = list(found[:MAX_NAMED_OBJECTS]), len(found) - MAX_NAMED_OBJECTS
    if more > 0:
        named[-1] += f"; and so for {more} more objects"
    return tuple(named)


def length(value: float) -> str:
    """Write a length in four digits, thousands between commas."""
    if value == 0 or 1e-3 <= abs(value) < 1e6:
        digits = 3 - int(np.floor(np.log10(abs(value)))) if value else 0
        text = f"{value:,.{max(digits, 0)}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.4g}"


def heights(low: float, high: float, units: str) -> str:
    """Say between which heights something lies, as distances from the plate."""
    if low == high == 0:
        return "in the plate"
    if high <= 0:
        return f"{_range(-high, -low)} {units} behind the plate"
    if low >= 0:
        return f"{_range(low, high)} {units} before the plate"
    return f"from {length(-low)} {units} behind the plate to {length(high)} {units} before it"


def _spans(low: float, high: float, units: str) -> str:
    """Say between which heights something lies, with the verb: a flat object lies at one height."""
    return f"{'lies' if length(low) == length(high) else 'spans'} {heights(low, high, units)}"


def _range(low: float, high: float) -> str:
    return length(low) if length(low) == length(high) else f"{length(low)} to {length(high)}"


def _name(number: int, part: SceneObject) -> str:
    return f"object {number} ({Path(part.name).name})"


def _size(low: Point, high: Point, units: str) -> str:
    return " x ".join(length(b - a) for a, b in zip(low, high, strict=True)) + f" {units}"


def _why_unseen(scene: Scene, part: SceneObject, apertures: Sequence[Aperture]) -> str:
    """Say with sizes why apertures see nothing of an object: beyond the reach, aside, or too small."""
    (toward, back), units = scene.frustum.reach, scene.units
    low, high = box(part)
    if high[2] < -back:
        return f"{_spans(low[2], high[2], units)}; the reach is {length(back)} {units} there"
    if low[2] > toward:
        return f"{_spans(low[2], high[2], units)}; the reach is {length(toward)} {units} there"
    if share_in_reach(part, scene.frustum) == 0.0:
        return (
            f"lies beyond the reach of {length(back)} {units} behind the plate and {length(toward)} before it"
        )
    aside = _why_aside(scene, low, high, apertures)
    if aside is not None:
        return aside
    where = f"is {_size(low, high, units)}, {heights(low[2], high[2], units)}"
    flags = apertures_in_sight(part, scene.frustum, scene.plate)
    if any(flags[one.row, one.column] for one in apertures):
        return f"{where}, and falls between the centers of pixels: it needs a larger scale, or other units"
    return f"{where}, and lies beside the lines of the image"


def _why_aside(scene: Scene, low: Point, high: Point, apertures: Sequence[Aperture]) -> str | None:
    """Say how far aside of the frusta a box lies; None where it does not lie on one side of all of them."""
    toward, back = scene.frustum.reach
    ends = (max(low[2], -back), min(high[2], toward))
    sides = (("to the left", "to the right"), ("below", "above"))
    widest, text = 0.0, None
    for axis, (less, more) in enumerate(sides):
        left, right = aside_of_frusta(scene.frustum, apertures, axis, ends)
        # The gap between box and lines; the ends of the box and of the lines, from the plate's middle.
        for gap, first, last, limit, word in (
            (left - high[axis], -high[axis], -low[axis], -left, less),
            (low[axis] - right, low[axis], high[axis], right, more),
        ):
            if gap > widest:
                widest = gap
                of = "of" if axis == 0 else ""
                text = (
                    f"lies {_range(first, last)} {scene.units} {word} {of} the plate's middle; "
                    f"at its height the lines end {length(limit)} {scene.units} from there"
                ).replace("  ", " ")
    return text


def _percent(share: float) -> str:
    """Write a share as percent without calling some of it none or all of it."""
    if share in (0.0, 1.0):
        return f"{100 * share:g} %"
    if share < 0.001:
        return "less than 0.1 %"
    return "more than 99.9 %" if share > 0.999 else f"{100 * share:.3g} %"
