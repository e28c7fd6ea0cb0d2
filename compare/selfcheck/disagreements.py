"""Pixels in which a traced image differs from the integers' answer: triangle, class, companions, position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.compare.selfcheck.rational import ExactRows
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.hogel_image import Certainty, HogelImage

MAX_LISTED = 5
"""Largest number of disagreements of one image that are described one by one."""

UNIT_ROUNDOFF = 2.0**-53
"""Largest relative error of one rounding to a double."""

PLANE_ROUNDINGS = 16
"""Roundings in each of the two dot products of s = (q . n) / (d . n), relative to the sum of absolute
products. A component of n has 4: 1 for each of the two differences of coordinates in a product, 1 for the
product, and 1 for the difference of two products. The product with q, which is a difference itself, has 2
more, and the sum of three products 2 more: 8, in whatever order they are computed. The number is doubled to
cover terms of second order and the rounding of this bound itself."""


@dataclass(frozen=True, kw_only=True)
class Disagreement:
    """One pixel that the reference has wrong.

    Attributes
    ----------
    row, column
        Row and column of the pixel.
    about
        Kind of disagreement: "triangle", "certainty", "companions" or "position".
    expected, got
        Answer of the integers, and of the reference.
    """

    row: int
    column: int
    about: str
    expected: str
    got: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Disagreements:
    """All pixels of an image that the reference has wrong.

    Attributes
    ----------
    wrong
        (H, W) pixels with any disagreement.
    listed
        Descriptions of the first few disagreements.
    """

    wrong: Mask
    listed: tuple[Disagreement, ...]


def disagreements(image: HogelImage, exact: ExactRows, pencil: Pencil, triangles: Floats) -> Disagreements:
    """Compare every pixel of a traced image with the exact answer for all its rows.

    A pixel is wrong in each of these cases:

    * its triangle is another one, or none where the line meets one, or one where the line meets none;
    * a tie is not called one, a pixel without a tie is called one, or the pixel was not examined;
    * its tie has other companions;
    * its position is off its line, or farther from the exact position along the line than
      `position_bound`; where the reference claims rational arithmetic, farther than one rounding.
    """
    assert image.certainty is not None
    tie = np.zeros(exact.triangle.shape, dtype=np.bool_)
    tie[exact.ties[:, 0], exact.ties[:, 1]] = True
    claimed = image.certainty == Certainty.TIE
    found = {
        "triangle": image.triangle != exact.triangle,
        "certainty": (claimed != tie) | (image.certainty == Certainty.UNEXAMINED),
        "companions": _other_companions(image, exact),
        "position": _misplaced(image, exact, pencil, triangles),
    }
    listed = []
    for about, mask in found.items():
        for row, column in np.argwhere(mask)[:MAX_LISTED].tolist():
            expected, got = _described(about, image, exact, (row, column))
            listed.append(Disagreement(row=row, column=column, about=about, expected=expected, got=got))
    return Disagreements(wrong=np.logical_or.reduce(list(found.values())), listed=tuple(listed[:MAX_LISTED]))


def _other_companions(image: HogelImage, exact: ExactRows) -> Mask:
    """Return the pixels in which the tied triangles differ from the exact ones, (H, W)."""
    assert image.companions is not None
    got, expected = set(map(tuple, image.companions.tolist())), set(map(tuple, exact.ties.tolist()))
    mask = np.zeros(exact.triangle.shape, dtype=np.bool_)
    for row, column, _ in got ^ expected:
        mask[row, column] = True
    return mask


def _misplaced(image: HogelImage, exact: ExactRows, pencil: Pencil, triangles: Floats) -> Mask:
    """Return the pixels whose position is not where the line meets the exact triangle, (H, W)."""
    assert image.certainty is not None
    mask: Mask = np.isfinite(image.position).any(axis=-1) != (exact.triangle >= 0)
    same = (image.triangle == exact.triangle) & (exact.triangle >= 0)
    d, s = pencil.directions()[same], exact.s[same]
    center = np.asarray(pencil.center)
    allowed = position_bound(triangles[exact.triangle[same]] - center, d, s)
    allowed = np.where(image.certainty[same] == Certainty.EXACT, UNIT_ROUNDOFF * np.abs(s), allowed)
    # The position is the center plus s d, two more roundings, and the exact s was rounded once. 8 covers
    # these and the same operations in this check.
    reach = np.abs(center) + np.abs(s[:, None] * d)
    off = np.abs(image.position[same] - (center + s[:, None] * d))
    mask[same] |= ~(off <= allowed[:, None] * np.abs(d) + 8 * UNIT_ROUNDOFF * reach).all(axis=1)
    return mask


def position_bound(corners: Floats, d: Floats, s: Floats) -> Floats:
    """Return the largest error of an s that was computed in double precision, (N,).

    Where rounding leaves the sign of d . n in doubt, only rational arithmetic can decide s: there the bound
    is that of a rounded exact s.

    Parameters
    ----------
    corners
        (N, 3, 3) corners of the triangles met, relative to the center, scene units.
    d
        (N, 3) directions of the lines.
    s
        (N,) exact values of s, rounded to the nearest double.
    """
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    magnitude = np.stack(
        [np.abs(a[:, i] * b[:, j]) + np.abs(a[:, j] * b[:, i]) for i, j in ((1, 2), (2, 0), (0, 1))], axis=1
    )
    rounding = PLANE_ROUNDINGS * UNIT_ROUNDOFF
    offset_error = rounding * np.sum(np.abs(corners[:, 0]) * magnitude, axis=1)
    slope_error = rounding * np.sum(np.abs(d) * magnitude, axis=1)
    slope = np.abs(np.sum(np.cross(a, b) * d, axis=1)) - slope_error
    decidable = slope > 0
    error = (offset_error + np.abs(s) * slope_error) / np.where(decidable, slope, 1.0)
    return np.where(decidable, error, 0.0) + 2 * UNIT_ROUNDOFF * np.abs(s)


def _described(about: str, image: HogelImage, exact: ExactRows, pixel: tuple[int, int]) -> tuple[str, str]:
    """Return the expected answer and the reference's answer in words."""
    assert image.certainty is not None
    assert image.companions is not None
    expected_ties = [number for *where, number in exact.ties.tolist() if tuple(where) == pixel]
    got_ties = [number for *where, number in image.companions.tolist() if tuple(where) == pixel]
    if about == "triangle":
        return str(exact.triangle[pixel]), str(image.triangle[pixel])
    if about == "certainty":
        return "tie" if expected_ties else "no tie", Certainty(image.certainty[pixel]).name.lower()
    if about == "companions":
        return str(expected_ties), str(got_ties)
    return f"s = {exact.s[pixel]!r}", f"position {image.position[pixel].tolist()}"
