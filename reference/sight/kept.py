"""What was made last, kept for as many threads as there are, in bounded memory."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from threading import Lock
from typing import Generic, TypeVar

from xfrustum.reference.devices.threads import worker_count

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


@dataclass(kw_only=True, eq=False)
class Kept(Generic[Key, Value]):
    """A function whose last values are kept: one for each thread that judges, and one more.

    Several threads may call it at once; what two of them miss is made twice.

    Attributes
    ----------
    make
        Function of a key.
    size
        Function that returns the size of a value.
    room
        Largest size of all kept values together.
    least
        Number of values that are kept whatever their size.
    most
        Largest number of values that are kept.
    """

    make: Callable[[Key], Value]
    size: Callable[[Value], int]
    room: int
    least: int = 0
    most: int = field(default_factory=lambda: worker_count() + 1)
    _values: OrderedDict[Key, Value] = field(init=False, default_factory=OrderedDict)
    _lock: Lock = field(init=False, default_factory=Lock)

    def known(self, key: Key) -> Value | None:
        """Return the value of a key if it is kept; None where it would have to be made."""
        with self._lock:
            return self._values.get(key)

    def __call__(self, key: Key) -> Value:
        """Return the value of a key."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key]
        value = self.make(key)
        with self._lock:
            self._values[key] = value
            self._values.move_to_end(key)
            taken = sum(map(self.size, self._values.values()))
            while len(self._values) > max(self.most, self.least) or (
                taken > self.room and len(self._values) > self.least
            ):
                taken -= self.size(self._values.popitem(last=False)[1])
        return value
