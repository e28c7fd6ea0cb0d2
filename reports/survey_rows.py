"""Work of a survey: hogels judged in blocks, rows of hogels and settings, and statistics of rows.

A map has at most `MAX_MAP_CELLS` cells along a side, and a cell shows its worst hogel.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import pyarrow as pa

from xfrustum.compare.attribution import CauseNumbers
from xfrustum.compare.comparison import ComparisonNumbers
from xfrustum.compare.run import Evaluator, JudgedDrawing
from xfrustum.compare.sampling import displacement_p99, is_beyond
from xfrustum.reference.truth import TruthBy, row_tile, tile_rows
from xfrustum.reports.blocks import HogelBlock, HogelJob, device_index
from xfrustum.reports.common.pictures import SURFACE_COLOR, displacement_map, mask, picture
from xfrustum.reports.common.records import named_columns, table_of
from xfrustum.reports.common.templates_environment import address
from xfrustum.reports.inspection import DRAWN, InspectedHogel, inspected_frame
from xfrustum.reports.plotting import plate_cells
from xfrustum.scenes import Aperture, DoubleFrustum, Frustum, Scene
from xfrustum.scenes.arrays import Floats, Mask

#: number of worst hogels per setting on the page
WORST_HOGELS = 6
#: columns that rank the worst hogels
P99, SURFACE = "displacement_px_p99", "surface_fraction"
#: columns that all statistics except maps need
COUNTED = ("column", "row", "setting", "beyond", "covered", P99, SURFACE)

#: Smallest displacement in the distribution, far below the resolution of float32 positions, and
#: largest number of points of the curve.
MIN_SHOWN_PX, SHOWN_QUANTILES = 1e-6, 500

#: captions of mapped columns; columns of causes are mapped too
MAP_COLUMNS = {
    P99: "displacement (p99), px",
    SURFACE: "share of wrong surfaces",
    "height_rms": "error of height (rms)",
    "radiance_rms": "error of radiance (rms)",
    "unexplained": "unexplained pixels",
}

#: longest side of a picture on the page
MAX_PICTURE_PX = 512

#: Number of pixels drawn and judged in a block, including the overhead of hogels: 10 to 60 s of one
#: core, long compared with the few milliseconds that a scheduler takes for a task.
PIXELS_PER_BLOCK = 1 << 22

#: Overhead of a hogel, pixels: transforming the triangles of the car for each drawing and each link
#: of the error budget takes as long as 256 x 256 pixels.
PIXELS_PER_HOGEL = 1 << 16

#: smallest number of blocks, so that several workers have work on a small sample
MIN_BLOCKS = 16

#: Number of hogels, in whole rows, of a block with truths by directions: all of them share each
#: pass over the scene, and a killed process loses at most two minutes of work.
DIRECTIONS_BLOCK = 1 << 12


@dataclass(frozen=True)
class Device:
    """Device that drew a hogel."""

    #: name of the device's OpenGL renderer
    renderer: str
    #: index among EGL's devices
    index: int


@dataclass(frozen=True, kw_only=True)
class SurveyRow:
    """Row of a hogel and a setting: the measures of `report`, and errors by cause.

    `beyond` (`compare.sampling`) also includes wrong surfaces, because displacement does not reveal
    z-fighting or a missing object: every visible point may lie in its place.
    """

    column: int
    row: int
    #: number of the setting, from 0
    setting: int
    beyond: bool
    settings: DoubleFrustum = field(metadata=named_columns("{}"))
    comparison: ComparisonNumbers = field(metadata=named_columns("{}"))
    causes: Mapping[str, CauseNumbers] = field(metadata=named_columns("cause_{}"))
    #: number of unexplained pixels
    unexplained: int
    device: Device

    @classmethod
    def from_drawing(
        cls,
        aperture: Aperture,
        setting: int,
        drawing: JudgedDrawing,
        tolerance_px: float,
        device: Device,
    ) -> SurveyRow:
        """Return the row of a drawing that was judged with causes."""
        comparison = drawing.comparison
        assert drawing.causes is not None and drawing.unexplained is not None
        assert comparison.surface is not None, "an evaluator has the scene at hand"
        return cls(
            column=aperture.column,
            row=aperture.row,
            setting=setting,
            beyond=is_beyond(
                displacement_p99(comparison), comparison.surface.fraction, tolerance_px
            ),
            settings=drawing.settings,
            comparison=comparison,
            causes={cause.name: cause.numbers for cause in drawing.causes},
            unexplained=drawing.unexplained,
            device=device,
        )


@dataclass(frozen=True, kw_only=True)
class WorstHogel:
    """Hogel ranked by its errors: beyond the limits, then displacement, then wrong surfaces."""

    #: column and row of the hogel
    aperture: tuple[int, int]
    #: 99th percentile of displacement, pixels; None if undefined
    displacement_p99_px: float | None
    surface_fraction: float
    beyond: bool

    @property
    def badness(self) -> float:
        """Displacement, pixels; if undefined, infinite for a hogel beyond the limits, else 0."""
        if self.displacement_p99_px is None:
            return math.inf if self.beyond else 0.0
        return self.displacement_p99_px

    @property
    def order(self) -> tuple[object, ...]:
        """Sort key, worst first; equal hogels by position, independent of the order of parts."""
        return not self.beyond, -self.badness, -self.surface_fraction, self.aperture[::-1]


def is_mapped(column: str) -> bool:
    """Return whether a column has a map: a measure of a hogel, or wrong surfaces by cause."""
    cause = column.startswith("cause_") and column.endswith("_surface")
    return column in MAP_COLUMNS or (cause and "predicted" not in column)


@dataclass(frozen=True, kw_only=True, eq=False)
class SettingStats:
    """Counts, maps and the worst hogels of one setting."""

    judged: int
    #: hogels beyond the tolerance
    beyond: int
    #: number of hogels within the limits that show nothing
    empty: int
    #: worst hogels, worst first
    worst: tuple[WorstHogel, ...]
    #: cells of maps with a judged hogel
    known: Mask
    #: largest value in each cell (rows, columns) by column name; NaN without a value
    maps: dict[str, Floats]
    #: defined displacements (p99) of hogels, pixels, ascending
    moved_px: Floats

    @classmethod
    def from_rows(cls, hogels: tuple[int, int], rows: pa.Table) -> Self:
        """Return the statistics of rows; `hogels` are the columns and rows of the plate."""
        places = np.stack([_numbers(rows, name) for name in ("column", "row")], -1).astype(np.int64)
        beyond, moved = _numbers(rows, "beyond") > 0, _numbers(rows, P99)
        columns = places.tolist(), moved.tolist(), _numbers(rows, SURFACE).tolist(), beyond.tolist()
        # Process rows one by one: a plate has millions of hogels, of which few are kept.
        worst = (
            WorstHogel(
                aperture=(column, row),
                displacement_p99_px=px if math.isfinite(px) else None,
                surface_fraction=share,
                beyond=bad,
            )
            for (column, row), px, share, bad in zip(*columns, strict=True)
        )
        return cls(
            judged=len(places),
            beyond=int(beyond.sum()),
            empty=int(((_numbers(rows, "covered") == 0) & ~beyond).sum()),
            worst=tuple(heapq.nsmallest(WORST_HOGELS, worst, key=lambda hogel: hogel.order)),
            known=plate_cells(hogels, places, beyond)[1],
            maps={
                name: plate_cells(hogels, places, _numbers(rows, name))[0]
                for name in filter(is_mapped, rows.column_names)
            },
            moved_px=np.sort(np.maximum(moved[np.isfinite(moved)], MIN_SHOWN_PX)),
        )

    def share_beyond(self) -> tuple[Floats, Floats]:
        """Return displacements in pixels, ascending, and the share of hogels above each."""
        moved = self.moved_px
        places = np.linspace(0, len(moved) - 1, min(len(moved), SHOWN_QUANTILES)).astype(int)
        return moved[places], (len(moved) - 1 - places) / max(self.judged, 1)


def counted_rows(rows: pa.Table) -> pa.Table:
    """Return only the columns that statistics need, because plates have millions of rows."""
    return rows.select([name for name in rows.column_names if name in COUNTED or is_mapped(name)])


def stats_of(
    hogels: tuple[int, int], settings: int, rows: Sequence[pa.Table]
) -> tuple[SettingStats, ...]:
    """Return the statistics of each setting; see `counted_rows`."""
    # A part of a job array may have no block, or finish before any other part.
    none = pa.table({name: pa.array([], pa.float64()) for name in COUNTED})
    table = pa.concat_tables(rows) if rows else none
    number = _numbers(table, "setting")
    some = (table.filter(pa.array(number == setting)) for setting in range(settings))
    return tuple(SettingStats.from_rows(hogels, rows) for rows in some)


def _numbers(rows: pa.Table, name: str) -> Floats:
    """Return a column as doubles, NaN where it is null."""
    column = rows.column(name).cast(pa.float64())
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)


def hogels_per_block(hogels: int, frustum: Frustum, settings: int) -> int:
    """Return the number of hogels of a block, independent of the number of workers."""
    cost = (math.prod(frustum.resolution) + PIXELS_PER_HOGEL) * settings
    return max(1, min(PIXELS_PER_BLOCK // cost, math.ceil(hogels / MIN_BLOCKS)))


def rows_per_block(scene: Scene) -> int:
    """Return the number of plate rows of a block with truths by directions."""
    columns, rows = scene.plate.hogels
    return min(
        tile_rows(scene.frustum, columns),
        math.ceil(rows / MIN_BLOCKS),
        math.ceil(DIRECTIONS_BLOCK / columns),
    )


@dataclass(frozen=True, kw_only=True)
class ShownHogel:
    """Pictures of one hogel as data URLs by caption, and its channels."""

    pictures: dict[str, str]
    inspected: InspectedHogel


@dataclass(frozen=True, kw_only=True, eq=False)
class SurveyJob(HogelJob):
    """Job that draws and judges hogels with some settings; each block writes a part of rows."""

    name = "survey"
    scene: Scene
    tolerance_px: float
    settings: tuple[DoubleFrustum, ...]
    tracer: str
    #: order in which truths are computed; by directions, blocks are whole rows of the plate
    truth_by: TruthBy

    @contextmanager
    def open(self) -> Iterator[SurveySession]:
        """Open the renderers of the scene."""
        with Evaluator(self.scene, self.tracer) as evaluator:
            yield SurveySession(self, evaluator)


@dataclass(frozen=True)
class SurveySession:
    """Renderers of a survey in one process."""

    job: SurveyJob
    evaluator: Evaluator

    def make(self, block: HogelBlock) -> None:
        """Judge the hogels of a block and write their rows."""
        job, device = self.job, Device(self.evaluator.device["renderer"], device_index())
        if job.truth_by is TruthBy.DIRECTIONS:
            first, last = block.apertures[0].row, block.apertures[-1].row
            self.evaluator.decide(row_tile(job.scene.plate, first, last + 1))
        hogels = self.evaluator.stream(block.apertures, job.settings, causes=True)
        rows = [
            SurveyRow.from_drawing(hogel.aperture, setting, drawing, job.tolerance_px, device)
            for hogel in hogels
            for setting, drawing in enumerate(hogel.drawings)
        ]
        job.parts.write(block.number, table_of(SurveyRow, rows))

    def shown(self, index: tuple[int, int], setting: int) -> ShownHogel:
        """Return truth, drawing and errors of one hogel, as pictures and as channels."""
        scene, settings = self.job.scene, [self.job.settings[setting]]
        with closing(
            self.evaluator.frames([scene.plate.aperture(*index)], settings, DRAWN)
        ) as frames:
            frame = next(frames)
        wrong = frame.comparison.maps.surface
        assert wrong is not None, "an evaluator has the scene at hand"
        reduction = -(-max(scene.frustum.resolution) // MAX_PICTURE_PX)
        pictures = {
            "truth": picture(frame.truth, reduction),
            "drawing": picture(frame.image, reduction),
            "displacement": displacement_map(frame.comparison.errors.moved, reduction),
            "wrong surfaces": mask(wrong, SURFACE_COLOR, reduction),
        }
        urls = {name: address(encoded) for name, encoded in pictures.items()}
        return ShownHogel(pictures=urls, inspected=inspected_frame(scene, frame))
