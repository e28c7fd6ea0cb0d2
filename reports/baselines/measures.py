"""The numbers of a hogel, and of a plate, that are kept and compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

from xfrustum.reports.verification.figures import DISPLACEMENT
from xfrustum.reports.verification.verdict import Hogel

Place = tuple[int, int]
"""Column and row of a hogel."""


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Numbers of one hogel or of a plate; the smaller, the better. None where a number cannot be known.

    They may also be means or limits of such numbers, so that counts need not be whole.

    Attributes
    ----------
    missing
        Number of hogels that could not be had; a missing hogel has no other number.
    wrong_surfaces, wrong_pixels, wrong_colors
        Numbers of pixels with the wrong surface, with the wrong triangle (or whatever images name), and with
        the right surface in another color.
    invalid
        Number of pixels that claim what does not exist.
    unexplained
        Number of wrong pixels that remain after correction and have no cause.
    displacement_rms_px, displacement_p99_px, displacement_max_px
        Spread of the displacement of what is shown; for a plate, that of the hogel in which it is largest.
    """

    missing: float | None = None
    wrong_surfaces: float | None = None
    wrong_pixels: float | None = None
    wrong_colors: float | None = None
    invalid: float | None = None
    unexplained: float | None = None
    displacement_rms_px: float | None = None
    displacement_p99_px: float | None = None
    displacement_max_px: float | None = None

    def value(self, name: str) -> float | None:
        """Return the number of a measure."""
        number: float | None = getattr(self, name)
        return number


NAMES = tuple(field.name for field in fields(Measures))
"""Names of all measures, what matters most first."""

WORDS = {
    "missing": "missing hogels",
    "wrong_surfaces": "wrong surfaces",
    "wrong_pixels": "wrong pixels",
    "wrong_colors": "wrong colors",
    "invalid": "claims of what does not exist",
    "unexplained": "unexplained pixels after correction",
    "displacement_rms_px": "displacement (rms)",
    "displacement_p99_px": "displacement (p99)",
    "displacement_max_px": "displacement (max)",
}
"""Names of measures in words."""


def is_count(name: str) -> bool:
    """Return whether a measure counts pixels or hogels; the others are distances in pixels."""
    return not name.endswith("_px")


@dataclass(frozen=True, kw_only=True)
class HogelMeasures:
    """The measures of one hogel, its place, and the property by which its pixels are wrong."""

    place: Place
    by: str | None
    measures: Measures


def measures_of(hogel: Hogel) -> HogelMeasures:
    """Return what is kept of a verified hogel: the figures of its image as it was delivered."""
    found, corrected = hogel.as_found, hogel.corrected
    if found is None or corrected is None:
        return HogelMeasures(place=hogel.aperture.index, by=None, measures=Measures(missing=1.0))
    spread = found.displacement_px
    # An image that shows nothing displaces nothing; `Limits.checks` knows which image that is.
    still = any(check.figure == DISPLACEMENT and check.value == 0 for check in hogel.checks)
    nothing = 0.0 if still else None
    measures = Measures(
        missing=0.0,
        wrong_surfaces=None if found.surface is None else float(found.surface.wrong),
        wrong_pixels=float(found.wrong),
        wrong_colors=None if found.radiance is None else float(found.radiance.wrong),
        invalid=float(found.invalid),
        unexplained=None if corrected.causes is None else float(corrected.causes["unexplained"]),
        displacement_rms_px=nothing if spread is None else spread.rms,
        displacement_p99_px=nothing if spread is None else spread.p99,
        displacement_max_px=nothing if spread is None else spread.max,
    )
    return HogelMeasures(place=hogel.aperture.index, by=found.by, measures=measures)


def total(hogels: Sequence[Measures]) -> Measures:
    """Return the measures of a plate: sums of counts, and the largest of distances."""
    numbers: dict[str, float | None] = {}
    for name in NAMES:
        known = [value for one in hogels if (value := one.value(name)) is not None]
        numbers[name] = None if not known else sum(known) if is_count(name) else max(known)
    return Measures(**numbers)
