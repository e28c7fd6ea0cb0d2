"""Comparison of the reference with integer brute force by pixel, and test on a closed sphere.

Truths by direction are compared with truths by hogels as well. A tile of hogels is traced hogel by
hogel, and some of its pixels are traced by direction. All bits must be equal, and the integer
arithmetic must give the same result for every line. Half of the pixels are spread over the film.
The other half are pixels that needed exact arithmetic in the aperture's own hogel: ties, edges,
close surfaces.
"""

from __future__ import annotations

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

from xfrustum.compare.rational import ExactRows, first_by_brute_force, first_on_lines
from xfrustum.reference import Reference
from xfrustum.reference.lines import PixelLines, RayBundle, TileLines, crossed_frustum
from xfrustum.reference.llvm import worker_count
from xfrustum.reference.rays.rays import ExactMesh, FirstHits, RayBatch
from xfrustum.reference.tracers import EmbreeTracer
from xfrustum.scenes import Aperture, Frustum, InputError, Plate, Scene, SceneObject, open_scene
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.library import builtin, hard_cases
from xfrustum.scenes.model.images import Certainty, DirectionImage, HogelImage
from xfrustum.scenes.plate import PlateTile

MAX_LISTED = 5  #: largest number of disagreements of one image that are described one by one
UNIT_ROUNDOFF = 2.0**-53  #: largest relative error of one rounding to a double

PLANE_ROUNDINGS = 16
"""Roundings in each of the two dot products of s = (q . n) / (d . n).

They are relative to the sum of absolute products. A component of n has 4 roundings: 1 for each of
the two differences of coordinates in a product, 1 for the product, and 1 for the difference of two
products. q is a difference, and its product with n has 2 more. The sum of three products has 2
more: 8, in any order. The number is doubled to cover terms of second order and the rounding of this
bound."""


@dataclass(frozen=True, kw_only=True)
class Disagreement:
    """A wrong pixel of the reference, with the exact result and the result of the reference."""

    row: int
    column: int
    about: str  #: "triangle", "certainty", "companions" or "position"
    expected: str
    got: str


@dataclass(frozen=True, kw_only=True, eq=False)
class ImageLines:
    """The line of every pixel of an image: P(s) = point + s d."""

    points: Floats  #: (H, W, 3)
    directions: Floats  #: (H, W, 3) d

    @classmethod
    def from_bundle(cls, bundle: RayBundle) -> ImageLines:
        """Return the lines of a hogel, which share one point."""
        d = bundle.directions()
        return cls(points=np.broadcast_to(np.asarray(bundle.center), d.shape), directions=d)


def disagreements(
    image: HogelImage | DirectionImage, exact: ExactRows, lines: ImageLines, triangles: Floats
) -> tuple[Mask, tuple[Disagreement, ...]]:
    """Compare every pixel of a reference image with the exact results for all its rows.

    A pixel is wrong if its triangle differs; if its certainty is wrong about a tie, or is
    `UNEXAMINED`; if other triangles are tied; or if its position is off its line. Along the line,
    the position may differ from the exact position by `position_bound`, or by one rounding if the
    reference claims rational arithmetic. Returns (H, W) pixels with any disagreement, and
    descriptions of the first few.
    """
    assert image.certainty is not None and image.tied_triangles is not None
    shape = exact.triangle.shape
    expected, got = (
        set(map(tuple, exact.ties.tolist())),
        set(map(tuple, image.tied_triangles.tolist())),
    )
    tie, tied_triangles = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_)
    for mask, places in ((tie, expected), (tied_triangles, got ^ expected)):
        for row, column, _ in places:
            mask[row, column] = True
    claimed = image.certainty == Certainty.TIE
    wrong_by_kind: dict[str, Mask] = {
        "triangle": image.triangle != exact.triangle,
        "certainty": (claimed != tie) | (image.certainty == Certainty.UNEXAMINED),
        "companions": tied_triangles,
        "position": _misplaced(image, exact, lines, triangles),
    }

    def described(about: str, pixel: tuple[int, int]) -> Disagreement:
        """Describe the exact result and the reference's result."""
        tied, marked = (
            sorted(number for *at, number in ties if tuple(at) == pixel) for ties in (expected, got)
        )
        assert image.certainty is not None
        words = {
            "triangle": (str(exact.triangle[pixel]), str(image.triangle[pixel])),
            "certainty": (
                "tie" if tied else "no tie",
                Certainty(image.certainty[pixel]).name.lower(),
            ),
            "companions": (str(tied), str(marked)),
            "position": (f"s = {exact.s[pixel]!r}", f"position {image.position[pixel].tolist()}"),
        }[about]
        return Disagreement(
            row=pixel[0], column=pixel[1], about=about, expected=words[0], got=words[1]
        )

    pixels = [
        (about, (row, column))
        for about, mask in wrong_by_kind.items()
        for row, column in np.argwhere(mask)
    ]
    listed = tuple(
        described(about, (int(row), int(column))) for about, (row, column) in pixels[:MAX_LISTED]
    )
    return np.logical_or.reduce(list(wrong_by_kind.values())), listed


