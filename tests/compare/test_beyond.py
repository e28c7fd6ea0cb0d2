"""When a hogel is beyond: by displacement, by what is undefined, by wrong surfaces; in all commands alike."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from xfrustum.compare.beyond import displacement_p99, is_beyond
from xfrustum.compare.judging.judged import MeasuredBy
from xfrustum.compare.metrics.error_maps import Spread
from xfrustum.compare.planning.measure import HogelResult
from xfrustum.compare.planning.views import Requirement
from xfrustum.reports.verification.verdict import Limits
from xfrustum.scenes import Aperture

JUDGED = 1000


def spread(p99: float) -> Spread:
    return Spread(rms=p99, p50=p99, p95=p99, p99=p99, max=p99)


def numbers(p99: float | None, at_plate: int = 0) -> Any:
    """Return what a comparison says of a hogel, without the rest."""
    return SimpleNamespace(
        displacement_px=None if p99 is None else spread(p99), at_plate=at_plate, judged=JUDGED
    )


def test_the_99th_percentile_or_more_than_one_percent_of_wrong_surfaces_or_what_is_undefined() -> None:
    assert not is_beyond(0.5, 0.01, 0.5)
    assert is_beyond(0.501, 0.0, 0.5) and is_beyond(0.0, 0.0101, 0.5)
    for undefined in (None, float("nan"), float("inf")):
        assert is_beyond(undefined, 0.0, 0.5) and is_beyond(undefined, 0.0, float("inf"))
    # A hogel that shows nothing displaces nothing.
    assert displacement_p99(numbers(None)) == 0.0


@pytest.mark.parametrize(
    ("p99", "at_plate", "defined"),
    [(None, 1, False), (0.1, 10, True), (0.1, 11, False), (0.0, JUDGED, False)],
)
def test_displacement_is_undefined_where_the_plate_itself_is_shown(
    p99: float | None, at_plate: int, defined: bool
) -> None:
    """All that is shown, or more of the picture than the percentile leaves out."""
    assert (displacement_p99(numbers(p99, at_plate)) < float("inf")) == defined


@given(st.floats(0, 2), st.integers(0, 30), st.integers(0, 30))
def test_all_commands_say_the_same(p99: float, at_plate: int, wrong: int) -> None:
    """Where everything is shown, the share that `verify` limits is that of all judged pixels."""
    moved, share = displacement_p99(numbers(p99, at_plate)), wrong / JUDGED
    beyond = is_beyond(moved, share, 0.5)
    hogel = HogelResult(
        aperture=Aperture(column=0, row=0, x=0.0, y=0.0),
        displacement_p99_px=moved,
        surface_fraction=share,
        depth_wrong=0.0,
    )
    assert hogel.beyond(0.5) == Requirement().missed_by(hogel) == beyond
    if at_plate * 100 <= JUDGED:
        found: Any = SimpleNamespace(
            shown=JUDGED,
            limited=wrong,
            limited_words="wrong surfaces",
            radiance=None,
            invalid=0,
            displacement_px=spread(p99),
            displacement_by=MeasuredBy.POINTS,
        )
        figures: Any = SimpleNamespace(numbers=found, claimed=JUDGED)
        assert all(check.held for check in Limits().checks(figures)) != beyond
