"""Closed forms of the error, from the truth's geometry alone (design, section 3)."""

from __future__ import annotations

import numpy as np

from xfrustum.compare.displacement import Spread
from xfrustum.compare.film import pixel_centers, shows_point_on_film
from xfrustum.scenes.hogel_image import HogelImage


def displacement(truth: HogelImage, near: float) -> Spread | None:
    """Return the spread of near-plane displacement over the surfaces that the truth shows.

    A surface point that belongs at film coordinate u is drawn at u |z| / (|z| + n): it moves by
    u n / (|z| + n) toward the middle of the film (pivot aperture, fit angle; paper, section 4).
    """
    shown = shows_point_on_film(truth)
    height = np.abs(truth.height[shown].astype(np.float64))
    width, rows = truth.camera.resolution
    from_middle = pixel_centers(truth.camera)[shown] - [(width - 1) / 2, (rows - 1) / 2]
    return Spread.of(np.hypot(from_middle[:, 0], from_middle[:, 1]) * (near / (height + near)))
