"""The first surface along each line of a grid: proven, or decided in integers.

The argument is that of `certify.certify`, for each pair of a line and a triangle by itself. It is the same
arithmetic on the same numbers: what is decided of a pixel is what its whole hogel says, bit for bit.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from xfrustum.reference.backend import constants, dr, on_device, recording
from xfrustum.reference.certify.certify import FirstSurfaces
from xfrustum.reference.certify.cone import Cones, Triangles, Viewpoint, in_range
from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.certify.pairs import NO_PAIRS, Pairs
from xfrustum.reference.eye.crossing import Axis, Crossings, crossings
from xfrustum.reference.lines.grid import LineGrid
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty


def first_along_grid(triangles: Triangles, grid: LineGrid, columns: Axis, rows: Axis) -> FirstSurfaces:
    """Decide what each line of a grid meets first.

    Parameters
    ----------
    triangles
        Triangles on the device.
    grid
        The lines.
    columns, rows
        The same lines beside the rays of the eye, which see the triangles that may matter.
    """
    width, height = grid.resolution
    limit = np.full(width * height, np.inf)
    kept = NO_PAIRS
    for part in crossings(triangles.corners, grid, columns, rows):
        found = _evaluated(triangles, grid, part)
        np.minimum.at(limit, found.pixel[found.sure], found.farthest[found.sure])
        kept = Pairs.joined([kept, found])
        kept = kept[kept.nearest <= limit[kept.pixel]]
    rivals = np.bincount(kept.pixel, minlength=len(limit))
    proven = (rivals[kept.pixel] == 1) & kept.sure
    triangle = np.full(len(limit), NOTHING, dtype=np.int32)
    s = np.full(len(limit), np.nan)
    certainty = np.full(len(limit), Certainty.PROVEN, dtype=np.uint8)
    triangle[kept.pixel[proven]], s[kept.pixel[proven]] = kept.triangle[proven], kept.s[proven]
    companions = _settle(triangles.corners, grid, kept[~proven], (triangle, s, certainty))
    shape = (height, width)
    return FirstSurfaces(
        triangle=triangle.reshape(shape),
        s=s.reshape(shape),
        certainty=certainty.reshape(shape),
        companions=companions,
    )


def _evaluated(triangles: Triangles, grid: LineGrid, part: Crossings) -> Pairs:
    """Return the pairs that meet or may meet, with bounds of their places."""
    if not len(part.triangle):
        return NO_PAIRS
    with recording():
        # Each line passes through a point of the plate of its own, from which s of a corner is exact.
        x, dx, y, dy = (
            on_device(one)
            for one in (
                grid.x[part.column],
                grid.dx[part.column],
                grid.y[part.row],
                grid.dy[part.row],
            )
        )
        zero, *ends = constants((0.0, *grid.s_range))
        seen_from = Viewpoint(center=[x, y, zero], ends=ends, slack=zero)
        # Whether a point of the plate lies in a triangle is left to the integers: no s near zero is sure.
        cones = Cones.of(triangles.points(on_device(part.triangle)), seen_from, False)
        s, error = cones.along_rows(dy).met(dx)
        possible, sure = in_range(s, error, cones.within, ends)
        may_cover, covers = cones.covering(dx, dy)
        possible, sure = possible & may_cover, sure & covers
        dr.eval(s, error, possible, sure)
        found = Pairs(
            pixel=part.row * grid.resolution[0] + part.column,
            triangle=part.triangle,
            s=s.numpy(),
            error=error.numpy(),
            sure=sure.numpy(),
        )
        return found[np.flatnonzero(possible.numpy())]


def _settle(triangles: Floats, grid: LineGrid, contested: Pairs, answer: tuple[Any, Any, Any]) -> Indices:
    """Decide lines for which several triangles may be first in integers; return the companions of ties.

    Parameters
    ----------
    triangles, grid
        The scene's triangles and the lines.
    contested
        All pairs of these lines.
    answer
        Triangle, s and certainty of all lines, which are filled in.
    """
    triangle, s, certainty = answer
    order = np.argsort(contested.pixel, kind="stable")
    lines, starts = np.unique(contested.pixel[order], return_index=True)
    rivals = np.split(contested.triangle[order], starts)[1:]
    companions = [np.zeros((0, 3), dtype=np.int64)]
    for line, some in zip(lines.tolist(), rivals, strict=True):
        row, column = divmod(line, grid.resolution[0])
        numbers = np.unique(some)
        exact = ExactPencil(triangles[numbers], _single(grid, row, column))
        hits = {
            number: place
            for index, number in enumerate(numbers.tolist())
            if (place := exact.meets(0, index)) is not None
        }
        certainty[line] = Certainty.EXACT
        if hits:
            first = min(hits.values())
            winners = [number for number, place in hits.items() if place == first]
            triangle[line], s[line] = winners[0], float(first)
            if len(winners) > 1:
                certainty[line] = Certainty.TIE
                companions.append(np.array([(row, column, winner) for winner in winners]))
    return np.concatenate(companions)


def _single(grid: LineGrid, row: int, column: int) -> Pencil:
    """Return one line of a grid as a film of one pixel, at whose center u and v are zero."""
    return Pencil(
        center=(float(grid.x[column]), float(grid.y[row]), 0.0),
        shear=(float(grid.dx[column]), float(grid.dy[row])),
        half_extent=(1.0, 1.0),
        resolution=(1, 1),
        s_range=grid.s_range,
    )
