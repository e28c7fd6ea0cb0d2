"""What threads share: errors, the frames of a turn, and the image beside which another is judged."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any, cast
from weakref import ref

import pytest

from xfrustum.compare.judging.charging import Charging, chain_start
from xfrustum.compare.judging.frames import draw_turn
from xfrustum.compare.judging.groups import Batched
from xfrustum.compare.judging.parts import Part
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

    def start(
        settings: object, exact: object, beside: Callable[[], JudgedImage]
    ) -> Callable[[], JudgedImage]:
        return beside

    frame = SimpleNamespace(result=lambda: [SimpleNamespace(image="drawn", settings=None)])
    exact = SimpleNamespace(result=lambda: "exact")
    charging = cast("Charging", SimpleNamespace(start=start))
    beside = cast("Any", chain_start(charging, cast("Any", exact), cast("Any", frame), compared))
    assert beside().image == "drawn"
    assert beside() is beside()


class Still:
    """A rasterizer whose pictures are objects, one of which cannot be drawn."""

    def __init__(self, broken: object = None) -> None:
        self.drawn: list[object] = []
        self._broken = broken

    def draw(self, aperture: Aperture, settings: object, **how: bool) -> Picture:
        if settings == self._broken:
            raise ArithmeticError("no picture")
        self.drawn.append(settings)
        return Picture()


class Picture:
    """A picture that somebody may or may not keep."""


def turn_of(rasterizer: Still, drawn: list[Future[Any]]) -> None:
    """Draw a turn of as many parts as there are futures, each of one setting: its number."""
    aperture = Plate(size=(2.0, 1.0), hogels=(2, 1)).aperture(0, 0)
    parts = [cast(Part, SimpleNamespace(settings=(number,))) for number in range(len(drawn))]
    machine = Machine(apart=True)
    draw_turn(machine, aperture, cast("Any", rasterizer), parts=parts, drawn=drawn, color=False)


def test_a_frame_is_freed_while_others_of_its_turn_wait() -> None:
    first, second = Future[Any](), Future[Any]()
    turn_of(Still(), [first, second])
    picture = ref(first.result()[0].drawn)
    del first
    assert picture() is None
    assert isinstance(second.result()[0].drawn, Picture)


def test_frames_that_nobody_wants_any_more_are_not_drawn() -> None:
    rasterizer, drawn = Still(), [Future[Any]() for _ in range(3)]
    drawn[1].cancel()
    turn_of(rasterizer, drawn)
    assert rasterizer.drawn == [0, 2]


def test_all_that_wait_for_a_turn_are_told_its_error() -> None:
    drawn = [Future[Any]() for _ in range(3)]
    with pytest.raises(ArithmeticError, match="no picture"):
        turn_of(Still(broken=1), drawn)
    for one in drawn:
        with pytest.raises(ArithmeticError, match="no picture"):
            one.result()
