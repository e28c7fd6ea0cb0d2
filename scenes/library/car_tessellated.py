"""The car in as many triangles as one likes, a share of them reflective: the paper's table 1 needs two."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from xfrustum.scenes.arrays import Indices, Mask
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.geometry.refine import refine
from xfrustum.scenes.geometry.smoothing import smoothed
from xfrustum.scenes.library import builtin
from xfrustum.scenes.library.studio import studio
from xfrustum.scenes.model.scene import Scene, SceneObject, read_only


@dataclass(frozen=True, kw_only=True, eq=False)
class TessellatedCar:
    """The car, and which of its triangles reflect.

    Attributes
    ----------
    scene
        The built-in car's, in other triangles.
    reflective
        (F,) the first triangles, beginning with the body's.
    """

    scene: Scene
    reflective: Mask


def tessellated_car(polygons: int, reflective_share: float) -> TessellatedCar:
    """Return the car in a number of triangles, a share of which is reflective.

    The surface is the built-in car's: triangles are split in four while that leaves too few, and then
    the longest edges at their middles, each in the two triangles that it bounds.

    Parameters
    ----------
    polygons
        Number of triangles, at least that of the built-in car. Splitting an edge may add two: then the car
        can have one triangle fewer.
    reflective_share
        Share of the triangles that reflect, 0 to 1; their number is rounded.

    Raises
    ------
    InputError
        There are too few polygons, or the share is none.
    """
    scene = builtin.build("car")
    if polygons < len(scene.faces) or not 0 <= reflective_share <= 1:
        raise InputError(
            f"the car has at least {len(scene.faces):,} triangles, of which a share from 0 to 1 may "
            f"reflect; not {polygons:,} and {reflective_share}"
        )
    while 4 * len(scene.faces) <= polygons:
        scene = refine(scene, 1)
    while split := _with_edges_split(scene, polygons - len(scene.faces)):
        scene = split
    reflective = np.arange(len(scene.faces)) < round(reflective_share * len(scene.faces))
    return TessellatedCar(scene=scene, reflective=read_only(reflective))


def mirrored(car: TessellatedCar) -> Scene:
    """Return the car in the studio's paint, smooth, with mirrors where it is reflective and nowhere else."""
    studio_look = studio()
    paint = studio_look.materials["paint"]
    dull = replace(paint, reflectivity=(0.0, 0.0, 0.0))
    objects = []
    first = 0
    for part in map(smoothed, car.scene.objects):
        reflective = car.reflective[first : first + len(part.faces)]
        first += len(part.faces)
        for material, chosen in (("paint", reflective), ("dull", ~reflective)):
            if chosen.any():
                objects.append(replace(part, faces=part.faces[chosen], material=material))
    materials = MappingProxyType({"paint": paint, "dull": dull})
    return replace(car.scene, objects=tuple(objects), appearance=replace(studio_look, materials=materials))


def _with_edges_split(scene: Scene, more: int) -> Scene | None:
    """Return the scene with up to this many more triangles; None where no split fits any more.

    No triangle is split twice. Objects are split in proportion; the largest comes last and gets the rest.
    """
    order = sorted(range(len(scene.objects)), key=lambda number: len(scene.objects[number].faces))
    objects, left, faces = list(scene.objects), more, len(scene.faces)
    for number in order:
        count = len(objects[number].faces)
        wanted = left if number == order[-1] else more * count // faces
        objects[number] = _split_longest(objects[number], wanted)
        left -= len(objects[number].faces) - count
    return None if left == more else replace(scene, objects=tuple(objects))


def _split_longest(part: SceneObject, more: int) -> SceneObject:
    """Split the longest edges at their middles, for at most this many more triangles."""
    sides = np.stack([part.faces, np.roll(part.faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    edges, edge_of_side, uses = np.unique(
        np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    length = np.linalg.norm(part.vertices[edges[:, 0]] - part.vertices[edges[:, 1]], axis=1)
    sides_of_edge = np.split(np.argsort(edge_of_side, kind="stable"), np.cumsum(uses)[:-1])
    # For each triangle, the corner at which the edge that is split begins; -1 where none is.
    corner_of_face = np.full(len(part.faces), -1)
    for edge in np.argsort(-length, kind="stable"):
        faces, corners = np.divmod(sides_of_edge[edge], 3)
        if len(faces) <= more and (corner_of_face[faces] < 0).all():
            corner_of_face[faces] = corners
            more -= len(faces)
        if more <= 0:
            break
    return _split(part, corner_of_face, edges, edge_of_side.reshape(-1, 3))


def _split(
    part: SceneObject,
    corner_of_face: Indices,
    edges: Indices,
    edge_of_face: Indices,
) -> SceneObject:
    """Split each face in two at the middle of its edge from a corner to the next; -1 leaves it whole."""
    (split,) = np.nonzero(corner_of_face >= 0)
    if not len(split):
        return part
    start = corner_of_face[split]
    used, middle = np.unique(edge_of_face[split, start], return_inverse=True)
    middle = middle + len(part.vertices)
    a, b, c = (part.faces[split, (start + step) % 3] for step in range(3))
    first = part.faces.copy()
    first[split] = np.stack([a, middle, c], axis=1)
    # Halves stay neighbors in the order of drawing.
    faces = np.insert(first, split + 1, np.stack([middle, b, c], axis=1), axis=0)
    middles = part.vertices[edges[used]].mean(axis=1)
    return replace(part, vertices=np.concatenate([part.vertices, middles]), faces=faces)
