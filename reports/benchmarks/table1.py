"""Table 1 of the paper, measured here: how many images a second of two databases, both cameras together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from tqdm import tqdm

from xfrustum.raster import Rasterizer
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.raster.rasterizer import SINGLE_SAMPLE
from xfrustum.reports.benchmarks.common import Record, exhaust, machine_record, positive, settings_of
from xfrustum.reports.benchmarks.plate import COLOR_ONLY
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.timing import race
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.library import builtin
from xfrustum.scenes.library.studio import mirrored, tessellated_car
from xfrustum.scenes.plate.plate import Aperture

RESOLUTION = 512
"""W = H; the paper does not say what it drew."""
REPEAT = 5
COLUMNS = 12
"""Neighboring apertures about the middle of the plate: what a plate is drawn in."""
ANTIALIASED_COLUMNS = 4
"""Number of these apertures that are drawn one by one, with antialiasing and without: each takes longer."""

ANTIALIASED = Sampling(multisample=4)
"""Antialiasing as it is measured: the largest number of coverage samples that Mesa's software renderer has.
The paper does not say how many its hardware took."""

PLATE, PLAIN, ON = "plate", "one by one", "antialiased"
"""The contestants: many hogels a submission; one hogel after the other, without and with antialiasing."""

REALITY_ENGINE, MAXIMUM_IMPACT = "RealityEngine2", "Maximum Impact"
"""The machines of the paper; antialiasing was on in the first."""


@dataclass(frozen=True, kw_only=True)
class Machine:
    """One machine's line of table 1: rates as the paper prints them, and whether antialiasing was on."""

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
    rates = {REALITY_ENGINE: reality_engine, MAXIMUM_IMPACT: maximum_impact}
    return {
        name: Machine(
            frames_per_second=frames, polygons_per_second=polygons, antialiasing=name == REALITY_ENGINE
        )
        for name, (frames, polygons) in rates.items()
    }


PAPER = (
    Database(polygons=42_382, reflective_share=0.312, machines=_both((1.98, 84_077), (3.42, 144_868))),
    Database(polygons=272_074, reflective_share=0.479, machines=_both((0.258, 70_286), (0.58, 159_710))),
)
"""Paper, table 1."""


def benchmark_table1(
    resolution: int = RESOLUTION,
    repeat: int = REPEAT,
    databases: Sequence[Database] = PAPER,
    *,
    progress: bool = False,
) -> Record:
    """Measure table 1 on the project's own car, W = H pixels, `repeat` times after a warm-up.

    Raises InputError where there is no usable OpenGL, or a database is smaller than the car.
    """
    with progress_bar(3 * len(databases) * (repeat + 1), "table 1", "run", shown=progress) as bar:
        rows, devices = zip(*(_row(one, positive(resolution), repeat, bar) for one in databases), strict=True)
    return {
        "rows": rows,
        "resolution": (resolution, resolution),
        "antialiasing": False,
        "settings": settings_of(builtin.build("car")),
        "device": devices[0],
        **machine_record(),
    }


