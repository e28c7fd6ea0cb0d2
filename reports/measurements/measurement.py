"""What a sweep measures: one row per aperture and setting, and the pictures that belong to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from xfrustum.compare.attribution.budget import Cause
from xfrustum.compare.attribution.shear import ShearNumbers
from xfrustum.compare.judging.stopwatch import StageTimes
from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.metrics.paired import PixelSet
from xfrustum.compare.prediction.predict import Prediction
from xfrustum.compare.scouting.automatic import AutoApertures
from xfrustum.reference.alone import AloneNumbers
from xfrustum.reference.plain import CERTIFIED
from xfrustum.reports.common.geometry import CameraGeometry, geometries_of
from xfrustum.reports.common.timing import Timing
from xfrustum.reports.inspection.hogels import InspectedHogel
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True)
class RasterParts:
    """Seconds of the parts of a frame; `gpu` is the device's own time."""

    gpu: float


@dataclass(frozen=True, kw_only=True)
class StageParts:
    """Seconds of the parts of the stages in `StageTimes`."""

    raster: RasterParts


@dataclass(frozen=True, kw_only=True)
class Ratios:
    """Ratios of what was measured to what was predicted.

    Each is None where there is no measurement or no prediction, and where zero is predicted.
    """

    displacement_rms: float | None
    displacement_p99: float | None
    surface: float | None


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One raster image judged against the truth.

    Attributes
    ----------
    aperture, settings
        What was drawn, and how.
    comparison
        How the image differs from the truth (CONVENTIONS.md, "Errors and their signs").
    causes
        The links of the error budget, which every wrong pixel is charged to one of; empty where causes were
        left out.
    unexplained
        Number of wrong pixels charged to rounding whose cause is not known; None likewise.
    predicted
        The error by closed forms, from the scene's geometry alone; None likewise.
    times_s
        Wall seconds per stage.
    parts_s
        Seconds of the parts of stages.
    shear
        What the pivot does to the points that are shown; None where it does nothing.
    wrong
        By `surface` and `radiance`: the judged pixels that show the wrong surface, or a color that is off
        by more than 1/255; empty where they were not kept.
    """

    aperture: Aperture
    settings: DoubleFrustum
    comparison: ComparisonNumbers
    causes: tuple[Cause, ...]
    unexplained: int | None
    predicted: Prediction | None
    times_s: StageTimes
    parts_s: StageParts
    shear: ShearNumbers | None = None
    wrong: Mapping[str, PixelSet] = field(default_factory=dict, repr=False)

    def wrong_share(self, kind: str) -> float:
        """Return the share of judged pixels that are wrong in one sense, `surface` or `radiance`."""
        if kind == "surface":
            return self.surface_fraction
        radiance = self.comparison.radiance
        return radiance.above_step if radiance else 0.0

    def wrong_count(self, kind: str) -> int:
        """Return the number of those pixels."""
        pixels = self.wrong_pixels(kind)
        return round(self.wrong_share(kind) * self.comparison.judged) if pixels is None else pixels.count

    def wrong_pixels(self, kind: str) -> PixelSet | None:
        """Return those pixels; None where they were not kept."""
        return self.wrong.get(kind)

    @property
    def surface_fraction(self) -> float:
        """Share of the judged pixels that show the wrong surface."""
        assert self.comparison.surface is not None, "a sweep has the scene at hand"
        return self.comparison.surface.fraction

    @property
    def displacement_p99_px(self) -> float:
        """99th percentile of displacement; 0 where the raster shows nothing to be displaced."""
        displacement = self.comparison.displacement_px
        return 0.0 if displacement is None else displacement.p99

    @property
    def measured_over_predicted(self) -> Ratios:
        """Ratios of what was measured to what was predicted."""
        if self.predicted is None:
            return Ratios(displacement_rms=None, displacement_p99=None, surface=None)
        displacement, predicted = self.comparison.displacement_px, self.predicted.displacement_px
        return Ratios(
            displacement_rms=_ratio(
                displacement.rms if displacement else None, predicted.rms if predicted else None
            ),
            displacement_p99=_ratio(
                displacement.p99 if displacement else None, predicted.p99 if predicted else None
            ),
            surface=_ratio(self.surface_fraction, self.predicted.surface_fraction),
        )


def _ratio(measured: float | None, predicted: float | None) -> float | None:
    return measured / predicted if measured is not None and predicted else None


@dataclass(frozen=True, kw_only=True)
class SettingPictures:
    """Encoded pictures (PNG or WebP) of one setting; see `xfrustum.reports.error_report.images`."""

    raster: bytes
    displacement: bytes
    surface: bytes
    triangle: bytes
    height: bytes
    causes: bytes | None = None
    radiance: bytes | None = None


@dataclass(frozen=True, kw_only=True)
class TracersAlonePictured:
    """What ray tracers alone would have got wrong of one truth.

    Attributes
    ----------
    numbers
        How many pixels.
    pictures
        Encoded marks of these pixels, by the tracer's name, and as `truth` of all surfaces; empty where
        no pixel would be wrong.
    """

    numbers: AloneNumbers
    pictures: Mapping[str, bytes]


BESIDES = ("pictures", "inspection", "alone", "repeat", "light")
"""Stages that are not measuring: the pictures of the page; the hogels of the inspection page; the pixels that
a tracer alone would have got wrong, which say nothing of a row; frames drawn again to rank them by time; and
the section on light."""

WITHIN_SWEEP = ("pictures", "inspection", "alone", "repeat")
"""Those of `BESIDES` that a sweep itself does."""

_NAMED_BESIDES = {
    "inspection": "the inspection page",
    "repeat": "frames drawn again for their time",
    "light": "light",
}
"""Those of `BESIDES` that are named in words where they were done."""

LEFT_OUT = ("causes", "predictions", "frames with exact depth", "traced models")
"""Parts that a report without causes leaves out: the causes of wrong pixels, predictions by closed forms, and
what causes alone need, which are frames with exact depth and the traced images of the cameras' models."""


