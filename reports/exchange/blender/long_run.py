"""What a run of hours needs: an end by Ctrl-C that loses nothing, the time left, and a quiet terminal."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from typing import Any

TOLD_EVERY_S = 10.0
"""Time between two lines on how many hogels are done and how long the others take."""


def interruptions() -> list[int]:
    """Return a list that Ctrl-C adds to from now on, and ends nothing by itself.

    Cycles calls back into Python while it renders, and a KeyboardInterrupt that is raised there is lost.
    """
    pressed: list[int] = []

    def note(number: int, _frame: object) -> None:
        pressed.append(number)
        os.write(2, b"this hogel is finished first\n")

    signal.signal(signal.SIGINT, note)
    return pressed


def hide_known_complaints() -> None:
    """Leave out two harmless tracebacks of Blender as a Python module from now on.

    It lacks the module oslquery, which finds parameters of shaders; the camera here has none. And its
    renderers are asked for a session after they were removed.
    """
    shown, unraisable = sys.excepthook, sys.unraisablehook

    def show(kind: Any, error: BaseException, trace: Any) -> None:
        if not (isinstance(error, ImportError) and error.name == "oslquery"):
            shown(kind, error, trace)

    def show_unraisable(told: Any) -> None:
        if not (isinstance(told.exc_value, ReferenceError) and "CyclesRender" in str(told.exc_value)):
            unraisable(told)

    sys.excepthook, sys.unraisablehook = show, show_unraisable


def progress(hogels: int, say: Callable[[str], None]) -> Callable[[int], None]:
    """Return a function of the number of hogels that are done, which says at times how long the rest is."""
    start = time.monotonic()
    told = start

    def step(done: int) -> None:
        nonlocal told
        now = time.monotonic()
        if done < hogels and now - told >= TOLD_EVERY_S:
            told = now
            left = (now - start) / done * (hogels - done)
            say(f"{done} of {hogels} hogels done, about {left:.0f} s left")

    return step
