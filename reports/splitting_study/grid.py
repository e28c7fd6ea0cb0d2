"""What the study of splitting measures: which cells, in which order."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.library.depth_family import REACH
from xfrustum.scenes.plate.double_frustum import Camera, DepthFormat, DepthMapping, DoubleFrustum

DepthBuffer = tuple[DepthFormat, DepthMapping]

BUFFERS: tuple[DepthBuffer, ...] = tuple(
    (depth, mapping) for depth in DepthFormat for mapping in DepthMapping
)
SIDES = (Camera.C, Camera.C_STAR)


def _nears(step: int = 1) -> tuple[float, ...]:
    return tuple(float(near) for near in np.geomspace(1e-1, 1e-8, 15)[::step])


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What is varied from picture to picture; lengths are shares of the reach.

    Attributes
    ----------
    side
        The one camera that has something to see.
    ratio
        Depth of the scene: farthest to nearest |z| of its surfaces.
    resolution
        W = H in pixels.
    near, slabs, depth, mapping
        As in `DoubleFrustum`.
    refined
        Number of times that every triangle was split in four.
    """

    side: Camera
    ratio: float
    resolution: int
    near: float
    depth: DepthFormat
    mapping: DepthMapping
    slabs: tuple[float, ...] = ()
    refined: int = 0

    @property
    def buffer(self) -> DepthBuffer:
        """Format and mapping."""
        return self.depth, self.mapping


@dataclass(frozen=True, kw_only=True)
class Cell(Setting):
    """One picture of the study."""

    @property
    def settings(self) -> DoubleFrustum:
        """Settings of the rasterizer, in scene units."""
        return _settings(self)

    @property
    def key(self) -> str:
        """The parameters as text; every double in full."""
        return json.dumps(asdict(self), sort_keys=True)


@dataclass(frozen=True, kw_only=True)
class SheetCell:
    """Pairs of sheets at the far end, of several separations; lengths are shares of the reach."""

    side: Camera
    near: float
    depth: DepthFormat
    mapping: DepthMapping
    slabs: tuple[float, ...] = ()

    @property
    def settings(self) -> DoubleFrustum:
        """Settings of the rasterizer, in scene units."""
        return _settings(self)

    @property
    def key(self) -> str:
        """The parameters as text; every double in full."""
        return json.dumps(asdict(self), sort_keys=True)


def _settings(cell: Cell | SheetCell) -> DoubleFrustum:
    return DoubleFrustum(
        near=cell.near * REACH,
        depth=cell.depth,
        mapping=cell.mapping,
        camera=cell.side,
        slabs=tuple(cut * REACH for cut in cell.slabs),
    )


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Every combination of these is one cell.

    Attributes
    ----------
    nears
        Offsets as shares of the reach, from the largest down.
    buffers
        Depth formats with mappings. Exact depth is drawn in any case; only what is listed is kept.
    resolutions, ratios, sides, refined
        As in `Cell`.

    Raises
    ------
    InputError
        One of them is empty.
    """

    nears: tuple[float, ...] = _nears()
    buffers: tuple[DepthBuffer, ...] = BUFFERS
    resolutions: tuple[int, ...] = (128, 256, 512)
    ratios: tuple[float, ...] = (1.5, 10.0, 100.0, 1000.0)
    sides: tuple[Camera, ...] = SIDES
    refined: int = 0

    def __post_init__(self) -> None:
        if not (self.nears and self.buffers and self.resolutions and self.ratios and self.sides):
            raise InputError("nothing to study: give at least one of each parameter")

    def pictures(self) -> Iterator[tuple[Camera, float, int]]:
        """Yield side, ratio and resolution of every truth. Resolutions run fastest: work mixes evenly."""
        for side in self.sides:
            for ratio in self.ratios:
                for resolution in self.resolutions:
                    yield side, ratio, resolution

    def cells(self) -> Iterator[Cell]:
        """Yield every cell, those of one truth together and of one near together among them."""
        for side, ratio, resolution in self.pictures():
            for near in self.nears:
                for depth, mapping in self.buffers:
                    yield Cell(
                        side=side,
                        ratio=ratio,
                        resolution=resolution,
                        near=near,
                        depth=depth,
                        mapping=mapping,
                        refined=self.refined,
                    )


FULL = Grid()
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
)
