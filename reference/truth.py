"""The reference: true images, every pixel proven, decided exactly or named a tie."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.averages import AVERAGED_PIXELS, averages, mean_color, points_per_side
from xfrustum.reference.bands import UNDIVIDED_PIXELS, in_parallel
from xfrustum.reference.certify import Certifier, FirstSurfaces
from xfrustum.reference.convergence import TOLERANCE, Converged, converged
from xfrustum.reference.embree import EmbreeTracer
from xfrustum.reference.lines import Pencil, crossed_frustum, model_cameras
from xfrustum.reference.mitsuba_tracer import MitsubaTracer
from xfrustum.reference.proposals import proposed
from xfrustum.reference.runner_up import RunnersUp
from xfrustum.reference.shading import Hits, Shader
from xfrustum.reference.tracer import Tracer
from xfrustum.reference.visibility import SurfacePoints, hidden
from xfrustum.scenes.double_frustum import DoubleFrustum
from xfrustum.scenes.effects import Effect
from xfrustum.scenes.hogel_image import NOTHING, Certainty, HogelCamera, HogelImage, stacked
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.sampling import Sampling, sub_apertures
from xfrustum.scenes.scene import Scene

TRACERS = ("embree", "mitsuba")
"""Names of the tracers that can be asked for."""


class Reference:
    """The ground truth of a scene: what its crossed frusta really show.

    Parameters
    ----------
    scene
        Its acceleration structure is built once.
    tracer
        One of `TRACERS`: who gives the second opinion, before `certify` has the last word.
    effects
        What of the light is evaluated; None for what the scene calls for.
    """

    def __init__(
        self, scene: Scene, tracer: str = "embree", effects: frozenset[Effect] | None = None
    ) -> None:
        if tracer not in TRACERS:
            raise ValueError(f"tracer must be one of {TRACERS}, not {tracer!r}")
        self.scene = scene
        self._tracer_name = tracer
        self._shader = Shader(scene, effects)

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

    def trace(self, aperture: Aperture, sampling: Sampling | None = None) -> HogelImage:
        """Return the true image of an aperture (paper, section 3: one frustum that crosses itself).

        Parameters
        ----------
        sampling
            What color is the mean of; None for the scene's own.
        """
        return stacked(list(self.trace_bands(aperture, sampling)))

    def trace_bands(self, aperture: Aperture, sampling: Sampling | None = None) -> Iterator[HogelImage]:
        """Yield the true image in bands of rows, from the top, in bounded memory; see `trace`."""
        sampling = self.scene.sampling if sampling is None else sampling
        pencil = crossed_frustum(self.scene.frustum, aperture)
        tracer, triangles = self.tracer, self.scene.triangles
        certifier = Certifier(triangles, pencil)

        def band(rows: range) -> HogelImage:
            decided = certifier.decide(rows)
            image = self._image(self._camera(aperture, pencil, None), pencil, rows, [(pencil, decided)])
            second_opinion = proposed(tracer, self.scene, pencil, rows)
            overruled = (second_opinion != decided.triangle) & (decided.certainty != Certainty.TIE)
            return replace(image, overruled=overruled)

        if averages(sampling):
            yield from self._averaged(aperture, sampling, band)
        else:
            yield from in_parallel(band, pencil.resolution)

    def _averaged(
        self, aperture: Aperture, sampling: Sampling, band: Callable[[range], HogelImage]
    ) -> Iterator[HogelImage]:
        """Yield bands whose color is a mean: over pixels' boxes, over the aperture (paper, section 6)."""
        apertures = sub_apertures(self.scene.plate, aperture, sampling.aperture)
        width, height = self.scene.frustum.resolution
        size = max(1, AVERAGED_PIXELS // width)
        for start in range(0, height, size):
            rows = range(start, min(start + size, height))
            side = points_per_side(sampling)
            color = mean_color(self.scene, self._shader, apertures, side, rows).astype(np.float32)
            for part in in_parallel(band, (width, height), rows=rows):
                own, color = np.split(color, [len(part.triangle)])
                yield replace(part, color=own)

    def converged(
        self,
        aperture: Aperture,
        tolerance: float = TOLERANCE,
        sampling: Sampling | None = None,
        seed: int = 0,
    ) -> Converged:
        """Return the color of the whole aperture, not of some points of it (paper, section 6).

        Parameters
        ----------
        aperture
            Its middle. It is as large as the pitch of the plate's hogels.
        tolerance
            Root mean square of the standard error over pixels and channels, in radiance, to be reached;
            `Converged.error` says what was reached.
        sampling
            How the pixels' boxes are sampled; None for the scene's own. Its number of sub-apertures
            means nothing here.
        seed
            Another seed gives other, independent points.
        """
        side = points_per_side(self.scene.sampling if sampling is None else sampling)
        rows = range(self.scene.frustum.resolution[1])

        def mean(apertures: Sequence[Aperture]) -> NDArray[np.float64]:
            return mean_color(self.scene, self._shader, apertures, side, rows)

        return converged(mean, self.scene.plate, aperture, tolerance, seed)

    def decide(self, aperture: Aperture) -> Iterator[FirstSurfaces]:
        """Yield who is first along each line, and nothing else, in bands of rows from the top."""
        pencil = crossed_frustum(self.scene.frustum, aperture)
        certifier = Certifier(self.scene.triangles, pencil)
        yield from in_parallel(certifier.decide, pencil.resolution, least_pixels=UNDIVIDED_PIXELS)

    def trace_model(self, aperture: Aperture, settings: DoubleFrustum) -> HogelImage:
        """Return what the cameras that settings ask for would draw without any rounding."""
        settings.check_against(self.scene.frustum)
        pencil = crossed_frustum(self.scene.frustum, aperture)
        cameras = model_cameras(self.scene.frustum, aperture, settings)
        certifiers = [(camera.pencil, Certifier(self.scene.triangles, camera.pencil)) for camera in cameras]

        def band(rows: range) -> HogelImage:
            layers = [(camera, certifier.decide(rows)) for camera, certifier in certifiers]
            return self._image(self._camera(aperture, pencil, settings), pencil, rows, layers)

        return stacked(list(in_parallel(band, pencil.resolution)))

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
        bands = in_parallel(runners_up.gaps, pencil.resolution, least_pixels=UNDIVIDED_PIXELS)
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
        position, seen_along = np.full(directions.shape, np.nan), directions
        companions = np.zeros((0, 3), dtype=np.int64)
        for layer, decided in layers:
            on_top = decided.triangle != NOTHING
            # Where a layer shows nothing, what is seen rests on both decisions.
            certainty = np.where(on_top, decided.certainty, np.maximum(certainty, decided.certainty))
            triangle = np.where(on_top, decided.triangle, triangle)
            along = layer.directions(some)
            points = np.asarray(layer.center) + decided.s[..., None] * along
            position = np.where(on_top[..., None], points, position)
            # What a camera fitted to some height shows, it sees along lines of its own.
            if layer.half_extent != pencil.half_extent:
                seen_along = np.where(on_top[..., None], along, seen_along)
            # Ties of what is now covered are nobody's companions any more.
            covered_now = on_top[companions[:, 0] - rows.start, companions[:, 1]]
            companions = np.concatenate((companions[~covered_now], decided.companions))
        normals, color = np.full(directions.shape, np.nan), np.zeros(directions.shape, dtype=np.float32)
        covered = np.flatnonzero(triangle != NOTHING)
        shown = triangle.ravel()[covered]
        normal = self.scene.normals[shown]
        normals.reshape(-1, 3)[covered] = normal
        position_shown, direction_shown = (v.reshape(-1, 3)[covered] for v in (position, seen_along))
        hits = Hits(triangle=shown, normal=normal, position=position_shown, direction=direction_shown)
        color.reshape(-1, 3)[covered] = self._shader.radiance(hits)
        return HogelImage(
            camera=camera,
            triangle=triangle,
            object=self._object_of_number[triangle],
            position=position,
            normal=normals,
            color=color,
            certainty=certainty,
            companions=companions,
        )
