"""The cells of docs/notebooks.md run one after the other and display the described results."""

import ast
import re
from pathlib import Path
from typing import Any

import pytest

import xfrustum
from tests.notebooks.test_shown import small_scene
from xfrustum import open_scene
from xfrustum.reports.displays import DISPLAYED

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "notebooks.md").read_text(encoding="utf-8")
PROGRAMS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def last_value(program: str, names: dict[str, object]) -> Any:
    """Run a cell of a notebook; return the value of its last line."""
    tree = ast.parse(program)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "docs/notebooks.md", "exec"), names)
    if not isinstance(last, ast.Expr):
        return None
    return eval(compile(ast.Expression(last.value), "docs/notebooks.md", "eval"), names)


def test_the_cells_run_one_after_the_other(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The scene is smaller, with just enough hogels for the page's aperture."""
    pytest.importorskip(
        "xarray", reason="needs the package xarray, the optional part xfrustum[notebook]"
    )

    def opened(name: str) -> xfrustum.Scene:
        scene = small_scene(name, (16, 12))
        return xfrustum.Scene(**{**vars(scene), "plate": open_scene(name).plate})

    monkeypatch.setattr(xfrustum, "open_scene", opened, raising=False)
    names: dict[str, object] = {}
    values = [last_value(program, names) for program in PROGRAMS]
    shown = [type(value).__name__ for value in values if isinstance(value, DISPLAYED)]
    assert shown == ["Scene", "Comparison"]
    printed = capsys.readouterr().out
    assert "mm [60, 20] " in printed
    for line in (
        "Scene(name='asymmetric-recentered'",
        "BudgetReport: ",
        "SceneView: ",
    ):
        assert line in printed
