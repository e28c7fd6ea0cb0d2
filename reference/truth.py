"""The reference: true images, every pixel proven, decided exactly or named a tie."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.certify import Certifier, FirstSurfaces
from xfrustum.reference.embree import EmbreeTracer
from xfrustum.reference.lines import Pencil, crossed_frustum, model_cameras
from xfrustum.reference.mitsuba_tracer import MitsubaTracer
from xfrustum.reference.proposals import proposed
from xfrustum.reference.runner_up import RunnersUp
from xfrustum.reference.shading import shaded
from xfrustum.reference.threads import worker_count
from xfrustum.reference.tracer import Tracer
from xfrustum.reference.visibility import SurfacePoints, hidden
from xfrustum.scenes.double_frustum import DoubleFrustum
from xfrustum.scenes.hogel_image import NOTHING, Certainty, HogelCamera, HogelImage, stacked
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.scene import Scene

TRACERS = ("embree", "mitsuba")
"""Names of the tracers that can be asked for."""

Band = TypeVar("Band")

BAND_PIXELS = 1 << 19
"""Pixels decided at once: bounds the memory, about 400 bytes a pixel, whatever the image's size."""

UNDIVIDED_PIXELS = 1 << 18
"""Deciding alone runs compiled on all processors anyway: smaller bands only add launches."""


