"""How do time and memory grow with triangles, pixels and apertures, and where does tracing overtake?"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from xfrustum.reports import provenance
from xfrustum.reports.progress import progress_bar
from xfrustum.reports.scaling_contestants import (
    APERTURES,
    CONTESTANTS,
    PIXELS,
    RASTERIZERS,
    TRIANGLES,
    UnavailableError,
    contestants_along,
)
from xfrustum.reports.scaling_expected import MEMORY, SECONDS, Finding, finding
from xfrustum.reports.scaling_fit import Overtaking
from xfrustum.reports.scaling_process import ENOUGH_S, FEWEST, Job, Measured, measure_apart
from xfrustum.reports.tables import json_ready

LIMIT_MIB = 8192.0
"""What each must stay below with the most triangles."""


@dataclass(frozen=True, kw_only=True)
class Axis:
    """What grows, and what stays as it is.

    Attributes
    ----------
    unit
        What sizes count.
    sizes
        Ascending, at least two. Of pixels, the sides of square images.
    triangles
        Of the globes, where these do not grow; None for the car.
    resolution, hogels
        Where these do not grow.
    """

    unit: str
    sizes: tuple[int, ...]
    triangles: int | None = None
    resolution: int = 512
    hogels: int = 1

    @property
    def counts(self) -> list[int]:
        """The sizes as counts of the unit."""
        return [size**2 if self.unit == PIXELS else size for size in self.sizes]

    @property
    def fixed(self) -> str:
        """What does not grow, in words."""
        scene = "the car" if self.triangles is None else f"globes of {self.triangles:,} triangles"
        image = f"{self.resolution} x {self.resolution} pixels"
        return {
            TRIANGLES: f"globes, {image}",
            PIXELS: scene,
            APERTURES: f"{scene}, {image} a hogel",
        }[self.unit]

    def job(self, contestant: str, size: int, repeat: int) -> Job:
        """Return what one process is to measure."""
        return Job(
            contestant=contestant,
            triangles=size if self.unit == TRIANGLES else self.triangles,
            resolution=size if self.unit == PIXELS else self.resolution,
            hogels=size if self.unit == APERTURES else self.hogels,
            repeat=repeat,
        )


@dataclass(frozen=True, kw_only=True)
class Extent:
    """How far everything is measured.

    Attributes
    ----------
    axes
        Each with its sizes.
    repeat
        Runs of each contestant at each size, at most; see `scaling_process.ENOUGH_S`.
    asymptotic
        Whether the sizes are large enough for exponents to be those expected.
    """

    axes: tuple[Axis, ...]
    repeat: int
    asymptotic: bool = True


FULL = Extent(
    axes=(
        Axis(unit=TRIANGLES, sizes=(10_000, 32_000, 100_000, 320_000, 1_000_000, 3_200_000, 10_000_000)),
        Axis(unit=PIXELS, sizes=(128, 256, 512, 1024, 2048, 4096), triangles=100_000),
        Axis(unit=APERTURES, sizes=(1, 3, 9, 27, 81), resolution=128),
    ),
    repeat=9,
)
QUICK = Extent(
    axes=(
        Axis(unit=TRIANGLES, sizes=(1_000, 4_000), resolution=64),
        Axis(unit=PIXELS, sizes=(32, 64), triangles=1_000),
        Axis(unit=APERTURES, sizes=(1, 3), resolution=32),
    ),
    repeat=1,
    asymptotic=False,
)


@dataclass(frozen=True, kw_only=True)
class AxisScaling:
    """Everything measured along one axis.

    Attributes
    ----------
    axis
        What grew.
    measured
        By contestant, at each size.
    """

    axis: Axis
    measured: dict[str, tuple[Measured, ...]]

    def costs(self, contestant: str, quantity: str) -> list[float]:
        """Return a contestant's median seconds, or MiB beyond what it imported, at each size."""
        points = self.measured[contestant]
        if quantity == SECONDS:
            return [point.seconds.median for point in points]
        return [point.peak_mib - point.imported_mib for point in points]

    def findings(self, quantity: str) -> dict[str, Finding]:
        """Return every contestant's growth, by name."""
        return {
            name: finding(self.axis.unit, quantity, name, self.axis.counts, self.costs(name, quantity))
            for name in self.measured
        }

    @property
    def overtakings(self) -> dict[str, Overtaking]:
        """Where each tracer overtakes the rasterizer of this axis, by name of the tracer."""
        raster = next(name for name in self.measured if name in RASTERIZERS)
        return {
            name: Overtaking.of(
                self.axis.counts,
                [point.seconds for point in self.measured[raster]],
                [point.seconds for point in points],
            )
            for name, points in self.measured.items()
            if name not in RASTERIZERS
        }

    def summary(self) -> dict[str, Any]:
        """Return what was measured and found along the axis."""
        return {
            "fixed": self.axis.fixed,
            "sizes": self.axis.sizes,
            "counts": self.axis.counts,
            "contestants": self.measured,
            "growth": {quantity: _growth(self.findings(quantity)) for quantity in (SECONDS, MEMORY)},
            "tracing_overtakes": {
                name: {
                    "at": one.from_size,
                    "crossings": one.crossings,
                    "sentence": one.sentence(self.axis.unit),
                }
                for name, one in self.overtakings.items()
            },
        }


