"""Rows of a survey, one for each hogel and setting, and bins of depth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from xfrustum.compare.attribution.budget import CauseNumbers
from xfrustum.compare.beyond import displacement_p99, is_beyond
from xfrustum.compare.judging.image_displacement import MeasuredBy
from xfrustum.compare.judging.judged import ColorFigures, SurfaceFigures
from xfrustum.compare.metrics.comparison import Comparison, ComparisonNumbers
from xfrustum.compare.metrics.displacement import Spread, lengths
from xfrustum.compare.run import JudgedDrawing
from xfrustum.reports.common.records import named_columns
from xfrustum.reports.verification.verdict import Hogel
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

DEPTH_DECADES, BINS_PER_DECADE = 4, 2
"""Decades of |z| below the reach that bins of depth tell apart, and bins of each: displacement goes as n/|z|,
so that from bin to bin it changes by a factor of about three."""


@dataclass(frozen=True, kw_only=True)
class DepthBins:
    """Displacement by depth of content: for each bin of |z|, over all pixels that show a surface there.

    Bins are half decades of |z| over the reach; the first one goes down to the plate. `squares_px2` are sums
    of squared displacements; where there is no pixel all three are 0.
    """

    pixels: tuple[int, ...]
    squares_px2: tuple[float, ...]
    max_px: tuple[float, ...]

    @classmethod
    def of(cls, drawn: HogelImage, displacement: Floats) -> DepthBins:
        """Sort the pixels of a drawing by the height of what they show.

        `displacement` is (H, W, 2) in pixels, NaN where it shows no surface off the plate.
        """
        moved = lengths(displacement)
        shown = np.isfinite(moved)
        moved, depth = moved[shown], np.abs(drawn.height[shown].astype(np.float64))
        ends, reach = depth_ends(), max(drawn.camera.reach)
        place = np.searchsorted(np.array(ends[1:-1]) * reach, depth, side="right")
        bins = len(ends) - 1
        largest = np.zeros(bins)
        np.maximum.at(largest, place, moved)
        return cls(
            pixels=tuple(np.bincount(place, minlength=bins).tolist()),
            squares_px2=tuple(np.bincount(place, weights=moved**2, minlength=bins).tolist()),
            max_px=tuple(largest.tolist()),
        )


def depth_ends() -> tuple[float, ...]:
    """Return the ends of the bins of depth, as fractions of the reach, from 0 to 1."""
    count = DEPTH_DECADES * BINS_PER_DECADE
    return (0.0, *(10 ** (-place / BINS_PER_DECADE) for place in range(count, 0, -1)), 1.0)


@dataclass(frozen=True, kw_only=True)
class Device:
    """The device that drew a hogel: the name of its OpenGL renderer, and its index among EGL's devices."""

    renderer: str
    index: int


@dataclass(frozen=True, kw_only=True)
class DrawnRow:
    """One hogel that our rasterizer drew with one setting: what `report` measures, and error by depth.

    `beyond` (`compare.beyond`) counts wrong surfaces too: displacement alone does not see depth fighting or a
    lost object, for all that is shown may be where it belongs.
    """

    column: int
    row: int
    setting: int
    beyond: bool
    settings: DoubleFrustum = field(metadata=named_columns("{}"))
    comparison: ComparisonNumbers = field(metadata=named_columns("{}"))
    causes: Mapping[str, CauseNumbers] = field(metadata=named_columns("cause_{}"))
    unexplained: int
    depth: DepthBins
    device: Device

    @classmethod
    def of(
        cls,
        aperture: Aperture,
        setting: int,
        drawing: JudgedDrawing,
        tolerance_px: float,
        device: Device,
    ) -> DrawnRow:
        """Return the row of a drawing that was judged with images and causes."""
        comparison, drawn = drawing.comparison, drawing.image
        assert isinstance(comparison, Comparison) and drawn is not None
        assert drawing.causes is not None and drawing.unexplained is not None
        assert comparison.surface is not None, "a judge has the scene at hand"
        return cls(
            column=aperture.column,
            row=aperture.row,
            setting=setting,
            beyond=is_beyond(displacement_p99(comparison), comparison.surface.fraction, tolerance_px),
            settings=drawing.settings,
            comparison=comparison.numbers,
            causes={cause.name: cause.numbers for cause in drawing.causes},
            unexplained=drawing.unexplained,
            depth=DepthBins.of(drawn, comparison.maps.displacement),
            device=device,
        )


@dataclass(frozen=True, kw_only=True)
class RoundingCauses:
    """Number of wrong pixels by the kind of rounding that can have made them wrong."""

    edge: int
    order: int
    lost: int
    unexplained: int


@dataclass(frozen=True, kw_only=True)
class ForeignNumbers:
    """The numbers of one image, as `verify` finds them; see `HogelNumbers`."""

    shown: int
    by: str
    wrong: int
    fraction: float
    surface: SurfaceFigures | None
    invalid: int
    displacement_px: Spread | None
    displacement_by: MeasuredBy
    radiance: ColorFigures | None
    causes: RoundingCauses | None


@dataclass(frozen=True, kw_only=True)
class ForeignRow:
    """One hogel of another renderer, judged as `verify` does, as found and corrected for the diagnosis.

    `beyond` is whether it is missing or exceeds a limit; `problem` is the reason where it is missing.
    """

    column: int
    row: int
    setting: int = 0
    beyond: bool
    verdict: str
    problem: str | None
    as_found: ForeignNumbers | None = field(metadata=named_columns("{}"))
    corrected: ForeignNumbers | None

    @classmethod
    def of(cls, hogel: Hogel) -> ForeignRow:
        """Return the row of a hogel that was verified."""
        found, corrected = (
            None
            if numbers is None
            else ForeignNumbers(
                **{
                    **vars(numbers),
                    "causes": None if numbers.causes is None else RoundingCauses(**numbers.causes),
                }
            )
            for numbers in (hogel.as_found, hogel.corrected)
        )
        return cls(
            column=hogel.aperture.column,
            row=hogel.aperture.row,
            beyond=not hogel.passed,
            verdict=hogel.verdict,
            problem=hogel.problem,
            as_found=found,
            corrected=corrected,
        )
