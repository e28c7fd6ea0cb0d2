"""Built-in shapes of size one about the origin, which `shape = "..."` in a scene file names."""

import difflib
from collections.abc import Callable
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes import InputError, SceneObject
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.geometry import SHAPE_NAMES

Mesh = tuple[Floats, Indices]  #: vertices (V, 3) and faces (F, 3)


def box() -> Mesh:
    """Return the cube of side 1."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, triangulate(np.array(quads))


def square() -> Mesh:
    """Return the square of side 1 in z = 0 that faces +z."""
    corners = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    return corners, triangulate(np.array([(0, 1, 2, 3)]))


def lathe(radii: Floats, heights: Floats, *, sectors: int = 48) -> Mesh:
    """Turn a profile (N,), from the bottom up along the outside, about the y axis; facets face outward."""
    turn = 2 * np.pi * np.arange(sectors) / sectors
    level = np.broadcast_to(heights[:, None], (len(heights), sectors))
    return wrapped_grid(
        np.stack([radii[:, None] * np.sin(turn), level, radii[:, None] * np.cos(turn)], axis=-1)
    )


def ball(radius: float, bands: int, sectors: int) -> Mesh:
    """Return a sphere about the origin, poles on the y axis."""
    polar = np.linspace(0, np.pi, bands + 1)
    return lathe(radius * np.sin(polar), -radius * np.cos(polar), sectors=sectors)


def wrapped_grid(rings: Floats) -> Mesh:
    """Join rings of points (N, M, 3) into a tube; rings that shrink to a point close it.

    Coordinates are rounded to 1e-6, so that sine tables that differ from machine to machine in the last bit
    give the same content hash.
    """
    count, around = rings.shape[:2]
    vertices = np.round(rings.reshape(-1, 3), 6) + 0.0
    index = np.arange(count * around).reshape(count, around)
    beside = np.roll(index, -1, axis=1)
    quads = np.stack([index[:-1], beside[:-1], beside[1:], index[1:]], axis=-1).reshape(-1, 4)
    return drop_flat(vertices, triangulate(quads))


def open_grid(points: Floats) -> Mesh:
    """Join a grid of points (N, M, 3) into a sheet; it faces where rows x columns point."""
    return np.round(points.reshape(-1, 3), 6) + 0.0, grid_faces(*points.shape[:2])


def grid_faces(rows: int, columns: int) -> Indices:
    """Return the faces of a sheet of rows x columns vertices, which faces where rows x columns point."""
    index = np.arange(rows * columns).reshape(rows, columns)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)
    return triangulate(quads.reshape(-1, 4))


def triangulate(quads: NDArray[np.integer]) -> Indices:
    """Split quads (N, 4) into triangles (2 N, 3) along the first diagonal."""
    return np.asarray(quads, dtype=np.int64)[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def drop_flat(vertices: Floats, faces: Indices) -> Mesh:
    """Leave out triangles two of whose corners are the same point."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    flat = (a == b).all(axis=1) | (b == c).all(axis=1) | (c == a).all(axis=1)
    return vertices, faces[~flat]


def join(*meshes: Mesh) -> Mesh:
    """Put meshes into one, in order."""
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [faces + offset for (_, faces), offset in zip(meshes, offsets, strict=False)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


_TURN = np.linspace(0, 2 * np.pi, 25)

#: Meshes by name. Bodies about the y axis are closed, of diameter and height 1, the cone's tip on top; the
#: tube of the torus has a diameter of 0.3.
SHAPES: MappingProxyType[str, Callable[[], Mesh]] = MappingProxyType({
    "box": box,
    "square": square,
    "sphere": lambda: ball(0.5, 24, 48),
    "cylinder": lambda: lathe(np.array([0, 0.5, 0.5, 0]), np.array([-0.5, -0.5, 0.5, 0.5])),
    "cone": lambda: lathe(np.array([0, 0.5, 0]), np.array([-0.5, -0.5, 0.5])),
    "torus": lambda: lathe(0.35 + 0.15 * np.cos(_TURN), 0.15 * np.sin(_TURN)),
})  # fmt: skip
assert tuple(SHAPES) == SHAPE_NAMES


def as_object(name: str, mesh: Mesh, **attributes: Any) -> SceneObject:
    """Return a mesh as an object of a scene."""
    return SceneObject(name=name, vertices=mesh[0], faces=mesh[1], **attributes)


def build_shape(name: str, *, material: str | None = None) -> SceneObject:
    """Return a built-in shape as an object in its own coordinates; InputError where there is none."""
    if name not in SHAPES:
        nearest = difflib.get_close_matches(name, list(SHAPES), n=1, cutoff=0.0)[0]
        raise InputError(
            f"no built-in shape is called {name!r}; the nearest is {nearest}, "
            f"and there are {', '.join(SHAPES)}"
        )
    return as_object(name, SHAPES[name](), material=material)
