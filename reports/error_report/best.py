"""Rows of a report: the choice of the best depth buffer and near planes, and figures for plotly.js.

The figures show errors over near planes and shares of causes. Every measured point carries its row
number in the sweep as `customdata`, so that the page can show the pictures of the point that was
clicked.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import TypeVar

from xfrustum.compare.attribution import Cause, CauseNumbers
from xfrustum.compare.comparison import ComparisonNumbers
from xfrustum.compare.error_maps import PixelSet, Spread, is_worse
from xfrustum.compare.prediction.predict import Prediction, Separations, links_of
from xfrustum.compare.prediction.reasons import Reasons
from xfrustum.compare.run import StageTimes
from xfrustum.compare.sampling import displacement_p99
from xfrustum.reports.common.pictures import CAUSE_COLORS
from xfrustum.reports.common.records import named_columns
from xfrustum.reports.plotting import COLORS, INK, Figure, log_axis, look, styled, titled
from xfrustum.reports.text import DISPLACEMENT_TIE_PX, sentences
from xfrustum.scenes import Aperture, DoubleFrustum
from xfrustum.scenes.representation import digits, percent

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
    def from_prediction(cls, predicted: Prediction) -> PredictedSurface:
        """Return the shares of a prediction."""
        parts = ("silhouettes", "snapped", "depth", "outside", "culled")
        shares = {name: getattr(predicted, name) for name in parts}
        return cls(fraction=predicted.surface_fraction, **shares)


@dataclass(frozen=True, kw_only=True)
class RowNumbers:
    """Settings and errors of a row, as report.json and measurements.parquet have them."""

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
    #: number of wrong pixels without an explanation by rounding; None without causes
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
        """99th percentile of displacement; see `compare.sampling.displacement_p99`."""
        return displacement_p99(self.comparison)

    def wrong_share(self, kind: str) -> float:
        """Return the share of wrong judged pixels by kind, `surface` or `radiance`."""
        if kind == "surface":
            return self.surface_fraction
        radiance = self.comparison.radiance
        return radiance.above_step if radiance else 0.0

    @property
    def measured_over_predicted(self) -> dict[str, float | None]:
        """Ratios by statistic; None if a value is missing, or if the predicted value is zero."""
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
    #: aperture with the largest displacement; equal to `aperture` unless another aperture has a
    #: larger displacement
    displaced_aperture: Aperture


def grouped(rows: Iterable[Row], key: Callable[[Row], Hashable]) -> list[list[Row]]:
    """Return rows in groups of equal keys, in the order of the first row of each group."""
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
    (`compare.error_maps`). The worst aperture counts.
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
    # Below the visible threshold all settings tie; above it, settings within measurement error tie.
    limit = max(min(map(_displaced, candidates)) + DISPLACEMENT_TIE_PX, UNSEEN_DISPLACEMENT_PX)
    return {group[0].settings for group in candidates if _displaced(group) <= limit}


def best_setting(rows: Sequence[Measurement]) -> Recommendation:
    """Return the middle of the widest window of equally good near planes.

    A window is a run of measured near planes of one depth buffer and one camera geometry, all of
    which are `equally_good`. If several windows are equally wide, the window with the larger nears
    is used; if these are equal too, the window of the first geometry and depth buffer. The middle
    of the window, by ratio, is farthest from nears with too large displacement and from nears that
    are too small for the depth buffer; if two nears are equally close to the middle, the larger one
    is used.
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


Number = Callable[[Measurement], float | None]
Rows = Sequence[tuple[int, Measurement]]
"""Rows of one aperture and one camera geometry, with their row numbers in the sweep."""

#: height of the panel of causes of one depth buffer on the page
PANEL_PIXELS = 170

_DASHED: Figure = {"name": "closed form", "mode": "lines", "line": {"color": INK, "dash": "dash"}}
_HOVER = "near %{x:.3g} of the reach<br>%{text}"


def _moved(statistic: str) -> Number:
    """Return the function that reads a statistic of a row's displacement."""
    return lambda row: getattr(row.comparison.displacement_px, statistic, None)


