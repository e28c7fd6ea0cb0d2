"""The process of a command: freed memory goes to what is allocated next, and what is loaded is left alone."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from xfrustum.cli.process import KEPT_BYTES, keep_freed_memory

PROGRAM = """
import resource
import numpy as np
from xfrustum.cli.process import KEPT_BYTES, keep_freed_memory

def pages():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

def images():
    for image in [np.ones(1 << 18) for _ in range(COUNT)]:
        assert image[-1] == 1

kept = keep_freed_memory()
images()
before = pages()
for _ in range(4):
    images()
print(int(kept), pages() - before)
"""
COUNT = KEPT_BYTES // 2 // (8 << 18)


def pages_of_later_images(**environment: str) -> tuple[bool, int]:
    """Return whether memory is kept, and the pages that images are given anew where others were freed."""
    ours = {name: value for name, value in os.environ.items() if not name.startswith(("MALLOC_", "GLIBC_"))}
    command = [sys.executable, "-c", PROGRAM.replace("COUNT", str(COUNT))]
    told = subprocess.run(command, env=ours | environment, capture_output=True, text=True, check=True)
    kept, pages = map(int, told.stdout.split())
    return bool(kept), pages


@pytest.mark.skipif(sys.platform != "linux", reason="other C libraries have no such choice")
def test_images_take_the_memory_of_those_that_were_freed() -> None:
    kept, pages = pages_of_later_images()
    if not kept:
        pytest.skip("the C library is not glibc")
    size = os.sysconf("SC_PAGE_SIZE")
    all_pages = KEPT_BYTES / 2 / size
    assert COUNT > 1
    assert pages < all_pages / 10
    # The user may have each image given back, and then all pages of the four rounds are new.
    kept, pages = pages_of_later_images(MALLOC_MMAP_THRESHOLD_="131072")
    assert not kept and pages > 3 * all_pages


def test_what_the_user_has_told_the_c_library_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "131072")
    assert not keep_freed_memory()


def test_the_garbage_collector_passes_over_what_is_loaded() -> None:
    program = """
import gc
from xfrustum.cli.process import keep_loaded_objects

before = len(gc.get_objects())
keep_loaded_objects()
print(before, gc.get_freeze_count(), len(gc.get_objects()))
"""
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    before, left_alone, looked_at = map(int, told.stdout.split())
    assert left_alone >= before > 100 * looked_at


def test_threads_hand_python_to_each_other_soon() -> None:
    program = "import sys; from xfrustum.cli import process as p; p.share_python_often(); "
    told = subprocess.run(
        [sys.executable, "-c", program + "print(sys.getswitchinterval() / p.SWITCH_S)"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert float(told.stdout) == pytest.approx(1, abs=1e-2)
