"""The place of each pixel follows from its number, whatever the width of the film is."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from xfrustum.compare.metrics.pixel_findings import _Film
from xfrustum.reference.devices.arithmetic import NUMPY
from xfrustum.reference.lines.lines import Pencil


@given(st.integers(1, 20_000), st.integers(0, 20_000))
def test_a_pixel_is_drawn_at_its_own_column_and_row(width: int, row: int) -> None:
    pencil = Pencil(
        center=(0.0, 0.0, 0.0),
        shear=(0.0, 0.0),
        half_extent=(0.5, 0.5),
        resolution=(width, row + 1),
        s_range=(-1.0, 1.0),
    )
    columns = np.unique([0, 1 % width, width // 2, width - 1])
    found = _Film.of(NUMPY, pencil).drawn_at(NUMPY, row * width + columns)
    np.testing.assert_array_equal(found[0], columns)
    np.testing.assert_array_equal(found[1], row)