def _misplaced(
    image: HogelImage | DirectionImage, exact: ExactRows, lines: ImageLines, triangles: Floats
) -> Mask:
    """Return the pixels (H, W) whose position is not where the line meets the exact triangle."""
    assert image.certainty is not None
    mask: Mask = np.isfinite(image.position).any(axis=-1) != (exact.triangle >= 0)
    same = (image.triangle == exact.triangle) & (exact.triangle >= 0)
    d, s, center = lines.directions[same], exact.s[same], lines.points[same]
    allowed = position_bound(triangles[exact.triangle[same]] - center[:, None], d, s)
    allowed = np.where(image.certainty[same] == Certainty.EXACT, UNIT_ROUNDOFF * np.abs(s), allowed)
    # The position, center + s d, has two more roundings, and the exact s was rounded once. A factor
    # of 8 covers these and the same operations in this check.
    reach = np.abs(center) + np.abs(s[:, None] * d)
    off = np.abs(image.position[same] - (center + s[:, None] * d))
    mask[same] |= ~(off <= allowed[:, None] * np.abs(d) + 8 * UNIT_ROUNDOFF * reach).all(axis=1)
    return mask


def position_bound(corners: Floats, d: Floats, s: Floats) -> Floats:
    """Return the largest error (N,) of an s that was computed in double precision.

    `corners` (N, 3, 3) are the corners of the triangles met, relative to the center. d (N, 3) are
    the directions, and s (N,) are the rounded exact values. If rounding leaves the sign of d . n
    undetermined, s needs rational arithmetic, and the bound allows only the rounding of an exact s.
    """
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    magnitude = np.stack(
        [
            np.abs(a[:, i] * b[:, j]) + np.abs(a[:, j] * b[:, i])
            for i, j in ((1, 2), (2, 0), (0, 1))
        ],
        axis=1,
    )
    rounding = PLANE_ROUNDINGS * UNIT_ROUNDOFF
    offset_error = rounding * np.sum(np.abs(corners[:, 0]) * magnitude, axis=1)
    slope_error = rounding * np.sum(np.abs(d) * magnitude, axis=1)
    slope = np.abs(np.sum(np.cross(a, b) * d, axis=1)) - slope_error
    decidable = slope > 0
    error = (offset_error + np.abs(s) * slope_error) / np.where(decidable, slope, 1.0)
    return np.where(decidable, error, 0.0) + 2 * UNIT_ROUNDOFF * np.abs(s)


TILE = (5, 3)  #: largest numbers of columns and rows of hogels about an aperture

DIRECTIONS, QUICK_DIRECTIONS = 12, 3
"""Largest number of pixels per scene that are spread over the film, and of open pixels."""

CHANNELS = ("triangle", "position", "normal", "certainty")
"""Arrays that must be equal, bit by bit, by direction and by hogel."""


@dataclass(frozen=True, kw_only=True)
class DirectionCheck:
    """Comparison of images by direction of one tile."""

    scene: str
    columns: tuple[int, int]  #: first and last column of the tile
    rows: tuple[int, int]
    directions: int  #: number of images
    pixels: int
    open: int  #: pixels that the filter did not prove: decided exactly, or ties
    differing: int  #: pixels whose bits differ from the images of their hogels
    wrong: int  #: pixels with another result in integer arithmetic
    disagreements: tuple[Disagreement, ...]  #: the first few; rows and columns are hogels
    seconds: float


