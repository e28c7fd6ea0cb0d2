"""Channels are packed without loss: every bit comes back, also of what is no number."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from xfrustum.reports.inspection.packing import packed, unpacked

SIZE = (7, 5)
KINDS = st.sampled_from(["float32", "uint32", "uint8"])
BITS = {"float32": np.uint32, "uint32": np.uint32, "uint8": np.uint8}


@st.composite
def channels(draw: st.DrawFn) -> tuple[list[str], list[NDArray[Any]]]:
    kinds = draw(st.lists(KINDS, min_size=1, max_size=4))
    # Any bits at all are a float32, NaN of every kind among them.
    bits = [draw(arrays(BITS[kind], SIZE[::-1])) for kind in kinds]
    return kinds, [values.view(kind) for kind, values in zip(kinds, bits, strict=True)]


@settings(max_examples=25)
@given(channels())
def test_every_bit_comes_back(some: tuple[list[str], list[NDArray[Any]]]) -> None:
    kinds, values = some
    back = unpacked(packed(values), kinds, SIZE)
    assert [one.dtype for one in back] == kinds
    assert [one.tobytes() for one in back] == [one.tobytes() for one in values]


def test_views_that_are_not_contiguous_are_packed_as_they_are_seen() -> None:
    points = np.arange(5 * 7 * 3, dtype=np.float32).reshape(5, 7, 3)
    (back,) = unpacked(packed([points[..., 1]]), ["float32"], SIZE)
    np.testing.assert_array_equal(back, points[..., 1])


def test_doubles_are_refused_instead_of_rounded() -> None:
    with pytest.raises(TypeError, match="float64"):
        packed([np.zeros((5, 7))])


def test_a_stream_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="7 x 5"):
        unpacked(zlib.compress(bytes(36)), ["uint8"], SIZE)


def test_points_of_a_surface_take_less_room_than_by_deflate_alone() -> None:
    """The filter is worth its code: neighbors share their upper bits."""
    v, u = np.mgrid[0:256, 0:256] / 256
    height = (40 + 3 * u + np.sin(5 * v)).astype(np.float32)
    assert len(packed([height])) < 0.7 * len(zlib.compress(height.tobytes(), 6))
