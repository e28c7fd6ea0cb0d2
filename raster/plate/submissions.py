"""Submissions to the device: how many hogels one draws, and the buffers it owns until it is read back."""

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
"""Largest size of one submission's attachments, so that a software renderer finds them in its caches."""
ROUND_BYTES = 1 << 25
"""Largest size of the attachments of one round of submissions, which bounds the memory."""
MAX_HOGELS = 4
"""Largest number of hogels in a submission, and of submissions in a round; more do not save more time."""
ROUNDS = 2
"""Number of rounds: one is drawn while the one before it is read back."""


@dataclass(frozen=True, kw_only=True)
class Batching:
    """The division of a stream of hogels into submissions and rounds.

    Attributes
    ----------
    hogels
        Hogels of one submission, which share clears and draws and have a layer each.
    submissions
        Submissions of one round, which are drawn one after the other, then read back together.
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
            The buffers of each pixel.
        layered
            Whether the device can draw on several layers at once.
        """
        hogel_bytes = form.bytes_per_pixel * size[0] * size[1]
        hogels = _within(MAX_HOGELS, SUBMISSION_BYTES // hogel_bytes) if layered else 1
        return cls(hogels=hogels, submissions=_within(MAX_HOGELS, ROUND_BYTES // (hogels * hogel_bytes)))

    @property
    def hogels_in_memory(self) -> int:
        """Largest number of hogels that are being drawn or read back at any time."""
        return ROUNDS * self.submissions * self.hogels


@dataclass(frozen=True, kw_only=True, eq=False)
class Slot:
    """The target and buffers that one submission owns until it has been read.

    Attributes
    ----------
    target
        Target with a layer for each hogel.
    hogels
        Buffers with the matrices of the hogels, one for each camera; see `program.hogel_block`.
    commands
        Buffers with the draws, by drawing and camera.
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
        Number of hogels and submissions.
    make_target
        Makes the target of one slot.
    counts
        Number of drawings and of cameras.
    """
    drawings, cameras = counts

    def buffers(reserve: int) -> list[moderngl.Buffer]:
        return [context.buffer(reserve=reserve, dynamic=True) for _ in range(cameras)]

    def slot() -> Slot:
        # These buffers grow as needed.
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
