"""The crossed frustum as a Mitsuba sensor, for any Mitsuba scene and any integrator.

    register_sensor()
    scene = mi.load_dict({
        **mitsuba_scene(scene),
        "sensor": {**sensor_parameters(scene, aperture), "sampler": {"type": "independent"}},
        "light": {"type": "constant"},
    })
    image = mi.render(scene, integrator=mi.load_dict({"type": "path", "hide_emitters": True}))

In a dictionary or in XML, `crossed_frustum` takes `aperture` (a point), `shear_x`, `shear_y` (k),
`half_extent_x`, `half_extent_y` (t), `reach_viewer` and `reach_back` (scene units), a film and a
sampler. Film row 0 is at the top; +z points to the viewer; there is no `to_world`. Mitsuba computes
in single precision: the error of a line is about 1e-7 of the reach.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from xfrustum.reference.lines.lines import crossed_frustum
from xfrustum.reference.llvm import mitsuba_backend
from xfrustum.reference.tracers.mitsuba_tracer import triangle_mesh
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture

PLUGIN = "crossed_frustum"  #: the sensor's name in Mitsuba scenes
DIFFUSE = "face_diffuse"  #: name of the mesh attribute with each triangle's diffuse color


def register_sensor() -> None:
    """Register the plugin in Mitsuba's current variant; further calls have no effect."""
    _registered(mitsuba_backend().variant)


def sensor_parameters(scene: Scene, aperture: Aperture) -> dict[str, Any]:
    """Return the sensor of an aperture, with a box-filtered film of the scene's resolution."""
    bundle = crossed_frustum(scene.frustum, aperture)
    return {
        "type": PLUGIN,
        "aperture": list(bundle.center),
        "shear_x": bundle.shear[0],
        "shear_y": bundle.shear[1],
        "half_extent_x": bundle.half_extent[0],
        "half_extent_y": bundle.half_extent[1],
        "reach_viewer": -bundle.s_range[0],
        "reach_back": bundle.s_range[1],
        "film": {
            "type": "hdrfilm",
            "width": bundle.resolution[0],
            "height": bundle.resolution[1],
            "pixel_format": "rgba",
            "rfilter": {"type": "box"},
        },
    }


