"""Many hogels judged in a process of its own, as a stream or in a loop: seconds, and the most memory it had.

`python -m xfrustum.reports.benchmarks.judge_stream JOB` is the process: it answers with one line of JSON.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from functools import partial

from xfrustum.compare.judging.judge import Judge
from xfrustum.compare.judging.stopwatch import Stopwatch
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.benchmarks.judge_contestants import LOOP, STREAM, loop_of, sized, spread_over, stream_of
from xfrustum.reports.benchmarks.scaling.process import peak_mib
from xfrustum.reports.common.timing import Timing
from xfrustum.scenes import open_scene
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate.plate import Aperture

RESOLUTION = 256
REPEAT = 3
PARTS = 9
"""Share of the hogels, one in so many, that a stream judges besides: its memory is to be the same."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """What one process measures.

    Attributes
    ----------
    scene
        Name or path of the scene.
    way
        `STREAM` or `LOOP`.
    resolution, hogels
        W = H in pixels of each hogel, and their number, spread over the plate.
    """

    scene: str
    way: str
    resolution: int
    hogels: int


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Wall and CPU seconds of judging all hogels, and the most memory after a first hogel and ever, MiB."""

    seconds: float
    cpu_s: float
    before_mib: float
    peak_mib: float


@dataclass(frozen=True, kw_only=True)
class Memory:
    """Hogels that a process judged, and the most memory it had, MiB; `before_mib` after a first hogel."""

    hogels: int
    before_mib: float
    peak_mib: float


@dataclass(frozen=True, kw_only=True)
class StreamRecord:
    """Many judged hogels: a stream beside the loop, each run in a process of its own, taking turns.

    Attributes
    ----------
    scene, resolution, hogels
        What was judged.
    hogels_per_second, cpu_s_per_hogel
        By `STREAM` and `LOOP`.
    ratio
        Median rate of the stream over that of the loop.
    memory
        By `STREAM`, `LOOP` and, of the stream with fewer hogels, `fewer`.
    """

    scene: str
    resolution: tuple[int, int]
    hogels: int
    hogels_per_second: dict[str, Timing]
    cpu_s_per_hogel: dict[str, Timing]
    ratio: float
    memory: dict[str, Memory]


def measure(job: Job) -> Measured:
    """Measure here; memory is that of this process, with whatever it did before."""
    scene = sized(open_scene(job.scene), job.resolution)
    apertures = spread_over(scene, job.hogels)
    with ExitStack() as stack:
        run: Callable[[list[Aperture]], object]
        if job.way == STREAM:
            run = partial(stream_of, stack.enter_context(Judge(scene)))
        else:
            run = partial(loop_of, Reference(scene), stack.enter_context(Rasterizer(scene)))
        # The first hogel compiles kernels and builds structures.
        run([scene.plate.middle])
        before, watch, cpu = peak_mib(), Stopwatch(), time.process_time()
        with watch.stage("run"):
            run(apertures)
        cpu = time.process_time() - cpu
    return Measured(seconds=watch.seconds["run"], cpu_s=cpu, before_mib=before, peak_mib=peak_mib())


def measure_apart(job: Job) -> Measured:
    """Measure in a new process of the same interpreter.

    Raises
    ------
    InputError
        The process was ended, as when memory runs out, or there is no usable OpenGL.
    """
    module = [sys.executable, "-m", "xfrustum.reports.benchmarks.judge_stream", json.dumps(asdict(job))]
    paths = {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    run = subprocess.run(module, capture_output=True, text=True, check=False, env={**os.environ, **paths})
    if run.returncode:
        last = (run.stderr.strip().splitlines() or ["it said nothing"])[-1]
        raise InputError(
            f"bench judge: the process of {job.way} at {job.scene} ended with {run.returncode} ({last}); "
            "free some memory, or measure fewer hogels"
        )
    return Measured(**json.loads(run.stdout.strip().splitlines()[-1]))


def benchmark_stream(
    scene: str,
    hogels: int,
    resolution: int = RESOLUTION,
    repeat: int = REPEAT,
    done: Callable[[], object] = lambda: None,
) -> StreamRecord:
    """Measure many judged hogels, as a stream and in a loop, which take turns.

    Parameters
    ----------
    scene
        Name or path of a scene.
    hogels, resolution
        Number of hogels, and W = H of each.
    repeat
        Number of processes of each.
    done
        Function that is called after each process.

    Raises
    ------
    InputError
        There is no such scene, a number is not positive, or a process was ended.
    """
    spread_over(open_scene(scene), hogels)
    runs: dict[str, list[Measured]] = {STREAM: [], LOOP: []}
    for _ in range(repeat):
        for way, found in runs.items():
            found.append(measure_apart(Job(scene=scene, way=way, resolution=resolution, hogels=hogels)))
            done()
    few = max(1, hogels // PARTS)
    fewer = measure_apart(Job(scene=scene, way=STREAM, resolution=resolution, hogels=few))
    done()
    rates = {way: Timing.of([hogels / one.seconds for one in found]) for way, found in runs.items()}
    return StreamRecord(
        scene=scene,
        resolution=(resolution, resolution),
        hogels=hogels,
        hogels_per_second=rates,
        cpu_s_per_hogel={
            way: Timing.of([one.cpu_s / hogels for one in found]) for way, found in runs.items()
        },
        ratio=rates[STREAM].median / rates[LOOP].median,
        memory={
            **{way: _memory(hogels, found) for way, found in runs.items()},
            "fewer": _memory(few, [fewer]),
        },
    )


def _memory(hogels: int, found: Sequence[Measured]) -> Memory:
    worst = max(found, key=lambda one: one.peak_mib)
    return Memory(hogels=hogels, before_mib=worst.before_mib, peak_mib=worst.peak_mib)


def lines_of(record: StreamRecord) -> list[str]:
    """Return what was measured as lines of text."""
    side, _ = record.resolution
    return [
        f"{record.hogels} hogels of {side} x {side} of {record.scene}, each run in a process of its own",
        *(
            f"  {way:<8}{rate.median:8.2f} hogels/s ({rate.lowest:.2f} to {rate.highest:.2f}), "
            f"{record.cpu_s_per_hogel[way].median:.3f} CPU seconds a hogel"
            for way, rate in record.hogels_per_second.items()
        ),
        f"  {STREAM}/{LOOP}{record.ratio:6.2f}",
        *(
            f"  most memory {one.peak_mib:7.0f} MiB with {one.hogels} hogels ({way}), "
            f"{one.before_mib:.0f} MiB after the first"
            for way, one in record.memory.items()
        ),
    ]


if __name__ == "__main__":
    sys.stdout.write(json.dumps(asdict(measure(Job(**json.loads(sys.argv[1]))))) + "\n")
