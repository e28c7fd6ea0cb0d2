"""Hard cases in which lines meet vertices and edges exactly, or surfaces the aperture itself."""

from __future__ import annotations

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.geometry.shapes import triangulate
from xfrustum.scenes.library.hard.case import HardCase, loose, on_line, wall
from xfrustum.scenes.model.scene import SceneObject

GRID_STEP = 4
"""Pixels between neighboring vertices of the bumpy sheets."""


def bumpy_sheet(name: str, columns: tuple[int, int], rows: tuple[int, int], side: int) -> SceneObject:
    """Return a sheet whose every vertex lies exactly on a pixel's line, at depths of 32 to 60.

    The image of the sheet is a plain grid: about every second pixel lies on an edge or a vertex.
    """
    column, row = np.meshgrid(
        np.arange(columns[0], columns[1] + 1, GRID_STEP), np.arange(rows[0], rows[1] + 1, GRID_STEP)
    )
    s = side * (32.0 + 4.0 * ((7 * column + 3 * row) // GRID_STEP % 8))
    index = np.arange(column.size).reshape(column.shape)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)
    return SceneObject(
        name=name,
        vertices=on_line(column, row, s).reshape(-1, 3),
        faces=triangulate(quads.reshape(-1, 4)),
    )


def _vertices_and_edges() -> tuple[SceneObject, ...]:
    return bumpy_sheet("behind", (2, 30), (2, 58), 1), bumpy_sheet("in front", (34, 62), (2, 58), -1)


def _closed_edges() -> tuple[SceneObject, ...]:
    behind = on_line([8, 40, 8], [8, 8, 40], [32.0, 64.0, 48.0])
    in_front = on_line([60, 60, 36], [60, 36, 60], [-32.0, -64.0, -48.0])
    return loose("behind", [behind]), loose("in front", [in_front])


EDGE_ON_COLUMN, EDGE_ON_ROW = 40, 20
"""Column and row of the pixels whose lines lie in a surface through the aperture."""


def _surface_through_aperture() -> tuple[SceneObject, ...]:
    # The triangle lies in the plane of all lines of one column, hence exactly through the aperture.
    column = EDGE_ON_COLUMN
    corners = on_line(column, 0, [-64.0, -64.0, 96.0])
    corners[:, 1] = (-48.0, 48.0, 0.0)
    return loose("surface", [corners]), wall()


def _vertex_on_aperture() -> tuple[SceneObject, ...]:
    # The sides have slopes of 1/4 = 32/128, between two columns: no pixel's line lies in a side.
    base = [(16.0, 16.0, -64.0), (-16.0, 16.0, -64.0), (-16.0, -16.0, -64.0), (16.0, -16.0, -64.0)]
    vertices: Floats = np.array([(0.0, 0.0, 0.0), *base])
    faces = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1), (1, 4, 3), (1, 3, 2)])
    return (SceneObject(name="pyramid", vertices=vertices, faces=faces),)


def _edge_through_aperture() -> tuple[SceneObject, ...]:
    column, row = EDGE_ON_COLUMN, EDGE_ON_ROW
    ends = on_line(column, row, [-32.0, 64.0])
    # One triangle lies in the plane of the row's lines, the other in that of the column's.
    aside = on_line(column, row, 16.0) + np.array([(20.0, 0.0, 0.0), (0.0, 20.0, 0.0)])
    return loose("tent", [[*ends, corner] for corner in aside]), wall()


def _triangle_in_plate() -> tuple[SceneObject, ...]:
    return loose("in plate", [[(-16, -16, 0), (16, -16, 0), (-16, 16, 0)]]), wall()


CASES = (
    HardCase(
        name="hard/vertices-and-edges",
        why="lines run exactly through vertices and edges of a mesh: cracks or double hits",
        expected="no crack; ties between all triangles around the vertex or beside the edge",
        triangles=392,
        objects=_vertices_and_edges,
    ),
    HardCase(
        name="hard/closed-edges",
        why="lines run exactly through the outline of single triangles: rounding decides",
        expected="triangles are closed: their outline belongs to them, decided exactly, no tie",
        triangles=2,
        objects=_closed_edges,
    ),
    HardCase(
        name="hard/surface-through-aperture",
        why="all lines meet at one point of the surface, and one column of lines lies in it",
        expected="the surface at height 0 in every pixel but that column, which shows the wall behind",
        triangles=2,
        objects=_surface_through_aperture,
    ),
    HardCase(
        name="hard/vertex-on-aperture",
        why="every line runs through the tip of a pyramid: all its sides are met at once",
        expected="a tie of the four sides at height 0 in every pixel; an ordinary pyramid from elsewhere",
        triangles=6,
        objects=_vertex_on_aperture,
        apertures=((2, 2), (3, 2)),
    ),
    HardCase(
        name="hard/edge-through-aperture",
        why="an edge runs through the aperture, along the line of one pixel",
        expected="a tie at height 0; one of both sides along a row and a column, the wall where they cross",
        triangles=3,
        objects=_edge_through_aperture,
    ),
    HardCase(
        name="hard/triangle-in-plate",
        why="a triangle lies in the plate: with the aperture inside, on its edge, on its corner, beside",
        expected="the triangle at height 0 in every pixel; from beside it only the wall behind",
        triangles=2,
        objects=_triangle_in_plate,
        apertures=((1, 3), (2, 2), (0, 4), (3, 1)),
    ),
)
