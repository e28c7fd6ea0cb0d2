"""The apertures that `auto` takes: the middle one, and the worst ones that a scout of the plate has found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from xfrustum.compare.scouting.scout import Look, Scout
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.tolerances import TOLERANCE_PX

MAX_AUTO_APERTURES = 4
"""Largest number of apertures that `auto` takes: the middle one, and the worst one in each of three respects
(the 99th percentile of displacement, the nearest surface, outlines). Each aperture takes a command as long as
the first; more of them, beside the worst, would be as bad for the same reason."""


@dataclass(frozen=True, kw_only=True)
class ChosenAperture:
    """An aperture, and the reason for which it was chosen.

    Attributes
    ----------
    aperture
        The aperture.
    why
        The reason in words.
    """

    aperture: Aperture
    why: str


@dataclass(frozen=True, kw_only=True, eq=False)
class AutoApertures:
    """The apertures that `auto` takes.

    Attributes
    ----------
    scout
        Looks through apertures all over the plate, from which they were chosen.
    chosen
        The apertures with their reasons; at least one, and no more than `MAX_AUTO_APERTURES`. The middle one
        is the first, unless it sees nothing and others do.
    blocked
        Number of scouted apertures in which a surface lies: it fills more than a hundredth of their picture
        at |z| = 0, and no settings draw that. They are chosen only where there are no others.
    """

    scout: Scout
    chosen: tuple[ChosenAperture, ...]
    blocked: int

    @property
    def apertures(self) -> tuple[Aperture, ...]:
        """The apertures alone, in the order of `chosen`."""
        return tuple(one.aperture for one in self.chosen)

    @classmethod
    def of(cls, scout: Scout) -> AutoApertures:
        """Choose apertures from what a scout has seen."""
        seeing = [look for look in scout.looks if math.isfinite(look.nearest)]
        free = [look for look in seeing if math.isfinite(look.pixels_per_near)]
        middle = scout.scene.plate.middle
        reasons: dict[Aperture, list[str]] = {}
        if not seeing or any(look.aperture == middle for look in seeing):
            reasons[middle] = ["the middle of the plate"]
        # Of equally bad ones the first is taken: the middle, so that no other is measured for the same.
        ordered = sorted(free or seeing, key=lambda look: look.aperture != middle)
        for aperture, reason in _worst(ordered, scout.scene.units):
            reasons.setdefault(aperture, []).append(reason)
        nearest = {
            look.aperture: f"nearest visible |z| {look.nearest:.2g} {scout.scene.units}" for look in seeing
        }
        return cls(
            scout=scout,
            chosen=tuple(
                ChosenAperture(
                    aperture=aperture, why="; ".join([*parts, nearest.get(aperture, "nothing seen")])
                )
                for aperture, parts in reasons.items()
            ),
            blocked=len(seeing) - len(free),
        )


def _worst(looks: Sequence[Look], units: str) -> list[tuple[Aperture, str]]:
    """Return the worst aperture in each respect, with the respect in words; none where there are no looks.

    The first of several that are equally bad is the worst.
    """
    if not looks:
        return []
    displaced = max(looks, key=lambda look: look.pixels_per_near)
    nearest = min(looks, key=lambda look: look.nearest)
    outlined = max(looks, key=lambda look: look.outline_widths)
    return [
        (displaced.aperture, f"largest displacement ({_tolerated(displaced, units)})"),
        (nearest.aperture, "surface nearest to the plate"),
        (outlined.aperture, f"longest outlines ({outlined.outline_widths:.2g} widths of the picture)"),
    ]


def _tolerated(look: Look, units: str) -> str:
    """Say from which near on the picture of an aperture is displaced by more than the usual tolerance."""
    if look.pixels_per_near == 0:
        return "none at any near"
    near = f"{TOLERANCE_PX / look.pixels_per_near:.2g}".replace("e-0", "e-")
    return f"over {TOLERANCE_PX:g} px from near {near} {units} on"
