"""Figures of all hogels together, and figures of one hogel or of all in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from xfrustum.compare.judging.image_displacement import MeasuredBy
from xfrustum.compare.judging.judged import (
    SURFACES,
    WRONG_WORDS,
    ColorFigures,
    HogelNumbers,
    SurfaceFigures,
)

DISPLACEMENT, COLORS = "displacement", "wrong colors"
"""Names of what is compared with limits, beside the kinds of wrong pixels that `compare.judging.judged`
names."""

NOT_MEASURED = "not measured, as there are no outlines"
"""Words for the displacement of an image whose truth has nothing that could be seen to move."""


@dataclass(frozen=True, kw_only=True)
class WorstDisplacement:
    """The 99th percentile of displacement of the hogel in which it is largest, pixels."""

    worst_p99: float


@dataclass(frozen=True, kw_only=True)
class PlateNumbers:
    """The numbers of all judged hogels together, as they are written; see `HogelNumbers`."""

    hogels: int
    by: str
    shown: int
    wrong: int
    fraction: float
    surface: SurfaceFigures | None
    invalid: int
    displacement_px: WorstDisplacement | None
    displacement_by: str
    radiance: ColorFigures | None
    causes: dict[str, int] | None


def totals(figures: Sequence[HogelNumbers | None]) -> PlateNumbers | None:
    """Return the figures of all hogels together, None where there are none."""
    known = [one for one in figures if one is not None]
    if not known:
        return None
    shown, wrong = sum(one.shown for one in known), sum(one.wrong for one in known)
    surfaces = [one.surface for one in known if one.surface is not None]
    spreads = [one.displacement_px.p99 for one in known if one.displacement_px is not None]
    colored = [one.radiance.wrong for one in known if one.radiance is not None]
    causes = [one.causes for one in known if one.causes is not None]
    surface = None
    if surfaces:
        of_surface = sum(one.wrong for one in surfaces)
        surface = SurfaceFigures(
            wrong=of_surface,
            fraction=of_surface / max(shown, 1),
            outside=sum(one.outside for one in surfaces),
        )
    return PlateNumbers(
        hogels=len(known),
        by=" or ".join(sorted({one.by for one in known})),
        shown=shown,
        wrong=wrong,
        fraction=wrong / shown if shown else 0.0,
        surface=surface,
        invalid=sum(one.invalid for one in known),
        displacement_px=WorstDisplacement(worst_p99=max(spreads)) if spreads else None,
        displacement_by=" or ".join(sorted({one.displacement_by for one in known})),
        radiance=ColorFigures(wrong=sum(colored)) if colored else None,
        causes={name: sum(one[name] for one in causes) for name in causes[0]} if causes else None,
    )


def percent(fraction: float) -> str:
    """Return a share in percent, with three digits."""
    return f"{100 * fraction:.3g} %"


def figures_words(figures: HogelNumbers | PlateNumbers) -> str:
    """Return figures of one hogel, or of all, in words; each says which wrong it counts."""
    parts = [f"{figures.shown:,} pixels show something"]
    if figures.surface is not None:
        outside = f", {figures.surface.outside:,} from outside the film" if figures.surface.outside else ""
        share = percent(figures.surface.fraction)
        parts.append(f"{SURFACES} {figures.surface.wrong:,} ({share}{outside})")
    counted = " or ".join(WRONG_WORDS[name] for name in figures.by.split(" or "))
    parts.append(f"{counted} {figures.wrong:,} ({percent(figures.fraction)})")
    if figures.invalid:
        parts.append(f"{figures.invalid:,} claim what does not exist")
    if figures.radiance is not None:
        parts.append(f"{COLORS} on right surfaces {figures.radiance.wrong:,}")
    text = ", ".join([*parts, _displacement_words(figures)])
    if figures.causes is not None and figures.wrong:
        causes = ", ".join(f"{name} {count:,}" for name, count in figures.causes.items())
        text += f"; causes of {counted}: {causes}"
    return text


def _displacement_words(figures: HogelNumbers | PlateNumbers) -> str:
    """Return the displacement in words, with what it was measured by."""
    whole = isinstance(figures, PlateNumbers)
    name = f"{DISPLACEMENT} (p99{' of the worst hogel' if whole else ''})"
    spread = figures.displacement_px
    if spread is None:
        if figures.displacement_by == MeasuredBy.NO_OUTLINES:
            return f"{name} {NOT_MEASURED}"
        return f"{name} unknown"
    p99 = spread.worst_p99 if isinstance(spread, WorstDisplacement) else spread.p99
    means = figures.displacement_by.split(" or ")
    by = " or ".join(one for one in means if one not in (MeasuredBy.NOTHING, MeasuredBy.NO_OUTLINES))
    some_unknown = " (in some hogels it cannot be known)" if MeasuredBy.NOTHING in means else ""
    return f"{name} {p99:.3g} px by {by}{some_unknown}"
