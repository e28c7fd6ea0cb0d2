"""Guesses that explain nothing are no help, and are not printed; the JSON object has them all."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.reports.verification.synthetic import verification
from xfrustum.compare.diagnosis.diagnosis import doubtful
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.reports.verification.files import render_page, table


@pytest.mark.parametrize(("explains", "told"), [(0.0, False), (0.004, False), (0.3, True)])
def test_a_guess_is_told_where_it_explains_anything(explains: float, told: bool) -> None:
    found = verification({(0, 0): 900, (1, 0): 0})
    guess = doubtful(replace(Fault(fault="shift-x", value=1.5, unit="px", words="moved"), explains=explains))
    found = replace(found, diagnosis=replace(found.diagnosis, does_not_explain=(guess,)))
    assert "no known fault explains what is wrong" in table(found)
    assert ("moved: would explain only" in table(found)) is told
    assert ("moved: would explain only" in render_page(found)) is told
    assert [one["words"] for one in found.summary()["does_not_explain"]] == [guess.words]
