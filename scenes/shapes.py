"""Built-in shapes of size one about the origin; placing, refining, smoothing meshes."""

import difflib
import math
from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes import InputError, Scene, SceneObject
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.scene import NormalsMade

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
    """Return the surface of revolution of a profile (N,), listed upward, about the y axis."""
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
    """Join rings of points (N, M, 3) into a tube, closed at rings that are a single point.

    Coordinates are rounded to 1e-6, so that the content hash is the same on machines whose sines
    differ in the last bit.
    """
    count, around = rings.shape[:2]
    vertices = np.round(rings.reshape(-1, 3), 6) + 0.0
    index = np.arange(count * around).reshape(count, around)
    following = np.roll(index, -1, axis=1)
    quads = np.stack([index[:-1], following[:-1], following[1:], index[1:]], axis=-1).reshape(-1, 4)
    return drop_flat(vertices, triangulate(quads))


def open_grid(points: Floats) -> Mesh:
    """Join a grid of points (N, M, 3) into a sheet with normals along axis 0 x axis 1."""
    return np.round(points.reshape(-1, 3), 6) + 0.0, grid_faces(*points.shape[:2])


def grid_faces(rows: int, columns: int) -> Indices:
    """Return the faces of a sheet of vertices (rows, columns), normals along axis 0 x axis 1."""
    index = np.arange(rows * columns).reshape(rows, columns)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)
    return triangulate(quads.reshape(-1, 4))


