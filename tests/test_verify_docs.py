"""The examples of docs/verify.md run, and say what they say they say."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from xfrustum.compare import faults

DOCS = Path(__file__).resolve().parents[1] / "docs" / "verify.md"


@pytest.mark.slow
def test_the_examples_in_python_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.DOTALL)
    assert len(blocks) == 3
    names: dict[str, Any] = {}
    results = []
    for block in blocks:
        exec(compile(block, str(DOCS), "exec"), names)
        results.append(names["found"])
    function, files, command = results
    assert not function.passed
    assert [fault.fault for fault in function.diagnosis.faults] == ["near"]
    assert files.passed
    assert command.passed


def test_every_fault_is_in_the_table() -> None:
    text = DOCS.read_text()
    known = [
        value
        for name, group in vars(faults).items()
        if name.isupper() and name != "CONVENTIONS"
        for value in ((group,) if isinstance(group, str) else group if isinstance(group, tuple) else ())
    ]
    assert len(known) == 21
    assert [name for name in known if f"`{name}`" not in text] == []
