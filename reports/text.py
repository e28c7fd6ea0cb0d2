"""Sentences and aligned lines for the codes and records of `compare`, `reference` and `scenes`.

Sentences about objects name those that are invisible, cut, tiny, in the plate, or seen from behind.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from xfrustum.compare.comparison import ComparisonNumbers, Share
from xfrustum.compare.prediction.reasons import MIN_PIXELS, Reason, Reasons
from xfrustum.scenes import Scene
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.model.images import Certainty
from xfrustum.scenes.model.scene import SceneObject
from xfrustum.scenes.model.visibility import (
    Point,
    aside_of_frusta,
    box,
    in_plate,
    sees_any,
    share_in_reach,
)
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.representation import counted, digits, percent, plain, sides

if TYPE_CHECKING:
    from xfrustum.compare.run import JudgedDrawing
    from xfrustum.compare.selfcheck import SelfCheck, ViewCheck


SENTENCES = {
    Reason.CROSSES: "not predicted: surfaces cross the plate",
    Reason.STARVED: "the depth buffer shows other surfaces than the displaced ones",
    Reason.ROUNDED: "smaller than the rounding of float32 positions",
    Reason.LARGE: (
        "triangles are far larger than the plate: "
        "float32 rounds their depth by more than is predicted"
    ),
    Reason.PARALLEL: (
        "surfaces are parallel to the plate: the depth of all their pixels is rounded alike"
    ),
    Reason.FEW: f"fewer than {MIN_PIXELS} pixels are predicted: chance decides",
    Reason.OUTSIDE: "points from outside the film are shown; the truth does not have them",
    Reason.STEPS: "all depths lie within two steps below one: float32 rounds many pixels alike",
    Reason.ALIGNED: (
        "edges run along rows or columns: all pixels beside an edge become wrong together"
    ),
    Reason.THIN: "surfaces are thinner than a pixel: the truth shows only a part of their contours",
}


def sentences(reasons: Reasons) -> Reasons:
    """Return reasons as sentences."""
    words = {name: reason and SENTENCES[Reason(reason)] for name, reason in vars(reasons).items()}
    return Reasons(**words)


DISPLACEMENT_TIE_PX = 1e-3
"""Displacements that differ by less count as equal, because 32-bit surface positions measure
displacement no better (99 % of pixels within 1e-3 px on meshes)."""

CERTAINTY_LABELS = {
    Certainty.PROVEN: "proven in floating point",
    Certainty.EXACT: "decided in rational arithmetic",
    Certainty.TIE: "tie, not judged",
    Certainty.UNEXAMINED: "not examined",
}
"""Meanings of the values of `certainty`."""


def displacement_words(displacement_p99_px: float) -> str:
    """Return the displacement of 99 % of a picture as a clause."""
    if math.isinf(displacement_p99_px):
        return (
            "where the picture belongs is undefined, "
            "for much of it shows a surface in the plate itself"
        )
    return f"99 % of the picture lies within {pixels(displacement_p99_px)} of where it belongs"


def pixels(value: float) -> str:
    """Write a displacement with two digits, at least `DISPLACEMENT_TIE_PX`."""
    # Round first, so that 99.6 is printed as 100, like other large values.
    rounded = float(f"{max(value, DISPLACEMENT_TIE_PX):.2g}")
    return f"{rounded:,.0f} px" if rounded >= 100 else plain(f"{rounded:.2g} px")


def aligned(rows: Sequence[Sequence[str]], others: Callable[[str, int], str] = str.rjust) -> str:
    """Return rows of cells as lines: the first column left-aligned, other columns by `others`."""
    first, *rest = [max(map(len, column)) for column in zip(*rows, strict=True)]
    # Align names to the left, and numbers to the right by default.
    cells = ([row[0].ljust(first), *map(others, row[1:], rest)] for row in rows)
    return "\n".join("  ".join(line).rstrip() for line in cells)


def scene_line(scene: Scene) -> str:
    """Return plate, film, reach and contents of a scene in a line."""
    toward, back = map(digits, scene.frustum.reach)
    screen, fov, units = scene.frustum.screen, scene.frustum.fov, scene.units
    if screen is not None:
        size, height = sides(screen.size), digits(screen.height)
        lines = f"recentered on a screen of {size} {units} at height {height} {units}"
    else:
        lines = f"each {sides(math.degrees(angle) for angle in fov or ())} degrees"
    triangles = sum(len(part.faces) for part in scene.objects)
    plate = scene.plate
    return (
        f"{scene.name!r}, a plate of {sides(plate.size)} {units} with {sides(plate.hogels)} "
        f"hogels of {sides(scene.frustum.resolution)} pixels, {lines}, "
        f"reach {toward} {units} toward the viewer and {back} {units} behind; "
        f"{counted(len(scene.objects), 'object')}, {counted(triangles, 'triangle')}"
    )


def _share(share: Share | None) -> str:
    return "not known" if share is None else f"{share.wrong:,} ({percent(share.fraction)})"


def comparison_line(numbers: ComparisonNumbers) -> str:
    """Return the errors of an image in a line."""
    parts = [
        "an unknown number show the wrong surface"
        if numbers.surface is None
        else f"{_share(numbers.surface)} show the wrong surface"
    ]
    if numbers.triangle is not None:
        parts.append(f"{_share(numbers.triangle)} another triangle")
    if spread := numbers.displacement_px:
        p99, most = digits(spread.p99), digits(spread.max)
        parts.append(f"99 of 100 surface points within {p99} px, all within {most} px")
    return f"of {numbers.judged:,} judged pixels {', '.join(parts)}"


def drawing_line(drawing: JudgedDrawing) -> str:
    """Return settings and errors of a judged drawing in a line."""
    near, depth = drawing.settings.near, drawing.settings.depth_label
    return f"near {near:.3g} scene units, {depth}: {comparison_line(drawing.comparison)}"


def comparison_table(numbers: ComparisonNumbers) -> str:
    """Return the numbers of a comparison as aligned lines."""
    surface, color = numbers.surface, numbers.radiance

    def named(group: object, names: str) -> str:
        """Write some numbers of a group, each after its name."""
        if group is None:
            return "not defined"
        return "  ".join(f"{name} {getattr(group, name):.3g}" for name in names.split())

    lines = {
        "pixels": f"{numbers.pixels:,}",
        "judged": f"{numbers.judged:,}",
        "covered": f"{numbers.covered:,}",
        "wrong surface": _share(surface),
    }
    if surface is not None and surface.culled is not None:
        lines["  a face culled"] = f"{surface.culled:,}"
    lines |= {
        "another triangle": _share(numbers.triangle),
        "displacement, px": named(numbers.displacement_px, "rms p50 p95 p99 max"),
        "height error": named(numbers.height, "rms max"),
        "drawn in the plate": f"{numbers.at_plate:,}",
    }
    if color is not None:
        lines["radiance error"] = named(color, "mean rms p99 max")
        if color.away_from_edges is not None:
            lines["  in the same triangle"] = named(color.away_from_edges, "mean rms p99 max")
        if color.flip is not None:
            ssim = "not defined" if color.ssim is None else f"{color.ssim:.4g}"
            lines["looks different"] = f"FLIP {color.flip:.3g}  SSIM {ssim}"
        if color.noise is not None:
            lines["beyond noise, 1/255"] = f"{color.noise.differ:,} pixels"
    return aligned(list(lines.items()), str.ljust)


COUNTS = {name: name for name in ("pixels", "covered", "proven", "exact", "ties", "wrong")}
COUNTS["tracer_wrong"] = "float32 wrong"
"""Titles of the counts of a self-check."""


def selfcheck_table(check: SelfCheck) -> str:
    """Return a self-check as text: a row per scene, the sphere, every disagreement, the result."""
    of_scene: dict[str, list[ViewCheck]] = {}
    for view in check.views:
        of_scene.setdefault(view.scene, []).append(view)
    rows = [("scene", "apertures", *COUNTS.values())]
    for name, group in (*of_scene.items(), ("all", list(check.views))):
        sums = (sum(getattr(view, count) for view in group) for count in COUNTS)
        rows.append((name, str(len(group)), *(f"{n:,}" for n in sums)))
    lines = [aligned(rows)]
    if sphere := check.sphere:
        lines.append(
            f"sphere of {sphere.triangles:,} triangles, lines from its center: "
            f"{sphere.vertices:,} vertices, "
            f"{sphere.vertex_misses:,} missed (float32 {sphere.tracer_vertex_misses:,}); "
            f"{sphere.edges:,} edges, "
            f"{sphere.edge_misses:,} missed (float32 {sphere.tracer_edge_misses:,}); "
            f"{sphere.wrong:,} wrong"
        )
    pixels, still_open, differing, wrong = (
        sum(getattr(each, count) for each in check.directions)
        for count in ("pixels", "open", "differing", "wrong")
    )
    lines += [
        f"by direction: {pixels:,} pixels of {sum(each.directions for each in check.directions):,} "
        f"images, {still_open:,} not proven, {differing:,} unlike pixels of hogels, {wrong:,} wrong"
    ]
    lines += [
        f"{each.scene} by direction: hogel column {each.columns[0] + at.column}, "
        f"row {each.rows[0] + at.row}, {at.about}: expected {at.expected}, got {at.got}"
        for each in check.directions
        for at in each.disagreements
    ]
    lines += [
        f"{view.scene} {view.aperture[0]},{view.aperture[1]}: column {at.column}, row {at.row}, "
        f"{at.about}: expected {at.expected}, got {at.got}"
        for view in check.views
        for at in view.disagreements
    ]
    result = "agree" if check.agrees else "DISAGREE"
    pixels = f"{check.total('pixels'):,} pixels"
    return "\n".join(
        [*lines, f"reference and integers {result} on {pixels} ({check.seconds:.0f} s)"]
    )


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
    from xfrustum.compare.error_maps import turned_away  # noqa: PLC0415 - loads SciPy
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
    """Return why no aperture shows an object, with sizes: beyond the reach, or to the side."""
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
