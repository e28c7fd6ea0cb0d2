"""Sentences of `verify` about defects, figures, limits and verdicts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from xfrustum.compare.diagnosis import defects as names
from xfrustum.compare.diagnosis import encodings as stored
from xfrustum.compare.diagnosis.defects import Defect
from xfrustum.compare.diagnosis.diagnosis import Basis, Diagnosis
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

# Hogels that a guess names, and that the sentence of a defect or the terminal names one by one.
MAX_NAMED, MAX_LISTED = 4, 10

# Largest difference from half a pitch at which apertures stand at the corners of hogels, pitches.
CORNER_PITCHES = 0.01

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
    stored.CHANNEL_ORDER: "channels are in another order: numbers are stored as {value}, not as "
    "RGB{same}",
    stored.ID_OFFSET: "{kept} is stored, not number + {stated:.0f}: all are off by one",
    names.VIEW_SHEAR: "views have {value:.3g} of the shear that the plate needs: they are "
    "registered at height {height}",
    **dict.fromkeys(
        stored.TRANSFER_FAULTS,
        "colors are not stored as {stated} values, as stated, but as {details[0]} values{option}",
    ),
}
"""Sentences of defects by name; `_defect_words` makes the others."""

NUMBERS = {
    "shift": "pixels are sampled {size:.3f} px {aside} their centers (images upright)",
    "fov": "the film is {value:.5g} times as {extent} as the scene's",
    "pitch": "apertures are {value:.5g} times as far apart in {axis}: as on a plate of "
    "{drawn:.5g} {units} instead of {plate:.5g}",
    "aperture-offset": "all apertures are moved by {size:.5g} {units} {toward}",
    "scene-offset": "the scene is moved by {size:.5g} {units} {toward}",
    "scene-scale": "the scene is {value:.5g} times as large as asked, about the origin",
    "screen-center": "the projection screen is centered at {axis} = {value:.5g} {units} instead "
    "of {should:.5g}",
    "screen-height": "the projection screen is at height {value:.5g} {units} instead of "
    "{should:.5g}",
}
"""Sentences of numbers of the camera model that are off, by group."""

SIDES = {
    "x": (("to the left", "to the left of"), ("to the right", "to the right of")),
    "y": (("downward", "above"), ("upward", "below")),
    "z": (("to the back", ""), ("toward the viewer", "")),
}
"""Directions of a negative and a positive number: of a move, and of a sampling point in pixels."""

PIXEL_WORDS = {"triangle-id": "numbers of triangles", "object-id": "numbers of objects"}


def percent(fraction: float) -> str:
    """Return a share in percent, with three digits."""
    return f"{100 * fraction:.3g} %"


def defect_words(defect: Defect, scene: Scene, by: str = "images") -> str:
    """Return the sentence of a defect; `by` names the evidence that leaves alternatives open."""
    words = _defect_words(defect, scene)
    others = f"; or {', or '.join(defect.alternatives)}: {by} cannot tell"
    return words + others if defect.alternatives else words


def _defect_words(defect: Defect, scene: Scene) -> str:
    """Return the sentence of a defect without its alternatives."""
    fault, value, stated, screen = defect.fault, defect.value, defect.stated, scene.frustum.screen
    if fault == names.SHEAR_SIGN:
        return _shear_sign(defect)
    # Defects without a template are deviations of one number of the camera model.
    if fault not in TEMPLATES:
        return _number_words(defect, scene)
    # The value of an offset is relative to the stated one; the message names the stored number.
    offset = int(value) + int(stated or 0) if fault == stored.ID_OFFSET else 0
    height = 0.0
    if fault == names.VIEW_SHEAR and screen is not None:
        # A share s of the shear 1/Z registers views at the height h with 1/(Z - h) = s/Z.
        height = screen.height * (1 - 1 / float(value))
    others = " or ".join(defect.details)
    # Ids below 256 leave two channels zero, whose order has no effect.
    same = f" (or as {others}: with so few numbers images cannot tell)" if others else ""
    return TEMPLATES[fault].format(
        value=value,
        stated=stated,
        details=defect.details,
        axes=AXES.get(str(value), ""),
        triangles=len(scene.faces),
        value_words=PIXEL_WORDS.get(str(value), "colors"),
        stated_words=PIXEL_WORDS.get(str(stated), "colors"),
        same=same,
        height=f"{height:.4g} {scene.units}",
        kept=f"number + {offset}" if offset else "the number itself",
        option="" if (value,) == defect.details else f": --encoding {value}",
    )


def _shear_sign(defect: Defect) -> str:
    words = "C and C* are sheared the wrong way, as for a screen on the plate's other side"
    if defect.value != "C and C*":
        other = "C" if defect.value == "C*" else "C*"
        words = f"{defect.value} is sheared the way of {other}; with respect to the plate the two "
        words += "are sheared in opposite directions"
    shears = ", or ".join(f"of {shear}" for shear in defect.details)
    return words + (f" (or the shear {shears} is reversed: images cannot tell)" if shears else "")


def _number_words(defect: Defect, scene: Scene) -> str:
    """Return the sentence of a number that is off."""
    value, should, units = defect.value, defect.stated, scene.units
    assert isinstance(value, float) and isinstance(should, float)
    # Names are `front-near-offset` or `near-x`: half of the display, group and axis.
    half, _, rest = defect.fault.partition("-")
    alone = {"front": "C*", "back": "C"}.get(half, "")
    axis = names.axis_of(defect.fault) or "x"
    group = (rest if alone else defect.fault).removesuffix(f"-{axis}")
    if group in ("near", "near-offset"):
        who = f"{alone} alone steps" if alone else "both cameras step"
        nominal = f", not by {should:.5g}" if should else ", which nobody mentioned"
        return f"{who} back by a near offset of {value:.5g} {units}{nominal}"
    place, size = "xyz".index(axis), abs(value)
    # The plate has no third side.
    plate, hogels = (*scene.plate.size, math.inf)[place], (*scene.plate.hogels, 1)[place]
    toward, aside = SIDES[axis][value > 0]
    words = NUMBERS[group].format(
        value=value,
        should=should,
        size=size,
        units=units,
        axis=axis,
        plate=plate,
        drawn=value * plate,
        toward=toward,
        aside=aside,
        extent="high" if place else "wide",
    )
    if group == "fov" and scene.frustum.fov is not None:
        angle = scene.frustum.fov[place]
        # The film scales with the tangent of half the angle, not with the angle.
        made = math.degrees(2 * math.atan(math.tan(angle / 2) * value))
        words += f": {made:.4g} degrees instead of {math.degrees(angle):.4g}"
    # The usual mistake: hogel corners instead of centers, an offset of half a pitch.
    elif group == "aperture-offset" and abs(size * hogels / plate - 0.5) <= CORNER_PITCHES:
        words += ": half a pitch, as at the corners of hogels instead of their centers"
    elif group == "scene-scale":
        # The unit is inferred from the confidence interval: the value itself is never exact.
        low, high = value if defect.low is None else defect.low, defect.high or value
        for factor, (small, large) in UNITS.items():
            if low <= factor <= high:
                words += f": {small} taken for {large}"
            if low <= 1 / factor <= high:
                words += f": {large} taken for {small}"
    return f"by {alone} alone, {words}" if alone else words


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
    for group in (group for group in heads if group in where):
        worst = sorted(where[group].items(), key=lambda entry: -entry[1]["fraction"])[:6]
        shares = (f"{place} {percent(n['fraction'])} ({n['wrong']:,})" for place, n in worst)
        lines.append(f"{heads[group]}: {', '.join(shares)}")
    return lines


def sentence(verification: Verification) -> str:
    """Return the verdict, with the figures of the worst hogel that decided it."""
    verdicts = [hogel.verdict for hogel in verification.hogels]
    count, single = len(verdicts), len(verdicts) == 1
    missing, bad, blind = (
        verdicts.count(outcome) for outcome in (Outcome.MISSING, Outcome.FAIL, Outcome.NOT_JUDGED)
    )
    if verification.passed:
        kept = ", ".join(map(check_words, verification.checks))
        who = "the hogel keeps" if single else f"all {count} hogels keep"
        return f"Right: {who} to the limits: at worst {kept}."
    if verification.verdict is Outcome.NOT_JUDGED:
        who = "the hogel" if single else f"{blind} of {count} hogels"
        rest = "" if blind == count else "; the others keep to the limits"
        return f"Not judged, neither right nor wrong: in {who} {NOTHING_TO_JUDGE}{rest}."
    exceeded = ", ".join(check_words(check) for check in verification.checks if check.held is False)
    who = (
        "the hogel exceeds"
        if single
        else f"{bad} of {count} hogels exceed{'s' if bad == 1 else ''}"
    )
    parts = [f"{who} a limit: at worst {exceeded}"] if bad else []
    if blind:
        parts.append(f"in {blind} of {count} {NOTHING_TO_JUDGE}")
    if missing:
        parts.append(f"{missing} of {count} are missing (--apertures chooses the hogels to judge)")
    return f"Not right: {'; and '.join(parts)}."


def claim(verification: Verification) -> str:
    """Return the bound on the share of the plate's hogels that fail; empty without a sample."""
    extent, share, failed = verification.extent, verification.share_at_most, verification.failed
    if extent is None or share is None:
        return ""
    plate = f"{extent.sample.hogels:,} hogels"
    if extent.everything:
        return f"of the plate's {plate}, all judged, {failed:,} do not pass"
    return (
        f"at most {percent_up(share)} of the plate's {plate} do not pass "
        f"({percent(extent.confidence)}; {failed:,} of {extent.judged:,} sampled)"
    )


