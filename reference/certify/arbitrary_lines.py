"""First surfaces along arbitrary lines through one point, each decided exactly.

The search misses no triangle. Seen from the center, a triangle lies in the cap about its middle
that reaches to the farthest of its three corners, because a cap smaller than a half sphere is
convex. Only lines in that cap, or in the opposite one, can meet the triangle. They are decided in
integers.
"""

from collections import defaultdict
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy.spatial import KDTree

from xfrustum.reference.certify.exact import ExactPencil, Integers
from xfrustum.reference.lines.lines import RayBundle, Vector
from xfrustum.scenes.arrays import Floats, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING

#: Margin of every chord: a million times the rounding of unit vectors and distances, 1e-15
CHORD_MARGIN = 1e-9

#: Largest chord of a cap that is surely smaller than a half sphere, whose chord is sqrt(2)
MAX_CHORD = 1.4


@dataclass(frozen=True, kw_only=True, eq=False)
class FirstAlong:
    """The first surfaces along N lines.

    `triangle` is the number of the first triangle, the smallest of a tie, `NOTHING` for none; s is
    the place on the line, to the nearest double, NaN for none. `ties` maps the number of a line to
    the numbers of the triangles that tie there, in ascending order.
    """

    triangle: Numbers
    s: Floats
    ties: dict[int, tuple[int, ...]]


def first_surfaces_along(
    triangles: Floats, center: Vector, directions: Floats, s_range: tuple[float, float]
) -> FirstAlong:
    """Decide the first surface along lines center + s d; meant for up to some 1e6 lines.

    Triangles (F, 3, 3) have their corners in scene units, directions d (N, 3) any length but zero.
    Surfaces count with s in the closed range, and the smallest s comes first.
    """
    exact = ExactLines(triangles, center, directions, s_range)
    met: dict[int, list[tuple[Fraction, int]]] = defaultdict(list)
    for number, lines in enumerate(_candidates(triangles - np.asarray(center), directions)):
        for line in lines:
            s = exact.meets(line, number)
            if s is not None:
                met[line].append((s, number))
    triangle = np.full(len(directions), NOTHING, dtype=np.int32)
    s_first = np.full(len(directions), np.nan)
    ties = {}
    for line, hits in met.items():
        first, triangle[line] = min(hits)
        s_first[line] = float(first)
        together = tuple(number for s, number in hits if s == first)
        if len(together) > 1:
            ties[line] = together
    return FirstAlong(triangle=triangle, s=s_first, ties=ties)


class ExactLines(ExactPencil):
    """Integer tests of triangles against arbitrary lines through a point, by line number."""

    def __init__(
        self, triangles: Floats, center: Vector, directions: Floats, s_range: tuple[float, float]
    ) -> None:
        no_film = RayBundle(
            center=center,
            shear=(0.0, 0.0),
            half_extent=(1.0, 1.0),
            resolution=(1, 1),
            s_range=s_range,
        )
        super().__init__(triangles, no_film)
        ratios = [[x.as_integer_ratio() for x in d] for d in directions.tolist()]
        # Denominators of doubles are powers of two: the largest is a multiple of all others.
        common = max((denominator for d in ratios for _, denominator in d), default=1)
        self._slope_bits = common.bit_length() - 1
        self._lines = [tuple(n * (common // denominator) for n, denominator in d) for d in ratios]

    def direction(self, pixel: int) -> Integers:
        """Return d of a line times 2**slope_bits."""
        x, y, z = self._lines[pixel]
        return x, y, z


def _candidates(corners: Floats, directions: Floats) -> list[list[int]]:
    """Return the lines that may meet each triangle (F, 3, 3), relative to the center."""
    # Directions of the corners from the center. A corner in the center has no direction.
    distance = np.linalg.norm(corners, axis=2, keepdims=True)
    near = (distance == 0).any(axis=(1, 2))
    seen = corners / np.where(distance > 0, distance, 1.0)
    # The middle of the cap, and the chord from there to the farthest corner.
    middle = seen.sum(axis=1)
    length = np.linalg.norm(middle, axis=1, keepdims=True)
    middle /= np.where(length > 0, length, 1.0)
    chord = np.linalg.norm(seen - middle[:, None], axis=2).max(axis=1) + CHORD_MARGIN
    # The argument needs a cap smaller than a half sphere. If the corners' directions cancel, the
    # middle is not a unit vector, and the chord is too long as well.
    everywhere = near | (chord > MAX_CHORD)

    # Lines run both ways from the center: search each line by its two directions.
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    tree = KDTree(np.concatenate((unit, -unit)))
    near_middle = tree.query_ball_point(middle, np.where(everywhere, 0.0, chord))
    all_lines = list(range(len(directions)))
    return [
        all_lines if anywhere else sorted({line % len(directions) for line in lines})
        for lines, anywhere in zip(near_middle, everywhere.tolist(), strict=True)
    ]
