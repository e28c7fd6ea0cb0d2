"""Is the truth true? The reference against integer brute force, pixel by pixel."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from tqdm import tqdm

from xfrustum.compare.selfcheck.disagreements import Disagreement, disagreements
from xfrustum.compare.selfcheck.rational import ExactRows, first_by_brute_force
from xfrustum.compare.selfcheck.sphere import SphereCheck, check_sphere
from xfrustum.compare.selfcheck.views import View, views
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import crossed_frustum
from xfrustum.reference.llvm import worker_count
from xfrustum.scenes.model.hogel_image import Certainty

MAX_TASK_PIXELS = 1 << 13
"""Largest number of pixels in one task of a process: so few that all processes are busy to the end."""


@dataclass(frozen=True, kw_only=True)
class ViewCheck:
    """The comparison of one image with the exact answer.

    Attributes
    ----------
    scene, aperture, resolution
        Name of the scene, column and row of the aperture, W and H of the image.
    pixels, covered, proven, exact, ties
        Numbers of all pixels, of those that show a surface, and of those in each class.
    wrong
        Number of pixels that disagree with the exact answer.
    disagreements
        Descriptions of the first few disagreements.
    tracer_wrong
        Number of pixels without a tie that the float32 tracer alone gets wrong.
    seconds
        Time for tracing, waiting for the exact rows, and comparing; other processes work ahead meanwhile.
    """

    scene: str
    aperture: tuple[int, int]
    resolution: tuple[int, int]
    pixels: int
    covered: int
    proven: int
    exact: int
    ties: int
    wrong: int
    disagreements: tuple[Disagreement, ...]
    tracer_wrong: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class SelfCheck:
    """All images that were checked, and the sphere.

    Attributes
    ----------
    views
        The comparison of each image.
    sphere
        The check of the sphere; None where it was not asked for.
    seconds
        Time for everything.
    """

    views: tuple[ViewCheck, ...]
    sphere: SphereCheck | None
    seconds: float

    @property
    def agrees(self) -> bool:
        """Whether no image and no line of the sphere is wrong."""
        return not any(view.wrong for view in self.views) and (self.sphere is None or self.sphere.agrees)

    def total(self, count: str) -> int:
        """Return the sum of one of the counts over all views."""
        return sum(getattr(view, count) for view in self.views)

    def summary(self) -> dict[str, Any]:
        """Return everything as `selfcheck --json` prints it."""
        counts = ("pixels", "covered", "proven", "exact", "ties", "wrong", "tracer_wrong")
        return {
            "agrees": self.agrees,
            **{count: self.total(count) for count in counts},
            "sphere": asdict(self.sphere) if self.sphere else None,
            "views": [asdict(view) for view in self.views],
            "seconds": self.seconds,
        }


def table(check: SelfCheck) -> str:
    """Return a self-check in words: one row per scene, the sphere, every disagreement, the result."""
    counts = ("pixels", "covered", "proven", "exact", "ties", "wrong", "tracer_wrong")
    titles = ("pixels", "covered", "proven", "exact", "ties", "wrong", "float32 wrong")
    of_scene: dict[str, list[ViewCheck]] = {}
    for view in check.views:
        of_scene.setdefault(view.scene, []).append(view)
    width = max(len(name) for name in of_scene)
    lines = [" ".join([f"{'scene':<{width}}", "apertures", *(f"{title:>13}" for title in titles)])]
    for name, group in (*of_scene.items(), ("all", list(check.views))):
        sums = (sum(getattr(view, count) for view in group) for count in counts)
        lines.append(" ".join([f"{name:<{width}}", f"{len(group):>9}", *(f"{n:>13,}" for n in sums)]))
    if check.sphere is not None:
        lines.append(check.sphere.sentence())
    lines += [
        f"{view.scene} {view.aperture[0]},{view.aperture[1]}: column {at.column}, row {at.row}, "
        f"{at.about}: expected {at.expected}, got {at.got}"
        for view in check.views
        for at in view.disagreements
    ]
    result = "agree" if check.agrees else "DISAGREE"
    return "\n".join(
        [
            *lines,
            f"reference and integers {result} on {check.total('pixels'):,} pixels ({check.seconds:.0f} s)",
        ]
    )


def selfcheck(
    names: Sequence[str] = (), *, quick: bool = False, progress: bool = False, processes: int | None = None
) -> SelfCheck:
    """Compare the reference with exact brute force on every pixel of many images.

    Parameters
    ----------
    names
        Scene files or built-in scenes; none for all of them and the sphere.
    quick
        Whether smaller images and a coarser sphere suffice.
    progress
        Whether to show a progress bar on standard error.
    processes
        Number of processes that compute; None for one per processor. With 1 no process is started: a script
        that does not guard its main module needs this.

    Raises
    ------
    InputError
        There is no such scene.
    """
    started = time.perf_counter()
    chosen = views(names, quick=quick)
    with _pool(processes or worker_count()) as pool, _progress_bar(chosen, progress) as bar:
        # All tasks are submitted at once: the other processes stay busy while this one traces.
        waiting = [(view, list(_exact_rows(view, pool))) for view in chosen]
        checked = [_check(view, rows, bar) for view, rows in waiting]
    return SelfCheck(
        views=tuple(checked),
        sphere=None if names else check_sphere(quick=quick),
        seconds=time.perf_counter() - started,
    )


def _check(view: View, rows: list[Future[ExactRows]], bar: Any) -> ViewCheck:
    """Trace a view, wait for its exact rows and compare."""
    started = time.perf_counter()
    image = Reference(view.scene).trace(view.aperture)
    assert image.certainty is not None
    assert image.overruled is not None
    parts = []
    for part in rows:
        parts.append(part.result())
        bar.update(parts[-1].triangle.size)
    exact = ExactRows(
        triangle=np.concatenate([part.triangle for part in parts]),
        s=np.concatenate([part.s for part in parts]),
        ties=np.concatenate([part.ties for part in parts]),
    )
    pencil = crossed_frustum(view.scene.frustum, view.aperture)
    found = disagreements(image, exact, pencil, view.scene.triangles)
    counts = np.bincount(image.certainty.ravel(), minlength=len(Certainty))
    return ViewCheck(
        scene=view.name,
        aperture=view.aperture.index,
        resolution=pencil.resolution,
        pixels=image.triangle.size,
        covered=int(image.covered.sum()),
        proven=int(counts[Certainty.PROVEN]),
        exact=int(counts[Certainty.EXACT]),
        ties=int(counts[Certainty.TIE]),
        wrong=int(found.wrong.sum()),
        disagreements=found.listed,
        tracer_wrong=int(image.overruled.sum()),
        seconds=time.perf_counter() - started,
    )


def _exact_rows(view: View, pool: Executor) -> Iterator[Future[ExactRows]]:
    """Submit a view to the pool in bands of rows."""
    pencil = crossed_frustum(view.scene.frustum, view.aperture)
    width, height = pencil.resolution
    step = max(1, MAX_TASK_PIXELS // width)
    for start in range(0, height, step):
        rows = range(start, min(start + step, height))
        yield pool.submit(first_by_brute_force, view.scene.triangles, pencil, rows)


class _HereAndNow(Executor):
    """An executor that computes every task at once, in this process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


@contextmanager
def _pool(processes: int) -> Iterator[Executor]:
    """Yield processes that inherit no thread, no lock and no OpenGL context: spawned, not forked."""
    if processes == 1:
        yield _HereAndNow()
        return
    pool = ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn"))
    try:
        yield pool
    finally:
        # After an error the remaining tasks are dropped.
        pool.shutdown(cancel_futures=True)


def _progress_bar(chosen: list[View], shown: bool) -> Any:
    pixels = sum(int(np.prod(view.scene.frustum.resolution)) for view in chosen)
    return tqdm(total=pixels, unit="px", unit_scale=True, disable=not shown)
