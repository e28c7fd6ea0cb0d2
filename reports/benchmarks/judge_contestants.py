"""Contestants for a race to judged hogels: streams, loops, and what they cannot do without."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from trimesh import Trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from xfrustum.compare.judging.judge import Judge
from xfrustum.compare.metrics.comparison import ComparisonNumbers, compare_images
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.devices.bands import BUSY_PIXELS, in_parallel
from xfrustum.reference.devices.dr_jit import backend
from xfrustum.reference.lines.lines import Pencil, crossed_frustum, pixel_places
from xfrustum.reference.tracers.bare_mitsuba import bare_intersection
from xfrustum.reference.tracers.entry import ray_origins
from xfrustum.reference.tracers.proposals import proposed
from xfrustum.scenes.arrays import Floats, Numbers
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.library.globes import globes
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

RELATIVE_NEAR = 1e-3
"""The step back from the plate, as a fraction of the reach."""

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

Run = Callable[[], object]
"""Answers for all apertures, and returns when that is done."""

GLOBES_PLATE = (9, 9)
"""Columns and rows of the plate that globes are seen through, which otherwise has a single aperture."""


def default_names() -> tuple[str, ...]:
    """Return the built-in car and, where the folder of test data is beside the checkout, its car body."""
    beside = Path(__file__).resolve().parents[3] / "shared" / "scenes" / "beetle.toml"
    return ("car", str(beside)) if beside.exists() else ("car",)


def globes_through_a_plate(triangles: int) -> Scene:
    """Return globes of so many triangles, and a plate of several hogels.

    Raises
    ------
    InputError
        No globe has that many triangles.
    """
    scene = globes(triangles, (1, 1))
    return replace(scene, plate=replace(scene.plate, hogels=GLOBES_PLATE))


def sized(scene: Scene, resolution: int) -> Scene:
    """Return a scene with a square film."""
    return replace(scene, frustum=replace(scene.frustum, resolution=(resolution, resolution)))


def settings_of(scene: Scene) -> DoubleFrustum:
    """Return the settings that all contestants draw with."""
    return DoubleFrustum(near=RELATIVE_NEAR * scene.frustum.longest_reach)


def spread_over(scene: Scene, count: int) -> list[Aperture]:
    """Return so many apertures, evenly spread over the plate row by row; some twice where it has fewer.

    Raises
    ------
    InputError
        The number is not positive.
    """
    if count < 1:
        raise InputError("bench: hogels must be positive; give such as 9")
    columns, rows = scene.plate.hogels
    numbers = np.linspace(0, columns * rows - 1, count).astype(int)
    return [scene.plate.aperture(int(number) % columns, int(number) // columns) for number in numbers]


def loop_of(
    reference: Reference, rasterizer: Rasterizer, apertures: Sequence[Aperture]
) -> list[ComparisonNumbers]:
    """Judge hogels one after the other."""
    settings, found = settings_of(reference.scene), []
    for aperture in apertures:
        truth = reference.trace(aperture)
        drawn = rasterizer.render(aperture, settings, normals=False, color=False)
        found.append(compare_images(truth, drawn, reference, radiance=False).numbers)
    return found


def stream_of(judge: Judge, apertures: Sequence[Aperture]) -> list[ComparisonNumbers]:
    """Judge the same hogels as a stream."""
    stream = judge.stream(apertures, [settings_of(judge.scene)], radiance=False)
    return [hogel.drawings[0].comparison for hogel in stream]


class PlainLoop:
    """The loop that a user would write with trimesh and NumPy; nothing that it finds is proven.

    Parameters
    ----------
    scene
        Scene with at least one triangle.
    rasterizer
        Rasterizer of the scene.
    """

    def __init__(self, scene: Scene, rasterizer: Rasterizer) -> None:
        self._scene, self._rasterizer = scene, rasterizer
        self._mesh = RayMeshIntersector(Trimesh(scene.vertices, scene.faces, process=False))
        self._object_of_number = np.append(scene.object_of_triangle, np.int32(NOTHING))

    def judge(self, apertures: Sequence[Aperture]) -> list[tuple[float, float]]:
        """Return the share of pixels with another object and the p99 of displacement of each hogel."""
        settings = settings_of(self._scene)
        return [
            self._judged(one, self._rasterizer.render(one, settings, normals=False, color=False))
            for one in apertures
        ]

    def _judged(self, aperture: Aperture, drawn: HogelImage) -> tuple[float, float]:
        pencil = crossed_frustum(self._scene.frustum, aperture)
        directions = pencil.directions().reshape(-1, 3)
        origins = ray_origins(self._scene, np.asarray(pencil.center), directions, pencil.s_range[0])
        first = self._mesh.intersects_first(origins, directions)
        wrong = self._object_of_number[first] != drawn.object.ravel()
        return float(wrong.mean()), _displacement_p99(drawn, pencil)


def _displacement_p99(drawn: HogelImage, pencil: Pencil) -> float:
    """Return the 99th percentile of the distance between where points are drawn and where they belong, px."""
    columns, rows = pencil.resolution
    point = drawn.position.reshape(-1, 3).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        place = pixel_places(point, pencil)
    row, column = np.divmod(np.arange(rows * columns), columns)
    moved = np.hypot(place[:, 0] - column, place[:, 1] - row)
    moved = moved[np.isfinite(moved)]
    return float(np.percentile(moved, 99)) if moved.size else 0.0


@contextmanager
def judge_contestants(scene: Scene, apertures: Sequence[Aperture]) -> Iterator[dict[str, Run]]:
    """Open the contestants that there are here, by the names in `MEANINGS`; leaving frees them.

    Parameters
    ----------
    scene
        Scene with at least one triangle.
    apertures
        Hogels that each run answers for.

    Raises
    ------
    InputError
        There is no usable OpenGL.
    """
    with ExitStack() as stack:
        judge = stack.enter_context(Judge(scene))
        rasterizer = stack.enter_context(Rasterizer(scene))
        plain, settings = PlainLoop(scene, rasterizer), settings_of(scene)
        found: dict[str, Run] = {
            STREAM: lambda: stream_of(judge, apertures),
            LOOP: lambda: loop_of(judge.reference, rasterizer, apertures),
            PLAIN: lambda: plain.judge(apertures),
            RENDER: lambda: _exhaust(
                rasterizer.render(one, settings, normals=False, color=False) for one in apertures
            ),
        }
        if not backend().scalar:
            bare = bare_intersection(scene, *_lines(scene, scene.plate.middle))
            found[MITSUBA] = lambda: _exhaust(bare() for _ in apertures)
        yield found


def _lines(scene: Scene, aperture: Aperture) -> tuple[Floats, Floats]:
    """Return origins and directions of an aperture's lines, (N, 3) each."""
    pencil = crossed_frustum(scene.frustum, aperture)
    directions = pencil.directions().reshape(-1, 3)
    return ray_origins(scene, np.asarray(pencil.center), directions, pencil.s_range[0]), directions


