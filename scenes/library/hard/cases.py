"""The suite of hard cases: scenes at which renderers of crossed frusta fail (docs/hard-cases.md)."""

from __future__ import annotations

from types import MappingProxyType

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.library.builtin import Listing
from xfrustum.scenes.library.hard import aimed as hard_aimed
from xfrustum.scenes.library.hard import frusta as hard_frusta
from xfrustum.scenes.library.hard import sheets as hard_sheets
from xfrustum.scenes.library.hard import slivers as hard_slivers
from xfrustum.scenes.library.hard.case import HardCase
from xfrustum.scenes.model.scene import Scene

CASES: MappingProxyType[str, HardCase] = MappingProxyType(
    {
        case.name: case
        for family in (hard_aimed, hard_sheets, hard_slivers, hard_frusta)
        for case in family.CASES
    }
)


def names(*, giants: bool = True) -> list[str]:
    """Return the names of the cases in the order of the suite, with or without the giants."""
    return [name for name, case in CASES.items() if giants or not case.giant]


def listing() -> list[Listing]:
    """Return name, difficulty and number of triangles of every case."""
    return [Listing(name=name, purpose=case.why, triangles=case.triangles) for name, case in CASES.items()]


def build(name: str) -> Scene:
    """Return the scene of a hard case, made anew each time: one of them takes hundreds of megabytes.

    Raises
    ------
    InputError
        There is no such case.
    """
    if name not in CASES:
        raise InputError(f"no hard case is called {name!r}; there are {', '.join(CASES)}")
    return CASES[name].build()
