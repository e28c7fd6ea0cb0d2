"""Light transport that a rasterizer leaves out, by Mitsuba and the crossed frustum's sensor.

Shadows by themselves need no paths: `shading` decides them exactly. Mitsuba traces interreflection,
with shadows or without, and direct light as a second opinion.

Paths start at the reference's samples: each path takes, at random, one of the centers of
`supersample` x `supersample` cells of its pixel. The mean over many paths therefore differs from
the mean of `Reference.trace` only by light transport and noise. Points and their light are in
double precision; only rays are in single precision. The formulas of `shading` are written a second
time on purpose, so that the two versions check each other.

CONVENTIONS.md, "Light", defines the surfaces. A light of color I gives the irradiance pi I to a
surface that faces it, so that a diffuse surface of coefficient d and albedo a scatters the share d
a of the incident light, and shows d a / pi of its irradiance. Hence, with interreflection:

* diffuse light adds d a times the cosine-weighted mean of the radiance over the hemisphere;
* a mirror shows the surface in the mirrored direction, or the environment if there is no surface;
* only lights make highlights. The light that comes from another surface is its whole radiance:
  ambient, diffuse, highlights, reflection. The ambient term stays constant, as if the surface
  glowed.

Surfaces beyond the reach are not imaged, but they cast shadows and send light.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.backend import padded
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.lines import crossed_frustum
from xfrustum.reference.llvm import mitsuba_backend, vector_backend
from xfrustum.reference.pictures import mean_color, points_per_side
from xfrustum.reference.shading import LINEAR, Shader, ShadowedShader
from xfrustum.reference.tracers import register_sensor, robust_scene, sensor_parameters, unit_scale
from xfrustum.scenes.appearance import Environment, Transport
from xfrustum.scenes.arrays import Bytes, Floats, Numbers
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture

#: Smallest squared area used as a divisor; it replaces the zero of a triangle without area
MIN_SQUARED_AREA = 2.0**-1000


class Table:
    """Numbers, or rows of three numbers, looked up by index."""

    def __init__(self, entries: NDArray[Any]) -> None:
        mi = vector_backend().mitsuba
        kinds = {
            "float64": mi.Float64,
            "float32": mi.Float32,
            "int32": mi.Int32,
            "uint32": mi.UInt32,
        }
        self._array = kinds[str(entries.dtype)](padded(entries, entries.dtype))
        self._vector = mi.Vector3f if entries.dtype == np.float32 else mi.Vector3d

    def number(self, index: Any) -> Any:
        """Return an entry; the index counts all entries of all rows."""
        return mitsuba_backend().drjit.gather(type(self._array), self._array, index)

    def vector(self, row: Any) -> Any:
        """Return a row of three numbers as a vector of doubles."""
        backend = mitsuba_backend()
        return backend.mitsuba.Vector3d(backend.drjit.gather(self._vector, self._array, row))


class Textures:
    """All pictures in one table, four bytes a texel; see `shading.Textures`."""

    def __init__(self, textures: tuple[Bytes, ...], texture_of_triangle: Numbers) -> None:
        packed = [np.ascontiguousarray(texture).view("<u4").ravel() for texture in textures]
        self._texels = Table(np.concatenate(packed).astype(np.uint32, copy=False))
        self._starts = Table(np.cumsum([0, *(len(part) for part in packed[:-1])]).astype(np.int32))
        self._heights, self._widths = (
            Table(np.array([texture.shape[axis] for texture in textures], dtype=np.int32))
            for axis in (0, 1)
        )
        self._of_triangle = Table(texture_of_triangle.astype(np.int32))
        self._linear = Table(LINEAR)

    def color(self, triangle: Any, uv: Any) -> Any:
        """Return linear RGB at texture coordinates, x and y of a vector; 1 without a texture."""
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        number = self._of_triangle.number(triangle)
        textured = number >= 0
        number = dr.maximum(number, 0)
        start, width, height = (
            t.number(number) for t in (self._starts, self._widths, self._heights)
        )

        def texel(row: Any, column: Any) -> Any:
            code = self._texels.number(
                start + _repeated(row, height) * width + _repeated(column, width)
            )
            return mi.Vector3d(*(self._linear.number((code >> bits) & 255) for bits in (0, 8, 16)))

        u, v = dr.select(textured, uv.x, 0.0), dr.select(textured, uv.y, 0.0)
        color = _between_texels(texel, (1.0 - v) * mi.Float64(height), u * mi.Float64(width))
        return dr.select(textured, color, mi.Vector3d(1.0))


class Surroundings:
    """The environment by direction."""

    def __init__(self, environment: Environment) -> None:
        self._height, self._width = environment.radiance.shape[:2]
        self._strength = environment.strength
        self._texels = Table(environment.radiance)

    def radiance(self, direction: Any) -> Any:
        """Return the environment's linear RGB in a direction, of any length."""
        dr = mitsuba_backend().drjit

        def texel(row: Any, column: Any) -> Any:
            inside = dr.clip(row, 0.0, self._height - 1.0)
            index = mitsuba_backend().mitsuba.Int32(inside) * self._width + _repeated(
                column, self._width
            )
            return self._texels.vector(index)

        around = dr.atan2(direction.x, -direction.z) / (2.0 * dr.pi) + 0.5
        down = 0.5 - dr.atan2(direction.y, dr.hypot(direction.x, direction.z)) / dr.pi
        return self._strength * _between_texels(texel, down * self._height, around * self._width)


