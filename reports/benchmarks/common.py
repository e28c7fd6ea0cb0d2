"""What the benchmarks share: how a record names its scene, rates, ratios and columns of text."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from typing import Any

from xfrustum.reference.llvm import mitsuba_backend
from xfrustum.reports.common import provenance
from xfrustum.reports.common.timing import Timing
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

Record = dict[str, Any]
"""The JSON object of a benchmark, or a part of it; `json_ready` makes it JSON's own types."""

RELATIVE_NEAR = 1e-3
"""The near offset, as a fraction of the reach."""


def scene_record(scene: Scene) -> Record:
    """Return what a record says of the scene that was measured."""
    return {"name": scene.name, "hash": scene.content_hash, "triangles": len(scene.faces)}


def machine_record(*, tracers: bool = False) -> Record:
    """Return the machine and the versions of the libraries, those of the tracers included if asked for."""
    versions = provenance.versions()
    if tracers:
        versions |= mitsuba_backend().versions
        versions |= {name: version(name) for name in ("drjit", "embreex", "trimesh")}
    return {"machine": provenance.machine(), "versions": versions}


def settings_of(scene: Scene) -> DoubleFrustum:
    """Return the settings that all contestants draw with."""
    return DoubleFrustum(near=RELATIVE_NEAR * scene.frustum.longest_reach)


def sized(scene: Scene, resolution: int) -> Scene:
    """Return a scene with a square film and one sample a pixel; InputError where it has no triangles."""
    if not len(scene.faces):
        raise InputError(f"scene {scene.name}: has no triangles to measure; choose one that has")
    film = replace(scene.frustum, resolution=(positive(resolution),) * 2)
    return replace(scene, frustum=film, sampling=Sampling())


def positive(count: int) -> int:
    """Return a resolution, a number of hogels or of repetitions; InputError where it is not positive."""
    if count < 1:
        raise InputError("bench: resolutions, hogels and repetitions must be positive; give such as 256")
    return count


def rate_of(amount: float, seconds: Timing) -> Timing:
    """Return the amount per second, given the seconds that all of it took."""
    lowest, median, highest = (amount / each for each in (seconds.highest, seconds.median, seconds.lowest))
    return replace(seconds, median=median, lowest=lowest, highest=highest, low=None, high=None)


def ratios_of(rates: Mapping[str, Timing], pairs: Iterable[tuple[str, str]]) -> dict[str, float | None]:
    """Return quotients of median rates as "one/other"; None where the other does not run here."""
    return {
        f"{one}/{other}": rates[one].median / rates[other].median if other in rates else None
        for one, other in pairs
    }


def exhaust(images: Iterable[object]) -> None:
    """Take every image and keep none."""
    deque(images, maxlen=0)


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of cells as lines of text, all columns as wide as their widest cell."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]


def spread(lowest_median_highest: tuple[float, float, float] | None) -> str:
    """Return a rate with its ends, or a dash for a contestant that does not run here."""
    if lowest_median_highest is None:
        return "-"
    lowest, median, highest = lowest_median_highest
    return f"{median:.2f} ({lowest:.2f} to {highest:.2f})"


def number(value: float | None) -> str:
    """Return a ratio, or a dash for one that is missing."""
    return "-" if value is None else f"{value:.2f}"
