"""Sentences of `verify` about defects, figures, limits and verdicts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from xfrustum.compare.diagnosis import defects as names
from xfrustum.compare.diagnosis import encodings as stored
from xfrustum.compare.diagnosis.defects import Defect, axis_of
from xfrustum.compare.diagnosis.diagnosis import Basis, Diagnosis
from xfrustum.compare.diagnosis.geometry_fit import CORNER_PITCHES, UNSEEN_NEAR_PER_REACH
from xfrustum.compare.diagnosis.testset import MIN_EXPLAINED_FRACTION
from xfrustum.compare.judging.judged import (
    SURFACES,
    WRONG_FIGURES,
    HogelNumbers,
    Judging,
    MeasuredBy,
)
from xfrustum.compare.judging.verdict import COLORS, DISPLACEMENT, Check, Outcome, PlateNumbers
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.representation import counted, percent_up

if TYPE_CHECKING:
    from xfrustum.reports.verification.verdict import Verification

# Hogels that a sentence names.
MAX_NAMED = 4
# Hogels that the terminal names one by one.
MAX_LISTED = 10

# Plain pictures give geometry by outlines alone: a hogel inside one surface has none.
NOT_MEASURED = "not measured, as there are no outlines"
NOTHING_TO_JUDGE = (
    "the truth has no outlines that could be seen to be wrong (write numbers of triangles, or "
    "judge "
    "colors)"
)

JUDGED = {
    "triangle": "surfaces, by the triangles that pixels name",
    "object": "surfaces, by the objects that pixels name",
    "coverage": "surfaces, by where something is shown",
    "outlines": "geometry: where pictures show something, and where outlines run, in whatever "
    "shading; not what lies between outlines",
}
"""Judged property by `HogelNumbers.by`; plain pictures are else judged by colors."""

UNITS = {
    10.0: ("millimeters", "centimeters"),
    25.4: ("millimeters", "inches"),
    2.54: ("centimeters", "inches"),
    100.0: ("centimeters", "meters"),
    1000.0: ("millimeters", "meters"),
}
"""Units that are mistaken for each other, by the factor between them."""

AXES = {
    "x, y, -z": "z is negated: what belongs before the plate is behind it",
    "x, z, y": "y and z are exchanged",
    "x, z, "
    "-y": "y and z are exchanged, and y is negated: the scene is turned by 90 degrees about x",
    "x, -z, "
    "y": "y and z are exchanged, and z is negated: the scene is turned by 90 degrees about x",
    "y, x, z": "x and y are exchanged",
    "-x, y, z": "x is negated: the scene is mirrored left to right",
    "x, -y, z": "y is negated: the scene is upside down, as in a mirror",
    "-x, y, -z": "x and z are negated: the scene is seen from behind",
}

TEMPLATES = {
    names.ORIENTATION: "images are {value}",
    names.ORDER: "apertures are in another order: {value}",
    names.PIVOT: "the shear is centered in the {value}, not in the {stated}",
    names.FIT: "the film is fitted to the {value}, not to the {stated}",
    names.NOT_RECENTERED: "frusta are not recentered: every aperture looks straight ahead, not "
    "at the "
    "projection screen",
    names.EQUAL_ANGLES: "pixels are spaced by equal angles along {value}: a flat film has equal "
    "tangents",
    names.Z_NEGATED: "axes are wrong: {axes} ({value} in place of x, y, z)",
    names.AXES_EXCHANGED: "axes are wrong: {axes} ({value} in place of x, y, z)",
    "front-missing": "the half on the viewer's side is missing: only C is drawn",
    "back-missing": "the half behind the plate is missing: only C* is drawn",
    "front-nearest": "on the viewer's side the surface nearest to the plate wins; C* must keep the "
    "farthest",
    "back-farthest": "behind the plate the surface farthest from it wins; C must keep the nearest",
    "not-overlaid": "C is drawn over C*; the viewer's half must cover the other",
    "culling": "faces whose corners run {value} as the viewer sees them are left out",
    "front-mirrored": "the half before the plate is {value}",
    "back-mirrored": "the half behind the plate is {value}",
    "front-unturned": "the half before the plate is {value}: C* looks back, so that its picture "
    "is to be turned by 180 degrees, and is not",
    "back-unturned": "the half behind the plate is {value}",
    "lights": "lights are not conjugated: on the viewer's side bright and dark are exchanged; "
    "C* needs L* = -L",
    "flat-normals": "triangles are shaded with their own normals: the scene's are interpolated "
    "between vertices",
    "inverted-normals": "surfaces are lit from the wrong side: normals point away from the viewer, "
    "or all lights are reversed",
    stored.WRONG_ENCODING: "pixels hold {value_words}, not {stated_words}: --encoding {value}",
    stored.BACKGROUND_ID: "nothing is stored as {value:.0f}, not as {stated:.0f}",
    stored.OVERFLOW: "only the low {value:.0f} bits of each number are stored, of {triangles:,} "
    "triangles: others are lost",
    stored.RESTARTING: "numbers of triangles begin anew with each of {value:.0f} objects, as "
    "gl_PrimitiveID does: add the number of each object's first triangle",
    # Mixed ids are invented numbers: their share is the only measurable size.
    stored.RESAMPLED: "numbers are mixed with their neighbors' in {value:.0%} of the pixels, by "
    "filtering, resizing or anti-aliasing: numbers have no averages",
    stored.LOSSY: "numbers went through lossy compression, such as JPEG: write PNG",
    "layout": "files were read as {stated}, and hold {details[0]}",
}
"""Sentences of defects by name; `defect_words` makes the others."""

PIXEL_WORDS = {"triangle-id": "numbers of triangles", "object-id": "numbers of objects"}
SIDES = (
    ("to the left", "to the right"),
    ("downward", "upward"),
    ("to the back", "toward the viewer"),
)


def percent(fraction: float) -> str:
    """Return a share in percent, with three digits."""
    return f"{100 * fraction:.3g} %"


def defect_words(defect: Defect, scene: Scene, by: str = "images") -> str:
    """Return the sentence of a defect; `by` names the evidence that leaves alternatives open."""
    words = _sized(defect, scene)
    others = f"; or {', or '.join(defect.alternatives)}: {by} cannot tell"
    return words + others if defect.alternatives else words


def _sized(defect: Defect, scene: Scene) -> str:
    """Return the sentence of a defect without its alternatives."""
    if (special := SPECIAL.get(defect.fault)) is not None:
        return special(defect, scene)
    # Defects without a template are deviations of one number of the camera model.
    if defect.fault not in TEMPLATES:
        return _number_words(defect, scene)
    return TEMPLATES[defect.fault].format(
        value=defect.value,
        stated=defect.stated,
        details=defect.details,
        axes=AXES.get(str(defect.value), ""),
        triangles=len(scene.faces),
        value_words=PIXEL_WORDS.get(str(defect.value), "colors"),
        stated_words=PIXEL_WORDS.get(str(defect.stated), "colors"),
    )


def _view_shear(defect: Defect, scene: Scene) -> str:
    screen, value = scene.frustum.screen, float(defect.value)
    assert screen is not None
    # A share s of the shear 1/Z registers views at the height h with 1/(Z - h) = s/Z.
    height = f"{screen.height * (1 - 1 / value):.4g} {scene.units}"
    text = f"views have {value:.3g} of the shear that the plate needs"
    return f"{text}: they are registered at height {height}"


def _channels(defect: Defect, _: Scene) -> str:
    order = f"channels are in another order: numbers are stored as {defect.value}, not as RGB"
    # Ids below 256 leave two channels zero, whose order has no effect.
    same = f" (or as {' or '.join(defect.details)}: with so few numbers images cannot tell)"
    return order + same if defect.details else order


def _id_offset(defect: Defect, _: Scene) -> str:
    stated = int(defect.stated or 0)
    # The value is relative to the stated offset; the message names the stored number.
    offset = int(defect.value) + stated
    kept = f"number + {offset}" if offset else "the number itself"
    return f"{kept} is stored, not number + {stated}: all are off by one"


def _transfer(defect: Defect, _: Scene) -> str:
    (curve,) = defect.details
    words = f"colors are not stored as {defect.stated} values, as stated, but as {curve}"
    return f"{words} values: --encoding {defect.value}" if defect.value != curve else words


def _shear_sign(defect: Defect, _: Scene) -> str:
    words = "C and C* are sheared the wrong way, as for a screen on the plate's other side"
    if defect.value != "C and C*":
        other = "C" if defect.value == "C*" else "C*"
        words = f"{defect.value} is sheared the way of {other}; with respect to the plate the two "
        words += "are sheared in opposite directions"
    shears = ", or ".join(f"of {shear}" for shear in defect.details)
    return words + (f" (or the shear {shears} is reversed: images cannot tell)" if shears else "")


SPECIAL: dict[str, Callable[[Defect, Scene], str]] = {
    names.SHEAR_SIGN: _shear_sign,
    names.VIEW_SHEAR: _view_shear,
    stored.CHANNEL_ORDER: _channels,
    stored.ID_OFFSET: _id_offset,
    **dict.fromkeys(stored.TRANSFER_FAULTS, _transfer),
}
"""Functions that make the sentences of defects with details."""


def _number_words(defect: Defect, scene: Scene) -> str:
    """Return the sentence of a number that is off."""
    name, value, should = defect.fault, defect.value, defect.stated
    assert isinstance(value, float) and isinstance(should, float)
    # Names are `front-near` or `near-x`: half of the display, group and axis.
    half, _, rest = name.partition("-")
    alone = {"front": "C*", "back": "C"}.get(half, "")
    group = (rest if alone else name).removesuffix("-offset" if alone else "")
    letter, units = axis_of(name) or "x", scene.units
    axis, size = "xyz".index(letter), f"{abs(value):.5g} {scene.units}"
    group = group.removesuffix(f"-{axis_of(name)}")
    side = SIDES[axis][value > 0]
    # The plate has no third side.
    # A scene offset along z has no pitch to compare with; zero disables the comparison.
    plate, hogels = (*scene.plate.size, 0.0)[axis], (*scene.plate.hogels, 1)[axis]
    if group == "shift":
        of = ("above", "below") if axis else ("to the left of", "to the right of")
        words = (
            f"pixels are sampled {abs(value):.3f} px {of[value > 0]} their centers (images upright)"
        )
    elif group == "fov":
        extent = "high" if axis else "wide"
        words = f"the film is {value:.5g} times as {extent} as the scene's"
        if scene.frustum.fov is not None:
            angle = scene.frustum.fov[axis]
            # The film scales with the tangent of half the angle, not with the angle.
            made = math.degrees(2 * math.atan(math.tan(angle / 2) * value))
            words += f": {made:.4g} degrees instead of {math.degrees(angle):.4g}"
    elif group == "pitch":
        words = (
            f"apertures are {value:.5g} times as far apart in {letter}: as on a plate of "
            f"{value * plate:.5g} {units} instead of {plate:.5g}"
        )
    elif group == "near":
        # A near offset below this share of the reach moves no point by a measurable amount.
        unseen = value < UNSEEN_NEAR_PER_REACH * scene.frustum.longest_reach
        offset = f"a near offset of {value:.5g} {units}"
        offset = "nothing that can be seen" if unseen and should else offset
        who = f"{alone} alone steps" if alone else "both cameras step"
        nominal = f", not by {should:.5g}" if should else ", which nobody mentioned"
        return f"{who} back by {offset}{nominal}"
    elif group == "aperture-offset":
        words = f"all apertures are moved by {size} {side}"
        # The usual mistake: hogel corners instead of centers, an offset of half a pitch.
        if abs(abs(value) - plate / hogels / 2) <= CORNER_PITCHES * plate / hogels:
            words += ": half a pitch, as at the corners of hogels instead of their centers"
    elif group == "scene-offset":
        words = f"the scene is moved by {size} {side}"
    elif group == "scene-scale":
        words = f"the scene is {value:.5g} times as large as asked, about the origin"
        # The unit is inferred from the confidence interval: the value itself is never exact.
        words += _units(value if defect.low is None else defect.low, defect.high or value)
    elif group == "screen-center":
        words = f"the projection screen is centered at {letter} = {value:.5g} {units}"
        words += f" instead of {should:.5g}"
    else:
        words = f"the projection screen is at height {value:.5g} {units} instead of {should:.5g}"
    return f"by {alone} alone, {words}" if alone else words


def _units(low: float, high: float) -> str:
    """Return the units that are mistaken for each other by a factor in an interval."""
    for factor, (small, large) in UNITS.items():
        if low <= factor <= high:
            return f": {small} taken for {large}"
        if low <= 1 / factor <= high:
            return f": {large} taken for {small}"
    return ""


def guess_words(defect: Defect, diagnosis: Diagnosis, scene: Scene) -> str:
    """Return the sentence of a defect that explains too little, or makes right pixels wrong."""
    words, share = defect_words(defect, scene, witnesses(diagnosis)), defect.explains or 0.0
    # Refuted guesses are parts of one correction: the last has the figures of all.
    parts = [guess for guess in diagnosis.does_not_explain if guess.refuted]
    if defect in parts[:-1]:
        return words
    together = "all of these together " if len(parts) > 1 and defect in parts else ""
    would = f"{together}would explain only {100 * share:.0f} % of what is wrong"
    if defect.refuted and (rest := diagnosis.refutation) is not None:
        named = ", ".join(f"{i},{j}" for i, j in rest.failed[:MAX_NAMED])
        named += ", .." if len(rest.failed) > MAX_NAMED else ""
        would += (
            f"; corrected, {rest.after:,} pixels of all judged hogels are wrong instead of "
            f"{rest.before:,}, and {len(rest.failed)} of {rest.judged} hogels do not pass: {named}"
        )
    elif share >= MIN_EXPLAINED_FRACTION:
        # A correction may explain most wrong pixels and still break correct ones.
        would = "would make pixels wrong that are right"
    return f"{words}: {would}"


def witnesses(diagnosis: Diagnosis) -> str:
    """Return the evidence that leaves alternatives open."""
    basis = diagnosis.evidence.basis
    return str(basis) if basis in (Basis.COLORS, Basis.OBJECTS) else "images"


def basis_words(diagnosis: Diagnosis) -> str:
    """Return the means of a diagnosis."""
    evidence = diagnosis.evidence
    if evidence.basis is Basis.NOTHING:
        return "nothing, as no hogel shows enough of the scene to tell"
    if evidence.basis is Basis.RIGHT:
        return f"{counted(evidence.hogels, 'hogel')}, in which nothing is wrong"
    if evidence.basis in (Basis.COLORS, Basis.OBJECTS):
        return f"registration of {counted(evidence.hogels, 'picture')}"
    words = f"{evidence.claims:,} claims of {counted(evidence.hogels, 'hogel')}"
    words += f"; {counted(evidence.spoiled, 'hogel')} unlike the others" if evidence.spoiled else ""
    return words + ("" if evidence.holds else "; no convention explains them alone")


def judged_words(by: set[str], colored: bool, judging: Judging) -> str:
    """Return the judged properties of images."""
    words = [entry for name, entry in JUDGED.items() if name in by]
    if "color" in by or colored:
        words.append(f"colors to within {judging.color_tolerance:.3g} of linear radiance")
    return ", and ".join(words) or "nothing"


def check_words(check: Check) -> str:
    """Return a figure and its limit."""

    def sized(value: float) -> str:
        return percent(value) if check.unit == "share" else f"{value:.3g} px"

    value = NOT_MEASURED if check.held is not False else "unknown"
    value = value if check.value is None else sized(check.value)
    limit = "no limit" if check.limit is None else f"limit {sized(check.limit)}"
    if check.held and check.unit == "share" and (check.value or 0.0) > (check.limit or math.inf):
        limit += ", and a single pixel"  # `Limits.checks` accepts it in any hogel
    return f"{check.figure} {value} ({limit})"


def figures_words(figures: PlateNumbers | HogelNumbers) -> str:
    """Return the sentence of the figures of one hogel, or of all."""
    parts = [f"{figures.shown:,} pixels show something"]
    if (surface := figures.surface) is not None:
        outside = f", {surface.outside:,} from outside the film" if surface.outside else ""
        parts.append(f"{SURFACES} {surface.wrong:,} ({percent(surface.fraction)}{outside})")
    counts = " or ".join(WRONG_FIGURES[name] for name in figures.by.split(" or "))
    parts.append(f"{counts} {figures.wrong:,} ({percent(figures.fraction)})")
    if figures.invalid:
        parts.append(f"{figures.invalid:,} claim what does not exist")
    if figures.radiance is not None:
        parts.append(f"{COLORS} on right surfaces {figures.radiance.wrong:,}")
    whole, spread = isinstance(figures, PlateNumbers), figures.displacement_px
    means = figures.displacement_by.split(" or ")
    name = f"{DISPLACEMENT} (p99{' of the worst hogel' if whole else ''})"
    if spread is None:
        unmeasured = means == [MeasuredBy.NO_OUTLINES]
        parts.append(f"{name} {NOT_MEASURED if unmeasured else 'unknown'}")
    else:
        p99 = spread["worst_p99"] if isinstance(spread, dict) else spread.p99
        known = [name for name in means if name not in (MeasuredBy.NOTHING, MeasuredBy.NO_OUTLINES)]
        some = " (in some hogels it cannot be known)" if MeasuredBy.NOTHING in means else ""
        parts.append(f"{name} {p99:.3g} px by {' or '.join(known)}{some}")
    text = ", ".join(parts)
    if figures.causes is not None and figures.wrong:
        causes = ", ".join(f"{name} {count:,}" for name, count in figures.causes.items())
        text += f"; causes of {counts}: {causes}"
    return text


def where_words(where: Mapping[str, Any]) -> list[str]:
    """Return where hogels are wrong, a line for each way to divide the pixels."""
    heads = {
        "side": "side of the plate",
        "object": "object",
        "distance": "distance from outlines of objects",
        "row": "row of hogels",
        "column": "column of hogels",
        "shown": "where images show",
    }
    lines = []
    for group, head in heads.items():
        worst = sorted(where.get(group, {}).items(), key=lambda entry: -entry[1]["fraction"])[:6]
        text = (
            f"{place} {100 * entry['fraction']:.3g} % ({entry['wrong']:,})"
            for place, entry in worst
        )
        lines += [f"{head}: {', '.join(text)}"] if worst else []
    return lines


def sentence(verification: Verification) -> str:
    """Return the verdict, with the figures of the worst hogel that decided it."""
    verdicts = [hogel.verdict for hogel in verification.hogels]
    count, missing, bad = (
        len(verdicts),
        verdicts.count(Outcome.MISSING),
        verdicts.count(Outcome.FAIL),
    )
    if verification.passed:
        kept = ", ".join(map(check_words, verification.checks))
        who = "the hogel keeps" if count == 1 else f"all {count} hogels keep"
        return f"Right: {who} to the limits: at worst {kept}."
    blind = verdicts.count(Outcome.NOT_JUDGED)
    if verification.verdict is Outcome.NOT_JUDGED:
        who = "the hogel" if count == 1 else f"{blind} of {count} hogels"
        rest = "" if blind == count else "; the others keep to the limits"
        return f"Not judged, neither right nor wrong: in {who} {NOTHING_TO_JUDGE}{rest}."
    exceeded = ", ".join(check_words(check) for check in verification.checks if check.held is False)
    who = f"{bad} of {count} hogels exceed{'s' if bad == 1 else ''}"
    who = "the hogel exceeds" if count == 1 else who
    parts = [f"{who} a limit: at worst {exceeded}"] if bad else []
    if blind:
        parts.append(f"in {blind} of {count} {NOTHING_TO_JUDGE}")
    if missing:
        parts.append(f"{missing} of {count} are missing (--apertures chooses the hogels to judge)")
    return f"Not right: {'; and '.join(parts)}."


def claim(verification: Verification) -> str:
    """Return the bound on the share of the plate's hogels that fail; empty without a sample."""
    extent, share = verification.extent, verification.share_at_most
    if extent is None or share is None:
        return ""
    plate, counts = (
        f"{extent.sample.hogels:,} hogels",
        f"{verification.failed:,} of {extent.judged:,}",
    )
    if extent.everything:
        return f"of the plate's {plate}, all judged, {verification.failed:,} do not pass"
    return (
        f"at most {percent_up(share)} of the plate's {plate} do not pass "
        f"({percent(extent.confidence)}; {counts} sampled)"
    )


