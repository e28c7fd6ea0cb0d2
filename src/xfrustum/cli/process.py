"""The process of a command: how it keeps memory, and how its threads share Python.

Images of a few MB are made and freed thousands of times. The C library gives their memory back to the
system and asks for it anew, and the system clears each page of it when it is first written to: on a virtual
machine this takes almost a millisecond a MB.

Threads that judge images call NumPy and kernels for some milliseconds at a time, in which others run Python.
"""

from __future__ import annotations

import ctypes
import gc
import os
import sys

KEPT_ARRAY_BYTES = 1 << 25
"""Largest arrays whose memory is kept: the limit that glibc itself reaches where arrays of this size are
freed (`DEFAULT_MMAP_THRESHOLD_MAX`)."""

KEPT_BYTES = 2 * KEPT_ARRAY_BYTES
"""Largest number of freed bytes that are kept at the end of each heap: twice the above, as glibc has it."""

_MALLOPT = {-3: KEPT_ARRAY_BYTES, -1: KEPT_BYTES}
"""Values by the numbers that malloc.h gives to `M_MMAP_THRESHOLD` and `M_TRIM_THRESHOLD`."""

SWITCH_S = 5e-4
"""Longest time for which a thread that has ended a call waits for Python: a tenth of Python's own, and of
what such calls take."""


def keep_freed_memory() -> bool:
    """Have the C library keep freed memory for what is allocated next; return whether it will.

    The C library raises the same limits by itself once it has freed large arrays; here they are raised from
    the start. Nothing is changed where it is not glibc, or where the environment says what it should do.
    """
    if sys.platform != "linux" or any(name.startswith(("MALLOC_", "GLIBC_TUNABLES")) for name in os.environ):
        return False
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    return mallopt is not None and all(mallopt(number, value) == 1 for number, value in _MALLOPT.items())


def keep_loaded_objects() -> None:
    """Have Python's garbage collector pass over all objects that there are by now.

    Call it where everything is imported, for what is loaded stays until the process ends. To look through
    the objects of all modules takes a tenth of a second, in which all other threads wait.
    """
    gc.freeze()


def share_python_often() -> None:
    """Have threads hand Python to each other after `SWITCH_S`."""
    sys.setswitchinterval(SWITCH_S)