def _predicted(statistic: str) -> Number:
    """Return the function that reads a statistic of a row's predicted displacement."""
    return lambda row: getattr(getattr(row.predicted, "displacement_px", None), statistic, None)


def _radiance(name: str) -> Number:
    """Return the function that reads a radiance error from a row."""
    return lambda row: getattr(row.comparison.radiance, name, None)


@dataclass(frozen=True)
class Quantity:
    """An error over near planes: title of its axis, and functions that read it from a row."""

    title: str
    measured: Number
    #: closed form; None if there is none
    predicted: Number | None = None
    #: True for a share of the judged pixels; False for a number on a logarithmic axis without zero
    is_share: bool = False

    def figure(self, groups: Mapping[str, Rows], reach: float) -> Figure | None:
        """Draw a line for each named group, and dashed closed forms; None if there are no points.

        Zeros of a share are hollow marks at half a pixel, below the smallest measurable share.
        """
        lines: list[Figure] = []
        forms: dict[tuple[float | None, ...], Figure] = {}
        write = percent if self.is_share else digits
        for place, (label, group) in enumerate(groups.items()):
            color, symbol = look(place)
            rows = sorted(group, key=lambda item: item[1].settings.near)
            nears = [row.settings.near / reach for _, row in rows]
            values = [self.measured(row) for _, row in rows]
            floors = [
                0.5 / max(row.comparison.judged, 1) if self.is_share else 0 for _, row in rows
            ]
            # Each curve is thinner than the curve below it, so that coinciding curves are visible.
            below = len(groups) - 1 - place
            marks = [symbol if value else f"{symbol}-open" for value in values]
            lines.append(
                {
                    "x": nears,
                    "y": [
                        value or floor or None for value, floor in zip(values, floors, strict=True)
                    ],
                    "customdata": [number for number, _ in rows],
                    "text": ["" if value is None else write(value) for value in values],
                    "name": label,
                    "mode": "lines+markers",
                    "line": {"color": color, "width": 1.6 + 0.8 * below},
                    "marker": {"symbol": marks, "size": 6 + below, "color": color},
                    "hovertemplate": _HOVER,
                }
            )
            if self.predicted is not None:
                expected = (self.predicted(row) for _, row in rows)
                form = [
                    None if value is None else max(value, floor) or None
                    for value, floor in zip(expected, floors, strict=True)
                ]
                # Equal closed forms of several groups are drawn once, in a separate color.
                ink = INK if tuple(form) in forms else color
                line = {"color": ink, "dash": "dash"}
                forms[tuple(form)] = {"x": nears, "y": form, **_DASHED, "line": line}
        for dashed in forms.values():
            # The legend has one entry for all closed forms.
            lines.append(dashed | {"showlegend": lines[-1]["name"] != dashed["name"]})
        return _log_figure(lines, self.title, percents=self.is_share)


FIGURES = {
    "surface": Quantity(
        "pixels with the wrong surface",
        lambda row: row.surface_fraction,
        lambda row: getattr(row.predicted, "surface_fraction", None),
        is_share=True,
    ),
    "displacement_p99": Quantity(
        "99th percentile of displacement, px", _moved("p99"), _predicted("p99")
    ),
    "displacement_rms": Quantity("rms displacement, px", _moved("rms"), _predicted("rms")),
    "triangle": Quantity(
        "pixels with another triangle",
        lambda row: getattr(row.comparison.triangle, "fraction", None),
        is_share=True,
    ),
}
SHADED_FIGURES = {
    "radiance": Quantity("rms radiance error, linear", _radiance("rms")),
    "flip": Quantity("FLIP, mean over the picture", _radiance("flip")),
}
GEOMETRY_FIGURES = {
    "geometry_surface": Quantity(
        "share of pixels with the wrong surface", lambda row: row.surface_fraction, is_share=True
    ),
    "geometry_displacement": Quantity(
        "99th percentile of displacement, px", lambda row: row.displacement_p99_px
    ),
}
"""Figures of one aperture, by the names of their plots in the page's script."""


def by_depth(rows: Rows) -> dict[str, Rows]:
    """Return the rows of each depth buffer, in the order of the sweep."""
    groups = grouped(rows, lambda item: item[1].settings.depth_label)
    return {group[0][1].settings.depth_label: group for group in groups}


