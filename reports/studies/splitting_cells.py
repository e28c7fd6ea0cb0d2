"""Cells and rows of the study of splitting, and whether one pair of frusta is enough in them.

All lengths are shares of the reach.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from itertools import product
from typing import Any

import numpy as np

from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.scenes.library.depth_family import REACH
from xfrustum.scenes.plate.double_frustum import (
    Camera,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Fit,
    Offset,
    Pivot,
)
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX

DepthBuffer = tuple[DepthFormat, DepthMapping]
Drawing = tuple[Pivot, Fit | None, Offset]

SIDES = (Camera.C, Camera.C_STAR)

ASKED_SEPARATION = 1e-3
"""Distance of two surfaces at the far end that a depth buffer must order, as a share of the reach."""

AS_IN_THE_PAPER: Drawing = (Pivot.APERTURE, None, Offset.PLATE)


class Family(StrEnum):
    """Kinds of scenes; each but the first changes one thing of the first.

    `ONE_SIDE` has cars on one side of the plate, seen from the middle aperture of a centered frustum.
    `BOTH_SIDES` has cars on both sides at once. `OFF_MIDDLE` is the first as an aperture off the middle sees
    it, and `IN_MIDDLE` the same scene as the middle aperture sees it. `RECENTERED` shows the picture of the
    first through a sheared frustum. `THROUGH` is a car that runs through the plate.
    """

    ONE_SIDE = "one side"
    BOTH_SIDES = "both sides"
    OFF_MIDDLE = "off the middle"
    IN_MIDDLE = "in the middle"
    RECENTERED = "recentered"
    THROUGH = "through the plate"


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One picture of the study.

    Attributes
    ----------
    family, side
        Kind of scene; the side of the plate with content, by the one camera that sees it, or `BOTH`.
    ratio
        Depth of the scene: farthest to nearest |z| of its surfaces. In the family `THROUGH` it is the reach
        over the aperture's distance from where the surface crosses the plate.
    resolution
        W = H in pixels.
    near, depth, mapping, slabs, pivot, fit, offset
        As in `DoubleFrustum`.
    """

    family: Family
    side: Camera
    ratio: float
    resolution: int
    near: float
    depth: DepthFormat
    mapping: DepthMapping
    slabs: tuple[float, ...] = ()
    pivot: Pivot = Pivot.APERTURE
    fit: Fit | None = None
    offset: Offset = Offset.PLATE

    @property
    def buffer(self) -> DepthBuffer:
        """Format and mapping."""
        return self.depth, self.mapping

    @property
    def picture(self) -> tuple[Family, Camera, float, int]:
        """The picture alone, without what draws it."""
        return self.family, self.side, self.ratio, self.resolution

    @property
    def drawing(self) -> Drawing:
        """Pivot, fit and offset."""
        return self.pivot, self.fit, self.offset

    @property
    def settings(self) -> DoubleFrustum:
        """Settings of the rasterizer, in scene units."""
        return DoubleFrustum(
            near=self.near * REACH,
            depth=self.depth,
            mapping=self.mapping,
            camera=self.side,
            pivot=self.pivot,
            fit=self.fit,
            offset=self.offset,
            slabs=tuple(cut * REACH for cut in self.slabs),
        )


