"""Why does each cost grow as it does? The exponent to expect of every contestant, and the reason."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from xfrustum.reports.benchmarks.scaling.contestants import (
    APERTURES,
    CERTIFIED,
    EMBREE,
    MITSUBA,
    PIXELS,
    PLATE,
    RASTER,
    STREAM,
    TRIANGLES,
    TRUTH,
)
from xfrustum.reports.benchmarks.scaling.fit import Exponents

SECONDS, MEMORY = "seconds", "memory"

Range = tuple[float, float]
LINEAR: Range = (0.8, 1.2)
"""Proportional at the large end, where a constant share still pulls down and full caches push up."""
NEARLY_LINEAR: Range = (0.6, 1.2)
"""Proportional plus a constant that is not yet negligible at the large end."""
SUBLINEAR: Range = (-0.1, 0.5)
"""A logarithm has exponents near zero; caches that a growing structure no longer fits into add to them."""
SATURATING: Range = (0.4, 1.2)
"""Proportional, but cheaper from the size on at which triangles are smaller than pixels: those that no
line can meet are dropped as soon as they are projected, and the others, whose rows are decided, no longer
grow in number. Where deciding costs twice what projecting does, a decade beyond that size has an exponent
of log10((2 + 10) / (2 + 1)) = 0.6, less what is constant."""
ROWS_AND_PIXELS: Range = (0.4, 1.1)
"""Between the root, exponent a half, and proportional, less a constant."""
FLAT: Range = (-0.15, 0.15)
"""Nothing grows; what is left is noise."""
BANDED: Range = (-0.5, 0.15)
"""Nothing grows, and what is held of triangles may shrink with the width of a band, as the root."""


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """What exponent is expected at the large end.

    Attributes
    ----------
    low, high
        Range of the exponent.
    because
        The reason, to be formatted with what was measured: `each`, what one more triangle, pixel or
        hogel costs at the large end; `sizes` and `growth`, how many times the size and the cost grew;
        `log`, the local exponent of a logarithm at the largest size.
    """

    low: float
    high: float
    because: str


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A fitted growth beside the expected one.

    Attributes
    ----------
    exponents
        Measured.
    expected
        Their range at the large end.
    sentence
        The reason for that range, with what was measured.
    """

    exponents: Exponents
    expected: Range
    sentence: str

    @property
    def as_expected(self) -> bool | None:
        """Whether the exponent at the large end lies in the range that the sentence is about.

        None where no such exponent is known.
        """
        found = self.exponents.large_end
        return None if found is None else self.expected[0] <= found <= self.expected[1]


def _all(span: Range, because: str, *contestants: str) -> dict[str, Expectation]:
    return dict.fromkeys(contestants, Expectation(low=span[0], high=span[1], because=because))


_TREE = (
    "a ray visits about log n nodes of a tree, which alone would have an exponent of {log} there, and a "
    "pixel shows one triangle however many there are: {sizes} times the triangles cost {growth} times the "
    "time"
)
_ONE_BY_ONE = "hogels are traced one by one and share nothing but the structure: {each} each"
_TRIANGLES_KEPT = (
    "corners, numbers, normals and structures of all triangles are kept and outweigh one picture: {each} each"
)
_IMAGE_KEPT = "the whole image is in memory at once and outweighs the triangles: {each} a pixel"
_DROPPED = (
    "a picture is dropped before the next is made, so that one is in memory: {growth} times for {sizes} "
    "times the hogels"
)

