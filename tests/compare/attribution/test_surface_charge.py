"""Wrong surfaces of a drawn image are charged like those of R0, corrected where depth changes them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from xfrustum.compare.attribution.budget import RIGHT, _surface_charge

DEPTH = 5
"""Number of the link of the depth buffer."""


def test_depth_is_charged_with_what_it_makes_wrong_and_nothing_with_what_it_makes_right() -> None:
    # Both right, both wrong by link 2, wrong by depth alone, and wrong until depth makes it right.
    exact_wrong, wrong = np.array([[False, True, False, True]]), np.array([[False, True, True, False]])
    start = SimpleNamespace(
        depth=DEPTH, exact_wrong=exact_wrong, surface_charge=np.array([[RIGHT, 2, RIGHT, 0]], dtype=np.int8)
    )
    errors = SimpleNamespace(surface=wrong)
    found = _surface_charge(cast(Any, start), cast(Any, None), cast(Any, errors))
    assert found.tolist() == [[RIGHT, 2, DEPTH, RIGHT]]
    assert start.surface_charge.tolist() == [[RIGHT, 2, RIGHT, 0]]
