"""All rows of a survey in bounded memory: counts, maps, distributions and the worst hogels.

Rows are read part by part. The numbers that are kept do not grow with the rows: a map has at most
`MAX_MAP_CELLS` cells along a side, in which the worst hogel counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from xfrustum.reports.survey.rows import depth_ends
from xfrustum.scenes.arrays import Floats, Indices, Mask

MAX_MAP_CELLS = 120
"""Largest number of cells along a side of a map, each five pixels wide on the page."""

WORST_HOGELS = 6
"""Number of the worst hogels of each setting that are named, and shown on the page."""

P99, SURFACE, FRACTION = "displacement_px_p99", "surface_fraction", "fraction"
"""Columns that decide which hogels are worst; images that name no surfaces have the last one alone."""

LOWEST_PX, HIGHEST_PX, BINS_PER_DECADE = 1e-6, 1e6, 20
"""Ends of the distribution of displacement, and its bins: far below what 32-bit positions can show, and far
beyond any film. What lies outside counts at the ends."""

MAP_COLUMNS = {
    P99: "displacement (p99), px",
    SURFACE: "share of wrong surfaces",
    FRACTION: "share of wrong pixels",
    "height_rms": "error of height (rms)",
    "radiance_rms": "error of radiance (rms)",
    "unexplained": "unexplained pixels",
}
"""Columns that are mapped where they have values, in words; columns of causes are found by their names."""


@dataclass(frozen=True, kw_only=True)
class WorstHogel:
    """A hogel by how bad it is: first whether it is beyond, then by displacement, then by its wrong surfaces.

    `badness` is the 99th percentile of displacement: infinite where that is unknown of a hogel beyond, 0
    where nothing is displaced. Of images that name no surfaces, `surface_fraction` is the share of wrong
    pixels; it is None for a hogel that is missing.
    """

    beyond: bool
    badness: float
    surface_fraction: float | None
    aperture: tuple[int, int]
    displacement_p99_px: float | None


class Tally:
    """Counts, maps and the worst hogels of the rows of one setting, for a plate of so many columns and rows.

    Attributes
    ----------
    worst
        The worst hogels, the worst first.
    maps
        By column: (rows, columns) of cells, the largest value in each; NaN where there is none.
    displaced
        Number of hogels by their 99th percentile of displacement, in the bins of `displacement_ends`.
    depth_pixels, depth_squares_px2, depth_max_px
        Sums and maxima of `DepthBins` over all hogels.
    """

    def __init__(self, hogels: tuple[int, int]) -> None:
        self._hogels = hogels
        self._cells = tuple(min(count, MAX_MAP_CELLS) for count in hogels)
        self.judged = self.beyond = 0
        self.worst: list[WorstHogel] = []
        self.maps: dict[str, Floats] = {}
        self.displaced: Indices = np.zeros(len(displacement_ends()) - 1, dtype=np.int64)
        bins = len(depth_ends()) - 1
        self.depth_pixels: Indices = np.zeros(bins, dtype=np.int64)
        self.depth_squares_px2, self.depth_max_px = np.zeros(bins), np.zeros(bins)

    def add(self, rows: pa.Table) -> None:
        """Count some rows, of this setting alone."""
        columns, lines = (_numbers(rows, name).astype(np.int64) for name in ("column", "row"))
        beyond = _numbers(rows, "beyond") > 0
        self.judged += len(columns)
        self.beyond += int(beyond.sum())
        self._rank(rows, columns, lines, beyond)
        place = tuple(
            index * cells // count
            for index, cells, count in zip((columns, lines), self._cells, self._hogels, strict=True)
        )
        for name in rows.column_names:
            if _is_mapped(name):
                self._map(name, place[::-1], _numbers(rows, name))
        moved = _numbers(rows, P99)
        moved = np.clip(moved[np.isfinite(moved)], LOWEST_PX, HIGHEST_PX)
        self.displaced += np.histogram(moved, displacement_ends())[0]
        if "depth_pixels" in rows.column_names:
            pixels, squares, largest = (
                np.array(rows.column(f"depth_{name}").to_pylist())
                for name in ("pixels", "squares_px2", "max_px")
            )
            self.depth_pixels += pixels.sum(axis=0)
            self.depth_squares_px2 += squares.sum(axis=0)
            self.depth_max_px = np.maximum(self.depth_max_px, largest.max(axis=0))

    @property
    def depth_rms_px(self) -> Floats:
        """Root mean square displacement in each bin of depth; NaN where nothing is shown."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.sqrt(self.depth_squares_px2 / self.depth_pixels))

    def share_beyond(self) -> tuple[list[float], list[float]]:
        """Return tolerances in px, ascending, and the share of judged hogels displaced by more than each."""
        above = self.displaced[::-1].cumsum()[::-1]
        return list(displacement_ends()[:-1]), (above / max(self.judged, 1)).tolist()

    def _rank(self, rows: pa.Table, columns: Indices, lines: Indices, beyond: Mask) -> None:
        p99, surface = _numbers(rows, P99), _numbers(rows, SURFACE)
        if FRACTION in rows.column_names:
            surface = np.where(np.isfinite(surface), surface, _numbers(rows, FRACTION))
        found = [
            WorstHogel(
                beyond=bool(is_beyond),
                badness=px if math.isfinite(px) else math.inf if is_beyond else 0.0,
                surface_fraction=share if math.isfinite(share) else None,
                aperture=(column, row),
                displacement_p99_px=px if math.isfinite(px) else None,
            )
            for column, row, is_beyond, px, share in zip(
                columns.tolist(), lines.tolist(), beyond.tolist(), p99.tolist(), surface.tolist(), strict=True
            )
        ]
        # Of equals the first on the plate is named, in whatever order parts are read.
        self.worst = sorted(
            (*self.worst, *found),
            key=lambda one: (
                not one.beyond,
                -one.badness,
                -(one.surface_fraction or 0.0),
                one.aperture[::-1],
            ),
        )[:WORST_HOGELS]

    def _map(self, name: str, place: tuple[Indices, ...], values: Floats) -> None:
        if name not in self.maps:
            self.maps[name] = np.full(self._cells[::-1], np.nan)
        np.fmax.at(self.maps[name], place, values)


def add_rows(found: Sequence[Tally], tables: Iterable[pa.Table]) -> None:
    """Count the rows of some parts, those of each setting in its tally."""
    for table in tables:
        numbers = _numbers(table, "setting")
        for setting, tally in enumerate(found):
            tally.add(table.filter(pa.array(numbers == setting)))


def displacement_ends() -> Floats:
    """Return the ends of the bins of displacement, px."""
    low, high = math.log10(LOWEST_PX), math.log10(HIGHEST_PX)
    return np.logspace(low, high, round((high - low) * BINS_PER_DECADE) + 1)


def _is_mapped(name: str) -> bool:
    cause = name.startswith("cause_") and name.endswith("_surface") and "predicted" not in name
    return cause or name in MAP_COLUMNS


def _numbers(rows: pa.Table, name: str) -> Floats:
    """Return a column as doubles, NaN where it is null, or where there is no such column."""
    if name not in rows.column_names:
        return np.full(len(rows), np.nan)
    column = rows.column(name).cast(pa.float64())
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)
