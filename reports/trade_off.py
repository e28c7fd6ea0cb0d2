"""Error against time: which configurations are worth it, and which is the cheapest within a tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from xfrustum.reports.best import digits, percent, pixels
from xfrustum.reports.measurement import Measurement, Sweep
from xfrustum.reports.timing import Spread

MAX_WRONG = 1e-2
"""Share of pixels with a wrong surface beyond which a picture is not within any tolerance. Displacement is
judged by its 99th percentile, which leaves one pixel in a hundred out; as many may show another surface."""

TOLERANCE_PX = 0.5
STRICTER = 0.2
"""Of the tolerance: what is asked besides, a tenth of a pixel where half a pixel is asked for."""


@dataclass(frozen=True, kw_only=True)
class Option:
    """One way to make a picture: its error and its time.

    Attributes
    ----------
    renderer
        `raster`, `embree`, `mitsuba` or `certified`.
    label
        The configuration in words.
    configuration
        The same as names and values.
    displacement_p99_px, surface_fraction
        Its error.
    time_s
        Seconds of a whole picture with read-back, over repetitions.
    gpu_s, read_s
        Of that, what the device drew, and what read-back took; None for who does not draw.
    """

    renderer: str
    label: str
    configuration: dict[str, Any]
    displacement_p99_px: float
    surface_fraction: float
    time_s: Spread
    gpu_s: Spread | None = None
    read_s: Spread | None = None

    def within(self, tolerance_px: float) -> bool:
        """Whether its error is below a tolerance."""
        return self.displacement_p99_px <= tolerance_px and self.surface_fraction <= MAX_WRONG

    def beats(self, other: Option) -> bool:
        """Whether it is nowhere worse than another, and somewhere better."""
        mine, others = self._worth(), other._worth()
        return mine != others and all(one <= two for one, two in zip(mine, others, strict=True))

    def _worth(self) -> tuple[float, float, float]:
        return self.time_s.median, self.displacement_p99_px, self.surface_fraction


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The cheapest option within a tolerance; None where there is none."""

    tolerance_px: float
    option: Option | None
    sentence: str


def pareto(options: Sequence[Option]) -> list[bool]:
    """Return which options no other one beats in time, displacement and wrong surfaces together."""
    return [not any(other.beats(option) for other in options) for option in options]


def cheapest(options: Sequence[Option], tolerance_px: float) -> Option | None:
    """Return the fastest option within a tolerance.

    Times are known no better than their spread: of all whose median is not beyond the fastest's own
    slowest repetition, the one with the least error.
    """
    allowed = [option for option in options if option.within(tolerance_px)]
    if not allowed:
        return None
    fastest = min(allowed, key=lambda option: option.time_s.median)
    as_fast = [option for option in allowed if option.time_s.median <= fastest.time_s.highest]
    return min(as_fast, key=lambda one: (one.displacement_p99_px, one.surface_fraction, one.time_s.median))


def answers(options: Sequence[Option], tolerance_px: float = TOLERANCE_PX) -> tuple[Answer, ...]:
    """Return what a tolerance costs, and what a fifth of it would cost, in words."""
    chosen = [cheapest(options, tolerance) for tolerance in (tolerance_px, STRICTER * tolerance_px)]
    first, second = chosen
    return (
        Answer(
            tolerance_px=tolerance_px,
            option=first,
            sentence=_none(tolerance_px)
            if first is None
            else f"The fastest way to stay under {digits(tolerance_px)} px: {_described(first)}.",
        ),
        Answer(
            tolerance_px=STRICTER * tolerance_px,
            option=second,
            sentence=_none(STRICTER * tolerance_px)
            if second is None
            else _stricter(STRICTER * tolerance_px, first, second),
        ),
    )


