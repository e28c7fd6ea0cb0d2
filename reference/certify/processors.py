"""What the double-precision arithmetic runs on: Dr.Jit on LLVM, or NumPy where there is none."""

from __future__ import annotations

from functools import cache
from importlib import import_module

from xfrustum.reference.certify.narrow import NarrowPhase
from xfrustum.reference.certify.narrow_numpy import NumpyNarrowPhase
from xfrustum.reference.devices.dr_jit import OLDEST_LLVM, loaded_llvm, prepare_llvm
from xfrustum.reference.lines.lines import Pencil


@cache
def compiled() -> bool:
    """Return whether Dr.Jit can compile here."""
    prepare_llvm()
    version = loaded_llvm()
    return version is not None and version[0] >= OLDEST_LLVM


def narrow_phase(pencil: Pencil, rows: range) -> NarrowPhase:
    """Return the narrow phase of some rows of an image on the fastest arithmetic there is."""
    if not compiled():
        return NumpyNarrowPhase(pencil, rows)
    # Only now: importing Dr.Jit's arrays needs the LLVM that was chosen above.
    phase: type[NarrowPhase] = import_module("xfrustum.reference.certify.narrow_jit").JitNarrowPhase
    return phase(pencil, rows)
