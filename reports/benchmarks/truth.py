"""How fast is the truth, next to tracers that prove nothing? Million pixels per second, and ratios.

All contestants answer for the same pixels of one aperture. What they answer differs, and so does what it
costs: a triangle number in float32, a point, or a number, a place along the line and a proof.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from trimesh import Trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from xfrustum.reference.lines.lines import crossed_frustum
from xfrustum.reference.llvm import mitsuba_backend
from xfrustum.reference.tracers.embree import EmbreeTracer
from xfrustum.reference.tracers.mitsuba_tracer import bare_intersection
from xfrustum.reference.tracers.proposals import pixel_rays
from xfrustum.reference.truth import Reference
from xfrustum.reports.benchmarks import common
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.timing import race
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

RESOLUTIONS = (512, 1024, 2048)
REPEAT = 9

MITSUBA, EMBREE, TRIMESH = "mitsuba", "embree", "trimesh"
CERTIFIED, TRUTH = "certified", "truth"
MEANINGS = {
    MITSUBA: "Mitsuba's bare ray_intersect_preliminary, robust, rays on the device",
    EMBREE: "Embree through embreex, robust, rays from NumPy: triangle numbers",
    TRIMESH: "trimesh's intersects_location, first hits only",
    CERTIFIED: "certified triangle, place along the line and certainty, with all set-up",
    TRUTH: "the whole true image: also points, normals and colors, without a second opinion",
}
"""All contestants, in the order in which they are listed."""

RATIOS = ((CERTIFIED, MITSUBA), (CERTIFIED, TRIMESH), (TRUTH, MITSUBA), (TRUTH, TRIMESH))
"""Pairs of contestants; the rate of the first is divided by that of the second."""


def truth_contestants(scene: Scene, aperture: Aperture) -> dict[str, Callable[[], object]]:
    """Return the contestants that there are here, by the names in `MEANINGS`.

    Acceleration structures are built, and rays aimed, here or at the first call, which no clock should count.
    The certified truth has no such thing: each call begins with the triangles. There is no `MITSUBA` where
    it has only its scalar variant, one ray at a time.
    """
    pencil = crossed_frustum(scene.frustum, aperture)
    origins, directions = pixel_rays(scene, pencil, range(pencil.resolution[1]))
    embree, reference = EmbreeTracer(scene), Reference(scene)
    mesh = RayMeshIntersector(Trimesh(scene.vertices, scene.faces, process=False))
    found: dict[str, Callable[[], object]] = {
        EMBREE: lambda: embree.first_hits(origins, directions),
        TRIMESH: lambda: mesh.intersects_location(origins, directions, multiple_hits=False),
        CERTIFIED: lambda: list(reference.decide(aperture)),
        TRUTH: lambda: reference.trace(aperture),
    }
    if not mitsuba_backend().scalar:
        found[MITSUBA] = bare_intersection(scene, origins, directions)
    return {name: found[name] for name in MEANINGS if name in found}


def benchmark_truth(
    scene: Scene, resolutions: Sequence[int] = RESOLUTIONS, repeat: int = REPEAT, *, progress: bool = False
) -> common.Record:
    """Measure the certified truth of a scene's middle aperture beside bare tracers, W = H of each race.

    Raises InputError where the scene has no triangles, or a number is not positive.
    """
    if not resolutions:
        raise InputError("bench: there is no resolution; give such as 512,1024")
    scenes, races = [common.sized(scene, side) for side in resolutions], []
    common.positive(repeat)
    with progress_bar(len(scenes) * len(MEANINGS), "bench", "contestant", shown=progress) as bar:
        for one in scenes:
            (width, height), rates = one.frustum.resolution, {}
            # One at a time, so that none pays for what another leaves behind in caches and heap.
            for name, run in truth_contestants(one, one.plate.middle).items():
                rates[name] = common.rate_of(width * height / 1e6, race({name: run}, repeat)[name])
                bar.update()
            ends = {
                name: {"median": rate.median, "slowest": rate.lowest, "fastest": rate.highest}
                for name, rate in rates.items()
            }
            races.append(
                {
                    "resolution": (width, height),
                    "mpixel_per_s": {name: ends.get(name) for name in MEANINGS},
                    "ratios": common.ratios_of(rates, RATIOS),
                }
            )
    return {
        "scene": {**common.scene_record(scene), "aperture": scene.plate.middle.index},
        "repeat": repeat,
        "meanings": MEANINGS,
        "races": races,
        **common.machine_record(tracers=True),
    }


def table(found: common.Record) -> str:
    """Return the rates and ratios as text, one column for each resolution."""
    machine, scene, races = found["machine"], found["scene"], found["races"]
    rows = [["million pixels per second", *("{} x {}".format(*one["resolution"]) for one in races)]]
    for name in MEANINGS:
        rates = [one["mpixel_per_s"][name] for one in races]
        ends = [rate and (rate["slowest"], rate["median"], rate["fastest"]) for rate in rates]
        rows.append([name, *map(common.spread, ends)])
    rows += [[pair, *(common.number(one["ratios"][pair]) for one in races)] for pair in races[0]["ratios"]]
    head = f"{scene['name']}, {scene['triangles']:,} triangles, middle aperture"
    lines = [
        f"{head}; {machine['cores']} cores of {machine['processor']}",
        f"median of {found['repeat']} after a warm-up (slowest to fastest)",
        *("", *common.columns(rows), ""),
        *(f"{name}: {meaning}" for name, meaning in MEANINGS.items()),
    ]
    return "\n".join(lines)
