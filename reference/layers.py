"""Layers: what single cameras show, and how they overlay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from xfrustum.reference.certify.certify import FirstSurfaces
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Bytes, Floats, Indices, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """What one camera shows in all rows of an image, or several cameras overlaid.

    Triangle numbers (H, W), `NOTHING` for none, their `Certainty`, the companions of ties (N, 3) as in
    `FirstSurfaces`, and surface points (H, W, 3) in scene units, NaN for none.
    """

    triangle: Numbers
    certainty: Bytes
    companions: Indices
    position: Floats

    @classmethod
    def of(cls, pencil: Pencil, decided: FirstSurfaces) -> Layer:
        """Return what a pencil's camera shows."""
        return cls(
            triangle=decided.triangle,
            certainty=decided.certainty,
            companions=decided.companions,
            position=np.asarray(pencil.center) + decided.s[..., None] * pencil.directions(),
        )


def overlaid(layers: Sequence[Layer]) -> Layer:
    """Return layers of the same image as one, the last of them on top."""
    below, *others = layers
    for upper in others:
        covers = upper.triangle != NOTHING
        certainty, companions = _overlaid(below, upper, 0)
        below = Layer(
            triangle=np.where(covers, upper.triangle, below.triangle),
            certainty=certainty,
            companions=companions,
            position=np.where(covers[..., None], upper.position, below.position),
        )
    return below


def overlaid_certainty(decided: Sequence[FirstSurfaces], first_row: int) -> tuple[Bytes, Indices]:
    """Return certainty and companions of decisions of the same rows, the last of them on top."""

    def on_top(below: FirstSurfaces, upper: FirstSurfaces) -> FirstSurfaces:
        certainty, companions = _overlaid(below, upper, first_row)
        return replace(below, certainty=certainty, companions=companions)

    found = reduce(on_top, decided)
    return found.certainty, found.companions


def _overlaid(
    below: Layer | FirstSurfaces, upper: Layer | FirstSurfaces, first_row: int
) -> tuple[Bytes, Indices]:
    covers = upper.triangle != NOTHING
    # Ties of what is now covered are nobody's companions any more.
    row, column, _ = below.companions.T
    visible = below.companions[~covers[row - first_row, column]]
    # Where a layer shows nothing, what is seen rests on both decisions.
    certainty = np.where(covers, upper.certainty, np.maximum(below.certainty, upper.certainty))
    return certainty, np.concatenate((visible, upper.companions))
