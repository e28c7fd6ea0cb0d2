"""The plate's apertures, by the formula of CONVENTIONS.md, "Frames"."""

from __future__ import annotations

import pytest

from xfrustum.scenes import InputError, Plate, open_scene

PLATE = Plate(size=(8.0, 6.0), hogels=(4, 2))


def test_row_zero_is_at_the_top_and_column_zero_at_the_left() -> None:
    first = PLATE.aperture(0, 0)
    last = PLATE.aperture(3, 1)
    assert (first.x, first.y) == (-3.0, 1.5)
    assert (last.x, last.y) == (3.0, -1.5)


def test_the_middle_aperture_of_an_odd_plate_is_at_the_origin_and_of_an_even_one_beside_it() -> None:
    odd = Plate(size=(8.0, 6.0), hogels=(5, 3)).middle
    assert (odd.index, odd.x, odd.y) == ((2, 1), 0.0, 0.0)
    assert (PLATE.middle.index, PLATE.middle.x, PLATE.middle.y) == ((2, 1), 1.0, -1.5)


@pytest.mark.parametrize("index", [(-1, 0), (0, -1), (4, 0), (0, 2)])
def test_an_aperture_outside_the_plate_is_an_error_that_says_where_it_ends(index: tuple[int, int]) -> None:
    with pytest.raises(InputError, match="columns run from 0 to 3, rows from 0 to 1"):
        PLATE.aperture(*index)


def test_a_report_adds_two_corners_when_the_frustum_is_recentered() -> None:
    centered, recentered = open_scene("car"), open_scene("car-recentered")
    assert [a.index for a in centered.default_apertures()] == [(40, 30)]
    assert [a.index for a in recentered.default_apertures()] == [(40, 30), (0, 0), (80, 60)]