@dataclass(frozen=True, kw_only=True, eq=False)
class Point:
    """Visible point of a surface, in scaled scene units.

    `side`, `normal` and `eye` are unit vectors: the triangle's own normal and the normal for
    shading, both turned to the visible side, and the eye vector. `albedo` is vertex color
    times texture.
    """

    position: Any
    side: Any
    normal: Any
    eye: Any
    albedo: Any
    object: Any

    @property
    def mirrored(self) -> Any:
        """The eye vector reflected across the normal."""
        return 2.0 * mitsuba_backend().drjit.dot(self.normal, self.eye) * self.normal - self.eye


class Surfaces:
    """All triangles of a scene, by number; lengths are multiplied by a scale."""

    def __init__(self, scene: Scene, scale: float) -> None:
        surface = scene.surface
        self._vertices = Table(scene.vertices * scale)
        self._faces = Table(scene.faces.astype(np.int32))
        self._normals = Table(scene.normals)
        self._objects = Table(scene.object_of_triangle)
        names = ("vertex_normals", "vertex_colors")
        self._vertex_normals, self._vertex_colors = (
            None if getattr(surface, name) is None else Table(getattr(surface, name))
            for name in names
        )
        self._textures: tuple[Textures, Table] | None = None
        if surface.texture_of_triangle is not None and surface.uv is not None:
            pictures = Textures(surface.textures, surface.texture_of_triangle)
            # Texture coordinates are padded to rows of three, as all vectors of a `Table` are.
            self._textures = pictures, Table(np.pad(surface.uv, ((0, 0), (0, 1))))

    def point(self, triangle: Any, origin: Any, direction: Any) -> Point:
        """Return the points where lines meet triangles' planes; any length of `direction`."""
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        face = [self._faces.number(3 * triangle + corner) for corner in range(3)]
        a, b, c = (self._vertices.vector(corner) for corner in face)
        flat = self._normals.vector(triangle)
        slope = dr.dot(flat, direction)
        turn = dr.select(slope > 0.0, -1.0, 1.0)
        met = (
            origin
            + direction * (dr.dot(flat, a - origin) / dr.select(slope == 0.0, 1.0, slope))
            - a
        )

        # The point is kept on the triangle: a float32 ray may graze a triangle that the line
        # misses.
        plane = dr.cross(b - a, c - a)
        inverse = 1.0 / dr.maximum(dr.squared_norm(plane), MIN_SQUARED_AREA)
        of_b = dr.clip(dr.dot(plane, dr.cross(met, c - a)) * inverse, 0.0, 1.0)
        of_c = dr.clip(dr.dot(plane, dr.cross(b - a, met)) * inverse, 0.0, 1.0 - of_b)
        weights = (1.0 - of_b - of_c, of_b, of_c)

        def between(table: Table) -> Any:
            parts = (
                weight * table.vector(corner) for weight, corner in zip(weights, face, strict=True)
            )
            return sum(parts, mi.Vector3d(0.0))

        normal, albedo = flat, mi.Vector3d(1.0)
        if self._vertex_normals is not None:
            smooth = between(self._vertex_normals)
            # Use the flat normal if a corner has no normal, so that the sum is NaN, or if normals
            # cancel.
            defined = dr.squared_norm(smooth) > 0.0
            normal = dr.normalize(dr.select(defined, smooth, flat))
        if self._vertex_colors is not None:
            albedo = albedo * between(self._vertex_colors)
        if self._textures is not None:
            pictures, uv = self._textures
            albedo = albedo * pictures.color(triangle, between(uv))
        return Point(
            position=a + of_b * (b - a) + of_c * (c - a),
            side=turn * flat,
            normal=turn * normal,
            eye=-dr.normalize(direction),
            albedo=albedo,
            object=self._objects.number(triangle),
        )


