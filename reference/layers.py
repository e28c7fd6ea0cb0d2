"""Layers: what single cameras show, and how they overlay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.reference.certify.certify import FirstSurfaces
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Bytes, Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING


@dataclass(frozen=True, kw_only=True, eq=False)
class NumberedLayer:
    """The triangles that one camera shows in some rows of an image, or several cameras overlaid.

    Attributes
    ----------
    triangle
        (rows, W) int32, `NOTHING` where it shows none.
    certainty
        (rows, W) uint8 `Certainty`.
    companions
        (N, 3) row of the image, column and triangle number of all that share a tie.
    first_row
        Row of the image that is the layer's first.
    """

    triangle: Numbers
    certainty: Bytes
    companions: Indices
    first_row: int

    @classmethod
    def of_decided(cls, decided: FirstSurfaces, rows: range) -> NumberedLayer:
        """Return the triangles that are decided in some rows of the image."""
        return cls(
            triangle=decided.triangle,
            certainty=decided.certainty,
            companions=decided.companions,
            first_row=rows.start,
        )

    @property
    def covers(self) -> Mask:
        """(rows, W) pixels that show a triangle."""
        return np.not_equal(self.triangle, NOTHING)

    def under(self, upper: NumberedLayer) -> NumberedLayer:
        """Return this layer with another one on top of it."""
        covers = upper.covers
        # Ties of what is now covered are nobody's companions any more.
        row, column, _ = self.companions.T
        visible = self.companions[~covers[row - self.first_row, column]]
        return NumberedLayer(
            triangle=np.where(covers, upper.triangle, self.triangle),
            # Where a layer shows nothing, what is seen rests on both decisions.
            certainty=np.where(covers, upper.certainty, np.maximum(self.certainty, upper.certainty)),
            companions=np.concatenate((visible, upper.companions)),
            first_row=self.first_row,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer(NumberedLayer):
    """What one camera shows in some rows of an image, with surface points (rows, W, 3), NaN for none."""

    position: Floats

    @classmethod
    def of(cls, pencil: Pencil, decided: FirstSurfaces, rows: range) -> Layer:
        """Return what a pencil's camera shows."""
        directions = pencil.directions(slice(rows.start, rows.stop))
        return cls(
            **vars(NumberedLayer.of_decided(decided, rows)),
            position=np.asarray(pencil.center) + decided.s[..., None] * directions,
        )


def overlaid(layers: Sequence[Layer]) -> Layer:
    """Return layers of the same rows as one, the last of them on top."""
    below, *others = layers
    for upper in others:
        position = np.where(upper.covers[..., None], upper.position, below.position)
        below = Layer(**vars(below.under(upper)), position=position)
    return below
