"""What a survey judges, block by block; a row for each hogel and setting; and all rows in bounded memory.

Rows are read part by part. Of maps and distributions as much is kept of a large plate as of a small
one: a map has at most `MAX_MAP_CELLS` cells along a side, in which the worst hogel counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from xfrustum.compare.attribution.budget import CauseNumbers
from xfrustum.compare.beyond import displacement_p99, is_beyond
from xfrustum.compare.judging.judged import HogelNumbers
from xfrustum.compare.judging.verdict import Hogel, Limits
from xfrustum.compare.metrics.comparison import Comparison, ComparisonNumbers
from xfrustum.compare.metrics.error_maps import lengths
from xfrustum.compare.run import Evaluator, JudgedDrawing, JudgedFrame
from xfrustum.compare.sampling import aperture_at
from xfrustum.reference import Reference
from xfrustum.reports.blocks import Job, device_index
from xfrustum.reports.common.records import named_columns, table_of
from xfrustum.reports.common.templates_environment import address
from xfrustum.reports.error_report.images import SURFACE_COLOR, displacement_map, mask, picture
from xfrustum.reports.inspection import DRAWN, InspectedHogel, inspected_frame
from xfrustum.reports.parts import ParquetParts
from xfrustum.reports.scout import plate_cells
from xfrustum.reports.verification.sources import ForeignRenderer, named_as_given
from xfrustum.reports.verification.verification import Run
from xfrustum.scenes import Aperture, DoubleFrustum, Frustum, HogelImage, Scene
from xfrustum.scenes.arrays import Floats

DEPTH_ENDS = (0.0, *(10 ** (-place / 2) for place in range(8, 0, -1)), 1.0)
"""Ends of the bins of |z|, as fractions of the reach: half decades, for displacement goes as n/|z|, so that
from bin to bin it changes by a factor of about three; the first bin goes down to the plate."""

WORST_HOGELS = 6  # number of the worst hogels of each setting that are named, and shown on the page
P99, SURFACE, FRACTION = "displacement_px_p99", "surface_fraction", "fraction"
"""Columns that decide which hogels are worst; images that name no surfaces have the last one alone."""

MIN_SHOWN_PX, SHOWN_QUANTILES = 1e-6, 500
"""Smallest displacement of the distribution, far below what 32-bit positions can show; and largest number of
its points."""

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
class DepthBins:
    """Displacement by depth of content: for each bin of |z|, over all pixels that show a surface there."""

    pixels: tuple[int, ...]
    squares_px2: tuple[float, ...]  # sums of squared displacements
    max_px: tuple[float, ...]

    @classmethod
    def from_image(cls, drawn: HogelImage, displacement: Floats) -> DepthBins:
        """Sort the pixels of a drawing, displaced (H, W, 2) in pixels, by the height of what they show."""
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
    """The device that drew a hogel: the name of its OpenGL renderer, and its index among EGL's devices."""

    renderer: str
    index: int


@dataclass(frozen=True, kw_only=True)
class DrawnRow:
    """One hogel that our rasterizer drew with one setting: what `report` measures, and error by depth.

    `beyond` (`compare.beyond`) counts wrong surfaces too: displacement alone does not see depth
    fighting or a lost object, for all that is shown may be where it belongs.
    """

    column: int
    row: int
    setting: int
    beyond: bool
    settings: DoubleFrustum = field(metadata=named_columns("{}"))
    comparison: ComparisonNumbers = field(metadata=named_columns("{}"))
    causes: Mapping[str, CauseNumbers] = field(metadata=named_columns("cause_{}"))
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
    ) -> DrawnRow:
        """Return the row of a drawing that was judged with images and causes."""
        comparison, drawn = drawing.comparison, drawing.image
        assert isinstance(comparison, Comparison) and drawn is not None
        assert drawing.causes is not None and drawing.unexplained is not None
        assert comparison.surface is not None, "a judge has the scene at hand"
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
class RoundingCauses:
    """Number of wrong pixels by the kind of rounding that can have made them wrong."""

    edge: int
    order: int
    lost: int
    unexplained: int


