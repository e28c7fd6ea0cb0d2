"""The verdict engine: figures of hogel images, and the limits that they keep or exceed.

`Hogel.from_figures` makes the verdict on one image, and `Verdict` is the verdict on a plate.
Sentences about verdicts are made in `xfrustum.reports.verification.words`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Self

from xfrustum.compare.beyond import is_beyond
from xfrustum.compare.judging.judged import (
    MAX_MISSING_OUTLINES,
    ColorFigures,
    Figures,
    HogelNumbers,
    Judging,
    MeasuredBy,
    SurfaceFigures,
)
from xfrustum.compare.judging.where import Places, places_of
from xfrustum.compare.renderer_model.drawn_model import EVEN, RendererModel
from xfrustum.scenes.arguments import InputError, real
from xfrustum.scenes.plate import Aperture
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

DISPLACEMENT, COLORS = "displacement", "wrong colors"
INVALID, MISSING = "claims of what does not exist", "missing outlines"
"""Codes of figures with a limit, in addition to `HogelNumbers.limited_figure`."""

MAX_INVALID_SHARE = 0.5
"""Largest share of claims that name triangles or objects that do not exist, for all limits."""


class Outcome(StrEnum):
    """Verdict on a hogel or a plate."""

    PASS = "pass"
    FAIL = "fail"  # a limit is exceeded
    MISSING = "missing"  # the image is missing; a plate with such a hogel fails
    NOT_JUDGED = "not judged"  # no content of the image could exceed a limit


@dataclass(frozen=True, kw_only=True)
class Check:
    """One figure of a hogel and its limit, with the fields of the JSON object.

    A figure that cannot be measured exceeds its limit. Displacement is an exception: where colors
    are judged, it need not be measured for a truth without outlines.
    """

    figure: str
    value: float | None  #: None if it cannot be measured, or need not be
    limit: float | None  #: None without a limit
    unit: str  #: `share` of pixels, or `px` of displacement
    held: bool | None  #: None if no content of the image could exceed the limit

    @property
    def badness(self) -> tuple[bool, bool, float]:
        """Sort key of checks of one figure, the worst last."""
        unknown = math.inf if self.held is False else -1.0
        return self.held is False, self.held is None, unknown if self.value is None else self.value


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits within which a hogel is right, and how its image is judged."""

    wrong: float = MAX_WRONG  #: largest share of shown pixels with wrong surface, color or outline
    #: largest displacement of 99 % of the points or outlines; None without a limit
    displacement_px: float | None = TOLERANCE_PX
    judging: Judging = field(default_factory=Judging)

    def __post_init__(self) -> None:
        if not 0 <= real(self.wrong) <= 1:
            raise InputError(f"max-wrong must be a share between 0 and 100 %, not {self.wrong}")
        if self.displacement_px is not None and not real(self.displacement_px) >= 0:
            raise InputError(
                f"max-displacement-px must be a number, not negative: {self.displacement_px}"
            )
        if not real(self.judging.color_tolerance) >= 0:
            raise InputError(
                f"max-color must be a number, not negative: {self.judging.color_tolerance}"
            )

    def checks(self, figures: Figures, excused: int = 0) -> tuple[Check, ...]:
        """Compare figures with the limits (`compare.beyond`); `excused` wrong pixels do not count.

        Shares are of the shown pixels, so that empty film does not dilute them. A single wrong
        pixel does not count as a share, unless the limit is 0. Displacement is not required of an
        image that shows nothing. If the truth has no outline that could appear displaced, it is not
        required of colors either, and other images are not judged.
        """
        numbers, checks = figures.numbers, list[Check]()

        def limit_share(figure: str, value: float, limit: float, held: bool | None) -> None:
            unit = "share"
            checks.append(Check(figure=figure, value=value, limit=limit, unit=unit, held=held))

        counts = {numbers.limited_figure: numbers.limited - excused}
        if numbers.radiance is not None:
            counts[COLORS] = numbers.radiance.wrong
        for name, count in counts.items():
            share, single = count / max(numbers.shown, 1), count == 1 and self.wrong > 0
            held = single or not is_beyond(0.0, share, math.inf, self.wrong)
            limit_share(name, share, self.wrong, held)
        if numbers.invalid:
            share, most = numbers.invalid / figures.claimed, MAX_INVALID_SHARE
            limit_share(INVALID, share, most, share <= most)
        spread, most_px = numbers.displacement_px, self.displacement_px
        value = spread.p99 if spread is not None else None if figures.claimed else 0.0
        kept: bool | None = most_px is None or not is_beyond(value, 0.0, most_px)
        if value is None and numbers.displacement_by is MeasuredBy.NO_OUTLINES:
            kept = None if numbers.blind else True
        elif (outlines := numbers.outlines) is not None and outlines.shown:
            share, most = outlines.missing / outlines.shown, MAX_MISSING_OUTLINES
            # If most outlines may be invisible in the picture, the rest is not representative.
            doubtful = 2 * outlines.unknown > outlines.shown
            doubtful |= outlines.untold > self.wrong * numbers.shown
            limit_share(MISSING, share, most, False if share > most else None if doubtful else True)
        moved = Check(figure=DISPLACEMENT, value=value, limit=most_px, unit="px", held=kept)
        return (*checks, moved)

    def mends(self, as_found: Figures, corrected: Figures, model: RendererModel) -> bool:
        """Return whether an image is right after correction, wrong pixels by rounding excused.

        An image that failed before correction must pass. An image that could not be judged before
        does not refute the correction unless it fails.
        """
        # The true places of surface points on an uneven film are unknown.
        limits = self if model.film == EVEN else replace(self, displacement_px=None)
        before = [check.held for check in self.checks(as_found)]
        after = [check.held for check in limits.checks(corrected, corrected.rounded)]
        return all(after) or (False not in before + after and None in before)


