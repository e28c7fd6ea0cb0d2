"""Rows of a report, and the choice among them: the best depth buffer and the best near planes."""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import TypeVar

from xfrustum.compare.attribution.budget import Cause, CauseNumbers
from xfrustum.compare.beyond import displacement_p99
from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.metrics.error_maps import PixelSet, Spread, is_worse
from xfrustum.compare.prediction.chain import links_of
from xfrustum.compare.prediction.predict import Prediction, Separations
from xfrustum.compare.prediction.reasons import Reasons
from xfrustum.compare.run import StageTimes
from xfrustum.reports.common.records import named_columns
from xfrustum.reports.text import DISPLACEMENT_TIE_PX, sentences
from xfrustum.scenes import Aperture, DoubleFrustum

Row = TypeVar("Row")

GEOMETRY = ("pivot", "fit", "offset", "slabs")
"""Fields of `DoubleFrustum` that determine camera positions and film extents."""

SURFACE_TIE_FRACTION = 1e-4
"""Surface fractions that differ by less count as equal.

A rasterizer snaps vertices to 2^-8 px, so that pixels within sqrt(2)/2 2^-8 px on both sides of a
silhouette may be wrong: a share of 0.0055 l/W, for contours with a length of l image widths. At
W = 512 and nine image widths this is one pixel in ten thousand."""

UNSEEN_DISPLACEMENT_PX = 0.1
"""Displacements below this are equally good.

At 67 pixels per degree, the viewing condition of FLIP, a pixel spans 54 arc seconds. The smallest
visible offset between two collinear lines is 5 arc seconds (vernier acuity, Westheimer 1979), a
tenth of a pixel."""


@dataclass(frozen=True, kw_only=True)
class PredictedSurface:
    """The predicted share of wrong surfaces, and its parts; see `Prediction`."""

    fraction: float
    silhouettes: float
    snapped: float
    depth: float
    outside: float
    culled: float

    @classmethod
    def from_prediction(cls, predicted: Prediction) -> "PredictedSurface":
        """Return the shares of a prediction."""
        parts = ("silhouettes", "snapped", "depth", "outside", "culled")
        shares = {name: getattr(predicted, name) for name in parts}
        return cls(fraction=predicted.surface_fraction, **shares)


