"""Comparison of a reference image with exact results: triangles, ties, certainties, positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.compare.selfcheck.rational import ExactRows
from xfrustum.reference.lines import RayBundle
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.images import Certainty, DirectionImage, HogelImage

MAX_LISTED = 5  #: largest number of disagreements of one image that are described one by one
UNIT_ROUNDOFF = 2.0**-53  #: largest relative error of one rounding to a double

PLANE_ROUNDINGS = 16
"""Roundings in each of the two dot products of s = (q . n) / (d . n).

They are relative to the sum of absolute products. A component of n has 4 roundings: 1 for each of
the two differences of coordinates in a product, 1 for the product, and 1 for the difference of two
products. q is a difference, and its product with n has 2 more. The sum of three products has 2
more: 8, in any order. The number is doubled to cover terms of second order and the rounding of this
bound."""


@dataclass(frozen=True, kw_only=True)
class Disagreement:
    """A wrong pixel of the reference, with the exact result and the result of the reference."""

    row: int
    column: int
    about: str  #: "triangle", "certainty", "companions" or "position"
    expected: str
    got: str


@dataclass(frozen=True, kw_only=True, eq=False)
class ImageLines:
    """The line of every pixel of an image: P(s) = point + s d."""

    points: Floats  #: (H, W, 3)
    directions: Floats  #: (H, W, 3) d

    @classmethod
    def from_bundle(cls, bundle: RayBundle) -> ImageLines:
        """Return the lines of a hogel, which share one point."""
        d = bundle.directions()
        return cls(points=np.broadcast_to(np.asarray(bundle.center), d.shape), directions=d)


def disagreements(
    image: HogelImage | DirectionImage, exact: ExactRows, lines: ImageLines, triangles: Floats
) -> tuple[Mask, tuple[Disagreement, ...]]:
    """Compare every pixel of a reference image with the exact results for all its rows.

    A pixel is wrong if its triangle differs; if its certainty is wrong about a tie, or is
    `UNEXAMINED`; if other triangles are tied; or if its position is off its line. Along the line,
    the position may differ from the exact position by `position_bound`, or by one rounding if the
    reference claims rational arithmetic. Returns (H, W) pixels with any disagreement, and
    descriptions of the first few.
    """
    assert image.certainty is not None and image.tied_triangles is not None
    shape = exact.triangle.shape
    expected, got = (
        set(map(tuple, exact.ties.tolist())),
        set(map(tuple, image.tied_triangles.tolist())),
    )
    tie, tied_triangles = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_)
    for mask, places in ((tie, expected), (tied_triangles, got ^ expected)):
        for row, column, _ in places:
            mask[row, column] = True
    claimed = image.certainty == Certainty.TIE
    wrong_by_kind: dict[str, Mask] = {
        "triangle": image.triangle != exact.triangle,
        "certainty": (claimed != tie) | (image.certainty == Certainty.UNEXAMINED),
        "companions": tied_triangles,
        "position": _misplaced(image, exact, lines, triangles),
    }

    def described(about: str, pixel: tuple[int, int]) -> Disagreement:
        """Describe the exact result and the reference's result."""
        tied, marked = (
            sorted(number for *at, number in ties if tuple(at) == pixel) for ties in (expected, got)
        )
        assert image.certainty is not None
        words = {
            "triangle": (str(exact.triangle[pixel]), str(image.triangle[pixel])),
            "certainty": (
                "tie" if tied else "no tie",
                Certainty(image.certainty[pixel]).name.lower(),
            ),
            "companions": (str(tied), str(marked)),
            "position": (f"s = {exact.s[pixel]!r}", f"position {image.position[pixel].tolist()}"),
        }[about]
        return Disagreement(
            row=pixel[0], column=pixel[1], about=about, expected=words[0], got=words[1]
        )

    pixels = [
        (about, (row, column))
        for about, mask in wrong_by_kind.items()
        for row, column in np.argwhere(mask)
    ]
    listed = tuple(
        described(about, (int(row), int(column))) for about, (row, column) in pixels[:MAX_LISTED]
    )
    return np.logical_or.reduce(list(wrong_by_kind.values())), listed


def _misplaced(
    image: HogelImage | DirectionImage, exact: ExactRows, lines: ImageLines, triangles: Floats
) -> Mask:
    """Return the pixels (H, W) whose position is not where the line meets the exact triangle."""
    assert image.certainty is not None
    mask: Mask = np.isfinite(image.position).any(axis=-1) != (exact.triangle >= 0)
    same = (image.triangle == exact.triangle) & (exact.triangle >= 0)
    d, s, center = lines.directions[same], exact.s[same], lines.points[same]
    allowed = position_bound(triangles[exact.triangle[same]] - center[:, None], d, s)
    allowed = np.where(image.certainty[same] == Certainty.EXACT, UNIT_ROUNDOFF * np.abs(s), allowed)
    # The position, center + s d, has two more roundings, and the exact s was rounded once. A factor
    # of 8 covers these and the same operations in this check.
    reach = np.abs(center) + np.abs(s[:, None] * d)
    off = np.abs(image.position[same] - (center + s[:, None] * d))
    mask[same] |= ~(off <= allowed[:, None] * np.abs(d) + 8 * UNIT_ROUNDOFF * reach).all(axis=1)
    return mask


def position_bound(corners: Floats, d: Floats, s: Floats) -> Floats:
    """Return the largest error (N,) of an s that was computed in double precision.

    `corners` (N, 3, 3) are the corners of the triangles met, relative to the center. d (N, 3) are
    the directions, and s (N,) the rounded exact values. If rounding leaves the sign of d . n
    undetermined, s needs rational arithmetic, and the bound allows only the rounding of an exact s.
    """
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    magnitude = np.stack(
        [
            np.abs(a[:, i] * b[:, j]) + np.abs(a[:, j] * b[:, i])
            for i, j in ((1, 2), (2, 0), (0, 1))
        ],
        axis=1,
    )
    rounding = PLANE_ROUNDINGS * UNIT_ROUNDOFF
    offset_error = rounding * np.sum(np.abs(corners[:, 0]) * magnitude, axis=1)
    slope_error = rounding * np.sum(np.abs(d) * magnitude, axis=1)
    slope = np.abs(np.sum(np.cross(a, b) * d, axis=1)) - slope_error
    decidable = slope > 0
    error = (offset_error + np.abs(s) * slope_error) / np.where(decidable, slope, 1.0)
    return np.where(decidable, error, 0.0) + 2 * UNIT_ROUNDOFF * np.abs(s)
