"""The answer to `xfrustum verify`: limits, every hogel's figures, and all of them together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from xfrustum.compare.diagnosis.diagnosis import Diagnosis
from xfrustum.compare.judging.judged import Figures, Judging
from xfrustum.reports.verification.worst_hogels import WorstHogels
from xfrustum.scenes.arguments import real
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

DISPLACEMENT, COLORS, INVALID = "displacement", "wrong colors", "claims of what does not exist"
"""Names of what is compared with limits, beside the kinds of wrong pixels that `compare.judging.judged`
names."""

MOST_INVALID = 0.5
"""Share of the pixels in which an image shows something that may claim what does not exist, whatever the
limits."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """One figure of a hogel and the limit that it is compared with.

    Attributes
    ----------
    figure
        What is limited, in words.
    value
        Its size: a share of pixels, or pixels of displacement; None where it cannot be known.
    limit
        What it may be at most; None where nothing is limited.
    unit
        `share` or `px`.
    held
        Whether the limit is kept. What cannot be known keeps none.
    """

    figure: str
    value: float | None
    limit: float | None
    unit: str
    held: bool

    @property
    def words(self) -> str:
        """The figure and its limit, as text, page and JUnit print them."""
        limit = "no limit" if self.limit is None else f"limit {_sized(self.limit, self.unit)}"
        value = "unknown" if self.value is None else _sized(self.value, self.unit)
        return f"{self.figure} {value} ({limit})"

    def summary(self) -> dict[str, str | float | bool | None]:
        """Return it as `verify --json` prints it."""
        return asdict(self)


def _sized(value: float, unit: str) -> str:
    return percent(value) if unit == "share" else f"{value:.3g} px"


def percent(fraction: float) -> str:
    """Return a share in percent, with three digits."""
    return f"{100 * fraction:.3g} %"


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What is still right.

    Attributes
    ----------
    wrong
        Share of the pixels where image or answer shows a surface that may be wrong: of wrong surfaces, where
        images tell surfaces; else of wrong colors or outlines, whichever are compared.
    displacement_px
        By which 99 of 100 surface points or outlines may be off; None where that does not matter.
    judging
        What pictures are compared by, and by how much colors may differ.
    """

    wrong: float = MAX_WRONG
    displacement_px: float | None = TOLERANCE_PX
    judging: Judging = field(default_factory=Judging)

    def __post_init__(self) -> None:
        if not 0 <= real(self.wrong) <= 1:
            raise InputError(f"max-wrong must be a share between 0 and 100 %, not {self.wrong}")
        if self.displacement_px is not None and not real(self.displacement_px) >= 0:
            raise InputError(f"max-displacement-px must be a number, not negative: {self.displacement_px}")
        if not real(self.judging.color_tolerance) >= 0:
            raise InputError(f"max-color must be a number, not negative: {self.judging.color_tolerance}")

    def checks(self, figures: Figures) -> tuple[Check, ...]:
        """Compare an image's figures with the limits; a single pixel is never more than a share."""
        shown = max(figures.shown, 1)

        def share(name: str, count: int) -> Check:
            held = bool(count <= np.ceil(self.wrong * figures.shown))
            return Check(figure=name, value=count / shown, limit=self.wrong, unit="share", held=held)

        found = [share(figures.limited_words, figures.limited)]
        if figures.radiance is not None:
            found.append(share(COLORS, figures.radiance))
        if figures.invalid:
            found.append(
                Check(
                    figure=INVALID,
                    value=figures.invalid / figures.claimed,
                    limit=MOST_INVALID,
                    unit="share",
                    held=not figures.mostly_invalid,
                )
            )
        return (*found, self._displacement(figures))

    def _displacement(self, figures: Figures) -> Check:
        """Compare a displacement; of an image that shows nothing there is none, and none is asked for."""
        spread, limit = figures.displacement_px, self.displacement_px
        value = spread.p99 if spread is not None else None if figures.claimed else 0.0
        held = limit is None or (value is not None and value <= limit)
        return Check(figure=DISPLACEMENT, value=value, limit=limit, unit="px", held=held)


def worst_checks(hogels: Sequence[tuple[Check, ...]]) -> tuple[Check, ...]:
    """Return of each figure the hogel's that is worst: limits are for every hogel, not for their mean."""
    worst: dict[str, Check] = {}
    for check in (check for checks in hogels for check in checks):
        known = worst.get(check.figure)
        if known is None or _badness(check) > _badness(known):
            worst[check.figure] = check
    return tuple(worst.values())


def _badness(check: Check) -> tuple[bool, float]:
    return not check.held, np.inf if check.value is None else check.value


