"""Museum of wrong hits: six reported failures of ray tracers, reproduced with our own data.

    python -c "from xfrustum.research.rays import museum_table; print(museum_table())"

Integer arithmetic decides every pair of a ray and a triangle exactly, without a search structure.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from importlib.util import find_spec
from typing import Any

import numpy as np
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector as EmbreeIntersector
from trimesh.ray.ray_triangle import RayMeshIntersector as NativeIntersector

from xfrustum.rays import ExactIntersector
from xfrustum.reference.rays.filter import meet
from xfrustum.reference.tracers import MitsubaTracer
from xfrustum.reports.text import aligned
from xfrustum.scenes import Frustum, Plate, Scene, SceneObject
from xfrustum.scenes.arrays import Floats, Indices, Numbers

#: contestants in the order of the table
CONTESTANTS = ("Embree by trimesh", "trimesh", "Mitsuba", "ExactIntersector")

#: rays of each exhibit
RAYS = 160


@dataclass(frozen=True, kw_only=True, eq=False)
class Exhibit:
    """A mesh and rays (N, 3); `counted` compares counts of hit points, not first triangles."""

    name: str
    reports: str  #: issues of other projects that describe the failure
    mesh: trimesh.Trimesh
    origins: Floats
    directions: Floats
    counted: bool = False


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Number of rays, and of wrong results of each contestant; None for a missing contestant."""

    name: str
    reports: str
    rays: int
    wrong: dict[str, int | None]


def exhibits() -> list[Exhibit]:
    """Return the six exhibits."""
    rng = np.random.default_rng(7)
    ball = trimesh.creation.icosphere(subdivisions=2)
    ball.apply_transform(trimesh.transformations.euler_matrix(0.3, 0.6, 0.1))
    middle = np.zeros((RAYS, 3))
    vertices = ball.vertices[:RAYS]
    sheets = trimesh.util.concatenate(
        [
            trimesh.creation.box(extents=[1, 1, 2e-7]).apply_translation([0, 0, 1e-6 * number])
            for number in range(8)
        ]
    )
    above = np.column_stack((rng.uniform(-0.5, 0.5, (RAYS, 2)), np.full(RAYS, 2.0)))
    faces = ball.triangles[rng.integers(0, len(ball.faces), RAYS)]
    starts = np.einsum("nk,nki->ni", rng.dirichlet(np.ones(3), RAYS), faces)
    small = ball.copy().apply_scale(1e-25)
    distant = ball.copy().apply_scale(0.05).apply_translation([4.1e6, 5.2e6, 100.0])
    toward = distant.triangles_center[rng.integers(0, len(ball.faces), RAYS)]
    before = toward + np.array([0.0, 0.0, 50.0])
    cavity = trimesh.creation.box(extents=[1e-4] * 3)
    cavity.invert()
    hollow = trimesh.util.concatenate([trimesh.creation.box(), cavity])
    anywhere = rng.normal(size=(RAYS, 3))
    return [
        Exhibit(
            name="through vertices, from the middle of a ball",
            reports="embree 174, 181; mitsuba3 1149",
            mesh=ball,
            origins=middle[: len(vertices)],
            directions=vertices,
        ),
        Exhibit(
            name="all hits of eight sheets, 1e-6 apart",
            reports="trimesh 1097, 1496, 2504; embree 188",
            mesh=sheets,
            origins=above,
            directions=np.tile([0.0, 0.0, -1.0], (RAYS, 1)),
            counted=True,
        ),
        Exhibit(
            name="walls of a small cavity, from its inside",
            reports="trimesh 2534",
            mesh=hollow,
            origins=rng.uniform(-4e-5, 4e-5, (RAYS, 3)),
            directions=anywhere,
            counted=True,
        ),
        Exhibit(
            name="from points of a ball outward",
            reports="trimesh 48",
            mesh=ball,
            origins=starts,
            directions=starts,
        ),
        Exhibit(
            name="a ball of size 1e-25, directions of 1e-30",
            reports="embree 45, 291",
            mesh=small,
            origins=middle,
            directions=1e-30 * anywhere,
        ),
        Exhibit(
            name="a ball of 5 cm at coordinates of 5e6 m",
            reports="embree 387",
            mesh=distant,
            origins=before,
            directions=toward - before,
        ),
    ]


def museum() -> list[Verdict]:
    """Return the number of wrong results of each contestant at each exhibit."""
    return [_judged(exhibit) for exhibit in exhibits()]


def museum_table() -> str:
    """Return the museum as text, one row for each exhibit."""
    rows: list[Sequence[str]] = [["exhibit", "reports", "rays", *CONTESTANTS]]
    for verdict in museum():
        wrong = ("-" if count is None else str(count) for count in verdict.wrong.values())
        rows.append([verdict.name, verdict.reports, str(verdict.rays), *wrong])
    return aligned(rows, str.ljust)


def _judged(exhibit: Exhibit) -> Verdict:
    rays = exhibit.origins, exhibit.directions
    right = [_exact(exhibit.mesh.triangles, *ray) for ray in zip(*rays, strict=True)]
    wrong: dict[str, int | None] = dict.fromkeys(CONTESTANTS)
    makers: dict[str, Callable[[trimesh.Trimesh], Any]] = {
        "Embree by trimesh": EmbreeIntersector,
        "ExactIntersector": ExactIntersector,
    }
    if find_spec("rtree") is not None:
        makers["trimesh"] = NativeIntersector
    for name, make in makers.items():
        intersector = make(exhibit.mesh)
        if exhibit.counted:
            index = intersector.intersects_location(*rays)[1]
            counts = np.bincount(index, minlength=len(right))
            wrong[name] = sum(
                count != len(places) for count, places in zip(counts, right, strict=True)
            )
        else:
            wrong[name] = _misses(intersector.intersects_first(*rays), right)
    if not exhibit.counted:
        wrong["Mitsuba"] = _misses(MitsubaTracer(_scene(exhibit.mesh)).first_hits(*rays), right)
    return Verdict(name=exhibit.name, reports=exhibit.reports, rays=len(right), wrong=wrong)


def _exact(triangles: Floats, origin: Floats, direction: Floats) -> list[list[int]]:
    """Return the triangles at each hit point along a ray, nearest first, by integer arithmetic."""
    count = len(triangles)
    tiled = (np.tile(vector, (count, 1)) for vector in (origin, direction, [0.0, np.inf]))
    decided = meet(np.array(triangles), *tiled)
    places: dict[Fraction, list[int]] = {}
    for number in np.flatnonzero(decided.met).tolist():
        places.setdefault(decided.place(number), []).append(number)
    return [numbers for _, numbers in sorted(places.items())]


def _misses(first: Indices | Numbers, right: list[list[list[int]]]) -> int:
    """Return the number of rays whose first triangle is not an exact first triangle."""
    return sum(
        number not in (places[0] if places else [-1])
        for number, places in zip(first.tolist(), right, strict=True)
    )


def _scene(mesh: trimesh.Trimesh) -> Scene:
    # A tracer uses neither plate nor frustum.
    return Scene(
        name="museum",
        plate=Plate(size=(1.0, 1.0), hogels=(1, 1)),
        frustum=Frustum(resolution=(1, 1), reach=(1.0, 1.0), fov=(1.0, 1.0)),
        objects=(
            SceneObject(
                name="mesh",
                vertices=np.array(mesh.vertices),
                faces=np.array(mesh.faces, dtype=np.int64),
            ),
        ),
    )
