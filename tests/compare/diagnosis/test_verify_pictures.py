"""Pictures without numbers are registered with the reference's own."""

from __future__ import annotations

from typing import Any

import pytest

import xfrustum
from tests.support.foreign_renderers import Faulty, small
from xfrustum.compare.renderer_model.conventions import Orientation

TURNED, EXCHANGED = Orientation(False, True, True), Orientation(True, False, True)

CASES: dict[str, tuple[dict[str, Any], dict[str, float | str]]] = {
    "nothing": ({}, {}),
    "turned and exchanged": (
        {"orientation": TURNED, "order": EXCHANGED},
        {"orientation": TURNED.words[0], "aperture-order": EXCHANGED.words[1]},
    ),
    "corners": ({"shift": (-0.5, -0.5)}, {"shift-x": -0.5, "shift-y": -0.5}),
    "fov": ({"fov": (0.98, 1.02)}, {"fov-x": 0.98, "fov-y": 1.02}),
}


@pytest.mark.slow
@pytest.mark.parametrize("shown", ["color", "object"])
@pytest.mark.parametrize("case", CASES)
def test_conventions_are_found_without_numbers_of_triangles(case: str, shown: str) -> None:
    faults, expected = CASES[case]
    scene = small("asymmetric", 64)
    with Faulty(scene=scene, shown=shown, **faults) as renderer:
        found = xfrustum.verify(scene, renderer)
    named = {fault.fault: fault.value for fault in found.diagnosis.faults}
    assert set(named) == set(expected)
    for name, size in expected.items():
        if isinstance(size, str):
            assert named[name] == size
        else:
            # A tenth of a pixel; a tenth of a percent.
            assert named[name] == pytest.approx(size, abs=0.1 if "shift" in name else 1e-3)
    assert found.passed == (not expected)


def test_a_picture_turned_about_is_seen_without_numbers() -> None:
    scene = small("asymmetric", 32)
    with Faulty(scene=scene, shown="color", orientation=TURNED, order=EXCHANGED) as renderer:
        found = xfrustum.verify(scene, renderer, apertures=[(i, j) for i in (0, 4) for j in (0, 3)])
    named = {fault.fault: fault.value for fault in found.diagnosis.faults}
    assert named["orientation"] == TURNED.words[0]
    assert named["aperture-order"] == EXCHANGED.words[1]