class Reference:
    """The ground truth of a scene: what its crossed frusta really show.

    Parameters
    ----------
    scene
        Its acceleration structure is built once.
    tracer
        One of `TRACERS`: who gives the second opinion, before `certify` has the last word.
    """

    def __init__(self, scene: Scene, tracer: str = "embree") -> None:
        if tracer not in TRACERS:
            raise ValueError(f"tracer must be one of {TRACERS}, not {tracer!r}")
        self.scene = scene
        self._tracer_name = tracer

    @cached_property
    def tracer(self) -> Tracer:
        """The tracer, built when first needed."""
        return MitsubaTracer(self.scene) if self._tracer_name == "mitsuba" else EmbreeTracer(self.scene)

    @cached_property
    def _object_of_number(self) -> NDArray[np.int32]:
        """Object numbers by triangle number; the last, which `NOTHING` finds, is `NOTHING`."""
        return np.append(self.scene.object_of_triangle, np.int32(NOTHING))

    @property
    def versions(self) -> dict[str, str]:
        """Names and versions of what decides the truth."""
        return self.tracer.versions

    def trace(self, aperture: Aperture) -> HogelImage:
        """Return the true image of an aperture (paper, section 3: one frustum that crosses itself)."""
        return stacked(list(self.trace_bands(aperture)))

    def trace_bands(self, aperture: Aperture) -> Iterator[HogelImage]:
        """Yield the true image in bands of rows, from the top, in bounded memory."""
        pencil = crossed_frustum(self.scene.frustum, aperture)
        tracer, triangles = self.tracer, self.scene.triangles
        certifier = Certifier(triangles, pencil)

        def band(rows: range) -> HogelImage:
            decided = certifier.decide(rows)
            image = self._image(self._camera(aperture, pencil, None), pencil, rows, [(pencil, decided)])
            second_opinion = proposed(tracer, self.scene, pencil, rows)
            overruled = (second_opinion != decided.triangle) & (decided.certainty != Certainty.TIE)
            return replace(image, overruled=overruled)

        yield from _in_parallel(band, pencil.resolution)

    def decide(self, aperture: Aperture) -> Iterator[FirstSurfaces]:
        """Yield who is first along each line, and nothing else, in bands of rows from the top."""
        pencil = crossed_frustum(self.scene.frustum, aperture)
        certifier = Certifier(self.scene.triangles, pencil)
        yield from _in_parallel(certifier.decide, pencil.resolution, least_pixels=UNDIVIDED_PIXELS)

    def trace_model(self, aperture: Aperture, settings: DoubleFrustum) -> HogelImage:
        """Return what the cameras that settings ask for would draw without any rounding."""
        settings.check_against(self.scene.frustum)
        pencil = crossed_frustum(self.scene.frustum, aperture)
        cameras = model_cameras(self.scene.frustum, aperture, settings)
        certifiers = [(camera.pencil, Certifier(self.scene.triangles, camera.pencil)) for camera in cameras]

        def band(rows: range) -> HogelImage:
            layers = [(camera, certifier.decide(rows)) for camera, certifier in certifiers]
            return self._image(self._camera(aperture, pencil, settings), pencil, rows, layers)

        return stacked(list(_in_parallel(band, pencil.resolution)))

    def gaps(self, aperture: Aperture) -> NDArray[np.float64]:
        """Return how far behind each pixel's first surface the same camera sees the next one, (H, W).

        In |z|, scene units: for C, which keeps the nearest surface behind the plate, to the second
        nearest; for C*, which keeps the farthest before the plate, to the second farthest. Infinite where
        there is none on that side of the plate.

        From the narrow phase of the truth, in double precision: no triangle is left out that a line
        surely meets, and each gap is off by no more than the bounds of rounding of its two surfaces, some
        1e-15 of |z| unless seen edge-on. Surfaces closer than that count as one, so that a point shared by
        two triangles is not behind itself. A line that passes an edge within rounding, where coverage would
        have to be decided in integers, is not taken to meet that triangle.
        """
        pencil = crossed_frustum(self.scene.frustum, aperture)
        runners_up = RunnersUp(self.scene.triangles, pencil)
        bands = _in_parallel(runners_up.gaps, pencil.resolution, least_pixels=UNDIVIDED_PIXELS)
        return np.concatenate(list(bands))

    def hidden(self, aperture: Aperture, points: SurfacePoints) -> NDArray[np.bool_]:
        """Return which points the true frustum of an aperture does not see; see `visibility.hidden`."""
        pencil = crossed_frustum(self.scene.frustum, aperture)
        return hidden(self.tracer, self.scene, pencil, points)

    def camera(self, aperture: Aperture) -> HogelCamera:
        """Return the true frustum of an aperture, as its image carries it."""
        return self._camera(aperture, crossed_frustum(self.scene.frustum, aperture), None)

    def _camera(self, aperture: Aperture, pencil: Pencil, settings: DoubleFrustum | None) -> HogelCamera:
        return HogelCamera(
            aperture=aperture,
            resolution=pencil.resolution,
            shear=pencil.shear,
            half_extent=pencil.half_extent,
            reach=self.scene.frustum.reach,
            scene=self.scene.source,
            scene_hash=self.scene.content_hash,
            renderer="reference" if settings is None else "reference, offset cameras",
            settings=settings,
        )

    def _image(
        self, camera: HogelCamera, pencil: Pencil, rows: range, layers: list[tuple[Pencil, FirstSurfaces]]
    ) -> HogelImage:
        """Overlay decided layers, the last on top, and say what their surfaces are."""
        some = slice(rows.start, rows.stop)
        directions = pencil.directions(some)
        triangle = np.full(directions.shape[:2], NOTHING, dtype=np.int32)
        certainty = np.zeros(directions.shape[:2], dtype=np.uint8)
        position = np.full(directions.shape, np.nan)
        companions = np.zeros((0, 3), dtype=np.int64)
        for layer, decided in layers:
            on_top = decided.triangle != NOTHING
            # Where a layer shows nothing, what is seen rests on both decisions.
            certainty = np.where(on_top, decided.certainty, np.maximum(certainty, decided.certainty))
            triangle = np.where(on_top, decided.triangle, triangle)
            points = np.asarray(layer.center) + decided.s[..., None] * layer.directions(some)
            position = np.where(on_top[..., None], points, position)
            # Ties of what is now covered are nobody's companions any more.
            covered_now = on_top[companions[:, 0] - rows.start, companions[:, 1]]
            companions = np.concatenate((companions[~covered_now], decided.companions))
        normals = np.full(directions.shape, np.nan)
        covered = triangle != NOTHING
        normals[covered] = self.scene.normals[triangle[covered]]
        return HogelImage(
            camera=camera,
            triangle=triangle,
            object=self._object_of_number[triangle],
            position=position,
            normal=normals,
            color=shaded(normals, directions),
            certainty=certainty,
            companions=companions,
        )


def _in_parallel(
    band: Callable[[range], Band], resolution: tuple[int, int], *, least_pixels: int = 1
) -> Iterator[Band]:
    """Yield an image's bands in order, made on all processors; none but the last is smaller than asked."""
    width, height = resolution
    workers = worker_count()
    rows = max(1, min(BAND_PIXELS // width, max(-(-height // workers), -(-least_pixels // width))))
    bands = [range(start, min(start + rows, height)) for start in range(0, height, rows)]
    with ThreadPoolExecutor(workers) as pool:
        # No more bands under way than workers, so that a slow reader bounds the memory.
        for start in range(0, len(bands), workers):
            yield from pool.map(band, bands[start : start + workers])
