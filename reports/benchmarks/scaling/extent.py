"""What grows, how far, and what stays as it is meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

from xfrustum.reports.benchmarks.scaling.contestants import APERTURES, PIXELS, TRIANGLES
from xfrustum.reports.benchmarks.scaling.process import Job


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
        Triangles of the globes, where these do not grow; None for the car.
    resolution, hogels
        Sides of the images and number of hogels, where these do not grow.
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
        Runs of each contestant at each size, at most; see `process.ENOUGH_S`.
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
