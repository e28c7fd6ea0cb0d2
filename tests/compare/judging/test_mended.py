"""A correction counts if the corrected hogel passes; hogels without a verdict refute no defect."""

from types import SimpleNamespace
from typing import Any

import pytest

from xfrustum.compare.judging.verdict import Check, Limits
from xfrustum.compare.renderer_model.drawn_model import RendererModel

PASS, FAIL, BLIND = (True, True), (True, False), (True, None)
"""Two limits: kept, exceeded, or None where no verdict is possible."""


@pytest.mark.parametrize(
    ("before", "after", "mended"),
    [
        (FAIL, PASS, True),
        (FAIL, FAIL, False),
        (FAIL, BLIND, False),  # blinded by the correction, which proves nothing
        (BLIND, BLIND, True),
        (BLIND, PASS, True),
        (BLIND, FAIL, False),
    ],
)
def test_hogels_that_cannot_be_judged_refute_no_defect(
    before: Any, after: Any, mended: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def checks(_: Limits, figures: Any, excused: int = 0) -> tuple[Check, ...]:
        return tuple(
            Check(figure="", value=None, limit=1.0, unit="px", held=held) for held in figures.kept
        )

    monkeypatch.setattr(Limits, "checks", checks)
    as_found: Any = SimpleNamespace(kept=before, rounded=0)
    corrected: Any = SimpleNamespace(kept=after, rounded=0)
    assert Limits().mends(as_found, corrected, RendererModel()) is mended
