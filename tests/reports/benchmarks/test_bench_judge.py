"""The benchmark of judging says what it measured; how fast anything is, is no test's business."""

from __future__ import annotations

import json
from typing import Any

import pytest

from tests.support.views import view
from xfrustum import Judge
from xfrustum.cli.main import main
from xfrustum.raster import Rasterizer
from xfrustum.reference.devices.dr_jit import backend
from xfrustum.reports.benchmarks import judge_stream
from xfrustum.reports.benchmarks.judge import benchmark_judge, judging_over_drawing, stages_of, table
from xfrustum.reports.benchmarks.judge_contestants import (
    COMPARING,
    DECIDING,
    DRAWN,
    LOOP,
    MEANINGS,
    MITSUBA,
    POINTS,
    RADIANCE,
    READ,
    SECOND_OPINION,
    STAGES,
    STREAM,
    PlainLoop,
    globes_through_a_plate,
    loop_of,
    spread_over,
    stream_of,
)
from xfrustum.reports.benchmarks.judge_stream import Job, Measured, benchmark_stream, measure_apart
from xfrustum.scenes import InputError

PARTS = {
    DECIDING: 1.0,
    SECOND_OPINION: 2.0,
    POINTS: 6.0,
    DRAWN: 1.0,
    READ: 4.0,
    COMPARING: 2.0,
    RADIANCE: 5.0,
}


def test_json_carries_every_contestant_and_stage_of_every_scene(capsys: pytest.CaptureFixture[str]) -> None:
    sizes = ["--resolution", "8,12", "--hogels", "2", "--repeat", "1", "--triangles", "1000"]
    assert main(["bench", "judge", "crossing", *sizes, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [one["scene"]["triangles"] for one in found["scenes"]] == [10598, 1000]
    assert found["hogels"] == 2 and found["repeat"] == 1 and found["stream"] is None
    assert set(found["meanings"]) == set(MEANINGS) and set(found["stages"]) == set(STAGES)
    assert set(found["machine"]) >= {"processor", "cores"} and "embreex" in found["versions"]
    for scene in found["scenes"]:
        assert [race["resolution"] for race in scene["races"]] == [[8, 8], [12, 12]]
        for race in scene["races"]:
            assert_complete(race)


def assert_complete(race: dict[str, Any]) -> None:
    rates = race["hogels_per_second"]
    assert set(rates) == set(MEANINGS)
    for name, rate in rates.items():
        if rate is None:
            assert name == MITSUBA and backend().scalar
        else:
            assert 0 < rate["lowest"] <= rate["median"] <= rate["highest"]
    for pair, ratio in race["ratios"].items():
        one, other = pair.split("/")
        assert ratio is None or ratio == pytest.approx(rates[one]["median"] / rates[other]["median"])
    assert set(race["cpu_s"]) == set(STAGES) and min(race["cpu_s"].values()) >= 0
    assert set(race["judging_over_drawing"]) == {"without radiance", "with radiance"}


def test_the_table_names_every_contestant_and_stage() -> None:
    lines = table(benchmark_judge([view("crossing")], (8,), 2, 1)).splitlines()
    for name in (*MEANINGS, *STAGES):
        assert any(line.startswith(name) for line in lines), name
    assert any(line.startswith("crossing, 10,598 triangles") for line in lines)


def test_stages_are_what_each_part_takes_beyond_the_parts_within_it() -> None:
    stages = stages_of(PARTS)
    assert stages == {**PARTS, POINTS: 5.0, READ: 3.0, RADIANCE: 3.0}
    assert stages_of({**PARTS, POINTS: 0.5})[POINTS] == 0.0
    ratios = judging_over_drawing(stages)
    assert ratios == {"without radiance": 8.0 / 4.0, "with radiance": 11.0 / 4.0}


def test_stream_and_loop_find_the_same_and_a_plain_loop_nearly() -> None:
    """On a scene without edges between objects nearby, a plain loop miscounts few pixels."""
    scene = view("asymmetric", (48, 48))
    apertures = spread_over(scene, 3)
    with Judge(scene) as judge, Rasterizer(scene) as rasterizer:
        streamed = stream_of(judge, apertures)
        assert streamed == loop_of(judge.reference, rasterizer, apertures)
        plain = PlainLoop(scene, rasterizer).judge(apertures)
    for (wrong, p99), judged in zip(plain, streamed, strict=True):
        assert judged.displacement_px is not None
        assert p99 == pytest.approx(judged.displacement_px.p99, abs=1e-3)
        # It counts displaced silhouettes, whose points the true frustum sees all the same.
        assert wrong < 0.05


def test_many_hogels_are_measured_in_processes_of_their_own_in_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    jobs: list[Job] = []

    def measured(job: Job) -> Measured:
        jobs.append(job)
        return Measured(
            seconds=2.0 if job.way == STREAM else 3.0,
            cpu_s=4.0,
            before_mib=100.0,
            peak_mib=200.0 + job.hogels,
        )

    monkeypatch.setattr(judge_stream, "measure_apart", measured)
    record = benchmark_stream("crossing", 18, 8, 2)
    assert [job.way for job in jobs] == [STREAM, LOOP, STREAM, LOOP, STREAM]
    assert [job.hogels for job in jobs] == [18, 18, 18, 18, 2]
    assert record.ratio == pytest.approx(1.5) and record.hogels_per_second[STREAM].median == 9.0
    assert record.memory["fewer"].peak_mib == 202.0 and record.memory[STREAM].peak_mib == 218.0
    text = "\n".join(judge_stream.lines_of(record))
    assert "18 hogels of 8 x 8 of crossing" in text and "stream/loop  1.50" in text


@pytest.mark.slow
@pytest.mark.parametrize("way", [STREAM, LOOP])
def test_a_process_of_its_own_judges(way: str) -> None:
    found = measure_apart(Job(scene="crossing", way=way, resolution=8, hogels=2))
    assert found.seconds > 0 and found.cpu_s > 0 and found.peak_mib >= found.before_mib > 0


@pytest.mark.slow
def test_a_process_that_ends_badly_is_said() -> None:
    with pytest.raises(InputError, match="stream at no-such-scene"):
        measure_apart(Job(scene="no-such-scene", way=STREAM, resolution=8, hogels=2))


def test_what_cannot_be_judged_is_refused() -> None:
    with pytest.raises(InputError, match="empty"):
        benchmark_judge([view("empty")], (8,), 1, 1)
    with pytest.raises(InputError, match="positive"):
        benchmark_judge([view("crossing")], (8,), 0, 1)
    with pytest.raises(InputError, match="positive"):
        spread_over(view("crossing"), 0)


def test_apertures_are_spread_over_the_plate() -> None:
    scene = globes_through_a_plate(1000)
    assert {one.index for one in spread_over(scene, 81)} == {(i, j) for i in range(9) for j in range(9)}
    assert spread_over(scene, 2) == [scene.plate.aperture(0, 0), scene.plate.aperture(8, 8)]
