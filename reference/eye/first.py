"""First surface along lines without a common point: proven, or decided in integers.

Each pixel of an eye sees a pixel of a hogel, and therefore the line of that pixel. The argument of
`certify` holds for each pair of a line and a triangle by itself, with the same arithmetic on the
same numbers: the decision of a pixel is that in the image of its whole hogel, bit for bit.

Projections of widened triangles onto the eye's film give the candidates of each line. The line
deviates from the ray of its pixel: at depth s below the plate they are at most D0 + |s| D1 apart,
where D0 is half a hogel and D1 half a pixel of its film. Each triangle is widened by this distance:
wherever the line meets the triangle, the pixel's ray meets the widened one. D0 + |s| D1 is convex
in s. The widened triangle therefore lies within the hull of its widened corners, and its image on
the film within the hull of their images.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.reference.backend import constants, dr, on_device, recording
from xfrustum.reference.certify.certify import FirstSurfaces
from xfrustum.reference.certify.cone import Cones, Triangles, Viewpoint, in_range
from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.certify.filter import NO_PAIRS, Pairs
from xfrustum.reference.lines.lines import LineGrid
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty

#: Pairs of a line and a triangle that are decided at once, about 1 kB each
PAIRS_AT_ONCE = 1 << 19

#: triangles whose columns and rows are searched at once
TRIANGLES_AT_ONCE = 1 << 13

#: Margin of every comparison, relative to the sum of its absolute values: more than ten thousand
#: roundings of 1e-16, for a few dozen operations
MARGIN = 1e-11

#: Smallest depth below the eye, relative to its height, at which corners are projected. Triangles
#: that reach the eye's height or beyond may cross any line.
BESIDE_THE_EYE = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """The lines of a grid along one axis, and the nearby rays of the eye.

    There are (N,) places where lines meet the plate, their slopes, and the slopes of the eye's rays
    (`seen`), ascending or descending; `eye` is the eye's coordinate on this axis, and `height` its
    distance from the plate.
    """

    place: Floats
    slope: Floats
    seen: Floats
    eye: float
    height: float

    def candidates(self, x: Floats, s: Floats) -> tuple[Indices, Indices]:
        """Return first and end (T,) of lines that may cross triangles with corners x, s (3, T)."""
        if not len(self.seen):
            none = np.zeros(x.shape[1], dtype=np.int64)
            return none, none
        # D0 and D1 of the module's argument: distance of lines and rays at the plate, per depth.
        apart = np.abs(self.place - self.eye - self.height * self.seen).max()
        spread = np.abs(self.slope - self.seen).max()
        size = np.abs(x) + abs(self.eye) + (self.height + np.abs(s)) * (1 + np.abs(self.seen).max())
        wider = apart + np.abs(s) * spread + MARGIN * size
        below = self.height + s
        near_eye = (below <= BESIDE_THE_EYE * self.height).any(axis=0)
        below = np.where(below > 0, below, 1.0)
        # Corners at the eye's height or beyond project anywhere: keep all lines.
        low = np.where(near_eye, -np.inf, ((x - wider - self.eye) / below).min(axis=0))
        high = np.where(near_eye, np.inf, ((x + wider - self.eye) / below).max(axis=0))
        if self.seen[0] <= self.seen[-1]:
            return np.searchsorted(self.seen, low, "left"), np.searchsorted(
                self.seen, high, "right"
            )
        # Slopes of rows descend: search negated slopes.
        down = -self.seen
        return np.searchsorted(down, -high, "left"), np.searchsorted(down, -low, "right")

    def crossed(self, x: Floats, s: Floats) -> tuple[Indices, Indices]:
        """Return triangle and line of all pairs that may cross on this axis, sorted by triangle."""
        first, end = self.candidates(x, s)
        counts = np.maximum(end - first, 0)
        triangle = np.repeat(np.arange(len(counts)), counts)
        line = np.arange(len(triangle)) - np.repeat(np.cumsum(counts) - counts - first, counts)
        aside = [
            x[k, triangle] - self.place[line] - s[k, triangle] * self.slope[line] for k in range(3)
        ]
        size = np.abs(self.place[line]) + sum(
            np.abs(x[k, triangle]) + np.abs(s[k, triangle] * self.slope[line]) for k in range(3)
        )
        doubt = MARGIN * size
        # A line misses a triangle whose corners all lie surely on one side of it.
        misses = np.logical_and.reduce([a > doubt for a in aside])
        misses |= np.logical_and.reduce([a < -doubt for a in aside])
        return triangle[~misses], line[~misses]


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossings:
    """Pairs of a line and a triangle that may cross: (N,) column, row, number of the triangle."""

    column: Indices
    row: Indices
    triangle: Indices


def crossings(triangles: Floats, grid: LineGrid, columns: Axis, rows: Axis) -> Iterator[Crossings]:
    """Yield all pairs of a line and a triangle (F, 3, 3) that may cross in the range, in parts."""
    z = triangles[..., 2]
    reached = (-z.min(axis=1) >= grid.s_range[0]) & (-z.max(axis=1) <= grid.s_range[1])
    numbers = np.flatnonzero(reached)
    for start in range(0, len(numbers), TRIANGLES_AT_ONCE):
        some = numbers[start : start + TRIANGLES_AT_ONCE]
        x, y, heights = np.ascontiguousarray(triangles[some].transpose(2, 1, 0))
        on_column, column = columns.crossed(x, -heights)
        on_row, row = rows.crossed(y, -heights)
        down = np.bincount(on_row, minlength=len(some))
        # Every column of a triangle with every row of it.
        repeats = down[on_column]
        first_row = np.cumsum(down) - down
        ends = np.cumsum(repeats)
        begin = 0
        while begin < len(on_column):
            before = ends[begin - 1] if begin else 0
            stop = max(begin + 1, int(np.searchsorted(ends, before + PAIRS_AT_ONCE)))
            part = np.repeat(np.arange(begin, stop), repeats[begin:stop])
            step = np.arange(len(part)) - np.repeat(
                ends[begin:stop] - repeats[begin:stop] - before, repeats[begin:stop]
            )
            own = on_column[part]
            yield Crossings(column=column[part], row=row[first_row[own] + step], triangle=some[own])
            begin = stop


def first_along_grid(
    triangles: Triangles, grid: LineGrid, columns: Axis, rows: Axis
) -> FirstSurfaces:
    """Decide the first surface of each line of a grid; `columns` and `rows` are its two axes."""
    width, height = grid.resolution
    limit = np.full(width * height, np.inf)
    kept = NO_PAIRS
    for part in crossings(triangles.corners, grid, columns, rows):
        pairs = _evaluated(triangles, grid, part)
        # A pair cannot be first if it lies behind the farthest bound of a sure pair of its line.
        np.minimum.at(limit, pairs.pixel[pairs.sure], pairs.farthest[pairs.sure])
        kept = Pairs.joined([kept, pairs])
        kept = kept[kept.nearest <= limit[kept.pixel]]
    # A sure pair without rivals is proven; integers decide the others.
    rivals = np.bincount(kept.pixel, minlength=len(limit))
    proven = (rivals[kept.pixel] == 1) & kept.sure
    shape = (height, width)
    decided = FirstSurfaces(
        triangle=np.full(shape, NOTHING, dtype=np.int32),
        s=np.full(shape, np.nan),
        certainty=np.full(shape, Certainty.PROVEN, dtype=np.uint8),
        tied_triangles=np.zeros((0, 3), dtype=np.int64),
    )
    decided.triangle.flat[kept.pixel[proven]] = kept.triangle[proven]
    decided.s.flat[kept.pixel[proven]] = kept.s[proven]
    return replace(decided, tied_triangles=_settle(triangles.corners, grid, kept[~proven], decided))


def _evaluated(triangles: Triangles, grid: LineGrid, part: Crossings) -> Pairs:
    """Return the pairs that meet or may meet, with bounds of their places."""
    if not len(part.triangle):
        return NO_PAIRS
    with recording():
        # Each line passes through its own point of the plate, from which s of a corner is exact.
        x, dx, y, dy = (
            on_device(values)
            for values in (
                grid.x[part.column],
                grid.dx[part.column],
                grid.y[part.row],
                grid.dy[part.row],
            )
        )
        zero, *ends = constants((0.0, *grid.s_range))
        seen_from = Viewpoint(center=[x, y, zero], ends=ends, slack=zero)
        # An s near zero is never sure: integers decide points of the plate that lie in a triangle.
        cones = Cones.from_points(triangles.points(on_device(part.triangle)), seen_from, False)
        s, error = cones.planes.along_rows(dy).met(dx)
        possible, sure = in_range(s, error, cones.within, ends)
        may_cover, covers = cones.covering(dx, dy)
        possible, sure = possible & may_cover, sure & covers
        dr.eval(s, error, possible, sure)
        pairs = Pairs(
            pixel=part.row * grid.resolution[0] + part.column,
            triangle=part.triangle,
            s=s.numpy(),
            error=error.numpy(),
            sure=sure.numpy(),
        )
        return pairs[np.flatnonzero(possible.numpy())]


def _settle(triangles: Floats, grid: LineGrid, ambiguous: Pairs, decided: FirstSurfaces) -> Indices:
    """Decide the lines of ambiguous pairs in integers, fill them in; return the tied triangles."""
    triangle, s, certainty = (
        values.reshape(-1) for values in (decided.triangle, decided.s, decided.certainty)
    )
    order = np.argsort(ambiguous.pixel, kind="stable")
    lines, starts = np.unique(ambiguous.pixel[order], return_index=True)
    rivals = np.split(ambiguous.triangle[order], starts)[1:]
    tied_triangles = [np.zeros((0, 3), dtype=np.int64)]
    for line, some in zip(lines.tolist(), rivals, strict=True):
        row, column = divmod(line, grid.resolution[0])
        numbers = np.unique(some)
        exact = ExactPencil(triangles[numbers], grid.line(column, row))
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
                tied_triangles.append(np.array([(row, column, winner) for winner in winners]))
    return np.concatenate(tied_triangles)
