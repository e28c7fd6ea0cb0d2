"""True images: asks `certify` for each pixel, then adds points, normals and color."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from xfrustum.reference.averages import AVERAGED_PIXELS, averages, mean_color, points_per_side
from xfrustum.reference.certify.certify import Certifier, FirstSurfaces, corner_table
from xfrustum.reference.certify.processors import compiled
from xfrustum.reference.certify.runner_up import RunnersUp
from xfrustum.reference.certify.sides import Sides, sorted_by_side
from xfrustum.reference.convergence import TOLERANCE, Converged, converged
from xfrustum.reference.devices.bands import BUSY_PIXELS, UNDIVIDED_PIXELS, in_parallel, in_turn
from xfrustum.reference.lines.facing import drawn_triangles
from xfrustum.reference.lines.lines import Pencil, crossed_frustum, model_cameras
from xfrustum.reference.pictures import Pictures
from xfrustum.reference.shading.shading import Shader
from xfrustum.reference.sight.clear import ClearTriangles
from xfrustum.reference.sight.sight import Sight, SurfacePoints
from xfrustum.reference.tracers.embree import EmbreeTracer, embree_versions
from xfrustum.reference.tracers.mitsuba_tracer import MitsubaTracer, mitsuba_versions
from xfrustum.reference.tracers.names import TRACERS
from xfrustum.reference.tracers.proposals import SecondOpinion, uncertified
from xfrustum.reference.tracers.tracer import Tracer
from xfrustum.scenes.appearance.sampling import Sampling, sub_apertures
from xfrustum.scenes.arguments import one_of
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.effects import Effect, checked
from xfrustum.scenes.model.hogel_image import NOTHING, HogelCamera, HogelImage, stacked
from xfrustum.scenes.model.rendering import Rendering
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Cull, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

if TYPE_CHECKING:
    from xfrustum.reference.lines.corners_jit import CornerTable

KEPT_TRIANGLES = 1 << 20
"""Most triangles that a reference keeps for all apertures: sorted in some 150 bytes each, and on the device
in up to some 310."""


class Reference:
    """The ground truth of a scene: the true images of its crossed frusta.

    Parameters
    ----------
    scene
        Scene that is asked about.
    tracer
        Name of the tracer that gives a second opinion on every pixel, one of `TRACERS`. The decision is
        always that of `certify`.
    effects
        Effects of light that are evaluated; None for those that the scene calls for.

    Raises
    ------
    InputError
        There is no such tracer, or no such effect.
    """

    def __init__(
        self, scene: Scene, tracer: str = "embree", effects: frozenset[Effect] | None = None
    ) -> None:
        one_of(scene, Scene, "scene")
        if tracer not in TRACERS:
            raise InputError(f"tracer must be one of {', '.join(TRACERS)}, not {tracer!r}")
        self.scene = scene
        self.tracer_name = tracer
        self._shader = Shader(scene, None if effects is None else checked(effects))
        self._pictures = Pictures(scene, self._shader)

    @cached_property
    def tracer(self) -> Tracer:
        """The tracer, built when first needed."""
        return MitsubaTracer(self.scene) if self.tracer_name == "mitsuba" else EmbreeTracer(self.scene)

    @cached_property
    def sight(self) -> Sight:
        """The search for hidden surface points, made ready when first needed."""
        return Sight(self.scene)

    @property
    def decided_by(self) -> str:
        """Name of what decides which surface a pixel shows; see `plain.DECISIONS`."""
        return "certified"

    @property
    def versions(self) -> dict[str, str]:
        """Names and versions of the libraries that the truth rests on, for reports."""
        # The tracer itself need not be built to be named.
        return mitsuba_versions() if self.tracer_name == "mitsuba" else embree_versions()

    def trace(
        self, aperture: Aperture, sampling: Sampling | None = None, *, colored: bool = True
    ) -> HogelImage:
        """Return the true image of an aperture (paper, section 3: one frustum that crosses itself).

        Parameters
        ----------
        aperture
            Aperture of the image.
        sampling
            Points over which color is averaged; None for the scene's own sampling.
        colored
            Whether the image has color; without it, it is made faster.
        """
        one_of(aperture, Aperture, "aperture")
        if not colored:
            return self._whole(aperture, self._kept_sides, colored=False)
        if averages(self.scene.sampling if sampling is None else sampling):
            image = stacked(list(self.trace_bands(aperture, sampling)))
        else:
            image = self._whole(aperture, self._kept_sides)
        return replace(image, rendering=self.rendering(sampling))

    def trace_bands(self, aperture: Aperture, sampling: Sampling | None = None) -> Iterator[HogelImage]:
        """Yield the true image in bands of rows, from the top, in bounded memory; see `trace`."""
        one_of(aperture, Aperture, "aperture")
        sampling = self.scene.sampling if sampling is None else sampling
        pencil = crossed_frustum(self.scene.frustum, aperture)
        band = partial(self._band, aperture, Certifier(self.scene.triangles, pencil))
        if averages(sampling):
            yield from self._averaged(aperture, sampling, band)
        else:
            least = UNDIVIDED_PIXELS if compiled() else BUSY_PIXELS
            yield from in_parallel(band, pencil.resolution, least_pixels=least)

    def stream(self, apertures: Iterable[Aperture], *, colored: bool = True) -> Iterator[HogelImage]:
        """Yield the true images of many apertures in order: those that `trace` returns, in less time.

        Triangles are sorted once for the whole plate. Memory does not grow with the number of apertures.

        Parameters
        ----------
        apertures
            Apertures of the images.
        colored
            Whether the images have color; without it they are made faster.
        """
        if colored and averages(self.scene.sampling):
            yield from map(self.trace, apertures)
            return
        sides = self._kept_sides or self._sorted_sides()
        for aperture in apertures:
            image = self._whole(aperture, sides, colored=colored)
            yield replace(image, rendering=self.rendering() if colored else None)

    @cached_property
    def _kept_sides(self) -> list[Sides] | None:
        """The triangles sorted for all apertures; None where they would take too much memory to be kept."""
        return self._sorted_sides() if len(self.scene.faces) <= KEPT_TRIANGLES else None

    @cached_property
    def _corner_table(self) -> CornerTable | None:
        """The triangles' corners on the device; None where they would take too much memory to be kept."""
        return corner_table(self.scene.triangles) if len(self.scene.faces) <= KEPT_TRIANGLES else None

    def _sorted_sides(self) -> list[Sides]:
        middle = crossed_frustum(self.scene.frustum, self.scene.plate.middle)
        return list(sorted_by_side(self.scene.triangles, middle))

    def _whole(
        self, aperture: Aperture, sides: Iterable[Sides] | None, *, colored: bool = True
    ) -> HogelImage:
        """Decide a whole true image."""
        pencil = crossed_frustum(self.scene.frustum, aperture)
        certifier = Certifier(self.scene.triangles, pencil, sides)
        band = partial(self._band, aperture, certifier, colored=colored)
        if compiled():
            return stacked(list(in_turn(band, pencil.resolution)))
        return stacked(list(in_parallel(band, pencil.resolution, least_pixels=BUSY_PIXELS)))

    def _band(
        self, aperture: Aperture, certifier: Certifier, rows: range, *, colored: bool = True
    ) -> HogelImage:
        """Decide some rows of a true image."""
        decided = certifier.decide(rows)
        pictures = self._pictures
        image = pictures.true_image(aperture, rows, certifier.pencil, decided, colored=colored)
        opinion = SecondOpinion(
            tracer=lambda: self.tracer,
            scene=self.scene,
            pencil=certifier.pencil,
            rows=rows,
            triangle=decided.triangle,
            certainty=decided.certainty,
        )
        return replace(image, second_opinion=opinion)

    def propose(self, aperture: Aperture) -> HogelImage:
        """Return the image that the float32 tracer alone proposes; no pixel of it is certified."""
        pencil = crossed_frustum(self.scene.frustum, aperture)
        found = uncertified(self.tracer, self.scene, pencil, rows := range(pencil.resolution[1]))
        return self._pictures.true_image(aperture, rows, pencil, found)

    def _averaged(
        self, aperture: Aperture, sampling: Sampling, band: Callable[[range], HogelImage]
    ) -> Iterator[HogelImage]:
        """Yield bands with color averaged over pixels' boxes and over the aperture (paper, section 6)."""
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
        """Return the color averaged over the whole aperture, not over some points of it (paper, section 6).

        Parameters
        ----------
        aperture
            Middle of the aperture, which is as large as the pitch of the plate's hogels.
        tolerance
            Largest root mean square of the standard error over pixels and channels, in radiance;
            `Converged.error` is the one that was reached.
        sampling
            Sampling of the pixels' boxes; None for the scene's own. Its number of sub-apertures is not
            used.
        seed
            Seed of the points; another one gives independent points.
        """
        side = points_per_side(self.scene.sampling if sampling is None else sampling)
        rows = range(self.scene.frustum.resolution[1])

        def mean(apertures: Sequence[Aperture]) -> Floats:
            return mean_color(self.scene, self._shader, apertures, side, rows)

        return converged(mean, self.scene.plate, aperture, tolerance, seed)

    def decide(self, aperture: Aperture) -> Iterator[FirstSurfaces]:
        """Yield the first surfaces alone, without points or color, in bands of rows from the top."""
        pencil = crossed_frustum(self.scene.frustum, aperture)
        decide = Certifier(self.scene.triangles, pencil).decide
        yield from in_parallel(decide, pencil.resolution, least_pixels=UNDIVIDED_PIXELS)

    def trace_model(self, aperture: Aperture, settings: DoubleFrustum, *, shaded: bool = True) -> HogelImage:
        """Return the image that the cameras of these settings would draw without any rounding.

        Parameters
        ----------
        aperture, settings
            Aperture of the image, and the cameras.
        shaded
            Whether the image has normals and color; without them it is made faster.
        """
        settings.check_against(self.scene.frustum)
        pencil = crossed_frustum(self.scene.frustum, aperture)
        cameras = model_cameras(self.scene.frustum, aperture, settings)
        deciders = [self._decider(camera.pencil, settings.cull) for camera in cameras]

        def band(rows: range) -> HogelImage:
            layers = [(camera.pencil, decide(rows)) for camera, decide in zip(cameras, deciders, strict=True)]
            return self._pictures.image(aperture, rows, layers, settings, shaded=shaded)

        if compiled() and not shaded:
            return stacked(list(in_turn(band, pencil.resolution)))
        return stacked(list(in_parallel(band, pencil.resolution, least_pixels=BUSY_PIXELS)))

    def _decider(self, pencil: Pencil, cull: Cull) -> Callable[[range], FirstSurfaces]:
        """Return what decides rows of a camera that may leave out faces."""
        if cull is Cull.NONE:
            return Certifier(self.scene.triangles, pencil, table=self._corner_table).decide
        some = drawn_triangles(self.scene.triangles, pencil, cull)
        triangles = self.scene.triangles[some]
        table = corner_table(triangles) if len(triangles) <= KEPT_TRIANGLES else None
        certifier = Certifier(triangles, pencil, table=table)
        return lambda rows: certifier.decide(rows).renumbered(some)

    def gaps(self, aperture: Aperture) -> Floats:
        """Return the gaps between each pixel's first surface and the next one on the same side, (H, W).

        A gap is a difference of |z|, in scene units: for C, which keeps the nearest surface behind the
        plate, to the second nearest; for C*, which keeps the farthest before the plate, to the second
        farthest. It is infinite where there is no second surface on that side of the plate.

        Gaps come from the narrow phase of the truth, in double precision: no triangle is left out that a
        line surely meets, and each gap is off by no more than the bounds of rounding of its two surfaces,
        some 1e-15 of |z| unless seen edge-on. Surfaces closer than that count as one, so that a point shared
        by two triangles is not behind itself. A line that passes an edge within rounding, where coverage
        would have to be decided in integers, is not taken to meet that triangle.
        """
        pencil = crossed_frustum(self.scene.frustum, aperture)
        gaps = RunnersUp(self.scene.triangles, pencil).gaps
        return np.concatenate(list(in_parallel(gaps, pencil.resolution, least_pixels=UNDIVIDED_PIXELS)))

    def clear(self, truth: HogelImage, pictures: int) -> ClearTriangles | None:
        """Return the triangles of a true image on which points are hidden by nothing; see `Sight.clear`.

        `pictures` is the number of pictures that are about to be judged by it.
        """
        pencil = crossed_frustum(self.scene.frustum, truth.camera.aperture)
        return self.sight.clear(pencil, partial(self._shown, truth), pictures)

    def make_ready(self, truth: HogelImage, pictures: int) -> None:
        """Make ready what judging some pictures by a true image needs, before they are there.

        `pictures` is their number. Results do not depend on whether this was called.
        """
        pencil = crossed_frustum(self.scene.frustum, truth.camera.aperture)
        self.sight.make_ready(pencil, partial(self._shown, truth), pictures)

    def _shown(self, truth: HogelImage) -> Mask:
        """Return the triangles (F,) that a true image shows."""
        seen = np.zeros(len(self.scene.faces), dtype=np.bool_)
        seen[truth.triangle[truth.triangle != NOTHING]] = True
        return seen

    def hidden(self, aperture: Aperture, points: SurfacePoints) -> Mask:
        """Return which points are hidden from the true frustum of an aperture; see `Sight.hidden`."""
        return self.sight.hidden(crossed_frustum(self.scene.frustum, aperture), points)

    def rendering(self, sampling: Sampling | None = None) -> Rendering:
        """Return the effects and samples of a true image's color; sampling as for `trace`."""
        return Rendering.of(self._shader.effects, self.scene.sampling if sampling is None else sampling)

    def camera(self, aperture: Aperture) -> HogelCamera:
        """Return the true frustum of an aperture, as its image has it."""
        return self._pictures.camera(aperture)
