"""What a report sweeps, one row of it, and which depth buffer and near planes are best, in words."""

import itertools
import math
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import groupby
from typing import TypeVar

import numpy as np

from xfrustum.compare.attribution.budget import Cause, CauseNumbers, ShearNumbers
from xfrustum.compare.beyond import displacement_p99, is_beyond
from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.metrics.error_maps import PixelSet, Spread, is_worse
from xfrustum.compare.prediction.chain import CULLING, LINKS, links_of
from xfrustum.compare.prediction.predict import Prediction, Separations
from xfrustum.compare.prediction.reasons import Reasons
from xfrustum.compare.run import StageTimes
from xfrustum.compare.scout import AutoApertures
from xfrustum.reference.alone import CERTIFIED
from xfrustum.reports.common.records import named_columns
from xfrustum.reports.text import sentences
from xfrustum.scenes import (
    Aperture,
    Cull,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Fit,
    Offset,
    Pivot,
)
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.plate.plate import Frustum
from xfrustum.scenes.representation import digits, percent, plain
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

DepthBuffer = tuple[DepthFormat, DepthMapping]

DEFAULT_DEPTHS: tuple[DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.REVERSED),
    (DepthFormat.D32F, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.REVERSED),
)
"""Depth buffers of a report, the cheapest first: where windows are equally good, the first is recommended."""

DEFAULT_NEARS_PER_REACH = np.geomspace(1e-1, 1e-8, 25)

GEOMETRY = ("pivot", "fit", "offset", "slabs")
"""Fields of `DoubleFrustum` that say where the cameras stand and what their films span."""


@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """What a report measures, and how; None is the usual choice.

    Every combination of the nears, depth buffers and camera geometries is measured.
    """

    #: In scene units, each between 0 and the reach; None for `default_nears`.
    nears: Sequence[float] | None = None
    #: None for the middle one and, if the frustum is recentered, two corners. With those that
    #: `auto_apertures` chooses, the page has a map of the plate.
    apertures: Sequence[Aperture] | AutoApertures | None = None
    depths: Sequence[DepthBuffer] | None = None
    #: None for both of a recentered frustum where they differ; else the aperture.
    pivots: Sequence[Pivot] | None = None
    fits: Sequence[Fit | float] | None = None
    offsets: Sequence[Offset] | None = None
    slabs: Sequence[tuple[float, ...]] | None = None
    cull: Cull = Cull.NONE
    tracer: str = "embree"
    #: Effects that are simulated, as `--effects` takes them: `auto`, `all`, or names between
    #: commas.
    effects: str = "auto"
    #: What decides the truths: `certified`, or a tracer alone, of which nothing is examined.
    decided_by: str = CERTIFIED
    #: Whether wrong pixels are charged to causes, and errors predicted.
    causes: bool = True
    #: By which rounding is explained; None for the known model of the device at hand.
    device: DeviceModel | None = None
    #: Whether there is a progress bar on standard error.
    progress: bool = False


def default_nears(frustum: Frustum) -> tuple[float, ...]:
    """Return 25 offsets in scene units, logarithmic, from 1e-1 down to 1e-8 of the longest reach."""
    return tuple(float(share) * frustum.longest_reach for share in DEFAULT_NEARS_PER_REACH)


def settings_of(frustum: Frustum, options: ReportOptions) -> tuple[DoubleFrustum, ...]:
    """Return all settings of a report, each once: geometry by geometry, and all nears of a buffer in turn.

    InputError where settings make no sense for the frustum.
    """
    nears = tuple(dict.fromkeys(default_nears(frustum) if options.nears is None else options.nears))
    buffers = tuple(dict.fromkeys(DEFAULT_DEPTHS if options.depths is None else options.depths))
    found = [
        replace(geometry, near=near, depth=depth, mapping=mapping, cull=options.cull)
        for geometry in geometry_grid(frustum, options)
        for depth, mapping in buffers
        for near in nears
        # Larger nears are left out where they are none that anybody asked for.
        if options.nears is not None or admits(geometry, near, frustum)
    ]
    for setting in found:
        setting.check_against(frustum)
    return tuple(found)


