"""The benchmark of clusters: what follows on paper, and the memory of who submits blocks."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from xfrustum.reports.benchmarks.cluster.forecast import breaking_workers, forecast

TASK_KB = 10
"""Memory of a task that is held, kB, by Dask's documentation."""


@given(st.integers(1, 10**7), st.integers(1, 600), st.integers(1, 1000))
def test_a_survey_on_paper_takes_at_least_its_work_and_its_scheduling(
    hogels: int, workers: int, per_block: int
) -> None:
    one = forecast(hogels, workers, 0.5, per_block, 2e-3, 2 * workers)
    assert one.wall_s >= hogels * 0.5 / workers * (1 - 1e-9)
    assert one.wall_s >= one.scheduling_s == one.blocks * 2e-3
    assert one.blocks * per_block >= hogels > (one.blocks - 1) * per_block
    assert one.tasks_held == 2 * workers


def test_more_workers_than_the_scheduler_can_feed_do_not_help() -> None:
    most = breaking_workers(10.0, 100.0)
    assert most == 1000
    times = [forecast(10**6, workers, 1.0, 10, 0.01, 0).wall_s for workers in (most, 10 * most)]
    assert times[0] == pytest.approx(times[1], rel=0.02)


@pytest.mark.slow
def test_the_memory_of_client_and_scheduler_does_not_grow_with_the_number_of_hogels() -> None:
    from xfrustum.reports.benchmarks.cluster.simulation import simulate  # noqa: PLC0415 - Dask, only here

    # Blocks of ten hogels: 10^3 and 10^5 hogels.
    few, many = simulate(8, 100, 0.0), simulate(8, 10_000, 0.0)
    held_mib = (many.blocks - few.blocks) * TASK_KB / 1024
    # All tasks together would take some 97 MiB; what allocators keep of passing ones is far less.
    assert many.client_growth_mib - few.client_growth_mib < held_mib / 4
    # The scheduler keeps histories of bounded length.
    assert many.scheduler_growth_mib - few.scheduler_growth_mib < held_mib / 2
