"""One contestant at one size in a process of its own: seconds, and the most memory it ever had.

`python -m xfrustum.reports.benchmarks.scaling.process JOB` is the process: it answers with one line of JSON.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from xfrustum.reports.benchmarks.scaling.contestants import CONTESTANTS, UnavailableError
from xfrustum.reports.common.timing import Stopwatch, Timing
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.library import builtin
from xfrustum.scenes.library.globes import globes
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

ENOUGH_S = 2.0
"""Seconds of measured runs after which no more are made, once there are `FEWEST`."""

FEWEST = 2
"""Measured runs that are made however long they take, where so many are asked for."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """What one process measures.

    Attributes
    ----------
    contestant
        A name of `CONTESTANTS`.
    triangles
        Triangles of the globes; None for the built-in car.
    resolution
        W = H in pixels.
    hogels
        Neighboring apertures about the middle of the plate; one run answers for all of them.
    repeat
        Measured runs at most, after one that counts as set-up.
    """

    contestant: str
    triangles: int | None
    resolution: int
    hogels: int
    repeat: int

    def question(self) -> tuple[Scene, Sequence[Aperture]]:
        """Return the scene, and the apertures that it is asked for from."""
        size = (self.resolution, self.resolution)
        if self.triangles is not None:
            scene = globes(self.triangles, size)
        else:
            scene = builtin.build("car")
            scene = replace(scene, frustum=replace(scene.frustum, resolution=size))
        first, row = scene.plate.middle.column - self.hogels // 2, scene.plate.middle.row
        return scene, [scene.plate.aperture(column, row) for column in range(first, first + self.hogels)]


@dataclass(frozen=True, kw_only=True)
class Measured:
    """One contestant at one size.

    Attributes
    ----------
    seconds
        Wall seconds of a run, which makes the pictures of all apertures.
    set_up_s
        Seconds that are paid once: from the scene to the first run's end, less one run. Structures, uploads,
        compiled programs, normals of triangles.
    imported_mib, scene_mib, peak_mib
        The most memory that the process had until it had imported everything, until it also had the
        scene, and ever. What a graphics card holds of its own is not in it.
    triangles
        Triangles of the scene.
    made_of
        Names and versions of what the contestant runs on.
    """

    seconds: Timing
    set_up_s: float
    imported_mib: float
    scene_mib: float
    peak_mib: float
    triangles: int
    made_of: dict[str, str]


def measure(job: Job) -> Measured:
    """Measure here; memory is that of this process, with whatever it did before.

    Raises
    ------
    UnavailableError
        The contestant does not run here.
    InputError
        There is no usable OpenGL, or no such scene.
    """
    set_up = CONTESTANTS[job.contestant].load()
    imported = peak_mib()
    scene, apertures = job.question()
    scene_peak = peak_mib()
    watch, taken = Stopwatch(), list[float]()
    with ExitStack() as stack:
        with watch.stage("set-up"):
            running = stack.enter_context(set_up(scene, apertures))
            running.pictures()
        while len(taken) < job.repeat and (len(taken) < FEWEST or sum(taken) < ENOUGH_S):
            one = Stopwatch()
            with one.stage("run"):
                running.pictures()
            taken.append(one.seconds["run"])
    return Measured(
        seconds=Timing.of(taken),
        set_up_s=max(0.0, watch.seconds["set-up"] - statistics.median(taken)),
        imported_mib=imported,
        scene_mib=scene_peak,
        peak_mib=peak_mib(),
        triangles=len(scene.faces),
        made_of=running.made_of,
    )


def peak_mib() -> float:
    """Return the most memory that this process ever had, resident, in MiB."""
    # Linux hands ru_maxrss down to a child: it is never less than the parent had when it forked.
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            if name == "VmHWM":
                return int(value.split()[0]) / 1024
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (2**20 if sys.platform == "darwin" else 2**10)


def measure_apart(job: Job) -> Measured:
    """Measure in a new process of the same interpreter.

    Raises
    ------
    UnavailableError, InputError
        As `measure`; InputError also where the process was ended, as when memory runs out.
    """
    module = [sys.executable, "-m", "xfrustum.reports.benchmarks.scaling.process", json.dumps(asdict(job))]
    paths = {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    run = subprocess.run(module, capture_output=True, text=True, check=False, env={**os.environ, **paths})
    if run.returncode:
        last = (run.stderr.strip().splitlines() or ["it said nothing"])[-1]
        raise InputError(
            f"bench scaling: the process of {job.contestant} at {job.triangles or 'the car'}, "
            f"{job.resolution} pixels, {job.hogels} hogels ended with {run.returncode} ({last}); "
            "free some memory, or measure less with --quick"
        )
    answer = json.loads(run.stdout.strip().splitlines()[-1])
    if "unavailable" in answer:
        raise UnavailableError(answer["unavailable"])
    if "refused" in answer:
        raise InputError(answer["refused"])
    return Measured(**{**answer, "seconds": Timing(**answer["seconds"])})


def _answer(job: Job) -> str:
    """Return the one line of JSON that the process says: what it measured, or why it did not."""
    try:
        return json.dumps(asdict(measure(job)))
    except UnavailableError as reason:
        return json.dumps({"unavailable": str(reason)})
    except InputError as reason:
        return json.dumps({"refused": str(reason)})


if __name__ == "__main__":
    sys.stdout.write(_answer(Job(**json.loads(sys.argv[1]))) + "\n")
