"""Certification: each pixel is proven, decided in integers, or a tie.

The argument (docs/truth.md): `filter` misses no triangle that a line meets, and bounds every
rounding error. If a line certainly meets a triangle in front of the nearest possible point of every
other triangle, this triangle is first, independent of any tracer: the pixel is proven. Pixels that
the filter leaves open may still be proven by edge functions at the pixel's center. Coincident
triangles are a tie. All other pixels are decided in integers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from xfrustum.reference.backend import recording
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.certify.directions import DirectionLines, ExactGrid
from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.certify.filter import Filter, Lines, Pairs, PencilLines
from xfrustum.reference.lines import PixelLines, RayBundle
from xfrustum.scenes.arrays import Bytes, Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.images import NOTHING, Certainty


@dataclass(frozen=True, kw_only=True, eq=False)
class FirstSurfaces:
    """The first surfaces along the lines of some rows."""

    triangle: Numbers  #: (rows, W) int32 triangle number, `NOTHING` where a line meets no triangle
    s: Floats  #: (rows, W) float64 position along the line, NaN where it meets no triangle
    certainty: Bytes  #: (rows, W) uint8 `Certainty`
    #: (N, 3) row of the image, column and triangle number of each tied triangle
    tied_triangles: Indices
    #: `triangle` and `s` as flat Dr.Jit arrays; None if they are only NumPy arrays
    device: tuple[Any, Any] | None = None

    def renumbered(self, numbers: Indices) -> FirstSurfaces:
        """Return the same decisions with `numbers` (F,) in place of triangles 0 to F - 1."""
        # The index -1, `NOTHING`, selects the last entry.
        known = np.append(numbers, NOTHING)
        tied_triangles = self.tied_triangles.copy()
        tied_triangles[:, 2] = known[tied_triangles[:, 2]]
        return replace(
            self,
            triangle=known[self.triangle].astype(np.int32),
            tied_triangles=tied_triangles,
            device=None,
        )


class Certifier:
    """Computation of the first surfaces along the lines of one image, with certainty."""

    def __init__(self, triangles: Triangles, bundle: RayBundle | PixelLines) -> None:
        self.bundle = bundle
        self._exact: ExactPencil | ExactGrid
        with recording():
            if isinstance(bundle, PixelLines):
                self._exact = ExactGrid(triangles.corners, bundle)
                lines: Lines = DirectionLines(bundle, triangles)
            else:
                self._exact = ExactPencil(triangles.corners, bundle)
                lines = PencilLines(bundle, self._exact)
        self._filter = Filter(triangles, lines)

    def gaps(self, rows: range, numbers: Indices | None = None) -> Floats:
        """Return the gaps of some rows, (rows, W); see `Reference.gaps` and `Filter.gaps`."""
        return self._filter.gaps(rows, numbers).reshape(len(rows), -1)

    def decide(self, rows: range) -> FirstSurfaces:
        """Decide the first surface of every pixel in some rows of the image."""
        classified = self._filter.classify_pixels(rows)
        shape = (len(rows), self.bundle.resolution[0])
        decided = FirstSurfaces(
            triangle=classified.triangle.reshape(shape),
            s=classified.s.reshape(shape),
            # Pixels are proven unless they are ambiguous; `_settle` overwrites ambiguous pixels.
            certainty=np.full(shape, Certainty.PROVEN, dtype=np.uint8),
            tied_triangles=np.zeros((0, 3), dtype=np.int64),
            device=classified.device,
        )
        ambiguous = classified.ambiguous
        if not len(ambiguous.pixel):
            return decided
        if isinstance(self._exact, ExactGrid):
            ambiguous = self._exact.through_apertures(ambiguous)
        decided = replace(
            decided, triangle=decided.triangle.copy(), s=decided.s.copy(), device=None
        )
        tied_triangles = self._settle(decided, ambiguous, rows.start * shape[1])
        return replace(decided, tied_triangles=tied_triangles)

    def _settle(self, decided: FirstSurfaces, ambiguous: Pairs, base: int) -> Indices:
        """Decide the ambiguous pixels, numbered from `base`, in place; return tied triangles."""
        triangle, s, certainty = (
            decided.triangle.ravel(),
            decided.s.ravel(),
            decided.certainty.ravel(),
        )
        width = self.bundle.resolution[0]
        # Step 1: a pixel with a single remaining candidate that is certainly met is proven.
        contenders = _not_behind(ambiguous, base, len(triangle))
        rivals = np.bincount(contenders.pixel - base, minlength=len(triangle))[
            contenders.pixel - base
        ]
        proven = (rivals == 1) & contenders.sure
        triangle[contenders.pixel[proven] - base] = contenders.triangle[proven]
        s[contenders.pixel[proven] - base] = contenders.s[proven]

        # Step 2: candidates with equal s on every line are a tie.
        groups = _Groups.from_pairs(contenders[~proven])
        tied = groups.tied(self._exact)
        leaders = groups.starts[tied]
        triangle[groups.pairs.pixel[leaders] - base] = groups.pairs.triangle[leaders]
        s[groups.pairs.pixel[leaders] - base] = groups.pairs.s[leaders]
        certainty[groups.pairs.pixel[leaders] - base] = Certainty.TIE
        sharing = groups.pairs[np.repeat(tied, groups.sizes)]
        tied_triangles = [np.stack((*np.divmod(sharing.pixel, width), sharing.triangle), axis=-1)]

        # Step 3: the other pixels are decided in integers, one by one.
        for pixel, numbers in groups.items(~tied):
            winners, where = _first(pixel, numbers, self._exact)
            if winners:
                triangle[pixel - base], s[pixel - base] = winners[0], where
            certainty[pixel - base] = Certainty.TIE if len(winners) > 1 else Certainty.EXACT
            if len(winners) > 1:
                tied_triangles.append(
                    np.array([(*divmod(pixel, width), winner) for winner in winners])
                )
        return np.concatenate(tied_triangles)


def first_surfaces(corners: Floats, bundle: RayBundle) -> FirstSurfaces:
    """Decide the first surface of every pixel of an image at once; `corners` are (F, 3, 3)."""
    return Certifier(Triangles(corners), bundle).decide(range(bundle.resolution[1]))


def _not_behind(pairs: Pairs, base: int, pixels: int) -> Pairs:
    """Return the pairs that are not certainly behind another pair of their pixel."""
    limit = np.full(pixels, np.inf)
    np.minimum.at(limit, pairs.pixel[pairs.sure] - base, pairs.farthest[pairs.sure])
    return pairs[pairs.nearest <= limit[pairs.pixel - base]]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Groups:
    """Ambiguous pairs grouped by pixel, each triangle once per pixel.

    `starts` (G,) are the indices of the first pair of each pixel, and `sizes` (G,) are the numbers
    of pairs.
    """

    pairs: Pairs
    starts: Indices
    sizes: Indices

    @classmethod
    def from_pairs(cls, ambiguous: Pairs) -> _Groups:
        # A triangle with an uncertain side may have two pairs for a pixel. The certain pair is
        # sorted first and kept.
        pairs = ambiguous[np.lexsort((~ambiguous.sure, ambiguous.triangle, ambiguous.pixel))]
        again = (np.diff(pairs.pixel, prepend=-1) == 0) & (np.diff(pairs.triangle, prepend=-1) == 0)
        pairs = pairs[~again]
        _, starts, sizes = np.unique(pairs.pixel, return_index=True, return_counts=True)
        return cls(pairs=pairs, starts=starts, sizes=sizes)

    def tied(self, exact: ExactPencil | ExactGrid) -> Mask:
        """Return a mask of the groups of triangles that every line meets at the same s.

        These are triangles through the center, which every line meets at exactly s = 0, and
        triangles in exactly the same plane.
        """
        if not len(self.starts):
            return np.zeros(0, dtype=np.bool_)
        # Triangles through the center have s = 0 exactly. They are tied if the group's first
        # triangle also passes through the center.
        leader = np.repeat(self.starts, self.sizes)
        known = (self.pairs.error == 0) & (self.pairs.error[leader] == 0)
        # Triangles in the plane of the group's first triangle, computed in integers once per pair.
        sure = np.repeat(np.logical_and.reduceat(self.pairs.sure, self.starts), self.sizes)
        unsettled = np.flatnonzero(sure & ~known)
        planes = np.stack(
            (self.pairs.triangle[leader[unsettled]], self.pairs.triangle[unsettled]), axis=-1
        )
        different, which = np.unique(planes, axis=0, return_inverse=True)
        coplanar = np.array([exact.coplanar(*pair) for pair in different.tolist()], dtype=np.bool_)
        known[unsettled] = coplanar[which.ravel()]
        # A tie needs at least two certain hits.
        alone = self.sizes == 1
        return np.asarray(np.logical_and.reduceat(sure & known, self.starts) & ~alone)

    def items(self, chosen: Mask) -> Iterator[tuple[int, list[int]]]:
        """Yield the pixel and the triangle numbers of some groups."""
        for start, size in zip(
            self.starts[chosen].tolist(), self.sizes[chosen].tolist(), strict=True
        ):
            yield int(self.pairs.pixel[start]), self.pairs.triangle[start : start + size].tolist()


def _first(
    pixel: int, numbers: list[int], exact: ExactPencil | ExactGrid
) -> tuple[list[int], float]:
    """Return the triangles that a pixel's line meets first, in ascending order, and their s."""
    hits = {number: s for number in numbers if (s := exact.meets(pixel, number)) is not None}
    if not hits:
        return [], float("nan")
    first = min(hits.values())
    return [number for number, s in hits.items() if s == first], float(first)
