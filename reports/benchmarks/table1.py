"""Table 1 of the paper, measured here: how many images a second of two databases, both cameras together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

from xfrustum.raster import Rasterizer
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.raster.rasterizer import SINGLE_SAMPLE
from xfrustum.reports.benchmarks.plate_contestants import COLOR_ONLY, exhaust
from xfrustum.reports.common import provenance
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.summaries import Summarized
from xfrustum.reports.common.timing import Timing, race
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.library import builtin
from xfrustum.scenes.library.car_tessellated import mirrored, tessellated_car
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture, Plate

RESOLUTION = 512
"""W = H; the paper does not say what it drew."""
REPEAT = 5
COLUMNS = 12
"""Neighboring apertures about the middle of the plate: what a plate is drawn in."""
ANTIALIASED_COLUMNS = 4
"""Number of these apertures that are drawn one by one, with antialiasing and without: each takes longer."""
RELATIVE_NEAR = 1e-3
"""The step back from the plate, as a fraction of the reach."""

ANTIALIASED = Sampling(multisample=4)
"""Antialiasing as it is measured: the largest number of coverage samples that Mesa's software renderer has.
The paper does not say how many its hardware took."""

PLATE, PLAIN, ON = "plate", "one by one", "antialiased"
"""The contestants: many hogels a submission; one hogel after the other, without and with antialiasing."""

ANTIALIASED_MACHINE = "RealityEngine2"
"""The machine of the paper whose antialiasing was on."""

Timed = Callable[[Mapping[str, Callable[[], object]]], dict[str, Timing]]
"""Runs something repeatedly, see `race`."""


@dataclass(frozen=True, kw_only=True)
class Machine:
    """One machine's line of table 1.

    Attributes
    ----------
    frames_per_second, polygons_per_second
        Rates as the paper prints them.
    antialiasing
        Whether it was on.
    """

    frames_per_second: float
    polygons_per_second: float
    antialiasing: bool


@dataclass(frozen=True, kw_only=True)
class Database:
    """One database of table 1: its size, its share of reflection mapped polygons, and both machines."""

    polygons: int
    reflective_share: float
    machines: dict[str, Machine]


def _both(reality_engine: tuple[float, float], maximum_impact: tuple[float, float]) -> dict[str, Machine]:
    return {
        "RealityEngine2": Machine(
            frames_per_second=reality_engine[0], polygons_per_second=reality_engine[1], antialiasing=True
        ),
        "Maximum Impact": Machine(
            frames_per_second=maximum_impact[0], polygons_per_second=maximum_impact[1], antialiasing=False
        ),
    }


PAPER = (
    Database(polygons=42_382, reflective_share=0.312, machines=_both((1.98, 84_077), (3.42, 144_868))),
    Database(polygons=272_074, reflective_share=0.479, machines=_both((0.258, 70_286), (0.58, 159_710))),
)
"""Paper, table 1."""


@dataclass(frozen=True, kw_only=True)
class AntialiasedRecord:
    """JSON object of an `Antialiased`; `factor` is over `ANTIALIASED_MACHINE`, which did the same."""

    samples: int
    frames_per_second: float
    polygons_per_second: float
    seconds_per_frame: Timing
    seconds_per_frame_without: Timing
    slowdown: float
    factor: float


@dataclass(frozen=True, kw_only=True)
class Antialiased:
    """One database drawn with antialiasing, hogel by hogel, and without it in the same loop.

    Attributes
    ----------
    samples
        Coverage samples of a pixel.
    seconds, without
        Wall seconds of one image by both cameras, reflections included, its color read back, with
        antialiasing and without.
    """

    samples: int
    seconds: Timing
    without: Timing

    @property
    def frames_per_second(self) -> float:
        """Images, each by both cameras."""
        return 1 / self.seconds.median

    @property
    def slowdown(self) -> float:
        """How many times as long antialiasing takes."""
        return self.seconds.median / self.without.median


@dataclass(frozen=True, kw_only=True)
class RowRecord:
    """JSON object of a `Table1Row`; polygons a second are the database's, as in the paper."""

    polygons: int
    reflective_share: float
    frames_per_second: float
    polygons_per_second: float
    submitted_polygons_per_second: float
    seconds_per_frame: Timing
    paper: dict[str, Machine]
    factors: dict[str, float]
    antialiased: AntialiasedRecord


