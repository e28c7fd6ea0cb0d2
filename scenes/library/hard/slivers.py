"""Hard cases of triangles that are hardly there: edge-on, needles, without area, twice, tiny."""

from __future__ import annotations

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.geometry.placement import place, placement
from xfrustum.scenes.geometry.shapes import build_shape
from xfrustum.scenes.library.hard.case import HardCase, film_rectangle, loose, on_line, wall
from xfrustum.scenes.model.scene import SceneObject

EDGE_ON_COLUMN, TURNED_COLUMN = 20, 44
"""Column whose lines lie in a triangle, and column of a triangle that is turned by `TURN` at either end."""
TURN = 2.0**-49
"""Distance in x by which the ends are moved: the step of doubles from 8 to 16, where the far end lies."""
TURNED_HALF_HEIGHT, TURNED_MIDDLE = 10.0, 48.0
"""Half the turned triangle's height where it crosses its column's lines, and the depth there."""


def _edge_on() -> tuple[SceneObject, ...]:
    def upright(column: int, turn: float) -> Floats:
        """Return a triangle along a column's lines, its ends moved in x."""
        corners = on_line(column, 0, [32.0, 32.0, 64.0])
        corners[:, 0] += (-turn, -turn, turn)
        corners[:, 1] = (-2 * TURNED_HALF_HEIGHT, 2 * TURNED_HALF_HEIGHT, 0.0)
        return corners

    return (
        loose("edge-on", [upright(EDGE_ON_COLUMN, 0.0)]),
        loose("turned", [upright(TURNED_COLUMN, TURN)]),
        wall(),
    )


NEEDLE = 28e-6
"""Half the width of a needle, in pixels; the longest are 56 pixels long, a million times their width."""


def _needles() -> tuple[SceneObject, ...]:
    down = on_line([20 - NEEDLE, 20 + NEEDLE, 20], [4, 4, 60], [64.0, 64.0, 48.0])
    between = on_line([24.5 - NEEDLE, 24.5 + NEEDLE, 24.5], [4, 4, 60], [64.0, 64.0, 48.0])
    diagonal = on_line([30 + NEEDLE / 2, 30 - NEEDLE / 2, 58], [4 - NEEDLE / 2, 4 + NEEDLE / 2, 32], 64.0)
    across = on_line([4, 4, 60], [44 - NEEDLE, 44 + NEEDLE, 44], [-64.0, -64.0, -48.0])
    return (loose("needles", [down, between, diagonal, across]),)


def _zero_area() -> tuple[SceneObject, ...]:
    point = on_line([10, 10, 10], 10, 32.0)
    two_equal = on_line([14, 30, 14], [12, 12, 12], [32.0, 48.0, 32.0])
    along_row = on_line([14, 22, 30], 20, 32.0)
    along_a_line = on_line(40, 40, [16.0, 32.0, 64.0])
    through_aperture = on_line(50, 50, [-32.0, 16.0, 64.0])
    in_aperture = np.zeros((3, 3))
    flat = [point, two_equal, along_row, along_a_line, through_aperture, in_aperture]
    return loose("flat", flat), wall()


def _duplicates() -> tuple[SceneObject, ...]:
    box = place(build_shape("box"), placement(24.0, (20.0, 35.0, 10.0), (3.0, -2.0, -56.0)))
    # All faces come twice on shared vertices, the second time wound the other way, and once more loose.
    faces = np.concatenate([box.faces, box.faces[:, ::-1]])
    return (
        SceneObject(name="faces twice", vertices=box.vertices, faces=faces),
        loose("vertices twice", box.vertices[box.faces]),
    )


SMALLEST = 2.0**-240
"""Depth of the nearer of two sheets, whose smallest coordinates, 1/128 of it, are about 4e-75."""


def _smallest() -> tuple[SceneObject, ...]:
    hidden = film_rectangle((4.0, 40.0), (4.0, 60.0), 2 * SMALLEST)
    nearer = film_rectangle((20.0, 56.0), (12.0, 52.0), SMALLEST)
    return loose("hidden", hidden), loose("nearer", nearer), wall()


CASES = (
    HardCase(
        name="hard/edge-on",
        why="a triangle in the plane of a column's lines, and one turned by a single step of a double",
        expected="the first covers nothing; the other covers 26 pixels of its column, at depth 48",
        triangles=3,
        objects=_edge_on,
    ),
    HardCase(
        name="hard/needles",
        why="triangles a million times longer than wide, along rows of pixel centers",
        expected="exactly the pixels whose centers they cover: 57, 29 and 57; between pixels none",
        triangles=4,
        objects=_needles,
    ),
    HardCase(
        name="hard/zero-area",
        why="triangles without area exactly on lines: points, collinear corners, in the aperture",
        expected="they cover nothing: the wall behind in every pixel, no tie",
        triangles=7,
        objects=_zero_area,
    ),
    HardCase(
        name="hard/duplicates",
        why="the same faces twice, wound either way, and again with vertices of their own",
        expected="every covered pixel is a tie of all three and shows the first",
        triangles=36,
        objects=_duplicates,
    ),
    HardCase(
        name="hard/smallest",
        why="two sheets 1e-72 behind the aperture, near the smallest coordinates that may be, and a wall",
        expected="the nearer sheet before the other, and the wall around them: 1517, 1248, 1331 pixels",
        triangles=5,
        objects=_smallest,
    ),
)
