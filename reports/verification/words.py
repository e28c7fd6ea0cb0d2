"""Sentences of `verify` about defects, measures, limits and verdicts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from xfrustum.compare.diagnosis import defects as names
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

# Largest number of hogels that a sentence or the terminal names.
MAX_LISTED = 10

# An offset points to hogel corners if it differs from half a pitch by at most this, in pitches.
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
"""Judged property by `HogelNumbers.by`; pictures without an entry here are judged by colors."""

UNITS = {
    10.0: ("millimeters", "centimeters"),
    25.4: ("millimeters", "inches"),
    2.54: ("centimeters", "inches"),
    100.0: ("centimeters", "meters"),
    1000.0: ("millimeters", "meters"),
}
"""Units that are mistaken for each other, by the factor between them."""

PLACES = {
    "side": "side of the plate",
    "object": "object",
    "distance": "distance from outlines of objects",
    "row": "row of hogels",
    "column": "column of hogels",
    "shown": "where images show",
}
"""Groups by which wrong pixels are counted, with their names."""

text = partial(template_sentence, "verify-words.txt.j2")


def percent(fraction: float) -> str:
    """Return a share in percent, with three digits."""
    return f"{100 * fraction:.3g} %"


def defect_words(defect: Defect, scene: Scene, by: str = "images") -> str:
    """Return the sentence of a defect; `by` is the evidence that does not exclude alternatives."""
    words = text("defect_words", defect=defect, facts=_facts(defect, scene))
    others = f"; or {', or '.join(defect.alternatives)}: {by} cannot tell"
    return words + others if defect.alternatives else words


def _facts(defect: Defect, scene: Scene) -> dict[str, Any]:
    """Return the facts about the scene that the sentence of a defect needs."""
    # Names may begin with a half of the display (`front-near-offset`) or end with an axis.
    half, _, rest = defect.fault.partition("-")
    alone = {"front": "C*", "back": "C"}.get(half, "")
    axis = names.axis_of(defect.fault) or "x"
    group = (rest if alone else defect.fault).removesuffix(f"-{axis}")
    facts: dict[str, Any] = {"group": group, "axis": axis, "alone": alone, "units": scene.units}
    facts |= {"triangles": len(scene.faces), "corner": False, "angles": None, "mistaken": None}
    facts["listed"] = MAX_LISTED
    value, screen, facts["height"] = defect.value, scene.frustum.screen, ""
    if not isinstance(value, float):
        return facts
    if defect.fault == names.VIEW_SHEAR and screen is not None:
        # Views with s times the shear 1/Z coincide at the height h for which 1/(Z - h) = s/Z.
        facts["height"] = f"{screen.height * (1 - 1 / value):.4g} {scene.units}"
    # The plate has a size only along x and y.
    if axis != "z":
        place = "xy".index(axis)
        facts["plate"] = plate = scene.plate.size[place]
        # A frequent mistake is an offset of half a pitch: hogel corners instead of centers.
        pitches = abs(value) * scene.plate.hogels[place] / plate
        facts["corner"] = group == "aperture-offset" and abs(pitches - 0.5) <= CORNER_PITCHES
        if group == "fov" and scene.frustum.fov is not None:
            angle = scene.frustum.fov[place]
            # The film scales with the tangent of half the angle, not with the angle.
            made = 2 * math.atan(math.tan(angle / 2) * value)
            facts["angles"] = math.degrees(made), math.degrees(angle)
    # Units are inferred from the confidence interval, because the value is never exact.
    # An interval that begins at zero is no evidence of any offset.
    facts["at_most"] = defect.high if defect.low is not None and defect.low <= 0 else None
    low, high = value if defect.low is None else defect.low, defect.high or value
    for factor, (small, large) in UNITS.items() if group == "scene-scale" else ():
        if low <= factor <= high:
            facts["mistaken"] = small, large
        if low <= 1 / factor <= high:
            facts["mistaken"] = large, small
    return facts


def guess_words(defect: Defect, diagnosis: Diagnosis, scene: Scene) -> str:
    """Return the sentence of a defect whose correction explains too little or breaks pixels."""
    words, share = defect_words(defect, scene, witnesses(diagnosis)), defect.explains or 0.0
    # Refuted guesses are parts of one correction; the last guess has the numbers of the whole.
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
    """Return the name of the evidence of a diagnosis, for the sentence about alternatives."""
    basis = diagnosis.evidence.basis
    return str(basis) if basis in (Basis.COLORS, Basis.OBJECTS) else "images"


def basis_words(diagnosis: Diagnosis) -> str:
    """Return the method of a diagnosis in words."""
    return text("basis_words", evidence=diagnosis.evidence)


def judged_words(by: set[str], colored: bool, judging: Judging) -> str:
    """Return the judged properties of images."""
    words = [entry for name, entry in JUDGED.items() if name in by]
    if "color" in by or colored:
        words.append(f"colors to within {judging.color_tolerance:.3g} of linear radiance")
    return ", and ".join(words) or "nothing"


def check_words(check: Check) -> str:
    """Return the sentence about a measure and its limit."""
    return text("check_words", check=check)


def figures_words(figures: PlateNumbers | HogelNumbers) -> str:
    """Return the sentence about the measures of one hogel or of all hogels."""
    counts = " or ".join(WRONG_FIGURES[name] for name in figures.by.split(" or "))
    whole = isinstance(figures, PlateNumbers)
    return text("figures_words", figures=figures, counts=counts, whole=whole)


def where_words(where: Mapping[str, Any]) -> list[str]:
    """Return the places of wrong pixels, one line for each group of `PLACES`."""
    lines = []
    for group in (group for group in PLACES if group in where):
        worst = sorted(where[group].items(), key=lambda entry: -entry[1]["fraction"])[:6]
        shares = (f"{place} {percent(n['fraction'])} ({n['wrong']:,})" for place, n in worst)
        lines.append(f"{PLACES[group]}: {', '.join(shares)}")
    return lines


def sentence(verification: Verification) -> str:
    """Return the verdict with the measures of the worst hogel, which decides it."""
    return text("sentence", found=verification, nothing_to_judge=NOTHING_TO_JUDGE)


def claim(verification: Verification) -> str:
    """Return the bound on the share of the plate's hogels that fail; empty without a sample."""
    extent, share = verification.extent, verification.share_at_most
    if extent is None or share is None:
        return ""
    return text("claim", extent=extent, share=percent_up(share), failed=verification.failed)


def unexplained_words(verification: Verification) -> str:
    """Return the sentence and the advice for images without a named defect."""
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
    """Return the sentence for images without a defect, with wrong pixels within the limits."""
    counts = {
        hogel.aperture.index: (hogel.as_found.causes or {}).get("unexplained", 0)
        for hogel in verification.hogels
        if hogel.as_found is not None
    }
    return text("nothing_words", counts=counts)
