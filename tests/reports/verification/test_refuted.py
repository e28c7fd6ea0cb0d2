"""A fault that explains one hogel, and makes all hogels together worse when corrected for, is not named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.reports.verification.synthetic import verification
from tests.support.foreign_renderers import Faulty
from xfrustum.compare.diagnosis.evidence import MIN_EXPLAINED_FRACTION
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.reports.verification.files import render_page, table
from xfrustum.reports.verification.verdict import with_correction_tested
from xfrustum.reports.verification.verification import verify
from xfrustum.scenes import open_scene

SPHERE = """
units = "mm"

[plate]
size   = [40.0, 30.0]
hogels = [16, 12]

[frustum]
resolution = [16, 12]
screen = { height = 120.0, center = [0.0, 0.0], size = [80.0, 60.0] }
reach  = [60.0, 60.0]

[[object]]
shape = "sphere"
scale = 12.0
"""

SHIFT = Fault(
    fault="shift-x", value=0.1, unit="px", words="shifted; or near", alternatives=("near",), explains=1.0
)


@pytest.mark.parametrize(("corrected", "named"), [((0, 400), False), ((0, 60), True), ((0, 0), True)])
def test_a_fault_is_named_where_its_correction_makes_no_more_pixels_wrong(
    corrected: tuple[int, int], named: bool
) -> None:
    found, other = (
        verification({(0, 0): 100, (1, 0): 100}),
        verification({(0, 0): corrected[0], (1, 0): corrected[1]}),
    )
    # None of these wrong pixels has a cause that is nobody's fault.
    numbers = [None if one.as_found is None else replace(one.as_found, causes=None) for one in other.hogels]
    hogels = tuple(replace(mine, corrected=its) for mine, its in zip(found.hogels, numbers, strict=True))
    found = replace(found, hogels=hogels, diagnosis=replace(found.diagnosis, faults=(SHIFT,)))
    tested = with_correction_tested(found)
    assert (tested.diagnosis.faults == (SHIFT,)) is named
    assert tested.explained is named
    assert ("no single fault that was tried explains all hogels" in table(tested)) is not named
    assert ("o single fault that was tried explains all hogels" in render_page(tested)) is not named
    assert ("explained: 100 %" in table(tested)) is named
    if not named:
        (guess,) = tested.diagnosis.does_not_explain
        assert guess.alternatives == ("near",)
        assert guess.explains == 0.0
        assert "800 pixels of all judged hogels are wrong instead of 400" in guess.words


@pytest.mark.slow
def test_a_near_offset_that_one_tested_hogel_shows_is_not_called_a_shift_of_pixels(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(SPHERE, encoding="utf-8")
    scene = open_scene(str(path))
    with Faulty(scene=scene, near=0.1) as renderer:
        found = verify(scene, renderer)
    assert not found.passed
    assert found.diagnosis.means == "191 claims of 1 hogel"
    assert found.diagnosis.faults == ()
    assert any("near" in guess.alternatives for guess in found.diagnosis.guesses)
    assert all((guess.explains or 0.0) < MIN_EXPLAINED_FRACTION for guess in found.diagnosis.guesses)
