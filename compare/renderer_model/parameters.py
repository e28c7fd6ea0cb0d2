"""Parameters of a guessed renderer in groups that tend to be wrong together: one table for all their uses.

A new group needs a row here, a field of the same name in `DrawnModel`, what it does to the lines in
`DrawnModel.pencil` and in `xfrustum.compare.diagnosis.containment`, and its words in
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
    """Kind of a parameter, which decides its unit and how finely it is searched for."""

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


@dataclass(frozen=True, kw_only=True)
class Group:
    """Parameters of a guessed renderer that tend to be wrong together, such as the shift along x and y.

    Attributes
    ----------
    name
        Name that users type, such as `scene-offset`; the field of `DrawnModel` has _ in place of -.
    faults
        One fault name per parameter, for when that parameter is off.
    kind
        Kind of its parameters.
    nominal
        Value of each of its parameters where nothing is wrong.
    """

    name: str
    faults: tuple[str, ...]
    kind: Kind
    nominal: float

    @property
    def field(self) -> str:
        """Name of the field of `DrawnModel`."""
        return self.name.replace("-", "_")


GROUPS = (
    Group(name="shift", faults=("shift-x", "shift-y"), kind=Kind.PIXELS, nominal=0.0),
    Group(name="fov", faults=("fov-x", "fov-y"), kind=Kind.FACTOR, nominal=1.0),
    Group(name="pitch", faults=("pitch-x", "pitch-y"), kind=Kind.FACTOR, nominal=1.0),
    Group(name="near", faults=("near",), kind=Kind.NEAR, nominal=0.0),
    Group(
        name="aperture-offset",
        faults=("aperture-offset-x", "aperture-offset-y"),
        kind=Kind.OFFSET,
        nominal=0.0,
    ),
    Group(
        name="scene-offset",
        faults=("scene-offset-x", "scene-offset-y", "scene-offset-z"),
        kind=Kind.OFFSET,
        nominal=0.0,
    ),
    Group(name="scene-scale", faults=("scene-scale",), kind=Kind.SIZE, nominal=1.0),
    Group(name="screen-center", faults=("screen-center-x", "screen-center-y"), kind=Kind.SCREEN, nominal=0.0),
    Group(name="screen-height", faults=("screen-height",), kind=Kind.SIZE, nominal=1.0),
)
"""All groups, in the order of `DrawnModel.parameters`."""

SCREEN_GROUPS = ("screen-center", "screen-height")
"""Groups that mean something for recentered frusta alone."""

GROUP_NAMES = tuple(group.name for group in GROUPS)
FAULT_NAMES = tuple(fault for group in GROUPS for fault in group.faults)
KINDS = tuple(group.kind for group in GROUPS for _ in group.faults)

PREFERENCE = (
    *("shift", "screen-center", "fov", "screen-height", "near"),
    *("scene-offset", "aperture-offset", "pitch", "scene-scale"),
)
"""Order in which groups are named that explain images equally well."""


def places(name: str) -> tuple[int, ...]:
    """Return the places of a group's parameters in `DrawnModel.parameters`."""
    return tuple(FAULT_NAMES.index(fault) for group in GROUPS if group.name == name for fault in group.faults)


def pixel_length(scene: Scene) -> float:
    """Return the width of a pixel at `TOLD_APART_PER_REACH` of the reach, scene units."""
    frustum = scene.frustum
    if frustum.screen is None:
        assert frustum.fov is not None
        half = math.tan(frustum.fov[0] / 2)
    else:
        half = frustum.screen.size[0] / 2 / abs(frustum.screen.height)
    return TOLD_APART_PER_REACH * frustum.longest_reach * 2 * half / frustum.resolution[0]


def screen_pixel_length(scene: Scene) -> float:
    """Return the width of a pixel on the projection screen, scene units; 1 where there is no screen."""
    frustum = scene.frustum
    return 1.0 if frustum.screen is None else frustum.screen.size[0] / frustum.resolution[0]


def screen_lengths(scene: Scene) -> Floats:
    """Return how far a shift by a pixel to the right and one down moves the film on the screen, x and y (2,).

    On a screen before the plate the film is mirrored in both axes.
    """
    screen = scene.frustum.screen
    assert screen is not None
    behind = -np.sign(screen.height)
    return np.asarray(np.asarray(screen.size) / scene.frustum.resolution * behind * (1, -1))


def smallest_named(scene: Scene) -> Floats:
    """Return by how much each number must be off nominal to be worth a name."""
    smallest = {
        Kind.PIXELS: SMALLEST_SHIFT_PX,
        Kind.FACTOR: SMALLEST_FACTOR,
        Kind.SIZE: SMALLEST_FACTOR,
        Kind.OFFSET: SMALLEST_SHIFT_PX * pixel_length(scene),
        Kind.SCREEN: SMALLEST_SHIFT_PX * screen_pixel_length(scene),
        Kind.NEAR: 0.0,
    }
    return np.array([smallest[kind] for kind in KINDS])


def fit_scales(scene: Scene, values: Floats) -> Floats:
    """Return the size of a small step of each number for the least squares."""
    reach = scene.frustum.longest_reach
    steps = {Kind.PIXELS: 0.1, Kind.FACTOR: 1e-3, Kind.OFFSET: 1e-2 * reach}
    steps[Kind.SCREEN] = steps[Kind.PIXELS] * screen_pixel_length(scene)
    relative = {Kind.SIZE: (0.03, 0.0), Kind.NEAR: (0.03, 1e-6 * reach)}
    return np.array([_step(steps, relative, kind, value) for kind, value in zip(KINDS, values, strict=True)])


def derivative_steps(scene: Scene, values: Floats) -> Floats:
    """Return steps for derivatives by each number, small against what is to be told apart."""
    reach = scene.frustum.longest_reach
    steps = {Kind.PIXELS: 1e-4, Kind.FACTOR: 1e-6, Kind.OFFSET: 1e-4 * pixel_length(scene)}
    steps[Kind.SCREEN] = steps[Kind.PIXELS] * screen_pixel_length(scene)
    relative = {Kind.SIZE: (1e-6, 0.0), Kind.NEAR: (1e-4, 1e-9 * reach)}
    return np.array([_step(steps, relative, kind, value) for kind, value in zip(KINDS, values, strict=True)])


def bounds(scene: Scene) -> tuple[Floats, Floats]:
    """Return the least and the largest value of each number."""
    reach = scene.frustum.longest_reach
    limits = {
        Kind.PIXELS: (-np.inf, np.inf),
        Kind.FACTOR: (0.01, np.inf),
        Kind.SIZE: (1e-6, 1e6),
        Kind.OFFSET: (-np.inf, np.inf),
        Kind.SCREEN: (-np.inf, np.inf),
        Kind.NEAR: (0.0, 0.9 * reach),
    }
    low, high = np.array([limits[kind] for kind in KINDS]).T
    return low, high


def _step(
    steps: dict[Kind, float], relative: dict[Kind, tuple[float, float]], kind: Kind, value: float
) -> float:
    if kind in steps:
        return steps[kind]
    share, least = relative[kind]
    return float(max(share * value, least))
