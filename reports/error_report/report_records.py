"""Dataclasses of the objects in report.json and of the rows in measurements.parquet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from xfrustum.compare import Spread
from xfrustum.compare.attribution.budget import Cause, CauseNumbers
from xfrustum.compare.attribution.shear import ShearNumbers
from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.prediction.predict import Separations
from xfrustum.compare.run import StageTimes
from xfrustum.reference.alone import AloneNumbers
from xfrustum.reports.common.json_ready import INLINED
from xfrustum.reports.common.records import named_columns
from xfrustum.reports.error_report.shading import ShadingRecord
from xfrustum.reports.measurements.best import Window
from xfrustum.reports.measurements.measurement import Ratios, StageParts, SweepCost
from xfrustum.reports.scouting.automatic import ScoutRecord
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture, Plate


@dataclass(frozen=True, kw_only=True)
class SceneRecord:
    """The scene that was measured."""

    name: str
    source: str
    hash: str
    units: str
    objects: int
    triangles: int
    plate: Plate
    frustum: Frustum


@dataclass(frozen=True, kw_only=True)
class BestRecord:
    """The best setting of a depth buffer; see `best.Recommendation`.

    Attributes
    ----------
    aperture
        Column and row of the aperture with most wrong surfaces.
    """

    settings: DoubleFrustum = field(metadata=INLINED)
    near_per_reach: float
    surface_fraction: float
    displacement_p99_px: float
    radiance_fraction: float | None
    window: Window
    aperture: tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class RecommendationRecord:
    """The best setting of all, in words and numbers.

    Attributes
    ----------
    command, plan_command
        Commands that draw with it, and that ask what holds for the whole plate.
    """

    sentence: str
    best: BestRecord = field(metadata=INLINED)
    command: str
    plan_command: str
    confidence: float


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
    """Settings and numbers of one row: what a row of report.json and one of measurements.parquet share."""

    settings: DoubleFrustum = field(metadata=named_columns("{}"))
    near_per_reach: float
    comparison: ComparisonNumbers = field(metadata=named_columns("{}"))
    unexplained: int | None
    shear: ShearNumbers | None
    predicted_displacement_px: Spread | None
    predicted_surface: PredictedSurface | None
    smallest_separation: Separations | None
    measured_over_predicted: Ratios
    times_s: StageTimes = field(metadata=named_columns("time_{}_s"))
    parts_s: StageParts = field(metadata=named_columns("time_{}_s"))


@dataclass(frozen=True, kw_only=True)
class ReportRow:
    """One row of report.json; the aperture by its column and row."""

    aperture: tuple[int, int]
    numbers: RowNumbers = field(metadata=INLINED)
    causes: tuple[Cause, ...]


@dataclass(frozen=True, kw_only=True)
class TableRow:
    """One row of measurements.parquet, which names the scene and everything that made the numbers."""

    aperture: Aperture
    numbers: RowNumbers = field(metadata=INLINED)
    causes: Mapping[str, CauseNumbers | None] = field(metadata=named_columns("cause_{}"))
    scene_name: str
    scene_source: str
    scene_hash: str
    units: str
    decided_by: str
    versions: Mapping[str, str] = field(metadata=named_columns("version_{}"))
    devices: Mapping[str, str] = field(metadata=named_columns("device_{}"))


@dataclass(frozen=True, kw_only=True)
class AloneRecord:
    """The pixels of one truth that ray tracers in single precision would have got wrong alone."""

    aperture: tuple[int, int]
    numbers: AloneNumbers = field(metadata=INLINED)


@dataclass(frozen=True, kw_only=True)
class ReportRecord:
    """The object in report.json; see `Sweep`.

    Attributes
    ----------
    left_out
        Names of what the report was asked to leave out.
    """

    scene: SceneRecord
    apertures: tuple[Aperture, ...]
    best: RecommendationRecord
    best_per_depth: tuple[BestRecord, ...]
    best_per_geometry: tuple[BestRecord, ...]
    rows: tuple[ReportRow, ...]
    tracers_alone: tuple[AloneRecord, ...]
    decided_by: str
    versions: Mapping[str, str]
    devices: Mapping[str, str]
    times_s: Mapping[str, float]
    cost: SweepCost
    shading: ShadingRecord | None
    scout: ScoutRecord | None
    left_out: tuple[str, ...]