@dataclass(frozen=True, kw_only=True)
class Hogel:
    """What was found of one hogel: a problem, or figures as found and corrected, and the limits kept."""

    aperture: Aperture
    problem: str | None = None
    as_found: dict[str, Any] | None = None
    corrected: dict[str, Any] | None = None
    checks: tuple[Check, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether it is there and keeps to every limit."""
        return self.problem is None and all(check.held for check in self.checks)

    @property
    def verdict(self) -> str:
        """One word: pass, fail, or missing."""
        return "missing" if self.problem else "pass" if self.passed else "fail"

    def summary(self) -> dict[str, Any]:
        """Return it as `verify --json` prints it."""
        return {
            "aperture": list(self.aperture.index),
            "verdict": self.verdict,
            "problem": self.problem,
            "checks": [check.summary() for check in self.checks],
            "as_found": self.as_found,
            "corrected": self.corrected,
        }


JUDGED_WORDS = {
    "triangle": "surfaces, by the triangles that pixels name",
    "object": "surfaces, by the objects that pixels name",
    "coverage": "surfaces, by where something is shown",
    "outlines": "geometry: where pictures show something, and where outlines run, in whatever shading",
}
"""What is judged of images that are compared by `Figures.by`; of plain pictures it is colors, unless geometry
was asked for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Verification:
    """The answer.

    Attributes
    ----------
    scene, source
        What was asked, and the name of who answered.
    limits, diagnosis, hogels
        What is still right, what was found, and every hogel.
    worst
        Pictures of the worst hogels.
    """

    scene: Scene
    source: str
    limits: Limits
    diagnosis: Diagnosis
    hogels: tuple[Hogel, ...]
    worst: WorstHogels = field(repr=False)

    @property
    def passed(self) -> bool:
        """Whether every hogel is there and keeps to the limits."""
        return all(hogel.passed for hogel in self.hogels)

    @property
    def checks(self) -> tuple[Check, ...]:
        """Of each figure that is compared with a limit, the worst hogel's."""
        return worst_checks([hogel.checks for hogel in self.hogels])

    @property
    def judged(self) -> str:
        """What was judged, in words."""
        judging = self.limits.judging
        by = {one["by"] for one in (hogel.as_found for hogel in self.hogels) if one is not None}
        words = [JUDGED_WORDS[name] for name in JUDGED_WORDS if name in by]
        colored = any(h.as_found is not None and h.as_found["radiance"] is not None for h in self.hogels)
        if colored or "color" in by:
            words.append(f"colors to within {judging.color_tolerance:.3g} of linear radiance")
        return ", and ".join(words) or "nothing"

    @property
    def explained(self) -> bool | None:
        """Whether the diagnosis explains what is wrong; None where no image that was judged is."""
        if self.diagnosis.faults:
            return True
        wrong = not all(check.held for hogel in self.hogels for check in hogel.checks)
        return False if wrong or self.diagnosis.does_not_explain else None

    def summary(self) -> dict[str, Any]:
        """Return it as `verify --json` prints it."""
        return {
            "verdict": "pass" if self.passed else "fail",
            "scene": self.scene.name,
            "source": self.source,
            "limits": {
                "wrong": self.limits.wrong,
                "displacement_px": self.limits.displacement_px,
                "color": self.limits.judging.color_tolerance,
            },
            "compared": str(self.limits.judging.compared),
            "judged": self.judged,
            "checks": [check.summary() for check in self.checks],
            "diagnosis": [fault.summary() for fault in self.diagnosis.faults],
            "does_not_explain": [fault.summary() for fault in self.diagnosis.does_not_explain],
            "explained": self.explained,
            "found_by": self.diagnosis.means,
            "as_found": totals([hogel.as_found for hogel in self.hogels]),
            "corrected": totals([hogel.corrected for hogel in self.hogels]),
            "hogels": [hogel.summary() for hogel in self.hogels],
        }


def totals(figures: Sequence[dict[str, Any] | None]) -> dict[str, Any] | None:
    """Return the figures of all hogels together, None where there are none."""
    known = [one for one in figures if one is not None]
    if not known:
        return None
    shown, wrong = (sum(one[name] for one in known) for name in ("shown", "wrong"))
    surfaces = [one["surface"]["wrong"] for one in known if one["surface"] is not None]
    spreads = [one["displacement_px"]["p99"] for one in known if one["displacement_px"] is not None]
    means = sorted({one["displacement_by"] for one in known})
    colored = [one["radiance"]["wrong"] for one in known if one["radiance"] is not None]
    reasons = [one["causes"] for one in known if one["causes"] is not None]
    return {
        "hogels": len(known),
        "by": " or ".join(sorted({one["by"] for one in known})),
        "shown": shown,
        "wrong": wrong,
        "fraction": wrong / shown if shown else 0.0,
        "surface": {"wrong": sum(surfaces), "fraction": sum(surfaces) / max(shown, 1)} if surfaces else None,
        "invalid": sum(one["invalid"] for one in known),
        "displacement_px": {"worst_p99": max(spreads)} if spreads else None,
        "displacement_by": " or ".join(means),
        "radiance": {"wrong": sum(colored)} if colored else None,
        "causes": {name: sum(one[name] for one in reasons) for name in reasons[0]} if reasons else None,
    }
