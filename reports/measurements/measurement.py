"""What a sweep measures: one row per aperture and setting, and the pictures that belong to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from xfrustum.compare.attribution.budget import Cause
from xfrustum.compare.attribution.shear import ShearNumbers
from xfrustum.compare.beyond import displacement_p99
from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.metrics.paired import PixelSet
from xfrustum.compare.prediction.predict import Prediction
from xfrustum.compare.run import StageTimes
from xfrustum.compare.scouting.automatic import AutoApertures
from xfrustum.reference.alone import AloneNumbers
from xfrustum.reference.plain import CERTIFIED
from xfrustum.reports.common.geometry import CameraGeometry, geometries_of
from xfrustum.reports.common.raster_command import plan_command
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
        """99th percentile of displacement; see `compare.beyond.displacement_p99`."""
        return displacement_p99(self.comparison)

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


LEFT_OUT = ("causes", "predictions", "frames with exact depth", "traced models")
"""Parts that a report without causes leaves out: the causes of wrong pixels, predictions by closed forms, and
what causes alone need, which are frames with exact depth and the traced images of the cameras' models."""


@dataclass(frozen=True, kw_only=True)
class SweepCost:
    """Wall seconds of everything, and those of its frames, its truths and the page's pictures added up.

    Stages run at the same time, so that sums may exceed what passed.
    """

    wall_s: float
    frames_s: float
    truths_s: float
    pictures_s: float


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
        Seconds of each stage, added up over all frames: `prepare`, `trace`, `raster`, `compare`, `predict`,
        `causes`, `pictures` of the page, `alone` for the tracers alone, `inspection` for that page, and
        `light` for the light of a shaded scene. Stages run at the same time: the sum exceeds `wall_s`.
    wall_s
        Wall seconds of everything.
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
    wall_s: float
    charged: bool = True
    auto: AutoApertures | None = None
    inspected: tuple[InspectedHogel, ...] = ()

    def with_stage(self, name: str, seconds: float) -> Sweep:
        """Return the sweep with one more stage, which was done after all others."""
        return replace(self, times_s={**self.times_s, name: seconds}, wall_s=self.wall_s + seconds)

    @property
    def gpu_s(self) -> float:
        """Seconds in which the device drew all frames, by its own clock."""
        return sum(row.parts_s.raster.gpu for row in self.rows)

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
        """What the hogels leave out of the plate, and the command that asks; empty where they are all."""
        columns, rows = self.scene.plate.hogels
        measured = len(self.apertures)
        if measured >= columns * rows:
            return ""
        return (
            f"Measured at {measured:,} of {columns * rows:,} hogels, and others may need other settings: "
            f"{plan_command(self.scene)} says what holds for the whole plate."
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
        """What measuring took."""
        return SweepCost(
            wall_s=self.wall_s,
            frames_s=self.times_s["raster"],
            truths_s=self.times_s["trace"],
            pictures_s=self.times_s["pictures"],
        )

    @property
    def cost_sentence(self) -> str:
        """What measuring took, in words."""
        cost, count = self.cost, len(self.truths)
        frames = "a raster frame" if len(self.rows) == 1 else f"{len(self.rows)} raster frames"
        if self.decided_by == CERTIFIED:
            truths = "the certified truth" if count == 1 else f"{count} certified truths"
        else:
            traced = "the picture" if count == 1 else f"{count} pictures"
            truths = f"{traced} by {self.decided_by} alone"
        return (
            f"Measured in {cost.wall_s:.2f} s of wall time, in which stages ran side by side: {frames} with "
            f"read-back {cost.frames_s:.2f} s, {truths} {cost.truths_s:.2f} s, the page's pictures "
            f"{cost.pictures_s:.2f} s."
        )
