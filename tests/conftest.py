"""Fixtures for every test."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import settings

# The same examples in every run, however long one takes on a loaded machine.
settings.register_profile("xfrustum", derandomize=True, deadline=None)
settings.load_profile("xfrustum")

CHECKOUT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of test data beside the checkout; tests that need it skip where it is not there."""
    folder = CHECKOUT.parent / "shared"
    if not folder.is_dir():
        pytest.skip("needs ../shared, the folder of test data beside the checkout, which is not here")
    return folder


@cache
def on_one_thread(drjit: ModuleType) -> None:
    """Let Dr.Jit's kernels run on one thread.

    Its threads wait busily for some 20 ms after each kernel. The kernels of small films take less than one
    millisecond, so that several threads would take up to four times the processors' time, and save none.
    """
    drjit.set_thread_count(1)


def pytest_runtest_setup() -> None:
    """Bound the threads as soon as some test has loaded Dr.Jit: most never do."""
    if "drjit" in sys.modules:
        on_one_thread(sys.modules["drjit"])
