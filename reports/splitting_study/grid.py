"""What the study of splitting measures: which cells, in which order."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from enum import StrEnum

import numpy as np

from xfrustum.scenes.errors import InputError
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

DepthBuffer = tuple[DepthFormat, DepthMapping]

BUFFERS: tuple[DepthBuffer, ...] = tuple(
    (depth, mapping) for depth in DepthFormat for mapping in DepthMapping
)
SIDES = (Camera.C, Camera.C_STAR)


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


def _nears(step: int = 1) -> tuple[float, ...]:
    return tuple(float(near) for near in np.geomspace(1e-1, 1e-8, 15)[::step])


@dataclass(frozen=True, kw_only=True)
class Cameras:
    """What draws; lengths are shares of the reach.

    Attributes
    ----------
    side
        The one camera that has something to see, or `BOTH`.
    near, slabs, depth, mapping, pivot, fit, offset
        As in `DoubleFrustum`.
    """

    side: Camera
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


@dataclass(frozen=True, kw_only=True)
class Picture:
    """What is seen: a scene through one aperture.

    Attributes
    ----------
    family
        Kind of scene.
    side
        Side of the plate on which there is content, as in `Cameras`.
    ratio
        Depth of the scene: farthest to nearest |z| of its surfaces. In the family `THROUGH` it is the reach
        over the aperture's distance from where the surface crosses the plate.
    resolution
        W = H in pixels.
    refined
        Number of times that every triangle was split in four.
    """

    side: Camera
    ratio: float
    resolution: int
    family: Family = Family.ONE_SIDE
    refined: int = 0

    @property
    def picture(self) -> Picture:
        """The picture alone, without what draws it."""
        return Picture(
            side=self.side,
            ratio=self.ratio,
            resolution=self.resolution,
            family=self.family,
            refined=self.refined,
        )


@dataclass(frozen=True, kw_only=True)
class Setting(Picture, Cameras):
    """What is varied from picture to picture."""


class Question(Cameras):
    """Cameras that are asked to draw something."""

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

    @property
    def key(self) -> str:
        """The parameters as text; every double in full."""
        return json.dumps(asdict(self), sort_keys=True)


@dataclass(frozen=True, kw_only=True)
class Cell(Setting, Question):
    """One picture of the study."""


@dataclass(frozen=True, kw_only=True)
class SheetCell(Question):
    """Pairs of sheets at the far end, of several separations."""


@dataclass(frozen=True, kw_only=True)
class FamilyGrid:
    """Every combination of these, with all nears of a `Grid`, is one cell of one family.

    Attributes
    ----------
    family, side
        As in `Picture`.
    ratios, resolutions, buffers
        As in `Grid`.
    drawn
        Pivots, fits and offsets that are drawn together, each as in `DoubleFrustum`.
    """

    family: Family
    side: Camera
    ratios: tuple[float, ...]
    buffers: tuple[DepthBuffer, ...]
    resolutions: tuple[int, ...] = (256,)
    drawn: tuple[tuple[Pivot, Fit | None, Offset], ...] = ((Pivot.APERTURE, None, Offset.PLATE),)

    def cells(self, nears: tuple[float, ...], refined: int) -> Iterator[Cell]:
        """Yield every cell, those of one truth together, of one drawing, and of one near among them."""
        for ratio in self.ratios:
            for resolution in self.resolutions:
                for pivot, fit, offset in self.drawn:
                    for near in nears:
                        for depth, mapping in self.buffers:
                            yield Cell(
                                family=self.family,
                                side=self.side,
                                ratio=ratio,
                                resolution=resolution,
                                near=near,
                                depth=depth,
                                mapping=mapping,
                                pivot=pivot,
                                fit=fit,
                                offset=offset,
                                refined=refined,
                            )


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Every combination of these is one cell of the family `ONE_SIDE`; other families follow.

    Attributes
    ----------
    nears
        Offsets as shares of the reach, from the largest down.
    buffers
        Depth formats with mappings. Exact depth is drawn in any case; only what is listed is kept.
    resolutions, ratios, sides, refined
        As in `Cell`.
    families
        The other families, which share `nears` and `refined`.

    Raises
    ------
    InputError
        One of them, `families` apart, is empty.
    """

    nears: tuple[float, ...] = _nears()
    buffers: tuple[DepthBuffer, ...] = BUFFERS
    resolutions: tuple[int, ...] = (128, 256, 512)
    ratios: tuple[float, ...] = (1.5, 10.0, 100.0, 1000.0)
    sides: tuple[Camera, ...] = SIDES
    refined: int = 0
    families: tuple[FamilyGrid, ...] = ()

    def __post_init__(self) -> None:
        if not (self.nears and self.buffers and self.resolutions and self.ratios and self.sides):
            raise InputError("nothing to study: give at least one of each parameter")

    def cells(self) -> Iterator[Cell]:
        """Yield every cell, those of one truth together and of one near together among them.

        Within a side, resolutions run fastest: work mixes evenly.
        """
        own = [
            FamilyGrid(
                family=Family.ONE_SIDE,
                side=side,
                ratios=self.ratios,
                resolutions=self.resolutions,
                buffers=self.buffers,
            )
            for side in self.sides
        ]
        for family in (*own, *self.families):
            yield from family.cells(self.nears, self.refined)


_HYPERBOLIC: tuple[DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.REVERSED),
    (DepthFormat.D32F, DepthMapping.REVERSED),
)
FAMILY_BUFFERS: tuple[DepthBuffer, ...] = (*_HYPERBOLIC, (DepthFormat.D24, DepthMapping.LOGARITHMIC))
"""Depth buffers of the other families: those that devices store without a fragment's help, and one that a
fragment writes. Depth is that of the first family, for the same |z| and near."""

_DEPTHS = (1.5, 10.0, 100.0, 1000.0)

FAMILIES = (
    FamilyGrid(family=Family.BOTH_SIDES, side=Camera.BOTH, ratios=_DEPTHS, buffers=FAMILY_BUFFERS),
    FamilyGrid(family=Family.IN_MIDDLE, side=Camera.C, ratios=_DEPTHS, buffers=FAMILY_BUFFERS),
    FamilyGrid(family=Family.OFF_MIDDLE, side=Camera.C, ratios=_DEPTHS, buffers=FAMILY_BUFFERS),
    FamilyGrid(
        family=Family.RECENTERED,
        side=Camera.C,
        ratios=_DEPTHS,
        buffers=FAMILY_BUFFERS,
        drawn=tuple((pivot, fit, Offset.PLATE) for pivot in Pivot for fit in (None, Fit.SCREEN)),
    ),
    FamilyGrid(
        family=Family.THROUGH,
        side=Camera.BOTH,
        ratios=(1e1, 1e2, 1e3, 1e4, 1e5, 1e6),
        buffers=FAMILY_BUFFERS,
        drawn=tuple((Pivot.APERTURE, None, offset) for offset in Offset),
    ),
)

FULL = Grid(families=FAMILIES)
QUICK = replace(
    FULL,
    nears=_nears(2),
    buffers=(
        (DepthFormat.D16, DepthMapping.STANDARD),
        (DepthFormat.D24, DepthMapping.STANDARD),
        (DepthFormat.D32F, DepthMapping.REVERSED),
    ),
    resolutions=(128,),
    ratios=(1.5, 100.0),
    families=tuple(
        replace(family, ratios=family.ratios[2:3], buffers=family.buffers[::3]) for family in FAMILIES
    ),
)