def unexplained_words(verification: Verification) -> str:
    """Return the sentence where no defect is named, with advice."""
    diagnosis, words = verification.diagnosis, "no known fault explains what is wrong"
    open_guesses = any(guess.alternatives for guess in diagnosis.does_not_explain)
    if diagnosis.refutation is not None and open_guesses:
        words = "no single fault that was tried explains all hogels; one of the alternatives may"
    # Mistakes of single hogels are seen only where these are among the diagnosed hogels.
    wrong = [hogel.aperture for hogel in verification.hogels if hogel.verdict is Outcome.FAIL]
    if wrong and diagnosis.evidence.basis is Basis.RIGHT:
        named = ";".join(f"{entry.column},{entry.row}" for entry in wrong[:MAX_LISTED])
        words += (
            ": the hogels that were diagnosed are right; diagnose some of both, --apertures "
            f"'{named};..'"
        )
    black = verification.where.get("shown", {}).get("nothing", {}).get("wrong", 0)
    if black and verification.as_found is not None and verification.as_found.by == "outlines":
        # A surface that no light reaches and one that is not drawn make the same picture.
        words += (
            f"; {black:,} of the wrong pixels are black where the truth shows a surface: black is "
            "taken for nothing; if they are unlit, draw with some ambient light, or write numbers "
            "of triangles"
        )
    return words


def explained_words(verification: Verification) -> str:
    """Return the share of wrong pixels that the diagnosis explains; empty if it names nothing."""
    faults = verification.diagnosis.faults
    shares = [defect.explains for defect in faults if defect.explains is not None]
    if not shares:
        return ""
    return f"{percent(min(shares))} of the wrong pixels of the hogels that were tested"


def nothing_words(verification: Verification) -> str:
    """Return the sentence where no defect was found, with wrong pixels within the limits."""
    counts = {
        hogel.aperture.index: (hogel.as_found.causes or {}).get("unexplained", 0)
        for hogel in verification.hogels
        if hogel.as_found is not None
    }
    if not counts:
        return "no hogel could be judged"
    if not (total := sum(counts.values())):
        return "nothing found"
    worst = "{},{}".format(*max(counts, key=lambda index: counts[index]))
    return f"nothing found; {total:,} pixels are wrong by no rounding, most in hogel {worst}"
