"""Tasks that run side by side, a bounded number at a time, and whose results come in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from threading import Barrier
from typing import TypeVar

from xfrustum.reference.devices.threads import worker_count

Item = TypeVar("Item")
Result = TypeVar("Result")

MAX_CONCURRENT_PIXELS = 1 << 23
"""Largest number of pixels of all images that are judged or wait for it, unless two images have more. An
image takes about 240 bytes a pixel with its truth, which lies on the device as well, and its error maps, so
that this is 2 GB."""

MIN_PIXELS_UNDER_WAY = 1 << 19
"""Smallest number of pixels of all images that are judged or wait for it, where each image is small: judging
one takes so little time that several have to be there for a thread, lest the thread waits."""


def images_under_way(pixels: int) -> int:
    """Return how many images of so many pixels are judged or wait for it at a time."""
    wanted = max(worker_count() + 1, MIN_PIXELS_UNDER_WAY // pixels)
    return max(2, min(wanted, MAX_CONCURRENT_PIXELS // pixels))


@contextmanager
def workers(name: str, count: int | None = None) -> Iterator[ThreadPoolExecutor]:
    """Open threads, as many as there are processors unless told otherwise; leaving ends them.

    What has not begun by then is cancelled, and what has begun is waited for.

    Raises
    ------
    RuntimeError
        The machine cannot start so many threads; those that it has started are ended.
    """
    count = worker_count() if count is None else count
    pool = ThreadPoolExecutor(count, thread_name_prefix=name)
    all_started = Barrier(count)
    try:
        # All threads start here, where no signal interrupts a command, and not at the first tasks: a thread
        # whose start was interrupted would never be ended.
        for _ in range(count):
            pool.submit(all_started.wait)
        yield pool
    finally:
        # Threads that wait for one that never starts would wait for ever.
        all_started.abort()
        pool.shutdown(wait=True, cancel_futures=True)


def in_order(
    pool: Executor, function: Callable[[Item], Result], items: Iterable[Item], most: int
) -> Iterator[Result]:
    """Yield what a function makes of each item, in the order of the items.

    Items are taken in the thread of the caller, a bounded number ahead of what it has been given. An
    exception of a task comes to the caller in the place of its result.

    Parameters
    ----------
    pool
        Threads in which the function runs.
    function
        Function of one item.
    items
        Items, as many as one likes.
    most
        Largest number of items whose results the caller has not been given yet.
    """
    waiting: deque[Future[Result]] = deque()
    try:
        for item in items:
            waiting.append(pool.submit(function, item))
            while waiting and (len(waiting) >= most or waiting[0].done()):
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for one in waiting:
            one.cancel()
