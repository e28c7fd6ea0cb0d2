"""The plate's apertures, by the formulas of CONVENTIONS.md, "Frames"."""

from itertools import islice
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from xfrustum.reports.plate.plate import blocks_of_apertures
from xfrustum.scenes import InputError, Plate, open_scene
from xfrustum.scenes.disk import largest_plate

PLATE = Plate(size=(8.0, 6.0), hogels=(4, 2))


def test_row_zero_is_at_the_top_and_the_middle_of_an_even_plate_beside_the_origin() -> None:
    first, last = PLATE.aperture(0, 0), PLATE.aperture(3, 1)
    assert (first.x, first.y, last.x, last.y) == (-3.0, 1.5, 3.0, -1.5)
    odd = Plate(size=(8.0, 6.0), hogels=(5, 3)).middle
    assert (odd.index, odd.x, odd.y) == ((2, 1), 0.0, 0.0)
    assert (PLATE.middle.index, PLATE.middle.x, PLATE.middle.y) == ((2, 1), 1.0, -1.5)


@pytest.mark.parametrize("index", [(-1, 0), (0, -1), (4, 0), (0, 2)])
def test_an_aperture_outside_the_plate_is_an_error_with_the_plates_size(
    index: tuple[int, int],
) -> None:
    with pytest.raises(InputError, match="columns run from 0 to 3, rows from 0 to 1"):
        PLATE.aperture(*index)


BLOCKED = Plate(size=(8.0, 6.0), hogels=(5, 4))


@st.composite
def spans(draw: st.DrawFn, count: int) -> tuple[int, int] | None:
    if draw(st.booleans()):
        return None
    first = draw(st.integers(0, count - 1))
    return first, draw(st.integers(first, count - 1))


@given(st.lists(st.tuples(spans(5), spans(4)), min_size=1, max_size=4))
def test_every_aperture_of_any_block_comes_once(
    blocks: list[tuple[tuple[int, int] | None, tuple[int, int] | None]],
) -> None:
    apertures = blocks_of_apertures(BLOCKED, blocks)
    listed = list(apertures)
    assert len(listed) == len(apertures) == len(set(listed))
    (columns, rows) = BLOCKED.hogels
    inside = {
        (i, j)
        for across, down in blocks
        for i in range(columns)
        for j in range(rows)
        if (across is None or across[0] <= i <= across[1])
        and (down is None or down[0] <= j <= down[1])
    }
    assert {aperture.index for aperture in listed} == inside
    assert [apertures[number] for number in range(len(apertures))] == listed
    assert all(aperture in apertures for aperture in listed)


def test_a_plate_of_ten_thousand_million_hogels_is_gone_through_without_a_list() -> None:
    plate = Plate(size=(8.0, 6.0), hogels=(100_000, 100_000))
    apertures = plate.apertures()
    assert len(apertures) == 10**10
    assert [aperture.index for aperture in islice(apertures, 2)] == [(0, 0), (1, 0)]
    assert apertures[-1].index == (99_999, 99_999)
    with pytest.raises(IndexError):
        apertures[10**10]


def test_a_scene_file_with_too_many_hogels_names_the_option(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(
        "[plate]\nsize = [1.0, 1.0]\nhogels = [100000, 100000]\n"
        "[frustum]\nresolution = [4, 4]\nfov_deg = [60.0, 60.0]\nreach = [2.0, 2.0]\n"
    )
    with largest_plate(10**10):
        assert open_scene(str(path)).plate.hogels == (100_000, 100_000)
    with pytest.raises(InputError, match="--max-hogels"):
        open_scene(str(path))