def check_directions(
    name: str, scene: Scene, aperture: Aperture, reference: type[Reference], *, quick: bool
) -> DirectionCheck:
    """Compare images by direction of a tile with its hogels and with integer arithmetic."""
    started = time.perf_counter()
    tile = _tile_about(aperture, scene)
    truth = reference(scene)
    hogels = [
        [truth.trace(scene.plate.aperture(column, row), colored=False) for column in tile.columns]
        for row in tile.rows
    ]
    own = hogels[tile.rows.index(aperture.row)][tile.columns.index(aperture.column)]
    pixels = _pixels(own, QUICK_DIRECTIONS if quick else DIRECTIONS)
    lines = TileLines(scene.frustum, tile)
    listed: list[Disagreement] = []
    compared, still_open, differing, wrong = 0, 0, 0, 0
    for image in truth.by_directions(tile, pixels, colored=False):
        grid = lines.of_pixel(image.pixel)
        exact = _turned(first_on_lines(scene.triangles, grid), grid)
        disagree, described = disagreements(image, exact, _image_lines(grid), scene.triangles)
        compared += image.triangle.size
        still_open += int(np.count_nonzero(image.certainty != Certainty.PROVEN))
        differing += int(np.count_nonzero(differs(image, hogels)))
        wrong += int(np.count_nonzero(disagree))
        listed += described
    return DirectionCheck(
        scene=name,
        columns=(tile.columns[0], tile.columns[-1]),
        rows=(tile.rows[0], tile.rows[-1]),
        directions=len(pixels),
        pixels=compared,
        open=still_open,
        differing=differing,
        wrong=wrong,
        disagreements=tuple(listed[:5]),
        seconds=time.perf_counter() - started,
    )


def differs(image: DirectionImage, hogels: Sequence[Sequence[HogelImage]]) -> Mask:
    """Return the hogels (rows, columns) whose pixel differs in a bit from an image by direction."""
    place = image.pixel[::-1]
    mask = np.zeros(image.triangle.shape, dtype=np.bool_)
    tied = {tuple(hogel): set[int]() for hogel in image.tied_triangles[:, :2].tolist()}
    for row, column, triangle in image.tied_triangles.tolist():
        tied[row, column].add(triangle)
    for (row, column), _ in np.ndenumerate(mask):
        hogel = hogels[row][column]
        assert hogel.tied_triangles is not None
        here = (hogel.tied_triangles[:, :2] == place).all(axis=1)
        mask[row, column] = set(hogel.tied_triangles[here, 2].tolist()) != tied.get(
            (row, column), set()
        ) or any(
            # As bytes, -0 and 0 differ, and a NaN equals itself.
            getattr(image, name)[row, column].tobytes() != getattr(hogel, name)[place].tobytes()
            for name in CHANNELS
        )
    return mask


def _tile_about(aperture: Aperture, scene: Scene) -> PlateTile:
    """Return the tile around an aperture, shifted or cut to lie within the plate."""
    ranges = []
    for at, size, hogels in zip(aperture.index, TILE, scene.plate.hogels, strict=True):
        count = min(size, hogels)
        first = min(max(at - size // 2, 0), hogels - count)
        ranges.append(range(first, first + count))
    return PlateTile(plate=scene.plate, columns=ranges[0], rows=ranges[1])


def _pixels(image: HogelImage, count: int) -> list[tuple[int, int]]:
    """Return up to `count` pixels (column, row) spread over a film, and up to `count` open ones."""
    assert image.certainty is not None
    numbers = []
    for some in (np.arange(image.triangle.size), np.flatnonzero(image.certainty)):
        step = len(some) / max(count, 1)
        # The middles of equal parts.
        places = ((np.arange(min(count, len(some))) + 0.5) * max(step, 1.0)).astype(np.int64)
        numbers += some[places].tolist()
    width = image.triangle.shape[1]
    return [divmod(number, width)[::-1] for number in dict.fromkeys(numbers)]


def _turned(exact: ExactRows, lines: PixelLines) -> ExactRows:
    """Return results in the order of the tile; lines are in this order or reversed."""
    if lines.step > 0:
        return exact
    width, height = lines.resolution
    ties = exact.ties.copy()
    ties[:, :2] = [height - 1, width - 1] - ties[:, :2]
    return ExactRows(triangle=exact.triangle[::-1, ::-1], s=exact.s[::-1, ::-1], ties=ties)


def _image_lines(lines: PixelLines) -> ImageLines:
    turned = (slice(None, None, lines.step),) * 2
    return ImageLines(points=lines.points()[turned], directions=lines.directions()[turned])


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
    """All checked images, and the sphere, which is None if it was not checked."""

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
    shared = Path(__file__).resolve().parents[2] / "shared" / "scenes"
    files = (str(path) for path in sorted(shared.glob("*.toml")))
    return [*builtin.names(), *hard_cases.names(giants=False), *files]


def _views(name: str, quick: bool) -> Iterator[tuple[str, Scene, Aperture]]:
    """Yield name, scene and aperture of each checked image; sizes suit integer arithmetic."""
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
