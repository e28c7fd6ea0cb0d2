"""`xfrustum study ways`: plates by two cameras, by slabs and by directions, up to a million hogels.

Errors are measured over the same part of each plate. Seconds of a whole plate are extrapolated from
evenly spaced hogels or passes, and also predicted from two other plates of the scene.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.compare.comparison import compare_images
from xfrustum.compare.planning import ways
from xfrustum.compare.planning.ways import PlateWay
from xfrustum.compare.sampling import displacement_p99
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.blocks import HERE, Engine, open_workers
from xfrustum.reports.common.outputs import json_object
from xfrustum.reports.common.templates_environment import fragment, plain_text
from xfrustum.reports.plotting import look
from xfrustum.research.paper import tessellated_car
from xfrustum.research.sweep import Origin, StudyFiles, Sweep, check_folder, write_study
from xfrustum.scenes import DepthFormat, DoubleFrustum, Scene, open_scene
from xfrustum.scenes.model.images import PlateContent

DEFAULT_FOLDER = Path("study") / "ways"
#: columns and rows of the pixels of a hogel
RESOLUTION = (64, 64)
#: number of triangles of the subdivided car, as in the paper's larger database
TRIANGLES = 272_074
FINE_CAR = "car of 272,074 triangles"
#: number of judged hogels drawn by two cameras, spread over the tile that is judged by directions
JUDGED_HOGELS = 8
#: content of the timed images: color in the usual type, and triangle numbers
CONTENT = PlateContent(ids=True)


@dataclass(frozen=True)
class Cell:
    """One setting: a way to draw a plate; lengths in shares of the reach."""

    scene: str
    longest: int  #: hogels along the longer side of the plate
    way: PlateWay
    near: float | None = None  #: None by directions
    cuts: tuple[float, ...] = ()

    def settings(self, scene: Scene) -> DoubleFrustum:
        """Return the settings of the two cameras."""
        reach = scene.frustum.longest_reach
        assert self.near is not None
        slabs = tuple(cut * reach for cut in self.cuts)
        return DoubleFrustum(near=self.near * reach, slabs=slabs, depth=DepthFormat.D24)


@dataclass(frozen=True, kw_only=True)
class Row(Cell):
    """A cell with its results."""

    hogels: int  #: hogels of the plate
    judged: int  #: number of judged pixels
    surface_fraction: float  #: share of the judged pixels with a wrong surface
    #: p99 at the worst judged hogel; None by directions, where no near offset displaces a surface
    displacement_p99_px: float | None
    seconds: float  #: time of the whole plate, extrapolated from a part
    predicted_s: float  #: time predicted from passes over two other plates, timed in turns


@dataclass(frozen=True)
class Study:
    """Grid of a study."""

    scenes: tuple[str, ...]
    plates: tuple[int, ...]  #: hogels along the longer side
    nears: tuple[float, ...]
    cuts: tuple[tuple[float, ...], ...]

    def blocks(self) -> list[tuple[Cell, ...]]:
        """Return the cells, one plate in each block."""
        return [
            (
                *(Cell(scene, longest, PlateWay.TWO_CAMERAS, near) for near in self.nears),
                *(Cell(scene, longest, PlateWay.SLABS, cut[0] / 1000, cut) for cut in self.cuts),
                Cell(scene, longest, PlateWay.DIRECTIONS),
            )
            for scene, longest in product(self.scenes, self.plates)
        ]


FULL = Study(
    scenes=("asymmetric", "car", FINE_CAR),
    plates=(25, 81, 256, 1155),
    nears=(1e-2, 1e-3, 1e-4, 1e-5),
    cuts=((0.1,), (0.01, 0.05, 0.25)),
)
QUICK = replace(FULL, scenes=("asymmetric",), plates=(25, 256), nears=(1e-3,), cuts=((0.1,),))


@cache
def _opened(name: str) -> Scene:
    scene = tessellated_car(TRIANGLES, 0.0).scene if name == FINE_CAR else open_scene(name)
    return replace(scene, frustum=replace(scene.frustum, resolution=RESOLUTION))


def measure(cells: Sequence[Cell]) -> Iterator[Row]:
    """Measure the ways to draw one plate."""
    scene = ways.with_hogels(_opened(cells[0].scene), cells[0].longest)
    hogels = math.prod(scene.plate.hogels)
    tile = ways.tile_about(scene.plate, scene.plate.middle, ways.COMPARED_SIDE)
    columns, rows = (
        np.linspace(side[0], side[-1], JUDGED_HOGELS).astype(int).tolist()
        for side in (tile.columns, tile.rows)
    )
    # Use no column and no row twice, and avoid the diagonal.
    rows = [rows[3 * k % JUDGED_HOGELS] for k in range(JUDGED_HOGELS)]
    apertures = [scene.plate.aperture(*place) for place in zip(columns, rows, strict=True)]
    reference = Reference(scene)
    truths = [reference.trace(aperture, colored=False) for aperture in apertures]
    pairs = [cell.settings(scene) for cell in cells if cell.way is not PlateWay.DIRECTIONS]
    times = ways.measure_plate(scene, pairs, CONTENT)
    seconds = dict(zip(pairs, times.hogels_s, strict=True))
    with Rasterizer(scene) as rasterizer:
        for cell in cells:
            if cell.way is PlateWay.DIRECTIONS:
                pixels = ways.spread_pixels(scene.frustum, ways.COMPARED_PASSES)
                errors = ways.direction_errors(reference, tile, pixels, DepthFormat.D24)
                yield Row(
                    **vars(cell),
                    hogels=hogels,
                    judged=errors.judged,
                    surface_fraction=errors.fraction,
                    displacement_p99_px=None,
                    seconds=times.directions_s,
                    predicted_s=times.speeds.directions_s(hogels),
                )
                continue
            settings = cell.settings(scene)
            drawn = [rasterizer.render(a, settings, normals=False, color=False) for a in apertures]
            numbers = [
                compare_images(truth, image, reference, radiance=False).numbers
                for truth, image in zip(truths, drawn, strict=True)
            ]
            judged = sum(each.judged for each in numbers)
            wrong = sum(0 if each.surface is None else each.surface.wrong for each in numbers)
            yield Row(
                **vars(cell),
                hogels=hogels,
                judged=judged,
                surface_fraction=wrong / judged,
                displacement_p99_px=max(map(displacement_p99, numbers)),
                seconds=seconds[settings],
                predicted_s=times.speeds.hogels_s(hogels),
            )


def make_study(
    out: Path = DEFAULT_FOLDER,
    study: Study = FULL,
    engine: Engine = HERE,
    *,
    progress: bool = False,
) -> StudyFiles | None:
    """Measure the ways to draw plates, and write document, figure and data.

    A block that is in the folder already, from the same libraries and device, is not measured
    again. Returns None if other parts of a job array are not measured yet.
    """
    check_folder(out, "ways")
    sweep, blocks = Sweep.from_measure("ways", out, Row, measure), study.blocks()
    with open_workers(engine, len(blocks)) as workers:
        rows = sweep.rows(blocks, workers, engine.part, progress=progress)
    if rows is None:
        return None
    return write_study(out, "ways", rows, sweep.origin, document, {"ways": svg(rows)})


# Results
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Crossover:
    """Number of hogels above which directions are faster; None outside the measured plates."""

    scene: str
    measured: float | None
    predicted: float | None

    @property
    def ratio(self) -> float | None:
        """Ratio of predicted to measured number of hogels."""
        return self.predicted / self.measured if self.measured and self.predicted else None


def crossovers(rows: Sequence[Row]) -> list[Crossover]:
    """Return the crossovers of all scenes: directions against two cameras at the fastest near."""
    return [
        Crossover(
            scene=scene,
            measured=_crossing(_ratios(rows, scene, "seconds")),
            predicted=_crossing(_ratios(rows, scene, "predicted_s")),
        )
        for scene in dict.fromkeys(row.scene for row in rows)
    ]


def fewest_wrong(rows: Sequence[Row]) -> list[dict[PlateWay, Row]]:
    """Return the setting with the fewest wrong surfaces of each way, for each plate.

    If two settings are equally wrong, the faster one is returned.
    """
    plates: dict[tuple[str, int], dict[PlateWay, Row]] = {}
    for row in sorted(rows, key=lambda row: (row.surface_fraction, row.seconds)):
        plates.setdefault((row.scene, row.hogels), {}).setdefault(row.way, row)
    return [plates[row.scene, row.hogels] for row in rows if row.way is PlateWay.DIRECTIONS]


def _ratios(rows: Sequence[Row], scene: str, name: str) -> list[tuple[int, float]]:
    """Return pairs: hogels, and seconds by directions over the least seconds by two cameras."""
    own = [row for row in rows if row.scene == scene]

    def least(hogels: int, way: PlateWay) -> float:
        matching = (row for row in own if (row.hogels, row.way) == (hogels, way))
        return float(min(getattr(row, name) for row in matching))

    return [
        (hogels, least(hogels, PlateWay.DIRECTIONS) / least(hogels, PlateWay.TWO_CAMERAS))
        for hogels in sorted({row.hogels for row in own})
    ]


def _crossing(ratios: Sequence[tuple[int, float]]) -> float | None:
    """Return the number of hogels at which both ways take the same time; None outside the plates.

    The ratio is W H (pass / N + cell) / hogel, a straight line in 1 / N, with the times of a pass,
    of each hogel in it, and of a hogel by two cameras. Other load on the machine differs between
    plates and cancels in the ratio.
    """
    for (fewer, above), (more, below) in pairwise(ratios):
        if above > 1 >= below:
            share = (above - 1) / (above - below)
            return 1 / ((1 - share) / fewer + share / more)
    return None


def sentence(rows: Sequence[Row]) -> str:
    """Return the result in one sentence."""
    turned = [row for row in rows if row.way is PlateWay.DIRECTIONS]
    pairs = [row for row in rows if row.way is PlateWay.TWO_CAMERAS]
    largest = max(turned, key=lambda row: row.hogels)
    same = [row for row in pairs if (row.scene, row.hogels) == (largest.scene, largest.hogels)]
    faster = min(row.seconds for row in same) / largest.seconds
    worst = max(row.surface_fraction for row in turned)
    return (
        f"By directions at most {100 * worst:.2g} % of the surfaces are wrong, and no near "
        f"displaces them; {largest.hogels:,} hogels of {largest.scene} take "
        f"{largest.seconds:.3g} s, {faster:.3g} times less than hogel by hogel."
    )


def record(files: StudyFiles) -> dict[str, Any]:
    """Return the study as `xfrustum study ways --json` prints it."""
    crossed = [{**asdict(each), "ratio": each.ratio} for each in crossovers(files.rows)]
    return json_object({**files.record, "sentence": sentence(files.rows), "crossovers": crossed})


def document(rows: Sequence[Row], origin: Origin) -> str:
    """Return the study as Markdown."""
    values = {
        "sentence": sentence(rows),
        "plates": fewest_wrong(rows),
        "resolution": RESOLUTION,
        "crossovers": crossovers(rows),
        "devices": origin.devices,
    }
    return plain_text("ways.md.j2", values)


#: size of a panel of the figure, left margin of a panel, top margin of the figure, px
_PANEL, _LEFT, _TOP = (270, 240), 64, 40
#: color and dashes of the curve of each way; the curves of slabs and two cameras may coincide
_CURVES = {
    PlateWay.TWO_CAMERAS: (look(0)[0], "none"),
    PlateWay.SLABS: (look(1)[0], "5 4"),
    PlateWay.DIRECTIONS: (look(3)[0], "none"),
}


def svg(rows: Sequence[Row]) -> str:
    """Draw seconds by number of hogels on logarithmic axes, one panel for each scene."""
    scenes = list(dict.fromkeys(row.scene for row in rows))
    (left, right), (low, high) = (
        # A margin of a tenth of a decade keeps points off the frame.
        (math.log10(min(values)) - 0.1, math.log10(max(values)) + 0.1)
        for values in ([row.hogels for row in rows], [row.seconds for row in rows])
    )
    width, height = _PANEL

    def across(hogels: float) -> float:
        return width * (math.log10(hogels) - left) / (right - left)

    def down(seconds: float) -> float:
        return height * (high - math.log10(seconds)) / (high - low)

    panels = []
    for number, crossed in enumerate(crossovers(rows)):
        curves = []
        for way in PlateWay:
            own = [row for row in rows if (row.scene, row.way) == (crossed.scene, way)]
            # Draw the fastest setting: near hardly changes the time.
            fastest = {
                hogels: min(row.seconds for row in own if row.hogels == hogels)
                for hogels in sorted({row.hogels for row in own})
            }
            points = [(across(hogels), down(seconds)) for hogels, seconds in fastest.items()]
            curves.append((*_CURVES[way], points))
        meeting = crossed.measured
        panels.append(
            {
                "title": crossed.scene,
                "x": _LEFT + number * (width + _LEFT),
                "curves": curves,
                "crossed": meeting and (f"{meeting:,.0f}", across(meeting)),
            }
        )
    drawn = {
        "panels": panels,
        "pixels": " x ".join(map(str, RESOLUTION)),
        "size": _PANEL,
        "top": _TOP,
        "width": _LEFT / 2 + len(scenes) * (width + _LEFT),
        "legend": [(str(way), *style) for way, style in _CURVES.items()],
        "across": [(10**k, across(10**k)) for k in range(math.ceil(left), math.floor(right) + 1)],
        "up": [(10**k, down(10**k)) for k in range(math.ceil(low), math.floor(high) + 1)],
    }
    return fragment("study-ways.svg.j2", drawn)
