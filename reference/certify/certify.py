"""Who is first along each line? Proven in double precision, decided in rationals, or a tie.

The argument (docs/truth.md): `spans` leaves out no triangle that a line meets, `narrow` bounds
every rounding error, so a triangle that surely is met before the nearest possible point of every
other is first, whatever any tracer says. Everything else is decided exactly.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.certify.footprints import footprints
from xfrustum.reference.certify.processors import narrow_phase
from xfrustum.reference.certify.rows import boxed_rows
from xfrustum.reference.certify.sides import Sides, sorted_by_side
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.lines.pairs import Pairs
from xfrustum.scenes.arrays import Bytes, Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.hogel_image import Certainty


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

    triangle: Numbers
    s: Floats
    certainty: Bytes
    companions: Indices


class Certifier:
    """Decides who is first along the lines of one image.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners in scene units.
    pencil
        The lines.
    sides
        The triangles as `sorted_by_side` sorts them for this pencil, where that has been done.

    Attributes
    ----------
    pencil
        The lines.
    """

    def __init__(self, triangles: Floats, pencil: Pencil, sides: Iterable[Sides] | None = None) -> None:
        self._triangles = triangles
        self.pencil = pencil
        self._exact = ExactPencil(triangles, pencil)
        self._footprints = footprints(sides or sorted_by_side(triangles, pencil), pencil, self._exact)

    def decide(self, rows: range) -> FirstSurfaces:
        """Decide the first surface of every pixel in some rows of the image."""
        phase = narrow_phase(self.pencil, rows)
        for boxed in boxed_rows(self._triangles, self.pencil, self._footprints, rows):
            phase.add(boxed)
        sifted = phase.finish()
        shape = (len(rows), self.pencil.resolution[0])
        found = FirstSurfaces(
            triangle=sifted.triangle.reshape(shape),
            s=sifted.s.reshape(shape),
            certainty=np.full(shape, Certainty.PROVEN, dtype=np.uint8),
            companions=np.zeros((0, 3), dtype=np.int64),
        )
        if not len(sifted.contested.pixel):
            return found
        return replace(found, companions=self._settle(found, sifted.contested, rows.start * shape[1]))

    def _settle(self, found: FirstSurfaces, contested: Pairs, base: int) -> Indices:
        """Fill in the pixels that `narrow` left open; return the companions of ties."""
        triangle, s, certainty = found.triangle.ravel(), found.s.ravel(), found.certainty.ravel()
        width = self.pencil.resolution[0]
        contenders = _not_behind(contested, base, len(triangle))
        rivals = np.bincount(contenders.pixel - base, minlength=len(triangle))[contenders.pixel - base]
        proven = (rivals == 1) & contenders.sure
        triangle[contenders.pixel[proven] - base] = contenders.triangle[proven]
        s[contenders.pixel[proven] - base] = contenders.s[proven]

        groups = _Groups.of(contenders[~proven])
        tied = groups.tied(self._exact)
        leaders = groups.starts[tied]
        triangle[groups.pairs.pixel[leaders] - base] = groups.pairs.triangle[leaders]
        s[groups.pairs.pixel[leaders] - base] = groups.pairs.s[leaders]
        certainty[groups.pairs.pixel[leaders] - base] = Certainty.TIE
        sharing = groups.pairs[np.repeat(tied, groups.sizes)]
        companions = [np.stack((*np.divmod(sharing.pixel, width), sharing.triangle), axis=-1)]

        for pixel, numbers in groups.items(~tied):
            winners, where = _first(pixel, numbers, self._exact)
            if winners:
                triangle[pixel - base], s[pixel - base] = winners[0], where
            certainty[pixel - base] = Certainty.TIE if len(winners) > 1 else Certainty.EXACT
            if len(winners) > 1:
                companions.append(np.array([(*divmod(pixel, width), winner) for winner in winners]))
        return np.concatenate(companions)


def first_surfaces(triangles: Floats, pencil: Pencil) -> FirstSurfaces:
    """Decide the first surface of every pixel of an image at once."""
    return Certifier(triangles, pencil).decide(range(pencil.resolution[1]))


def _not_behind(pairs: Pairs, base: int, pixels: int) -> Pairs:
    """Drop the pairs that surely lie behind another, now that doubtful coverage is settled."""
    limit = np.full(pixels, np.inf)
    np.minimum.at(limit, pairs.pixel[pairs.sure] - base, pairs.farthest[pairs.sure])
    return pairs[pairs.nearest <= limit[pairs.pixel - base]]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Groups:
    """Contested pairs by pixel, within one by triangle number, each triangle once."""

    pairs: Pairs
    starts: Indices
    sizes: Indices

    @classmethod
    def of(cls, contested: Pairs) -> _Groups:
        # A triangle whose side is in doubt comes twice; the pair that is sure comes first.
        pairs = contested[np.lexsort((~contested.sure, contested.triangle, contested.pixel))]
        again = (np.diff(pairs.pixel, prepend=-1) == 0) & (np.diff(pairs.triangle, prepend=-1) == 0)
        pairs = pairs[~again]
        _, starts, sizes = np.unique(pairs.pixel, return_index=True, return_counts=True)
        return cls(pairs=pairs, starts=starts, sizes=sizes)

    def tied(self, exact: ExactPencil) -> Mask:
        """Return the groups of which every line meets all at one s: no need to ask this line.

        That is triangles through the center, met at s = 0 without any error, and triangles in
        exactly one plane.
        """
        if not len(self.starts):
            return np.zeros(0, dtype=np.bool_)
        leader = np.repeat(self.starts, self.sizes)
        known = (self.pairs.error == 0) & (self.pairs.error[leader] == 0)
        sure = np.repeat(np.logical_and.reduceat(self.pairs.sure, self.starts), self.sizes)
        asked = np.flatnonzero(sure & ~known)
        planes = np.stack((self.pairs.triangle[leader[asked]], self.pairs.triangle[asked]), axis=-1)
        different, which = np.unique(planes, axis=0, return_inverse=True)
        coplanar = np.array([exact.coplanar(one, other) for one, other in different.tolist()], dtype=np.bool_)
        known[asked] = coplanar[which.ravel()]
        alone = self.sizes == 1
        return np.asarray(np.logical_and.reduceat(sure & known, self.starts) & ~alone)

    def items(self, chosen: Mask) -> Iterator[tuple[int, list[int]]]:
        """Yield pixel and triangle numbers of some groups."""
        for start, size in zip(self.starts[chosen].tolist(), self.sizes[chosen].tolist(), strict=True):
            yield int(self.pairs.pixel[start]), self.pairs.triangle[start : start + size].tolist()


def _first(pixel: int, numbers: list[int], exact: ExactPencil) -> tuple[list[int], float]:
    """Return the first of some triangles along a pixel's line in ascending order, and their s."""
    hits = {number: s for number in numbers if (s := exact.meets(pixel, number)) is not None}
    if not hits:
        return [], float("nan")
    first = min(hits.values())
    return [number for number, s in hits.items() if s == first], float(first)