def geometry_grid(frustum: Frustum, options: ReportOptions) -> tuple[DoubleFrustum, ...]:
    """Return every combination of pivot, fit, offset and cuts, each once: the cuts change fastest."""
    # A centered frustum has no shear. The own centers of cameras without an offset are the
    # aperture.
    both = frustum.recentered and options.pivots is None
    usual = tuple(Pivot) if both else (Pivot.APERTURE,)
    product = itertools.product(
        usual if options.pivots is None else options.pivots,
        (None,) if options.fits is None else options.fits,
        (Offset.PLATE,) if options.offsets is None else options.offsets,
        ((),) if options.slabs is None else options.slabs,
    )
    return geometries_of(
        DoubleFrustum(near=1.0, pivot=pivot, fit=fit, offset=offset, slabs=tuple(cuts))
        for pivot, fit, offset, cuts in product
        if not (both and pivot is Pivot.CAMERA and offset == Offset.NONE)
    )


def admits(geometry: DoubleFrustum, near: float, frustum: Frustum) -> bool:
    """Return whether a near lies before the first cut, as it must where cameras do not step back."""
    return geometry.offset is Offset.PLATE or near < min((*geometry.slabs, *frustum.reach))


def geometry_of(settings: DoubleFrustum) -> DoubleFrustum:
    """Return the camera geometry of settings: the same cameras, of near 1 and the usual depth buffer."""
    return DoubleFrustum(near=1.0, **{name: getattr(settings, name) for name in GEOMETRY})


def geometries_of(settings: Iterable[DoubleFrustum]) -> tuple[DoubleFrustum, ...]:
    """Return the camera geometries of some settings, each once, in the order in which they first occur."""
    return tuple(dict.fromkeys(map(geometry_of, settings)))


