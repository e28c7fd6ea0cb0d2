"""The verdict engine: limits on the figures of hogel images, places of wrong pixels, verdicts.

`Hogel.from_figures` makes the verdict on one image, and `Verdict` is the verdict on a plate. Places
are the side of the plate, object, hogel, and distance from outlines. Sentences about verdicts are
made in `xfrustum.reports.verification.words`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import PurePath
from typing import Any, Self

import numpy as np
from scipy.ndimage import distance_transform_edt

from xfrustum.compare.error_maps import covered_by
from xfrustum.compare.judging.judged import (
    COLOR_ONLY,
    MAX_MISSING_OUTLINES,
    ColorFigures,
    Figures,
    HogelNumbers,
    Judging,
    MeasuredBy,
    SurfaceFigures,
)
from xfrustum.compare.judging.outlines import steps_of
from xfrustum.compare.renderer_model.drawn_model import EVEN, RendererModel
from xfrustum.compare.renderer_model.pictures import shows_something
from xfrustum.compare.sampling import is_beyond
from xfrustum.scenes.arguments import InputError, real
from xfrustum.scenes.model.images import NOTHING
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

DISTANCES_PX = (1.5, 4.5)
"""Upper ends of the distance ranges, px: pixels next to an outline, and its surroundings."""

Places = dict[str, tuple[int, int]]
"""Numbers of wrong pixels and of pixels where image or truth shows something, by place."""


def places_of(figures: Figures) -> Places:
    """Return the places of the wrong pixels of one hogel."""
    answer, error = figures.answer, figures.error
    # Plain pictures identify no surfaces: pixels that are not black count as shown.
    shows = shows_something if figures.numbers.by in COLOR_ONLY else covered_by
    covered = shows(figures.image)
    shown = answer.covered | covered | error
    across, down = steps_of(answer.object)
    outline = np.pad(across > 0, ((0, 0), (0, 1))) | np.pad(down > 0, ((0, 1), (0, 0)))
    apart = distance_transform_edt(~outline) if outline.any() else np.full(outline.shape, np.inf)
    near, far = DISTANCES_PX
    masks = {
        "side/front": answer.height > 0,
        "side/back": answer.height <= 0,
        "side/nothing": ~answer.covered,
        "distance/within 1 px": apart <= near,
        "distance/2 to 4 px": (apart > near) & (apart <= far),
        "distance/farther": apart > far,
        "shown/nothing": ~covered,
    }
    for number in np.unique(answer.object[answer.object != NOTHING]).tolist():
        masks[f"object/{number}"] = answer.object == number
    return {
        name: (int((mask & error).sum()), int((mask & shown).sum())) for name, mask in masks.items()
    }


def where_wrong(scene: Scene, hogels: Iterable[tuple[Aperture, Places]]) -> dict[str, Any] | None:
    """Return wrong and shown pixels of all hogels by place; None if none is wrong."""
    wrong, shown = Counter[str](), Counter[str]()
    for aperture, places in hogels:
        sides = [count for name, count in places.items() if name.startswith("side/")]
        total = (sum(camera for camera, _ in sides), sum(camera for _, camera in sides))
        lines = {f"row/{aperture.row}": total, f"column/{aperture.column}": total}
        for name, (bad, of) in (places | lines).items():
            wrong[name] += bad
            shown[name] += of
    if not any(wrong.values()):
        return None
    shares: dict[str, Any] = {}
    for name in sorted(shown, key=lambda entry: (entry.split("/")[0], shown[entry] == 0)):
        group, place = name.split("/")
        if group == "object":
            place = f"{place} ({PurePath(scene.objects[int(place)].name).stem})"
        if shown[name]:
            share = wrong[name] / shown[name]
            counts = {"wrong": wrong[name], "shown": shown[name], "fraction": share}
            shares.setdefault(group, {})[place] = counts
    return shares


def wrong_counts(scene: Scene, hogels: Sequence[tuple[Aperture, Places]]) -> dict[str, Any] | None:
    """Return the numbers of wrong pixels, `where` of `verify --json`; None if nothing is wrong.

    `front` is the content in front of the plate, drawn by C*. `hogels` has a list for each row of
    the plate, with None for hogels that were not judged; `shares` is the result of `where_wrong`.
    """
    shares = where_wrong(scene, hogels)
    if shares is None:
        return None
    columns, rows = scene.plate.hogels
    plate: list[list[int | None]] = [[None] * columns for _ in range(rows)]
    for aperture, places in hogels:
        wrong = (count for name, (count, _) in places.items() if name.startswith("side/"))
        plate[aperture.row][aperture.column] = sum(wrong)
    sides, objects = (
        {place: counts["wrong"] for place, counts in shares.get(group, {}).items()}
        for group in ("side", "object")
    )
    sides = {"front": 0, "back": 0} | sides
    return {"sides": sides, "objects": objects, "hogels": plate, "shares": shares}


DISPLACEMENT, COLORS = "displacement", "wrong colors"
INVALID, MISSING = "claims of what does not exist", "missing outlines"
"""Codes of figures with a limit, in addition to `HogelNumbers.limited_figure`."""

MAX_INVALID_SHARE = 0.5
"""Largest share of pixels that name triangles or objects which the scene does not have."""


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
        """Compare figures with the limits (`is_beyond`); `excused` wrong pixels do not count.

        Shares are of the shown pixels, so that empty film does not dilute them. A single wrong
        pixel does not count as a share, unless the limit is 0. Displacement is not required of an
        image that shows nothing. If the truth has no outline that could appear displaced,
        displacement is not required of colors either, and other images are not judged.
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
        """Return whether an image is right after correction, except for pixels wrong by rounding.

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
    left: int = 0  #: wrong pixels that remain after correction, not counting rounding
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
        """Worst hogel's check of each figure: limits apply to every hogel."""
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
