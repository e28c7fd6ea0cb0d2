"""The answer to `xfrustum verify`: limits, every hogel's figures, and all of them together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from xfrustum.compare.diagnosis import Diagnosis
from xfrustum.compare.judged import Figures
from xfrustum.reports.worst_hogels import WorstHogels
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.scene import Scene


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What is still right.

    Attributes
    ----------
    wrong
        Share of the pixels where image or answer shows a surface.
    displacement_px
        By which 99 of 100 surface points may be off.
    """

    wrong: float = 0.01
    displacement_px: float = 0.5

    def __post_init__(self) -> None:
        if not 0 <= self.wrong <= 1:
            raise InputError(f"max-wrong must be a share between 0 and 100 %, not {self.wrong}")
        if not self.displacement_px >= 0:
            raise InputError(f"max-displacement-px must not be negative, not {self.displacement_px}")

    def hold(self, figures: Figures) -> bool:
        """Return whether an image keeps to them; a single pixel is never more than a share."""
        count = figures.wrong if figures.surface is None else figures.surface
        spread = figures.displacement_px
        worst = max(count, figures.radiance or 0)
        return bool(worst <= np.ceil(self.wrong * figures.shown)) and (
            spread is None or spread.p99 <= self.displacement_px
        )


@dataclass(frozen=True, kw_only=True)
class Hogel:
    """What was found of one hogel: a problem, or figures as found and corrected."""

    aperture: Aperture
    passed: bool
    problem: str | None = None
    as_found: dict[str, Any] | None = None
    corrected: dict[str, Any] | None = None

    def summary(self) -> dict[str, Any]:
        """Return it as `verify --json` prints it."""
        verdict = "missing" if self.problem else "pass" if self.passed else "fail"
        return {
            "aperture": list(self.aperture.index),
            "verdict": verdict,
            "problem": self.problem,
            "as_found": self.as_found,
            "corrected": self.corrected,
        }


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

    def summary(self) -> dict[str, Any]:
        """Return it as `verify --json` prints it."""
        return {
            "verdict": "pass" if self.passed else "fail",
            "scene": self.scene.name,
            "source": self.source,
            "limits": {"wrong": self.limits.wrong, "displacement_px": self.limits.displacement_px},
            "diagnosis": [fault.summary() for fault in self.diagnosis.faults],
            "does_not_explain": [fault.summary() for fault in self.diagnosis.does_not_explain],
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
    colored = [one["radiance"]["wrong"] for one in known if one["radiance"] is not None]
    reasons = [one["causes"] for one in known if one["causes"] is not None]
    return {
        "hogels": len(known),
        "shown": shown,
        "wrong": wrong,
        "fraction": wrong / shown if shown else 0.0,
        "surface": {"wrong": sum(surfaces), "fraction": sum(surfaces) / max(shown, 1)} if surfaces else None,
        "displacement_px": {"worst_p99": max(spreads)} if spreads else None,
        "radiance": {"wrong": sum(colored)} if colored else None,
        "causes": {name: sum(one[name] for one in reasons) for name in reasons[0]} if reasons else None,
    }
