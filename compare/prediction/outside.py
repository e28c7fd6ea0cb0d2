"""Closed form of the pixels that show what belongs outside the film, from what the truth shows at its border.

A point on the border of the film that is drawn further in by d pixels leaves the d pixels between to points
from beyond the border. A pixel counts from its center on: of d pixels, those are floor(d + 1/2).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

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
    points
        Surface points of the true image, where they are known already.
    """

    def __init__(self, truth: HogelImage, frustum: Frustum, points: TruePoints | None = None) -> None:
        points = points or TruePoints.of(truth)
        height, width = points.height.shape
        index = np.arange(height * width).reshape(height, width)
        # Left and right, top and bottom: pixels, the axis of displacement, and its outward sign.
        sides = ((index[:, 0], 0, -1), (index[:, -1], 0, 1), (index[0], 1, -1), (index[-1], 1, 1))
        self._frustum = frustum
        # All sides are displaced at once: small arrays cost calls alone.
        self._points = points.at(np.concatenate([pixels for pixels, _, _ in sides]))
        ends = np.cumsum([0, *(len(pixels) for pixels, _, _ in sides)]).tolist()
        self._sides = [
            (slice(*both), axis, sign) for both, (_, axis, sign) in zip(pairwise(ends), sides, strict=True)
        ]
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
        shown = self._shown(chain)
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

    def _shown(self, chain: Sequence[DoubleFrustum]) -> list[Floats]:
        # Links that change no setting are displaced once.
        moved = {one: displacements(self._points, self._frustum, one) for one in dict.fromkeys(chain)}
        found = []
        for side, axis, sign in self._sides:
            inward = {one: field[side, axis] * sign for one, field in moved.items()}
            pixels = {
                one: np.floor(np.maximum(np.nan_to_num(by, nan=0.0), 0.0) + 0.5) for one, by in inward.items()
            }
            found.append(np.stack([pixels[one] for one in chain]))
        return found
