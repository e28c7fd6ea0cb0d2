"""LLVM or CUDA for Dr.Jit, Mitsuba's variant, and the number of threads of a process.

Dr.Jit selects an LLVM at its first import. It refuses version 14, and with 15 and 16 the *process*
ends inside the first kernel ("Cannot select: ... fmaximum"). This module therefore selects the
library by version, and sets `DRJIT_LIBLLVM_PATH` before Dr.Jit is imported.
"""

import ctypes
import importlib
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from xfrustum.scenes.arguments import InputError

#: Environment variable that Dr.Jit reads first. If it is set, no other library is considered.
LLVM_VARIABLE = "DRJIT_LIBLLVM_PATH"

CACHE_VARIABLE = "DRJIT_CACHE_DIR"  # environment variable that names the folder of compiled kernels

#: Oldest version in use: Dr.Jit refuses 14; its minimum and maximum abort with 15 and 16
OLDEST_LLVM = 17

#: preferred version; otherwise the nearest version is taken
TESTED_LLVM = 19

#: Text in place of a library's path if Dr.Jit was imported before this module could choose one
FOUND_BY_DRJIT = "none: Dr.Jit found none when it was imported"

#: Environment variable with the largest number of threads of a process, so that several workers can
#: share the machine. Thread pools of ray tracers ignore the CPU affinity of the process.
THREADS_VARIABLE = "XFRUSTUM_THREADS"

#: Environment variable for the device of Dr.Jit's arrays, and its values. `auto`, the default,
#: selects CUDA if Dr.Jit detects an NVIDIA GPU
DEVICE_VARIABLE, DEVICES = "XFRUSTUM_DEVICE", ("auto", "llvm", "cuda")

Version = tuple[int, int, int]


@cache
def array_device() -> str:
    """Return the device of Dr.Jit's arrays, `cuda` or `llvm`; InputError if there is none."""
    if _cuda_card():
        return "cuda"
    require_llvm()
    return "llvm"


@cache
def _cuda_card() -> bool:
    """Return whether to use CUDA; InputError if the environment requests a missing device."""
    device = os.environ.get(DEVICE_VARIABLE) or "auto"
    if device not in DEVICES:
        raise InputError(f"{DEVICE_VARIABLE} is {device!r}: set it to one of {', '.join(DEVICES)}")
    if device == "llvm":
        return False
    available = False
    # Without a driver, calls of Dr.Jit print messages.
    with suppress(OSError, AttributeError):
        if ctypes.CDLL(os.environ.get("DRJIT_LIBCUDA_PATH") or "libcuda.so.1").cuInit(0) == 0:
            prepare_llvm()
            drjit = importlib.import_module("drjit")
            available = drjit.has_backend(drjit.JitBackend.CUDA)
    if device == "cuda" and not available:
        raise InputError(
            f"{DEVICE_VARIABLE} or --arrays requests cuda, and Dr.Jit has no NVIDIA card on this "
            "machine: install a driver from version 535 on (`nvidia-smi` lists its cards), or "
            "choose llvm or auto"
        )
    return available


def worker_count() -> int:
    """Return the number of CPUs of this process, at most the limit of `THREADS_VARIABLE`."""
    available = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    named = thread_limit()
    return available if named is None else min(named, available)


def thread_limit() -> int | None:
    """Return the largest number of threads by `THREADS_VARIABLE`; None if it is not set."""
    named = os.environ.get(THREADS_VARIABLE, "")
    return max(1, int(named)) if named.isdecimal() else None


@cache
def require_llvm() -> None:
    """Prepare Dr.Jit for CPUs, with the allowed threads; InputError without a usable LLVM."""
    library = prepare_llvm()
    # Without an LLVM, a call of Dr.Jit would print messages.
    version = None if library.startswith("none: ") and library != FOUND_BY_DRJIT else loaded_llvm()
    if version is None or version[0] < OLDEST_LLVM:
        raise InputError(
            f"the truth is compiled by LLVM {OLDEST_LLVM} or newer ({library}): install it, for "
            f"example by `apt install libllvm{TESTED_LLVM}`, or name its library in {LLVM_VARIABLE}"
        )
    _limit_threads()


@cache
def _limit_threads() -> None:
    limit = thread_limit()
    if limit is not None:
        importlib.import_module("drjit").set_thread_count(limit)


@dataclass(frozen=True, kw_only=True)
class MitsubaBackend:
    """Mitsuba with a variant set; `llvm` is the version in use, or the reason for none."""

    mitsuba: Any
    drjit: Any
    variant: str
    llvm: str

    @property
    def scalar(self) -> bool:
        """True if Mitsuba traces one ray at a time."""
        return self.variant.startswith("scalar")

    @property
    def versions(self) -> dict[str, str]:
        """Names and versions for reports."""
        return {
            "mitsuba": self.mitsuba.__version__,
            "mitsuba variant": self.variant,
            "llvm": self.llvm,
        }


