"""4 x 4 matrices as lists, with the bound on the rounding of whatever was computed with them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tests.second_reader.model import UNIT

Matrix = list[list[float]]
Values = Sequence[float]

#: Roundings of an entry: of a matrix from a quaternion (10) times scale (1), of a product (4).
LOCAL, PRODUCT = 11, 4


def product(a: Matrix, b: Matrix) -> Matrix:
    """Multiply two matrices."""
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def identity() -> Matrix:
    """Return the unit matrix."""
    return [[float(i == j) for j in range(4)] for i in range(4)]


@dataclass(frozen=True)
class Placement:
    """Affine map, with the sizes of the terms that it adds up and their relative error."""

    matrix: Matrix
    sizes: Matrix  #: sums of the absolute values of the terms of each entry
    relative: float  #: error of each entry over its size; 0 where the entries are exact

    def __matmul__(self, inner: Placement) -> Placement:
        """Apply `inner` first."""
        if inner.matrix == identity():
            return self
        if self.matrix == identity():
            return inner
        return Placement(
            product(self.matrix, inner.matrix),
            product(self.sizes, inner.sizes),
            self.relative + inner.relative + PRODUCT * UNIT,
        )

    def of(self, point: Values, sizes: Values, relative: float) -> tuple[list[float], list[float]]:
        """Place a point whose terms have these sizes and this error; return it and its bounds."""
        if self.matrix == identity():
            return list(point), [relative * size for size in sizes]
        placed = [sum(row[k] * point[k] for k in range(3)) + row[3] for row in self.matrix[:3]]
        terms = [sum(row[k] * sizes[k] for k in range(3)) + row[3] for row in self.sizes[:3]]
        error = self.relative + relative + PRODUCT * UNIT
        return placed, [error * term for term in terms]

    def mirrors(self) -> bool:
        """Test whether the determinant is negative."""
        (a, b, c, _), (d, e, f, _), (g, h, i, _) = self.matrix[:3]
        return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0


def stated(matrix: Matrix) -> Placement:
    """Return the map of a matrix that a file states itself."""
    return Placement(matrix, [[abs(value) for value in row] for row in matrix], 0.0)


def composed(translation: Values, rotation: Values, scale: Values, unit: bool) -> Placement:
    """Return the map T R S; the rotation is a quaternion x, y, z, w.

    The formats require a unit quaternion. Stored in float32 it is not quite one, and whether its
    length is removed first (`unit`) is open: either is right.
    """
    length = math.sqrt(sum(value * value for value in rotation)) if unit else 1.0
    x, y, z, w = (value / length for value in rotation) if length != 1 else rotation
    turn = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    sizes = [
        [1 + 2 * (y * y + z * z), 2 * (abs(x * y) + abs(z * w)), 2 * (abs(x * z) + abs(y * w))],
        [2 * (abs(x * y) + abs(z * w)), 1 + 2 * (x * x + z * z), 2 * (abs(y * z) + abs(x * w))],
        [2 * (abs(x * z) + abs(y * w)), 2 * (abs(y * z) + abs(x * w)), 1 + 2 * (x * x + y * y)],
    ]
    turned = (x, y, z) != (0, 0, 0)
    matrix, terms = identity(), identity()
    for i in range(3):
        for j in range(3):
            matrix[i][j] = turn[i][j] * scale[j] if turned else float(i == j) * scale[j]
            terms[i][j] = sizes[i][j] * abs(scale[j]) if turned else float(i == j) * abs(scale[j])
        matrix[i][3], terms[i][3] = translation[i], abs(translation[i])
    return Placement(matrix, terms, LOCAL * UNIT if turned else 0.0)
