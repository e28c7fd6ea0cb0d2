"""One row of a report: a raster image judged against the truth, its pictures, and its columns."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from xfrustum.compare.attribution.budget import Cause, CauseNumbers, ShearNumbers
from xfrustum.compare.beyond import displacement_p99
from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.metrics.error_maps import PixelSet, Spread
from xfrustum.compare.prediction.chain import CULLING, LINKS, links_of
from xfrustum.compare.prediction.predict import Prediction, Separations
from xfrustum.compare.run import StageTimes
from xfrustum.reports.common.records import named_columns
from xfrustum.scenes.plate.double_frustum import DoubleFrustum, Offset
from xfrustum.scenes.plate.plate import Aperture

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
class PredictedSurface:
    """The predicted share of wrong surfaces, and its parts; see `Prediction`."""

    fraction: float
    silhouettes: float
    snapped: float
    depth: float
    outside: float
    culled: float = 0.0


@dataclass(frozen=True, kw_only=True)
class RowNumbers:
    """Settings and numbers of a row, as report.json and measurements.parquet have them."""

    settings: DoubleFrustum = field(metadata=named_columns("{}"))
    near_per_reach: float
    comparison: ComparisonNumbers = field(metadata=named_columns("{}"))
    unexplained: int | None
    shear: ShearNumbers | None
    predicted_displacement_px: Spread | None
    predicted_surface: PredictedSurface | None
    smallest_separation: Separations | None
    measured_over_predicted: Mapping[str, float | None]
    times_s: StageTimes = field(metadata=named_columns("time_{}_s"))
    parts_s: Mapping[str, Mapping[str, float]] = field(metadata=named_columns("time_{}_s"))


@dataclass(frozen=True, kw_only=True)
class TableRow:
    """One row of measurements.parquet, which names the scene and everything that made the numbers."""

    aperture: Aperture
    numbers: RowNumbers = field(metadata=named_columns("{}"))
    causes: Mapping[str, CauseNumbers | None] = field(metadata=named_columns("cause_{}"))
    made_by: Mapping[str, str] = field(metadata=named_columns("{}"))


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One raster image judged against the truth (CONVENTIONS.md, "Errors and their signs").

    Wrong pixels are charged to one of the links of the error budget (`causes`); those that rounding ought to
    explain and does not are `unexplained`; `predicted` is the error by closed forms, from the geometry of the
    scene alone. Where causes were left out, the first is empty and the others are None. `shear` is what the
    pivot does to the points that are shown, None where it does nothing.
    """

    aperture: Aperture
    settings: DoubleFrustum
    comparison: ComparisonNumbers
    causes: tuple[Cause, ...]
    unexplained: int | None
    predicted: Prediction | None
    times_s: StageTimes
    #: The device's own time, a part of `times_s.raster`.
    gpu_s: float
    shear: ShearNumbers | None = None
    #: By `surface` and `radiance`: the judged pixels that show the wrong surface, or a color that is off by
    #: more than 1/255; empty where they were not kept.
    wrong: Mapping[str, PixelSet] = field(default_factory=dict, repr=False)
    #: Encoded pictures by name; see `images.setting_pictures`.
    pictures: Mapping[str, bytes] = field(default_factory=dict, repr=False)

    @property
    def surface_fraction(self) -> float:
        """Share of the judged pixels that show the wrong surface."""
        assert self.comparison.surface is not None, "a sweep has the scene at hand"
        return self.comparison.surface.fraction

    @property
    def displacement_p99_px(self) -> float:
        """99th percentile of displacement; see `compare.beyond.displacement_p99`."""
        return displacement_p99(self.comparison)

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
    def measured_over_predicted(self) -> dict[str, float | None]:
        """Ratios; None where there is no measurement or no prediction, and where zero is predicted."""
        predicted, measured = self.predicted, self.comparison.displacement_px
        moved = predicted.displacement_px if predicted else None
        surface = predicted.surface_fraction if predicted else None
        return {
            "displacement_rms": measured.rms / moved.rms if measured and moved and moved.rms else None,
            "displacement_p99": measured.p99 / moved.p99 if measured and moved and moved.p99 else None,
            "surface": self.surface_fraction / surface if surface else None,
        }

    def cause_words(self, name: str) -> str:
        """Return what a sentence calls a cause; without an offset the first link is the gap."""
        if name == LINKS[0] and self.settings.offset is Offset.NONE:
            return "the gap at the plate"
        return CAUSE_WORDS[name]

    def numbers(self, reach: float) -> RowNumbers:
        """Return the numbers of the row, as they are written."""
        predicted, surface = self.predicted, None
        if predicted is not None:
            names = ("silhouettes", "snapped", "depth", "outside", "culled")
            parts = {name: getattr(predicted, name) for name in names}
            surface = PredictedSurface(fraction=predicted.surface_fraction, **parts)
        return RowNumbers(
            settings=self.settings,
            near_per_reach=self.settings.near / reach,
            comparison=self.comparison,
            unexplained=self.unexplained,
            shear=self.shear,
            predicted_displacement_px=predicted.displacement_px if predicted else None,
            predicted_surface=surface,
            smallest_separation=predicted.separation if predicted else None,
            measured_over_predicted=self.measured_over_predicted,
            times_s=self.times_s,
            parts_s={"raster": {"gpu": self.gpu_s}},
        )

    def table_row(self, reach: float, made_by: Mapping[str, str]) -> TableRow:
        """Return the row of measurements.parquet; where causes were left out, their columns stay."""
        causes: dict[str, CauseNumbers | None] = dict.fromkeys(links_of(self.settings))
        return TableRow(
            aperture=self.aperture,
            numbers=self.numbers(reach),
            causes=causes | {cause.name: cause.numbers for cause in self.causes},
            made_by=made_by,
        )