def _stricter(tolerance_px: float, loose: Option | None, strict: Option) -> str:
    if loose is strict:
        return f"{digits(tolerance_px)} px would cost nothing more: the same configuration keeps it."
    times = "" if loose is None else f" {strict.time_s.median / loose.time_s.median:.2f} times the time"
    colon = ":" if loose is None else " of that:"
    return f"{digits(tolerance_px)} px would cost{times}{colon} {_described(strict)}."


def _none(tolerance_px: float) -> str:
    return (
        f"Nothing that was measured stays under {digits(tolerance_px)} px with at most "
        f"{percent(MAX_WRONG)} of wrong surfaces."
    )


def _described(option: Option) -> str:
    time = option.time_s
    spread = (
        f" ({1000 * time.lowest:.3g} to {1000 * time.highest:.3g})"
        if time.repetitions > 1
        else ", taken once"
    )
    return (
        f"{option.label}, {1000 * time.median:.3g} ms a picture{spread}; 99 % of it lies within "
        f"{pixels(option.displacement_p99_px)} of where it belongs, and {percent(option.surface_fraction)} "
        "of the judged pixels show the wrong surface"
    )


def options_of(sweep: Sweep) -> list[Option]:
    """Return the settings of a sweep as options, the worst aperture's errors, and the certified truth."""
    grouped: dict[str, list[Measurement]] = {}
    for row in sweep.rows:
        grouped.setdefault(raster_label(row, sweep), []).append(row)
    traced = {row.aperture: row.times_s["trace"] for row in sweep.rows}
    return [
        Option(
            renderer="raster",
            label=label,
            configuration={"near": rows[0].settings.near, "depth": rows[0].settings.depth_label},
            displacement_p99_px=max(row.displacement_p99_px for row in rows),
            surface_fraction=max(row.surface_fraction for row in rows),
            time_s=Spread.of([row.times_s["raster"] for row in rows]),
            gpu_s=Spread.of([row.times_s["gpu"] for row in rows]),
        )
        for label, rows in grouped.items()
    ] + [certified(Spread.of(list(traced.values())))]


def raster_label(row: Measurement, sweep: Sweep) -> str:
    """Return the words for a row's settings."""
    scene = sweep.scene
    return near_label(row.settings.near, scene.units, scene.frustum.longest_reach, row.settings.depth_label)


def near_label(near: float, units: str, reach: float, depth: str) -> str:
    """Return the words for a near plane with a depth buffer."""
    return f"raster, near {digits(near)} {units} ({digits(near / reach)} of the reach) with {depth} depth"


def certified(time_s: Spread) -> Option:
    """Return the truth, which has no error."""
    return Option(
        renderer="certified",
        label="the certified truth",
        configuration={"certified": True},
        displacement_p99_px=0.0,
        surface_fraction=0.0,
        time_s=time_s,
    )


def summary(options: Sequence[Option], tolerance_px: float = TOLERANCE_PX) -> dict[str, Any]:
    """Return options and answers as `cost --json` prints them."""
    return {
        "rows": [
            {
                "renderer": option.renderer,
                "label": option.label,
                **option.configuration,
                "error": {
                    "displacement_p99_px": option.displacement_p99_px,
                    "surface_fraction": option.surface_fraction,
                },
                "time_s": _seconds(option.time_s),
                "gpu_s": _seconds(option.gpu_s),
                "read_back_s": _seconds(option.read_s),
                "pareto": best,
            }
            for option, best in zip(options, pareto(options), strict=True)
        ],
        "answers": [
            {
                "tolerance_px": answer.tolerance_px,
                "configuration": answer.option and answer.option.label,
                "time_s": _seconds(answer.option.time_s) if answer.option else None,
                "sentence": answer.sentence,
            }
            for answer in answers(options, tolerance_px)
        ],
    }


def _seconds(spread: Spread | None) -> dict[str, float] | None:
    if spread is None or not math.isfinite(spread.median):
        return None
    return {"median": spread.median, "low": spread.lowest, "high": spread.highest}
