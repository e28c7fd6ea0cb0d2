"""How fast are hogels judged? Hogels per second, CPU seconds by stage, and ratios."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm
from trimesh import Trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from xfrustum.compare.metrics.comparison import ComparisonNumbers, compare_images
from xfrustum.compare.run import Judge
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import crossed_frustum, pixel_places
from xfrustum.reference.llvm import mitsuba_backend
from xfrustum.reference.tracers.mitsuba_tracer import bare_intersection
from xfrustum.reference.tracers.proposals import pixel_rays
from xfrustum.reports.benchmarks import common
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.timing import race
from xfrustum.scenes.library.targets import globes
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

RESOLUTIONS = (128, 256, 512, 1024)
REPEAT = 5
HOGELS = 6
"""Hogels that each run judges: enough that a stream overlaps, and few enough for a million pixels each."""

STREAM, LOOP, PLAIN = "stream", "loop", "plain"
RENDER, MITSUBA = "render", "mitsuba"
MEANINGS = {
    STREAM: "Judge.stream, which overlaps drawing, tracing and comparing: numbers alone",
    LOOP: "trace, render and compare_images, one hogel after the other: the same numbers",
    PLAIN: "render, trimesh's intersects_first and NumPy: other objects, and displacement, nothing proven",
    RENDER: "the frame alone, without normals and color, read back",
    MITSUBA: "Mitsuba's bare ray_intersect_preliminary of the middle aperture, rays on the device",
}
"""All contestants, in the order in which they are listed."""

RATIOS = ((STREAM, LOOP), (STREAM, PLAIN), (STREAM, RENDER), (STREAM, MITSUBA))
"""Pairs of contestants; the rate of the first is divided by that of the second."""

DECIDING, SECOND_OPINION, POINTS = "deciding", "second opinion", "points and colors"
DRAWN, READ, COMPARING, RADIANCE = "drawing", "read-back", "comparing", "comparing radiance"
STAGES = {
    DECIDING: "the certified decision alone",
    SECOND_OPINION: "the tracer's first hits along the same lines, which is no part of a truth",
    POINTS: "the rest of a truth: points, normals, objects, colors",
    DRAWN: "the double frustum, until the device has finished",
    READ: "the rest of a frame: triangle numbers, surface points, normals and colors, read back",
    COMPARING: "compare_images, without colors",
    RADIANCE: "what comparing colors takes besides",
}
"""All stages of one judged hogel, in the order in which they are listed."""

GLOBES_PLATE = (9, 9)
"""Columns and rows of the plate that globes are seen through, which otherwise has a single aperture."""

Run = Callable[[], object]
"""Answers for all apertures, and returns when that is done."""


def default_scenes() -> tuple[str, ...]:
    """Return the built-in car and, where the folder of test data is beside the checkout, its car body."""
    beside = Path(__file__).resolve().parents[3] / "shared" / "scenes" / "beetle.toml"
    return ("car", str(beside)) if beside.exists() else ("car",)


def globes_through_a_plate(triangles: int) -> Scene:
    """Return globes of so many triangles, and a plate of several hogels; see `globes`."""
    scene = globes(triangles, (1, 1))
    return replace(scene, plate=replace(scene.plate, hogels=GLOBES_PLATE))


def spread_over(scene: Scene, count: int) -> list[Aperture]:
    """Return so many apertures, evenly spread over the plate row by row; some twice where it has fewer."""
    across, rows = scene.plate.hogels
    numbers = np.linspace(0, across * rows - 1, common.positive(count)).astype(int)
    return [scene.plate.aperture(int(n) % across, int(n) // across) for n in numbers]


def judged_in_stream(judge: Judge, apertures: Sequence[Aperture]) -> list[ComparisonNumbers]:
    """Judge hogels with truths and frames made side by side."""
    stream = judge.stream(apertures, [common.settings_of(judge.scene)], radiance=False)
    return [hogel.drawings[0].comparison for hogel in stream]


def judged_in_loop(
    reference: Reference, rasterizer: Rasterizer, apertures: Sequence[Aperture]
) -> list[ComparisonNumbers]:
    """Judge the same hogels one after the other."""
    settings, found = common.settings_of(reference.scene), []
    for aperture in apertures:
        truth = reference.trace(aperture)
        drawn = rasterizer.render(aperture, settings, normals=False, color=False)
        found.append(compare_images(truth, drawn, reference, radiance=False).numbers)
    return found


def judged_plainly(
    scene: Scene, rasterizer: Rasterizer, mesh: RayMeshIntersector, apertures: Sequence[Aperture]
) -> list[tuple[float, float]]:
    """Judge hogels as a user would with trimesh and NumPy; nothing that it finds is proven.

    Each has the share of pixels with another object, and the 99th percentile of displacement, px.
    """
    object_of_number, found = np.append(scene.object_of_triangle, np.int32(NOTHING)), []
    for aperture in apertures:
        drawn = rasterizer.render(aperture, common.settings_of(scene), normals=False, color=False)
        pencil = crossed_frustum(scene.frustum, aperture)
        width, height = pencil.resolution
        first = mesh.intersects_first(*pixel_rays(scene, pencil, range(height)))
        wrong = object_of_number[first] != drawn.object.ravel()
        with np.errstate(invalid="ignore", divide="ignore"):
            place = pixel_places(drawn.position.reshape(-1, 3).astype(np.float64), pencil)
        row, column = np.divmod(np.arange(width * height), width)
        moved = np.hypot(place[:, 0] - column, place[:, 1] - row)
        moved = moved[np.isfinite(moved)]
        found.append((float(wrong.mean()), float(np.percentile(moved, 99)) if moved.size else 0.0))
    return found


@contextmanager
def judge_contestants(scene: Scene, apertures: Sequence[Aperture]) -> Iterator[dict[str, Run]]:
    """Open the contestants that there are here, by the names in `MEANINGS`; leaving frees them."""
    settings = common.settings_of(scene)
    mesh = RayMeshIntersector(Trimesh(scene.vertices, scene.faces, process=False))
    with Judge(scene) as judge, Rasterizer(scene) as rasterizer:
        found: dict[str, Run] = {
            STREAM: lambda: judged_in_stream(judge, apertures),
            LOOP: lambda: judged_in_loop(judge.reference, rasterizer, apertures),
            PLAIN: lambda: judged_plainly(scene, rasterizer, mesh, apertures),
            RENDER: lambda: common.exhaust(
                rasterizer.render(one, settings, normals=False, color=False) for one in apertures
            ),
        }
        if not mitsuba_backend().scalar:
            pencil = crossed_frustum(scene.frustum, scene.plate.middle)
            bare = bare_intersection(scene, *pixel_rays(scene, pencil, range(pencil.resolution[1])))
            found[MITSUBA] = lambda: common.exhaust(bare() for _ in apertures)
        yield found


@contextmanager
def judging_stages(scene: Scene, aperture: Aperture) -> Iterator[dict[str, Run]]:
    """Open parts of judging one hogel whose differences are the times of `STAGES`; leaving frees them.

    The parts are named by the stages that they end with: `POINTS` is a whole truth, `READ` a whole frame and
    `RADIANCE` a comparison with colors.
    """
    with Rasterizer(scene) as rasterizer:
        reference, settings = Reference(scene), common.settings_of(scene)
        truth = reference.trace(aperture)
        frame = rasterizer.render(aperture, settings, normals=False)
        yield {
            DECIDING: lambda: common.exhaust(reference.decide(aperture)),
            SECOND_OPINION: lambda: reference.trace(aperture).overruled,
            POINTS: lambda: reference.trace(aperture),
            DRAWN: lambda: rasterizer.draw_only(aperture, settings),
            READ: lambda: rasterizer.render(aperture, settings),
            COMPARING: lambda: compare_images(truth, frame, reference, radiance=False),
            RADIANCE: lambda: compare_images(truth, frame, reference),
        }


def stages_of(parts: Mapping[str, float]) -> dict[str, float]:
    """Return the seconds of each stage, given those of `judging_stages`; a difference is never negative."""
    within = {SECOND_OPINION: POINTS, POINTS: DECIDING, READ: DRAWN, RADIANCE: COMPARING}
    return {
        stage: max(0.0, parts[stage] - (parts[within[stage]] if stage in within else 0.0)) for stage in STAGES
    }


def judging_over_drawing(cpu_s: Mapping[str, float]) -> dict[str, float]:
    """Return truth and comparing over a frame, in CPU seconds, without colors and with them.

    A second opinion is no part of a truth: it is asked for when somebody reads it.
    """
    drawing = cpu_s[DRAWN] + cpu_s[READ]
    without = cpu_s[DECIDING] + cpu_s[POINTS] + cpu_s[COMPARING]
    return {"without radiance": without / drawing, "with radiance": (without + cpu_s[RADIANCE]) / drawing}


def benchmark_judge(
    scenes: Sequence[Scene],
    resolutions: Sequence[int] = RESOLUTIONS,
    hogels: int = HOGELS,
    repeat: int = REPEAT,
    *,
    progress: bool = False,
) -> common.Record:
    """Measure how fast hogels, spread over the plates of some scenes, are judged; W = H of each race.

    Contestants, and then stages, take `repeat` turns after a warm-up. Raises InputError where a scene has no
    triangles, a number is not positive, or there is no usable OpenGL.
    """
    films = [[common.sized(scene, side) for side in resolutions] for scene in scenes]
    turns = len(scenes) * len(resolutions) * (common.positive(repeat) + 1) * (len(MEANINGS) + len(STAGES))
    with progress_bar(turns, "bench", "run", shown=progress) as bar:
        judged = [
            {
                "scene": common.scene_record(scene),
                "settings": common.settings_of(scene),
                "races": [_race(film, common.positive(hogels), repeat, bar) for film in sizes],
            }
            for scene, sizes in zip(scenes, films, strict=True)
        ]
    asked = {"hogels": hogels, "repeat": repeat, "meanings": MEANINGS, "stages": STAGES}
    return {**asked, "scenes": judged, **common.machine_record(tracers=True)}


def _race(scene: Scene, hogels: int, repeat: int, bar: tqdm[Any]) -> common.Record:
    with judge_contestants(scene, spread_over(scene, hogels)) as runs:
        taken = race(runs, repeat, bar.update)
    rates = {name: common.rate_of(hogels, seconds) for name, seconds in taken.items()}
    cpu: dict[str, list[float]] = {stage: [] for stage in STAGES}
    with judging_stages(scene, scene.plate.middle) as runs:
        for turn in range(repeat + 1):
            for stage, run in runs.items():
                begun = time.process_time()
                run()
                if turn:
                    cpu[stage].append(time.process_time() - begun)
                bar.update()
    cpu_s = stages_of({stage: statistics.median(values) for stage, values in cpu.items()})
    return {
        "resolution": scene.frustum.resolution,
        "hogels_per_second": {name: rates.get(name) for name in MEANINGS},
        "ratios": common.ratios_of(rates, RATIOS),
        "cpu_s": cpu_s,
        "judging_over_drawing": judging_over_drawing(cpu_s),
    }


def table(found: common.Record) -> str:
    """Return rates, ratios and stages as text, one column for each resolution."""
    machine = found["machine"]
    lines = [
        f"{found['hogels']} hogels a run; {machine['cores']} cores of {machine['processor']}",
        f"median of {found['repeat']} after a warm-up (slowest to fastest), taking turns",
    ]
    for judged in found["scenes"]:
        scene, races = judged["scene"], judged["races"]
        heads = ["{} x {}".format(*one["resolution"]) for one in races]
        rows = [["judged hogels per second", *heads]]
        for name in MEANINGS:
            rates = [one["hogels_per_second"][name] for one in races]
            ends = (rate and (rate.lowest, rate.median, rate.highest) for rate in rates)
            rows.append([name, *map(common.spread, ends)])
        rows += [
            [pair, *(common.number(one["ratios"][pair]) for one in races)] for pair in races[0]["ratios"]
        ]
        rows.append(["CPU ms of one hogel", *heads])
        rows += [[stage, *(f"{1e3 * one['cpu_s'][stage]:.1f}" for one in races)] for stage in STAGES]
        for how in races[0]["judging_over_drawing"]:
            shares = (common.number(one["judging_over_drawing"][how]) for one in races)
            rows.append([f"(truth + comparing)/drawing {how}", *shares])
        lines += ["", f"{scene['name']}, {scene['triangles']:,} triangles", *common.columns(rows)]
    legend = (f"{name}: {meaning}" for name, meaning in (MEANINGS | STAGES).items())
    return "\n".join((*lines, "", *legend))