@dataclass(frozen=True, kw_only=True)
class Table1Row:
    """One database, measured.

    Attributes
    ----------
    polygons, reflective_share
        Size of the car as it was drawn, and its share of reflective polygons.
    seconds
        Wall seconds of one image by both cameras, reflections included, its color read back.
    submitted
        Polygons that an image submits on average: those in its frusta, the reflective ones twice.
    paper
        The line of table 1.
    antialiased
        The same with antialiasing.
    """

    polygons: int
    reflective_share: float
    seconds: Timing
    submitted: float
    paper: Database
    antialiased: Antialiased

    @property
    def frames_per_second(self) -> float:
        """Images, each by both cameras."""
        return 1 / self.seconds.median

    @property
    def factors(self) -> dict[str, float]:
        """How many times as fast as each machine of the paper."""
        return {
            name: self.frames_per_second / machine.frames_per_second
            for name, machine in self.paper.machines.items()
        }

    @property
    def antialiased_factor(self) -> float:
        """How many times as fast as the paper's machine with antialiasing, with antialiasing."""
        old = self.paper.machines[ANTIALIASED_MACHINE].frames_per_second
        return self.antialiased.frames_per_second / old

    @property
    def record(self) -> RowRecord:
        """The row, as it is written."""
        return RowRecord(
            polygons=self.polygons,
            reflective_share=self.reflective_share,
            frames_per_second=self.frames_per_second,
            polygons_per_second=self.polygons * self.frames_per_second,
            submitted_polygons_per_second=self.submitted * self.frames_per_second,
            seconds_per_frame=self.seconds,
            paper=self.paper.machines,
            factors=self.factors,
            antialiased=AntialiasedRecord(
                samples=self.antialiased.samples,
                frames_per_second=self.antialiased.frames_per_second,
                polygons_per_second=self.polygons * self.antialiased.frames_per_second,
                seconds_per_frame=self.antialiased.seconds,
                seconds_per_frame_without=self.antialiased.without,
                slowdown=self.antialiased.slowdown,
                factor=self.antialiased_factor,
            ),
        )


@dataclass(frozen=True, kw_only=True)
class Table1Record:
    """JSON object of a `Table1`."""

    rows: tuple[RowRecord, ...]
    resolution: tuple[int, int]
    antialiasing: bool
    settings: DoubleFrustum
    device: str
    machine: dict[str, str]
    versions: dict[str, str]


@dataclass(frozen=True, kw_only=True)
class Table1(Summarized[Table1Record]):
    """Both rows, and what they were measured on."""

    rows: tuple[Table1Row, ...]
    resolution: tuple[int, int]
    settings: DoubleFrustum
    device: str
    machine: dict[str, str]
    versions: dict[str, str]

    @property
    def record(self) -> Table1Record:
        """Everything measured."""
        return Table1Record(
            rows=tuple(row.record for row in self.rows),
            resolution=self.resolution,
            antialiasing=False,
            settings=self.settings,
            device=self.device,
            machine=self.machine,
            versions=self.versions,
        )


def benchmark_table1(
    resolution: int = RESOLUTION,
    repeat: int = REPEAT,
    databases: tuple[Database, ...] = PAPER,
    *,
    progress: bool = False,
) -> Table1:
    """Measure table 1 on the project's own car.

    Parameters
    ----------
    resolution
        W = H in pixels.
    repeat
        Number of times that each database is drawn after it has warmed up.
    databases
        Their sizes and shares.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        There is no usable OpenGL, or a database is smaller than the car.
    """
    settings = DoubleFrustum(near=RELATIVE_NEAR * builtin.build("car").frustum.longest_reach)
    rows, device = [], ""
    with progress_bar(3 * len(databases) * (repeat + 1), "table 1", "run", shown=progress) as bar:
        for database in databases:
            row, device = _row(database, settings, resolution, partial(race, repeat=repeat, done=bar.update))
            rows.append(row)
    return Table1(
        rows=tuple(rows),
        resolution=(resolution, resolution),
        settings=settings,
        device=device,
        machine=provenance.machine(),
        versions=provenance.versions(),
    )


