"""What is wrong with a renderer, in words with figures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.drawn_model import DrawnModel, Front
from xfrustum.scenes.scene import Scene

SMALLEST_SHIFT_PX = 0.05
"""Shifts that are worth a name: half of the tenth of a pixel to which a sampling point is asked for."""

SMALLEST_FACTOR = 5e-4
"""Likewise of field of view and pitch: half of a tenth of a percent."""

ORIENTATION, ORDER, NEAR, PIVOT, FIT = "orientation", "aperture-order", "near", "pivot", "fit"
SHIFT, FOV, PITCH = ("shift-x", "shift-y"), ("fov-x", "fov-y"), ("pitch-x", "pitch-y")
FRONT_MISSING, FRONT_NEAREST, NOT_OVERLAID, LIGHTS = (
    "front-missing",
    "front-nearest",
    "not-overlaid",
    "lights",
)

CONVENTIONS = ("orientation", "order", "shift", "fov", "pitch", "near")
"""What a renderer's author may declare, so that images are judged by it."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One thing found.

    Attributes
    ----------
    fault
        Its short name.
    value
        A number, or words.
    low, high
        The interval of a number.
    unit
        Of the three.
    words
        One sentence.
    """

    fault: str
    value: float | str
    words: str
    low: float | None = None
    high: float | None = None
    unit: str | None = None

    def summary(self) -> dict[str, Any]:
        """Return it as `verify --json` prints it."""
        return {
            "fault": self.fault,
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "unit": self.unit,
            "words": self.words,
        }


def faults_of(
    scene: Scene, nominal: DrawnModel, found: DrawnModel, low: NDArray[np.float64], high: NDArray[np.float64]
) -> tuple[Fault, ...]:
    """Name what a guess has that the nominal one has not.

    Parameters
    ----------
    scene
        For its units.
    nominal, found
        What should be, and what was found.
    low, high
        (7,) intervals of what was found, in the order of `DrawnModel.parameters`. A number is named
        where its interval leaves out the nominal one, and it is worth a name.
    """
    return (
        *_conventions(nominal, found),
        *_numbers(scene, nominal, found, low, high),
        *_halves(found),
    )


def lights_fault(back: float, front: float) -> Fault | None:
    """Return the fault of a light that is not conjugated, given both halves' correlations with the truth."""
    if not (back > 0 > front):
        return None
    return Fault(
        fault=LIGHTS,
        value=front,
        unit="correlation",
        words=(
            "lights are not conjugated: on the viewer's side bright and dark are exchanged (correlation "
            f"with the truth {front:.2f}, behind the plate {back:.2f}); C* needs L* = -L"
        ),
    )


def _conventions(nominal: DrawnModel, found: DrawnModel) -> Iterator[Fault]:
    if found.orientation != nominal.orientation:
        words = found.orientation.words
        yield Fault(fault=ORIENTATION, value=words, words=f"images are {words}")
    if found.order != nominal.order:
        words = found.order.order_words
        yield Fault(fault=ORDER, value=words, words=f"apertures are in another order: {words}")
    if found.near and found.pivot is not nominal.pivot:
        words = f"the shear is centered in the {found.pivot}, not in the {nominal.pivot}"
        yield Fault(fault=PIVOT, value=str(found.pivot), words=words)
    if found.near and found.fit is not nominal.fit:
        words = f"the film is fitted to the {found.fit}, not to the {nominal.fit}"
        yield Fault(fault=FIT, value=str(found.fit), words=words)


def _numbers(
    scene: Scene, nominal: DrawnModel, found: DrawnModel, low: NDArray[np.float64], high: NDArray[np.float64]
) -> Iterator[Fault]:
    kinds = [(name, "px", SMALLEST_SHIFT_PX) for name in SHIFT]
    kinds += [(name, "ratio", SMALLEST_FACTOR) for name in (*FOV, *PITCH)]
    kinds += [(NEAR, scene.units, 0.0)]
    values = zip(kinds, nominal.parameters, found.parameters, low, high, strict=True)
    for (name, unit, smallest), should, value, least, most in values:
        if abs(value - should) > smallest and not least <= should <= most:
            yield Fault(
                fault=name,
                value=float(value),
                low=float(least) if math.isfinite(least) else None,
                high=float(most) if math.isfinite(most) else None,
                unit=unit,
                words=_number_words(name, scene, float(value), float(should)),
            )


def _number_words(name: str, scene: Scene, value: float, should: float) -> str:
    if name == SHIFT[0]:
        side = "right" if value > 0 else "left"
        return f"pixels are sampled {abs(value):.3f} px to the {side} of their centers (images upright)"
    if name == SHIFT[1]:
        side = "below" if value > 0 else "above"
        return f"pixels are sampled {abs(value):.3f} px {side} their centers (images upright)"
    if name in FOV:
        axis = FOV.index(name)
        text = f"the film is {value:.5g} times as {('wide', 'high')[axis]} as the scene's"
        if scene.frustum.fov is None:
            return text
        angle = scene.frustum.fov[axis]
        drawn = math.degrees(2 * math.atan(math.tan(angle / 2) * value))
        return f"{text}: {drawn:.4g} degrees instead of {math.degrees(angle):.4g}"
    if name in PITCH:
        axis = PITCH.index(name)
        size = scene.plate.size[axis]
        return (
            f"apertures are {value:.5g} times as far apart in {'xy'[axis]}: as on a plate of "
            f"{value * size:.5g} {scene.units} instead of {size:.5g}"
        )
    stated = f", not by {should:.5g}" if should else ", which nobody mentioned"
    return f"both cameras step back by a near offset of {value:.5g} {scene.units}{stated}"


def _halves(found: DrawnModel) -> Iterator[Fault]:
    if found.front is Front.MISSING:
        words = "the half on the viewer's side is missing: only C is drawn"
        yield Fault(fault=FRONT_MISSING, value="missing", words=words)
    if found.front is Front.NEAREST:
        words = "on the viewer's side the surface nearest to the plate wins; C* must keep the farthest"
        yield Fault(fault=FRONT_NEAREST, value="nearest wins", words=words)
    if not found.overlaid:
        words = "C is drawn over C*; the viewer's half must cover the other"
        yield Fault(fault=NOT_OVERLAID, value="back over front", words=words)