def _row(database: Database, resolution: int, repeat: int, bar: tqdm[Any]) -> tuple[Record, str]:
    """Return a row of the table, whose polygons a second are the database's as in the paper; and the device.

    Submitted are those in an image's frusta on average, the reflective ones twice.
    """
    car = tessellated_car(database.polygons, database.reflective_share)
    scene = replace(mirrored(car), frustum=replace(car.scene.frustum, resolution=(resolution, resolution)))
    settings, plate = settings_of(builtin.build("car")), scene.plate

    def neighbors(count: int) -> list[Aperture]:
        first = plate.middle.column - count // 2
        return [plate.aperture(column, plate.middle.row) for column in range(first, first + count)]

    apertures, few = neighbors(COLUMNS), neighbors(ANTIALIASED_COLUMNS)
    with PlateRenderer(scene, settings, COLOR_ONLY) as renderer, Rasterizer(scene) as rasterizer:
        runs = {
            PLATE: lambda: exhaust(renderer.hogels(apertures)),
            PLAIN: lambda: exhaust(rasterizer.render_color(one, settings, SINGLE_SAMPLE) for one in few),
            ON: lambda: exhaust(rasterizer.render_color(one, settings, ANTIALIASED) for one in few),
        }
        drawn = {PLATE: len(apertures), PLAIN: len(few), ON: len(few)}
        taken = race(runs, repeat, bar.update)
        submitted = renderer.drawn_triangles(apertures) / len(apertures)
        device = renderer.device["renderer"]
    seconds = {name: whole.divided_by(drawn[name]) for name, whole in taken.items()}
    rate, antialiased_rate = 1 / seconds[PLATE].median, 1 / seconds[ON].median
    row = {
        "polygons": database.polygons,
        "reflective_share": float(car.reflective.mean()),
        "frames_per_second": rate,
        "polygons_per_second": database.polygons * rate,
        "submitted_polygons_per_second": submitted * rate,
        "seconds_per_frame": seconds[PLATE],
        "paper": database.machines,
        "factors": {name: rate / old.frames_per_second for name, old in database.machines.items()},
        "antialiased": {
            "samples": ANTIALIASED.multisample,
            "frames_per_second": antialiased_rate,
            "polygons_per_second": database.polygons * antialiased_rate,
            "seconds_per_frame": seconds[ON],
            "seconds_per_frame_without": seconds[PLAIN],
            "slowdown": seconds[ON].median / seconds[PLAIN].median,
            "factor": antialiased_rate / database.machines[REALITY_ENGINE].frames_per_second,
        },
    }
    return row, device


def table(found: Record) -> str:
    """Return table 1 as text, one line for each machine."""
    machine, rows = found["machine"], found["rows"]
    lines = [f"{'polygons':>9}{'reflective':>12}{'frames/s':>11}{'polygons/s':>13}{'factor':>9}  drawn by"]

    def add(row: Record, rates: Record, factor: str, drawn_by: str) -> None:
        lines.append(
            f"{row['polygons']:>9,}{100 * row['reflective_share']:>11.1f}%{rates['frames_per_second']:>11.3g}"
            f"{rates['polygons_per_second']:>13,.0f}{factor:>9}  {drawn_by}"
        )

    for row in rows:
        on = row["antialiased"]
        here = f"{found['device']}, {machine['cores']} cores of {machine['processor']}, antialiasing off"
        add(row, row, "", here)
        add(row, on, "", f"the same, hogel by hogel, antialiasing on ({on['samples']} samples)")
        for name, old in row["paper"].items():
            drawn_by = f"{name} (1996), antialiasing {'on' if old.antialiasing else 'off'}"
            add(row, vars(old), f"{row['factors'][name]:,.1f}", drawn_by)
    width, height = found["resolution"]
    factors = " and ".join(f"{row['antialiased']['factor']:.1f}" for row in rows)
    slower = " and ".join(f"{row['antialiased']['slowdown']:.2f}" for row in rows)
    shares = (row["submitted_polygons_per_second"] / row["polygons_per_second"] for row in rows)
    lines += [
        "",
        f"Images of {width} x {height} by both cameras with reflections, 8-bit color read back; the paper "
        "does not say its size.",
        "Polygons submitted for an image, reflective ones twice, over the database's: "
        + ", ".join(f"{share:.2f}" for share in shares)
        + ".",
        f"With antialiasing one hogel is drawn after the other and read back in 32 bits: {slower} times as "
        "long as without in the same loop,",
        f"and {factors} times as fast as the {REALITY_ENGINE}, whose antialiasing was on.",
        f"Median of {rows[0]['seconds_per_frame'].repetitions} rows of {COLUMNS} hogels after a warm-up; "
        f"{ANTIALIASED_COLUMNS} where they are drawn one after the other.",
    ]
    return "\n".join(lines)
