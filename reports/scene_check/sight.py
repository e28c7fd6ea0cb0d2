"""Sentences about objects that are invisible, cut, tiny, in the plate, or seen from behind."""

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.model.visibility import (
    Point,
    aside_of_frusta,
    box,
    in_plate,
    sees_any,
    share_in_reach,
)
from xfrustum.scenes.plate import Aperture

#: largest number of objects that one message names
MAX_NAMED_OBJECTS = 3

#: width and height of the images in which back faces are counted, pixels
FACING_RESOLUTION = (64, 64)

#: Smallest size of an object without a warning, share of the plate's longer side. A smaller object
#: is probably in other units.
MIN_SIZE_FRACTION = 0.01


def require_seen(scene: Scene, apertures: Sequence[Aperture]) -> None:
    """Raise InputError, with sizes, if no aperture shows an object."""
    if sentence := unseen_sentence(scene, apertures):
        raise InputError(sentence)


def unseen_sentence(scene: Scene, apertures: Sequence[Aperture]) -> str | None:
    """Return the reason and advice if apertures show no object; else None."""
    command = shlex.join(("xfrustum", "check", scene.source or scene.name))
    advice = "Change the object's scale or translate, or the frustum's reach"
    facts = unseen_facts(scene, apertures)
    return facts and f"{facts}. {advice}; `{command}` shows where everything lies"


def unseen_facts(scene: Scene, apertures: Sequence[Aperture]) -> str | None:
    """Return the reason, with sizes, if apertures show no object; else None."""
    if not scene.objects or sees_any(scene, apertures):
        return None
    reasons = [
        f"{_called(number, part)} {_why_unseen(scene, part, apertures)}"
        for number, part in enumerate(scene.objects)
    ]
    who = f"none of the {len(apertures)} requested apertures sees anything"
    if len(apertures) >= np.prod(scene.plate.hogels):
        who = "no aperture of the plate sees anything"
    elif len(apertures) == 1:
        who = f"aperture {apertures[0].column},{apertures[0].row} sees nothing"
    return f"{scene.name}: {who} of the scene: {'; '.join(_first(reasons))}"


def warnings(scene: Scene) -> tuple[str, ...]:
    """Return a sentence for each object that the reach cuts and for each tiny object."""
    (toward, back), units, side = scene.frustum.reach, scene.units, max(scene.plate.size)
    reach = f"the reach is {length(back)} {units} behind the plate and {length(toward)} before it"
    cut, tiny = [], []
    for number, part in enumerate(scene.objects):
        name, (low, high) = _called(number, part), box(part)
        if low[2] < -back or high[2] > toward:
            share = share_in_reach(part, scene.frustum)
            beyond = "of its surface is beyond and is not imaged"
            lost = "" if share is None else f": {_percent(1 - share)} {beyond}"
            cut.append(f"{name} {_spans(low[2], high[2], units)}, and {reach}{lost}")
        if max(np.subtract(high, low)) < MIN_SIZE_FRACTION * side:
            tiny.append(
                f"{name} is {_size(low, high)} {units}, and the plate is {length(side)} {units} "
                "wide: give it a scale if it is in other units"
            )
    return (*_first(cut), *_first(tiny))


def plate_warnings(scene: Scene) -> tuple[str, ...]:
    """Return a sentence for each object with triangles in the plate."""
    flat = [(number, part, in_plate(part)) for number, part in enumerate(scene.objects)]
    messages = [
        f"{_called(number, part)}: {count:,} of its {len(part.faces):,} triangles lie in the "
        "plate, within rounding: displacement is undefined there, and no plan holds for apertures "
        "that show it; move it before or behind the plate"
        for number, part, count in flat
        if count
    ]
    return _first(messages)


