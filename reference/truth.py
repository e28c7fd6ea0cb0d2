"""The reference: true images, every pixel proven, decided exactly or named a tie."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.certify import FirstSurfaces, first_surfaces
from xfrustum.reference.embree import EmbreeTracer
from xfrustum.reference.lines import Pencil, crossed_frustum, offset_pinholes
from xfrustum.reference.shading import shaded
from xfrustum.reference.threads import worker_count
from xfrustum.reference.visibility import hidden
from xfrustum.scenes.double_frustum import Camera, DoubleFrustum
from xfrustum.scenes.hogel_image import NOTHING, HogelCamera, HogelImage
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.scene import Scene

TRACERS = ("embree",)
"""Names of the tracers that can be asked for."""

BAND_PIXELS = 1 << 17
"""Pixels decided at once; with `PENDING_PAIRS` it bounds the memory, whatever the image's size."""


class Reference:
    """The ground truth of a scene: what its crossed frusta really show.

    Parameters
    ----------
    scene
        Its acceleration structure is built once.
    tracer
        One of `TRACERS`: who traces first, before `certify` has the last word.
    """

    def __init__(self, scene: Scene, tracer: str = "embree") -> None:
        if tracer not in TRACERS:
            raise ValueError(f"tracer must be one of {TRACERS}, not {tracer!r}")
        self.scene = scene

    @cached_property
    def _tracer(self) -> EmbreeTracer:
        return EmbreeTracer(self.scene)

    @property
    def versions(self) -> dict[str, str]:
        """Names and versions of what decides the truth."""
        return self._tracer.versions

    def trace(self, aperture: Aperture) -> HogelImage:
        """Return the true image of an aperture (paper, section 3: one frustum that crosses itself)."""
        pencil = crossed_frustum(self.scene.frustum, aperture)
        bands = list(self._decided(pencil))
        return self._image(self._camera(aperture, pencil, None), [(pencil, bands)])

    def trace_bands(self, aperture: Aperture) -> Iterator[tuple[int, HogelImage]]:
        """Yield the true image in bands, (first row, image of some rows), in bounded memory."""
        pencil = crossed_frustum(self.scene.frustum, aperture)
        camera = self._camera(aperture, pencil, None)
        row = 0
        for band in self._decided(pencil):
            yield row, self._image(camera, [(pencil, [band])], row)
            row += len(band.triangle)

    def trace_model(self, aperture: Aperture, settings: DoubleFrustum) -> HogelImage:
        """Return what the offset cameras C and C* would draw without any rounding, C* over C."""
        settings.check_against(self.scene.frustum)
        pencil = crossed_frustum(self.scene.frustum, aperture)
        c, c_star = offset_pinholes(self.scene.frustum, aperture, settings.near)
        drawn = {Camera.BOTH: (c, c_star), Camera.C: (c,), Camera.C_STAR: (c_star,)}[settings.camera]
        layers = [(camera, list(self._decided(camera))) for camera in drawn]
        return self._image(self._camera(aperture, pencil, settings), layers)

    def hidden(
        self, aperture: Aperture, points: NDArray[np.float64], tolerance: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Return which points the true frustum of an aperture does not see; see `visibility.hidden`."""
        pencil = crossed_frustum(self.scene.frustum, aperture)
        return hidden(self._tracer, self.scene, pencil, points, tolerance)

    def _decided(self, pencil: Pencil) -> Iterator[FirstSurfaces]:
        """Decide an image band by band, on all processors."""
        width, height = pencil.resolution
        workers = worker_count()
        rows = max(1, min(BAND_PIXELS // width, -(-height // workers)))
        bands = [range(start, min(start + rows, height)) for start in range(0, height, rows)]
        triangles = self.scene.triangles
        with ThreadPoolExecutor(workers) as pool:
            # No more bands under way than workers, so that a slow reader bounds the memory.
            for start in range(0, len(bands), workers):
                yield from pool.map(
                    lambda band: first_surfaces(triangles, pencil, band), bands[start : start + workers]
                )

    def _camera(self, aperture: Aperture, pencil: Pencil, settings: DoubleFrustum | None) -> HogelCamera:
        return HogelCamera(
            aperture=aperture,
            resolution=pencil.resolution,
            shear=pencil.shear,
            half_extent=pencil.half_extent,
            reach=self.scene.frustum.reach,
            scene=self.scene.source,
            scene_hash=self.scene.content_hash,
            renderer="reference",
            settings=settings,
        )

    def _image(
        self,
        camera: HogelCamera,
        layers: list[tuple[Pencil, list[FirstSurfaces]]],
        first_row: int = 0,
    ) -> HogelImage:
        """Overlay decided layers, the last on top, and say what their surfaces are."""
        for pencil, bands in layers:
            upper_triangle = np.concatenate([band.triangle for band in bands])
            upper_certainty = np.concatenate([band.certainty for band in bands])
            s = np.concatenate([band.s for band in bands])
            rows = slice(first_row, first_row + len(s))
            upper_position = np.asarray(pencil.center) + s[..., None] * pencil.directions(rows)
            if pencil is layers[0][0]:
                triangle, certainty, position = upper_triangle, upper_certainty, upper_position
            else:
                on_top = upper_triangle != NOTHING
                # Where the upper layer shows nothing, both layers' decisions were needed.
                certainty = np.where(on_top, upper_certainty, np.maximum(certainty, upper_certainty))
                triangle = np.where(on_top, upper_triangle, triangle)
                position = np.where(on_top[..., None], upper_position, position)
        covered = triangle != NOTHING
        objects = np.full(triangle.shape, NOTHING, dtype=np.int32)
        objects[covered] = self.scene.object_of_triangle[triangle[covered]]
        normals = np.full((*triangle.shape, 3), np.nan)
        normals[covered] = self.scene.normals[triangle[covered]]
        return HogelImage(
            camera=camera,
            triangle=triangle,
            object=objects,
            position=position,
            normal=normals,
            color=shaded(normals, layers[0][0].directions(slice(first_row, first_row + len(triangle)))),
            certainty=certainty,
            companions=np.concatenate([band.companions for _, bands in layers for band in bands]),
        )
