"""Work of a survey: hogels judged in blocks, a row for each hogel and setting, and its statistics.

Statistics are accumulated part by part in bounded memory: a map has at most `MAX_MAP_CELLS` cells
along a side, and a cell shows its worst hogel.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from xfrustum.compare.attribution.budget import CauseNumbers
from xfrustum.compare.beyond import displacement_p99, is_beyond
from xfrustum.compare.metrics.comparison import Comparison, ComparisonNumbers
from xfrustum.compare.metrics.error_maps import lengths
from xfrustum.compare.run import Evaluator, JudgedDrawing
from xfrustum.compare.sampling import aperture_at
from xfrustum.reports.blocks import Job, device_index
from xfrustum.reports.common.pictures import SURFACE_COLOR, displacement_map, mask, picture
from xfrustum.reports.common.records import named_columns, table_of
from xfrustum.reports.common.templates_environment import address
from xfrustum.reports.heat_map import plate_cells
from xfrustum.reports.inspection import DRAWN, InspectedHogel, inspected_frame
from xfrustum.reports.parts import ParquetParts
from xfrustum.scenes import Aperture, DoubleFrustum, Frustum, HogelImage, Scene
from xfrustum.scenes.arrays import Floats

#: Ends of the bins of |z| as fractions of the reach: half decades, for displacement goes as n/|z|
#: and so changes by a factor of about three from bin to bin; the first bin begins at the plate.
DEPTH_ENDS = (0.0, *(10 ** (-place / 2) for place in range(8, 0, -1)), 1.0)

#: number of the worst hogels of each setting that are named and shown
WORST_HOGELS = 6
#: columns that rank the worst hogels
P99, SURFACE = "displacement_px_p99", "surface_fraction"

#: Smallest displacement in the distribution, far below the resolution of 32-bit positions; and
#: largest number of its points.
MIN_SHOWN_PX, SHOWN_QUANTILES = 1e-6, 500

#: Columns that are mapped where they have values, and their captions; columns of causes follow.
MAP_COLUMNS = {
    P99: "displacement (p99), px",
    SURFACE: "share of wrong surfaces",
    "height_rms": "error of height (rms)",
    "radiance_rms": "error of radiance (rms)",
    "unexplained": "unexplained pixels",
}

#: longest side of a picture on the page
MAX_PICTURE_PX = 512

#: Pixels that are drawn and judged in a block, with the overhead of each hogel: 10 to 60 s of one
#: core, while a task costs a scheduler a few milliseconds.
PIXELS_PER_BLOCK = 1 << 22

#: Overhead of a hogel in pixels: the triangles of the car, transformed for each drawing and each
#: link of the error budget, take as long as 256 x 256 pixels.
PIXELS_PER_HOGEL = 1 << 16

#: number of blocks even of a small sample, so that several workers have work
MIN_BLOCKS = 16


@dataclass(frozen=True, kw_only=True)
class DepthBins:
    """Displacement by depth of content: values for each bin of |z|."""

    pixels: tuple[int, ...]
    #: sums of squared displacements
    squares_px2: tuple[float, ...]
    max_px: tuple[float, ...]

    @classmethod
    def from_image(cls, drawn: HogelImage, displacement: Floats) -> DepthBins:
        """Bin the displacements (H, W, 2), pixels, of a drawing by the height of its surfaces."""
        moved = lengths(displacement)
        shown = np.isfinite(moved)
        moved, depth = moved[shown], np.abs(drawn.height[shown].astype(np.float64))
        ends, bins = np.array(DEPTH_ENDS[1:-1]) * max(drawn.camera.reach), len(DEPTH_ENDS) - 1
        place = np.searchsorted(ends, depth, side="right")
        largest = np.zeros(bins)
        np.maximum.at(largest, place, moved)
        return cls(
            pixels=tuple(np.bincount(place, minlength=bins).tolist()),
            squares_px2=tuple(np.bincount(place, weights=moved**2, minlength=bins).tolist()),
            max_px=tuple(largest.tolist()),
        )


@dataclass(frozen=True)
class Device:
    """Device that drew a hogel."""

    #: name of its OpenGL renderer
    renderer: str
    #: index among EGL's devices
    index: int


@dataclass(frozen=True, kw_only=True)
class SurveyRow:
    """One hogel drawn with one setting: the measures of `report`, and the error by depth.

    `beyond` (`compare.beyond`) counts wrong surfaces too: displacement does not show depth
    fighting or a lost object, for every visible point may be where it belongs.
    """

    column: int
    row: int
    #: number of the setting, from 0
    setting: int
    beyond: bool
    settings: DoubleFrustum = field(metadata=named_columns("{}"))
    comparison: ComparisonNumbers = field(metadata=named_columns("{}"))
    causes: Mapping[str, CauseNumbers] = field(metadata=named_columns("cause_{}"))
    #: pixels
    unexplained: int
    depth: DepthBins
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
        """Return the row of a drawing that was judged with images and causes."""
        comparison, drawn = drawing.comparison, drawing.image
        assert isinstance(comparison, Comparison) and drawn is not None
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
            comparison=comparison.numbers,
            causes={cause.name: cause.numbers for cause in drawing.causes},
            unexplained=drawing.unexplained,
            depth=DepthBins.from_image(drawn, comparison.maps.displacement),
            device=device,
        )


@dataclass(frozen=True, kw_only=True)
class WorstHogel:
    """Hogel by its badness: beyond the limits, then displacement, then wrong surfaces."""

    #: column and row
    aperture: tuple[int, int]
    #: None where it is undefined
    displacement_p99_px: float | None
    surface_fraction: float
    beyond: bool

    @property
    def badness(self) -> float:
        """Displacement, pixels: infinite where it is undefined beyond the limits, else 0."""
        if self.displacement_p99_px is None:
            return math.inf if self.beyond else 0.0
        return self.displacement_p99_px

    @property
    def order(self) -> tuple[object, ...]:
        """Sort key, the worst first; equal hogels by their place, however parts are read."""
        return not self.beyond, -self.badness, -self.surface_fraction, self.aperture[::-1]


class SettingStats:
    """Counts, maps and the worst hogels of the rows of one setting."""

    def __init__(self, hogels: tuple[int, int]) -> None:
        # Columns and rows of the plate.
        self._hogels = hogels
        self.judged = self.beyond = 0
        #: hogels within the limits that show nothing
        self.empty = 0
        #: cells of maps with a judged hogel
        self.known = np.zeros((1, 1), dtype=bool)
        #: the worst first
        self.worst: list[WorstHogel] = []
        #: By column: the largest value in each cell (rows, columns); NaN where there is none.
        self.maps: dict[str, Floats] = {}
        self._moved_px: list[Floats] = []
        #: Sums and maxima of `DepthBins` over all hogels.
        self.depth_pixels, self.depth_squares_px2, self.depth_max_px = np.zeros(
            (3, len(DEPTH_ENDS) - 1)
        )

    def add(self, rows: pa.Table) -> None:
        """Count some rows of this setting."""
        places = np.stack([_numbers(rows, name) for name in ("column", "row")], -1).astype(np.int64)
        beyond, moved = _numbers(rows, "beyond") > 0, _numbers(rows, P99)
        self.judged += len(places)
        self.beyond += int(beyond.sum())
        self.empty += int(((_numbers(rows, "covered") == 0) & ~beyond).sum())
        columns = places.tolist(), moved.tolist(), _numbers(rows, SURFACE).tolist(), beyond.tolist()
        self.worst += [
            WorstHogel(
                aperture=(column, row),
                displacement_p99_px=px if math.isfinite(px) else None,
                surface_fraction=share,
                beyond=bad,
            )
            for (column, row), px, share, bad in zip(*columns, strict=True)
        ]
        self.worst = sorted(self.worst, key=lambda hogel: hogel.order)[:WORST_HOGELS]
        self.known = self.known | plate_cells(self._hogels, places, beyond)[1]
        for name in rows.column_names:
            cause = name.startswith("cause_") and name.endswith("_surface")
            if name in MAP_COLUMNS or (cause and "predicted" not in name):
                cells, _ = plate_cells(self._hogels, places, _numbers(rows, name))
                self.maps[name] = np.fmax(self.maps.get(name, np.nan), cells)
        self._moved_px.append(np.maximum(moved[np.isfinite(moved)], MIN_SHOWN_PX))
        pixels, squares, largest = (
            np.array(rows[f"depth_{name}"].to_pylist()).reshape(-1, len(DEPTH_ENDS) - 1)
            for name in ("pixels", "squares_px2", "max_px")
        )
        self.depth_pixels += pixels.sum(axis=0)
        self.depth_squares_px2 += squares.sum(axis=0)
        self.depth_max_px = np.maximum(self.depth_max_px, largest.max(axis=0, initial=0.0))

    def share_beyond(self) -> tuple[Floats, Floats]:
        """Return displacements in pixels, ascending, and the share of hogels above each."""
        moved = np.sort(np.concatenate([np.zeros(0), *self._moved_px]))
        places = np.linspace(0, len(moved) - 1, min(len(moved), SHOWN_QUANTILES)).astype(int)
        return moved[places], (len(moved) - 1 - places) / max(self.judged, 1)


def add_rows(stats: Sequence[SettingStats], tables: Iterable[pa.Table]) -> None:
    """Count the rows of some parts by their settings."""
    for table in tables:
        numbers = _numbers(table, "setting")
        for setting, counts in enumerate(stats):
            counts.add(table.filter(pa.array(numbers == setting)))


def _numbers(rows: pa.Table, name: str) -> Floats:
    """Return a column as doubles, NaN where it is null."""
    column = rows.column(name).cast(pa.float64())
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)


def hogels_per_block(hogels: int, frustum: Frustum, settings: int) -> int:
    """Return the size of a block of some hogels; it never depends on the number of workers."""
    cost = (math.prod(frustum.resolution) + PIXELS_PER_HOGEL) * settings
    return max(1, min(PIXELS_PER_BLOCK // cost, math.ceil(hogels / MIN_BLOCKS)))


@dataclass(frozen=True, kw_only=True)
class HogelBlock:
    """Hogels by their places on the path of `aperture_at`."""

    #: of the part
    number: int
    places: Sequence[int]


def blocks_of(places: Sequence[int], size: int, first: int) -> list[HogelBlock]:
    """Divide places into blocks, numbered from `first`; the last may be smaller."""
    begins = range(0, len(places), size)
    return [
        HogelBlock(number=number, places=places[begin : begin + size])
        for number, begin in enumerate(begins, first)
    ]


@dataclass(frozen=True, kw_only=True)
class ShownHogel:
    """Pictures of one hogel as data URLs by caption, and all its channels."""

    pictures: dict[str, str]
    inspected: InspectedHogel


@dataclass(frozen=True, kw_only=True, eq=False)
class SurveyJob(Job):
    """Hogels of a scene, drawn with some settings and judged in blocks, each a part of rows."""

    name = "survey"
    scene: Scene
    parts: ParquetParts
    tolerance_px: float
    settings: tuple[DoubleFrustum, ...]
    tracer: str

    def finished(self, block: HogelBlock) -> bool:
        """Return whether a block has its part."""
        return self.parts.finished(block.number)

    def size(self, block: HogelBlock) -> int:
        """Return the number of hogels of a block."""
        return len(block.places)

    def words(self, block: HogelBlock) -> str:
        """Return the number of a block and its first aperture."""
        column, row = aperture_at(self.scene.plate, block.places[0]).index
        return f"block {block.number} (from aperture {column},{row})"

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
        apertures = [aperture_at(job.scene.plate, place) for place in block.places]
        hogels = self.evaluator.stream(apertures, job.settings, images=True, causes=True)
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