def _repeated(index: Any, size: Any) -> Any:
    """Return a whole number, given as a double, as an index modulo a size."""
    mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
    count = mi.Float64(size)
    whole = index - count * dr.floor(index / count)
    return mi.Int32(whole)


def _between_texels(texel: Callable[[Any, Any], Any], down: Any, right: Any) -> Any:
    """Mix the four texels about a place; centers of texels lie at halves."""
    dr = mitsuba_backend().drjit
    row, column = dr.floor(down - 0.5), dr.floor(right - 0.5)
    below, right_share = down - 0.5 - row, right - 0.5 - column
    upper = dr.lerp(texel(row, column), texel(row, column + 1.0), right_share)
    lower = dr.lerp(texel(row + 1.0, column), texel(row + 1.0, column + 1.0), right_share)
    return dr.lerp(upper, lower, below)


#: unit roundoff of float32
SINGLE = 2.0**-24

#: Distance of rays' starts from their surface, in roundings of the scene's largest coordinate, on
#: the visible side, so that a surface does not hide itself. Rounding a triangle's corners and the
#: start to float32 moves them relative to each other by up to 2 sqrt(3) roundings. Embree computes
#: the side of the plane on which a ray starts, with 6 roundings, from corners relative to the
#: start; these are up to 2 sqrt(3) long. The sum is 25, and 64 leaves a factor of two. Shadows
#: closer to their caster than this distance, some 4e-6 of the scene's size, are lost.
CLEARANCE = 64

#: Number of bounces before Russian roulette, and the largest probability that a path survives it
FREE_BOUNCES, MAX_CHANCE = 3, 0.95

#: Logarithm below which a power is taken as zero: it is 1e-304, and float64 ends at 1e-308
MIN_LOGARITHM = -700.0

#: Largest number of bounces. Light scattered more often is left out: a share of 1e-6 at albedo 0.9
MAX_BOUNCES = 128


