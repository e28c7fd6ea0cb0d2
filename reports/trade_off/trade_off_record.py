"""Error against time as `cost --json` prints it: the options and what tolerances cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from xfrustum.reports.common.json_ready import INLINED
from xfrustum.reports.common.timing import Timing
from xfrustum.reports.trade_off.trade_off import Configuration, FastestWithin, Option, answers, pareto
from xfrustum.tolerances import TOLERANCE_PX


@dataclass(frozen=True, kw_only=True)
class TimeRecord:
    """Repeated seconds of one thing.

    Attributes
    ----------
    median, low, high
        Median, fastest and slowest of the repetitions.
    interval
        Ends of the interval of the median.
    repetitions
        Number of repetitions.
    """

    median: float
    low: float
    high: float
    interval: tuple[float, float]
    repetitions: int

    @classmethod
    def of(cls, times: Timing | None) -> TimeRecord | None:
        """Return the record of some repetitions; None where there are none."""
        if times is None or not math.isfinite(times.median):
            return None
        return cls(
            median=times.median,
            low=times.lowest,
            high=times.highest,
            interval=times.interval,
            repetitions=times.repetitions,
        )


@dataclass(frozen=True, kw_only=True)
class ErrorRecord:
    """The error of an option: 99th percentile of displacement, and the share of wrong surfaces."""

    displacement_p99_px: float
    surface_fraction: float


@dataclass(frozen=True, kw_only=True)
class OptionRecord:
    """An option with its error and its times; `pareto` says whether no other option beats it."""

    renderer: str
    label: str
    configuration: Configuration = field(metadata=INLINED)
    error: ErrorRecord
    time_s: TimeRecord | None
    gpu_s: TimeRecord | None
    read_back_s: TimeRecord | None
    pareto: bool


@dataclass(frozen=True, kw_only=True)
class AnswerRecord:
    """What a tolerance costs; see `trade_off.FastestWithin`.

    Attributes
    ----------
    configuration, time_s
        The option with the least error of the fastest ones, and its time; None where nothing keeps the
        tolerance.
    ranked
        Whether there were enough repetitions to rank options by time.
    fastest
        The fastest options, in words.
    """

    tolerance_px: float
    configuration: str | None
    time_s: TimeRecord | None
    ranked: bool
    fastest: tuple[str, ...]
    sentence: str


@dataclass(frozen=True, kw_only=True)
class TradeOffRecord:
    """All options, and what tolerances cost."""

    rows: tuple[OptionRecord, ...]
    answers: tuple[AnswerRecord, ...]


def trade_off_record(options: Sequence[Option], tolerance_px: float = TOLERANCE_PX) -> TradeOffRecord:
    """Return options and answers as `cost --json` prints them; see `trade_off.answers`."""
    return TradeOffRecord(
        rows=tuple(_option(option, best) for option, best in zip(options, pareto(options), strict=True)),
        answers=tuple(_answer(answer) for answer in answers(options, tolerance_px)),
    )


def _option(option: Option, best: bool) -> OptionRecord:
    return OptionRecord(
        renderer=option.renderer,
        label=option.label,
        configuration=option.configuration,
        error=ErrorRecord(
            displacement_p99_px=option.displacement_p99_px, surface_fraction=option.surface_fraction
        ),
        time_s=TimeRecord.of(option.time_s),
        gpu_s=TimeRecord.of(option.gpu_s),
        read_back_s=TimeRecord.of(option.read_s),
        pareto=best,
    )


def _answer(answer: FastestWithin) -> AnswerRecord:
    option, ranking = answer.option, answer.ranking
    return AnswerRecord(
        tolerance_px=answer.tolerance_px,
        configuration=option.label if option else None,
        time_s=TimeRecord.of(option.time_s) if option else None,
        ranked=ranking is not None and ranking.ranked,
        fastest=tuple(one.label for one in ranking.fastest) if ranking else (),
        sentence=answer.sentence,
    )