@dataclass(frozen=True, kw_only=True)
class Row(Cell):
    """A cell, its picture judged, and the sheets at the far end of its side.

    docs/answers.md, "The study of splitting", says what each field is.
    """

    judged: int
    covered: int
    nearest: float
    farthest: float
    surface_wrong: int
    outside: int
    depth_wrong: int
    lost: int
    displacement_rms: float | None
    displacement_p99: float | None
    displacement_max: float | None
    displaced: int
    predicted_rms: float | None
    predicted_p99: float | None
    misordered: float
    ordered_separation: float | None
    predicted_separation: float

    @property
    def depth_fraction(self) -> float:
        """Share of the judged pixels whose wrong surface is charged to depth."""
        return self.depth_wrong / self.judged


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Every combination of these, with each of some nears, is one cell of one family."""

    family: Family
    sides: tuple[Camera, ...]
    ratios: tuple[float, ...]
    buffers: tuple[DepthBuffer, ...]
    resolutions: tuple[int, ...] = (256,)
    drawings: tuple[Drawing, ...] = (AS_IN_THE_PAPER,)

    def blocks(self, nears: Sequence[float]) -> Iterator[tuple[Cell, ...]]:
        """Yield the cells of each picture, those of one drawing and near together: they share a control."""
        for side, ratio, resolution in product(self.sides, self.ratios, self.resolutions):
            picture: dict[str, Any] = {
                "family": self.family,
                "side": side,
                "ratio": ratio,
                "resolution": resolution,
            }
            yield tuple(
                Cell(**picture, near=near, depth=depth, mapping=mapping, pivot=pivot, fit=fit, offset=offset)
                for (pivot, fit, offset), near, (depth, mapping) in product(
                    self.drawings, nears, self.buffers
                )
            )


Study = tuple[tuple[float, ...], tuple[Grid, ...]]
"""The nears of a study, from the largest down, and its grids."""

_DEPTHS = (1.5, 10.0, 100.0, 1000.0)
_BUFFERS: tuple[DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.REVERSED),
    (DepthFormat.D32F, DepthMapping.REVERSED),
    (DepthFormat.D24, DepthMapping.LOGARITHMIC),
)
"""Depth buffers of the other families: those that devices store without a fragment's help, and one that a
fragment writes. Depth is that of the first family, for the same |z| and near."""

_FIRST = Grid(
    family=Family.ONE_SIDE,
    sides=SIDES,
    ratios=_DEPTHS,
    buffers=tuple(product(DepthFormat, DepthMapping)),
    resolutions=(128, 256, 512),
)
_OTHERS = (
    Grid(family=Family.BOTH_SIDES, sides=(Camera.BOTH,), ratios=_DEPTHS, buffers=_BUFFERS),
    Grid(family=Family.IN_MIDDLE, sides=(Camera.C,), ratios=_DEPTHS, buffers=_BUFFERS),
    Grid(family=Family.OFF_MIDDLE, sides=(Camera.C,), ratios=_DEPTHS, buffers=_BUFFERS),
    Grid(
        family=Family.RECENTERED,
        sides=(Camera.C,),
        ratios=_DEPTHS,
        buffers=_BUFFERS,
        drawings=tuple((pivot, fit, Offset.PLATE) for pivot in Pivot for fit in (None, Fit.SCREEN)),
    ),
    Grid(
        family=Family.THROUGH,
        sides=(Camera.BOTH,),
        ratios=(1e1, 1e2, 1e3, 1e4, 1e5, 1e6),
        buffers=_BUFFERS,
        drawings=tuple((Pivot.APERTURE, None, offset) for offset in Offset),
    ),
)
_NEARS = tuple(float(near) for near in np.geomspace(1e-1, 1e-8, 15))

FULL: Study = (_NEARS, (_FIRST, *_OTHERS))
QUICK: Study = (
    _NEARS[::2],
    (
        replace(_FIRST, ratios=(1.5, 100.0), buffers=(*_BUFFERS[:2], _BUFFERS[3]), resolutions=(128,)),
        *(replace(grid, ratios=grid.ratios[2:3], buffers=_BUFFERS[::3]) for grid in _OTHERS),
    ),
)


class Suitability(StrEnum):
    """Whether one setting is enough, and if it is not, why."""

    ENOUGH = "enough"
    BENT = "bent"
    STARVED = "starved"
    BOTH = "both"


def suitability(row: Row) -> Suitability:
    """Judge one cell by what was measured.

    It is bent where displacement exceeds `TOLERANCE_PX`: that of what was drawn, as measured, or that of what
    should have been drawn, in closed form, for what is bent out of the film or behind something else is not
    drawn. What the near plane clips, without an offset, counts as displaced. It is starved of depth where
    more than `MAX_DEPTH_WRONG` of the pixels show a wrong surface because of it, or where sheets
    `ASKED_SEPARATION` apart at the far end are not ordered.
    """
    # A picture in which nothing is left to be displaced has lost everything to depth.
    bent = row.displacement_p99 is not None and row.displacement_p99 > TOLERANCE_PX
    starved = row.depth_fraction > MAX_DEPTH_WRONG or row.misordered > MAX_MISORDERED_FRACTION
    return _named(bent or _should_be_bent(row), starved)


def predicted_suitability(row: Row) -> Suitability:
    """Judge one cell by the closed forms alone: displacement, and the smallest ordered separation."""
    return _named(_should_be_bent(row), row.predicted_separation > ASKED_SEPARATION)


def _should_be_bent(row: Row) -> bool:
    """Return whether over 1 % of what the truth shows is displaced too far or clipped, in closed form."""
    displaced = row.predicted_p99 is not None and row.predicted_p99 > TOLERANCE_PX
    # The nearest |z| of a row is that of its nearest hundredth.
    return displaced or (row.offset is Offset.NONE and row.nearest < row.near)


def _named(bent: bool, starved: bool) -> Suitability:
    if bent:
        return Suitability.BOTH if starved else Suitability.BENT
    return Suitability.STARVED if starved else Suitability.ENOUGH


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scene, an image and a depth buffer: what a person has before choosing near and slabs."""

    family: Family
    side: Camera
    ratio: float
    resolution: int
    depth: DepthFormat
    mapping: DepthMapping
    pivot: Pivot
    fit: Fit | None
    offset: Offset

    @classmethod
    def of(cls, row: Cell) -> Case:
        """Return the case that a cell belongs to."""
        return cls(**{one.name: getattr(row, one.name) for one in fields(cls)})

    @property
    def buffer(self) -> DepthBuffer:
        """Format and mapping."""
        return self.depth, self.mapping


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What is enough in a case.

    `nears` are the offsets with which one pair of frusta is enough, largest first. `slabs` are the heights of
    the fewest slabs that were enough where no offset is; None where no number of slabs that was tried was.
    """

    case: Case
    nears: tuple[float, ...]
    slabs: tuple[float, ...] | None

    @property
    def one_pair(self) -> bool:
        """Whether one pair of frusta is enough."""
        return bool(self.nears)


def outcomes(rows: Iterable[Row]) -> dict[Case, Outcome]:
    """Return what is enough in each case, in the order in which cases first appear."""
    grouped: dict[Case, list[Row]] = {}
    for row in rows:
        grouped.setdefault(Case.of(row), []).append(row)
    found = {}
    for case, own in grouped.items():
        good = [row for row in own if suitability(row) is Suitability.ENOUGH]
        nears = tuple(sorted((row.near for row in good if not row.slabs), reverse=True))
        slabs = min((row.slabs for row in good if row.slabs), key=len, default=None)
        found[case] = Outcome(case=case, nears=nears, slabs=slabs)
    return found


def straight_nears(rows: Iterable[Row]) -> set[float]:
    """Return the nears of some rows at which no picture is bent; no depth buffer moves the picture."""
    rows = list(rows)
    bent = {row.near for row in rows if suitability(row) in {Suitability.BENT, Suitability.BOTH}}
    return {row.near for row in rows} - bent