@dataclass(frozen=True, kw_only=True)
class RowNumbers:
    """Settings and numbers of a row, as report.json and measurements.parquet have them."""

    aperture: Aperture
    settings: DoubleFrustum = field(metadata=named_columns("{}"))
    near_per_reach: float
    comparison: ComparisonNumbers = field(metadata=named_columns("{}"))
    unexplained: int | None
    predicted_displacement_px: Spread | None
    predicted_surface: PredictedSurface | None
    smallest_separation: Separations | None
    measured_over_predicted: Mapping[str, float | None]
    prediction_reasons: Reasons | None
    times_s: StageTimes = field(metadata=named_columns("time_{}_s"))
    parts_s: Mapping[str, Mapping[str, float]] = field(metadata=named_columns("time_{}_s"))
    #: causes by link of the budget; None for each link in a report without causes
    causes: Mapping[str, CauseNumbers | None] = field(metadata=named_columns("cause_{}"))
    #: scene, versions and devices that produced the numbers
    made_by: Mapping[str, str] = field(metadata=named_columns("{}"))


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One raster image judged against the truth (CONVENTIONS.md, "Errors and their signs")."""

    aperture: Aperture
    settings: DoubleFrustum
    comparison: ComparisonNumbers
    #: links of the error budget with their wrong pixels; empty if left out
    causes: tuple[Cause, ...]
    #: wrong pixels without an explanation by rounding; None without causes
    unexplained: int | None
    #: error predicted in closed form from the scene alone; None without causes
    predicted: Prediction | None
    times_s: StageTimes
    #: time of the device, a part of `times_s.raster`
    gpu_s: float
    #: Wrong judged pixels by kind: `surface` has pixels with the wrong surface; for a shaded scene
    #: `radiance` has pixels with a color that is off by more than 1/255.
    wrong: Mapping[str, PixelSet] = field(repr=False)
    #: encoded pictures by name; see `pictures.setting_pictures`
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
        """Return the share of wrong judged pixels by kind, `surface` or `radiance`."""
        if kind == "surface":
            return self.surface_fraction
        radiance = self.comparison.radiance
        return radiance.above_step if radiance else 0.0

    @property
    def measured_over_predicted(self) -> dict[str, float | None]:
        """Ratios; None without a measurement or a prediction, and where zero is predicted."""
        predicted, measured = self.predicted, self.comparison.displacement_px
        moved = predicted.displacement_px if predicted else None

        def ratio(statistic: str) -> float | None:
            below = getattr(moved, statistic, None)
            return getattr(measured, statistic) / below if measured and below else None

        surface = predicted.surface_fraction if predicted else None
        return {
            "displacement_rms": ratio("rms"),
            "displacement_p99": ratio("p99"),
            "surface": self.surface_fraction / surface if surface else None,
        }

    def numbers(self, reach: float, made_by: Mapping[str, str]) -> RowNumbers:
        """Return the row of the record and of the table; `reach` in scene units."""
        predicted = self.predicted
        # A report without causes has the columns of causes, too.
        causes: dict[str, CauseNumbers | None] = dict.fromkeys(links_of(self.settings))
        return RowNumbers(
            aperture=self.aperture,
            settings=self.settings,
            near_per_reach=self.settings.near / reach,
            comparison=self.comparison,
            unexplained=self.unexplained,
            predicted_displacement_px=predicted.displacement_px if predicted else None,
            predicted_surface=PredictedSurface.from_prediction(predicted) if predicted else None,
            smallest_separation=predicted.separation if predicted else None,
            measured_over_predicted=self.measured_over_predicted,
            prediction_reasons=sentences(predicted.reasons) if predicted else None,
            times_s=self.times_s,
            parts_s={"raster": {"gpu": self.gpu_s}},
            causes=causes | {cause.name: cause.numbers for cause in self.causes},
            made_by=made_by,
        )


@dataclass(frozen=True, kw_only=True)
class Window:
    """Consecutive near planes of one depth buffer that are equally good, scene units."""

    low: float
    high: float
    #: number of nears measured from `low` to `high`
    nears: int


@dataclass(frozen=True, kw_only=True)
class Recommendation:
    """A setting that is recommended, with its numbers at the worst of the apertures."""

    settings: DoubleFrustum
    surface_fraction: float
    displacement_p99_px: float
    #: share of judged pixels with a channel off by more than 1/255; None without shading
    radiance_fraction: float | None
    #: equally good near planes of the same depth buffer
    window: Window
    #: aperture with the largest share of wrong surfaces; the largest displacement breaks ties
    aperture: Aperture
    #: aperture with the largest displacement; `aperture` unless another is displaced more
    displaced_aperture: Aperture


def grouped(rows: Iterable[Row], key: Callable[[Row], Hashable]) -> list[list[Row]]:
    """Return rows in groups of equal keys, in the order in which the keys come first."""
    groups: dict[Hashable, list[Row]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return list(groups.values())


def geometry_of(settings: DoubleFrustum) -> DoubleFrustum:
    """Return the camera geometry of settings: the same cameras with near 1 and default depth."""
    return DoubleFrustum(near=1.0, **{name: getattr(settings, name) for name in GEOMETRY})


def geometries_of(settings: Iterable[DoubleFrustum]) -> tuple[DoubleFrustum, ...]:
    """Return the camera geometries of some settings, in the order of their first occurrence."""
    return tuple(dict.fromkeys(map(geometry_of, settings)))


def _is_worse(worst: Measurement, others: Sequence[Measurement], kind: str, tests: int) -> bool:
    """Return whether the worst row of a setting is worse than another setting, beyond chance."""
    if worst.wrong_share(kind) <= _share(others, kind) + SURFACE_TIE_FRACTION:
        return False
    other = next(row for row in others if row.aperture == worst.aperture)
    here, there = worst.wrong[kind], other.wrong[kind]
    # Pixels wrong in both pictures cancel in a paired test.
    shared = here.shared_with(there)
    return is_worse(here.count - shared, there.count - shared, tests)


def _share(rows: Sequence[Measurement], kind: str) -> float:
    """Return the share of wrong pixels at the worst aperture."""
    return max(row.wrong_share(kind) for row in rows)


def _displaced(rows: Sequence[Measurement]) -> float:
    return max(row.displacement_p99_px for row in rows)


def equally_good(rows: Sequence[Measurement]) -> set[DoubleFrustum]:
    """Return the settings for which no measured setting is better.

    Settings are chosen in three steps. The first keeps settings that are not worse than the setting
    with the fewest wrong surfaces. The second does the same for wrong colors if the scene is
    shaded. The third keeps settings displaced by at most `UNSEEN_DISPLACEMENT_PX` or, if that is
    more, by the least displacement plus `DISPLACEMENT_TIE_PX`. One setting is worse than another if
    it has more wrong pixels by more than `SURFACE_TIE_FRACTION` and beyond chance
    (`compare.metrics.error_maps`). The worst aperture counts.
    """
    candidates = grouped(rows, lambda row: row.settings)
    tests = max(len(candidates) - 1, 1)
    for kind in rows[0].wrong:
        least = min(candidates, key=lambda group: _share(group, kind))
        candidates = [
            group
            for group in candidates
            if not _is_worse(max(group, key=lambda row: row.wrong_share(kind)), least, kind, tests)
        ]
    # Below the visible threshold all settings are equal; above it, ties within measurement error.
    limit = max(min(map(_displaced, candidates)) + DISPLACEMENT_TIE_PX, UNSEEN_DISPLACEMENT_PX)
    return {group[0].settings for group in candidates if _displaced(group) <= limit}


def best_setting(rows: Sequence[Measurement]) -> Recommendation:
    """Return the middle of the widest window of equally good near planes.

    A window is a run of measured near planes of one depth buffer and one camera geometry that all
    are `equally_good`. If several windows are equally wide, the window with the larger nears is
    used; if these are equal too, the window of the first geometry and depth buffer. The middle of
    the window, by ratio, is farthest from nears that displace too much and from nears that are too
    small for the depth buffer; of two middles the larger near is used.
    """
    good, windows = equally_good(rows), []
    settings = dict.fromkeys(row.settings for row in rows)
    for line in grouped(settings, lambda each: replace(each, near=1.0)):
        runs = groupby(sorted(line, key=lambda each: each.near), good.__contains__)
        windows += [list(run) for is_good, run in runs if is_good]
    window = max(windows, key=lambda run: (run[-1].near / run[0].near, run[-1].near))
    low, high = window[0].near, window[-1].near
    middle = (low * high) ** 0.5
    # Compare ratios to the middle, upwards or downwards; digits beyond the twelfth are rounding.
    best = min(
        reversed(window), key=lambda each: round(max(each.near / middle, middle / each.near), 12)
    )
    # The worst aperture of the chosen setting gives the numbers.
    chosen = [row for row in rows if row.settings == best]
    worst = max(chosen, key=lambda row: (row.surface_fraction, row.displacement_p99_px))
    moved = max(chosen, key=lambda row: (row.displacement_p99_px, row is worst))
    return Recommendation(
        settings=best,
        surface_fraction=worst.surface_fraction,
        displacement_p99_px=moved.displacement_p99_px,
        radiance_fraction=_share(chosen, "radiance") if "radiance" in worst.wrong else None,
        window=Window(low=low, high=high, nears=len(window)),
        aperture=worst.aperture,
        displaced_aperture=moved.aperture,
    )


def best_per_depth(rows: Sequence[Measurement]) -> list[Recommendation]:
    """Return the best setting of each depth format and mapping, in the order of the rows."""
    return [best_setting(group) for group in grouped(rows, lambda row: row.settings.depth_label)]


def best_per_geometry(rows: Sequence[Measurement]) -> list[Recommendation]:
    """Return the best setting of each camera geometry, in the order of the rows."""
    return [best_setting(group) for group in grouped(rows, lambda row: geometry_of(row.settings))]


def can_be_judged(rows: Sequence[Measurement]) -> bool:
    """Return whether any pixel could be wrong at any setting."""
    shown = any(row.comparison.covered or row.comparison.displacement_px for row in rows)
    return shown and any(row.comparison.judged for row in rows)
