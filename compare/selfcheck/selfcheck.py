"""Comparison of the reference with integer brute force, pixel by pixel, and a closed sphere."""

import multiprocessing
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from tqdm import tqdm

from xfrustum.compare.selfcheck.comparison import Disagreement, ImageLines, disagreements
from xfrustum.compare.selfcheck.directions import DirectionCheck, check_directions
from xfrustum.compare.selfcheck.rational import ExactRows, first_by_brute_force
from xfrustum.reference import Reference
from xfrustum.reference.lines import crossed_frustum
from xfrustum.reference.llvm import worker_count
from xfrustum.reference.rays.rays import ExactMesh, FirstHits, RayBatch
from xfrustum.reference.tracers import EmbreeTracer
from xfrustum.scenes import Aperture, Frustum, InputError, Plate, Scene, SceneObject, open_scene
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.library import builtin, hard_cases
from xfrustum.scenes.model.images import Certainty

Compute = Callable[..., Iterator[ExactRows]]  #: `map`, in this process or in worker processes
MAX_TASK_PIXELS = 1 << 13
"""Largest number of pixels in one task of a process: small tasks keep all processes busy."""

VIEW_PIXELS, QUICK_VIEW_PIXELS = 50_000, 1_600
"""Approximate numbers of pixels in each view of a scene.

Hard cases keep their own resolution, because their geometry lies on the lines of its pixels."""

APERTURE_SHARES = ((0.5, 0.5), (0.3, 0.7), (0.0, 0.0), (1.0, 1.0))
"""Apertures as shares of the columns and rows of a plate: middle, off center, two corners."""

SUBDIVISIONS, QUICK_SUBDIVISIONS = 6, 4
"""Numbers of subdivisions of an icosahedron: the spheres have 81,920 and 5,120 triangles."""

COUNTS = ("pixels", "covered", "proven", "exact", "ties", "wrong", "tracer_wrong")
"""Counts of each view that are summed over all views."""

DIRECTION_COUNTS = ("pixels", "open", "differing", "wrong")
"""Counts of the checks by direction; their sums are named `direction_pixels` and so on."""


@dataclass(frozen=True, kw_only=True)
class ViewCheck:
    """Comparison of one image with the exact results."""

    scene: str
    aperture: tuple[int, int]
    resolution: tuple[int, int]
    pixels: int
    covered: int
    proven: int
    exact: int
    ties: int
    wrong: int
    disagreements: tuple[Disagreement, ...]  #: the first few
    tracer_wrong: int  #: pixels without a tie at which the float32 tracer's proposal is wrong
    seconds: float  #: wall time; other processes compute later views at the same time


@dataclass(frozen=True, kw_only=True)
class SphereCheck:
    """Lines from a sphere's center through its vertices and the middles of its edges.

    The misses of the float32 tracer are counted as well. A line is wrong if it does not meet the
    right triangles: at a vertex exactly the triangles that share the vertex, at s = 1; in the
    middle of an edge at least one of the two triangles that share the edge.
    """

    triangles: int
    vertices: int
    edges: int
    vertex_misses: int
    edge_misses: int
    wrong: int
    tracer_vertex_misses: int
    tracer_edge_misses: int
    seconds: float

    @property
    def agrees(self) -> bool:
        """True if every line meets the right triangles."""
        return self.vertex_misses == self.edge_misses == self.wrong == 0


@dataclass(frozen=True, kw_only=True)
class SelfCheck:
    """All checked images, and the sphere; None if it was not checked."""

    views: tuple[ViewCheck, ...]
    directions: tuple[DirectionCheck, ...]  #: for each scene
    sphere: SphereCheck | None
    seconds: float

    @property
    def agrees(self) -> bool:
        """True if no image, no pixel by direction and no line of the sphere is wrong."""
        wrong = [view.wrong for view in self.views]
        wrong += [each.wrong + each.differing for each in self.directions]
        return not any(wrong) and (self.sphere is None or self.sphere.agrees)

    def total(self, count: str) -> int:
        """Return the sum of a count over all views."""
        return sum(getattr(view, count) for view in self.views)

    def summary(self) -> dict[str, Any]:
        """Return the record that `selfcheck --json` prints."""
        counts = {count: self.total(count) for count in COUNTS}
        for count in DIRECTION_COUNTS:
            counts[f"direction_{count}"] = sum(getattr(each, count) for each in self.directions)
        return {"agrees": self.agrees, **counts, **asdict(self)}