@dataclass(frozen=True, kw_only=True)
class Hogel:
    """Verdict on one hogel: a problem, or figures as found and corrected, and the checks."""

    aperture: Aperture
    problem: str | None = None  #: reason why the image is missing
    as_found: HogelNumbers | None = None
    corrected: HogelNumbers | None = None
    checks: tuple[Check, ...] = ()
    places: Places | None = None  #: places of its wrong pixels before correction
    left: int = 0  #: wrong pixels that remain after correction, except by rounding
    mended: bool = True  #: whether the image is right after correction
    storage: str | None = None  #: file format that changed the pixels, such as "JPEG, lossy"

    @classmethod
    def from_figures(
        cls,
        limits: Limits,
        aperture: Aperture,
        model: RendererModel,
        as_found: Figures,
        corrected: Figures,
    ) -> Self:
        """Judge an image by its figures as found, and as corrected for a diagnosed model."""
        return cls(
            aperture=aperture,
            as_found=as_found.numbers,
            corrected=corrected.numbers,
            checks=limits.checks(as_found),
            places=places_of(as_found),
            left=corrected.numbers.all_wrong - corrected.rounded,
            mended=limits.mends(as_found, corrected, model),
            storage=as_found.image.storage,
        )

    @property
    def verdict(self) -> Outcome:
        """Outcome of the checks; missing where there is no image."""
        if self.problem is not None:
            return Outcome.MISSING
        held = [check.held for check in self.checks]
        if False in held:
            return Outcome.FAIL
        return Outcome.NOT_JUDGED if None in held else Outcome.PASS

    @property
    def passed(self) -> bool:
        """True if the image exists and keeps every limit."""
        return self.verdict is Outcome.PASS


@dataclass(frozen=True, kw_only=True)
class PlateNumbers:
    """Numbers of all judged hogels together; see `HogelNumbers`."""

    hogels: int
    by: str
    shown: int
    wrong: int
    fraction: float
    surface: SurfaceFigures | None
    invalid: int
    displacement_px: dict[str, float] | None  #: `worst_p99`: largest p99 of a hogel
    displacement_by: str
    radiance: ColorFigures | None
    causes: dict[str, int] | None

    @classmethod
    def from_hogels(cls, figures: Sequence[HogelNumbers | None]) -> PlateNumbers | None:
        """Return the figures of all hogels together, None if there are none."""
        known = [figure for figure in figures if figure is not None]
        if not known:
            return None
        shown, wrong, invalid = (
            sum(getattr(numbers, name) for numbers in known)
            for name in ("shown", "wrong", "invalid")
        )
        spreads = [numbers.displacement_px.p99 for numbers in known if numbers.displacement_px]
        colored = [numbers.radiance.wrong for numbers in known if numbers.radiance]
        surfaces = [numbers.surface for numbers in known if numbers.surface]
        bad, outside = (
            sum(getattr(surface, name) for surface in surfaces) for name in ("wrong", "outside")
        )
        surface = SurfaceFigures(wrong=bad, fraction=bad / max(shown, 1), outside=outside)
        causes = Counter[str]()
        for numbers in known:
            causes.update(numbers.causes or {})
        return cls(
            hogels=len(known),
            by=" or ".join(sorted({numbers.by for numbers in known})),
            shown=shown,
            wrong=wrong,
            fraction=wrong / max(shown, 1),
            surface=surface if surfaces else None,
            invalid=invalid,
            displacement_px={"worst_p99": max(spreads)} if spreads else None,
            displacement_by=" or ".join(sorted({numbers.displacement_by for numbers in known})),
            radiance=ColorFigures(wrong=sum(colored)) if colored else None,
            causes=dict(causes) or None,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict:
    """Verdict on some hogels of a plate by its limits."""

    limits: Limits
    hogels: tuple[Hogel, ...]

    @property
    def passed(self) -> bool:
        """True if every hogel exists and keeps the limits."""
        return all(hogel.passed for hogel in self.hogels)

    @property
    def verdict(self) -> Outcome:
        """The verdict on all hogels: not judged if none fails and some could not be judged."""
        if self.passed:
            return Outcome.PASS
        outcomes = {hogel.verdict for hogel in self.hogels}
        judged = outcomes <= {Outcome.PASS, Outcome.NOT_JUDGED}
        return Outcome.NOT_JUDGED if judged else Outcome.FAIL

    @property
    def checks(self) -> tuple[Check, ...]:
        """Worst hogel's check of each figure: limits hold for every hogel."""
        worst: dict[str, Check] = {}
        for check in (check for hogel in self.hogels for check in hogel.checks):
            known = worst.get(check.figure, check)
            worst[check.figure] = max(known, check, key=lambda entry: entry.badness)
        return tuple(worst.values())

    @property
    def as_found(self) -> PlateNumbers | None:
        """Figures of all hogels as they were delivered."""
        return PlateNumbers.from_hogels([hogel.as_found for hogel in self.hogels])

    @property
    def corrected(self) -> PlateNumbers | None:
        """Figures of all hogels after correction for the diagnosis."""
        return PlateNumbers.from_hogels([hogel.corrected for hogel in self.hogels])