def geometry_names(geometries: Sequence[DoubleFrustum]) -> dict[DoubleFrustum, str]:
    """Return a name of each geometry, which tells it from the others.

    A single one is named by what is not usual about it, such as `pivot camera, no offset`, or not
    at all.
    """
    varied = [name for name in GEOMETRY if len({getattr(one, name) for one in geometries}) > 1]
    usual = DoubleFrustum(near=1.0)

    def words(one: DoubleFrustum) -> Iterator[str]:
        heights = " and ".join(map(digits, one.slabs))
        told = {
            "pivot": f"pivot {one.pivot}",
            "fit": f"fit {digits(one.fit) if isinstance(one.fit, float) else one.fit}",
            "offset": "no offset" if one.offset is Offset.NONE else "offset to the plate",
            "slabs": f"cuts at {heights}" if heights else "no cuts",
        }
        for name in GEOMETRY:
            if name in varied or (not varied and getattr(one, name) != getattr(usual, name)):
                yield "usual fit" if name == "fit" and one.fit is None else told[name]

    return {one: ", ".join(words(one)) for one in geometries}


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
    prediction_reasons: Reasons | None
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
    """One raster image judged against the truth (CONVENTIONS.md, "Errors and their signs")."""

    aperture: Aperture
    settings: DoubleFrustum
    comparison: ComparisonNumbers
    causes: tuple[
        Cause, ...
    ]  #: links of the error budget with their wrong pixels; empty where left out
    unexplained: (
        int | None
    )  #: wrong pixels that rounding ought to explain and does not; None without causes
    predicted: (
        Prediction | None
    )  #: the error by closed forms, from the scene alone; None without causes
    times_s: StageTimes
    gpu_s: float  #: the device's own time, a part of `times_s.raster`
    shear: ShearNumbers | None = (
        None  #: what the pivot does to the points that are shown, if anything
    )
    #: By `surface` and `radiance`: the judged pixels that show the wrong surface, or a color that
    #: is off by more than 1/255; empty where they were not kept.
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
        return (
            round(self.wrong_share(kind) * self.comparison.judged)
            if pixels is None
            else pixels.count
        )

    @property
    def measured_over_predicted(self) -> dict[str, float | None]:
        """Ratios; None where there is no measurement or no prediction, and where zero is predicted."""
        predicted, measured = self.predicted, self.comparison.displacement_px
        moved = predicted.displacement_px if predicted else None
        surface = predicted.surface_fraction if predicted else None
        return {
            "displacement_rms": measured.rms / moved.rms
            if measured and moved and moved.rms
            else None,
            "displacement_p99": measured.p99 / moved.p99
            if measured and moved and moved.p99
            else None,
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
            parts = {one.name: getattr(predicted, one.name) for one in fields(PredictedSurface)[1:]}
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
            prediction_reasons=sentences(predicted.reasons) if predicted else None,
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


Row = TypeVar("Row")

SURFACE_TIE_FRACTION = 1e-4
"""Surface fractions closer than this are equal. A rasterizer snaps vertices to 2^-8 px, which leaves
the pixels within sqrt(2)/2 2^-8 px on both sides of a silhouette in doubt: a share of 0.0055 l/W,
for
contours as long as l image widths. At W = 512 and nine image widths this is one pixel in ten thousand."""

DISPLACEMENT_TIE_PX = 1e-3
"""Displacements closer than this are equal: 32-bit surface positions measure it no better (99 % of
pixels within 1e-3 px on meshes)."""

MAX_NAMED_HOGELS = 5  #: largest number of hogels that the recommendation names

UNSEEN_DISPLACEMENT_PX = 0.1
"""Displacements below this are equally good. At 67 pixels per degree, for which FLIP judges, a pixel spans 54
seconds of arc; people see an offset of 5 at best between two lines that continue each other
(vernier acuity,
Westheimer 1979): a tenth of a pixel."""


@dataclass(frozen=True, kw_only=True)
class Window:
    """Consecutive near planes of one depth buffer that are equally good, scene units."""

    low: float
    high: float
    nears: int  #: that were measured from `low` to `high`


@dataclass(frozen=True, kw_only=True)
class Recommendation:
    """A setting that is recommended, with its numbers at the worst of the apertures."""

    settings: DoubleFrustum
    surface_fraction: float
    displacement_p99_px: float
    #: Share of judged pixels with a channel that is off by more than 1/255; None of a scene without
    #: shading.
    radiance_fraction: float | None
    #: The near planes of the same depth buffer that are as good.
    window: Window
    #: The aperture with the largest share of wrong surfaces, and of those the most displaced one;
    #: and the one with the largest displacement: the same one, unless another is displaced more.
    aperture: Aperture
    displaced_aperture: Aperture


def _grouped(rows: Iterable[Row], key: Callable[[Row], Hashable]) -> list[list[Row]]:
    """Return rows in groups of equal keys, in the order in which the keys come first."""
    found: dict[Hashable, list[Row]] = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    return list(found.values())


def _worst(rows: Sequence[Measurement], kind: str) -> Measurement:
    """Return the row of a setting at the aperture with most pixels that are wrong in one sense."""
    return max(rows, key=lambda row: row.wrong_share(kind))


def _is_worse(
    one: Sequence[Measurement], other: Sequence[Measurement], kind: str, comparisons: int
) -> bool:
    """Return whether a setting is worse at its worst aperture: by more than a tie, and beyond chance."""
    here = _worst(one, kind)
    if here.wrong_share(kind) <= _worst(other, kind).wrong_share(kind) + SURFACE_TIE_FRACTION:
        return False
    there = next(row for row in other if row.aperture == here.aperture)
    both = kind in here.wrong and kind in there.wrong
    shared = here.wrong[kind].shared_with(there.wrong[kind]) if both else 0
    return is_worse(here.wrong_count(kind) - shared, there.wrong_count(kind) - shared, comparisons)


def _displaced(rows: Sequence[Measurement]) -> float:
    return max(row.displacement_p99_px for row in rows)


def equally_good(rows: Sequence[Measurement]) -> set[DoubleFrustum]:
    """Return the settings than which no measured setting is better.

    Settings are chosen in three steps. The first keeps those that are not worse than the one with
    the fewest wrong surfaces. The second does the same for wrong colors, where the scene is shaded.
    The third keeps those displaced by at most `UNSEEN_DISPLACEMENT_PX` or, if that is more, by the
    least displacement plus `DISPLACEMENT_TIE_PX`. One setting is worse than another if it has more
    wrong pixels by more than `SURFACE_TIE_FRACTION` and beyond chance
    (`compare.metrics.error_maps`). The worst aperture counts.
    """
    candidates = _grouped(rows, lambda row: row.settings)
    comparisons = max(len(candidates) - 1, 1)
    for kind in ("surface", "radiance"):
        least = min(candidates, key=lambda one: _worst(one, kind).wrong_share(kind))
        candidates = [one for one in candidates if not _is_worse(one, least, kind, comparisons)]
    limit = max(min(map(_displaced, candidates)) + DISPLACEMENT_TIE_PX, UNSEEN_DISPLACEMENT_PX)
    return {one[0].settings for one in candidates if _displaced(one) <= limit}


def best_setting(rows: Sequence[Measurement]) -> Recommendation:
    """Return what is recommended: the middle of the widest window of equally good near planes.

    A window is a run of near planes of one depth buffer and one camera geometry, as they were
    measured, that all are `equally_good`. Where windows are equally wide, the one with the larger
    nears is taken, and where these are equal too, the geometry and the depth buffer that come
    first. Its middle, by ratio, is farthest both from nears so large that they bend the picture and
    from nears so small that they starve it of depth; of two middles the larger near is taken.
    """
    good, windows = equally_good(rows), []
    for line in _grouped(
        dict.fromkeys(row.settings for row in rows), lambda one: replace(one, near=1.0)
    ):
        for is_good, run in groupby(sorted(line, key=lambda one: one.near), key=good.__contains__):
            if is_good:
                nears = [one.near for one in run]
                windows.append(
                    (Window(low=nears[0], high=nears[-1], nears=len(nears)), nears, line[0])
                )
    window, nears, cameras = max(windows, key=lambda one: (one[0].high / one[0].low, one[0].high))
    middle = (window.low * window.high) ** 0.5
    # The ratio to the middle, upwards or downwards; its digits beyond the twelfth are rounding.
    near = min(reversed(nears), key=lambda near: round(max(near / middle, middle / near), 12))
    chosen = [row for row in rows if row.settings == replace(cameras, near=near)]
    shaded = all("radiance" in row.wrong for row in chosen)
    worst = max(chosen, key=lambda row: (row.surface_fraction, row.displacement_p99_px))
    moved = max(chosen, key=lambda row: (row.displacement_p99_px, row is worst))
    return Recommendation(
        settings=worst.settings,
        surface_fraction=worst.surface_fraction,
        displacement_p99_px=moved.displacement_p99_px,
        radiance_fraction=_worst(chosen, "radiance").wrong_share("radiance") if shaded else None,
        window=window,
        aperture=worst.aperture,
        displaced_aperture=moved.aperture,
    )


def best_per_depth(rows: Sequence[Measurement]) -> list[Recommendation]:
    """Return the best setting of each depth format and mapping, in the order in which the rows name them."""
    return [best_setting(group) for group in _grouped(rows, lambda row: row.settings.depth_label)]


def best_per_geometry(rows: Sequence[Measurement]) -> list[Recommendation]:
    """Return the best setting of each camera geometry, in the order in which the rows name them."""
    return [best_setting(group) for group in _grouped(rows, lambda row: geometry_of(row.settings))]


def can_be_judged(rows: Sequence[Measurement]) -> bool:
    """Return whether there is a pixel that some setting could show wrongly."""
    shown = any(row.comparison.covered or row.comparison.displacement_px for row in rows)
    return shown and any(row.comparison.judged for row in rows)


def sentence(
    rows: Sequence[Measurement], units: str, reach: float, *, recentered: bool = True
) -> str:
    """Say which near planes and which depth buffer are best, and how good they are.

    `units` and `reach` are the scene's length unit, and its larger reach in it. The pivot of a
    frustum that is not recentered, hence not sheared, changes nothing and is not named.
    """
    indices = dict.fromkeys(row.aperture.index for row in rows)
    named = "; ".join(f"{column},{row}" for column, row in list(indices)[:MAX_NAMED_HOGELS])
    named += "; .." if len(indices) > MAX_NAMED_HOGELS else ""
    where = f"At hogel {named}:" if len(indices) == 1 else f"At {len(indices)} hogels ({named}):"
    if not any(row.comparison.judged for row in rows):
        return f"{where} nothing can be judged: every pixel of the truth is a tie."
    if not can_be_judged(rows):
        return f"{where} there is nothing to judge: neither the truth nor any raster image shows a surface."
    best = best_setting(rows)

    # The cameras, where there are others or they are not the usual ones.
    geometries = geometries_of(
        row.settings if recentered else replace(row.settings, pivot=Pivot.APERTURE) for row in rows
    )
    own = best.settings if recentered else replace(best.settings, pivot=Pivot.APERTURE)
    name = geometry_names(geometries)[geometry_of(own)]
    cameras = f" and {name}" if name else ""

    nears, near = best.window.nears, digits(best.settings.near)
    equally = f"; the {nears} nears measured there are equally good. At {near} {units}, "
    colors = ""
    if best.radiance_fraction is not None:
        colors = f"{percent(best.radiance_fraction)} are off in color by more than a level of 255, "
    elsewhere = gap = ""
    if best.settings.offset is Offset.NONE:
        gap = (
            " The cameras stay in the aperture and clip all that is closer than near: a gap of "
            f"{near} {units} on each side of the plate."
        )
    if best.displaced_aperture != best.aperture and best.displacement_p99_px > DISPLACEMENT_TIE_PX:
        elsewhere = (
            f" (the worst at {best.displaced_aperture.column},{best.displaced_aperture.row})"
        )
    return (
        f"{where} {_praise(best, rows)} near {near_range(best.window)} {units} "
        f"({near_range(best.window, reach)} of the reach) with {best.settings.depth_label} depth{cameras}"
        f"{equally if nears > 1 else '. '}{_wrong(best, rows)}, {colors}"
        f"and {where_it_lies(best.displacement_p99_px)}{elsewhere}.{gap}"
    )


def _praise(best: Recommendation, rows: Sequence[Measurement]) -> str:
    """Begin with the praise: no setting that misses the tolerances is called good, nor are others denied."""
    limits = f"{TOLERANCE_PX:g} px and {percent(MAX_WRONG)} wrong surfaces"
    every = {row.settings for row in rows}
    kept = every - {
        row.settings
        for row in rows
        if is_beyond(row.displacement_p99_px, row.surface_fraction, TOLERANCE_PX)
    }
    if best.settings in kept:
        return "the one setting measured:" if len(every) == 1 else f"best of {len(every)} settings:"
    if len(every) == 1:
        return f"the one setting measured does not keep to {limits}:"
    if not kept:
        return f"no setting measured keeps to {limits}. The least bad of {len(every)}:"
    return f"best of {len(every)} settings by wrong surfaces, though only others keep to {limits}:"


def _wrong(best: Recommendation, rows: Sequence[Measurement]) -> str:
    """Say how many pixels show the wrong surface, at which aperture, and by what if one cause prevails."""
    apertures = len({row.aperture for row in rows})
    place = f"{best.aperture.column},{best.aperture.row}"
    where = f" at the worst of {apertures} apertures ({place})" if apertures > 1 else ""
    said = f"{percent(best.surface_fraction)} of the judged pixels show the wrong surface{where}"
    worst = next(
        row for row in rows if row.settings == best.settings and row.aperture == best.aperture
    )
    most = max(worst.causes, key=lambda cause: cause.surface, default=None)
    wrong = sum(cause.surface for cause in worst.causes)
    if best.surface_fraction <= SURFACE_TIE_FRACTION or most is None or 2 * most.surface <= wrong:
        return said
    return f"{said}, most of them by {worst.cause_words(most.name)}"


def near_range(window: Window, unit: float = 1.0) -> str:
    """Write a window, in multiples of a length."""
    if window.nears == 1:
        return digits(window.low / unit)
    return f"{digits(window.low / unit)} to {digits(window.high / unit)}"


def where_it_lies(displacement_p99_px: float) -> str:
    """Say how far from its place 99 % of the picture lies."""
    if math.isinf(displacement_p99_px):
        return "where the picture belongs is undefined, for much of it shows a surface in the plate itself"
    return f"99 % of the picture lies within {pixels(displacement_p99_px)} of where it belongs"


def pixels(value: float) -> str:
    """Write a displacement with two digits; below `DISPLACEMENT_TIE_PX` they mean nothing."""
    rounded = float(f"{max(value, DISPLACEMENT_TIE_PX):.2g}")
    return f"{rounded:,.0f} px" if rounded >= 100 else plain(f"{rounded:.2g} px")


def equally_good_sentence(rows: Sequence[Measurement]) -> str:
    """Say how many settings of which depth buffers are equally good by error; empty where one is the best."""
    good = equally_good(rows)
    if len(good) < 2 or not can_be_judged(rows):
        return ""
    counts = Counter(row.settings.depth_label for row in rows if row.settings in good)
    apertures = len({row.aperture for row in rows})
    named = ", ".join(f"{count // apertures} of {label}" for label, count in counts.items())
    return f"{len(good)} settings are equally good by error: {named}. xfrustum cost tells their times apart."


def cause_sentences(rows: Sequence[Measurement], units: str) -> list[str]:
    """Say for each depth buffer of one aperture which cause makes most surfaces wrong where."""

    def dominant(row: Measurement) -> str:
        if row.surface_fraction <= SURFACE_TIE_FRACTION:
            return "hardly a surface is wrong"
        return f"{row.cause_words(max(row.causes, key=lambda cause: cause.surface).name)} dominates"

    def told(rows: Sequence[Measurement]) -> Iterator[str]:
        for what, run in groupby(sorted(rows, key=lambda row: row.settings.near), key=dominant):
            nears = [row.settings.near for row in run]
            where = f"from n = {digits(nears[0])} to" if len(nears) > 1 else "at n ="
            yield f"{where} {digits(nears[-1])} {units} {what}"

    groups = _grouped(rows, lambda row: row.settings.depth_label)
    return [f"{group[0].settings.depth_label}: {'; '.join(told(group))}." for group in groups]
