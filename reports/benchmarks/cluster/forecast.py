"""Time and memory of plates too large to be measured here, on paper, and what breaks first.

The assumptions: every hogel takes as long as the measured ones; workers do not slow one another down, for
each has processors and a device of its own; the scheduler does one thing at a time; a block that is started
last is finished last, so that in the end workers wait for one block at most; the store takes what the workers
write.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

PLATES = (4_941, 100_000, 10_000_000)
"""Numbers of hogels of the forecasts: the built-in plate, and the sizes that people ask for."""

WORKER_COUNTS = (2, 64, 512)
"""Numbers of workers of the forecasts."""

ROW_BYTES = 900
"""Bytes of a row in a part of some 50 hogels: 106 columns, compressed. Smaller parts take more a row."""


@dataclass(frozen=True, kw_only=True)
class SimulatedRun:
    """What many blocks took with simulated workers.

    Attributes
    ----------
    workers, blocks, block_s
        Number of workers and of blocks, and the seconds that each block sleeps.
    wall_s, ideal_s
        Seconds from the first block to the last, and those that the workers would take alone.
    overhead
        `wall_s` over `ideal_s`, less one; None where blocks do not sleep.
    tasks_per_s
        Blocks per second.
    scheduler_ms, client_ms
        Processor time of the scheduler and of the client for each block, milliseconds.
    scheduler_mib, scheduler_growth_mib, client_growth_mib
        Resident memory of the scheduler in the end; and what scheduler and client have grown by from the
        tenth part of the blocks to the last.
    """

    workers: int
    blocks: int
    block_s: float
    wall_s: float
    ideal_s: float
    overhead: float | None
    tasks_per_s: float
    scheduler_ms: float
    client_ms: float
    scheduler_mib: float
    scheduler_growth_mib: float
    client_growth_mib: float


@dataclass(frozen=True, kw_only=True)
class Forecast:
    """A survey of a whole plate, on paper.

    Attributes
    ----------
    hogels, workers, blocks
        Numbers of hogels, workers and blocks.
    work_s, scheduling_s, wall_s
        Seconds that the workers take, that the scheduler's processor takes, and that a survey takes: the
        larger of the two, and a block for the end.
    tasks_held
        Number of tasks that scheduler and client hold at a time, whatever the plate.
    rows_mib
        Size of all rows on the disk.
    """

    hogels: int
    workers: int
    blocks: int
    work_s: float
    scheduling_s: float
    wall_s: float
    tasks_held: int
    rows_mib: float


def forecast(
    hogels: int, workers: int, hogel_s: float, hogels_per_block: int, task_s: float, tasks_held: int
) -> Forecast:
    """Forecast a survey of a whole plate.

    Parameters
    ----------
    hogels, workers
        Numbers of hogels and of workers.
    hogel_s
        Seconds that a worker takes for a hogel.
    hogels_per_block
        Number of hogels of a block.
    task_s
        Seconds of the scheduler for a task.
    tasks_held
        Number of tasks under way at a time.
    """
    blocks, block_s = math.ceil(hogels / hogels_per_block), hogels_per_block * hogel_s
    work_s, scheduling_s = math.ceil(blocks / workers) * block_s, blocks * task_s
    return Forecast(
        hogels=hogels,
        workers=workers,
        blocks=blocks,
        work_s=work_s,
        scheduling_s=scheduling_s,
        wall_s=max(work_s, scheduling_s + block_s),
        tasks_held=tasks_held,
        rows_mib=hogels * ROW_BYTES / (1 << 20),
    )


def breaking_workers(block_s: float, tasks_per_s: float) -> int:
    """Return the number of workers beyond which one scheduler cannot feed them, and more do not help."""
    return math.floor(block_s * tasks_per_s)