@contextmanager
def judging_stages(scene: Scene, aperture: Aperture) -> Iterator[dict[str, Run]]:
    """Open parts of judging one hogel whose differences are the times of `STAGES`; leaving frees them.

    The parts are named by the stages that they end with: `POINTS` is a whole truth, `READ` a whole frame and
    `RADIANCE` a comparison with colors.
    """
    with Rasterizer(scene) as rasterizer:
        reference, settings = Reference(scene), settings_of(scene)
        pencil = crossed_frustum(scene.frustum, aperture)
        truth = reference.trace(aperture)
        frame = rasterizer.render(aperture, settings, normals=False)

        def second_opinion(rows: range) -> Numbers:
            return proposed(reference.tracer, scene, [pencil], rows)

        yield {
            DECIDING: lambda: _exhaust(reference.decide(aperture)),
            SECOND_OPINION: lambda: _exhaust(
                in_parallel(second_opinion, pencil.resolution, least_pixels=BUSY_PIXELS)
            ),
            POINTS: lambda: reference.trace(aperture),
            DRAWN: lambda: rasterizer.draw_only(aperture, settings),
            READ: lambda: rasterizer.render(aperture, settings),
            COMPARING: lambda: compare_images(truth, frame, reference, radiance=False),
            RADIANCE: lambda: compare_images(truth, frame, reference),
        }


def _exhaust(images: Iterable[object]) -> None:
    deque(images, maxlen=0)
