"""Benchmarks: rates and their ratios within one run, as the JSON objects that the commands print.

`bench truth`, `judge` and `plate` time the toolkit, plain loops and bare tracers.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm
from trimesh import Trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from xfrustum.compare.comparison import ComparisonNumbers, compare_images
from xfrustum.compare.planning.ways import spread_pixels
from xfrustum.compare.run import Evaluator
from xfrustum.raster import Rasterizer
from xfrustum.raster.device.context import describe, open_context
from xfrustum.raster.plate.directions import DirectionRenderer
from xfrustum.raster.plate.renderer import PlainLoop, PlateRenderer
from xfrustum.reference import Reference
from xfrustum.reference.lines import crossed_frustum, pixel_places
from xfrustum.reference.llvm import array_device, mitsuba_backend
from xfrustum.reference.proposals import pixel_rays
from xfrustum.reference.tracers import EmbreeTracer, bare_intersection
from xfrustum.reports.common import outputs
from xfrustum.reports.common.outputs import json_ready, progress_bar
from xfrustum.reports.common.timing import Timing, race
from xfrustum.reports.text import aligned
from xfrustum.scenes import Aperture, DoubleFrustum, HogelImage, InputError, Scene
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.effects import Effect, needed
from xfrustum.scenes.model.images import ColorType, PlateContent
from xfrustum.scenes.plate import PlateTile

#: The JSON object of a benchmark, or a part of it; `json_ready` converts it to JSON's types
Record = dict[str, Any]

#: near offset of all drawn images, as a fraction of the reach
RELATIVE_NEAR = 1e-3


def scene_record(scene: Scene) -> Record:
    """Return the description of a measured scene."""
    return {"name": scene.name, "hash": scene.content_hash, "triangles": len(scene.faces)}


def machine_record(*, tracers: bool = False) -> Record:
    """Return machine, device of arrays, OpenGL renderer, and versions, also of tracers on request.

    InputError if there is no usable OpenGL.
    """
    versions = outputs.versions()
    if tracers:
        versions |= mitsuba_backend().versions
        versions |= {name: version(name) for name in ("drjit", "embreex", "trimesh")}
    context = open_context()
    renderer = describe(context)["renderer"]
    context.release()
    machine = outputs.machine()
    return {
        "machine": machine,
        "arrays": machine["arrays"],
        "renderer": renderer,
        "versions": versions,
    }


def settings_of(scene: Scene) -> DoubleFrustum:
    """Return the settings that all contestants draw with."""
    return DoubleFrustum(near=RELATIVE_NEAR * scene.frustum.longest_reach)


def bare_frame(rasterizer: Rasterizer, aperture: Aperture) -> HogelImage:
    """Return a frame without normals and color."""
    return rasterizer.render(aperture, settings_of(rasterizer.scene), normals=False, color=False)


def sized(scene: Scene, resolution: int) -> Scene:
    """Return a scene with a square film, one sample a pixel; InputError without triangles."""
    if not len(scene.faces):
        raise InputError(f"scene {scene.name}: has no triangles to measure; choose one that has")
    film = replace(scene.frustum, resolution=(resolution, resolution))
    return replace(scene, frustum=film, sampling=Sampling())


def film_rays(scene: Scene, aperture: Aperture) -> tuple[Floats, Floats]:
    """Return origins and directions of the rays through all pixels of an aperture."""
    bundle = crossed_frustum(scene.frustum, aperture)
    return pixel_rays(scene, bundle, range(bundle.resolution[1]))


def rate_of(amount: float, seconds: Timing) -> Timing:
    """Return an amount per second; `seconds` is the time of the whole amount."""
    lowest, median, highest = (
        amount / each for each in (seconds.highest, seconds.median, seconds.lowest)
    )
    return replace(seconds, median=median, lowest=lowest, highest=highest, low=None, high=None)


def ratios_of(
    rates: Mapping[str, Timing], pairs: Iterable[tuple[str, str]]
) -> dict[str, float | None]:
    """Return quotients of median rates as "first/second"; None if a contestant is missing."""
    return {
        f"{first}/{second}": rates[first].median / rates[second].median
        if first in rates and second in rates
        else None
        for first, second in pairs
    }


def exhaust(images: Iterable[object]) -> None:
    """Consume all images without keeping them."""
    deque(images, maxlen=0)


def rates_table(title: str, races: Sequence[Record], key: str) -> str:
    """Return rates and ratios of some races as text, one column for each race."""
    heads = ["{} x {}".format(*race["resolution"]) for race in races]
    rows: list[Sequence[str]] = [[title, *heads]]
    for name in races[0][key]:
        # A rate is a median with the smallest and largest value; None for a contestant that is
        # missing.
        rates = [
            rate and list(rate.values())[:3]
            for rate in json_ready([race[key][name] for race in races])
        ]
        cells = ("{:.2f} ({:.2f} to {:.2f})".format(*rate) if rate else "-" for rate in rates)
        rows.append([name, *cells])
    for pair in races[0]["ratios"]:
        ratios = (race["ratios"][pair] for race in races)
        rows.append([pair, *("-" if ratio is None else f"{ratio:.2f}" for ratio in ratios)])
    return aligned(rows, str.ljust)


def report(
    head: Iterable[str], tables: Iterable[str], record: Record, meanings: Mapping[str, str]
) -> str:
    """Return a benchmark as text: scene, machine, tables, and meanings of its names."""
    where = f"{record['machine']['cores']} cores of {record['machine']['processor']}"
    where += f"; arrays on {record['arrays']}, drawing by {record['renderer']}"
    devices = {name: f" (on {device})" for name, device in record["devices"].items()}
    legend = "\n".join(
        f"{name}{devices.get(name, '')}: {meaning}" for name, meaning in meanings.items()
    )
    return "\n\n".join(("\n".join((*head, where)), *tables, legend))


# The truth, next to tracers that prove nothing
# ------------------------------------------------------------

#: meanings of the contestants, in the order of the table
TRUTH_MEANINGS = {
    "mitsuba": "Mitsuba's bare ray_intersect_preliminary, robust, rays on the device",
    "embree": "Embree through embreex, robust, rays from NumPy: triangle numbers",
    "trimesh": "trimesh's intersects_location, first hits only",
    "certified": "certified triangle, place along the line and certainty, with all set-up",
    "truth": "the whole true image: also points, normals and colors, without a second opinion",
}

#: pairs of contestants (first, second), for the rate of the first over the rate of the second
TRUTH_RATIOS = [(ours, bare) for ours in ("certified", "truth") for bare in ("mitsuba", "trimesh")]


_TRACING = {"embree": "processors", "trimesh": "processors"}


def _mitsuba() -> str:
    return mitsuba_backend().variant


def truth_contestants(scene: Scene, aperture: Aperture) -> dict[str, Callable[[], object]]:
    """Return the contestants that this machine has, by the names in `TRUTH_MEANINGS`.

    Acceleration structures and rays are made here or at the first call: do not time that call. The
    certified truth has no such structure: each call begins with the triangles. `mitsuba` is missing
    if Mitsuba has only its scalar variant, which traces one ray at a time.
    """
    # Rays are made once, before timing begins.
    origins, directions = film_rays(scene, aperture)
    embree, reference = EmbreeTracer(scene), Reference(scene)
    # Acceleration structures are built before timing begins.
    mesh = RayMeshIntersector(Trimesh(scene.vertices, scene.faces, process=False))
    runs: dict[str, Callable[[], object]] = {
        "embree": lambda: embree.first_hits(origins, directions),
        "trimesh": lambda: mesh.intersects_location(origins, directions, multiple_hits=False),
        "certified": lambda: list(reference.decide(aperture)),
        "truth": lambda: reference.trace(aperture),
    }
    # The scalar variant traces one ray at a time, which is not comparable.
    if not mitsuba_backend().scalar:
        runs["mitsuba"] = bare_intersection(scene, origins, directions)
    return {name: runs[name] for name in TRUTH_MEANINGS if name in runs}


def benchmark_truth(
    scene: Scene,
    resolutions: Sequence[int] = (512, 1024, 2048),
    repeat: int = 9,
    *,
    progress: bool = False,
) -> Record:
    """Measure rates of the certified truth and of bare tracers, at one aperture of square films.

    InputError if the scene has no triangles.
    """
    scenes, races = [sized(scene, side) for side in resolutions], []
    with progress_bar(
        len(scenes) * len(TRUTH_MEANINGS), "bench", "contestant", shown=progress
    ) as bar:
        for film in scenes:
            (width, height), rates = film.frustum.resolution, {}
            # Run one contestant at a time, so that the caches and heap of another do not slow it.
            for name, run in truth_contestants(film, film.plate.middle).items():
                rates[name] = rate_of(width * height / 1e6, race({name: run}, repeat)[name])
                bar.update()
            ends = {
                name: {"median": film.median, "slowest": film.lowest, "fastest": film.highest}
                for name, film in rates.items()
            }
            races.append(
                {
                    "resolution": (width, height),
                    "mpixel_per_s": {name: ends.get(name) for name in TRUTH_MEANINGS},
                    "ratios": ratios_of(rates, TRUTH_RATIOS),
                }
            )
    return {
        "scene": {**scene_record(scene), "aperture": scene.plate.middle.index},
        "repeat": repeat,
        "meanings": TRUTH_MEANINGS,
        "devices": {
            **_TRACING,
            "certified": array_device(),
            "truth": array_device(),
            "mitsuba": _mitsuba(),
        },
        "races": races,
        **machine_record(tracers=True),
    }


def truth_table(record: Record) -> str:
    """Return the rates and ratios as text, one column for each resolution."""
    scene = record["scene"]
    head = [
        f"{scene['name']}, {scene['triangles']:,} triangles, middle aperture",
        f"median of {record['repeat']} after a warm-up (slowest to fastest)",
    ]
    rates = rates_table("million pixels per second", record["races"], "mpixel_per_s")
    return report(head, [rates], record, TRUTH_MEANINGS)


# Judged hogels, and CPU seconds by stage
# -------------------------------------------------------------------

JUDGE_MEANINGS = {
    "stream": "Evaluator.stream, which overlaps drawing, tracing and comparing: numbers alone",
    "loop": "trace, render and compare_images, one hogel after the other: the same numbers",
    "plain": "render, trimesh's intersects_first and NumPy: other objects, and displacement, "
    "nothing proven",
    "render": "the frame alone, without normals and color, read back",
    "mitsuba": "Mitsuba's bare ray_intersect_preliminary of the middle aperture, rays on the "
    "device",
}

JUDGE_RATIOS = [("stream", name) for name in JUDGE_MEANINGS if name != "stream"]


def default_scenes() -> tuple[str, ...]:
    """Return the built-in car and, if the folder of test data exists, its car body."""
    body = Path(__file__).resolve().parents[3] / "shared" / "scenes" / "beetle.toml"
    return ("car", str(body)) if body.exists() else ("car",)


def judged_in_stream(judge: Evaluator, apertures: Sequence[Aperture]) -> list[ComparisonNumbers]:
    """Judge hogels in a stream, which overlaps tracing, drawing and comparing."""
    stream = judge.stream(apertures, [settings_of(judge.scene)], radiance=False)
    return [hogel.drawings[0].comparison for hogel in stream]


def judged_in_loop(
    reference: Reference, rasterizer: Rasterizer, apertures: Sequence[Aperture]
) -> list[ComparisonNumbers]:
    """Judge the same hogels one after the other."""
    numbers = []
    for aperture in apertures:
        truth = reference.trace(aperture)
        drawn = bare_frame(rasterizer, aperture)
        numbers.append(compare_images(truth, drawn, reference, radiance=False).numbers)
    return numbers


def judged_plainly(
    rasterizer: Rasterizer, mesh: RayMeshIntersector, apertures: Sequence[Aperture]
) -> list[tuple[float, float]]:
    """Judge hogels as a user would with trimesh and NumPy, without proofs.

    Returns the share of pixels with a wrong object and the 99th percentile of displacement, px, of
    each hogel.
    """
    scene = rasterizer.scene
    numbers = []
    for aperture in apertures:
        drawn = bare_frame(rasterizer, aperture)
        bundle = crossed_frustum(scene.frustum, aperture)
        width, height = bundle.resolution
        first = mesh.intersects_first(*film_rays(scene, aperture))
        wrong = scene.object_of_number[first] != drawn.object.ravel()
        # Pixels without a surface have NaN places.
        with np.errstate(invalid="ignore", divide="ignore"):
            place = pixel_places(drawn.position.reshape(-1, 3).astype(np.float64), bundle)
        row, column = np.divmod(np.arange(width * height), width)
        moved = np.hypot(place[:, 0] - column, place[:, 1] - row)
        moved = moved[np.isfinite(moved)]
        numbers.append(
            (float(wrong.mean()), float(np.percentile(moved, 99)) if moved.size else 0.0)
        )
    return numbers


def benchmark_judge(
    scenes: Sequence[Scene],
    resolutions: Sequence[int] = (128, 256, 512, 1024),
    hogels: int = 6,
    repeat: int = 5,
    *,
    progress: bool = False,
) -> Record:
    """Measure judged hogels per second on square films; the hogels are spread over each plate.

    Contestants take `repeat` turns after a warm-up. InputError if a scene has no triangles, or
    there is no usable OpenGL.
    """
    films = [[sized(scene, side) for side in resolutions] for scene in scenes]
    turns = len(scenes) * len(resolutions) * (repeat + 1) * len(JUDGE_MEANINGS)
    with progress_bar(turns, "bench", "run", shown=progress) as bar:
        judged = [
            {
                "scene": scene_record(scene),
                "settings": settings_of(scene),
                "races": [_race(film, hogels, repeat, bar) for film in sizes],
            }
            for scene, sizes in zip(scenes, films, strict=True)
        ]
    return {
        "hogels": hogels,
        "repeat": repeat,
        "meanings": JUDGE_MEANINGS,
        "scenes": judged,
        **machine_record(tracers=True),
    }


def _race(scene: Scene, hogels: int, repeat: int, bar: tqdm[Any]) -> Record:
    """Measure all compared programs at one resolution."""
    middle, plate = scene.plate.middle, scene.plate
    # Spread the hogels evenly over the plate, row by row; a plate with fewer hogels repeats some.
    numbers = np.linspace(0, math.prod(plate.hogels) - 1, hogels).astype(int).tolist()
    apertures = [
        plate.aperture(number % plate.hogels[0], number // plate.hogels[0]) for number in numbers
    ]
    mesh = RayMeshIntersector(Trimesh(scene.vertices, scene.faces, process=False))
    with Evaluator(scene) as judge, Rasterizer(scene) as rasterizer:
        reference = judge.reference
        runs: dict[str, Callable[[], object]] = {
            "stream": lambda: judged_in_stream(judge, apertures),
            "loop": lambda: judged_in_loop(reference, rasterizer, apertures),
            "plain": lambda: judged_plainly(rasterizer, mesh, apertures),
            "render": lambda: exhaust(bare_frame(rasterizer, a) for a in apertures),
        }
        if not mitsuba_backend().scalar:
            bare = bare_intersection(scene, *film_rays(scene, middle))
            runs["mitsuba"] = lambda: exhaust(bare() for _ in apertures)
        taken = race(runs, repeat, bar.update)
    rates = {name: rate_of(hogels, seconds) for name, seconds in taken.items()}
    renderer = judge.device["renderer"]
    both = f"{renderer}, {array_device()}"
    return {
        "resolution": scene.frustum.resolution,
        "devices": {
            **{"stream": both, "loop": both, "plain": f"{renderer}, processors"},
            **{"render": renderer, "mitsuba": _mitsuba()},
        },
        "hogels_per_second": {name: rates.get(name) for name in JUDGE_MEANINGS},
        "ratios": ratios_of(rates, JUDGE_RATIOS),
    }


def judge_table(record: Record) -> str:
    """Return rates and ratios as text, one column for each resolution."""
    tables = []
    for judged in record["scenes"]:
        scene, races = judged["scene"], judged["races"]
        rates = rates_table("judged hogels per second", races, "hogels_per_second")
        tables.append(f"{scene['name']}, {scene['triangles']:,} triangles\n{rates}")
    head = [
        f"{record['hogels']} hogels a run",
        f"median of {record['repeat']} after a warm-up (slowest to fastest), taking turns",
    ]
    devices = record["scenes"][0]["races"][0]["devices"]
    return report(head, tables, {**record, "devices": devices}, JUDGE_MEANINGS)


# Many hogels at once, next to plain loops
# ---------------------------------------------

PLATE_MEANINGS = {
    "plain": "one hogel after the other, every triangle twice, triangle numbers and float32 color "
    "read back",
    "plain-numbered": "the same, with the triangles' numbers in vertices instead of gl_PrimitiveID",
    "read-back": "the images of plain read back, nothing drawn: what the bus allows",
    "batched": "PlateRenderer, the same images read back",
    "batched-discarded": "the draws of batched with rasterization discarded, nothing read back",
    "bare": "one hogel after the other, every triangle twice, 8-bit color only, nothing read back",
    "bare-numbered": "the same, with the triangles' numbers in vertices instead of gl_PrimitiveID",
    "batched-color": "PlateRenderer, 8-bit color only, read back",
    "directions": "DirectionRenderer, the same images of the whole plate, a pass for each pixel of "
    "a hogel: an even part of the passes is timed",
}

PLATE_RATIOS = (
    *(
        ("batched", other)
        for other in ("plain", "plain-numbered", "batched-discarded", "read-back")
    ),
    *(("batched-color", other) for other in ("bare", "bare-numbered")),
    ("directions", "batched"),
)

#: largest number of timed passes over the plate; all W H passes would take minutes
MOST_PASSES = 64

EVERYTHING = PlateContent(color=ColorType.FLOAT32, ids=True)
COLOR_ONLY = PlateContent(color=ColorType.UINT8)


def benchmark_plate(
    scene: Scene, resolution: int = 128, repeat: int = 5, *, progress: bool = False
) -> Record:
    """Time the middle row of a scene's plate, and the whole plate by directions, for square films.

    InputError if the scene has no triangles.
    """
    scene = sized(scene, resolution)
    settings, row = settings_of(scene), scene.plate.middle.row
    apertures = [scene.plate.aperture(column, row) for column in range(scene.plate.hogels[0])]
    effects = needed(scene) - {Effect.REFLECTION}  # plain loops draw no reflections
    turns = (repeat + 1) * len(PLATE_MEANINGS)
    with ExitStack() as stack, progress_bar(turns, "bench", "row", shown=progress) as bar:
        batched, color = (
            stack.enter_context(PlateRenderer(scene, settings, replace(content, effects=effects)))
            for content in (EVERYTHING, COLOR_ONLY)
        )
        plain, plain_numbered, bare, bare_numbered = (
            stack.enter_context(PlainLoop(scene, settings, content, numbered=numbered))
            for content in (EVERYTHING, COLOR_ONLY)
            for numbered in (False, True)
        )
        runs = {
            "plain": lambda: exhaust(plain.hogels(apertures)),
            "plain-numbered": lambda: exhaust(plain_numbered.hogels(apertures)),
            "read-back": lambda: plain.read_only(len(apertures)),
            "batched": lambda: exhaust(batched.hogels(apertures)),
            "batched-discarded": lambda: batched.draw_only(apertures, rasterize=False),
            "bare": lambda: bare.draw_only(apertures),
            "bare-numbered": lambda: bare_numbered.draw_only(apertures),
            "batched-color": lambda: exhaust(color.hogels(apertures)),
        }
        passes = spread_pixels(scene.frustum, MOST_PASSES)
        tile = PlateTile.whole(scene.plate)
        # There are no images by direction if surfaces reach the screen.
        with suppress(InputError):
            turned = stack.enter_context(
                DirectionRenderer(
                    scene, tile, replace(EVERYTHING, effects=effects), depth=settings.depth
                )
            )
            runs["directions"] = lambda: exhaust(turned.images(passes))
        seconds = race(runs, repeat, bar.update)
        device = batched.device["renderer"]
    amounts = dict.fromkeys(runs, float(len(apertures)))
    # Every pass draws one pixel of all hogels.
    amounts["directions"] = math.prod(tile.size) * len(passes) / (resolution * resolution)
    rates = {name: rate_of(amounts[name], taken) for name, taken in seconds.items()}
    return {
        "scene": scene_record(scene),
        "resolution": scene.frustum.resolution,
        "settings": settings,
        "row": row,
        "hogels": len(apertures),
        "passes": {
            "hogels": math.prod(tile.size),
            "timed": len(passes),
            "of": resolution * resolution,
        },
        "meanings": PLATE_MEANINGS,
        "hogels_per_second": {name: rates.get(name) for name in PLATE_MEANINGS},
        "ratios": ratios_of(rates, PLATE_RATIOS),
        "device": device,
        "devices": dict.fromkeys(PLATE_MEANINGS, device),
        **machine_record(),
    }


def plate_table(record: Record) -> str:
    """Return rates and ratios as text."""
    scene, hogels, passes = record["scene"], record["hogels"], record["passes"]
    head = [
        f"{scene['name']}, {scene['triangles']:,} triangles, row {record['row']}: {hogels} hogels; "
        f"by directions {passes['timed']} of {passes['of']:,} passes over {passes['hogels']:,}",
        f"median of {record['hogels_per_second']['plain'].repetitions} after a warm-up "
        "(slowest to fastest)",
    ]
    rates = rates_table("hogels per second", [record], "hogels_per_second")
    return report(head, [rates], record, PLATE_MEANINGS)
