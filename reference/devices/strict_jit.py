"""Dr.Jit as the certificate needs it: one recorder at a time, IEEE arithmetic, as many threads as wanted."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import drjit as dr
from drjit.llvm import UInt32

_ONE_AT_A_TIME = threading.Lock()
"""Lock for recording kernels, which Dr.Jit does once per process; a kernel itself uses all processors."""


@contextmanager
def strict_arithmetic() -> Iterator[None]:
    """Keep Dr.Jit to IEEE arithmetic: a proof must not depend on how a compiler rearranges it."""
    with _ONE_AT_A_TIME, dr.scoped_set_flag(dr.JitFlag.FastMath, False):
        yield


def run_kernels_on(threads: int) -> None:
    """Have kernels run on so many threads, as soon as no kernel runs and none is recorded.

    Dr.Jit does not keep kernels from being launched while it starts or ends threads, and holds Python's lock
    while it waits for the threads that it ends. This must not be called within `strict_arithmetic`.
    """
    with _ONE_AT_A_TIME:
        UInt32(0)  # a thread waits for kernels only once it has made an array
        dr.sync_thread()
        dr.set_thread_count(threads)