class LightPaths:
    """A scene of at least one triangle, loaded into Mitsuba, and light paths through it."""

    def __init__(self, scene: Scene) -> None:
        self.scale = unit_scale(scene.vertices)
        self._scene = robust_scene(scene, self.scale)
        self._surfaces = Surfaces(scene, self.scale)
        names = ("ambient", "diffuse", "specular", "reflectivity", "exponent")
        self._material = SimpleNamespace(
            **{
                name: Table(np.array([getattr(m, name) for m in scene.materials], float))
                for name in names
            }
        )
        self._lights = scene.appearance.lights
        environment = scene.appearance.environment
        self._surroundings = None if environment is None else Surroundings(environment)
        self._offset = CLEARANCE * SINGLE * float(np.abs(scene.vertices * self.scale).max())

    def first(self, ray: Any, active: Any) -> tuple[Any, Any]:
        """Return the first triangle along float32 rays, and whether there is any."""
        dr, mi = mitsuba_backend().drjit, mitsuba_backend().mitsuba
        met = self._scene.ray_intersect_preliminary(ray, active=active)
        valid = met.is_valid() & active
        return dr.select(valid, mi.Int32(met.prim_index), 0), valid

    def radiance(
        self, first: tuple[Any, Any], line: tuple[Any, Any], transport: Transport, sampler: Any
    ) -> Any:
        """Return linear RGB that arrives along lines, one path each.

        `first` are the triangles that the method `first` returned. `line` are the origins and
        directions of the lines along which these triangles are seen, in double precision, scaled.
        """
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        triangle, active = first
        if not transport.interreflection:
            point = self._surfaces.point(triangle, *line)
            return dr.select(active, self._shown(point, transport, active), mi.Vector3d(0.0))

        def bounce(*state: Any) -> tuple[Any, ...]:
            sampler, count, triangle, line, share, light, active = state
            point = self._surfaces.point(triangle, *line)
            light = light + dr.select(active, share * self._shown(point, transport, active), 0.0)
            direction, weight, active = self._scattered(point, sampler, active)
            share = share * weight
            # Russian roulette: paths that go on weigh more, so that the mean is unbiased.
            chance = dr.select(count < FREE_BOUNCES, 1.0, dr.minimum(dr.max(share), MAX_CHANCE))
            active = active & (mi.Float64(sampler.next_1d()) < chance) & (count + 1 < MAX_BOUNCES)
            share = dr.select(active, share / dr.select(active, chance, 1.0), 0.0)
            line = (point.position + self._offset * point.side, direction)
            triangle, active = self.first(self._ray(*line), active)
            return sampler, count + 1, triangle, line, share, light, active

        start = (sampler, mi.UInt32(0), triangle, line, mi.Vector3d(1.0), mi.Vector3d(0.0), active)
        return dr.while_loop(start, lambda *state: state[-1], bounce)[-2]

    def _shown(self, point: Point, transport: Transport, active: Any) -> Any:
        """Return the radiance of a point along its eye vector, without interreflection."""
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        material, index = self._material, point.object
        diffuse = material.diffuse.vector(index) * point.albedo
        specular, exponent = material.specular.vector(index), material.exponent.number(index)
        mirrored = point.mirrored
        radiance = material.ambient.vector(index) * point.albedo
        for light in self._lights:
            toward = mi.Vector3d(*light.direction)
            cosine = dr.dot(point.normal, toward)
            highlight = power(dr.maximum(dr.dot(mirrored, toward), 0.0), exponent)
            lit = active & (cosine > 0.0)
            if transport.shadows:
                # A smooth normal may face a light below the triangle's own plane. The triangle does
                # not hide this light.
                under = dr.dot(point.side, toward) <= 0.0
                lit = lit & (under | self._sees(point, toward, lit))
            shown = mi.Vector3d(*light.color) * (diffuse * cosine + specular * highlight)
            radiance = radiance + dr.select(lit, shown, 0.0)
        if self._surroundings is not None:
            reflected = material.reflectivity.vector(index) * self._surroundings.radiance(mirrored)
            if transport.interreflection:
                # A mirrored direction below the triangle's own plane, which a smooth normal may
                # cause, is not followed.
                under = dr.dot(point.side, mirrored) <= 0.0
                reflected = dr.select(under | self._sees(point, mirrored, active), reflected, 0.0)
            radiance = radiance + reflected
        return radiance

    def _sees(self, point: Point, direction: Any, active: Any) -> Any:
        """Return whether a direction from a point is unobstructed and above its triangle."""
        dr = mitsuba_backend().drjit
        active = active & (dr.dot(point.side, direction) > 0.0)
        ray = self._ray(point.position + self._offset * point.side, direction)
        return active & ~self._scene.ray_test(ray, active)

    def _scattered(self, point: Point, sampler: Any, active: Any) -> tuple[Any, Any, Any]:
        """Return a random direction of scattering, its weight, and whether the path goes on."""
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        diffuse = self._material.diffuse.vector(point.object) * point.albedo
        mirror = self._material.reflectivity.vector(point.object)
        # Choose mirror or diffuse in proportion to their light; the weight divides by the
        # probability.
        both = dr.sum(diffuse) + dr.sum(mirror)
        chance = dr.sum(mirror) / dr.select(both > 0.0, both, 1.0)
        reflects = mi.Float64(sampler.next_1d()) < chance
        around = mi.Frame3f(mi.Vector3f(point.normal))
        anywhere = mi.Vector3d(
            around.to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d()))
        )
        direction = dr.select(reflects, point.mirrored, anywhere)
        weight = dr.select(reflects, mirror, diffuse) / dr.select(reflects, chance, 1.0 - chance)
        active = active & (both > 0.0) & (dr.dot(point.side, direction) > 0.0)
        return direction, weight, active

    def _ray(self, origin: Any, direction: Any) -> Any:
        mi = mitsuba_backend().mitsuba
        return mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))


def power(base: Any, exponent: Any) -> Any:
    """Return a power of a cosine; zero where Dr.Jit's function gives minus infinity or NaN."""
    dr = mitsuba_backend().drjit
    base = dr.minimum(base, 1.0)
    within = (base > 0.0) & (exponent * dr.log(dr.select(base > 0.0, base, 1.0)) > MIN_LOGARITHM)
    return dr.select(within, dr.power(dr.select(within, base, 1.0), exponent), 0.0)


#: largest number of light paths of one launch: each path takes 200 bytes of memory
PATHS_AT_ONCE = 1 << 20


@dataclass(frozen=True, kw_only=True, eq=False)
class RadianceEstimate:
    """A picture (H, W, 3) in linear RGB from `samples` random light paths a pixel, and its noise.

    The variance of the mean (H, W, 3) is estimated from the samples. It is zero where all samples
    agree, as in pixels without supersampling and without interreflection.
    """

    mean: Floats
    variance_of_mean: Floats
    samples: int


