"""Figures in words."""

from __future__ import annotations

from xfrustum.compare.judging.image_displacement import MeasuredBy
from xfrustum.reports.verification.verdict import PlateNumbers, figures_words


def plate(by: str) -> PlateNumbers:
    return PlateNumbers(
        hogels=2,
        by="triangle",
        shown=10,
        wrong=1,
        fraction=0.1,
        surface=None,
        invalid=0,
        displacement_px={"worst_p99": 0.25},
        displacement_by=by,
        radiance=None,
        causes=None,
    )


def test_words_say_that_displacement_cannot_be_known_in_some_hogels_where_that_is_so() -> None:
    both = " or ".join(sorted({MeasuredBy.NOTHING, MeasuredBy.POINTS}))
    words = "displacement (p99 of the worst hogel) 0.25 px by surface points"
    assert figures_words(plate(MeasuredBy.POINTS)).endswith(words)
    assert figures_words(plate(both)).endswith(f"{words} (in some hogels it cannot be known)")
