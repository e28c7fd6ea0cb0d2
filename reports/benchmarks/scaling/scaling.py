"""How do time and memory grow with triangles, pixels and apertures, and where does tracing overtake?"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from tqdm import tqdm

from xfrustum.reports.benchmarks.scaling.contestants import (
    CONTESTANTS,
    RASTERIZERS,
    TRIANGLES,
    UnavailableError,
    contestants_along,
)
from xfrustum.reports.benchmarks.scaling.expected import MEMORY, SECONDS, Finding, finding
from xfrustum.reports.benchmarks.scaling.extent import FULL, Axis, Extent
from xfrustum.reports.benchmarks.scaling.fit import Crossing, Overtaking
from xfrustum.reports.benchmarks.scaling.process import ENOUGH_S, FEWEST, Job, Measured, measure_apart
from xfrustum.reports.common import provenance
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.summaries import Summarized

LIMIT_MIB = 8192.0
"""Peak memory that every contestant must stay below with the most triangles."""


@dataclass(frozen=True, kw_only=True)
class GrowthRecord:
    """JSON object of a `Finding`."""

    exponent: float | None
    exponent_large_end: float | None
    growth: float | None
    expected: tuple[float, float]
    as_expected: bool | None
    sentence: str

    @classmethod
    def of(cls, found: Finding) -> GrowthRecord:
        """Return the JSON object of a finding."""
        return cls(
            exponent=found.exponents.overall,
            exponent_large_end=found.exponents.large_end,
            growth=found.exponents.growth,
            expected=found.expected,
            as_expected=found.as_expected,
            sentence=found.sentence,
        )


@dataclass(frozen=True, kw_only=True)
class OvertakingRecord:
    """JSON object of an `Overtaking`; `at` is the size from which on tracing is faster."""

    at: float | None
    crossings: tuple[Crossing, ...]
    sentence: str


@dataclass(frozen=True, kw_only=True)
class AxisRecord:
    """JSON object of an `AxisScaling`."""

    fixed: str
    sizes: tuple[int, ...]
    counts: list[int]
    contestants: dict[str, tuple[Measured, ...]]
    growth: dict[str, dict[str, GrowthRecord]]
    tracing_overtakes: dict[str, OvertakingRecord]


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

    @property
    def record(self) -> AxisRecord:
        """What was measured and found along the axis."""
        return AxisRecord(
            fixed=self.axis.fixed,
            sizes=self.axis.sizes,
            counts=self.axis.counts,
            contestants=self.measured,
            growth={
                quantity: {name: GrowthRecord.of(one) for name, one in self.findings(quantity).items()}
                for quantity in (SECONDS, MEMORY)
            },
            tracing_overtakes={
                name: OvertakingRecord(
                    at=one.from_size, crossings=one.crossings, sentence=one.sentence(self.axis.unit)
                )
                for name, one in self.overtakings.items()
            },
        )


@dataclass(frozen=True, kw_only=True)
class RepeatRecord:
    """How often each contestant ran at each size: at most, at least, and the seconds that are enough."""

    most: int
    fewest: int
    enough_s: float


@dataclass(frozen=True, kw_only=True)
class MemoryRecord:
    """Peak memory of every contestant with the most triangles, and whether all stay below the limit."""

    triangles: int
    peak_mib: dict[str, float]
    limit_mib: float
    within: bool


@dataclass(frozen=True, kw_only=True)
class ScalingRecord:
    """JSON object of a `ScalingBenchmark`."""

    meanings: dict[str, str]
    repeat: RepeatRecord
    asymptotic: bool
    axes: dict[str, AxisRecord]
    memory_with_most_triangles: MemoryRecord
    unavailable: dict[str, str]
    machine: dict[str, str]
    versions: dict[str, str]


@dataclass(frozen=True, kw_only=True)
class ScalingBenchmark(Summarized[ScalingRecord]):
    """All axes, and what they were measured on.

    Attributes
    ----------
    axes
        Axes in the order in which they were measured.
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

    @property
    def record(self) -> ScalingRecord:
        """Everything measured."""
        peaks = {name: point.peak_mib for name, point in self.most_triangles.items()}
        return ScalingRecord(
            meanings={name: one.meaning for name, one in CONTESTANTS.items()},
            repeat=RepeatRecord(most=self.extent.repeat, fewest=FEWEST, enough_s=ENOUGH_S),
            asymptotic=self.extent.asymptotic,
            axes={one.axis.unit: one.record for one in self.axes},
            memory_with_most_triangles=MemoryRecord(
                triangles=next(iter(self.most_triangles.values())).triangles,
                peak_mib=peaks,
                limit_mib=LIMIT_MIB,
                within=max(peaks.values()) < LIMIT_MIB,
            ),
            unavailable=self.unavailable,
            machine=self.machine,
            versions=self.versions,
        )


@dataclass
class _Running:
    """The contestants that still run, and what they turned out to be made of."""

    unavailable: dict[str, str] = field(default_factory=dict)
    made_of: dict[str, str] = field(default_factory=dict)

    def measure(self, axis: Axis, repeat: int, bar: tqdm[Any]) -> AxisScaling:
        measured: dict[str, list[Measured]] = {name: [] for name in contestants_along(axis.unit)}
        # Size by size, so that those who are compared have the same slow minutes.
        for size in axis.sizes:
            for name, points in measured.items():
                if name not in self.unavailable:
                    self._point(axis.job(name, size, repeat), points)
                bar.update()
        return AxisScaling(
            axis=axis,
            measured={
                name: tuple(points) for name, points in measured.items() if name not in self.unavailable
            },
        )

    def _point(self, job: Job, points: list[Measured]) -> None:
        try:
            points.append(measure_apart(job))
            self.made_of |= points[-1].made_of
        except UnavailableError as reason:
            self.unavailable[job.contestant] = str(reason)


def benchmark_scaling(extent: Extent = FULL, *, progress: bool = False) -> ScalingBenchmark:
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
    running = _Running()
    with progress_bar(runs, "bench scaling", "process", shown=progress) as bar:
        axes = tuple(running.measure(axis, extent.repeat, bar) for axis in extent.axes)
    return ScalingBenchmark(
        axes=axes,
        extent=extent,
        unavailable=running.unavailable,
        machine=provenance.machine(),
        versions={**provenance.versions(), **running.made_of},
    )
