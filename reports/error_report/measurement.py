"""What is measured of one setting at one aperture, and the pictures that belong to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from xfrustum.compare.attribution.budget import Cause, ShearNumbers
from xfrustum.compare.beyond import displacement_p99
from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.metrics.paired import PixelSet
from xfrustum.compare.prediction.chain import CULLING, LINKS
from xfrustum.compare.prediction.predict import Prediction
from xfrustum.compare.run import StageTimes
from xfrustum.reference.alone import AloneNumbers
from xfrustum.scenes.plate.double_frustum import DoubleFrustum, Offset
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
    comparison
        How the image differs from the truth (CONVENTIONS.md, "Errors and their signs").
    causes
        The links of the error budget, which every wrong pixel is charged to one of; empty where causes were
        left out.
    unexplained
        Number of wrong pixels charged to rounding whose cause is not known; None likewise.
    predicted
        The error by closed forms, from the scene's geometry alone; None likewise.
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
        pixels = self.wrong.get(kind)
        return round(self.wrong_share(kind) * self.comparison.judged) if pixels is None else pixels.count

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
        predicted, measured = self.predicted, self.comparison.displacement_px
        moved = predicted.displacement_px if predicted else None
        return Ratios(
            displacement_rms=measured.rms / moved.rms if measured and moved and moved.rms else None,
            displacement_p99=measured.p99 / moved.p99 if measured and moved and moved.p99 else None,
            surface=self.surface_fraction / predicted.surface_fraction
            if predicted and predicted.surface_fraction
            else None,
        )

    @property
    def cause_words(self) -> Mapping[str, str]:
        """What sentences call each cause; without an offset the first link is the gap."""
        if self.settings.offset is Offset.NONE:
            return {**CAUSE_WORDS, LINKS[0]: "the gap at the plate"}
        return CAUSE_WORDS

    @property
    def main_cause(self) -> str | None:
        """The cause of more than half of the wrong surfaces, in words; None where none makes so many."""
        most = max(self.causes, key=lambda cause: cause.surface, default=None)
        wrong = sum(cause.surface for cause in self.causes)
        return self.cause_words[most.name] if most and 2 * most.surface > wrong else None


CAUSE_WORDS = {
    "near offset": "the near offset",
    "pivot": "the shear about the wrong point",
    "fit": "the fit",
    "slabs": "the cuts into slabs",
    CULLING: "culling",
    "rasterization": "rasterization",
    "depth": "the depth buffer",
}
"""What each cause is called in a sentence."""


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
