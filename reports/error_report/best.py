"""The recommendation: which depth buffer and near planes are best, and the sentence that says so."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import TypeVar

from xfrustum.compare.beyond import is_beyond
from xfrustum.compare.metrics.paired import is_worse
from xfrustum.reports.common.geometry import CameraGeometry, geometry_names
from xfrustum.reports.error_report.measurement import Measurement
from xfrustum.scenes.notebook import digits, percent, plain
from xfrustum.scenes.plate.double_frustum import DoubleFrustum, Offset
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

Row = TypeVar("Row")

SURFACE_TIE_FRACTION = 1e-4
"""Surface fractions closer than this are equal. A rasterizer snaps vertices to 2^-8 px, which leaves
the pixels within sqrt(2)/2 2^-8 px on both sides of a silhouette in doubt: a share of 0.0055 l/W, for
contours as long as l image widths. At W = 512 and nine image widths this is one pixel in ten thousand."""

DISPLACEMENT_TIE_PX = 1e-3
"""Displacements closer than this are equal: 32-bit surface positions measure it no better (99 % of
pixels within 1e-3 px on meshes)."""

MAX_NAMED_HOGELS = 5
"""Largest number of hogels that the recommendation names."""

UNSEEN_DISPLACEMENT_PX = 0.1
"""Displacements below this are equally good. At 67 pixels per degree, for which FLIP judges, a pixel spans 54
seconds of arc; people see an offset of 5 at best between two lines that continue each other (vernier acuity,
Westheimer 1979): a tenth of a pixel."""


@dataclass(frozen=True, kw_only=True)
class Window:
    """Consecutive near planes of one depth buffer that are equally good.

    Attributes
    ----------
    low, high
        The least and the largest near, scene units.
    nears
        Number of nears that were measured from `low` to `high`.
    """

    low: float
    high: float
    nears: int

    @property
    def width(self) -> float:
        """The largest near over the least."""
        return self.high / self.low


@dataclass(frozen=True, kw_only=True)
class Recommendation:
    """A setting that is recommended, with its numbers at the worst of the apertures.

    Attributes
    ----------
    radiance_fraction
        Share of judged pixels with a channel of color that is off by more than 1/255; None where the scene
        is not shaded.
    window
        The near planes of the same depth buffer that are as good.
    aperture
        The aperture with the largest share of wrong surfaces, and of those the most displaced one.
    displaced_aperture
        The aperture with the largest displacement: the same one, unless another is displaced more.
    """

    settings: DoubleFrustum
    surface_fraction: float
    displacement_p99_px: float
    radiance_fraction: float | None
    window: Window
    aperture: Aperture
    displaced_aperture: Aperture


class _Candidate:
    """One setting at all apertures."""

    def __init__(self, rows: Sequence[Measurement]) -> None:
        self.settings = rows[0].settings
        self._rows = {row.aperture: row for row in rows}
        self.displacement_p99_px = max(row.displacement_p99_px for row in rows)

    def worst(self, kind: str) -> tuple[float, Aperture]:
        """Return the largest share of pixels that are wrong in one sense, and its aperture."""
        shares = {place: row.wrong_share(kind) for place, row in self._rows.items()}
        place = max(shares, key=shares.__getitem__)
        return shares[place], place

    def is_worse_than(self, other: _Candidate, kind: str, comparisons: int) -> bool:
        """Return whether it is worse at its worst aperture: by more than a tie, and beyond chance."""
        share, place = self.worst(kind)
        if share <= other.worst(kind)[0] + SURFACE_TIE_FRACTION:
            return False
        here, there = self._rows[place], other._rows[place]
        both = kind in here.wrong and kind in there.wrong
        shared = here.wrong[kind].shared_with(there.wrong[kind]) if both else 0
        return is_worse(here.wrong_count(kind) - shared, there.wrong_count(kind) - shared, comparisons)

    def recommendation(self, window: Window) -> Recommendation:
        """Return the setting with its numbers."""
        rows = self._rows.values()
        shaded = all("radiance" in row.wrong for row in rows)
        worst = max(rows, key=lambda row: (row.surface_fraction, row.displacement_p99_px))
        moved = max(rows, key=lambda row: (row.displacement_p99_px, row is worst))
        return Recommendation(
            settings=self.settings,
            surface_fraction=worst.surface_fraction,
            displacement_p99_px=self.displacement_p99_px,
            radiance_fraction=self.worst("radiance")[0] if shaded else None,
            window=window,
            aperture=worst.aperture,
            displaced_aperture=moved.aperture,
        )


def _grouped(rows: Iterable[Row], key: Callable[[Row], Hashable]) -> list[list[Row]]:
    """Return rows in groups of equal keys, in the order in which the keys come first."""
    found: dict[Hashable, list[Row]] = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    return list(found.values())


def _candidates(rows: Sequence[Measurement]) -> list[_Candidate]:
    return [_Candidate(group) for group in _grouped(rows, lambda row: row.settings)]


def equally_good(rows: Sequence[Measurement]) -> set[DoubleFrustum]:
    """Return the settings than which no measured setting is better.

    Settings are chosen in three steps. The first keeps those that are not worse than the one with the fewest
    wrong surfaces. The second does the same for wrong colors, where the scene is shaded. The third keeps
    those displaced by at most `UNSEEN_DISPLACEMENT_PX` or, if that is more, by the least displacement plus
    `DISPLACEMENT_TIE_PX`. One setting is worse than another if it has more wrong pixels by more than
    `SURFACE_TIE_FRACTION` and beyond chance (`compare.metrics.paired`). The worst aperture counts.

    Raises
    ------
    ValueError
        There are no rows.
    """
    return {one.settings for one in _best(_candidates(rows))}


def _best(candidates: list[_Candidate]) -> list[_Candidate]:
    comparisons = max(len(candidates) - 1, 1)
    for kind in ("surface", "radiance"):
        least = min(candidates, key=lambda one: one.worst(kind)[0])
        candidates = [one for one in candidates if not one.is_worse_than(least, kind, comparisons)]
    least_px = min(one.displacement_p99_px for one in candidates)
    limit = max(least_px + DISPLACEMENT_TIE_PX, UNSEEN_DISPLACEMENT_PX)
    return [one for one in candidates if one.displacement_p99_px <= limit]


def best_setting(rows: Sequence[Measurement]) -> Recommendation:
    """Return what is recommended: the middle of the widest window of equally good near planes.

    A window is a run of near planes of one depth buffer and one camera geometry, as they were measured, that
    all are `equally_good`. Where windows are equally wide, the one with the larger nears is taken, and where
    these are equal too, the geometry and the depth buffer that come first. Its middle, by ratio, is farthest
    both from nears so large that they bend the picture and from nears so small that they starve it of depth;
    of two middles the larger near is taken.

    Raises
    ------
    ValueError
        There are no rows.
    """
    candidates = _candidates(rows)
    good, windows = _best(candidates), []
    for line in _grouped(candidates, _line):
        ascending = sorted(line, key=lambda one: one.settings.near)
        for is_good, neighbors in groupby(ascending, key=lambda one: one in good):
            if is_good:
                windows.append(list(neighbors))

    def window(run: Sequence[_Candidate]) -> Window:
        return Window(low=run[0].settings.near, high=run[-1].settings.near, nears=len(run))

    run = max(windows, key=lambda one: (window(one).width, window(one).high))
    middle = (run[0].settings.near * run[-1].settings.near) ** 0.5
    # The ratio to the middle, upwards or downwards; its digits beyond the twelfth are rounding.
    chosen = min(
        reversed(run), key=lambda one: round(max(one.settings.near / middle, middle / one.settings.near), 12)
    )
    return chosen.recommendation(window(run))


def _line(one: _Candidate) -> Hashable:
    """Return what all settings of one window have in common: depth buffer and camera geometry."""
    return one.settings.depth, one.settings.mapping, CameraGeometry.of(one.settings)


def can_be_judged(rows: Sequence[Measurement]) -> bool:
    """Return whether there is a pixel that some setting could show wrongly."""
    shown = any(row.comparison.covered or row.comparison.displacement_px for row in rows)
    return shown and any(row.comparison.judged for row in rows)


def best_per_depth(rows: Sequence[Measurement]) -> list[Recommendation]:
    """Return the best setting of each depth format and mapping, in the order in which the rows name them."""
    return [best_setting(group) for group in _grouped(rows, lambda row: row.settings.depth_label)]


def best_per_geometry(rows: Sequence[Measurement]) -> list[Recommendation]:
    """Return the best setting of each camera geometry, in the order in which the rows name them."""
    return [best_setting(group) for group in _grouped(rows, lambda row: CameraGeometry.of(row.settings))]


def keeping_tolerance(rows: Sequence[Measurement]) -> set[DoubleFrustum]:
    """Return the settings with which no hogel that was measured is beyond `TOLERANCE_PX`."""
    beyond = {
        row.settings for row in rows if is_beyond(row.displacement_p99_px, row.surface_fraction, TOLERANCE_PX)
    }
    return {row.settings for row in rows} - beyond


def sentence(rows: Sequence[Measurement], units: str, reach: float, *, recentered: bool = True) -> str:
    """Say which near planes and which depth buffer are best, and how good they are.

    Parameters
    ----------
    rows
        All rows of a sweep.
    units, reach
        The scene's length unit, and its larger reach in it.
    recentered
        Whether the frustum is sheared; the pivot of one that is not changes nothing and is not named.
    """
    where = _where(rows)
    if not any(row.comparison.judged for row in rows):
        return f"{where} nothing can be judged: every pixel of the truth is a tie."
    if not can_be_judged(rows):
        return f"{where} there is nothing to judge: neither the truth nor any raster image shows a surface."
    best = best_setting(rows)
    cameras = _cameras(best, rows, recentered)
    return (
        f"{where} {_praise(best, rows)} near {near_range(best.window)} {units} "
        f"({near_range(best.window, reach)} of the reach) with {best.settings.depth_label} depth{cameras}"
        f"{_equally(best, units)}{_wrong(best, rows)}, {_colors(best)}"
        f"and {where_it_lies(best.displacement_p99_px)}"
        f"{_elsewhere(best)}.{gap(best, units)}"
    )


def _where(rows: Sequence[Measurement]) -> str:
    """Begin the sentence with the hogels that it speaks of."""
    places = [f"{column},{row}" for column, row in dict.fromkeys(row.aperture.index for row in rows)]
    named = f"{'; '.join(places[:MAX_NAMED_HOGELS])}{'; ..' if len(places) > MAX_NAMED_HOGELS else ''}"
    return f"At hogel {named}:" if len(places) == 1 else f"At {len(places)} hogels ({named}):"


def _praise(best: Recommendation, rows: Sequence[Measurement]) -> str:
    """Go on with the praise: no setting that misses the tolerances is called good, nor are others denied."""
    count = len({row.settings for row in rows})
    limits = f"{TOLERANCE_PX:g} px and {percent(MAX_WRONG)} wrong surfaces"
    kept = keeping_tolerance(rows)
    if best.settings in kept:
        return "the one setting measured:" if count == 1 else f"best of {count} settings:"
    if count == 1:
        return f"the one setting measured does not keep to {limits}:"
    if not kept:
        return f"no setting measured keeps to {limits}. The least bad of {count}:"
    return f"best of {count} settings by wrong surfaces, though only others keep to {limits}:"


def _cameras(best: Recommendation, rows: Sequence[Measurement], recentered: bool) -> str:
    """Name the cameras where there are others or they are not the usual ones."""

    def shown(settings: DoubleFrustum) -> CameraGeometry:
        geometry = CameraGeometry.of(settings)
        return geometry if recentered else replace(geometry, pivot=CameraGeometry().pivot)

    names = geometry_names(tuple(dict.fromkeys(shown(row.settings) for row in rows)))
    name = names[shown(best.settings)]
    return f" and {name}" if name else ""


def _wrong(best: Recommendation, rows: Sequence[Measurement]) -> str:
    """Say how many pixels show the wrong surface, at which aperture, and by what if one cause prevails."""
    apertures = len({row.aperture for row in rows})
    place = f"{best.aperture.column},{best.aperture.row}"
    where = f" at the worst of {apertures} apertures ({place})" if apertures > 1 else ""
    said = f"{percent(best.surface_fraction)} of the judged pixels show the wrong surface{where}"
    if best.surface_fraction <= SURFACE_TIE_FRACTION:
        return said
    worst = next(row for row in rows if row.settings == best.settings and row.aperture == best.aperture)
    return f"{said}, most of them by {worst.main_cause}" if worst.main_cause else said


def _elsewhere(best: Recommendation) -> str:
    """Name the most displaced aperture where it is not the one with the most wrong surfaces."""
    place = best.displaced_aperture
    same = place == best.aperture or best.displacement_p99_px <= DISPLACEMENT_TIE_PX
    return "" if same else f" (the worst at {place.column},{place.row})"


def gap(best: Recommendation, units: str) -> str:
    """Say what cameras that stay in the aperture leave out; nothing of cameras that step back."""
    if best.settings.offset is Offset.PLATE:
        return ""
    return (
        " The cameras stay in the aperture and clip all that is closer than near: a gap of "
        f"{digits(best.settings.near)} {units} on each side of the plate."
    )


def _equally(best: Recommendation, units: str) -> str:
    if best.window.nears == 1:
        return ". "
    return (
        f"; the {best.window.nears} nears measured there are equally good. "
        f"At {digits(best.settings.near)} {units}, "
    )


def _colors(best: Recommendation) -> str:
    if best.radiance_fraction is None:
        return ""
    return f"{percent(best.radiance_fraction)} are off in color by more than a level of 255, "


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
