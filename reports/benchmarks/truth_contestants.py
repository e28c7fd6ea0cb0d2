"""Contestants for a race to the truth: the certified one, and what others would have called one.

All answer for the same pixels of one aperture. What they answer differs, and so does what it
costs: a triangle number in float32, a point, or a number, a place along the line and a proof.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version

import numpy as np
from trimesh import Trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from xfrustum.reference.devices.dr_jit import backend
from xfrustum.reference.lines.lines import crossed_frustum
from xfrustum.reference.tracers.bare_mitsuba import bare_intersection
from xfrustum.reference.tracers.embree import EmbreeTracer
from xfrustum.reference.tracers.entry import ray_origins
from xfrustum.reference.truth import Reference
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

Run = Callable[[], object]
"""Answers for all pixels of an image, and returns when that is done."""

MITSUBA, EMBREE, TRIMESH = "mitsuba", "embree", "trimesh"
CERTIFIED, TRUTH = "certified", "truth"
MEANINGS = {
    MITSUBA: "Mitsuba's bare ray_intersect_preliminary, robust, rays on the device",
    EMBREE: "Embree through embreex, robust, rays from NumPy: triangle numbers",
    TRIMESH: "trimesh's intersects_location, first hits only",
    CERTIFIED: "certified triangle, place along the line and certainty, with all set-up",
    TRUTH: "the whole true image: also points, normals and colors, without a second opinion",
}
"""All contestants, in the order in which they are listed."""


def truth_contestants(scene: Scene, aperture: Aperture) -> dict[str, Run]:
    """Return the contestants that there are here, by the names in `MEANINGS`.

    Acceleration structures are built, and rays aimed, here or at the first call, which no clock
    should count. The certified truth has no such thing: each call begins with the triangles.

    Parameters
    ----------
    scene
        Scene with at least one triangle.
    aperture
        Aperture whose crossed frustum is answered for, from the viewer's end to the back.

    Returns
    -------
    dict
        `MITSUBA` is not in it where there is only its scalar variant, one ray at a time.
    """
    pencil = crossed_frustum(scene.frustum, aperture)
    directions = pencil.directions().reshape(-1, 3)
    origins = ray_origins(scene, np.asarray(pencil.center), directions, pencil.s_range[0])
    embree, reference = EmbreeTracer(scene), Reference(scene)
    mesh = RayMeshIntersector(Trimesh(scene.vertices, scene.faces, process=False))
    found: dict[str, Run] = {
        EMBREE: lambda: embree.first_hits(origins, directions),
        TRIMESH: lambda: mesh.intersects_location(origins, directions, multiple_hits=False),
        CERTIFIED: lambda: list(reference.decide(aperture)),
        TRUTH: lambda: reference.trace(aperture),
    }
    if not backend().scalar:
        found[MITSUBA] = bare_intersection(scene, origins, directions)
    return {name: found[name] for name in MEANINGS if name in found}


def versions() -> dict[str, str]:
    """Return names and versions of what the contestants are made of."""
    libraries = {name: version(name) for name in ("drjit", "embreex", "trimesh")}
    return {**backend().versions, **libraries}