@dataclass(frozen=True, kw_only=True)
class CpuCost:
    """CPU seconds of all threads of the process.

    Attributes
    ----------
    measuring_s
        From the loaded scene to the measured rows: renderers made ready, kernels and programs compiled,
        truths, frames, comparisons and, where they were wanted, causes and predictions.
    frames_s, truths_s
        Part of it in which frames were drawn and read back, and in which truths were traced. Both run while
        nothing else does.
    ratio
        `measuring_s` over `frames_s` and `truths_s` together; None where these took no time.
    besides_s
        Stages that are not measuring, see `BESIDES`, and `page`, in which the page was put together.
    """

    measuring_s: float
    frames_s: float
    truths_s: float
    ratio: float | None
    besides_s: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class SweepCost:
    """What measuring took beside what it cannot do without: its frames with read-back and its truths.

    The stages in `BESIDES` are timed separately: they are not measuring.

    Attributes
    ----------
    wall_s
        Wall seconds of measuring.
    frames_s, truths_s
        Seconds of all frames and of all truths.
    pictures_s
        Seconds of encoding the page's pictures.
    ratio
        `wall_s` over `frames_s` and `truths_s` together.
    ratio_without_causes
        `ratio` of a report without causes; None in a report that has them.
    total_s
        Seconds of everything.
    cpu
        The same in CPU seconds, which depend less on what else the machine does.
    """

    wall_s: float
    frames_s: float
    truths_s: float
    pictures_s: float
    ratio: float
    ratio_without_causes: float | None
    total_s: float
    cpu: CpuCost


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Everything measured on a scene.

    Attributes
    ----------
    rows, pictures
        One of each per aperture and setting, in the same order: all settings of the first
        aperture first.
    truths
        Encoded picture of the truth, per aperture.
    alone
        What each ray tracer alone would have got wrong, per aperture; empty where a tracer alone made the
        truths.
    decided_by
        What decided the truths; see `reference.plain.DECISIONS`.
    reduction
        Image pixels per picture pixel, along each side.
    versions, devices
        Libraries and hardware that produced the numbers.
    times_s
        Wall seconds per stage, which add up to `wall_s`. `exact` compares the frames with exact depth, beside
        which those of all depth buffers are compared, `pictures` encodes those of the page,
        `inspection` draws and packs the hogels of the inspection page, `repeat`
        draws frames again to time them, `light` measures the light of a shaded scene, and `other` is the
        rest.
    parts_s
        Seconds of the parts of stages.
    wall_s
        Wall seconds of everything.
    frames_s
        By setting: times of repeated frames with read-back at the first aperture, where they were timed.
    cpu_s
        CPU seconds: of `raster` and `trace`, of the stages in `BESIDES` and of `page`, and as `all` those of
        everything but `light` and `page`.
    charged
        Whether wrong pixels were charged to causes, and errors predicted.
    auto
        The scout from which the apertures were chosen; None where they were given.
    inspected
        Hogels of some apertures, the worst first, drawn with the best setting, with all their channels.
    """

    scene: Scene
    apertures: tuple[Aperture, ...]
    rows: tuple[Measurement, ...]
    pictures: tuple[SettingPictures, ...]
    truths: tuple[bytes, ...]
    alone: tuple[TracersAlonePictured, ...]
    decided_by: str
    reduction: int
    versions: Mapping[str, str]
    devices: Mapping[str, str]
    times_s: Mapping[str, float]
    parts_s: StageParts
    wall_s: float
    frames_s: Mapping[DoubleFrustum, Timing]
    cpu_s: Mapping[str, float]
    charged: bool = True
    auto: AutoApertures | None = None
    inspected: tuple[InspectedHogel, ...] = ()

    def with_stage(self, name: str, seconds: float, cpu_s: float) -> Sweep:
        """Return the sweep with one more stage, which was done after all others, and its CPU seconds."""
        longer = self.with_cpu(name, cpu_s)
        return replace(longer, times_s={**self.times_s, name: seconds}, wall_s=self.wall_s + seconds)

    def with_cpu(self, name: str, seconds: float) -> Sweep:
        """Return the sweep with the CPU seconds of one more stage."""
        return replace(self, cpu_s={**self.cpu_s, name: seconds})

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of what the sweep was asked to leave out."""
        return () if self.charged else LEFT_OUT

    @cached_property
    def geometries(self) -> tuple[CameraGeometry, ...]:
        """Camera geometries of all settings, each once."""
        return geometries_of(row.settings for row in self.rows)

    def numbered(self, aperture: Aperture, geometry: CameraGeometry) -> list[tuple[int, Measurement]]:
        """Return the rows of an aperture and a geometry, with their numbers."""
        return [
            (number, row)
            for number, row in enumerate(self.rows)
            if row.aperture == aperture and CameraGeometry.of(row.settings) == geometry
        ]

    @property
    def coverage_sentence(self) -> str:
        """What the apertures leave out of the plate; empty where a scout chose them, or they are all."""
        columns, rows = self.scene.plate.hogels
        measured = len(self.apertures)
        if self.auto is not None or measured >= columns * rows:
            return ""
        return (
            f"Measured at {measured:,} of {columns * rows:,} apertures; others may be far worse: "
            "--apertures auto looks for them, and xfrustum plan holds for the plate."
        )

    @property
    def left_out_sentence(self) -> str:
        """What the sweep was asked to leave out, in words; empty where that is nothing."""
        if self.charged:
            return ""
        return (
            f"Left out, as asked for: {', '.join(LEFT_OUT[:-1])} and {LEFT_OUT[-1]}. Wrong pixels are "
            "counted and shown, and not explained."
        )

    @property
    def cost(self) -> SweepCost:
        """The price of measuring, beside that of its frames and truths."""
        needed = self.times_s["raster"] + self.times_s["trace"]
        apart = sum(self.times_s.get(stage, 0.0) for stage in BESIDES)
        measuring = self.wall_s - apart
        ratio = measuring / needed
        return SweepCost(
            wall_s=measuring,
            frames_s=self.times_s["raster"],
            truths_s=self.times_s["trace"],
            pictures_s=self.times_s["pictures"],
            ratio=ratio,
            ratio_without_causes=None if self.charged else ratio,
            total_s=self.wall_s,
            cpu=self._cpu_cost(),
        )

    def _cpu_cost(self) -> CpuCost:
        """Return the price of measuring in CPU seconds."""
        besides = {stage: self.cpu_s[stage] for stage in (*BESIDES, "page") if stage in self.cpu_s}
        within = sum(self.cpu_s.get(stage, 0.0) for stage in WITHIN_SWEEP)
        frames, truths = self.cpu_s.get("raster", 0.0), self.cpu_s.get("trace", 0.0)
        measuring, needed = self.cpu_s["all"] - within, frames + truths
        return CpuCost(
            measuring_s=measuring,
            frames_s=frames,
            truths_s=truths,
            ratio=measuring / needed if needed else None,
            besides_s=besides,
        )

    @property
    def cost_sentence(self) -> str:
        """The price of measuring in words."""
        cost = self.cost
        frames = "a raster frame" if len(self.rows) == 1 else f"{len(self.rows)} raster frames"
        count = len(self.truths)
        if self.decided_by == CERTIFIED:
            truths = "the certified truth" if count == 1 else f"{count} certified truths"
        else:
            traced = "the picture" if count == 1 else f"{count} pictures"
            truths = f"{traced} by {self.decided_by} alone"
        besides = [f"the page's pictures {cost.pictures_s:.2f} s"]
        for stage, words in _NAMED_BESIDES.items():
            if stage in self.times_s:
                besides.append(f"{words} {self.times_s[stage]:.2f} s")
        return (
            f"Measured in {cost.wall_s:.2f} s of wall time: {cost.ratio:.2f} times what {frames} "
            f"with read-back ({cost.frames_s:.2f} s) and {truths} ({cost.truths_s:.2f} s) take"
            f"{_in_cpu(cost.cpu)}. "
            f"Besides: {', '.join(besides)}; {cost.total_s:.2f} s in all."
        )


def _in_cpu(cost: CpuCost) -> str:
    """Say what that is in CPU time; nothing where frames and truths took none."""
    return "" if cost.ratio is None else f", and {cost.ratio:.2f} times as much CPU time as they take"
