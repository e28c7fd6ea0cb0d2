"""Result of the second reader, parsing of numbers and lines, and matrices with rounding bounds."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\Z")
#: Rounding of a coordinate relative to the sum of its absolute terms: three matrices, morph targets
#: and joints are about forty double-precision operations
ROUNDING = 64 * 2.0**-53


class Refused(Exception):
    """Error for an invalid or unsupported file; the message is the reason."""


@dataclass
class Reading:
    """Polygons of a file in the file's order."""

    polygons: list[Floats] = field(default_factory=list)  #: (n, 3) each, n >= 3, double precision
    #: rounding bound of a coordinate; 0 if the file states the coordinates themselves
    rounding: float = 0.0
    #: False if the specification leaves the winding open, as for mirroring joints
    oriented: bool = True

    def add(self, vertices: Floats, corners: list[int], least: int = 3) -> None:
        """Append a polygon of some vertices; refuse indices out of range."""
        if len(corners) < least or not all(0 <= corner < len(vertices) for corner in corners):
            raise Refused(f"corners {corners} of {len(vertices)} vertices")
        self.polygons.append(vertices[corners])

    def checked(self) -> Reading:
        """Return the reading; refuse it without polygons, or with numbers that are not finite."""
        if not self.polygons or not np.isfinite(np.concatenate(self.polygons)).all():
            raise Refused("no triangles, or coordinates that are not finite")
        return self


def number(word: bytes) -> float:
    """Read a decimal number; refuse inf, nan and 1_000."""
    if not _NUMBER.match(word):
        raise Refused(f"{word!r} is no number")
    return float(word)


def integer(word: bytes) -> int:
    """Read a whole number."""
    if not re.match(rb"[+-]?\d+\Z", word):
        raise Refused(f"{word!r} is no whole number")
    return int(word)


def plain_lines(data: bytes) -> list[bytes]:
    """Split a text into lines with any line ends; skip a byte-order mark."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        data = data.decode("utf-16").encode()
    data = data.removeprefix(b"\xef\xbb\xbf")
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")


class Placement:
    """Affine map (4, 4); `sizes` sums the absolute values of the terms of each entry."""

    def __init__(self, matrix: Any = None, sizes: Any = None) -> None:
        self.matrix: Floats = np.eye(4) if matrix is None else np.asarray(matrix, np.float64)
        self.sizes: Floats = np.abs(self.matrix) if sizes is None else sizes

    def __matmul__(self, inner: Placement) -> Placement:
        """Return the map that applies `inner` first."""
        return Placement(self.matrix @ inner.matrix, self.sizes @ inner.sizes)

    def of(self, points: Floats, sizes: Floats) -> tuple[Floats, Floats]:
        """Place points (V, 3) with terms of some sizes; return the points and the new sizes."""
        if np.array_equal(self.matrix, np.eye(4)):
            return points, sizes
        linear, moved = self.matrix[:3, :3], self.matrix[:3, 3]
        return points @ linear.T + moved, sizes @ self.sizes[:3, :3].T + self.sizes[:3, 3]

    @property
    def exact(self) -> bool:
        """True if placed points are not rounded."""
        return np.array_equal(self.matrix, np.eye(4))

    @property
    def mirrors(self) -> bool:
        """True if the determinant is negative."""
        (a, b, c), (d, e, f), (g, h, i) = self.matrix[:3, :3].tolist()
        return bool(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0)
