"""Dr.Jit as the certificate needs it: one recorder at a time, and IEEE arithmetic."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import drjit as dr

_ONE_AT_A_TIME = threading.Lock()
"""Lock for recording kernels, which Dr.Jit does once per process; a kernel itself uses all processors."""


@contextmanager
def strict_arithmetic() -> Iterator[None]:
    """Keep Dr.Jit to IEEE arithmetic: a proof must not depend on how a compiler rearranges it."""
    with _ONE_AT_A_TIME, dr.scoped_set_flag(dr.JitFlag.FastMath, False):
        yield