def facing_warnings(scene: Scene) -> tuple[str, ...]:
    """Return a sentence for each object whose visible pixels mostly show back faces.

    The middle aperture and the plate's corners are traced, without certificates.
    """
    from xfrustum.compare.metrics.error_maps import turned_away  # noqa: PLC0415 - loads SciPy
    from xfrustum.reference import Reference  # noqa: PLC0415 - loads ray tracers

    coarse = replace(scene, frustum=replace(scene.frustum, resolution=FACING_RESOLUTION))
    reference, messages = Reference(coarse), []
    seen = np.zeros((2, len(scene.objects)), dtype=np.int64)
    for aperture in dict.fromkeys((scene.plate.middle, *scene.plate.corners)):
        image = reference.propose(aperture, colored=False)
        for place, pixels in enumerate((image.covered, image.covered & turned_away(image))):
            seen[place] += np.bincount(image.object[pixels], minlength=len(scene.objects))
    for number, (part, whole, away) in enumerate(zip(scene.objects, *seen.tolist(), strict=True)):
        if 2 * away > whole:
            messages.append(
                f"{_percent(away / whole)} of the visible pixels of {_called(number, part)} show "
                "back faces, and `--cull back` leaves them out; flip_winding = true in its table "
                "turns the winding"
            )
    return _first(messages)


def _called(number: int, part: SceneObject) -> str:
    return f"object {number} ({Path(part.name).name})"


def _first(messages: list[str]) -> tuple[str, ...]:
    """Return the first sentences; the last ends with the number of further objects."""
    more = len(messages) - MAX_NAMED_OBJECTS
    named = messages[:MAX_NAMED_OBJECTS]
    return tuple(named) if more <= 0 else (*named[:-1], f"{named[-1]}; and so for {more} more")


def _why_unseen(scene: Scene, part: SceneObject, apertures: Sequence[Aperture]) -> str:
    """Return, with sizes, the reason why no aperture shows an object: its depth or its side."""
    (toward, back), units, (low, high) = scene.frustum.reach, scene.units, box(part)
    share = share_in_reach(part, scene.frustum)
    if share is None:
        return "has triangles without area alone"
    if share == 0:
        reach = back if high[2] < 0 else toward
        return f"{_spans(low[2], high[2], units)}; the reach is {length(reach)} {units} there"
    # Compute gaps between the lines and the box, and their distances from the plate's middle.
    ends, gaps = (max(low[2], -back), min(high[2], toward)), list[tuple[float, str]]()
    for axis, words in enumerate((("to the left of", "to the right of"), ("below", "above"))):
        left, right = aside_of_frusta(scene.frustum, apertures, axis, ends)
        for first, last, limit, word in (
            (-high[axis], -low[axis], -left, words[0]),
            (low[axis], high[axis], right, words[1]),
        ):
            where = f"lies {_range(first, last)} {units} {word} the plate's middle"
            line = f"at its height the lines end {length(limit)} {units} from there"
            gaps.append((first - limit, f"{where}; {line}"))
    widest, aside = max(gaps)
    return aside if widest > 0 else "lies beside the lines of the image"


def length(value: float) -> str:
    """Return a length with four digits and commas between thousands."""
    if value == 0 or 1e-3 <= abs(value) < 1e6:
        digits = 3 - int(np.floor(np.log10(abs(value)))) if value else 0
        text = f"{value:,.{max(digits, 0)}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.4g}"


def heights(low: float, high: float, units: str) -> str:
    """Return heights as distances from the plate, in words."""
    if low == high == 0:
        return "in the plate"
    if low < 0 < high:
        return f"from {length(-low)} {units} behind the plate to {length(high)} {units} before it"
    if high <= 0:
        return f"{_range(-high, -low)} {units} behind the plate"
    return f"{_range(low, high)} {units} before the plate"


def _spans(low: float, high: float, units: str) -> str:
    """Return heights with a verb: a flat object lies at one height."""
    return f"{'lies' if length(low) == length(high) else 'spans'} {heights(low, high, units)}"


def _range(low: float, high: float) -> str:
    return length(low) if length(low) == length(high) else f"{length(low)} to {length(high)}"


def _size(low: Point, high: Point) -> str:
    return " x ".join(length(b - a) for a, b in zip(low, high, strict=True))


def _percent(share: float) -> str:
    """Return a share in percent; only exact 0 and 1 are written as 0 % and 100 %."""
    if 0 < share < 0.001:
        return "less than 0.1 %"
    return "more than 99.9 %" if 0.999 < share < 1 else f"{100 * share:.3g} %"
