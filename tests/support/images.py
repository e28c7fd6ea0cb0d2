"""Bitwise comparison of images, and pixels away from all edges."""

from dataclasses import fields
from typing import Any

import numpy as np

from xfrustum.scenes import HogelImage
from xfrustum.scenes.arrays import Mask


def assert_same(first: Any, other: Any, *names: str) -> None:
    """Assert that some attributes of two images, by default all fields, are bit-identical.

    Second opinions are compared through `overruled`, which reads them.
    """
    every = (
        "overruled" if field.name == "second_opinion" else field.name for field in fields(first)
    )
    for name in names or every:
        a, b = getattr(first, name), getattr(other, name)
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes(), name
        else:
            assert a == b, name


def interior(image: HogelImage) -> Mask:
    """Return the pixels whose eight neighbors show the same triangle; none at the border."""
    height, width = image.triangle.shape
    shifted = [
        image.triangle[r : height - 2 + r, c : width - 2 + c] for r in range(3) for c in range(3)
    ]
    inside = np.zeros(image.triangle.shape, dtype=np.bool_)
    inside[1:-1, 1:-1] = np.all([shifted[4] == other for other in shifted], axis=0)
    return np.asarray(inside & image.covered)
