"""A closed mesh about a point: no line through the point may miss it, least of all at its corners.

In float32 and without its robust mode, Embree misses a quarter of the corners of such a sphere.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import trimesh

from xfrustum.reference.certify.arbitrary_lines import FirstAlong, first_surfaces_along
from xfrustum.reference.tracers.embree import EmbreeTracer
from xfrustum.scenes import Frustum, Plate, Scene, SceneObject
from xfrustum.scenes.arrays import Floats, Indices

SUBDIVISIONS, QUICK_SUBDIVISIONS = 6, 4
"""Numbers of subdivisions of an icosahedron: the spheres have 81,920 and 5,120 triangles."""

S_RANGE = (0.0, 2.0)
"""Range of s on every line: from the center to beyond the unit sphere, which is met at about 1."""


@dataclass(frozen=True, kw_only=True)
class SphereCheck:
    """Lines from a sphere's center through its vertices and the middles of its edges.

    Attributes
    ----------
    triangles, vertices, edges
        Numbers of triangles, vertices and edges of the sphere.
    vertex_misses, edge_misses
        Numbers of lines through vertices and through edges that meet nothing.
    wrong
        Number of lines that do not meet the right triangles: at a vertex all its triangles and no others, at
        s = 1; in the middle of an edge one of its two triangles or both.
    tracer_vertex_misses, tracer_edge_misses
        Numbers of lines that meet nothing by the float32 tracer alone, in its robust mode.
    seconds
        Time for the whole check.
    """

    triangles: int
    vertices: int
    edges: int
    vertex_misses: int
    edge_misses: int
    wrong: int
    tracer_vertex_misses: int
    tracer_edge_misses: int
    seconds: float

    @property
    def agrees(self) -> bool:
        """Whether every line meets the right triangles."""
        return self.vertex_misses == self.edge_misses == self.wrong == 0

    def sentence(self) -> str:
        """Return the counts in words."""
        return (
            f"sphere of {self.triangles:,} triangles, lines from its center: "
            f"{self.vertices:,} vertices, {self.vertex_misses:,} missed "
            f"(float32 {self.tracer_vertex_misses:,}); "
            f"{self.edges:,} edges, {self.edge_misses:,} missed (float32 {self.tracer_edge_misses:,}); "
            f"{self.wrong:,} wrong"
        )


def check_sphere(*, quick: bool = False) -> SphereCheck:
    """Ask the reference about every vertex and every edge of a sphere about the origin."""
    started = time.perf_counter()
    mesh = trimesh.creation.icosphere(subdivisions=QUICK_SUBDIVISIONS if quick else SUBDIVISIONS)
    vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    edges = np.asarray(mesh.edges_unique, dtype=np.int64)
    middles = vertices[edges].mean(axis=1)

    at_vertices = first_surfaces_along(vertices[faces], (0.0, 0.0, 0.0), vertices, S_RANGE)
    at_edges = first_surfaces_along(vertices[faces], (0.0, 0.0, 0.0), middles, S_RANGE)
    tracer = EmbreeTracer(_as_scene(vertices, faces))
    return SphereCheck(
        triangles=len(faces),
        vertices=len(vertices),
        edges=len(edges),
        vertex_misses=int((at_vertices.triangle < 0).sum()),
        edge_misses=int((at_edges.triangle < 0).sum()),
        wrong=_wrong_at_vertices(at_vertices, faces) + _wrong_at_edges(at_edges, faces, edges),
        tracer_vertex_misses=int((tracer.first_hits(np.zeros_like(vertices), vertices) < 0).sum()),
        tracer_edge_misses=int((tracer.first_hits(np.zeros_like(middles), middles) < 0).sum()),
        seconds=time.perf_counter() - started,
    )


def _wrong_at_vertices(found: FirstAlong, faces: Indices) -> int:
    """Count the vertices at which a line meets other triangles than exactly theirs, or not at s = 1."""
    around: list[list[int]] = [[] for _ in found.triangle]
    for number, corners in enumerate(faces.tolist()):
        for vertex in corners:
            around[vertex].append(number)
    return sum(
        found.ties.get(vertex, ()) != tuple(numbers) or float(found.s[vertex]) != 1.0
        for vertex, numbers in enumerate(around)
    )


def _wrong_at_edges(found: FirstAlong, faces: Indices, edges: Indices) -> int:
    """Count the edges at the rounded middle of which a line meets a triangle that is not the edge's own."""
    wrong = 0
    for line, ends in enumerate(edges.tolist()):
        met = found.ties.get(line, (int(found.triangle[line]),))
        wrong += not all(set(ends) <= set(faces[number].tolist()) for number in met)
    return wrong


def _as_scene(vertices: Floats, faces: Indices) -> Scene:
    """Return the sphere as the tracer takes it; plate and frustum play no part."""
    sphere = SceneObject(name="sphere", vertices=vertices, faces=faces)
    return Scene(
        name="sphere",
        plate=Plate(size=(1.0, 1.0), hogels=(1, 1)),
        frustum=Frustum(resolution=(1, 1), reach=(1.0, 1.0), fov=(1.0, 1.0)),
        objects=(sphere,),
    )
