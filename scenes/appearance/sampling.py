"""Sampling over pixels and over the aperture, and light transport; off by default."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from xfrustum.scenes.arguments import settle, switch, whole
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate.plate import Aperture, Plate

if TYPE_CHECKING:
    from xfrustum.scenes.arrays import Floats

MAX_SAMPLES = 1 << 16  #: largest count of samples of any kind


@dataclass(frozen=True, kw_only=True)
class Sampling:
    """Samples of color per pixel and per aperture, 1 to `MAX_SAMPLES`; otherwise InputError."""

    supersample: int = 1  #: points along each side of a pixel, on a regular grid (box filter)
    #: coverage samples of the rasterizer; the reference averages over the same box
    multisample: int = 1
    #: sub-apertures over which the image is averaged (paper, section 6: band limiting)
    aperture: int = 1

    def __post_init__(self) -> None:
        for name in ("supersample", "multisample", "aperture"):
            count = whole(getattr(self, name))
            if not 1 <= count <= MAX_SAMPLES:
                raise InputError(
                    f"{name} must be a count between 1 and {MAX_SAMPLES}, not "
                    f"{getattr(self, name)!r}"
                )
            settle(self, **{name: count})


@dataclass(frozen=True, kw_only=True)
class Transport:
    """Shadows and interreflection, by light paths; InputError for values out of range."""

    shadows: bool = False  #: whether surfaces cast shadows on each other
    interreflection: bool = False  #: whether surfaces light each other
    samples: int = 64  #: light paths per pixel

    def __post_init__(self) -> None:
        samples = whole(self.samples)
        if not 2 <= samples <= MAX_SAMPLES:
            raise InputError(
                f"samples must be a count between 2 and {MAX_SAMPLES}, not {self.samples!r}: "
                "fewer than two have no variance"
            )
        shadows, lit = (
            switch(self.shadows, "shadows"),
            switch(self.interreflection, "interreflection"),
        )
        settle(self, samples=samples, shadows=shadows, interreflection=lit)

    @property
    def simulated(self) -> bool:
        """True if any light transport is simulated."""
        return self.shadows or self.interreflection


#: The real root of x^3 = x + 1. Its powers give an evenly distributed additive recurrence in two
#: dimensions.
PLASTIC = 1.32471795724474602596


def sub_apertures(plate: Plate, aperture: Aperture, count: int) -> tuple[Aperture, ...]:
    """Return points spread evenly over one hogel pitch about an aperture (paper, section 6).

    They follow the additive recurrence of Roberts, "The unreasonable effectiveness of quasirandom
    sequences" (2018): the error of a smooth integrand falls as 1 / count.
    """
    if count == 1:
        return (aperture,)
    offsets = additive_recurrence(count) - 0.5
    pitch = (plate.size[0] / plate.hogels[0], plate.size[1] / plate.hogels[1])
    return tuple(
        replace(aperture, x=aperture.x + float(x) * pitch[0], y=aperture.y + float(y) * pitch[1])
        for x, y in offsets
    )


def additive_recurrence(count: int) -> Floats:
    """Return (count, 2) points in [0, 1), centered: their mean tends to one half."""
    import numpy as np  # noqa: PLC0415 - scenes are listed without it

    steps = np.arange(count, dtype=np.float64)[:, None]
    return np.asarray((0.5 + (steps + 0.5) * [1 / PLASTIC, 1 / PLASTIC**2]) % 1.0)
