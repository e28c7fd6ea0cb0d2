"""The benchmark says what it measured; how fast anything is, is no test's business."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.cli.main import main
from xfrustum.reference import Reference
from xfrustum.reference.devices.dr_jit import backend
from xfrustum.reports.benchmarks.truth import Race, Rate, benchmark_truth, table
from xfrustum.reports.benchmarks.truth_contestants import (
    CERTIFIED,
    EMBREE,
    MEANINGS,
    MITSUBA,
    TRIMESH,
    TRUTH,
    truth_contestants,
)
from xfrustum.scenes import NOTHING, HogelImage, InputError


def rate(median: float) -> Rate:
    return Rate(median=median, slowest=median / 2, fastest=median * 2)


def test_json_carries_every_contestant_at_every_resolution_the_machine_and_the_versions(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["bench", "truth", "crossing", "--resolution", "8,12", "--repeat", "2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {"scene", "repeat", "meanings", "races", "machine", "versions"}
    assert found["scene"]["name"] == "crossing"
    assert found["repeat"] == 2
    assert [race["resolution"] for race in found["races"]] == [[8, 8], [12, 12]]
    for race in found["races"]:
        assert set(race["mpixel_per_s"]) == set(found["meanings"]) == set(MEANINGS)
        for name, measured in race["mpixel_per_s"].items():
            if measured is None:
                assert name == MITSUBA and backend().scalar
            else:
                assert 0 < measured["slowest"] <= measured["median"] <= measured["fastest"]
        assert set(race["ratios"]) >= {"certified/mitsuba", "certified/trimesh"}
        assert all(ratio > 0 for ratio in race["ratios"].values() if ratio is not None)
    assert set(found["machine"]) >= {"processor", "cores"}
    assert set(found["versions"]) >= {"mitsuba", "mitsuba variant", "drjit", "embreex", "trimesh", "numpy"}


def test_ratios_are_those_of_the_medians_and_open_where_one_is_missing() -> None:
    race = Race(resolution=8, rates={TRIMESH: rate(2.0), CERTIFIED: rate(8.0), TRUTH: rate(1.0)})
    assert race.ratios == {
        "certified/mitsuba": None,
        "certified/trimesh": 4.0,
        "truth/mitsuba": None,
        "truth/trimesh": 0.5,
    }


def test_the_table_names_scene_machine_and_every_rate() -> None:
    measured = benchmark_truth(view("crossing", (8, 8)), (8,), 1)
    lines = table(measured).splitlines()
    assert "crossing" in lines[0] and measured.machine["processor"] in lines[0]
    assert {line.split()[0] for line in lines if line} >= {
        *MEANINGS,
        "certified/mitsuba",
        "certified/trimesh",
    }


@pytest.mark.parametrize("name", ["car", "asymmetric-recentered"])
def test_all_contestants_answer_for_the_same_lines(name: str) -> None:
    """Where the truth is proven and no tracer was overruled, all see the same triangles."""
    scene = view(name, (40, 30))
    aperture = scene.plate.middle
    found: dict[str, Callable[[], Any]] = dict(truth_contestants(scene, aperture))
    truth = found[TRUTH]()
    assert isinstance(truth, HogelImage) and truth.overruled is not None
    # The bare tracers know no far end: a hit beyond it is theirs alone.
    same = ~truth.overruled & truth.covered
    assert same.mean() > 0.05
    bands = list(Reference(scene).decide(aperture))
    np.testing.assert_array_equal(np.concatenate([band.triangle for band in bands]), truth.triangle)
    np.testing.assert_array_equal(np.asarray(found[EMBREE]()).reshape(30, 40)[same], truth.triangle[same])
    _, ray, hit = found[TRIMESH]()
    seen = np.full(same.size, NOTHING)
    seen[ray] = hit
    # Not in robust mode, it may miss a line near an edge.
    assert (seen.reshape(30, 40) == truth.triangle)[same].mean() > 0.99
    if MITSUBA in found:
        met = found[MITSUBA]().prim_index.numpy()
        np.testing.assert_array_equal(met.reshape(30, 40)[same], truth.triangle[same])


@pytest.mark.parametrize("sizes", ["0", "512,-1", "many", ""])
def test_impossible_resolutions_are_refused_in_one_line(
    sizes: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "truth", "crossing", "--resolution", sizes]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1


def test_a_scene_without_triangles_is_refused() -> None:
    empty = replace(view("crossing", (8, 8)), name="nothing", objects=())
    with pytest.raises(InputError, match="nothing"):
        benchmark_truth(empty, (8,), 1)
