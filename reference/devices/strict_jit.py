"""Dr.Jit as the certificate needs it: one recorder at a time, and IEEE arithmetic."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import drjit as dr

_ONE_AT_A_TIME = threading.Lock()
"""Dr.Jit records per process; its kernels themselves use all processors."""


@contextmanager
def strict_arithmetic() -> Iterator[None]:
    """Hold Dr.Jit to IEEE arithmetic: a proof must not rest on a compiler's liberties."""
    with _ONE_AT_A_TIME, dr.scoped_set_flag(dr.JitFlag.FastMath, False):
        yield