def selfcheck(
    names: Sequence[str] = (),
    *,
    quick: bool = False,
    progress: bool = False,
    processes: int | None = None,
) -> SelfCheck:
    """Compare the reference with exact brute force on every pixel of many images.

    `names` are scene files or built-in scenes; if empty, all built-in scenes and the sphere are
    checked. `quick` uses smaller images and a coarser sphere. `processes` is the number of worker
    processes; None for one per processor, 1 for the calling process only. Raises InputError for an
    unknown scene or a scene with too many triangles.
    """
    started = time.perf_counter()
    views = [view for name in names or default_names() for view in _views(name, quick)]
    pixels = sum(int(np.prod(scene.frustum.resolution)) for _, scene, _ in views)
    # Processes are spawned, not forked: they inherit no thread, no lock and no OpenGL context.
    pool = ProcessPoolExecutor(
        processes or worker_count(), mp_context=multiprocessing.get_context("spawn")
    )
    compute: Compute = map if processes == 1 else pool.map
    try:
        with tqdm(total=pixels, unit="px", unit_scale=True, disable=not progress) as bar:
            # All tasks are submitted at once, so that the workers stay busy while this process
            # traces.
            waiting = [(*view, _exact_rows(compute, *view[1:])) for view in views]
            first_of_scene = {view[0]: view for view in reversed(views)}
            directions = [
                check_directions(*first_of_scene[name], Reference, quick=quick)
                for name in dict.fromkeys(name for name, *_ in views)
            ]
            checked = [_check(*view, bar) for view in waiting]
    finally:
        # After an error the remaining tasks are dropped.
        pool.shutdown(cancel_futures=True)
    return SelfCheck(
        views=tuple(checked),
        directions=tuple(directions),
        sphere=None if names else check_sphere(quick=quick),
        seconds=time.perf_counter() - started,
    )


def default_names() -> list[str]:
    """Return the built-in scenes, the hard cases, and scene files beside the checkout."""
    shared = Path(__file__).resolve().parents[3] / "shared" / "scenes"
    files = (str(path) for path in sorted(shared.glob("*.toml")))
    return [*builtin.names(), *hard_cases.names(giants=False), *files]


def _views(name: str, quick: bool) -> Iterator[tuple[str, Scene, Aperture]]:
    """Yield name, scene and aperture of each checked image, small enough for integers."""
    case = hard_cases.CASES.get(name)
    if case is not None and case.giant:
        raise InputError(
            f"{name} is a giant, which integers take hours for: leave it out of the self-check"
        )
    scene = case.build() if case else open_scene(name)
    if case is None:
        # With an odd number of columns, the lines of the middle column have slope 0 in x. In
        # symmetric scenes they run along edges.
        width, height = scene.frustum.resolution
        factor = sqrt((QUICK_VIEW_PIXELS if quick else VIEW_PIXELS) / (width * height))
        resolution = (max(1, round(width * factor)) | 1, max(1, round(height * factor)))
        scene = replace(scene, frustum=replace(scene.frustum, resolution=resolution))
    columns, rows = scene.plate.hogels
    places = [
        (min(int(x * columns), columns - 1), min(int(y * rows), rows - 1))
        for x, y in APERTURE_SHARES
    ]
    if case is not None:
        places = [*case.apertures, *(places if not quick else ())]
    yield from ((name, scene, scene.plate.aperture(*place)) for place in dict.fromkeys(places))


