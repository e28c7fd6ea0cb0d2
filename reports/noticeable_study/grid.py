"""What the study of viewers asks: scenes, nears, depth buffers, pitches, distances, and what is replayed."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import TypeVar

import numpy as np

from xfrustum.compare.eye.limits import Viewer
from xfrustum.scenes import open_scene
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum, Pivot

T = TypeVar("T")

DepthBuffer = tuple[DepthFormat, DepthMapping]

D16: DepthBuffer = (DepthFormat.D16, DepthMapping.STANDARD)
D24: DepthBuffer = (DepthFormat.D24, DepthMapping.STANDARD)
D32F: DepthBuffer = (DepthFormat.D32F, DepthMapping.REVERSED)


@dataclass(frozen=True, kw_only=True)
class Seat:
    """A plate and a place before it; lengths in millimeters, the unit of the scenes.

    Attributes
    ----------
    scene
        Name of a built-in scene.
    pitch
        Width and height of a hogel, as nearly as the plate's size allows.
    distance
        Distance of the eyes.
    """

    scene: str
    pitch: float
    distance: float

    @property
    def viewer(self) -> Viewer:
        """The viewer."""
        return Viewer(distance=self.distance)

    def opened(self) -> Scene:
        """Return the scene with hogels of this pitch."""
        scene = open_scene(self.scene)
        width, height = scene.plate.size
        hogels = (round(width / self.pitch), round(height / self.pitch))
        return replace(scene, plate=replace(scene.plate, hogels=hogels))


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Settings of the cameras; near is in millimeters."""

    near: float
    depth: DepthFormat
    mapping: DepthMapping
    pivot: Pivot

    @property
    def buffer(self) -> DepthBuffer:
        """Format and mapping."""
        return self.depth, self.mapping

    @property
    def settings(self) -> DoubleFrustum:
        """Settings of the rasterizer."""
        return DoubleFrustum(near=self.near, depth=self.depth, mapping=self.mapping, pivot=self.pivot)


@dataclass(frozen=True, kw_only=True)
class Cell(Seat, Setting):
    """One question: what does a viewer notice of a plate that is drawn with some settings?"""

    @property
    def key(self) -> str:
        """The parameters as text; every double in full."""
        return json.dumps(asdict(self), sort_keys=True)

    @property
    def seat(self) -> Seat:
        """The plate and the place alone."""
        return Seat(scene=self.scene, pitch=self.pitch, distance=self.distance)


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Closed forms are evaluated for every combination; some cells are replayed besides.

    Attributes
    ----------
    scenes
        Names of built-in scenes, each with the pivots that it is drawn with.
    nears, buffers, pitches, distances
        As in `Cell`.
    replayed_nears
        Nears that are replayed with all depth buffers at the middle pitch and distance, whatever closed forms
        say of them; `rows.decisive` names the others that are replayed.
    pixels
        Smallest number of pixels that the films of both eyes have together in replays.

    Raises
    ------
    InputError
        One of them is empty, or what is replayed is not among the cells.
    """

    scenes: tuple[tuple[str, tuple[Pivot, ...]], ...]
    nears: tuple[float, ...]
    buffers: tuple[DepthBuffer, ...]
    pitches: tuple[float, ...]
    distances: tuple[float, ...]
    replayed_nears: tuple[float, ...]
    pixels: int

    def __post_init__(self) -> None:
        some = (self.scenes, self.nears, self.buffers, self.pitches, self.distances, self.replayed_nears)
        if not all(some) or not set(self.replayed_nears) <= set(self.nears):
            raise InputError(
                "nothing to study: give at least one of each parameter, and replay some of the nears"
            )

    def cells(self) -> Iterator[Cell]:
        """Yield every cell, those of one scene together."""
        for name, pivots in self.scenes:
            for pivot, pitch, distance, near, (depth, mapping) in itertools.product(
                pivots, self.pitches, self.distances, self.nears, self.buffers
            ):
                yield Cell(
                    scene=name,
                    pivot=pivot,
                    pitch=pitch,
                    distance=distance,
                    near=near,
                    depth=depth,
                    mapping=mapping,
                )

    def is_replayed_anyway(self, cell: Cell) -> bool:
        """Return whether a cell is replayed whatever closed forms say of it."""
        in_middle = (cell.pitch, cell.distance) == (_middle(self.pitches), _middle(self.distances))
        return in_middle and cell.near in self.replayed_nears

    def columns(self, size: tuple[float, float]) -> int:
        """Return the columns of an eye's film before a plate of some size, as few as give `pixels`."""
        width, height = size
        fewest = max(1, math.isqrt(round(self.pixels / 2 * width / height)) - 1)
        return next(
            columns
            for columns in itertools.count(fewest)
            if 2 * columns * max(1, round(columns * height / width)) >= self.pixels
        )


def _middle(values: tuple[T, ...]) -> T:
    return values[len(values) // 2]


BOTH = (Pivot.APERTURE, Pivot.CAMERA)

NEARS = tuple(float(f"{near:.3g}") for near in np.geomspace(10.0, 1e-3, 9))
"""Nears from 10 mm down to 1 micrometer, half a decade apart."""

PIXELS = 4742
"""Number of pixels of which one may be wrong by depth without doubt: the exact bound of Clopper and Pearson
at 95 % is then no more than `tolerances.MAX_DEPTH_WRONG`, 0.1 %. Where none is wrong, 2,995 would do."""

FULL = Grid(
    scenes=(
        ("car", (Pivot.APERTURE,)),
        ("asymmetric", (Pivot.APERTURE,)),
        ("car-recentered", BOTH),
        ("car-transfer", BOTH),
    ),
    nears=NEARS,
    buffers=(D16, D24, D32F),
    pitches=(0.25, 0.5, 1.0),
    distances=(300.0, 600.0, 1200.0),
    replayed_nears=(NEARS[1], NEARS[3], NEARS[5]),
    pixels=PIXELS,
)

QUICK = replace(
    FULL,
    scenes=FULL.scenes[1:2],
    nears=NEARS[1:6:2],
    pitches=(1.0,),
    distances=(600.0,),
    buffers=(D16, D32F),
    pixels=384,
)
