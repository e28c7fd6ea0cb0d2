"""The figures of docs/method.md are those that their program draws."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]
PROGRAM = runpy.run_path(str(CHECKOUT / "scripts" / "draw_method_figures.py"))


@pytest.mark.parametrize("name", sorted(PROGRAM["FIGURES"]))
def test_a_figure_is_what_its_program_draws_and_the_page_shows_it(name: str) -> None:
    drawn = PROGRAM["FIGURES"][name]().document()
    assert (CHECKOUT / "docs" / "images" / name).read_text() == drawn
    assert f"images/{name}" in (CHECKOUT / "docs" / "method.md").read_text()