def _exact_rows(compute: Compute, scene: Scene, aperture: Aperture) -> Iterator[ExactRows]:
    bundle = crossed_frustum(scene.frustum, aperture)
    width, height = bundle.resolution
    step = max(1, MAX_TASK_PIXELS // width)
    bands = [range(start, min(start + step, height)) for start in range(0, height, step)]
    return compute(
        first_by_brute_force, [scene.triangles] * len(bands), [bundle] * len(bands), bands
    )


def _check(
    name: str, scene: Scene, aperture: Aperture, rows: Iterator[ExactRows], bar: Any
) -> ViewCheck:
    started = time.perf_counter()
    image = Reference(scene).trace(aperture)
    assert image.certainty is not None and image.overruled is not None
    parts = []
    for part in rows:
        parts.append((part.triangle, part.s, part.ties))
        bar.update(part.triangle.size)
    triangle, s, ties = (np.concatenate(part) for part in zip(*parts, strict=True))
    exact = ExactRows(triangle=triangle, s=s, ties=ties)
    bundle = crossed_frustum(scene.frustum, aperture)
    wrong, listed = disagreements(image, exact, ImageLines.from_bundle(bundle), scene.triangles)
    counts = np.bincount(image.certainty.ravel(), minlength=len(Certainty))
    return ViewCheck(
        scene=name,
        aperture=aperture.index,
        resolution=bundle.resolution,
        pixels=image.triangle.size,
        covered=int(image.covered.sum()),
        proven=int(counts[Certainty.PROVEN]),
        exact=int(counts[Certainty.EXACT]),
        ties=int(counts[Certainty.TIE]),
        wrong=int(wrong.sum()),
        disagreements=listed,
        tracer_wrong=int(image.overruled.sum()),
        seconds=time.perf_counter() - started,
    )


def check_sphere(*, quick: bool = False) -> SphereCheck:
    """Trace lines through every vertex and edge of a sphere: none may miss it."""
    started = time.perf_counter()
    mesh = trimesh.creation.icosphere(subdivisions=QUICK_SUBDIVISIONS if quick else SUBDIVISIONS)
    vertices, faces = (
        np.asarray(mesh.vertices, dtype=np.float64),
        np.asarray(mesh.faces, dtype=np.int64),
    )
    edges = np.asarray(mesh.edges_unique, dtype=np.int64)
    middles = vertices[edges].mean(axis=1)
    at_vertices, at_edges = (
        first_from_center(vertices[faces], lines) for lines in (vertices, middles)
    )
    # The tracer does not use the plate and the frustum.
    scene = Scene(
        name="sphere",
        plate=Plate(size=(1.0, 1.0), hogels=(1, 1)),
        frustum=Frustum(resolution=(1, 1), reach=(1.0, 1.0), fov=(1.0, 1.0)),
        objects=(SceneObject(name="sphere", vertices=vertices, faces=faces),),
    )
    tracer = EmbreeTracer(scene)
    # A vertex is wrong unless its line meets exactly the triangles around it, at s = 1. An edge is
    # wrong if the line through its rounded middle meets a triangle without this edge.
    around: list[list[int]] = [[] for _ in vertices]
    for number, corners in enumerate(faces.tolist()):
        for vertex in corners:
            around[vertex].append(number)
    ties = _by_ray(at_vertices)
    wrong = sum(
        ties[vertex] != numbers or float(at_vertices.t[vertex]) != 1.0
        for vertex, numbers in enumerate(around)
    )
    ties = _by_ray(at_edges)
    for line, ends in enumerate(edges.tolist()):
        met = ties[line] or [int(at_edges.triangle[line])]
        wrong += not all(set(ends) <= set(faces[number].tolist()) for number in met)
    return SphereCheck(
        triangles=len(faces),
        vertices=len(vertices),
        edges=len(edges),
        vertex_misses=int((at_vertices.triangle < 0).sum()),
        edge_misses=int((at_edges.triangle < 0).sum()),
        wrong=wrong,
        tracer_vertex_misses=int((tracer.first_hits(np.zeros_like(vertices), vertices) < 0).sum()),
        tracer_edge_misses=int((tracer.first_hits(np.zeros_like(middles), middles) < 0).sum()),
        seconds=time.perf_counter() - started,
    )


def first_from_center(triangles: Floats, directions: Floats) -> FirstHits:
    """Return the first surfaces along rays (N, 3) from the origin, for t from 0 to 2."""
    # Rays meet the unit sphere at about t = 1.
    ends = np.tile([0.0, 2.0], (len(directions), 1))
    return ExactMesh.from_triangles(triangles).first(
        RayBatch(origins=np.zeros_like(directions), directions=directions, ends=ends)
    )


def _by_ray(hits: FirstHits) -> dict[int, list[int]]:
    """Return the tied triangles of each ray."""
    ties: dict[int, list[int]] = defaultdict(list)
    for ray, triangle in hits.ties.tolist():
        ties[ray].append(triangle)
    return ties
