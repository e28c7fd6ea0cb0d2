"""The plate, its apertures and their crossed frustum, and the settings of the two cameras.

Source: the paper, sections 3 and 4; frames are in CONVENTIONS.md. The formulas of lines and
matrices exist twice, in `reference.lines` and `raster.cameras`, and not here: a mistake in a
formula shared by both renderers would not be detected.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import overload

from xfrustum.scenes.arguments import InputError, choice, one_of, real, reals, settle, whole, wholes


@dataclass(frozen=True, kw_only=True)
class Aperture:
    """One aperture: the common point of all lines of a hogel; InputError if invalid."""

    column: int
    row: int  #: 0 is at the top
    x: float  #: center in scene units; its z is 0, the plate
    y: float

    def __post_init__(self) -> None:
        index, center = (whole(self.column), whole(self.row)), (real(self.x), real(self.y))
        if min(index) < 0:
            raise InputError(
                "an aperture's column and row must be counts from 0, not "
                f"{self.column!r}, {self.row!r}"
            )
        if not all(map(math.isfinite, center)):
            raise InputError(f"an aperture's x and y must be finite, not {self.x!r}, {self.y!r}")
        settle(self, column=index[0], row=index[1], x=center[0], y=center[1])

    @property
    def index(self) -> tuple[int, int]:
        """Column and row, in the order of the command line."""
        return (self.column, self.row)


@dataclass(frozen=True, kw_only=True)
class Plate:
    """The holographic plate: a rectangle in z = 0 about the origin, divided into apertures."""

    size: tuple[float, float]  #: width and height in scene units
    hogels: tuple[int, int]  #: columns and rows of apertures

    def __post_init__(self) -> None:
        size, hogels = reals(self.size, 2), wholes(self.hogels, 2)
        if not all(math.isfinite(s) and s > 0 for s in size):
            raise InputError(f"plate.size must be two positive lengths, not {self.size!r}")
        if not all(n >= 1 for n in hogels):
            raise InputError(f"plate.hogels must be two counts of at least 1, not {self.hogels!r}")
        settle(self, size=size, hogels=hogels)

    def aperture(self, column: int, row: int) -> Aperture:
        """Return the aperture in a column and row; InputError if it lies outside the plate."""
        (columns, rows), index = self.hogels, f"{column},{row}"
        column, row = whole(column), whole(row)
        if not (0 <= column < columns and 0 <= row < rows):
            raise InputError(
                f"aperture {index} lies outside the plate: "
                f"columns run from 0 to {columns - 1}, rows from 0 to {rows - 1}"
            )
        width, height = self.size
        x, y = (
            (column + 0.5) * width / columns - width / 2,
            height / 2 - (row + 0.5) * height / rows,
        )
        return Aperture(column=column, row=row, x=x, y=y)

    def apertures(self) -> ApertureBlocks:
        """Return all apertures, row by row from the top left, as a lazy sequence."""
        columns, rows = self.hogels
        return ApertureBlocks(self, ((range(columns), range(rows)),))

    @property
    def middle(self) -> Aperture:
        """The default aperture: column Nx // 2, row Ny // 2."""
        return self.aperture(self.hogels[0] // 2, self.hogels[1] // 2)

    @property
    def corners(self) -> tuple[Aperture, Aperture]:
        """Apertures at top left and bottom right, with the largest shear if recentered."""
        return self.aperture(0, 0), self.aperture(self.hogels[0] - 1, self.hogels[1] - 1)


Block = tuple[range, range]  #: columns and rows of a block


@dataclass(frozen=True, eq=False)
class ApertureBlocks(Sequence[Aperture]):
    """Apertures of rectangles, each once, row by row from the top left, as a lazy sequence."""

    plate: Plate
    blocks: tuple[Block, ...]

    def __iter__(self) -> Iterator[Aperture]:
        for number, (columns, rows) in enumerate(self.blocks):
            earlier = self.blocks[:number]
            for row in rows:
                for column in columns:
                    if not any(column in other and row in others for other, others in earlier):
                        yield self.plate.aperture(column, row)

    def __len__(self) -> int:
        # Rows between two neighboring ends of blocks are in the same blocks, with the same columns.
        ends = sorted({end for _, rows in self.blocks for end in (rows.start, rows.stop)})
        return sum(
            (stop - start) * len(set[int]().union(*(c for c, rows in self.blocks if start in rows)))
            for start, stop in pairwise(ends)
        )

    @overload
    def __getitem__(self, index: int) -> Aperture: ...
    @overload
    def __getitem__(self, index: slice) -> list[Aperture]: ...
    def __getitem__(self, index: int | slice) -> Aperture | list[Aperture]:
        """Return an aperture by its index: computed for one block, by iteration for several."""
        if isinstance(index, slice):
            return [self[place] for place in range(*index.indices(len(self)))]
        place = index + len(self) if index < 0 else index
        if not 0 <= place < len(self):
            raise IndexError(index)
        if len(self.blocks) == 1:
            columns, rows = self.blocks[0]
            row, column = divmod(place, len(columns))
            return self.plate.aperture(columns[column], rows[row])
        return next(aperture for number, aperture in enumerate(self) if number == place)

    def __contains__(self, aperture: object) -> bool:
        index = getattr(aperture, "index", None)
        return index is not None and any(
            index[0] in columns and index[1] in rows for columns, rows in self.blocks
        )


@dataclass(frozen=True, kw_only=True)
class PlateTile:
    """Rectangle of hogels: the film of an image by direction.

    An image by direction has one pixel for each hogel, with row 0 of the tile on top.
    """

    plate: Plate
    columns: range
    rows: range

    @classmethod
    def whole(cls, plate: Plate) -> PlateTile:
        """Return the tile of all hogels of a plate."""
        return cls(plate=plate, columns=range(plate.hogels[0]), rows=range(plate.hogels[1]))

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of hogels."""
        return len(self.columns), len(self.rows)


#: Smallest half-extent of a film, as a slope. Slopes of neighboring lines of an image 1e4 pixels
#: wide differ by 2e-4 of the half-extent: at 1e-12 this is the rounding error of a shear of about
#: one in double precision.
SMALLEST_SLOPE = 1e-12


@dataclass(frozen=True, kw_only=True)
class Screen:
    """A projection screen fixed to the plate's frame (paper, section 5), in scene units."""

    height: float  #: signed, above the plate, not zero; positive on the viewer's side
    center: tuple[float, float]  #: x, y
    size: tuple[float, float]  #: width, height

    def __post_init__(self) -> None:
        height, center, size = real(self.height), reals(self.center, 2), reals(self.size, 2)
        if not math.isfinite(height) or height == 0:
            raise InputError(
                f"frustum.screen.height must be finite and not zero, not {self.height!r}: "
                "a screen in the plate has no direction to shear to"
            )
        if not all(math.isfinite(c) for c in center):
            raise InputError(
                f"frustum.screen.center must be two finite coordinates, not {self.center!r}"
            )
        if not all(math.isfinite(s) and s > 0 for s in size):
            raise InputError(f"frustum.screen.size must be two positive lengths, not {self.size!r}")
        least = 2 * abs(height) * SMALLEST_SLOPE
        if min(size) < least:
            raise InputError(
                f"frustum.screen.size must be at least {least:.3g} for a screen at height "
                f"{height:.6g}, not {list(size)}: no image resolves such angles"
            )
        settle(self, height=height, center=center, size=size)


@dataclass(frozen=True, kw_only=True)
class Frustum:
    """Crossed frustum of every aperture: centered (`fov`) or recentered (`screen`)."""

    resolution: tuple[int, int]  #: width and height of the hogel image in pixels
    reach: tuple[
        float, float
    ]  #: largest distances of imaged surfaces toward the viewer and behind the plate, scene units
    fov: tuple[float, float] | None = None  #: full angles in x and y, radians
    screen: Screen | None = None

    def __post_init__(self) -> None:
        resolution, reach = wholes(self.resolution, 2), reals(self.reach, 2)
        if not all(n >= 1 for n in resolution):
            raise InputError(
                f"frustum.resolution must be two counts of at least 1, not {self.resolution!r}"
            )
        if not all(math.isfinite(r) and r > 0 for r in reach):
            raise InputError(f"frustum.reach must be two positive lengths, not {self.reach!r}")
        if (self.fov is None) == (self.screen is None):
            raise InputError(
                "frustum needs either fov_deg or screen, and not both: fov_deg = [x, y] degrees "
                "centers it, screen = { height = .., center = [x, y], size = [w, h] } recenters it"
            )
        fov = None if self.fov is None else reals(self.fov, 2)
        if fov is not None and not all(0 < angle < math.pi for angle in fov):
            numbers = not any(map(math.isnan, fov))
            angles = (
                [math.degrees(angle) for angle in fov] if numbers else f"{self.fov!r} (in radians)"
            )
            raise InputError(
                f"frustum.fov_deg must be two angles between 0 and 180 degrees, not {angles}"
            )
        if fov is not None and min(fov) < 2 * SMALLEST_SLOPE:
            raise InputError(
                f"frustum.fov_deg must be at least {math.degrees(2 * SMALLEST_SLOPE):.1e} degrees, "
                f"not {[math.degrees(angle) for angle in fov]}: no image resolves such angles"
            )
        if self.screen is not None:
            one_of(self.screen, Screen, "frustum.screen")
        settle(self, resolution=resolution, reach=reach, fov=fov)

    @property
    def recentered(self) -> bool:
        """True if the shear changes from aperture to aperture (paper, section 5)."""
        return self.screen is not None

    @property
    def longest_reach(self) -> float:
        """The larger reach of the two sides, used where no side is specified."""
        return max(self.reach)


#: Smallest near distance, in scene units: the smallest normal float32. Devices may round smaller
#: numbers to zero.
SMALLEST_NEAR = 2.0**-126


class DepthFormat(StrEnum):
    """Storage of the depth buffer."""

    D16 = "d16"
    D24 = "d24"
    D32F = "d32f"


class DepthMapping(StrEnum):
    """Function from distance w, between near n and far f, to stored depth.

    `STANDARD` is hyperbolic, from 0 at near to 1 at far. `GL` is the same with clip depth -1..1,
    and `REVERSED` is from 1 to 0. `LOGARITHMIC` is ln(w/n)/ln(f/n), and `LINEAR` is
    (w - n)/(f - n); both are written by the fragment shader.
    """

    STANDARD = "standard"
    GL = "gl"
    REVERSED = "reversed"
    LOGARITHMIC = "logarithmic"
    LINEAR = "linear"


class Pivot(StrEnum):
    """Center of the shear of a recentered frustum: the aperture (paper), or each camera."""

    APERTURE = "aperture"
    CAMERA = "camera"


class Offset(StrEnum):
    """Offset of the cameras, so that near planes meet at the plate (paper), or none."""

    PLATE = "plate"
    NONE = "none"


class Fit(StrEnum):
    """Angles of the offset cameras: equal to the frustum's, or exact on the screen."""

    ANGLE = "angle"
    SCREEN = "screen"


class Camera(StrEnum):
    """The cameras that draw: both, or only one (paper, figure 7)."""

    BOTH = "both"
    C = "c"
    C_STAR = "c-star"


class Cull(StrEnum):
    """Omitted faces: none, or faces turned away from the viewer, for both cameras.

    `BACK` changes no picture of closed bodies that lie off the plate and within the reach (paper,
    section 3).
    """

    NONE = "none"
    BACK = "back"


@dataclass(frozen=True, kw_only=True)
class DoubleFrustum:
    """Settings of the two cameras C and C*; names may be strings, such as `depth="d24"`.

    Raises InputError for an unknown name, or for a length that is not positive and finite.
    """

    #: Near distance n > 0, scene units: distance of the near planes from the cameras, and offset of
    #: both cameras if `offset` is `plate`.
    near: float
    depth: DepthFormat = DepthFormat.D24
    mapping: DepthMapping = DepthMapping.STANDARD
    camera: Camera = Camera.BOTH
    pivot: Pivot = Pivot.APERTURE
    offset: Offset = Offset.PLATE
    #: A `Fit`, or the height |z| of the two planes that are drawn without displacement. None
    #: selects the far end of the first slab if there are slabs, else the angle.
    fit: Fit | float | None = None
    #: Heights |z| at which both frusta are cut, ascending. Every slab except the first has its own
    #: near plane, and cameras exactly at the aperture; `fit` and `offset` apply to the first slab.
    slabs: tuple[float, ...] = ()
    cull: Cull = Cull.NONE

    def __post_init__(self) -> None:
        near, slabs = real(self.near), reals(self.slabs)
        if not (math.isfinite(near) and near > 0):
            raise InputError(f"near must be a positive length, not {self.near!r}")
        if near < SMALLEST_NEAR:
            raise InputError(
                f"near must be at least {SMALLEST_NEAR:.3g}, as matrices have 32 bits, "
                f"not {self.near}"
            )
        if not all(low < high for low, high in itertools.pairwise((0.0, *slabs, math.inf))):
            raise InputError(
                f"slabs must be positive heights in ascending order, not {self.slabs!r}"
            )
        fit: Fit | float | None = None
        if isinstance(self.fit, str) and self.fit in list(Fit):
            fit = Fit(self.fit)
        elif self.fit is not None:
            fit = real(self.fit)
            if not (math.isfinite(fit) and fit > 0):
                raise InputError(
                    f"fit must be angle, screen, or a positive height, not {self.fit!r}"
                )
        settle(self, near=near, slabs=slabs, fit=fit)
        kinds = {"depth": DepthFormat, "mapping": DepthMapping, "camera": Camera}
        for name, kind in (kinds | {"pivot": Pivot, "offset": Offset, "cull": Cull}).items():
            settle(self, **{name: choice(kind, getattr(self, name), name)})

    def check_against(self, frustum: Frustum) -> None:
        """Raise InputError if these settings are invalid for a frustum."""
        if not self.near < frustum.longest_reach:
            raise InputError(
                f"near {self.near} must be smaller than the reach, {frustum.longest_reach}; "
                "it is the distance that both cameras step back from the plate"
            )
        if self.slabs and not self.slabs[-1] < frustum.longest_reach:
            raise InputError(
                f"slabs must lie within the reach, {frustum.longest_reach}, not at {self.slabs[-1]}"
            )
        if self.fit is Fit.SCREEN and frustum.screen is None:
            raise InputError("fit screen needs a recentered frustum; give a height instead")
        first = min((*self.slabs, *frustum.reach))
        if self.offset is Offset.NONE and not self.near < first:
            raise InputError(
                f"near {self.near} without an offset must be smaller than {first}: it clips nearer "
                "surfaces"
            )

    def fitted_height(self, frustum: Frustum) -> float | None:
        """Return the height |z| that the first slab draws exactly; None to keep the angle."""
        if self.fit is Fit.SCREEN and frustum.screen is not None:
            return abs(frustum.screen.height)
        if self.fit is None and self.slabs:
            return self.slabs[0]
        return None if self.fit is None or isinstance(self.fit, Fit) else self.fit

    def sections(self, reach: float) -> tuple[tuple[float, float], ...]:
        """Return the two heights |z| between which each slab of one side lies, innermost first."""
        cuts = (0.0, *(height for height in self.slabs if height < reach), reach)
        return tuple(itertools.pairwise(cuts))

    @property
    def depth_label(self) -> str:
        """Format and mapping for reports, such as `D24 standard`."""
        return f"{self.depth.upper()} {self.mapping}"