def _growth(findings: dict[str, Finding]) -> dict[str, Any]:
    return {
        name: {
            "exponent": one.exponents.overall,
            "exponent_large_end": one.exponents.large_end,
            "growth": one.exponents.growth,
            "expected": one.expected,
            "as_expected": one.as_expected,
            "sentence": one.sentence,
        }
        for name, one in findings.items()
    }


@dataclass(frozen=True, kw_only=True)
class ScalingBenchmark:
    """All axes, and what they were measured on.

    Attributes
    ----------
    axes
        In the order in which they were measured.
    extent
        What was asked for.
    unavailable
        Contestants that do not run here, and why.
    machine, versions
        Names and values, for whoever repeats it.
    """

    axes: tuple[AxisScaling, ...]
    extent: Extent
    unavailable: dict[str, str]
    machine: dict[str, str]
    versions: dict[str, str]

    @property
    def most_triangles(self) -> dict[str, Measured]:
        """Every contestant with the most triangles."""
        triangles = next(one for one in self.axes if one.axis.unit == TRIANGLES)
        return {name: points[-1] for name, points in triangles.measured.items()}

    def summary(self) -> dict[str, Any]:
        """Return everything measured as one JSON object."""
        peaks = {name: point.peak_mib for name, point in self.most_triangles.items()}
        ready: dict[str, Any] = json_ready(
            {
                "meanings": {name: one.meaning for name, one in CONTESTANTS.items()},
                "repeat": {"most": self.extent.repeat, "fewest": FEWEST, "enough_s": ENOUGH_S},
                "asymptotic": self.extent.asymptotic,
                "axes": {one.axis.unit: one.summary() for one in self.axes},
                "memory_with_most_triangles": {
                    "triangles": next(iter(self.most_triangles.values())).triangles,
                    "peak_mib": peaks,
                    "limit_mib": LIMIT_MIB,
                    "within": max(peaks.values()) < LIMIT_MIB,
                },
                "unavailable": self.unavailable,
                "machine": self.machine,
                "versions": self.versions,
            }
        )
        return ready


@dataclass
class _Field:
    """The contestants that still run, and what they turned out to be made of."""

    unavailable: dict[str, str] = field(default_factory=dict)
    made_of: dict[str, str] = field(default_factory=dict)

    def measure(self, axis: Axis, repeat: int, bar: Any) -> AxisScaling:
        measured: dict[str, tuple[Measured, ...]] = {}
        for name in contestants_along(axis.unit):
            points = []
            for size in axis.sizes:
                bar.update()
                if name in self.unavailable:
                    continue
                try:
                    points.append(measure_apart(axis.job(name, size, repeat)))
                    self.made_of |= points[-1].made_of
                except UnavailableError as reason:
                    self.unavailable[name] = str(reason)
            if name not in self.unavailable:
                measured[name] = tuple(points)
        return AxisScaling(axis=axis, measured=measured)


def bench_scaling(extent: Extent = FULL, *, progress: bool = False) -> ScalingBenchmark:
    """Measure time and memory along all axes, each contestant at each size in a process of its own.

    Parameters
    ----------
    extent
        `FULL`, or `QUICK`, which shows that everything runs and nothing else.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        There is no usable OpenGL, or a process was ended, as when memory runs out.
    """
    runs = sum(len(contestants_along(axis.unit)) * len(axis.sizes) for axis in extent.axes)
    running = _Field()
    with progress_bar(runs, "bench scaling", "process", shown=progress) as bar:
        axes = tuple(running.measure(axis, extent.repeat, bar) for axis in extent.axes)
    return ScalingBenchmark(
        axes=axes,
        extent=extent,
        unavailable=running.unavailable,
        machine=provenance.machine(),
        versions={**provenance.versions(), **running.made_of},
    )
