"""Threads that run tasks side by side are ended, also where some of them cannot start."""

from __future__ import annotations

import threading

import pytest

from xfrustum.compare.judging.in_order import in_order, workers

LONGEST_WAIT_S = 60.0
"""Time after which a command that has not ended counts as waiting for ever."""


@pytest.mark.parametrize("started", [0, 1, 3])
def test_threads_that_cannot_start_are_an_error_and_nothing_waits_for_them(
    monkeypatch: pytest.MonkeyPatch, started: int
) -> None:
    starts: list[str] = []
    start = threading.Thread.start

    def limited(thread: threading.Thread) -> None:
        if thread.name.startswith("scarce"):
            starts.append(thread.name)
            if len(starts) > started:
                raise RuntimeError("can't start new thread")
        start(thread)

    found: list[str] = []

    def opened() -> None:
        try:
            with workers("scarce", 4):
                found.append("opened")
        except RuntimeError as error:
            found.append(str(error))

    monkeypatch.setattr(threading.Thread, "start", limited)
    opening = threading.Thread(target=opened, daemon=True)
    opening.start()
    opening.join(LONGEST_WAIT_S)
    assert found == ["can't start new thread"]
    assert not any(thread.name.startswith("scarce") for thread in threading.enumerate())


def test_threads_that_have_nothing_to_do_are_ended() -> None:
    for _ in range(50):
        with workers("idle", 4):
            pass
    assert not any(thread.name.startswith("idle") for thread in threading.enumerate())


def test_results_come_in_order_and_errors_in_their_places() -> None:
    with workers("ordered", 2) as pool:
        results = in_order(pool, lambda n: 12 // n, (4, 3, 0, 1), most=3)
        assert [next(results), next(results)] == [3, 4]
        with pytest.raises(ZeroDivisionError):
            next(results)