def unexplained_words(verification: Verification) -> str:
    """Return the sentence where no defect is named, with advice."""
    several = "no single fault that was tried explains all hogels; one of the alternatives may"
    guesses = verification.diagnosis.does_not_explain
    ambiguous = verification.diagnosis.refutation is not None and any(
        guess.alternatives for guess in guesses
    )
    words = several if ambiguous else "no known fault explains what is wrong"
    # Mistakes of single hogels are seen only where these are among the diagnosed hogels.
    wrong = [hogel.aperture for hogel in verification.hogels if hogel.verdict is Outcome.FAIL]
    if wrong and verification.diagnosis.evidence.basis is Basis.RIGHT:
        named = ";".join(f"{entry.column},{entry.row}" for entry in wrong[:MAX_LISTED])
        words += (
            ": the hogels that were diagnosed are right; diagnose some of both, --apertures "
            f"'{named};..'"
        )
    black = (verification.where or {}).get("shown", {}).get("nothing", {}).get("wrong", 0)
    if black and verification.as_found is not None and verification.as_found.by == "outlines":
        # A surface that no light reaches and one that is not drawn make the same picture.
        words += (
            f"; {black:,} of the wrong pixels are black where the truth shows a surface: black is "
            "taken "
        )
        words += (
            "for nothing; if they are unlit, draw with some ambient light, or write numbers of "
            "triangles"
        )
    return words


def explained_words(verification: Verification) -> list[str]:
    """Return the share of wrong pixels that the diagnosis explains; none where it names nothing."""
    shares = [
        defect.explains for defect in verification.diagnosis.faults if defect.explains is not None
    ]
    if not shares:
        return []
    return [f"{percent(min(shares))} of the wrong pixels of the hogels that were tested"]


def nothing_words(verification: Verification) -> str:
    """Return the sentence where no defect was found, with wrong pixels within the limits."""
    if verification.as_found is None:
        return "no hogel could be judged"
    count = (verification.as_found.causes or {}).get("unexplained", 0)
    if not count:
        return "nothing found"
    by_hogel = {
        hogel.aperture: (hogel.as_found and hogel.as_found.causes) or {}
        for hogel in verification.hogels
    }
    worst = max(by_hogel, key=lambda entry: by_hogel[entry].get("unexplained", 0))
    return (
        f"nothing found; {count:,} pixels are wrong by no rounding, most in hogel "
        f"{worst.column},{worst.row}"
    )
