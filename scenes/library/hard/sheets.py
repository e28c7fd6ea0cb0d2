"""Hard cases of depth order: coincident and nearly coincident sheets, and the ends of the reach."""

from __future__ import annotations

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.geometry.placement import place, placement
from xfrustum.scenes.geometry.shapes import build_shape, triangulate
from xfrustum.scenes.library.hard.case import REACH, HardCase, film_rectangle, loose
from xfrustum.scenes.model.scene import SceneObject

SEPARATIONS = (1e-3, 1e-6, 1e-9, 1e-12)
"""Separations of the nearly coincident sheets, column by column, as fractions of `SHEET_DISTANCE`.

In one more column each corner is a single step of a double apart.
"""
SHEET_DISTANCE = 64.0
"""Distance of the sheets from the plate, at their top left corners."""
SHEET_ROWS = ((3.5, 29.5), (33.5, 59.5))
"""Edges of the sheets behind and before the plate, between pixels."""


def sheet_columns(index: int) -> tuple[float, float]:
    """Return the left and right edge of a column of sheets, between pixels."""
    return 12 * index + 1.5, 12 * index + 13.5


def ball(z: float) -> SceneObject:
    """Return a ball of diameter 24 at a height above the plate, in one half of the film for each side."""
    return place(build_shape("sphere"), placement(24.0, (10.0, 20.0, 0.0), (0.25 * abs(z), -0.0625 * z, z)))


def _coincident_copies() -> tuple[SceneObject, ...]:
    return ball(-50.0), ball(50.0), ball(-50.0), ball(50.0)


def _coincident_other_triangles() -> tuple[SceneObject, ...]:
    def in_plane(*points: tuple[float, float]) -> Floats:
        x, y = np.array(points).T
        return np.stack((x, y, -64 + x / 4 + y / 8), axis=-1)

    corners = ((-24.0, -24.0), (24.0, -24.0), (24.0, 24.0), (-24.0, 24.0))
    two = SceneObject(
        name="two triangles", vertices=in_plane(*corners), faces=triangulate(np.array([(0, 1, 2, 3)]))
    )
    fan = np.array([(4, 0, 1), (4, 1, 2), (4, 2, 3), (4, 3, 0)])
    four = SceneObject(name="four triangles", vertices=in_plane(*corners, (4.0, -8.0)), faces=fan)
    return two, four


def _nearly_coincident() -> tuple[SceneObject, ...]:
    lower, upper = [], []
    for side, rows in zip((1, -1), SHEET_ROWS, strict=True):
        for index in range(len(SEPARATIONS) + 1):
            # The sheets lean and are bent: all pixels of a flat one would be right, or all wrong.
            depth = side * SHEET_DISTANCE * np.array([1.0, 1.125, 1.25, 1.0625])
            sheet = film_rectangle(sheet_columns(index), rows, depth)
            raised = sheet.copy()
            if index < len(SEPARATIONS):
                raised[..., 2] += SEPARATIONS[index] * SHEET_DISTANCE
            else:
                raised[..., 2] = np.nextafter(sheet[..., 2], np.inf)
            lower.append(sheet)
            upper.append(raised)
    # The hidden sheets come first, so that a renderer that breaks ties by the smaller number is wrong.
    return loose("lower sheets", np.concatenate(lower)), loose("upper sheets", np.concatenate(upper))


AT_REACH = ((2.5, 30.5), (34.5, 62.5))
"""First and last column of the sheets exactly at the reach, and of those one step of a double beyond it. The
rows of the sheets behind and before the plate are the same numbers."""


def _at_the_reach() -> tuple[SceneObject, ...]:
    at, beyond = REACH, float(np.nextafter(REACH, np.inf))
    return tuple(
        loose(name, np.concatenate([film_rectangle(columns, AT_REACH[k], (s, -s)[k]) for k in (0, 1)]))
        for name, columns, s in (("at the reach", AT_REACH[0], at), ("beyond", AT_REACH[1], beyond))
    )


CASES = (
    HardCase(
        name="hard/coincident-copies",
        why="the same triangles twice: nothing decides which is first",
        expected="every covered pixel is a tie of both copies and shows the first",
        triangles=8_832,
        objects=_coincident_copies,
    ),
    HardCase(
        name="hard/coincident-other-triangles",
        why="the same plane in other triangles: equal depth from unequal numbers",
        expected="every covered pixel is a tie between both sheets and shows the first",
        triangles=6,
        objects=_coincident_other_triangles,
    ),
    HardCase(
        name="hard/nearly-coincident",
        why="sheets 1e-3 to 1e-12 of their distance apart, and one step of a double; the hidden one first",
        expected="the upper sheet everywhere, no tie; one step of a double is decided exactly",
        triangles=40,
        objects=_nearly_coincident,
    ),
    HardCase(
        name="hard/at-the-reach",
        why="sheets exactly at the ends of the reach, and one step of a double beyond",
        expected="those at the reach are imaged, those beyond are not",
        triangles=8,
        objects=_at_the_reach,
    ),
    HardCase(
        name="hard/nothing",
        why="no objects: nothing to build, nothing to hit",
        expected="no surface in any pixel, proven",
        triangles=0,
        objects=lambda: (),
    ),
    HardCase(
        name="hard/only-in-front",
        why="nothing behind the plate: one of the two cameras sees nothing",
        expected="surfaces at positive heights only",
        triangles=2_208,
        objects=lambda: (ball(50.0),),
    ),
    HardCase(
        name="hard/only-behind",
        why="nothing in front of the plate: the other camera sees nothing",
        expected="surfaces at negative heights only",
        triangles=2_208,
        objects=lambda: (ball(-50.0),),
    ),
    HardCase(
        name="hard/only-out-of-reach",
        why="objects on the lines, but beyond the reach on both sides",
        expected="no surface in any pixel, proven",
        triangles=4_416,
        objects=lambda: (ball(REACH + 30.0), ball(-REACH - 30.0)),
    ),
)
