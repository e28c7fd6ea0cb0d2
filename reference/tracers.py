"""Ray tracers as second opinions: Embree, Mitsuba, and the crossed frustum as a Mitsuba sensor.

**Tracers.** Embree, in single precision and robust mode, and Mitsuba, on all processors or a GPU,
propose the first triangle of each ray, independently of each other. Positions are computed from the
triangle in double precision. Proposals are compared with the decisions of `certify`.

**Sensor**, for any Mitsuba scene and any integrator:

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

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from typing import Any, Protocol

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from xfrustum.reference.backend import padded
from xfrustum.reference.lines import crossed_frustum
from xfrustum.reference.llvm import mitsuba_backend, vector_backend, worker_count
from xfrustum.scenes.arrays import Floats, Indices, Numbers, Singles
from xfrustum.scenes.model.images import NOTHING
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture

TRACERS = ("embree", "mitsuba")  #: names of the tracers; the first is the default


class Tracer(Protocol):
    """Triangles of a scene in a ray tracer. Its hits are proposals: `certify` uses no tracer."""

    name: str

    def first_hits(self, origins: Floats, directions: Floats) -> Numbers:
        """Return the first triangle (N,) of rays (N, 3) of any length, `NOTHING` for none."""


def unit_scale(vertices: Floats) -> float:
    """Return the power of two that scales a scene to about unit size, exactly.

    Embree has absolute constants near the limits of float32.
    """
    size = float(np.abs(vertices).max(initial=0.0))
    return float(2.0 ** -np.floor(np.log2(size))) if size > 0 else 1.0


#: Rays of one call. Embree's binding traces a call on one thread and releases the interpreter lock:
#: several calls run on several threads.
EMBREE_RAYS = 1 << 16


def embree_versions() -> dict[str, str]:
    """Return name and version of the tracer, for reports."""
    return {"embreex": version("embreex")}


class EmbreeMesh:
    """Acceleration structure of a mesh of about unit size, in Embree's robust mode.

    Parameters
    ----------
    vertices
        (V, 3) positions, rounded to float32.
    faces
        (F, 3) vertex numbers of each triangle.
    """

    def __init__(self, vertices: Floats, faces: Indices) -> None:
        self._embree = EmbreeScene(robust=True)
        self._empty = len(faces) == 0
        if not self._empty:
            TriangleMesh(self._embree, vertices.astype(np.float32), faces.astype(np.int32))
            # The structure is built on the first ray, and two threads must not build it at once.
            self._embree.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    def first_hits(
        self, origins: Singles, directions: Singles, lengths: Singles | None = None
    ) -> Numbers:
        """Return the first triangle (N,) of rays (N, 3) up to lengths, `NOTHING` for none."""
        hits = np.full(len(origins), NOTHING, dtype=np.int32)
        if self._empty or not len(hits):
            return hits

        def fill(start: int) -> None:
            part = slice(start, start + EMBREE_RAYS)
            ends = None if lengths is None else lengths[part]
            hits[part] = self._embree.run(origins[part], directions[part], ends)

        with ThreadPoolExecutor(worker_count()) as pool:
            list(pool.map(fill, range(0, len(hits), EMBREE_RAYS)))
        return hits


class EmbreeTracer:
    """A scene in Embree, scaled by `scale`."""

    name = "embree"

    def __init__(self, scene: Scene) -> None:
        self.scale = unit_scale(scene.vertices)
        self._mesh = EmbreeMesh(scene.vertices * self.scale, scene.faces)

    def first_hits(self, origins: Floats, directions: Floats) -> Numbers:
        """Return the first triangle of each ray, (N,); see `Tracer.first_hits`."""
        scaled = (origins * self.scale).astype(np.float32)
        return self._mesh.first_hits(scaled, directions.astype(np.float32))


#: rays of one call. This bounds the memory, some 100 bytes per ray.
MITSUBA_RAYS = 1 << 20


def mitsuba_versions() -> dict[str, str]:
    """Return name and version of the tracer, its variant and its LLVM, for reports."""
    return mitsuba_backend().versions


class MitsubaTracer:
    """Acceleration structure of a scene in Mitsuba, in robust mode if Mitsuba uses Embree."""

    name = "mitsuba"

    def __init__(self, scene: Scene) -> None:
        self._backend = vector_backend()
        mi = self._backend.mitsuba
        # The classes are kept, so that this tracer outlives a change of Mitsuba's variant.
        self._ray, self._point, self._vector = mi.Ray3f, mi.Point3f, mi.Vector3f
        self._int = mi.Int
        self.scale = unit_scale(scene.vertices)
        self._scene = robust_scene(scene, self.scale) if len(scene.faces) else None

    def first_hits(self, origins: Floats, directions: Floats) -> Numbers:
        """Return the first triangle of each ray, (N,); see `Tracer.first_hits`."""
        hits = np.full(len(origins), NOTHING, dtype=np.int32)
        if self._scene is None:
            return hits
        dr = self._backend.drjit
        for start in range(0, len(origins), MITSUBA_RAYS):
            part = slice(start, start + MITSUBA_RAYS)
            point = self._point(_coordinates((origins[part] * self.scale).astype(np.float32)))
            ray = self._ray(point, self._vector(_coordinates(directions[part].astype(np.float32))))
            met = self._scene.ray_intersect_preliminary(ray, coherent=True)
            hits[part] = dr.select(met.is_valid(), self._int(met.prim_index), NOTHING).numpy()
        return hits


def robust_scene(scene: Scene, scale: float) -> Any:
    """Return a `mi.Scene` of all triangles, scaled; in robust mode if Mitsuba uses Embree."""
    mesh = triangle_mesh("scene", scene.vertices * scale, scene.faces)
    return mitsuba_backend().mitsuba.load_dict(
        {"type": "scene", "embree_use_robust_intersections": True, "mesh": mesh}, optimize=False
    )


def triangle_mesh(name: str, vertices: Floats, faces: Indices, bsdf: Any | None = None) -> Any:
    """Return a `mi.Mesh` in float32 with primitives in the order of `faces`, at least one."""
    mi = mitsuba_backend().mitsuba
    properties = mi.Properties()
    if bsdf is not None:
        properties["bsdf"] = bsdf
    mesh = mi.Mesh(name, len(vertices), len(faces), properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = padded(vertices, np.float32)
    parameters["faces"] = padded(faces, np.uint32)
    parameters.update()
    return mesh


def bare_intersection(scene: Scene, origins: Floats, directions: Floats) -> Callable[[], object]:
    """Return a function that intersects rays (N, 3) with a scene on the device, synchronously."""
    mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
    scale = unit_scale(scene.vertices)
    loaded = robust_scene(scene, scale)
    ray = mi.Ray3f(mi.Point3f(_coordinates(origins * scale)), mi.Vector3f(_coordinates(directions)))
    # Copy the rays to the device: the measured rate must not include reading NumPy's memory.
    dr.make_opaque(ray)
    dr.sync_thread()

    def trace() -> object:
        met = loaded.ray_intersect_preliminary(ray, coherent=True)
        dr.eval(met)
        dr.sync_thread()
        return met

    return trace


def _coordinates(vectors: Floats | Singles) -> Singles:
    # Dr.Jit's arrays of vectors store each coordinate contiguously.
    rows: Singles = padded(vectors.T, np.float32).reshape(3, -1)
    return rows


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
        """Return start (on the viewer's side), unit direction and length of a position's line."""
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
        surfaces into an integral over the film: u and v, as parts of the film, vary by
        dx / (2 s tx) and dy / (2 s ty), and areas across d are 1 / |d| of areas along the plate.
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
        """Return start and size of a film's crop window, as parts of the whole film."""
        mi = self.mi
        whole = mi.Vector2f(film.size())
        return mi.Vector2f(film.crop_offset()) / whole, mi.Vector2f(film.crop_size()) / whole


@lru_cache
def _registered(variant: str) -> type:
    """Define the sensor on the classes of one variant: each Mitsuba variant has its own."""
    mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit

    box = mi.BoundingBox3f if variant.startswith("scalar") else mi.ScalarBoundingBox3f

    class CrossedFrustum(mi.Sensor):  # type: ignore[misc, name-defined]  # comes with a variant
        """Sensor whose lines pass through the aperture, from the viewer's end to the far end."""

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
