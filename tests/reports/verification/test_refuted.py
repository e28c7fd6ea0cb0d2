"""Faults are named where the corrected hogels pass; hogels that cannot be judged refute none."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from xfrustum.compare.judging.verdict import Check, Limits
from xfrustum.compare.renderer_model.drawn_model import RendererModel

PASS, FAIL, BLIND = (True, True), (True, False), (True, None)


@pytest.mark.parametrize(
    ("before", "after", "mended"),
    [
        (FAIL, PASS, True),
        (FAIL, FAIL, False),
        (FAIL, BLIND, False),  # blinded by the correction: nothing says that it is right
        (BLIND, BLIND, True),
        (BLIND, PASS, True),
        (BLIND, FAIL, False),
    ],
)
def test_hogels_that_cannot_be_judged_refute_no_fault(
    before: Any, after: Any, mended: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def checks(_: Limits, figures: Any, excused: int = 0) -> tuple[Check, ...]:
        return tuple(
            Check(figure="", value=None, limit=1.0, unit="px", held=held) for held in figures.kept
        )

    monkeypatch.setattr(Limits, "checks", checks)
    found, corrected = (SimpleNamespace(kept=kept, rounded=0) for kept in (before, after))
    assert Limits().mends(found, corrected, RendererModel()) is mended  # type: ignore[arg-type]