def pair_figure(points: Sequence[tuple[float, float, float]], title: str) -> Figure | None:
    """Draw a measured value, and its closed form as a dashed line, over near / reach."""
    nears, *heights = (list(column) for column in zip(*points, strict=True))
    marked: Figure = {
        "name": "measured",
        "mode": "lines+markers",
        "line": {"color": COLORS[1], "width": 2},
    }
    lines: list[Figure] = [
        {"x": nears, "y": [height or None for height in column], **style}
        for column, style in zip(heights, (marked, _DASHED), strict=True)
    ]
    return _log_figure(lines, title)


def _log_figure(lines: list[Figure], title: str, *, percents: bool = False) -> Figure | None:
    """Return a figure of lines over near on logarithmic axes; None if there are no points."""
    nears, heights = ([at for line in lines for at in line[axis] if at] for axis in "xy")
    if not heights:
        return None
    # Labels side by side need more space than stacked labels, and rotated labels overlap the
    # legend.
    near = {"title": "near plane / reach", "tickangle": 0, **log_axis(nears, ratio=30, labels=3)}
    # Shares have labels as in sentences: 0.0001 as `0.01%`.
    labels = {"tickformat": "~%", "exponentformat": "none"} if percents else {}
    axes = {"xaxis": near, "yaxis": log_axis(heights) | labels}
    return styled(lines, {"title": titled(title), "height": 400, **axes})


def cause_figure(rows: Rows, reach: float) -> Figure | None:
    """Draw the share of each cause in the wrong surfaces over near; None without wrong surfaces."""
    # Wrong surfaces of each cause, by row number; they add up to all wrong surfaces.
    counts = {number: {cause.name: cause.surface for cause in row.causes} for number, row in rows}
    groups = by_depth([item for item in rows if any(counts[item[0]].values())])
    if not groups:
        return None
    # The legend lists only causes that occur in the figure.
    occurring = [name for name in CAUSE_COLORS if any(here.get(name) for here in counts.values())]
    areas: list[Figure] = []
    layout: Figure = {"annotations": []}
    axes = ["y", *(f"y{number}" for number in range(2, len(groups) + 1))]
    for axis, (label, unordered) in zip(axes, groups.items(), strict=True):
        group = sorted(unordered, key=lambda item: item[1].settings.near)
        for name in occurring:
            pairs = [
                (counts[number].get(name, 0), sum(counts[number].values())) for number, _ in group
            ]
            areas.append(
                {
                    "x": [row.settings.near / reach for _, row in group],
                    "y": [100 * count / wrong for count, wrong in pairs],
                    "yaxis": axis,
                    "customdata": [number for number, _ in group],
                    "text": [f"{count:,} of {wrong:,} wrong pixels" for count, wrong in pairs],
                    "hovertemplate": f"{name}, {_HOVER}<extra></extra>",
                    "name": name,
                    "legendgroup": name,
                    # Only the first panel adds entries to the legend, one per cause.
                    "showlegend": axis == "y",
                    "mode": "lines",
                    "stackgroup": f"panel {axis}",
                    "line": {"width": 0.5, "color": CAUSE_COLORS[name]},
                    "fillcolor": CAUSE_COLORS[name],
                }
            )
        layout[axis.replace("y", "yaxis")] = {"range": [0, 100], "ticksuffix": " %", "nticks": 3}
        above = {"yref": f"{axis} domain", "y": 1, "yanchor": "bottom", "showarrow": False}
        heading = {"text": label, "xref": "paper", "x": 0.5, "font": {"size": 16}}
        layout["annotations"].append(heading | above)
    subplots = [[f"x{axis}"] for axis in axes]
    layout["grid"] = {"columns": 1, "rows": len(axes), "subplots": subplots, "ygap": 0.3}
    layout["xaxis"] = {
        "title": "near, as a share of the reach",
        **log_axis([near for area in areas for near in area["x"]]),
    }
    return styled(areas, {"height": 110 + PANEL_PIXELS * len(axes), **layout})
