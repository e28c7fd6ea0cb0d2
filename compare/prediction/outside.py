"""Closed form of the pixels that show what belongs outside the film, from what the truth shows at its border.

A point on the border of the film that is drawn further in by d pixels leaves the d pixels between to points
from beyond the border. A pixel counts from its center on: of d pixels, those are floor(d + 1/2).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xfrustum.compare.prediction.displacement import TruePoints, displacements
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.frustum import Frustum


class Border:
    """What a true image shows in its outermost rows and columns.

    Parameters
    ----------
    truth
        The true image.
    frustum
        The scene's frustum.
    """

    def __init__(self, truth: HogelImage, frustum: Frustum) -> None:
        points = TruePoints.of(truth)
        height, width = points.height.shape
        index = np.arange(height * width).reshape(height, width)
        self._frustum = frustum
        # Left and right, top and bottom: pixels, the axis of displacement, and its outward sign.
        self._sides = tuple(
            (points.at(pixels), axis, sign)
            for pixels, axis, sign in (
                (index[:, 0], 0, -1),
                (index[:, -1], 0, 1),
                (index[0], 1, -1),
                (index[-1], 1, 1),
            )
        )
        self._pixels = (height, width)

    def charged_fractions(self, chain: Sequence[DoubleFrustum]) -> tuple[float, ...]:
        """Return the share of all pixels from outside the film that each link of a chain is charged with.

        Parameters
        ----------
        chain
            Settings, as they are changed link by link: pixels are charged to the link from which on they
            show points from outside.
        """
        # Rows of (links, pixels of a side): how many pixels in from the border show what lies beyond it.
        shown = [self._shown(side, chain) for side in range(4)]
        to_the_end = [np.minimum.accumulate(side[::-1], axis=0)[::-1] for side in shown]
        height, width = self._pixels
        across = np.minimum(to_the_end[0] + to_the_end[1], width).sum(axis=1) / (height * width)
        down = np.minimum(to_the_end[2] + to_the_end[3], height).sum(axis=1) / (height * width)
        # Both at once only in corners: taken as independent.
        together = 1 - (1 - across) * (1 - down)
        return tuple(np.diff(together, prepend=0.0).tolist())

    def fraction(self, settings: DoubleFrustum) -> float:
        """Return the share of all pixels that show points from outside the film."""
        return self.charged_fractions((settings,))[0]

    def _shown(self, side: int, chain: Sequence[DoubleFrustum]) -> Floats:
        points, axis, sign = self._sides[side]
        moved = [displacements(points, self._frustum, settings)[:, axis] * sign for settings in chain]
        return np.floor(np.maximum(np.nan_to_num(np.stack(moved), nan=0.0), 0.0) + 0.5)
