"""Closed form of the pixels that show what belongs outside the film, from what the truth shows at its border.

A point on the border of the film that is drawn further in by d pixels leaves the d pixels between to points
from beyond the border. A pixel counts from its center on: of d pixels, those are floor(d + 1/2).
"""

from __future__ import annotations

from collections.abc import Sequence

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
    points
        Surface points of the true image, where they are known already.
    """

    def __init__(self, truth: HogelImage, frustum: Frustum, points: TruePoints | None = None) -> None:
        points = points or TruePoints.of(truth)
        height, width = points.height.shape
        columns, rows = np.arange(width), np.arange(height) * width
        # Left and right, top and bottom: pixels, the axis of displacement, and its outward sign.
        sides = ((rows, 0, -1), (rows + width - 1, 0, 1), (columns, 1, -1), (columns + rows[-1], 1, 1))
        self._frustum, self._shape = frustum, (height, width)
        self._sides = [(points.at(pixels), axis, sign) for pixels, axis, sign in sides]

    def charged_fractions(self, chain: Sequence[DoubleFrustum]) -> tuple[float, ...]:
        """Return the share of all pixels from outside the film that each link of a chain is charged with.

        Parameters
        ----------
        chain
            Settings, as they are changed link by link: pixels are charged to the link from which on they
            show points from outside. Links that change no setting are charged with nothing.
        """
        shown = {one: self._shown(one) for one in dict.fromkeys(chain)}
        height, width = self._shape
        together, to_the_end = [], shown[chain[-1]]
        for settings in reversed(chain):
            to_the_end = [
                np.minimum(one, other) for one, other in zip(to_the_end, shown[settings], strict=True)
            ]
            left, right, top, bottom = to_the_end
            across = np.minimum(left + right, width).sum() / (height * width)
            down = np.minimum(top + bottom, height).sum() / (height * width)
            # Both at once only in corners: taken as independent.
            together.append(1 - (1 - across) * (1 - down))
        return tuple(np.diff(together[::-1], prepend=0.0).tolist())

    def fraction(self, settings: DoubleFrustum) -> float:
        """Return the share of all pixels that show points from outside the film."""
        return self.charged_fractions((with_named_fit(settings, self._frustum),))[0]

    def _shown(self, settings: DoubleFrustum) -> list[Floats]:
        """Return how many pixels in from the border show what lies beyond it, for each side's points."""
        found = []
        for points, axis, sign in self._sides:
            moved = sign * displacements(points, self._frustum, settings)[:, axis]
            # What is not known, as no camera draws it, shows nothing.
            found.append(np.floor(np.fmax(moved, 0.0) + 0.5))
        return found
