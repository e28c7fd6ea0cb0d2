"""Settings in parts that are drawn together: those of the same cameras follow one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.prediction.chain import with_exact_depth
from xfrustum.scenes.plate.double_frustum import DoubleFrustum


@dataclass(frozen=True, kw_only=True)
class Part:
    """Settings of the same cameras that are drawn one after the other.

    Attributes
    ----------
    settings
        Settings that are drawn now.
    first, only
        Whether they are the first of these cameras, and whether there is no other setting of these cameras.
    """

    settings: tuple[DoubleFrustum, ...]
    first: bool
    only: bool


def parts_of(settings: Sequence[DoubleFrustum], size: int) -> list[Part]:
    """Return settings, each once, in parts of about one size whose cameras are the same.

    Settings of the same cameras follow one another and share the traced links of the chain. So do geometries
    of one near, which share some of these links too. A smaller remainder would leave processors idle, so that
    the parts of one pair of cameras are equal.
    """
    cameras: dict[DoubleFrustum, list[DoubleFrustum]] = {}
    nears = list(dict.fromkeys(setting.near for setting in settings))
    for setting in sorted(dict.fromkeys(settings), key=lambda one: nears.index(one.near)):
        cameras.setdefault(with_exact_depth(setting), []).append(setting)
    found = []
    for group in cameras.values():
        parts = np.array_split(np.arange(len(group)), max(1, round(len(group) / size)))
        for part in parts:
            some = tuple(group[i] for i in part)
            first = some[0] is group[0]
            found.append(Part(settings=some, first=first, only=len(group) == 1))
    return found