@dataclass(frozen=True, kw_only=True)
class ForeignNumbers(HogelNumbers):
    """The numbers of one image, as `verify` finds them, with columns for its causes in any case."""

    causes: RoundingCauses | None  # type: ignore[assignment]

    @classmethod
    def from_numbers(cls, one: HogelNumbers | None) -> ForeignNumbers | None:
        """Return the numbers with the causes as columns."""
        causes = None if one is None or one.causes is None else RoundingCauses(**one.causes)
        return None if one is None else cls(**{**vars(one), "causes": causes})


@dataclass(frozen=True, kw_only=True)
class ForeignRow:
    """One hogel of another renderer, judged as `verify` does, as found and corrected for the diagnosis."""

    column: int
    row: int
    setting: int = 0
    beyond: bool  # it is missing, for the reason `problem`, or exceeds a limit
    verdict: str
    problem: str | None
    as_found: ForeignNumbers | None = field(metadata=named_columns("{}"))
    corrected: ForeignNumbers | None

    @classmethod
    def from_hogel(cls, hogel: Hogel) -> ForeignRow:
        """Return the row of a hogel that was verified."""
        return cls(
            column=hogel.aperture.column,
            row=hogel.aperture.row,
            beyond=not hogel.passed,
            verdict=hogel.verdict,
            problem=hogel.problem,
            as_found=ForeignNumbers.from_numbers(hogel.as_found),
            corrected=ForeignNumbers.from_numbers(hogel.corrected),
        )


@dataclass(frozen=True, kw_only=True)
class WorstHogel:
    """A hogel by how bad it is: whether it is beyond, then by displacement, then by its wrong surfaces."""

    beyond: bool
    badness: (
        float  # p99 of displacement: infinite where it is unknown of a hogel beyond, 0 of others
    )
    surface_fraction: (
        float | None
    )  # wrong pixels of images that name no surfaces; None for a missing hogel
    aperture: tuple[int, int]
    displacement_p99_px: float | None


class SettingStats:
    """Counts, maps and the worst hogels of the rows of one setting, for a plate of so many hogels."""

    def __init__(self, hogels: tuple[int, int]) -> None:
        self._hogels = hogels
        self.judged = self.beyond = self.empty = 0
        self.looked = np.zeros((1, 1), dtype=bool)  #: cells of maps in which a hogel was judged
        self.worst: list[WorstHogel] = []  #: the worst first
        #: By column: (rows, columns) of cells, the largest value in each; NaN where there is none
        self.maps: dict[str, Floats] = {}
        self._moved_px: list[Floats] = []
        #: Sums and maxima of `DepthBins` over all hogels
        self.depth_pixels, self.depth_squares_px2, self.depth_max_px = np.zeros(
            (3, len(DEPTH_ENDS) - 1)
        )

    def add(self, rows: pa.Table) -> None:
        """Count some rows, of this setting alone."""
        columns, lines = (_numbers(rows, name).astype(np.int64) for name in ("column", "row"))
        beyond, moved, surface = (_numbers(rows, name) for name in ("beyond", P99, SURFACE))
        self.judged += len(columns)
        self.beyond += int((beyond > 0).sum())
        # Of our drawings the truth's surfaces are counted, of images their own too.
        shown = np.fmin(_numbers(rows, "covered"), _numbers(rows, "shown"))
        self.empty += int(((shown == 0) & (beyond == 0)).sum())
        surface = np.where(np.isfinite(surface), surface, _numbers(rows, FRACTION))
        found = [
            WorstHogel(
                beyond=is_beyond > 0,
                badness=px if math.isfinite(px) else math.inf if is_beyond > 0 else 0.0,
                surface_fraction=share if math.isfinite(share) else None,
                aperture=(column, row),
                displacement_p99_px=px if math.isfinite(px) else None,
            )
            for column, row, is_beyond, px, share in zip(
                *(one.tolist() for one in (columns, lines, beyond, moved, surface)), strict=True
            )
        ]
        # Of equals the first on the plate is named, in whatever order parts are read.
        self.worst = sorted(
            (*self.worst, *found),
            key=lambda h: (
                not h.beyond,
                -h.badness,
                -(h.surface_fraction or 0.0),
                h.aperture[::-1],
            ),
        )[:WORST_HOGELS]
        places = np.stack((columns, lines), axis=-1)
        self.looked = self.looked | plate_cells(self._hogels, places, beyond)[1]
        for name in rows.column_names:
            cause = (
                name.startswith("cause_") and name.endswith("_surface") and "predicted" not in name
            )
            if cause or name in MAP_COLUMNS:
                cells, _ = plate_cells(self._hogels, places, _numbers(rows, name))
                self.maps[name] = np.fmax(self.maps.get(name, np.nan), cells)
        self._moved_px.append(np.maximum(moved[np.isfinite(moved)], MIN_SHOWN_PX))
        if "depth_pixels" in rows.column_names:
            names = ("pixels", "squares_px2", "max_px")
            bins = (np.array(rows.column(f"depth_{name}").to_pylist()) for name in names)
            pixels, squares, largest = bins
            self.depth_pixels += pixels.sum(axis=0)
            self.depth_squares_px2 += squares.sum(axis=0)
            self.depth_max_px = np.maximum(self.depth_max_px, largest.max(axis=0))

    def share_beyond(self) -> tuple[Floats, Floats]:
        """Return displacements in px, ascending, and the share of hogels displaced by more than each."""
        moved = np.sort(np.concatenate([np.zeros(0), *self._moved_px]))
        places = np.linspace(0, len(moved) - 1, min(len(moved), SHOWN_QUANTILES)).astype(int)
        return moved[places], (len(moved) - 1 - places) / max(self.judged, 1)


