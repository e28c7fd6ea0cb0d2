"""The numbers of a guessed renderer, in groups that tend to be wrong together: one table for all their uses.

A new group needs a row here, a field of the same name in `DrawnModel`, what it does to the lines in
`DrawnModel.pencil` and in `xfrustum.compare.diagnosis.claims`, and its words in
`xfrustum.compare.diagnosis.faults`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene

# Half of the tenth of a pixel to which a sampling point is asked for, and half of a tenth of a percent:
# smaller shifts and factors have no name.
SMALLEST_SHIFT_PX, SMALLEST_FACTOR = 0.05, 5e-4

# Distance, as a part of the reach, at which moved apertures and scenes must be seen to move, to have a name.
TOLD_APART_PER_REACH = 0.1


class Kind(Enum):
    """Kind of a number, which decides its unit and how finely it is searched for."""

    PIXELS = auto()  # a length on the film
    FACTOR = auto()  # a ratio about one
    SIZE = auto()  # a ratio of any magnitude
    OFFSET = auto()  # a length of the scene, of either sign
    SCREEN = auto()  # a length on the projection screen, of either sign
    NEAR = auto()  # a length of the scene, not negative, of any magnitude


@dataclass(frozen=True)
class Group:
    """Numbers that tend to be wrong together: a name, the axes that each has a number for, and their kind."""

    name: str
    axes: str
    kind: Kind

    @property
    def faults(self) -> tuple[str, ...]:
        """Names of its numbers as faults."""
        return tuple(f"{self.name}-{axis}" for axis in self.axes) or (self.name,)

    @property
    def field(self) -> str:
        """Name of the field of `DrawnModel`."""
        return self.name.replace("-", "_")


GROUPS = (
    Group("shift", "xy", Kind.PIXELS),
    Group("fov", "xy", Kind.FACTOR),
    Group("pitch", "xy", Kind.FACTOR),
    Group("near", "", Kind.NEAR),
    Group("aperture-offset", "xy", Kind.OFFSET),
    Group("scene-offset", "xyz", Kind.OFFSET),
    Group("scene-scale", "", Kind.SIZE),
    Group("screen-center", "xy", Kind.SCREEN),
    Group("screen-height", "", Kind.SIZE),
)
"""All groups, in the order of `DrawnModel.parameters`."""

SCREEN_GROUPS = ("screen-center", "screen-height")  # They mean something for recentered frusta alone.
CAMERA_GROUPS = ("shift", "fov", "near")  # One camera may have them off nominal alone.
FAULT_NAMES = tuple(fault for group in GROUPS for fault in group.faults)
KINDS = tuple(group.kind for group in GROUPS for _ in group.faults)

PREFERENCE = (
    *("shift", "screen-center", "fov", "screen-height", "near"),
    *("scene-offset", "aperture-offset", "pitch", "scene-scale"),
)
"""Order in which groups are named that explain images equally well."""


def places(*names: str) -> list[int]:
    """Return the places of the numbers of some groups in `DrawnModel.parameters`."""
    groups = {group.name: group for group in GROUPS}
    return [FAULT_NAMES.index(fault) for name in names for fault in groups[name].faults]


def screen_lengths(scene: Scene) -> Floats:
    """Return how far a shift by a pixel to the right and one down moves the film on the screen, x and y (2,).

    On a screen before the plate the film is mirrored in both axes.
    """
    screen = scene.frustum.screen
    assert screen is not None
    behind = -np.sign(screen.height)
    return np.asarray(np.asarray(screen.size) / scene.frustum.resolution * behind * (1, -1))


@dataclass(frozen=True, eq=False)
class Table:
    """For each number (P,): how finely it is searched for, and between which ends."""

    smallest: Floats  # difference from nominal that is worth a name
    scale: Floats  # a small step for the least squares
    step: Floats  # for derivatives, small against what is to be told apart
    low: Floats
    high: Floats


def table(scene: Scene, values: Floats) -> Table:
    """Return the table of a scene's numbers at some values (P,)."""
    frustum, reach, inf = scene.frustum, scene.frustum.longest_reach, np.inf
    if frustum.screen is None:
        assert frustum.fov is not None
        width, on_screen = 2 * math.tan(frustum.fov[0] / 2), 1.0
    else:
        width = frustum.screen.size[0] / abs(frustum.screen.height)
        on_screen = frustum.screen.size[0] / frustum.resolution[0]
    px = TOLD_APART_PER_REACH * reach * width / frustum.resolution[0]

    def row(kind: Kind, value: float) -> tuple[float, ...]:
        near_scale, near_step = max(0.03 * value, 1e-6 * reach), max(1e-4 * value, 1e-9 * reach)
        return {
            Kind.PIXELS: (SMALLEST_SHIFT_PX, 0.1, 1e-4, -inf, inf),
            Kind.FACTOR: (SMALLEST_FACTOR, 1e-3, 1e-6, 0.01, inf),
            Kind.SIZE: (SMALLEST_FACTOR, 0.03 * value, 1e-6 * value, 1e-6, 1e6),
            Kind.OFFSET: (SMALLEST_SHIFT_PX * px, 1e-2 * reach, 1e-4 * px, -inf, inf),
            Kind.SCREEN: (SMALLEST_SHIFT_PX * on_screen, 0.1 * on_screen, 1e-4 * on_screen, -inf, inf),
            Kind.NEAR: (0.0, near_scale, near_step, 0.0, 0.9 * reach),
        }[kind]

    return Table(*np.array([row(kind, value) for kind, value in zip(KINDS, values.tolist(), strict=True)]).T)


def smallest_named(scene: Scene) -> Floats:
    """Return by how much each number (P,) must be off nominal to be worth a name."""
    return table(scene, np.ones(len(KINDS))).smallest
