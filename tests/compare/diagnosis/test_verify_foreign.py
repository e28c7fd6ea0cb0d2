"""Hogels of a public double-frustum renderer about which nothing is known in advance."""

from __future__ import annotations

from pathlib import Path

import pytest

import xfrustum

SLOW = pytest.mark.slow


# Hogels without an offset run every time.
@pytest.mark.parametrize(
    ("name", "offset"),
    [("BT-0.001", None), *(pytest.param(f"DF-{near}", near, marks=SLOW) for near in (0.1, 0.01, 0.001))],
)
def test_conventions_and_offset_of_another_renderer_are_found(
    name: str, offset: float | None, shared_data: Path
) -> None:
    folder = shared_data / "data" / "foreign"
    found = xfrustum.verify(
        str(folder / "scene.toml"), str(folder / name / "Hogel_{i}x{j}.png"), encoding="triangle-id"
    )
    named = {fault.fault: fault for fault in found.diagnosis.faults}
    near = named.pop("near", None)
    assert set(named) == {"orientation", "aperture-order", "shift-x", "shift-y"}
    assert named["orientation"].value == "turned by 180 degrees"
    assert abs(float(named["shift-x"].value)) == pytest.approx(0.5, abs=0.01)
    assert abs(float(named["shift-y"].value)) == pytest.approx(0.5, abs=0.01)
    if offset is None:
        assert near is None
    else:
        assert near is not None
        assert near.value == pytest.approx(offset, rel=0.02)
        assert near.low is not None
        assert near.high is not None
        assert near.low <= offset <= near.high
    summary = found.summary()
    assert summary["as_found"]["fraction"] > 0.9
    assert summary["corrected"]["fraction"] < 0.01
    charged = summary["corrected"]["causes"]
    assert sum(charged.values()) == summary["corrected"]["wrong"]
    assert charged["unexplained"] == 0
    assert not found.passed
    assert len(found.hogels) == 25
