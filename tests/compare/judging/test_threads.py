"""What threads share: the first error of a tracing thread, and the image beside which another is judged."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any, cast

import pytest

from xfrustum.compare.judging.charging import Charging, chain_start
from xfrustum.compare.judging.groups import Batched
from xfrustum.compare.judging.stopwatch import Machine, Stopwatch
from xfrustum.compare.judging.threads import TracingThread
from xfrustum.compare.metrics.error_maps import JudgedImage
from xfrustum.reference import Reference
from xfrustum.scenes import Plate
from xfrustum.scenes.plate.plate import Aperture


class Broken:
    """A reference whose second truth cannot be traced."""

    def stream(self, apertures: Iterator[Aperture], *, colored: bool) -> Iterator[str]:
        for number, _ in enumerate(apertures):
            if number == 1:
                raise ArithmeticError("the second one")
            yield "traced"


def test_all_that_is_traced_after_an_error_ends_with_this_error() -> None:
    aperture = Plate(size=(2.0, 1.0), hogels=(2, 1)).aperture(0, 0)
    with ThreadPoolExecutor(1) as thread:
        tracing = TracingThread(cast("Reference", Broken()), thread, Machine(apart=False), colored=False)
        asked: list[Future[Any]] = [tracing.submit(aperture, Stopwatch()) for _ in range(4)]
        assert asked[0].result() == "traced"
        for future in asked[1:]:
            with pytest.raises(ArithmeticError, match="the second one"):
                future.result()


def test_what_is_found_of_the_image_beside_another_is_found_once() -> None:
    task: Future[Any] = Future()
    task.set_result([SimpleNamespace(errors=None)])
    compared: Batched[Any] = Batched(task=task, place=0)

    def start(image: object, beside: Callable[[], JudgedImage]) -> Callable[[], JudgedImage]:
        return beside

    frame = SimpleNamespace(result=lambda: [SimpleNamespace(image="drawn")])
    exact = SimpleNamespace(result=lambda: "exact")
    charging = cast("Charging", SimpleNamespace(start=start))
    beside = cast("Any", chain_start(charging, cast("Any", exact), cast("Any", frame), compared))
    assert beside().image == "drawn"
    assert beside() is beside()
