"""What a report says about light beside its rows: effects and their time, the eye vector, what is missed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from xfrustum.compare.metrics.left_out import LeftOutNumbers
from xfrustum.reports.common.formatting import digits, percent
from xfrustum.reports.common.json_ready import INLINED
from xfrustum.reports.common.timing import CONFIDENCE, FEWEST_DIFFERENCES
from xfrustum.reports.effects.cost_record import Cost
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.model.effects import Decision
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True)
class EyeError:
    """What the bent eye vector costs at one near plane: root mean squares over points and channels.

    Attributes
    ----------
    near
        Near plane in scene units.
    predicted
        Error at the truth's surface points.
    measured
        Error at the points that the device drew, with its float32 arithmetic.
    """

    near: float
    predicted: float
    measured: float


@dataclass(frozen=True, kw_only=True, eq=False)
class MissedLight:
    """The light that a rasterizer misses in one aperture's image.

    Attributes
    ----------
    aperture
        Aperture whose truth was traced.
    numbers
        Light that is missed.
    picture, difference
        The truth with shadows and interreflection, and its difference from the truth without, encoded.
    """

    aperture: Aperture
    numbers: LeftOutNumbers
    picture: bytes
    difference: bytes


@dataclass(frozen=True, kw_only=True)
class MissedRecord:
    """The light that is missed in one aperture's image, as report.json has it."""

    aperture: tuple[int, int]
    numbers: LeftOutNumbers = field(metadata=INLINED)


@dataclass(frozen=True, kw_only=True)
class ShadingRecord:
    """What report.json says about light; see `ShadingReport`."""

    effects: str
    decisions: tuple[Decision, ...]
    saved_s: dict[str, float]
    saved_interval_s: dict[str, tuple[float, float]]
    image_s: dict[str, float]
    same_bits: bool
    sampling: Sampling
    seconds_per_aperture_sample: dict[str, float]
    eye_vector: tuple[EyeError, ...]
    left_out: tuple[MissedRecord, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class ShadingReport:
    """What a report says about light beside its rows.

    Attributes
    ----------
    scene
        Scene that was measured.
    names
        Effects that were drawn, as `--effects` takes them.
    decisions
        For every effect: whether the scene calls for it, and why.
    saved
        By renderer: cost of all effects beyond those that the scene calls for.
    same_bits
        Whether the rasterizer's images with all effects and with those called for are the same, bit by bit.
    per_sample
        By renderer: seconds for each point of the aperture; empty where it has one point.
    eye
        Error by near; empty where no highlight and no reflection is drawn.
    missed
        Missed light by aperture; empty where no light transport is asked for.
    """

    scene: Scene
    names: str
    decisions: tuple[Decision, ...]
    saved: dict[str, Cost]
    same_bits: bool
    per_sample: dict[str, float]
    eye: tuple[EyeError, ...]
    missed: tuple[MissedLight, ...]

    @property
    def record(self) -> ShadingRecord:
        """The numbers as report.json has them."""
        return ShadingRecord(
            effects=self.names,
            decisions=self.decisions,
            saved_s={name: cost.seconds for name, cost in self.saved.items()},
            saved_interval_s={name: cost.interval for name, cost in self.saved.items()},
            image_s={name: cost.without for name, cost in self.saved.items()},
            same_bits=self.same_bits,
            sampling=self.scene.sampling,
            seconds_per_aperture_sample=self.per_sample,
            eye_vector=self.eye,
            left_out=tuple(
                MissedRecord(aperture=part.aperture.index, numbers=part.numbers) for part in self.missed
            ),
        )

    def sentences(self) -> Iterator[str]:
        """Say in words how much time is saved, and how much light is missed."""
        for name, cost in self.saved.items():
            yield (
                f"{name.capitalize()}: {milliseconds(cost.without)} an image with what the scene calls for; "
                f"all effects {_more(cost)}."
            )
        for part in self.missed:
            pixels = self.scene.frustum.resolution[0] * self.scene.frustum.resolution[1]
            numbers = part.numbers
            yield (
                f"Aperture {part.aperture.column},{part.aperture.row}: light transport changes "
                f"{numbers.pixels:,} pixels ({percent(numbers.pixels / pixels)}), "
                f"{numbers.darker:,} of them to darker; rms {digits(numbers.rms)} in radiance, "
                f"after noise of {digits(numbers.rms_noise)} is taken off."
            )


def _more(cost: Cost) -> str:
    """Say what all effects cost more; where repetitions do not tell it from nothing, that."""
    low, high = (f"{digits(1e3 * end)}" for end in cost.interval)
    if not cost.resolved:
        return (
            f"could not be told apart from that in {cost.repetitions} repetitions "
            f"(the difference lies between {low} and {high} ms, {_confidence(cost)})"
        )
    more = "more" if cost.seconds > 0 else "less"
    part = percent(abs(cost.seconds) / cost.without)
    between = f"the difference lies between {low} and {high} ms, {_confidence(cost)}"
    return f"take {milliseconds(abs(cost.seconds))} {more} ({part}; {between})"


def _confidence(cost: Cost) -> str:
    known = cost.repetitions >= FEWEST_DIFFERENCES
    return f"with {percent(CONFIDENCE)} confidence" if known else "with too few repetitions"


def milliseconds(seconds: float) -> str:
    """Write a time, from one second on in seconds."""
    return f"{digits(seconds)} s" if seconds >= 1 else f"{digits(1e3 * seconds)} ms"