class PathTracer:
    """Light transport of a scene; paths start at the points of its sampling."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    @property
    def versions(self) -> dict[str, str]:
        """Names and versions of the libraries that compute the paths, for reports."""
        return mitsuba_backend().versions

    @cached_property
    def _paths(self) -> LightPaths:
        return LightPaths(self.scene)

    @cached_property
    def _triangles(self) -> Triangles:
        return Triangles(self.scene.triangles)

    @cached_property
    def _shaders(self) -> tuple[Shader, ShadowedShader]:
        """Shaders of direct light: without shadows, and with exact shadows."""
        return Shader(self.scene), ShadowedShader(self.scene)

    def _direct(self, aperture: Aperture, *, shadows: bool) -> Floats:
        """Return mean direct light (H, W, 3) over the points of each pixel; shadows are exact."""
        side, rows = points_per_side(self.scene.sampling), range(self.scene.frustum.resolution[1])
        shader = self._shaders[shadows]
        return mean_color(self.scene, self._triangles, shader, [aperture], side, rows)

    def render(
        self, aperture: Aperture, transport: Transport, seed: int = 0, *, exact: bool | None = None
    ) -> RadianceEstimate:
        """Return the radiance through the middle of an aperture; equal seeds give equal paths.

        Direct light, with or without shadows, can be `exact`: without paths and noise. By default
        it is exact if shadows are the only light transport. Without shadows, exact light and light
        paths agree to the rounding of colors.
        """
        if exact is None:
            exact = transport.shadows and not transport.interreflection
        if exact and len(self.scene.faces):
            mean = self._direct(aperture, shadows=transport.shadows)
            return RadianceEstimate(
                mean=mean, variance_of_mean=np.zeros_like(mean), samples=transport.samples
            )
        width, height = self.scene.frustum.resolution
        mean, variance = np.zeros((height * width, 3)), np.zeros((height * width, 3))
        if len(self.scene.faces):
            starts = _PathStarts(self.scene, aperture, self._paths.scale)

            def path(pixel: Any, sampler: Any) -> Any:
                first_hit, line = starts.seen(self._paths, pixel, sampler)
                return self._paths.radiance(first_hit, line, transport, sampler)

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
    """Lines of one image; a path takes one of the lines of its pixel at random.

    The sensor's rays, in float32, hit a surface. The light of the surface is computed in double
    precision, along the line of the reference. Lengths are multiplied by a scale.
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
        # Opaque values, so that another image does not compile another kernel.
        self._center = [dr.opaque(mi.Float64, scale * part) for part in fine.center]
        self._side, self._width, self._height = (
            dr.opaque(mi.UInt32, n) for n in (side, width, height)
        )

    def seen(self, paths: LightPaths, pixel: Any, sampler: Any) -> tuple[Any, Any]:
        """Return the result of `LightPaths.first` on a random line of a pixel, and the line."""
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        row, column = pixel // (self._width // self._side), pixel % (self._width // self._side)
        part = sampler.next_2d()
        x, y = (
            place * self._side + dr.minimum(mi.UInt32(share * self._side), self._side - 1)
            for place, share in ((column, part.x), (row, part.y))
        )
        film = mi.Point2f((mi.Float64(x) + 0.5) / self._width, (mi.Float64(y) + 0.5) / self._height)
        ray, _ = self._sensor.sample_ray(0.0, 0.5, film, mi.Point2f(0.5))
        line = (
            mi.Vector3d(*self._center),
            mi.Vector3d(self._dx.number(x), self._dy.number(y), -1.0),
        )
        return paths.first(ray, mi.Bool(True)), line


class _Moments:
    """Mean and variance of samples in batches (Chan, Golub and LeVeque, 1983)."""

    def __init__(self, pixels: int) -> None:
        self._count = 0
        self.mean = np.zeros((pixels, 3))
        self._squares = np.zeros((pixels, 3))

    def add(self, colors: Floats) -> None:
        """Add samples (pixels, n, 3)."""
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
    # Opaque values, so that another launch does not compile another kernel.
    first, times = (dr.opaque(mi.UInt32, value) for value in (pixels.start, paths))
    color = path(first + dr.arange(mi.UInt32, count) // times, sampler).numpy()
    return np.asarray(color.T.reshape(len(pixels), paths, 3), dtype=np.float64)
