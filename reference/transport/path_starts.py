"""The lines on which light paths begin: those of the reference's samples on the film, as doubles.

The sensor aims rays in float32, which find the surface; its light is computed along the same line in double
precision that the reference decides.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from xfrustum.reference.averages import points_per_side
from xfrustum.reference.lines.lines import crossed_frustum
from xfrustum.reference.llvm import mitsuba_backend
from xfrustum.reference.tracers.sensor import register_sensor, sensor_parameters
from xfrustum.reference.transport.device_tables import Table
from xfrustum.reference.transport.light_paths import LightPaths
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture


class PathStarts:
    """The lines of one image; a path takes one of a pixel's `supersample` x `supersample` lines at random.

    Parameters
    ----------
    scene
        Scene with the frustum and the sampling.
    aperture
        Aperture that the lines pass through.
    scale
        Factor by which lengths are multiplied.
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
        """Return the result of `LightPaths.first` for a random line of a pixel, and that line, scaled.

        Parameters
        ----------
        paths
            The scene in Mitsuba.
        pixel
            Pixel number, row * W + column.
        sampler
            Mitsuba's sampler, seeded.
        """
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        whole = int if mitsuba_backend().scalar else mi.UInt32
        row, column = pixel // (self._width // self._side), pixel % (self._width // self._side)
        part = sampler.next_2d()
        x, y = (
            place * self._side + dr.minimum(whole(share * self._side), self._side - 1)
            for place, share in ((column, part.x), (row, part.y))
        )
        film = mi.Point2f((mi.Float64(x) + 0.5) / self._width, (mi.Float64(y) + 0.5) / self._height)
        ray, _ = self._sensor.sample_ray(0.0, 0.5, film, mi.Point2f(0.5))
        line = (mi.Vector3d(*self._center), mi.Vector3d(self._dx.number(x), self._dy.number(y), -1.0))
        return paths.first(ray, mi.Bool(True)), line
