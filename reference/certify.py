"""Who is first along each line? Proven in double precision, decided in rationals, or a tie.

The argument (docs/truth.md): `spans` leaves out no triangle that a line meets, `narrow` bounds
every rounding error, so a triangle that surely is met before the nearest possible point of every
other is first, whatever any tracer says. Everything else is decided exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.exact import ExactPencil
from xfrustum.reference.lines import Pencil
from xfrustum.reference.narrow import Pairs
from xfrustum.reference.processors import narrow_phase
from xfrustum.reference.spans import footprints, spans
from xfrustum.scenes.hogel_image import Certainty


@dataclass(frozen=True, kw_only=True, eq=False)
class FirstSurfaces:
    """What the lines of some rows meet first.

    Attributes
    ----------
    triangle
        (rows, W) int32, `NOTHING` where a line meets none.
    s
        (rows, W) float64 along the line, NaN where it meets none.
    certainty
        (rows, W) uint8 `Certainty`.
    companions
        (N, 3) row of the image, column and triangle number of all that share a tie.
    """

    triangle: NDArray[np.int32]
    s: NDArray[np.float64]
    certainty: NDArray[np.uint8]
    companions: NDArray[np.int64]


class Certifier:
    """Decides who is first along the lines of one image.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners in scene units.
    pencil
        The lines.
    """

    def __init__(self, triangles: NDArray[np.float64], pencil: Pencil) -> None:
        self._triangles = triangles
        self._pencil = pencil
        self._exact = ExactPencil(triangles, pencil)
        self._footprints = footprints(triangles, pencil, self._exact)

    def decide(self, rows: range) -> FirstSurfaces:
        """Decide the first surface of every pixel in some rows of the image."""
        width = self._pencil.resolution[0]
        phase = narrow_phase(self._pencil, rows)
        for span in spans(self._triangles, self._pencil, self._footprints, rows):
            phase.add(span)
        sifted = phase.finish()
        triangle, s = sifted.triangle, sifted.s
        certainty = np.full(len(triangle), Certainty.PROVEN, dtype=np.uint8)

        base = rows.start * width
        contenders = _not_behind(sifted.contested, base, len(triangle))
        rivals = np.bincount(contenders.pixel - base, minlength=len(triangle))[contenders.pixel - base]
        proven = (rivals == 1) & contenders.sure
        triangle[contenders.pixel[proven] - base] = contenders.triangle[proven]
        s[contenders.pixel[proven] - base] = contenders.s[proven]

        companions: list[tuple[int, int, int]] = []
        for pixel, group in _by_pixel(contenders[~proven]):
            winners, where, decided = _decide(pixel, group, self._exact)
            certainty[pixel - base] = decided
            if winners:
                triangle[pixel - base], s[pixel - base] = winners[0], where
            if decided == Certainty.TIE:
                companions.extend((*divmod(pixel, width), winner) for winner in winners)

        shape = (len(rows), width)
        return FirstSurfaces(
            triangle=triangle.reshape(shape),
            s=s.reshape(shape),
            certainty=certainty.reshape(shape),
            companions=np.array(companions, dtype=np.int64).reshape(-1, 3),
        )


def first_surfaces(triangles: NDArray[np.float64], pencil: Pencil) -> FirstSurfaces:
    """Decide the first surface of every pixel of an image at once."""
    return Certifier(triangles, pencil).decide(range(pencil.resolution[1]))


def _not_behind(pairs: Pairs, base: int, pixels: int) -> Pairs:
    """Drop the pairs that surely lie behind another, now that doubtful coverage is settled."""
    limit = np.full(pixels, np.inf)
    np.minimum.at(limit, pairs.pixel[pairs.sure] - base, pairs.farthest[pairs.sure])
    return pairs[pairs.nearest <= limit[pairs.pixel - base]]


def _by_pixel(contested: Pairs) -> list[tuple[int, Pairs]]:
    """Group pairs by pixel, within one by triangle number."""
    order = np.lexsort((contested.triangle, contested.pixel))
    contested = contested[order]
    pixels, starts = np.unique(contested.pixel, return_index=True)
    ends = np.append(starts, len(order))[1:]
    return [
        (pixel, contested[np.arange(start, end)])
        for pixel, start, end in zip(pixels.tolist(), starts.tolist(), ends.tolist(), strict=True)
    ]


def _decide(pixel: int, group: Pairs, exact: ExactPencil) -> tuple[list[int], float, Certainty]:
    """Return the first triangles of a contested pixel in ascending order, their s, and the class."""
    numbers = group.triangle.tolist()
    if group.sure.all() and (
        not group.error.any() or all(exact.coplanar_pair(numbers[0], other) for other in numbers[1:])
    ):
        # Every line meets these at one s: no need to ask this line.
        return numbers, float(group.s[0]), Certainty.TIE
    hits = {number: s for number in numbers if (s := exact.meets(pixel, number)) is not None}
    if not hits:
        return [], float("nan"), Certainty.EXACT
    first = min(hits.values())
    winners = [number for number, s in hits.items() if s == first]
    return winners, float(first), Certainty.TIE if len(winners) > 1 else Certainty.EXACT
