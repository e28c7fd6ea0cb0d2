"""Closed form of the pixels that show what belongs outside the film, from what the truth shows at its border.

A point on the border of the film that is drawn further in by d pixels leaves the d pixels between to points
from beyond the border. A pixel counts from its center on: of d pixels, those are floor(d + 1/2).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from xfrustum.compare.prediction.chain import with_named_fit
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
        columns, rows = np.arange(width), np.arange(height) * width
        # Left and right, top and bottom: pixels, the axis of displacement, and its outward sign.
        sides = ((rows, 0, -1), (rows + width - 1, 0, 1), (columns, 1, -1), (columns + rows[-1], 1, 1))
        self._frustum = frustum
        # All sides are displaced at once: small arrays cost calls alone.
        self._points = points.at(np.concatenate([pixels for pixels, _, _ in sides]))
        ends = np.cumsum([0, *(len(pixels) for pixels, _, _ in sides)]).tolist()
        self._sides = [slice(*both) for both in pairwise(ends)]
        axes, signs = np.repeat([(axis, sign) for _, axis, sign in sides], np.diff(ends), axis=0).T
        # Place of each point's displacement along its axis among those of all points and both axes.
        self._inward, self._signs = 2 * np.arange(len(axes)) + axes, signs.astype(np.float64)
        self._pixels = (height, width)
        self._fractions: dict[DoubleFrustum, float] = {}

    def charged_fractions(self, chain: Sequence[DoubleFrustum]) -> tuple[float, ...]:
        """Return the share of all pixels from outside the film that each link of a chain is charged with.

        Parameters
        ----------
        chain
            Settings, as they are changed link by link: pixels are charged to the link from which on they
            show points from outside.
        """
        first, *others = dict.fromkeys(chain)
        if not others:
            # Links that change no setting are charged with nothing.
            return (self.fraction(first), *[0.0] * (len(chain) - 1))
        return self._charged_fractions(chain)

    def fraction(self, settings: DoubleFrustum) -> float:
        """Return the share of all pixels that show points from outside the film."""
        settings = with_named_fit(settings, self._frustum)
        if settings not in self._fractions:
            self._fractions[settings] = self._charged_fractions((settings,))[0]
        return self._fractions[settings]

    def _charged_fractions(self, chain: Sequence[DoubleFrustum]) -> tuple[float, ...]:
        # Links that change no setting are displaced once.
        shown = {one: self._shown(one) for one in dict.fromkeys(chain)}
        to_the_end = np.minimum.accumulate(np.stack([shown[one] for one in reversed(chain)]), axis=0)[::-1]
        left, right, top, bottom = (to_the_end[:, side] for side in self._sides)
        height, width = self._pixels
        across = np.minimum(left + right, width).sum(axis=1) / (height * width)
        down = np.minimum(top + bottom, height).sum(axis=1) / (height * width)
        # Both at once only in corners: taken as independent.
        together = 1 - (1 - across) * (1 - down)
        return tuple(np.diff(together, prepend=0.0).tolist())

    def _shown(self, settings: DoubleFrustum) -> Floats:
        """Return how many pixels in from the border show what lies beyond it, at each point of all sides."""
        moved = displacements(self._points, self._frustum, settings)
        # What is not known, as no camera draws it, shows nothing.
        return np.asarray(np.floor(np.fmax(moved.ravel().take(self._inward) * self._signs, 0.0) + 0.5))
