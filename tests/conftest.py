"""Fixtures for all tests."""

from __future__ import annotations

import gc
import os
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tests.support.commands import Command
    from tests.support.worlds import World

# NumPy's libraries wait in busy loops for their threads, and Mesa's software renderer wakes its
# threads for each call. Small matrices and films do not need threads (`on_one_thread`). For Mesa, 0
# means none.
THREADS = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "0"}
for name, count in THREADS.items():
    os.environ.setdefault(name, count)

EXAMPLES, EXAMPLES_EVERY_TIME = 100, 25  #: hypothesis's examples with and without slow tests

CHECKOUT = Path(__file__).resolve().parents[1]


def pytest_configure(config: pytest.Config) -> None:
    """Use the same examples in every run, without a deadline on a loaded machine."""
    count = EXAMPLES_EVERY_TIME if "not slow" in config.option.markexpr else EXAMPLES
    settings.register_profile("xfrustum", derandomize=True, deadline=None, max_examples=count)
    settings.load_profile("xfrustum")
    gc.disable()  # until all modules are loaded: they are no garbage


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of test data beside the checkout; skip the test if it is missing."""
    folder = CHECKOUT.parent / "shared"
    if not folder.is_dir():
        pytest.skip("needs ../shared, the folder of test data beside the checkout")
    return folder


def _worlds() -> Any:
    """Return the module of worlds; a late import, as it loads the whole product."""
    return import_module("tests.support.worlds")


@pytest.fixture(scope="session")
def centered() -> World:
    """Return `asymmetric` at 64 x 48 pixels, 5 x 4 hogels: different parts on each side."""
    made: World = _worlds().world("asymmetric")
    return made


@pytest.fixture(scope="session")
def recentered() -> World:
    """Return `asymmetric-recentered` at 64 x 48 pixels, 5 x 4 hogels: an off-center screen."""
    made: World = _worlds().world("asymmetric-recentered")
    return made


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> World:
    """Return a scene of three shapes at 32 x 24 pixels, 5 x 4 hogels, with files of its images."""
    made: World = _worlds().tiny_world(tmp_path_factory.mktemp("tiny"))
    return made


@pytest.fixture(scope="session", params=["centered", "recentered", "tiny"])
def world(request: pytest.FixtureRequest) -> World:
    """Return each of the three worlds in turn."""
    made: World = request.getfixturevalue(request.param)
    return made


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Command:
    """Return a function that runs a command line: `command("scenes --json").record`."""
    made: Command = import_module("tests.support.commands").command_of(capsys)
    return made


@pytest.fixture(autouse=True, scope="session")
def records_follow_their_schemas() -> Iterator[None]:
    """Check every JSON object that a command prints in a test against its schema."""
    options = import_module("xfrustum.cli.options")
    printed = options.Printed.tell

    def checked(self: Any, summary: Callable[[], Any], text: Callable[[], str]) -> None:
        if self.as_json:
            record = summary()
            import_module("tests.support.records").check_printed(record)
            printed(self, lambda: record, text)
        else:
            printed(self, summary, text)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(options.Printed, "tell", checked)
        yield


@cache
def on_one_thread(drjit: ModuleType) -> None:
    """Run Dr.Jit's kernels on one thread.

    Dr.Jit's threads spin for about 20 ms after each kernel, but kernels of small films take less
    than one millisecond. Several threads would cost up to four times the CPU time, without being
    faster.
    """
    drjit.set_thread_count(1)


def pytest_runtest_setup() -> None:
    """Limit threads as soon as a test has loaded Dr.Jit: most test runs never load it."""
    if "drjit" in sys.modules:
        on_one_thread(sys.modules["drjit"])


def pytest_collection_finish() -> None:
    """Exempt loaded modules from garbage collection: each search of them costs CPU time."""
    gc.enable()
    gc.freeze()
