"""The choice between Dr.Jit on LLVM and NumPy, and of the number of threads that run Dr.Jit's kernels.

Dr.Jit's threads wait busily for a while after each kernel. With small images this takes more of the
processors than the kernels themselves, and takes it from what runs beside them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache
from importlib import import_module
from threading import Lock

from xfrustum.reference.certify.narrow import NarrowPhase
from xfrustum.reference.certify.narrow_numpy import NumpyNarrowPhase
from xfrustum.reference.devices.dr_jit import OLDEST_LLVM, limit_threads, loaded_llvm, prepare_llvm
from xfrustum.reference.lines.lines import Pencil


def compiled() -> bool:
    """Return whether Dr.Jit can compile on this machine, and bound its threads if so."""
    # Threads that ask first at once must not set the number of threads one after the other.
    with _ASKING:
        return _compiled()


_ASKING = Lock()
"""Lock of those who ask whether Dr.Jit can compile."""


@cache
def _compiled() -> bool:
    prepare_llvm()
    version = loaded_llvm()
    if version is None or version[0] < OLDEST_LLVM:
        return False
    limit_threads()
    _BOUND.be_ready()
    return True


def narrow_phase(pencil: Pencil, rows: range) -> NarrowPhase:
    """Return the narrow phase of some rows of an image, compiled where that is possible."""
    if not compiled():
        return NumpyNarrowPhase(pencil, rows)
    # Imported only here, because Dr.Jit's arrays need the LLVM that `compiled` has chosen.
    phase: type[NarrowPhase] = import_module("xfrustum.reference.certify.narrow_jit").JitNarrowPhase
    return phase(pencil, rows)


BUSY_WAIT_S = 0.02
"""Longest time for which each of Dr.Jit's threads waits busily after a kernel before it sleeps."""

KERNEL_PIXEL_S = 4e-8
"""Time that one thread takes for a pixel in the longest kernel of a truth: twice the 1.9e-8 s of scenes of
40,000 triangles at 512 x 512, for deeper scenes take longer."""

MAX_SHORT_PIXELS = round(BUSY_WAIT_S / KERNEL_PIXEL_S)
"""Largest number of pixels, or of points, whose kernels run on one thread.

A kernel that takes a time T on one thread takes T/n on n of them, and then n - 1 of these wait busily for up
to W = `BUSY_WAIT_S`: they occupy T + (n - 1) W of the processors' time. On one thread it occupies T, and even
if nothing else has work for the other n - 1 processors meanwhile, no more than n T are gone. One thread is
the better choice where n T <= T + (n - 1) W, which is T <= W, however many processors there are. T grows with
the pixels, by `KERNEL_PIXEL_S`."""


class _Bound:
    """Count of those who want kernels on one thread, and the number of threads where nobody does."""

    def __init__(self) -> None:
        self._lock, self._wanted, self._lifted = Lock(), 0, 0
        self._ready = self._bound = False
        self._before = 0

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Bound the threads for as long as the block runs; before Dr.Jit is ready, as soon as it is."""
        try:
            with self._lock:
                self._wanted += 1
                self._settle()
            yield
        finally:
            with self._lock:
                self._wanted -= 1
                self._settle()

    def be_ready(self) -> None:
        """Bound the threads if anybody wants that, now that Dr.Jit is there."""
        with self._lock:
            self._ready = True
            self._settle()

    @contextmanager
    def lifted(self) -> Iterator[None]:
        """Give the threads back for as long as the block runs, whoever wants one."""
        try:
            with self._lock:
                self._lifted += 1
                self._settle()
            yield
        finally:
            with self._lock:
                self._lifted -= 1
                self._settle()

    def _settle(self) -> None:
        """Have kernels run on as many threads as are wanted now."""
        bound = self._wanted > 0 and not self._lifted
        if not self._ready or bound == self._bound:
            return
        if bound:
            self._before = import_module("drjit").thread_count()
        if self._before > 1:
            _run_kernels_on(1 if bound else self._before)
        self._bound = bound


def _run_kernels_on(threads: int) -> None:
    # Imported only here, because Dr.Jit's arrays need the LLVM that `compiled` has chosen.
    import_module("xfrustum.reference.devices.strict_jit").run_kernels_on(threads)


_BOUND = _Bound()
"""The bound of this process: Dr.Jit has one pool of threads."""


def kernels_on_one_thread(pixels: int) -> AbstractContextManager[None]:
    """Have Dr.Jit's kernels run on one thread, of all of the process, unless images are large.

    Kernels that are running end first, so this must not be entered or left within `strict_arithmetic`.

    Parameters
    ----------
    pixels
        Pixels of an image, or points that are asked about: above `MAX_SHORT_PIXELS` nothing is changed.
    """
    return nullcontext() if pixels > MAX_SHORT_PIXELS else _BOUND.kept()


def kernels_on_all_threads() -> AbstractContextManager[None]:
    """Have kernels run on all threads within `kernels_on_one_thread`, while nothing else runs."""
    return _BOUND.lifted()
