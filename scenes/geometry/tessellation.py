"""Sets of Bezier patches as triangles: within a chord tolerance of the surface, and without cracks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.geometry.bezier import casteljau, evenly, normals, steps_for, surface
from xfrustum.scenes.geometry.shapes import drop_flat, triangulate
from xfrustum.scenes.model.scene import SceneObject

Steps = Sequence[tuple[int, int]]
"""Numbers of steps along u and v into which each patch is cut."""

MAX_TRIANGLES = 20_000_000
"""Largest number of triangles: a tolerance that asks for more is a mistake in its unit."""


def tessellate(
    nets: Sequence[Floats], chord_tolerance: float, *, name: str, material: str | None = None
) -> SceneObject:
    """Return patches as triangles that lie within a tolerance of the surface.

    No point of the triangles is farther from the surface than the tolerance, and no point of the surface
    farther from the triangles. Where patches share an edge, by the same control points, both cut it in the
    same points, to the last bit.

    Parameters
    ----------
    nets
        Control nets (n + 1, m + 1, 3).
    chord_tolerance
        Largest distance, in the unit of the control points.
    name, material
        Name of the object and of its material.

    Raises
    ------
    InputError
        The tolerance asks for more than `MAX_TRIANGLES`, or all patches are without area.
    """
    least = [steps_for(net, chord_tolerance) for net in nets]
    triangles = _triangles(least)
    # Matching only adds steps. It counts them in 64 bits, which a senseless tolerance would overflow.
    if triangles <= MAX_TRIANGLES:
        least = matched_steps(nets, least)
        triangles = _triangles(least)
    if triangles > MAX_TRIANGLES:
        raise InputError(
            f"a chord tolerance of {chord_tolerance:.3g} takes {_count(triangles)} triangles, more than "
            f"{MAX_TRIANGLES:,}; choose a larger chord_tolerance"
        )
    return cut(nets, least, name=name, material=material)


def _count(number: int) -> str:
    return f"{number:,}" if number < 10**15 else f"{float(number):.0e}"


def _triangles(steps: Steps) -> int:
    return sum(2 * along_u * along_v for along_u, along_v in steps)


def cut(nets: Sequence[Floats], steps: Steps, *, name: str, material: str | None = None) -> SceneObject:
    """Return patches cut into given steps, with the exact normals of the surface at the vertices.

    The winding faces where f_u x f_v points. Triangles without area, at edges that are collapsed to a
    point, are left out.
    """
    vertices, directions, faces = [], [], []
    start = 0
    for net, (along_u, along_v) in zip(nets, steps, strict=True):
        points = _grid(net, along_u, along_v)
        index = start + np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
        quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)
        faces.append(triangulate(quads.reshape(-1, 4)))
        vertices.append(points.reshape(-1, 3))
        directions.append(normals(net, evenly(along_u), evenly(along_v)).reshape(-1, 3))
        start += index.size
    kept, with_area = drop_flat(np.concatenate(vertices), np.concatenate(faces))
    return SceneObject(
        name=name,
        vertices=kept,
        faces=with_area,
        material=material,
        vertex_normals=np.concatenate(directions),
    )


def matched_steps(nets: Sequence[Floats], least: Steps) -> list[tuple[int, int]]:
    """Return the least steps with which patches that share an edge agree on it.

    Opposite edges of a patch have the same steps, so agreement spreads over strips of patches.
    """
    # A graph links the directions of patches that share an edge: node 2 p is patch p along u, node 2 p + 1
    # along v. The first patch with an edge owns it.
    owners: dict[bytes, int] = {}
    links = []
    for patch, net in enumerate(nets):
        for side, axis in ((net[:, 0], 0), (net[:, -1], 0), (net[0], 1), (net[-1], 1)):
            if _is_point(side):
                continue
            node = 2 * patch + axis
            links.append((node, owners.setdefault(_oriented(side)[0].tobytes(), node)))
    # All directions of a strip, a connected part of the graph, take the largest number of steps among them.
    wanted = np.array(least, dtype=np.int64).reshape(-1)
    pairs = np.array(links, dtype=np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(wanted), len(wanted)))
    strips, strip = connected_components(graph, directed=False)
    of_strip = np.zeros(strips, dtype=np.int64)
    np.maximum.at(of_strip, strip, wanted)
    return [(int(u), int(v)) for u, v in of_strip[strip].reshape(-1, 2)]


def _grid(net: Floats, along_u: int, along_v: int) -> Floats:
    """Return a patch's points (along_u + 1, along_v + 1, 3), its borders as curves of their own."""
    points = surface(net, evenly(along_u), evenly(along_v))
    points[:, 0], points[:, -1] = _edge(net[:, 0], along_u), _edge(net[:, -1], along_u)
    points[0], points[-1] = _edge(net[0], along_v), _edge(net[-1], along_v)
    return points


def _edge(controls: Floats, steps: int) -> Floats:
    """Return the points of a border: the same bits for both patches that share it."""
    if _is_point(controls):
        return np.repeat(controls[:1], steps + 1, axis=0)
    oriented, turned = _oriented(controls)
    points = casteljau(oriented, evenly(steps))
    return points[::-1] if turned else points


def _oriented(controls: Floats) -> tuple[Floats, bool]:
    """Return control points in the lesser of their two orders, and whether that is the reverse of theirs."""
    controls = controls + 0.0  # turns negative zeros positive, so that equal points have equal bytes
    turned = controls[::-1].tolist() < controls.tolist()
    return np.ascontiguousarray(controls[::-1] if turned else controls), turned


def _is_point(controls: Floats) -> bool:
    return bool((controls == controls[0]).all())
