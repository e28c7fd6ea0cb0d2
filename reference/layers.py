"""Layers: what single cameras show, and how they overlay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.reference.certify.certify import FirstSurfaces
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Bytes, Floats, Indices, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """What one camera shows in some rows of an image, or several cameras overlaid.

    Attributes
    ----------
    triangle
        (rows, W) int32, `NOTHING` where it shows none.
    position
        (rows, W, 3) surface points in scene units, NaN where it shows none.
    certainty
        (rows, W) uint8 `Certainty`.
    directions
        (rows, W, 3) directions of the lines along which it sees.
    companions
        (N, 3) row of the image, column and triangle number of all that share a tie.
    first_row
        Row of the image that is the layer's first.
    """

    triangle: Numbers
    position: Floats
    certainty: Bytes
    directions: Floats
    companions: Indices
    first_row: int

    @classmethod
    def of(
        cls, pencil: Pencil, decided: FirstSurfaces, rows: range, directions: Floats | None = None
    ) -> Layer:
        """Return what a pencil's camera shows.

        Parameters
        ----------
        pencil, decided, rows
            Lines of the camera, and the surfaces that are first along them in some rows of the image.
        directions
            Directions of the pencil's lines in these rows, where they are at hand.
        """
        if directions is None:
            directions = pencil.directions(slice(rows.start, rows.stop))
        return cls(
            triangle=decided.triangle,
            position=np.asarray(pencil.center) + decided.s[..., None] * directions,
            certainty=decided.certainty,
            directions=directions,
            companions=decided.companions,
            first_row=rows.start,
        )


def overlaid(layers: Sequence[Layer]) -> Layer:
    """Return layers of the same rows as one, the last of them on top."""
    below, *others = layers
    for upper in others:
        covers = upper.triangle != NOTHING
        directions = below.directions
        if upper.directions is not directions:
            directions = np.where(covers[..., None], upper.directions, directions)
        # Ties of what is now covered are nobody's companions any more.
        row, column, _ = below.companions.T
        visible = below.companions[~covers[row - below.first_row, column]]
        below = Layer(
            triangle=np.where(covers, upper.triangle, below.triangle),
            position=np.where(covers[..., None], upper.position, below.position),
            # Where a layer shows nothing, what is seen rests on both decisions.
            certainty=np.where(covers, upper.certainty, np.maximum(below.certainty, upper.certainty)),
            directions=directions,
            companions=np.concatenate((visible, upper.companions)),
            first_row=below.first_row,
        )
    return below