def _row(database: Database, settings: DoubleFrustum, resolution: int, timed: Timed) -> tuple[Table1Row, str]:
    car = tessellated_car(database.polygons, database.reflective_share)
    frustum = replace(car.scene.frustum, resolution=(resolution, resolution))
    scene = replace(mirrored(car), frustum=frustum)
    apertures = _neighbors(scene.plate, COLUMNS)
    middle = _neighbors(scene.plate, ANTIALIASED_COLUMNS)
    with PlateRenderer(scene, settings, COLOR_ONLY) as renderer, Rasterizer(scene) as rasterizer:

        def one_by_one(sampling: Sampling) -> None:
            for aperture in middle:
                rasterizer.render_color(aperture, settings, sampling)

        runs = {
            PLATE: lambda: exhaust(renderer.hogels(apertures)),
            PLAIN: lambda: one_by_one(SINGLE_SAMPLE),
            ON: lambda: one_by_one(ANTIALIASED),
        }
        drawn = {PLATE: len(apertures), PLAIN: len(middle), ON: len(middle)}
        taken = {name: whole.divided_by(drawn[name]) for name, whole in timed(runs).items()}
        row = Table1Row(
            polygons=len(scene.faces),
            reflective_share=float(car.reflective.mean()),
            seconds=taken[PLATE],
            submitted=renderer.drawn_triangles(apertures) / len(apertures),
            paper=database,
            antialiased=Antialiased(samples=ANTIALIASED.multisample, seconds=taken[ON], without=taken[PLAIN]),
        )
        return row, renderer.device["renderer"]


def _neighbors(plate: Plate, count: int) -> list[Aperture]:
    """Return so many neighbors in the middle of the plate's middle row."""
    first, row = plate.middle.column - count // 2, plate.middle.row
    return [plate.aperture(column, row) for column in range(first, first + count)]


def table(measured: Table1) -> str:
    """Return table 1 as text, one line for each machine."""
    cores, processor = measured.machine["cores"], measured.machine["processor"]
    lines = [f"{'polygons':>9}{'reflective':>12}{'frames/s':>11}{'polygons/s':>13}{'factor':>9}  drawn by"]
    for row in measured.rows:
        start = f"{row.polygons:>9,}{100 * row.reflective_share:>11.1f}%"
        rate = row.frames_per_second
        here = f"{measured.device}, {cores} cores of {processor}, antialiasing off"
        lines.append(f"{start}{rate:>11.3g}{row.polygons * rate:>13,.0f}{'':>9}  {here}")
        on = row.antialiased.frames_per_second
        there_too = f"the same, hogel by hogel, antialiasing on ({row.antialiased.samples} samples)"
        lines.append(f"{start}{on:>11.3g}{row.polygons * on:>13,.0f}{'':>9}  {there_too}")
        for name, old in row.paper.machines.items():
            there = f"{name} (1996), antialiasing {'on' if old.antialiasing else 'off'}"
            speed = f"{old.frames_per_second:>11.3g}{old.polygons_per_second:>13,.0f}"
            lines.append(f"{start}{speed}{row.factors[name]:>9,.1f}  {there}")
    width, height = measured.resolution
    factors = " and ".join(f"{row.antialiased_factor:.1f}" for row in measured.rows)
    slower = " and ".join(f"{row.antialiased.slowdown:.2f}" for row in measured.rows)
    submitted = ", ".join(f"{row.submitted / row.polygons:.2f}" for row in measured.rows)
    lines += [
        "",
        f"Images of {width} x {height} by both cameras with reflections, 8-bit color read back; the paper "
        "does not say its size.",
        f"Polygons submitted for an image, reflective ones twice, over the database's: {submitted}.",
        f"With antialiasing one hogel is drawn after the other and read back in 32 bits: {slower} times as "
        "long as without in the same loop,",
        f"and {factors} times as fast as the {ANTIALIASED_MACHINE}, whose antialiasing was on.",
        f"Median of {measured.rows[0].seconds.repetitions} rows of {COLUMNS} hogels after a warm-up; "
        f"{ANTIALIASED_COLUMNS} where they are drawn one after the other.",
    ]
    return "\n".join(lines)