def add_rows(found: Sequence[SettingStats], tables: Iterable[pa.Table]) -> None:
    """Count the rows of some parts, those of each setting in its tally."""
    for table in tables:
        numbers = _numbers(table, "setting")
        for setting, tally in enumerate(found):
            tally.add(table.filter(pa.array(numbers == setting)))


def _numbers(rows: pa.Table, name: str) -> Floats:
    """Return a column as doubles, NaN where it is null, or where there is no such column."""
    if name not in rows.column_names:
        return np.full(len(rows), np.nan)
    column = rows.column(name).cast(pa.float64())
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)


MAX_PICTURE_PX = 512  # longest side of a picture on the page; larger images are reduced
PIXELS_PER_BLOCK = 1 << 22
"""Pixels that are drawn and judged in a block, those that a hogel costs anyway included: 10 to 60 s of one
core, while a task costs a scheduler a few milliseconds."""

PIXELS_PER_HOGEL = 1 << 16
"""Pixels that take as long as what a hogel costs however small it is: on the car, whose triangles are all
transformed for each drawing and each link of its error budget, about as many as 256 x 256."""

MIN_BLOCKS = 16
"""Number of blocks that even a small sample is cut into where it has as many hogels, for several workers."""


def hogels_per_block(hogels: int, frustum: Frustum, settings: int) -> int:
    """Return how many of some hogels a block has; it depends on the work, never on the number of workers."""
    cost = (math.prod(frustum.resolution) + PIXELS_PER_HOGEL) * settings
    return max(1, min(PIXELS_PER_BLOCK // cost, math.ceil(hogels / MIN_BLOCKS)))


@dataclass(frozen=True, kw_only=True)
class HogelBlock:
    """Some hogels by their places on the path of `aperture_at`, and the number of their part."""

    number: int
    places: Sequence[int]


@dataclass(frozen=True, kw_only=True)
class ShownHogel:
    """Pictures of one hogel, data URLs by what they show, and all its channels; none where it is missing."""

    pictures: dict[str, str]
    inspected: InspectedHogel | None


@dataclass(frozen=True)
class Session:
    """What judges the hogels of a survey in one process."""

    make: Callable[[HogelBlock], None]  # writes the rows of a block
    shown: Callable[
        [tuple[int, int], int], ShownHogel
    ]  # of a column and row, and the number of a setting


@dataclass(frozen=True, kw_only=True, eq=False)
class SurveyJob(Job):
    """Hogels of a scene that are judged in blocks, each of which becomes a part of rows."""

    scene: Scene
    parts: ParquetParts
    tolerance_px: float

    def finished(self, block: HogelBlock) -> bool:
        """Return whether a block has its part."""
        return self.parts.finished(block.number)

    def size(self, block: HogelBlock) -> int:
        """Return the number of hogels of a block."""
        return len(block.places)

    def words(self, block: HogelBlock) -> str:
        """Return the number of a block, and its first aperture."""
        return "block {} (from aperture {},{})".format(
            block.number, *self.apertures(block)[0].index
        )

    def apertures(self, block: HogelBlock) -> list[Aperture]:
        """Return the hogels of a block, in their order."""
        return [aperture_at(self.scene.plate, place) for place in block.places]


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnJob(SurveyJob):
    """A survey of what our rasterizer draws with some settings; the tracer gives truths a second opinion."""

    name = "survey"
    settings: tuple[DoubleFrustum, ...]
    tracer: str

    @contextmanager
    def open(self) -> Iterator[Session]:
        """Open the renderers of the scene."""

        def make(block: HogelBlock) -> None:
            hogels = judge.stream(self.apertures(block), self.settings, images=True, causes=True)
            rows = [
                DrawnRow.from_drawing(hogel.aperture, setting, drawing, self.tolerance_px, device)
                for hogel in hogels
                for setting, drawing in enumerate(hogel.drawings)
            ]
            self.parts.write(block.number, table_of(DrawnRow, rows))

        def shown(index: tuple[int, int], setting: int) -> ShownHogel:
            apertures, settings = [self.scene.plate.aperture(*index)], [self.settings[setting]]
            with closing(judge.frames(apertures, settings, DRAWN)) as frames:
                return self._shown(next(frames))

        with Evaluator(self.scene, self.tracer) as judge:
            device = Device(judge.device["renderer"], device_index())
            yield Session(make, shown)

    def _shown(self, frame: JudgedFrame) -> ShownHogel:
        """Return truth, drawing and errors of one hogel, as pictures and as channels."""
        wrong = frame.comparison.maps.surface
        reduction = -(-max(self.scene.frustum.resolution) // MAX_PICTURE_PX)
        assert wrong is not None, "a judge has the scene at hand"
        pictures = {
            "truth": picture(frame.truth, reduction),
            "drawing": picture(frame.image, reduction),
            "displacement": displacement_map(frame.comparison.errors.moved, reduction),
            "wrong surfaces": mask(wrong, SURFACE_COLOR, reduction),
        }
        urls = {name: address(encoded) for name, encoded in pictures.items()}
        return ShownHogel(pictures=urls, inspected=inspected_frame(self.scene, frame))


@dataclass(frozen=True, kw_only=True, eq=False)
class ForeignJob(SurveyJob):
    """A survey of another renderer's files; `state` is their digest, by which others are refused."""

    name = "survey-images"
    draws = False
    renderer: ForeignRenderer
    state: str

    @contextmanager
    def open(self) -> Iterator[Session]:
        """Diagnose the renderer: every process for itself, with the same outcome."""
        renderer, asked = self.renderer, self.scene.plate.apertures()
        renderer.require_state(asked, self.state)
        reference, limits = Reference(self.scene), Limits(displacement_px=self.tolerance_px)

        def make(block: HogelBlock) -> None:
            judged = run.hogels(question, self.apertures(block))
            rows = [
                ForeignRow.from_hogel(named_as_given(hogel, renderer.named_from))
                for hogel, _ in judged
            ]
            self.parts.write(block.number, table_of(ForeignRow, rows))

        def shown(index: tuple[int, int], setting: int) -> ShownHogel:
            found = run.pictured(question, self.scene.plate.aperture(*index), channels=True)
            pictures, inspected = (found.pictures, found.inspected) if found else ({}, None)
            return ShownHogel(pictures=pictures, inspected=inspected)

        with renderer.opened(reference) as source:
            run = Run(
                renderer=renderer,
                reference=reference,
                source=source,
                apertures=asked,
                limits=limits,
            )
            question = run.question()
            run.kept.clear()  # few hogels of the sample are this process's own: all are read anew
            yield Session(make, shown)


def shown_hogel(session: Session, index: tuple[int, int], setting: int) -> ShownHogel:
    """Return what a page shows of one hogel; a question to the workers."""
    return session.shown(index, setting)
