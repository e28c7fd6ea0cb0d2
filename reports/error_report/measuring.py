"""How settings are measured at an aperture: truth, frames, comparisons, predictions, and their times."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare import Comparison
from xfrustum.compare.attribution.budget import Budget
from xfrustum.compare.judging.engine import JudgedFrame, TracedHogel, Wanted
from xfrustum.compare.judging.judge import Judge
from xfrustum.compare.metrics.paired import PixelSet
from xfrustum.compare.metrics.radiance import STEP
from xfrustum.raster import Rasterizer
from xfrustum.reference.alone import TracersAlone
from xfrustum.reference.plain import CERTIFIED
from xfrustum.reports.common.timing import FEWEST_REPETITIONS, Stopwatch, Timing
from xfrustum.reports.common.turns import open_races, take_turn, take_turns_until_settled
from xfrustum.reports.error_report import images
from xfrustum.reports.error_report.causes import CAUSE_COLORS
from xfrustum.reports.measurements.measurement import (
    Measurement,
    RasterParts,
    SettingPictures,
    StageParts,
    TracersAlonePictured,
)
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.look import is_shaded
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

REPEAT_BUDGET_S = 20.0
"""Largest number of wall seconds for drawing frames again to time them: a fifth of the time of a default
report, of 125 settings, at 512 x 512 with a software renderer."""


@dataclass(frozen=True, kw_only=True)
class TracedAperture:
    """What a report shows of the truth of an aperture.

    Attributes
    ----------
    picture
        The truth as an encoded picture.
    alone
        How many pixels each ray tracer alone would have got wrong, with pictures; None where the truth is
        not certified.
    """

    picture: bytes
    alone: TracersAlonePictured | None


@dataclass(frozen=True, kw_only=True)
class MeasuredSetting:
    """One setting at one aperture: its row and its pictures."""

    row: Measurement
    pictures: SettingPictures


class SettingMeasurer:
    """A judge of a scene that measures settings at its apertures.

    Parameters
    ----------
    judge
        Judge of the scene that is shown.
    reduction
        Image pixels per picture pixel, along each side.
    causes
        Whether wrong pixels are charged to causes, and errors predicted.
    """

    def __init__(self, judge: Judge, reduction: int, *, causes: bool = True) -> None:
        self._judge = judge
        scene = judge.scene
        self._scale = scene.frustum.longest_reach, images.height_range(scene, scene.frustum.longest_reach)
        self._reduction = reduction
        shaded = is_shaded(scene)
        # Where a scene says nothing of light, colors say nothing of the rasterizer, and take time.
        wanted = Wanted(color=True, radiance=shaded, perceptual=shaded, causes=causes, apart=True)
        self._engine = judge.engine(wanted, self._measured)
        self._watch = Stopwatch()

    @property
    def seconds(self) -> dict[str, float]:
        """Seconds by stage, of all rows and of what they have in common."""
        total = Stopwatch()
        total.add(self._watch.seconds)
        total.add(self._engine.watch.seconds)
        return total.seconds

    @property
    def cpu_seconds(self) -> dict[str, float]:
        """CPU seconds by stage; see `Machine`."""
        return dict(self._engine.machine.cpu.seconds)

    def measure(
        self, apertures: Sequence[Aperture], settings: Sequence[DoubleFrustum]
    ) -> Iterator[tuple[Aperture, TracedAperture | MeasuredSetting]]:
        """Measure settings at some apertures, and yield for each the settings and then its truth.

        Truths and frames are made while nothing else runs. What is made of them overlaps.
        """
        hogel: TracedHogel | None = None
        with closing(self._engine.frames(apertures, settings)) as frames:
            for one in frames:
                if hogel is not None and one.hogel.number != hogel.number:
                    yield hogel.aperture, self._traced(hogel)
                hogel = one.hogel
                self._watch.add(one.found.lap.seconds)
                yield hogel.aperture, one.found.measured
            if hogel is not None:
                # Last, so that nothing has to stop for the tracers alone.
                yield hogel.aperture, self._traced(hogel)

    def _traced(self, hogel: TracedHogel) -> TracedAperture:
        machine, truth = self._engine.machine, hogel.truth
        self._watch.record("trace", hogel.trace_s)
        with machine.stage(self._watch, "pictures"):
            picture = images.picture(truth, self._reduction)
        # Tracers have threads of their own, whose time is known only while nothing else runs.
        with machine.undisturbed(), machine.timed(self._watch, "alone"):
            alone = self._alone(truth)
        return TracedAperture(picture=picture, alone=alone)

    @cached_property
    def _tracers(self) -> TracersAlone:
        return TracersAlone(self._judge.scene)

    def _alone(self, truth: HogelImage) -> TracersAlonePictured | None:
        if self._judge.reference.decided_by != CERTIFIED:
            return None
        found = self._tracers.find(truth)
        return TracersAlonePictured(
            numbers=found.numbers, pictures=images.alone_pictures(truth, found.wrong, self._reduction)
        )

    def _measured(self, frame: JudgedFrame) -> _Measured:
        """Return the row of a frame and its pictures, encoded in the thread that has judged it."""
        row, taken = _row(frame), Stopwatch()
        with self._engine.machine.stage(taken, "pictures"):
            charges = None if frame.budget is None else _charges(frame.budget)
            pictures = images.setting_pictures(
                frame.image, frame.comparison.maps, charges, self._scale, self._reduction
            )
        taken.add(frame.lap.seconds)
        return _Measured(measured=MeasuredSetting(row=row, pictures=pictures), lap=taken)

    def repeat(self, rows: Sequence[Measurement], budget_s: float) -> dict[DoubleFrustum, Timing]:
        """Draw the settings of some rows in turns until the fastest are told apart; return the times of each.

        Nothing is repeated where not all settings could be drawn often enough in the time.

        Parameters
        ----------
        rows
            Rows of one aperture.
        budget_s
            Largest number of seconds.
        """
        begun = time.process_time()
        timings = self._repeated(rows, budget_s)
        self._engine.machine.cpu.record("repeat", time.process_time() - begun)
        return timings

    def _repeated(self, rows: Sequence[Measurement], budget_s: float) -> dict[DoubleFrustum, Timing]:
        settings = [row.settings for row in rows]
        expected = sum(row.times_s.raster for row in rows)
        if len(settings) < 2 or FEWEST_REPETITIONS * expected > budget_s:
            return {}
        aperture = rows[0].aperture
        runs = [partial(self._render, aperture, setting) for setting in settings]
        seconds: list[list[float]] = [[] for _ in settings]
        for _ in range(FEWEST_REPETITIONS):
            take_turn(runs, seconds)
        left = budget_s - sum(map(sum, seconds))
        take_turns_until_settled(runs, seconds, _unsettled, left)
        return {setting: Timing.of(taken) for setting, taken in zip(settings, seconds, strict=True)}

    def _render(self, aperture: Aperture, settings: DoubleFrustum) -> None:
        def render(rasterizer: Rasterizer) -> None:
            rasterizer.render(aperture, settings, normals=False, color=True)

        self._judge.drawing.submit(render).result()


@dataclass(frozen=True, kw_only=True)
class _Measured:
    """A measured setting, and the seconds of its stages with that of encoding its pictures."""

    measured: MeasuredSetting
    lap: Stopwatch


def _row(frame: JudgedFrame) -> Measurement:
    budget = frame.budget
    return Measurement(
        aperture=frame.hogel.aperture,
        settings=frame.settings,
        comparison=frame.comparison.numbers,
        causes=() if budget is None else budget.causes,
        unexplained=None if budget is None else budget.explanation.counts()["unexplained"],
        shear=None if budget is None else budget.start.shear,
        predicted=frame.prediction,
        times_s=frame.times,
        parts_s=StageParts(raster=RasterParts(gpu=frame.gpu_s)),
        wrong=_wrong_pixels(frame.comparison),
    )


def _charges(budget: Budget) -> NDArray[np.int8]:
    """Return the place in `CAUSE_COLORS` of each wrong surface's link, (H, W), or the place after all."""
    places = np.array([list(CAUSE_COLORS).index(name) for name in budget.links], dtype=np.int8)
    wrong = budget.surface_charge >= 0
    charge = budget.surface_charge.copy()
    charge[wrong] = places[charge[wrong]]
    charge[budget.explanation.unexplained & wrong] = len(CAUSE_COLORS)
    return charge


def _wrong_pixels(comparison: Comparison) -> dict[str, PixelSet]:
    # Not by its maps: those of displacement and height are made for pictures alone.
    found = {}
    if comparison.errors.surface is not None:
        found["surface"] = PixelSet.of(comparison.errors.surface)
    if comparison.colors is not None:
        with np.errstate(invalid="ignore"):
            found["radiance"] = PixelSet.of(np.abs(comparison.colors.error).max(axis=-1) > STEP)
    return found


def _unsettled(spreads: Sequence[Timing]) -> list[bool]:
    """Return which settings take a further turn."""
    fastest = min(spreads, key=lambda one: one.median)
    return open_races([one for one in spreads if not fastest.told_below(one)], spreads)