def triangulate(quads: NDArray[np.integer]) -> Indices:
    """Split quads (N, 4) into triangles (2 N, 3) along the first diagonal."""
    return np.asarray(quads, dtype=np.int64)[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def drop_flat(vertices: Floats, faces: Indices) -> Mesh:
    """Return the mesh without triangles that have two corners at the same point."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    flat = (a == b).all(axis=1) | (b == c).all(axis=1) | (c == a).all(axis=1)
    return vertices, faces[~flat]


def has_area(triangles: Floats) -> Mask:
    """Return the mask (F,) of triangles (F, 3, 3) with an area beyond the rounding of doubles."""
    edges = np.ascontiguousarray((triangles[:, 1:] - triangles[:, :1]).transpose(1, 2, 0))
    # Edges are scaled to at most one, so that areas neither underflow nor overflow.
    size = np.abs(edges).max(axis=(0, 1))
    edges /= np.where(size > 0, size, 1.0)
    doubled = np.linalg.norm(np.cross(edges[0], edges[1], axis=0), axis=0)
    return np.asarray(
        doubled > 4 * np.finfo(np.float64).eps
    )  # bound of three roundings of products that are at most one


def join(*meshes: Mesh) -> Mesh:
    """Join meshes into one mesh, in order."""
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [faces + offset for (_, faces), offset in zip(meshes, offsets, strict=False)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


_TURN = np.linspace(0, 2 * np.pi, 25)

#: Meshes by name. Sphere, cylinder and cone are closed bodies about the y axis, with diameter and
#: height 1; the cone's tip is on top. The torus has diameter 1, and its tube has diameter 0.3.
SHAPES: MappingProxyType[str, Callable[[], Mesh]] = MappingProxyType({
    "box": box,
    "square": square,
    "sphere": lambda: ball(0.5, 24, 48),
    "cylinder": lambda: lathe(np.array([0, 0.5, 0.5, 0]), np.array([-0.5, -0.5, 0.5, 0.5])),
    "cone": lambda: lathe(np.array([0, 0.5, 0]), np.array([-0.5, -0.5, 0.5])),
    "torus": lambda: lathe(0.35 + 0.15 * np.cos(_TURN), 0.15 * np.sin(_TURN)),
})  # fmt: skip


def as_object(name: str, mesh: Mesh, **attributes: Any) -> SceneObject:
    """Return a mesh as an object of a scene."""
    return SceneObject(name=name, vertices=mesh[0], faces=mesh[1], **attributes)


def build_shape(name: str, *, material: str | None = None) -> SceneObject:
    """Return a built-in shape in its own coordinates; InputError for unknown names."""
    if name not in SHAPES:
        nearest = difflib.get_close_matches(name, list(SHAPES), n=1, cutoff=0.0)[0]
        raise InputError(
            f"no built-in shape is called {name!r}; the nearest is {nearest}, "
            f"and there are {', '.join(SHAPES)}"
        )
    return as_object(name, SHAPES[name](), material=material)


Vector = tuple[float, float, float]


def placement(
    scale: float = 1.0, rotate_deg: Vector = (0.0, 0.0, 0.0), translate: Vector = (0.0, 0.0, 0.0)
) -> Floats:
    """Return the (4, 4) scene-from-mesh matrix: scale, then rotate, then translate.

    Angles turn about the fixed x, then y, then z axis, counterclockwise when looking against the
    axis.
    """
    # Compute row by row and not as matrix products, for the reason given in `place`.
    matrix = np.diag([scale, scale, scale, 1.0])
    for axis, angle in enumerate(rotate_deg):
        cosine, sine = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        first, second = (axis + 1) % 3, (axis + 2) % 3
        old_first, old_second = matrix[first].copy(), matrix[second].copy()
        matrix[first] = cosine * old_first - sine * old_second
        matrix[second] = sine * old_first + cosine * old_second
    matrix[:3, 3] = translate
    return matrix


def magnification(scene_from_mesh: Floats) -> float:
    """Return the largest factor by which a (4, 4) affine matrix stretches any length."""
    return float(np.linalg.norm(scene_from_mesh[:3, :3], ord=2))


def cofactors(matrices: Floats) -> Floats:
    """Return (N, 3, 3) matrices that transform normals (as rows) of surfaces placed by matrices.

    They are the inverse transposes times the determinants, and exist for singular matrices too.
    """
    x, y, z = np.moveaxis(matrices, 2, 0)
    return np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)


def place(part: SceneObject, scene_from_mesh: Floats) -> SceneObject:
    """Return the object with its vertices and their normals moved by a (4, 4) affine matrix.

    If the matrix mirrors, the order of corners is unchanged. The winding then faces the other side,
    and normals are turned to this side.
    """
    x, y, z = part.vertices.T
    # Do not use a matrix product: the order of BLAS sums depends on the machine, and the scene's
    # content hash must not.
    with np.errstate(over="ignore", invalid="ignore"):
        moved = [row[0] * x + row[1] * y + row[2] * z + row[3] for row in scene_from_mesh[:3]]
    normals = part.vertex_normals
    if normals is not None:
        # Cofactors map the cross product of two edges to the cross product of the moved edges. They
        # are the inverse transpose times the determinant. Its sign reverses normals if the matrix
        # mirrors. Normals are not normalized, so that interpolation remains linear in the original
        # normals.
        linear = scene_from_mesh[:3, :3]
        (turned,) = cofactors((linear / np.abs(linear).max())[None])
        normals = normals @ (turned / np.abs(turned).max())
    return replace(part, vertices=np.stack(moved, axis=1), vertex_normals=normals)


def refine(scene: Scene, levels: int) -> Scene:
    """Return the scene with each triangle split in four at the midpoints of edges, `levels` times.

    Triangle t becomes 4 t to 4 t + 3. A midpoint gets the mean normals, colors and texture
    coordinates of the edge's ends. Normals are not normalized, so that interpolation over the parts
    equals interpolation over the whole triangle.
    """
    for _ in range(levels):
        scene = replace(scene, objects=tuple(map(_in_four, scene.objects)))
    return scene


def _in_four(part: SceneObject) -> SceneObject:
    def with_middles(values: Floats | None) -> Floats | None:
        """Append the means over edges to values at vertices (V, N); the mean with a NaN is NaN."""
        return None if values is None else np.concatenate([values, values[edges].mean(axis=1)])

    sides = np.stack([part.faces, np.roll(part.faces, -1, axis=1)], axis=-1)
    edges, edge_of_side = np.unique(
        np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_inverse=True
    )
    middle = edge_of_side.reshape(-1, 3) + len(part.vertices)
    (a, b, c), (ab, bc, ca) = part.faces.T, middle.T
    textured = part.texture_of_triangle
    return replace(
        part,
        # Halve first: the sum of two huge coordinates may overflow.
        vertices=np.concatenate([part.vertices, (part.vertices[edges] / 2).sum(axis=1)]),
        faces=np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=-1).reshape(-1, 3),
        uv=with_middles(part.uv),
        vertex_normals=with_middles(part.vertex_normals),
        vertex_colors=with_middles(part.vertex_colors),
        texture_of_triangle=None if textured is None else np.repeat(textured, 4),
    )


def smoothed(part: SceneObject) -> SceneObject:
    """Return the object with normals added at vertices that have none.

    Faces are weighted by their angles at the vertex, so that the result does not depend on the
    triangulation of a flat surface (Thürmer and Wüthrich, "Computing vertex normals from polygonal
    facets", 1998). Vertices with equal coordinates count as one. A vertex gets no normal if the
    mean is zero.
    """
    mean, own = _mean_normals(part.vertices, part.faces), part.vertex_normals
    if own is None or not np.isfinite(own).any():
        return replace(part, vertex_normals=mean, normals_made=NormalsMade.ALL)
    normals = np.where(np.isfinite(own), own, mean)
    added = bool((np.isfinite(normals) & ~np.isfinite(own)).any())
    made = NormalsMade.SOME if added else part.normals_made
    return replace(part, vertex_normals=normals, normals_made=made)


def flipped(part: SceneObject) -> SceneObject:
    """Reverse an object's winding, and its normals if most of them oppose the new winding."""
    normals, faces = part.vertex_normals, part.faces[:, ::-1]
    if normals is not None:
        a, b, c = part.vertices[faces].transpose(1, 0, 2)
        along = np.einsum("fi,fci->fc", np.cross(b - a, c - a), normals[faces])
        normals = -normals if np.nansum(np.sign(along)) < 0 else normals
    return replace(part, faces=faces, vertex_normals=normals)


def _mean_normals(vertices: Floats, faces: Indices) -> Floats:
    """Return (V, 3) unit normals, weighted by angles; NaN where there are none."""
    # Scale sides to size one: products of the sides of tiny or huge triangles would under- or
    # overflow.
    triangles = vertices[faces]
    sides = np.roll(triangles, -1, axis=1) - triangles
    scale = np.abs(sides).max(axis=(1, 2), keepdims=True)
    after = sides / np.where(scale > 0, scale, 1.0)
    before = -np.roll(after, 1, axis=1)
    # Normals of the triangles (F, 3, 3), one for each corner, with the angle at the corner as
    # length.
    cross = np.cross(after, before)
    twice_area = np.linalg.norm(cross, axis=2, keepdims=True)
    angle = np.arctan2(twice_area, (after * before).sum(axis=2, keepdims=True))
    weighted = np.divide(cross, twice_area, out=np.zeros(cross.shape), where=twice_area > 0) * angle
    points, point_of_vertex = np.unique(vertices, axis=0, return_inverse=True)
    corners = point_of_vertex.reshape(-1)[faces].reshape(-1)
    total = np.stack(
        [np.bincount(corners, axis, len(points)) for axis in weighted.reshape(-1, 3).T], axis=1
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    unit = np.divide(total, length, out=np.full(total.shape, np.nan), where=length > 0)
    return np.asarray(unit[point_of_vertex.reshape(-1)])
