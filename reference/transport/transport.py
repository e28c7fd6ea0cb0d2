"""Light transport that a rasterizer leaves out, by Mitsuba and the crossed frustum's sensor.

Paths start where the reference's samples are: in the centers of `supersample` x `supersample` cells of each
pixel, each path in one of them at random. So the mean over many paths is the mean that `Reference.trace`
takes; the only differences are light transport and noise.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from xfrustum.reference.averages import points_per_side
from xfrustum.reference.lines.lines import crossed_frustum
from xfrustum.reference.llvm import mitsuba_backend
from xfrustum.reference.tracers.sensor import register_sensor, sensor_parameters
from xfrustum.reference.transport.light_paths import LightPaths
from xfrustum.reference.transport.surfaces import Table
from xfrustum.scenes.appearance.sampling import Transport
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

PATHS_AT_ONCE = 1 << 20  #: light paths of one launch. This bounds the memory, some 200 bytes a path.


@dataclass(frozen=True, kw_only=True, eq=False)
class RadianceEstimate:
    """A picture (H, W, 3) in linear RGB from so many random light paths a pixel, and its noise.

    The variance of the mean (H, W, 3) is estimated from its own samples: zero where all of them agree, as in
    pixels that are not supersampled and without interreflection.
    """

    mean: Floats
    variance_of_mean: Floats
    samples: int


class PathTracer:
    """Renders a scene's apertures with light transport; paths start at the points of its sampling."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    @property
    def versions(self) -> dict[str, str]:
        """Names and versions of the libraries that compute the paths, for reports."""
        return mitsuba_backend().versions

    @cached_property
    def _paths(self) -> LightPaths:
        return LightPaths(self.scene)

    def render(self, aperture: Aperture, transport: Transport, seed: int = 0) -> RadianceEstimate:
        """Return the radiance that the middle of an aperture sees; for more points, average their estimates.

        The same seed gives the same paths. Without shadows and interreflection the result is the direct light
        that `Reference.trace` shows.
        """
        width, height = self.scene.frustum.resolution
        mean, variance = np.zeros((height * width, 3)), np.zeros((height * width, 3))
        if len(self.scene.faces):
            starts = _PathStarts(self.scene, aperture, self._paths.scale)

            def path(pixel: Any, sampler: Any) -> Any:
                found, line = starts.seen(self._paths, pixel, sampler)
                return self._paths.radiance(found, line, transport, sampler)

            for number, first in enumerate(range(0, height * width, PATHS_AT_ONCE)):
                pixels = range(first, min(first + PATHS_AT_ONCE, height * width))
                moments = _Moments(len(pixels))
                random, left = np.random.default_rng((seed, number)), transport.samples
                while left:
                    together = min(left, max(1, PATHS_AT_ONCE // len(pixels)))
                    moments.add(_together(path, pixels, together, int(random.integers(1 << 32))))
                    left -= together
                part = slice(pixels.start, pixels.stop)
                mean[part], variance[part] = moments.mean, moments.variance_of_mean
        return RadianceEstimate(
            mean=mean.reshape(height, width, 3),
            variance_of_mean=variance.reshape(height, width, 3),
            samples=transport.samples,
        )


class _PathStarts:
    """The lines of one image; a path takes one of a pixel's `supersample` x `supersample` lines at random.

    The sensor aims rays in float32, which find the surface; its light is computed along the same line in
    double precision that the reference decides. Lengths are multiplied by a scale.
    """

    def __init__(self, scene: Scene, aperture: Aperture, scale: float) -> None:
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        register_sensor()
        parameters = sensor_parameters(scene, aperture)
        for name in ("reach_viewer", "reach_back"):
            parameters[name] *= scale
        parameters["aperture"] = [scale * part for part in parameters["aperture"]]
        self._sensor = mi.load_dict(parameters)
        side = points_per_side(scene.sampling)
        width, height = (side * count for count in scene.frustum.resolution)
        fine = replace(crossed_frustum(scene.frustum, aperture), resolution=(width, height))
        self._dx, self._dy = Table(fine.dx), Table(fine.dy)
        # Opaque, so that another image's values do not compile another kernel.
        self._center = [dr.opaque(mi.Float64, scale * part) for part in fine.center]
        self._side, self._width, self._height = (dr.opaque(mi.UInt32, n) for n in (side, width, height))

    def seen(self, paths: LightPaths, pixel: Any, sampler: Any) -> tuple[Any, Any]:
        """Return what `LightPaths.first` finds on a random line of a pixel, and the line."""
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        row, column = pixel // (self._width // self._side), pixel % (self._width // self._side)
        part = sampler.next_2d()
        x, y = (
            place * self._side + dr.minimum(mi.UInt32(share * self._side), self._side - 1)
            for place, share in ((column, part.x), (row, part.y))
        )
        film = mi.Point2f((mi.Float64(x) + 0.5) / self._width, (mi.Float64(y) + 0.5) / self._height)
        ray, _ = self._sensor.sample_ray(0.0, 0.5, film, mi.Point2f(0.5))
        line = (mi.Vector3d(*self._center), mi.Vector3d(self._dx.number(x), self._dy.number(y), -1.0))
        return paths.first(ray, mi.Bool(True)), line


class _Moments:
    """Mean and variance of samples that come in batches (Chan, Golub and LeVeque, 1983)."""

    def __init__(self, pixels: int) -> None:
        self._count = 0
        self.mean = np.zeros((pixels, 3))
        self._squares = np.zeros((pixels, 3))

    def add(self, colors: Floats) -> None:
        """Take samples (pixels, n, 3) into account."""
        own = colors.mean(axis=1)
        apart, count = own - self.mean, self._count + colors.shape[1]
        self._squares += ((colors - own[:, None]) ** 2).sum(axis=1)
        self._squares += apart**2 * (self._count * colors.shape[1] / count)
        self.mean += apart * (colors.shape[1] / count)
        self._count = count

    @property
    def variance_of_mean(self) -> Floats:
        """(pixels, 3) unbiased estimate of the variance of the mean."""
        return self._squares / ((self._count - 1) * self._count)


def _together(path: Callable[[Any, Any], Any], pixels: range, paths: int, seed: int) -> Floats:
    """Return colors (pixels, paths, 3), all paths in one launch."""
    mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
    count = len(pixels) * paths
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, count)
    # Opaque, so that another launch's values do not compile another kernel.
    first, times = (dr.opaque(mi.UInt32, value) for value in (pixels.start, paths))
    color = path(first + dr.arange(mi.UInt32, count) // times, sampler).numpy()
    return np.asarray(color.T.reshape(len(pixels), paths, 3), dtype=np.float64)
