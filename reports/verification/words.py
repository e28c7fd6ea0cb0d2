"""Sentences of `verify` about defects, figures, limits and verdicts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from xfrustum.compare.diagnosis import defects as names
from xfrustum.compare.diagnosis import encodings as stored
from xfrustum.compare.diagnosis.defects import Defect
from xfrustum.compare.diagnosis.diagnosis import Basis, Diagnosis
from xfrustum.compare.diagnosis.testset import MIN_EXPLAINED_FRACTION
from xfrustum.compare.judging.judged import (
    WRONG_FIGURES,
    HogelNumbers,
    Judging,
)
from xfrustum.compare.judging.verdict import Check, Outcome, PlateNumbers
from xfrustum.reports.common.templates_environment import sentence as template_sentence
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.representation import percent_up

if TYPE_CHECKING:
    from xfrustum.reports.verification.verdict import Verification

# Hogels that a sentence or the terminal names one by one.
MAX_LISTED = 10

# Largest difference from half a pitch at which apertures stand at the corners of hogels, pitches.
CORNER_PITCHES = 0.01

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

PLACES = {
    "side": "side of the plate",
    "object": "object",
    "distance": "distance from outlines of objects",
    "row": "row of hogels",
    "column": "column of hogels",
    "shown": "where images show",
}
"""Ways to divide pixels by place."""

text = partial(template_sentence, "verify-words.txt.j2")

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
    value = defect.value
    facts: dict[str, Any] = {"corner": False, "angles": None, "mistaken": None}
    assert isinstance(value, float)
    # Names are `front-near-offset` or `near-x`: half of the display, group and axis.
    half, _, rest = defect.fault.partition("-")
    alone = {"front": "C*", "back": "C"}.get(half, "")
    axis = names.axis_of(defect.fault) or "x"
    group = (rest if alone else defect.fault).removesuffix(f"-{axis}")
    # The plate has no third side.
    if axis != "z":
        place = "xy".index(axis)
        facts["plate"] = plate = scene.plate.size[place]
        # The usual mistake: hogel corners instead of centers, an offset of half a pitch.
        pitches = abs(value) * scene.plate.hogels[place] / plate
        facts["corner"] = group == "aperture-offset" and abs(pitches - 0.5) <= CORNER_PITCHES
        if group == "fov" and scene.frustum.fov is not None:
            angle = scene.frustum.fov[place]
            # The film scales with the tangent of half the angle, not with the angle.
            made = 2 * math.atan(math.tan(angle / 2) * value)
            facts["angles"] = math.degrees(made), math.degrees(angle)
    # The unit is inferred from the confidence interval: the value itself is never exact.
    low, high = value if defect.low is None else defect.low, defect.high or value
    for factor, (small, large) in UNITS.items() if group == "scene-scale" else ():
        if low <= factor <= high:
            facts["mistaken"] = small, large
        if low <= 1 / factor <= high:
            facts["mistaken"] = large, small
    number = {"group": group, "axis": axis, "value": value, "nominal": defect.stated}
    return text("number_words", **number, alone=alone, units=scene.units, facts=facts)


def guess_words(defect: Defect, diagnosis: Diagnosis, scene: Scene) -> str:
    """Return the sentence of a defect that explains too little, or makes right pixels wrong."""
    words, share = defect_words(defect, scene, witnesses(diagnosis)), defect.explains or 0.0
    # Refuted guesses are parts of one correction: the last has the figures of all.
    parts = [guess for guess in diagnosis.does_not_explain if guess.refuted]
    if defect in parts[:-1]:
        return words
    return text(
        "guess_words",
        words=words,
        share=share,
        together=len(parts) > 1 and defect in parts,
        refutation=diagnosis.refutation if defect.refuted else None,
        # A correction may explain most wrong pixels and still break correct ones.
        spoils=share >= MIN_EXPLAINED_FRACTION,
    )


def witnesses(diagnosis: Diagnosis) -> str:
    """Return the evidence that leaves alternatives open."""
    basis = diagnosis.evidence.basis
    return str(basis) if basis in (Basis.COLORS, Basis.OBJECTS) else "images"


def basis_words(diagnosis: Diagnosis) -> str:
    """Return the means of a diagnosis."""
    return text("basis_words", evidence=diagnosis.evidence)


def judged_words(by: set[str], colored: bool, judging: Judging) -> str:
    """Return the judged properties of images."""
    words = [entry for name, entry in JUDGED.items() if name in by]
    if "color" in by or colored:
        words.append(f"colors to within {judging.color_tolerance:.3g} of linear radiance")
    return ", and ".join(words) or "nothing"


def check_words(check: Check) -> str:
    """Return a figure and its limit."""
    return text("check_words", check=check)


def figures_words(figures: PlateNumbers | HogelNumbers) -> str:
    """Return the sentence of the figures of one hogel, or of all."""
    counts = " or ".join(WRONG_FIGURES[name] for name in figures.by.split(" or "))
    whole = isinstance(figures, PlateNumbers)
    return text("figures_words", figures=figures, counts=counts, whole=whole)


def where_words(where: Mapping[str, Any]) -> list[str]:
    """Return where hogels are wrong, a line for each way to divide the pixels."""
    lines = []
    for group in (group for group in PLACES if group in where):
        worst = sorted(where[group].items(), key=lambda entry: -entry[1]["fraction"])[:6]
        shares = (f"{place} {percent(n['fraction'])} ({n['wrong']:,})" for place, n in worst)
        lines.append(f"{PLACES[group]}: {', '.join(shares)}")
    return lines


def sentence(verification: Verification) -> str:
    """Return the verdict, with the figures of the worst hogel that decided it."""
    return text("sentence", found=verification, nothing_to_judge=NOTHING_TO_JUDGE)


def claim(verification: Verification) -> str:
    """Return the bound on the share of the plate's hogels that fail; empty without a sample."""
    extent, share = verification.extent, verification.share_at_most
    if extent is None or share is None:
        return ""
    return text("claim", extent=extent, share=percent_up(share), failed=verification.failed)


def unexplained_words(verification: Verification) -> str:
    """Return the sentence where no defect is named, with advice."""
    wrong = [hogel.aperture for hogel in verification.hogels if hogel.verdict is Outcome.FAIL]
    black, numbers = 0, verification.as_found
    if numbers is not None and numbers.by == "outlines":
        black = verification.where.get("shown", {}).get("nothing", {}).get("wrong", 0)
    diagnosis = verification.diagnosis
    shown = wrong[:MAX_LISTED]
    return text("unexplained_words", diagnosis=diagnosis, wrong=shown, black=black)


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
    return text("nothing_words", counts=counts)
