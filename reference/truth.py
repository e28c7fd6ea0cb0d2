"""True images: decisions of `certify` for each pixel, with points, normals and color."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Self

import numpy as np

from xfrustum.reference.averages import (
    AVERAGED_PIXELS,
    TOLERANCE,
    Converged,
    averages,
    converged,
    mean_color,
    points_per_side,
)
from xfrustum.reference.certify.certify import Certifier, FirstSurfaces
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.certify.occlusion import Occlusion, SurfacePoints
from xfrustum.reference.lines.lines import RayBundle, TileLines, crossed_frustum, model_cameras
from xfrustum.reference.lines.triangles import drawn_triangles
from xfrustum.reference.memory import BAND_PIXELS, WHOLE_PIXELS, bands
from xfrustum.reference.pictures import Pictures
from xfrustum.reference.shading.shading import Shader
from xfrustum.reference.tiles import HogelDecisions, TileDecisions
from xfrustum.reference.tracers.embree import EmbreeTracer, embree_versions
from xfrustum.reference.tracers.mitsuba_tracer import MitsubaTracer, mitsuba_versions
from xfrustum.reference.tracers.proposals import SecondOpinion, uncertified
from xfrustum.reference.tracers.tracer import TRACERS, Tracer
from xfrustum.scenes.appearance import Sampling, sub_apertures
from xfrustum.scenes.arguments import InputError, one_of
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.effects import Effect, checked
from xfrustum.scenes.model.images import DirectionImage, HogelCamera, HogelImage, Rendering, stacked
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, Cull, DoubleFrustum, PlateTile


class Reference:
    """The ground truth of a scene: the true images of its crossed frusta.

    `tracer`, one of `TRACERS`, gives a second opinion on every pixel; the decision is always by
    `certify`. `effects` are the evaluated effects of light; None selects all that the scene needs.
    Raises InputError for an unknown tracer or effect.
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
        self._tile: TileDecisions | None = None

    @cached_property
    def tracer(self) -> Tracer:
        """The tracer, built when first needed."""
        return (
            MitsubaTracer(self.scene) if self.tracer_name == "mitsuba" else EmbreeTracer(self.scene)
        )

    def build_tracer(self) -> Tracer:
        """Build the acceleration structures now, so that no picture's time includes them."""
        return self.tracer

    @cached_property
    def _triangles(self) -> Triangles:
        return Triangles(self.scene.triangles)

    @cached_property
    def _occlusion(self) -> Occlusion:
        return Occlusion(self._triangles)

    @cached_property
    def _certifiers(self) -> Callable[[RayBundle], Certifier]:
        # An image and its gaps share their boxes, the larger part of the work for few pixels.
        return lru_cache(maxsize=2)(lambda bundle: Certifier(self._triangles, bundle))

    def _certifier(self, bundle: RayBundle, *, gaps: bool = False) -> Certifier | HogelDecisions:
        """Return the decisions along the lines of a bundle, from the tile if it has them."""
        known = None if self._tile is None else self._tile.of(bundle)
        if known is None or (gaps and known.behind is None):
            return self._certifiers(bundle)
        return known

    def with_tile(self, tile: PlateTile, *, gaps: bool = False) -> Self:
        """Return a reference that has decided all hogels of a tile, with the same bits.

        Directions are decided one by one (`tiles`), in some 13 bytes for each pixel of all hogels,
        and 16 more with the `gaps` that predictions of depth errors read.
        """
        # The copy shares what both need.
        _ = self._triangles, self._occlusion, self._certifiers
        other = copy(self)
        other._tile = TileDecisions(self._triangles, self.scene.frustum, tile, gaps=gaps)
        return other

    def first_surfaces(self, bundle: RayBundle) -> FirstSurfaces:
        """Decide the first surface of every pixel of a bundle's image at once."""
        return self._certifier(bundle).decide(range(bundle.resolution[1]))

    @property
    def decided_by(self) -> str:
        """Name of the decision method of this reference; see `alone.DECISIONS`."""
        return "certified"

    @property
    def versions(self) -> dict[str, str]:
        """Names and versions of the libraries that compute the truth, for reports."""
        # Do not build the tracer only for its name.
        return mitsuba_versions() if self.tracer_name == "mitsuba" else embree_versions()

    def trace(
        self, aperture: Aperture, sampling: Sampling | None = None, *, colored: bool = True
    ) -> HogelImage:
        """Return the true image of an aperture (paper, section 3: one frustum that crosses itself).

        `sampling` are the points that average color, None for the scene's own; without color
        (`colored`) the image is made faster.
        """
        one_of(aperture, Aperture, "aperture")
        # Bands of means are smaller: they hold sums of all samples of a pixel.
        if colored and averages(self.scene.sampling if sampling is None else sampling):
            image = stacked(list(self.trace_bands(aperture, sampling)))
        else:
            image = stacked(list(self._bands(aperture, WHOLE_PIXELS, colored=colored)))
        return replace(image, rendering=self.rendering(sampling) if colored else None)

    def trace_bands(
        self, aperture: Aperture, sampling: Sampling | None = None
    ) -> Iterator[HogelImage]:
        """Yield the true image in bands of rows, from the top, in bounded memory; see `trace`."""
        one_of(aperture, Aperture, "aperture")
        sampling = self.scene.sampling if sampling is None else sampling
        if not averages(sampling):
            yield from self._bands(aperture, BAND_PIXELS)
            return
        # Color is averaged over pixels' boxes and over the aperture (paper, section 6).
        apertures = sub_apertures(self.scene.plate, aperture, sampling.aperture)
        row, side = 0, points_per_side(sampling)
        # Surfaces are those at pixel centers through the middle of the aperture.
        for band in self._bands(aperture, AVERAGED_PIXELS, colored=False):
            rows = range(row, row := row + len(band.triangle))
            color = mean_color(self.scene, self._triangles, self._shader, apertures, side, rows)
            yield replace(band, color=color.astype(np.float32))

    def stream(
        self, apertures: Iterable[Aperture], *, colored: bool = True
    ) -> Iterator[HogelImage]:
        """Yield the true images of many apertures in order, as `trace` returns them."""
        for aperture in apertures:
            yield self.trace(aperture, colored=colored)

    def by_directions(
        self,
        tile: PlateTile,
        pixels: Iterable[tuple[int, int]],
        *,
        normals: bool = True,
        colored: bool = True,
    ) -> Iterator[DirectionImage]:
        """Yield the true images by direction of some pixels (column, row) of all hogels of a tile.

        Each pixel has the bits that `trace` returns with one sample a pixel. The lines of one
        direction are parallel, or pass through a point of the screen, so that boxes and planes of
        triangles serve all hogels (docs/truth.md, "By directions"). InputError if colors are means.
        """
        if averages(self.scene.sampling) and colored:
            raise InputError(
                f"{self.scene.name}: has several samples a pixel, and images by direction have "
                "one; trace hogel by hogel"
            )
        lines = TileLines(self.scene.frustum, tile)
        for pixel in pixels:
            grid = lines.of_pixel(pixel)
            decided = Certifier(self._triangles, grid).decide(range(grid.resolution[1]))
            yield self._pictures.by_direction(
                tile, pixel, (grid, decided), normals=normals, colored=colored
            )

    def _bands(
        self, aperture: Aperture, pixels: int, *, colored: bool = True
    ) -> Iterator[HogelImage]:
        """Yield the true image in bands of some pixels, one sample a pixel or without color."""
        bundle = crossed_frustum(self.scene.frustum, aperture)
        certifier = self._certifier(bundle)
        for rows in bands(bundle.resolution[0], range(bundle.resolution[1]), pixels):
            decided = certifier.decide(rows)
            image = self._pictures.image(
                self.camera(aperture), rows, [(bundle, decided)], colored=colored
            )
            opinion = SecondOpinion(
                tracer=lambda: self.tracer,
                scene=self.scene,
                bundle=bundle,
                rows=rows,
                triangle=decided.triangle,
                certainty=decided.certainty,
            )
            yield replace(image, second_opinion=opinion)

    def propose(self, aperture: Aperture, *, colored: bool = True) -> HogelImage:
        """Return the image that the float32 tracer proposes; none of its pixels is certified."""
        bundle = crossed_frustum(self.scene.frustum, aperture)
        proposal = uncertified(self.tracer, self.scene, bundle, rows := range(bundle.resolution[1]))
        return self._pictures.image(
            self.camera(aperture), rows, [(bundle, proposal)], colored=colored
        )

    def converged(
        self,
        aperture: Aperture,
        tolerance: float = TOLERANCE,
        sampling: Sampling | None = None,
        seed: int = 0,
    ) -> Converged:
        """Return the color averaged over the whole area of an aperture (paper, section 6).

        The tolerance is the largest root mean square of the standard error over pixels and
        channels, in radiance; `Converged.error` is the error reached. `sampling` has the boxes of
        pixels, None for the scene's own; its number of sub-apertures is not used. A different seed
        gives independent points.
        """
        side = points_per_side(self.scene.sampling if sampling is None else sampling)
        rows = range(self.scene.frustum.resolution[1])

        def mean(apertures: Sequence[Aperture]) -> Floats:
            return mean_color(self.scene, self._triangles, self._shader, apertures, side, rows)

        return converged(mean, self.scene.plate, aperture, tolerance, seed)

    def decide(self, aperture: Aperture) -> Iterator[FirstSurfaces]:
        """Yield the first surfaces, without points or color, in bands of rows from the top."""
        bundle = crossed_frustum(self.scene.frustum, aperture)
        certifier = self._certifier(bundle)
        for rows in bands(bundle.resolution[0], range(bundle.resolution[1])):
            yield certifier.decide(rows)

    def trace_model(
        self, aperture: Aperture, settings: DoubleFrustum, *, shaded: bool = True
    ) -> HogelImage:
        """Return the image of the cameras of some settings without rounding; faster unshaded."""
        settings.check_against(self.scene.frustum)
        width, height = self.scene.frustum.resolution
        cameras = model_cameras(self.scene.frustum, aperture, settings)
        camera = self._pictures.camera(aperture, settings)
        rows = list(bands(width, range(height), WHOLE_PIXELS))
        # One certifier per camera serves all bands: its boxes are computed once.
        decided = [self._decided(each.bundle, settings.cull, rows) for each in cameras]
        return stacked(
            [
                self._pictures.image(
                    camera,
                    band,
                    [
                        (each.bundle, next(surfaces))
                        for each, surfaces in zip(cameras, decided, strict=True)
                    ],
                    normals=shaded,
                    colored=shaded,
                )
                for band in rows
            ]
        )

    def _decided(
        self, bundle: RayBundle, cull: Cull, rows: Sequence[range]
    ) -> Iterator[FirstSurfaces]:
        """Yield the first surfaces of a camera, which may cull faces, in bands of rows."""
        if cull is Cull.NONE:
            yield from map(Certifier(self._triangles, bundle).decide, rows)
            return
        # Culled triangles are dropped before the decision, so that surfaces behind them show.
        some = drawn_triangles(self.scene.triangles, bundle, cull)
        certifier = Certifier(Triangles(self.scene.triangles[some]), bundle)
        for band in rows:
            yield certifier.decide(band).renumbered(some)

    def gaps(self, aperture: Aperture, before: HogelImage | None = None) -> Floats:
        """Return the gap behind each pixel's first surface to the next on the same side, (H, W).

        A gap is a difference of |z|, in scene units. C keeps the nearest surface behind the plate,
        and its gap is to the second nearest; C* keeps the farthest in front of the plate, and its
        gap is to the second farthest. It is infinite if there is no second surface. With `before`,
        the true image, only surfaces drawn before the first one count as next; triangles are drawn
        in the order of their numbers.

        Gaps come from the filter of the truth: no triangle is left out that a line surely meets,
        and each gap is off by no more than the bounds of rounding of its two surfaces, some 1e-15
        of |z| unless seen edge-on. Closer surfaces count as one, so that a point shared by two
        triangles is not behind itself. A line that passes an edge within rounding counts as missing
        that triangle.
        """
        bundle = crossed_frustum(self.scene.frustum, aperture)
        certifier = self._certifier(bundle, gaps=True)
        width, height = bundle.resolution
        numbers = None if before is None else before.triangle.astype(np.int64)
        return np.concatenate(
            [
                certifier.gaps(
                    rows, None if numbers is None else numbers[rows.start : rows.stop].reshape(-1)
                )
                for rows in bands(width, range(height))
            ]
        )

    def hidden(self, aperture: Aperture, points: SurfacePoints) -> Mask:
        """Return which points are hidden from the true frustum of an aperture, (N,)."""
        return self.hidden_from(crossed_frustum(self.scene.frustum, aperture), points)

    def hidden_from(self, bundle: RayBundle, points: SurfacePoints) -> Mask:
        """Return the points (N,) hidden from the center of a ray bundle; see `Occlusion`."""
        return self._occlusion.hidden(bundle, points)

    def rendering(self, sampling: Sampling | None = None) -> Rendering:
        """Return the effects and samples of a true image's color; sampling as for `trace`."""
        return Rendering.from_effects(
            self._shader.effects, self.scene.sampling if sampling is None else sampling
        )

    def camera(self, aperture: Aperture) -> HogelCamera:
        """Return the true frustum of an aperture, as its image has it."""
        return self._pictures.camera(aperture)
