"""Table 1 of the paper, measured here: how many images a second of two databases, both cameras together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reports.benchmarks.plate_contestants import COLOR_ONLY, exhaust
from xfrustum.reports.common import provenance
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.summaries import Summarized
from xfrustum.reports.common.timing import Timing, race
from xfrustum.scenes.library import builtin
from xfrustum.scenes.library.car_tessellated import mirrored, tessellated_car
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture, Plate

RESOLUTION = 512
"""W = H; the paper does not say what it drew."""
REPEAT = 5
COLUMNS = 12
"""Neighboring apertures about the middle of the plate: what a plate is drawn in."""
RELATIVE_NEAR = 1e-3
"""The step back from the plate, as a fraction of the reach."""


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
    """

    polygons: int
    reflective_share: float
    seconds: Timing
    submitted: float
    paper: Database

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
    with progress_bar(len(databases) * (repeat + 1), "table 1", "run", shown=progress) as bar:
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
    apertures = _neighbors(scene.plate)
    with PlateRenderer(scene, settings, COLOR_ONLY) as renderer:
        taken = timed({"row": lambda: exhaust(renderer.hogels(apertures))})["row"]
        row = Table1Row(
            polygons=len(scene.faces),
            reflective_share=float(car.reflective.mean()),
            seconds=taken.divided_by(len(apertures)),
            submitted=renderer.drawn_triangles(apertures) / len(apertures),
            paper=database,
        )
        return row, renderer.device["renderer"]


def _neighbors(plate: Plate) -> list[Aperture]:
    first, row = plate.middle.column - COLUMNS // 2, plate.middle.row
    return [plate.aperture(column, row) for column in range(first, first + COLUMNS)]


def table(measured: Table1) -> str:
    """Return table 1 as text, one line for each machine."""
    cores, processor = measured.machine["cores"], measured.machine["processor"]
    lines = [f"{'polygons':>9}{'reflective':>12}{'frames/s':>11}{'polygons/s':>13}{'factor':>9}  drawn by"]
    for row in measured.rows:
        start = f"{row.polygons:>9,}{100 * row.reflective_share:>11.1f}%"
        rate = row.frames_per_second
        here = f"{measured.device}, {cores} cores of {processor}, antialiasing off"
        lines.append(f"{start}{rate:>11.3g}{row.polygons * rate:>13,.0f}{'':>9}  {here}")
        for name, old in row.paper.machines.items():
            there = f"{name} (1996), antialiasing {'on' if old.antialiasing else 'off'}"
            speed = f"{old.frames_per_second:>11.3g}{old.polygons_per_second:>13,.0f}"
            lines.append(f"{start}{speed}{row.factors[name]:>9,.1f}  {there}")
    width, height = measured.resolution
    submitted = ", ".join(f"{row.submitted / row.polygons:.2f}" for row in measured.rows)
    lines += [
        "",
        f"Images of {width} x {height} by both cameras with reflections, 8-bit color read back; the paper "
        "does not say its size.",
        f"Polygons submitted for an image, reflective ones twice, over the database's: {submitted}.",
        f"Median of {measured.rows[0].seconds.repetitions} rows of {COLUMNS} hogels after a warm-up.",
    ]
    return "\n".join(lines)