def mitsuba_backend() -> MitsubaBackend:
    """Return Mitsuba with this machine's best variant; InputError for an LLVM that would abort."""
    llvm = prepare_llvm()
    mitsuba = importlib.import_module("mitsuba")
    version = loaded_llvm()
    usable = version is not None and version[0] >= OLDEST_LLVM
    if version is not None:
        llvm = ".".join(map(str, version)) + (
            "" if usable else f", not used: older than {OLDEST_LLVM}"
        )
    # A variant set by the caller stays: objects of two variants do not mix.
    chosen = mitsuba.variant()
    if chosen is None:
        chosen = "cuda_ad_rgb" if cuda_works() else "llvm_ad_rgb" if usable else "scalar_rgb"
        mitsuba.set_variant(chosen)
    elif chosen.startswith("llvm") and not usable:
        raise InputError(
            f"Mitsuba's variant {chosen} is set on LLVM {llvm}, which would abort the process: set "
            f"{LLVM_VARIABLE} to an LLVM from {OLDEST_LLVM} on before mitsuba is imported, or take "
            "scalar_rgb"
        )
    _limit_threads()
    return MitsubaBackend(
        mitsuba=mitsuba, drjit=importlib.import_module("drjit"), variant=chosen, llvm=llvm
    )


def vector_backend() -> MitsubaBackend:
    """Return Mitsuba; InputError if its variant is scalar, which traces one ray at a time."""
    backend = mitsuba_backend()
    if backend.scalar:
        raise InputError(
            f"Mitsuba's variant {backend.variant} traces one ray at a time (LLVM {backend.llvm}): "
            "its rays and light transport need an LLVM or CUDA variant"
        )
    return backend


@cache
def prepare_llvm() -> str:
    """Set the LLVM of Dr.Jit before its import; return its path, or the reason for none."""
    if "drjit" in sys.modules:
        return FOUND_BY_DRJIT
    if (
        "HOME" not in os.environ
    ):  # Without HOME, Dr.Jit prints a message: name a cache folder in the user's home folder
        with suppress(RuntimeError):
            os.environ.setdefault(CACHE_VARIABLE, str(Path.home() / ".drjit"))
    named = os.environ.get(LLVM_VARIABLE)
    library = accepted_llvm([Path(named)] if named else installed_llvms())
    if library is None:
        where = f"{LLVM_VARIABLE} names none" if named else "none found"
        return f"none: {where} from version {OLDEST_LLVM} on"
    os.environ[LLVM_VARIABLE] = str(library)
    return str(library)


def accepted_llvm(
    libraries: Iterable[Path], ask: Callable[[Path], Version | None] | None = None
) -> Path | None:
    """Return the best library that Dr.Jit can compile with; None if there is none.

    Libraries are sorted and rejected by name first, so that few are loaded; `ask` returns a
    library's version.
    """
    ask = ask or asked_version
    named = [(named_version(library), library) for library in dict.fromkeys(libraries)]
    promising = [
        (major, library) for major, library in named if major is None or major >= OLDEST_LLVM
    ]
    promising.sort(
        key=lambda entry: (entry[0] is None, abs((entry[0] or 0) - TESTED_LLVM), str(entry[1]))
    )
    for _, library in promising:
        version = ask(library)
        if version is not None and version[0] >= OLDEST_LLVM:
            return library
    return None


def named_version(library: Path) -> int | None:
    """Return the major version in a library's name, with links resolved; None without a version."""
    match = re.search(r"libLLVM(?:\.so\.|-)(\d+)", library.resolve().name)
    return int(match[1]) if match else None


def asked_version(library: Path) -> Version | None:
    """Load a library and return its version; None if it is not LLVM 16 or newer."""
    try:
        get_version = ctypes.CDLL(str(library)).LLVMGetVersion
    except (OSError, AttributeError):
        # LLVMGetVersion came with LLVM 16.
        return None
    parts = (ctypes.c_uint(), ctypes.c_uint(), ctypes.c_uint())
    get_version(*(ctypes.byref(part) for part in parts))
    return parts[0].value, parts[1].value, parts[2].value


def installed_llvms() -> list[Path]:
    """Return the LLVM libraries of the dynamic linker and of the usual folders."""
    libraries: list[Path] = []
    # Use the loader's list first, then the folders, for systems without the list.
    ldconfig = shutil.which("ldconfig", path=os.pathsep.join((os.environ.get("PATH", ""), "/sbin")))
    if ldconfig is not None:
        listed = subprocess.run(
            [ldconfig, "-p"], capture_output=True, text=True, check=False
        ).stdout
        libraries.extend(Path(path) for path in re.findall(r"=> (\S*/libLLVM[-.]\S+)", listed))
    folders = [
        Path(folder) for folder in os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep) if folder
    ]
    folders += [Path(sys.prefix, "lib"), Path("/usr/local/lib"), Path("/usr/lib64")]
    folders += [*Path("/usr/lib").glob("llvm*/lib"), *Path("/usr/lib").glob("*-linux-gnu")]
    for folder in folders:
        libraries.extend(sorted(folder.glob("libLLVM[-.]*so*")))
    return libraries


def loaded_llvm() -> Version | None:
    """Return the version of the LLVM that Dr.Jit has loaded; None if it has loaded none."""
    drjit = importlib.import_module("drjit")
    if not drjit.has_backend(drjit.JitBackend.LLVM):
        return None
    version: Version = drjit.detail.llvm_version()
    return version


def cuda_works() -> bool:
    """Return whether CUDA is selected, and OptiX is available for tracing rays."""
    if not _cuda_card():
        return False
    try:
        ctypes.CDLL(os.environ.get("DRJIT_LIBOPTIX_PATH") or "libnvoptix.so.1")
    except OSError:
        return False
    return True
