"""What a verification says: of refuted faults, of guesses, and of displacement that is not known."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.reports.verification.synthetic import verification
from tests.support.foreign_renderers import Faulty
from xfrustum.compare.diagnosis.diagnosis import MIN_EXPLAINED_FRACTION, doubtful
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.reports.verification.verdict import (
    plate_map,
    render_page,
    table,
    with_correction_tested,
)
from xfrustum.reports.verification.verification import verify
from xfrustum.scenes import open_scene

SPHERE = """
plate = { size = [40.0, 30.0], hogels = [16, 12] }
object = [{ shape = "sphere", scale = 12.0 }]
[frustum]
resolution = [16, 12]
screen = { height = 120.0, center = [0.0, 0.0], size = [80.0, 60.0] }
reach  = [60.0, 60.0]
"""

SHIFT = Fault(
    fault="shift-x", value=0.1, unit="px", words="shifted; or near", alternatives=("near",), explains=1.0
)


@pytest.mark.parametrize(("corrected", "named"), [((0, 400), False), ((0, 60), True), ((0, 0), True)])
def test_a_fault_is_named_where_its_correction_makes_no_more_pixels_wrong(
    corrected: tuple[int, int], named: bool
) -> None:
    found = verification({(0, 0): 100, (1, 0): 100})
    other = verification({(i, 0): wrong for i, wrong in enumerate(corrected)})
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


@pytest.mark.parametrize(("explains", "told"), [(0.0, False), (0.004, False), (0.3, True)])
def test_a_guess_is_told_where_it_explains_anything(explains: float, told: bool) -> None:
    found = verification({(0, 0): 900, (1, 0): 0})
    guess = doubtful(replace(Fault(fault="shift-x", value=1.5, unit="px", words="moved"), explains=explains))
    found = replace(found, diagnosis=replace(found.diagnosis, does_not_explain=(guess,)))
    assert "no known fault explains what is wrong" in table(found)
    assert ("moved: would explain only" in table(found)) is told
    assert ("moved: would explain only" in render_page(found)) is told
    assert [one["words"] for one in found.summary()["does_not_explain"]] == [guess.words]


def test_the_page_of_a_failed_verification_maps_which_hogels_are_wrong() -> None:
    found = verification({(0, 0): 0, (1, 0): 30, (0, 1): 900, (1, 1): None})
    drawn = plate_map(found)
    assert drawn is not None
    cells = {one["words"]: one["cells"] for one in drawn["classes"]}
    assert cells == {
        "keeps to the limits": [[0, 0]],
        "exceeds a limit": [[0, 1]],
        "half or more is wrong": [[1, 0]],
        "missing": [[1, 1]],
    }
    assert all(f'd="M{c} {r}h.96v.96h-.96z"' in render_page(found) for ((r, c),) in cells.values())
    right = verification({(0, 0): 0, (1, 0): 0})
    assert plate_map(right) is None and "Which hogels fail" not in render_page(right)
