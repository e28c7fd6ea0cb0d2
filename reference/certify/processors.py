"""The choice between Dr.Jit on LLVM and NumPy for the double-precision arithmetic."""

from __future__ import annotations

from functools import cache
from importlib import import_module

from xfrustum.reference.certify.narrow import NarrowPhase
from xfrustum.reference.certify.narrow_numpy import NumpyNarrowPhase
from xfrustum.reference.devices.dr_jit import OLDEST_LLVM, limit_threads, loaded_llvm, prepare_llvm
from xfrustum.reference.lines.lines import Pencil


@cache
def compiled() -> bool:
    """Return whether Dr.Jit can compile on this machine, and bound its threads if so."""
    prepare_llvm()
    version = loaded_llvm()
    if version is None or version[0] < OLDEST_LLVM:
        return False
    limit_threads()
    return True


def narrow_phase(pencil: Pencil, rows: range) -> NarrowPhase:
    """Return the narrow phase of some rows of an image, compiled where that is possible."""
    if not compiled():
        return NumpyNarrowPhase(pencil, rows)
    # Imported only here, because Dr.Jit's arrays need the LLVM that `compiled` has chosen.
    phase: type[NarrowPhase] = import_module("xfrustum.reference.certify.narrow_jit").JitNarrowPhase
    return phase(pencil, rows)
