"""Light that comes from a surface point, directly or by way of others, with shadows or without.

The surfaces are those of CONVENTIONS.md, "Light". A light of color I has the irradiance pi I on a surface
that faces it, so that a diffuse surface of coefficient d and albedo a scatters the share d a of the incident
light, and shows d a / pi of its irradiance. Hence, with interreflection:

* diffuse light adds d a times the mean of the radiance that arrives over the hemisphere, by cosine;
* a mirror shows the surface that lies in the mirrored direction, and the environment only where none does;
* only lights make highlights; light from another surface is its whole radiance: ambient, diffuse, highlights,
  reflection. The ambient term stays constant, as if the surface glowed.

Surfaces beyond the reach are not imaged, but they cast shadows and send light.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np

from xfrustum.reference.llvm import mitsuba_backend
from xfrustum.reference.tracers.mitsuba_tracer import robust_scene
from xfrustum.reference.tracers.tracer import unit_scale
from xfrustum.reference.transport.surfaces import Point, Surfaces, Surroundings, Table
from xfrustum.scenes.appearance.sampling import Transport
from xfrustum.scenes.model.scene import Scene

SINGLE = 2.0**-24  #: unit roundoff of float32

CLEARANCE = 64
"""Distance by which rays start off their surface, in roundings of the scene's largest coordinate, to the side
that is seen, so that a surface does not hide itself. Rounding a triangle's corners and the start to float32
moves them against each other by up to 2 sqrt(3). From corners relative to the start, up to 2 sqrt(3) long,
Embree computes the side of the plane that a ray starts on with 6 roundings. That makes 25 in all, and 64
leaves a factor of two. A shadow that begins nearer to its caster than this is lost: some 4e-6 of the scene's
size."""

FREE_BOUNCES, MAX_CHANCE = 3, 0.95
"""Bounces that every path may make, and the largest chance to go on after them (Russian roulette)."""

MIN_LOGARITHM = -700.0
"""Logarithm below which a power is taken as zero: it is 1e-304, and float64 ends at 1e-308."""

MAX_BOUNCES = 128
"""Largest number of bounces. Light that is scattered more often is left out; at albedo 0.9 that is 1e-6 of
all light."""


class LightPaths:
    """A scene with at least one triangle in Mitsuba, and the light paths through it."""

    def __init__(self, scene: Scene) -> None:
        self.scale = unit_scale(scene.vertices)
        self._scene = robust_scene(scene, self.scale)
        self._surfaces = Surfaces(scene, self.scale)
        names = ("ambient", "diffuse", "specular", "reflectivity", "exponent")
        self._material = SimpleNamespace(
            **{name: Table(np.array([getattr(m, name) for m in scene.materials], float)) for name in names}
        )
        self._lights = scene.appearance.lights
        environment = scene.appearance.environment
        self._surroundings = None if environment is None else Surroundings(environment)
        self._offset = CLEARANCE * SINGLE * float(np.abs(scene.vertices * self.scale).max())

    def first(self, ray: Any, active: Any) -> tuple[Any, Any]:
        """Return the number of the first triangle that float32 rays meet, and whether they meet any."""
        dr, mi = mitsuba_backend().drjit, mitsuba_backend().mitsuba
        met = self._scene.ray_intersect_preliminary(ray, active=active)
        found = met.is_valid() & active
        return dr.select(found, mi.Int32(met.prim_index), 0), found

    def radiance(
        self, found: tuple[Any, Any], line: tuple[Any, Any], transport: Transport, sampler: Any
    ) -> Any:
        """Return linear RGB that arrives along lines, one path each.

        `found` is what `first` returns; `line` are origin and direction of the line along which that surface
        is seen, in double precision, scaled.
        """
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        triangle, active = found
        if not transport.interreflection:
            point = self._surfaces.point(triangle, *line)
            return dr.select(active, self._shown(point, transport, active), mi.Vector3d(0.0))

        def bounce(*state: Any) -> tuple[Any, ...]:
            sampler, count, triangle, line, share, light, active = state
            point = self._surfaces.point(triangle, *line)
            light = light + dr.select(active, share * self._shown(point, transport, active), 0.0)
            direction, weight, active = self._scattered(point, sampler, active)
            share = share * weight
            chance = dr.select(count < FREE_BOUNCES, 1.0, dr.minimum(dr.max(share), MAX_CHANCE))
            active = active & (mi.Float64(sampler.next_1d()) < chance) & (count + 1 < MAX_BOUNCES)
            share = dr.select(active, share / dr.select(active, chance, 1.0), 0.0)
            line = (point.position + self._offset * point.side, direction)
            triangle, active = self.first(self._ray(*line), active)
            return sampler, count + 1, triangle, line, share, light, active

        start = (sampler, mi.UInt32(0), triangle, line, mi.Vector3d(1.0), mi.Vector3d(0.0), active)
        return dr.while_loop(start, lambda *state: state[-1], bounce)[-2]

    def _shown(self, point: Point, transport: Transport, active: Any) -> Any:
        """Return the radiance of a point along its eye vector, without the light of other surfaces."""
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
                # A light that a smooth normal faces, but that lies under the triangle's own plane, is not
                # hidden by that triangle.
                under = dr.dot(point.side, toward) <= 0.0
                lit = lit & (under | self._sees(point, toward, lit))
            shown = mi.Vector3d(*light.color) * (diffuse * cosine + specular * highlight)
            radiance = radiance + dr.select(lit, shown, 0.0)
        if self._surroundings is not None:
            reflected = material.reflectivity.vector(index) * self._surroundings.radiance(mirrored)
            if transport.interreflection:
                # A mirrored direction that lies under the triangle's own plane, because of a smooth
                # normal, is not followed.
                under = dr.dot(point.side, mirrored) <= 0.0
                reflected = dr.select(under | self._sees(point, mirrored, active), reflected, 0.0)
            radiance = radiance + reflected
        return radiance

    def _sees(self, point: Point, direction: Any, active: Any) -> Any:
        """Return whether nothing hides a direction from a point, not even the point's own triangle."""
        dr = mitsuba_backend().drjit
        active = active & (dr.dot(point.side, direction) > 0.0)
        ray = self._ray(point.position + self._offset * point.side, direction)
        return active & ~self._scene.ray_test(ray, active)

    def _scattered(self, point: Point, sampler: Any, active: Any) -> tuple[Any, Any, Any]:
        """Return a random direction to look for light of other surfaces, its weight, and whether to look."""
        mi, dr = mitsuba_backend().mitsuba, mitsuba_backend().drjit
        diffuse = self._material.diffuse.vector(point.object) * point.albedo
        mirror = self._material.reflectivity.vector(point.object)
        both = dr.sum(diffuse) + dr.sum(mirror)
        chance = dr.sum(mirror) / dr.select(both > 0.0, both, 1.0)
        reflects = mi.Float64(sampler.next_1d()) < chance
        around = mi.Frame3f(mi.Vector3f(point.normal))
        anywhere = mi.Vector3d(around.to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d())))
        direction = dr.select(reflects, point.mirrored, anywhere)
        weight = dr.select(reflects, mirror, diffuse) / dr.select(reflects, chance, 1.0 - chance)
        active = active & (both > 0.0) & (dr.dot(point.side, direction) > 0.0)
        return direction, weight, active

    def _ray(self, origin: Any, direction: Any) -> Any:
        mi = mitsuba_backend().mitsuba
        return mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))


def power(base: Any, exponent: Any) -> Any:
    """Return a power of a cosine, at most one, and zero where it is too small for a double.

    Dr.Jit's own returns minus infinity or NaN there. A cosine that was rounded to more than one counts as
    one.
    """
    dr = mitsuba_backend().drjit
    base = dr.minimum(base, 1.0)
    within = (base > 0.0) & (exponent * dr.log(dr.select(base > 0.0, base, 1.0)) > MIN_LOGARITHM)
    return dr.select(within, dr.power(dr.select(within, base, 1.0), exponent), 0.0)
