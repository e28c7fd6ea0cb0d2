"""How many hogels are drawn at once, and what each submission owns while it is on its way."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import TypeVar

import moderngl

from xfrustum.raster.plate.geometry import DRAW_COMMAND
from xfrustum.raster.plate.program import HOGEL
from xfrustum.raster.plate.targets import LayeredTarget, TargetFormat

_Item = TypeVar("_Item")

SUBMISSION_BYTES = 1 << 20
"""Attachments of one submission: what a processor that draws in software keeps close by."""
ROUND_BYTES = 1 << 25
"""Attachments of one round of submissions: what a process can spare."""
MOST_HOGELS = 4
"""Of a submission, and submissions of a round: more save no time that is left to save."""
ROUNDS = 2
"""One is drawn while the one before is read back."""


@dataclass(frozen=True, kw_only=True)
class Batching:
    """How a stream of hogels is cut into submissions.

    Attributes
    ----------
    hogels
        Of one submission: they share clears and draws, on a layer each.
    submissions
        Of one round: drawn one after the other, then read back together.
    """

    hogels: int
    submissions: int

    @classmethod
    def of(cls, size: tuple[int, int], form: TargetFormat, *, layered: bool) -> Batching:
        """Return the batching of images of some size.

        Parameters
        ----------
        size
            W, H in pixels.
        form
            What a pixel consists of.
        layered
            Whether the device can draw on several layers at once.
        """
        hogel_bytes = form.bytes_per_pixel * size[0] * size[1]
        hogels = _within(MOST_HOGELS, SUBMISSION_BYTES // hogel_bytes) if layered else 1
        return cls(hogels=hogels, submissions=_within(MOST_HOGELS, ROUND_BYTES // (hogels * hogel_bytes)))

    @property
    def hogels_in_memory(self) -> int:
        """How many hogels are drawn or on their way back at any time, at most."""
        return ROUNDS * self.submissions * self.hogels


@dataclass(frozen=True, kw_only=True, eq=False)
class Slot:
    """What one submission owns until it has been read: a target, and what each camera draws.

    Attributes
    ----------
    target
        With a layer for each hogel.
    hogels
        By camera, see `plate_program.hogel_block`.
    commands
        By drawing and camera.
    """

    target: LayeredTarget
    hogels: list[moderngl.Buffer]
    commands: list[list[moderngl.Buffer]]


def make_rounds(
    context: moderngl.Context,
    batching: Batching,
    make_target: Callable[[], LayeredTarget],
    counts: tuple[int, int],
) -> list[list[Slot]]:
    """Return the slots of every round.

    Parameters
    ----------
    context
        The current context.
    batching
        How many there are.
    make_target
        Makes a target for one.
    counts
        Of drawings and of cameras.
    """
    drawings, cameras = counts

    def buffers(reserve: int) -> list[moderngl.Buffer]:
        return [context.buffer(reserve=reserve, dynamic=True) for _ in range(cameras)]

    def slot() -> Slot:
        # What a camera draws grows as needed.
        commands = [buffers(DRAW_COMMAND.itemsize) for _ in range(drawings)]
        return Slot(target=make_target(), hogels=buffers(HOGEL.itemsize * batching.hogels), commands=commands)

    return [[slot() for _ in range(batching.submissions)] for _ in range(ROUNDS)]


def groups(items: Iterable[_Item], size: int) -> Iterator[list[_Item]]:
    """Yield consecutive items, `size` at a time."""
    rest = iter(items)
    while group := list(islice(rest, size)):
        yield group


def _within(most: int, wanted: int) -> int:
    return max(1, min(most, wanted))