def mitsuba_scene(scene: Scene) -> dict[str, Any]:
    """Return the triangles as a Mitsuba scene; the caller adds sensor and light, and loads it.

    All objects are one two-sided mesh in the diffuse colors of their materials, so that the
    primitive number of a hit, in the `aov` integrator or in `ray_intersect`, is the scene's
    triangle number.
    """
    loaded: dict[str, Any] = {"type": "scene", "embree_use_robust_intersections": True}
    if len(scene.faces):
        color = {"type": "mesh_attribute", "name": DIFFUSE}
        bsdf = mitsuba_backend().mitsuba.load_dict(
            {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": color}}
        )
        mesh = triangle_mesh("triangles", scene.vertices, scene.faces, bsdf)
        diffuse = np.array([material.diffuse for material in scene.materials], dtype=np.float32)
        mesh.add_attribute(DIFFUSE, 3, diffuse[scene.object_of_triangle].ravel())
        loaded["triangles"] = mesh
    return loaded


@dataclass(frozen=True, kw_only=True)
class _FilmLines:
    """Lines of one aperture in the types of the sensor's variant; `reach` to viewer and back."""

    mi: Any
    dr: Any
    aperture: Any
    shear: Any
    half_extent: Any
    reach: tuple[Any, Any]

    @classmethod
    def from_properties(cls, mi: Any, dr: Any, props: Any) -> _FilmLines:
        """Return the lines of a plugin's properties; ValueError unless all sizes are positive."""
        lines = cls(
            mi=mi,
            dr=dr,
            aperture=mi.Point3f(props["aperture"]),
            shear=mi.Vector2f(props["shear_x"], props["shear_y"]),
            half_extent=mi.Vector2f(props["half_extent_x"], props["half_extent_y"]),
            reach=(mi.Float(props["reach_viewer"]), mi.Float(props["reach_back"])),
        )
        # Opaque values, so that another aperture does not compile another kernel.
        dr.make_opaque(lines.aperture, lines.shear, lines.half_extent, lines.reach)
        sizes = ("half_extent_x", "half_extent_y", "reach_viewer", "reach_back")
        if min(props[name] for name in sizes) <= 0:
            raise ValueError(f"{PLUGIN}: half extents and reaches must be positive")
        return lines

    def __str__(self) -> str:
        return f"aperture = {self.aperture}, shear = {self.shear}, reach = {self.reach}"

    def through(self, film: Any, position: Any) -> tuple[Any, Any, Any]:
        """Return the viewer's end, unit direction and length of a film position's line."""
        mi, dr = self.mi, self.dr
        start, window = self._crop_window(film)
        x, y = position.x * window.x + start.x, position.y * window.y + start.y
        # Positions on Mitsuba's film count from the top left; u and v count from the center, v up.
        slope_x = self.shear.x + (2.0 * x - 1.0) * self.half_extent.x
        slope_y = self.shear.y + (1.0 - 2.0 * y) * self.half_extent.y
        d = mi.Vector3f(slope_x, slope_y, -1.0)
        length = dr.norm(d)
        return self.aperture - self.reach[0] * d, d / length, sum(self.reach) * length

    def direction_sample(self, it: Any, active: Any, film: Any) -> tuple[Any, Any]:
        """Aim from a point in the scene at the viewer's end of its own line, for light tracing.

        One line of the whole film passes through each point. The weight turns an integral over
        surfaces into one over the film: u and v vary by dx / (2 s tx) and dy / (2 s ty), and a
        surface is seen from d foreshortened by |d| against the plane of the plate.
        """
        mi, dr = self.mi, self.dr
        offset = it.p - self.aperture
        s = dr.select(offset.z == 0.0, dr.nan, -offset.z)
        u = (offset.x / s - self.shear.x) / self.half_extent.x
        v = (offset.y / s - self.shear.y) / self.half_extent.y
        start, window = self._crop_window(film)
        x, y = ((u + 1.0) / 2.0 - start.x) / window.x, ((1.0 - v) / 2.0 - start.y) / window.y
        seen = active & (x >= 0.0) & (x <= 1.0) & (y >= 0.0) & (y <= 1.0)
        seen &= (s >= -self.reach[0]) & (s <= self.reach[1])
        end, d, _ = self.through(film, mi.Point2f(x, y))
        pixels = mi.Vector2f(film.crop_size())
        sample = dr.zeros(mi.DirectionSample3f)
        sample.p, sample.d, sample.n = end, -d, d
        sample.dist = dr.norm(end - it.p)
        sample.uv = mi.Point2f(x * pixels.x, y * pixels.y)
        sample.time, sample.pdf, sample.delta = it.time, dr.select(seen, 1.0, 0.0), True
        area = 4.0 * self.half_extent.x * self.half_extent.y * window.x * window.y
        weight = dr.select(seen, -1.0 / (d.z * s * s * area), 0.0)
        return sample, mi.Spectrum(weight)

    def _crop_window(self, film: Any) -> tuple[Any, Any]:
        """Return where a film's crop window begins and its size, as parts of the whole film."""
        mi = self.mi
        whole = mi.Vector2f(film.size())
        return mi.Vector2f(film.crop_offset()) / whole, mi.Vector2f(film.crop_size()) / whole


@lru_cache
def _registered(variant: str) -> type:
    """Define the sensor on the classes of one variant: each Mitsuba variant has its own."""
    mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit

    box = mi.BoundingBox3f if variant.startswith("scalar") else mi.ScalarBoundingBox3f

    class CrossedFrustum(mi.Sensor):  # type: ignore[misc, name-defined]  # comes with a variant
        """Every line passes through the aperture, from the viewer's end to the far one."""

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.lines = _FilmLines.from_properties(mi, dr, props)
            self.point = mi.ScalarPoint3f(props["aperture"])
            self.m_needs_sample_2, self.m_needs_sample_3 = True, False

        def sample_ray(
            self, time: Any, wavelength: Any, position: Any, lens: Any, active: Any = True
        ) -> tuple[Any, Any]:
            ray = mi.Ray3f()
            weight = self._aim(ray, time, wavelength, position, active)
            return ray, weight

        def sample_ray_differential(
            self, time: Any, wavelength: Any, position: Any, lens: Any, active: Any = True
        ) -> tuple[Any, Any]:
            ray = mi.RayDifferential3f()
            weight = self._aim(ray, time, wavelength, position, active)
            pixel = 1.0 / mi.Vector2f(self.film().crop_size())
            ray.o_x, ray.d_x, _ = self.lines.through(
                self.film(), position + mi.Vector2f(pixel.x, 0.0)
            )
            ray.o_y, ray.d_y, _ = self.lines.through(
                self.film(), position + mi.Vector2f(0.0, pixel.y)
            )
            ray.has_differentials = True
            return ray, weight

        def sample_direction(self, it: Any, sample: Any, active: Any = True) -> tuple[Any, Any]:
            return self.lines.direction_sample(it, active, self.film())

        def bbox(self) -> Any:
            return box(self.point)

        def to_string(self) -> str:
            return f"CrossedFrustum[{self.lines}]"

        def _aim(self, ray: Any, time: Any, wavelength: Any, position: Any, active: Any) -> Any:
            """Fill a ray from a position in [0, 1]^2 of the crop window; return its weight."""
            ray.time = self.shutter_open() + time * self.shutter_open_time()
            nowhere = dr.zeros(mi.SurfaceInteraction3f)
            ray.wavelengths, weight = self.sample_wavelengths(nowhere, wavelength, active)
            ray.o, ray.d, ray.maxt = self.lines.through(self.film(), position)
            return weight

    mi.register_sensor(PLUGIN, CrossedFrustum)
    return CrossedFrustum
