"""The numbers of a guessed renderer, in groups that tend to be wrong together: one table for all their uses.

A new group needs a row here, a field of the same name in `DrawnModel`, what it does to the lines in
`DrawnModel.pencil` and in `xfrustum.compare.diagnosis.claims`, and its words in
`xfrustum.compare.diagnosis.faults`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene

SMALLEST_SHIFT_PX = 0.05
"""Smallest shift that has a name: half of the tenth of a pixel to which a sampling point is asked for."""

SMALLEST_FACTOR = 5e-4
"""Smallest deviation of a factor from one that has a name: half of a tenth of a percent."""

TOLD_APART_PER_REACH = 0.1
"""Distance, as a part of the reach, at which moved apertures and scenes must be seen to move,
to have a name."""


class Kind(StrEnum):
    """Kind of a number, which decides its unit and how finely it is searched for."""

    PIXELS = "pixels"
    """A length on the film."""
    FACTOR = "factor"
    """A ratio about one."""
    SIZE = "size"
    """A ratio of any magnitude."""
    OFFSET = "offset"
    """A length of the scene, of either sign."""
    SCREEN = "screen"
    """A length on the projection screen, of either sign."""
    NEAR = "near"
    """A length of the scene, not negative, of any magnitude."""


@dataclass(frozen=True)
class Group:
    """Numbers that tend to be wrong together: their names as faults, and their value where nothing is wrong.

    The name of a group is what users type; the field of `DrawnModel` has _ in place of -.
    """

    name: str
    faults: tuple[str, ...]
    kind: Kind
    nominal: float

    @property
    def field(self) -> str:
        """Name of the field of `DrawnModel`."""
        return self.name.replace("-", "_")


def _along(name: str, axes: str) -> tuple[str, ...]:
    return tuple(f"{name}-{axis}" for axis in axes)


GROUPS = (
    Group("shift", _along("shift", "xy"), Kind.PIXELS, 0.0),
    Group("fov", _along("fov", "xy"), Kind.FACTOR, 1.0),
    Group("pitch", _along("pitch", "xy"), Kind.FACTOR, 1.0),
    Group("near", ("near",), Kind.NEAR, 0.0),
    Group("aperture-offset", _along("aperture-offset", "xy"), Kind.OFFSET, 0.0),
    Group("scene-offset", _along("scene-offset", "xyz"), Kind.OFFSET, 0.0),
    Group("scene-scale", ("scene-scale",), Kind.SIZE, 1.0),
    Group("screen-center", _along("screen-center", "xy"), Kind.SCREEN, 0.0),
    Group("screen-height", ("screen-height",), Kind.SIZE, 1.0),
)
"""All groups, in the order of `DrawnModel.parameters`."""

SCREEN_GROUPS = ("screen-center", "screen-height")
"""Groups that mean something for recentered frusta alone."""

CAMERA_GROUPS = ("shift", "fov", "near")
"""Groups that one camera may have off nominal alone."""

GROUP_NAMES = tuple(group.name for group in GROUPS)
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """For each number (P,): how finely it is searched for, and between which ends.

    Attributes
    ----------
    smallest
        Difference from nominal that is worth a name.
    scale
        Size of a small step for the least squares.
    step
        Step for derivatives, small against what is to be told apart.
    low, high
        Least and largest value.
    """

    smallest: Floats
    scale: Floats
    step: Floats
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
        return {
            Kind.PIXELS: (SMALLEST_SHIFT_PX, 0.1, 1e-4, -inf, inf),
            Kind.FACTOR: (SMALLEST_FACTOR, 1e-3, 1e-6, 0.01, inf),
            Kind.SIZE: (SMALLEST_FACTOR, 0.03 * value, 1e-6 * value, 1e-6, 1e6),
            Kind.OFFSET: (SMALLEST_SHIFT_PX * px, 1e-2 * reach, 1e-4 * px, -inf, inf),
            Kind.SCREEN: (SMALLEST_SHIFT_PX * on_screen, 0.1 * on_screen, 1e-4 * on_screen, -inf, inf),
            Kind.NEAR: (
                0.0,
                max(0.03 * value, 1e-6 * reach),
                max(1e-4 * value, 1e-9 * reach),
                0.0,
                0.9 * reach,
            ),
        }[kind]

    smallest, scale, step, low, high = np.array(
        [row(kind, value) for kind, value in zip(KINDS, values.tolist(), strict=True)]
    ).T
    return Table(smallest=smallest, scale=scale, step=step, low=low, high=high)


def smallest_named(scene: Scene) -> Floats:
    """Return by how much each number (P,) must be off nominal to be worth a name."""
    return table(scene, np.ones(len(KINDS))).smallest