EXPECTED: dict[tuple[str, str], dict[str, Expectation]] = {
    (TRIANGLES, SECONDS): {
        **_all(LINEAR, "both cameras transform every triangle, shown or not: {each} each", RASTER),
        **_all(SUBLINEAR, _TREE, EMBREE, MITSUBA),
        **_all(
            SATURATING,
            "every triangle is projected onto the film so that none is left out, also those too small to "
            "meet a pixel's line; but only those that can meet one are decided, and once triangles are "
            "smaller than pixels there are no more of them: {each} each",
            CERTIFIED,
            TRUTH,
        ),
    },
    (PIXELS, SECONDS): {
        **_all(
            NEARLY_LINEAR,
            "pixels are filled, read back and given points and normals one by one, and this outweighs the "
            "transform of the triangles in the end: {each} each",
            RASTER,
        ),
        **_all(LINEAR, "each pixel is a ray and gets point, normal and color: {each} each", EMBREE, MITSUBA),
        **_all(
            ROWS_AND_PIXELS,
            "each triangle is cut into rows, whose number grows as the root of that of the pixels, and each "
            "pixel within them is decided: {each} each",
            CERTIFIED,
        ),
        **_all(
            LINEAR,
            "each pixel is decided, traced for a second opinion and given point, normal and color: "
            "{each} each",
            TRUTH,
        ),
    },
    (APERTURES, SECONDS): {
        **_all(
            LINEAR,
            "hogels of one submission share its orders, but each has vertices and pixels of its own: "
            "{each} each",
            PLATE,
        ),
        **_all(LINEAR, _ONE_BY_ONE, EMBREE, MITSUBA),
        **_all(
            LINEAR,
            "hogels are decided one by one, each from all triangles again: {each} each",
            CERTIFIED,
            TRUTH,
        ),
        **_all(
            LINEAR,
            "triangles are sorted by side once for the plate, but projected and decided for each hogel: "
            "{each} each",
            STREAM,
        ),
    },
    (TRIANGLES, MEMORY): _all(NEARLY_LINEAR, _TRIANGLES_KEPT, RASTER, EMBREE, MITSUBA, CERTIFIED, TRUTH),
    (PIXELS, MEMORY): {
        **_all(NEARLY_LINEAR, _IMAGE_KEPT, RASTER, EMBREE, MITSUBA, TRUTH),
        **_all(
            BANDED,
            "rows are decided in bands of a bounded number of pixels, and each is dropped; the more bands, "
            "the fewer triangles in each: {growth} times for {sizes} times the pixels",
            CERTIFIED,
        ),
    },
    (APERTURES, MEMORY): {
        **_all(FLAT, _DROPPED, EMBREE, MITSUBA, CERTIFIED, TRUTH),
        **_all(
            SUBLINEAR,
            "no more than a round of submissions is in memory: {growth} times for {sizes} times the hogels",
            PLATE,
        ),
        **_all(
            SUBLINEAR,
            "lines of no more hogels than fill one call of the tracer are in memory: {growth} times for "
            "{sizes} times the hogels",
            STREAM,
        ),
    },
}
"""By axis and quantity, of each contestant."""


def finding(
    axis: str, quantity: str, contestant: str, sizes: Sequence[float], costs: Sequence[float]
) -> Finding:
    """Fit a contestant's costs, seconds or MiB, and set them beside what is expected."""
    expectation = EXPECTED[axis, quantity][contestant]
    exponents = Exponents.of(sizes, costs)
    each = (costs[-1] - costs[-2]) / (sizes[-1] - sizes[-2])
    return Finding(
        exponents=exponents,
        expected=(expectation.low, expectation.high),
        sentence=expectation.because.format(
            log=f"{1 / math.log(sizes[-1]):.2f}",
            each=_seconds(each) if quantity == SECONDS else _bytes(each * 2**20),
            sizes=f"{sizes[-1] / sizes[0]:,.0f}",
            growth="an unknown number of" if exponents.growth is None else f"{exponents.growth:.3g}",
        ),
    )


def _seconds(value: float) -> str:
    for unit, factor in (("s", 1.0), ("ms", 1e3), ("µs", 1e6)):
        if abs(value) * factor >= 1:
            return f"{value * factor:.3g} {unit}"
    return f"{value * 1e9:.3g} ns"


def _bytes(value: float) -> str:
    for unit, size in (("MiB", 2**20), ("KiB", 2**10)):
        if abs(value) >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value:.0f} bytes"
