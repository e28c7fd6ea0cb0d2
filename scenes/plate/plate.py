"""The plate, its apertures and their crossed frustum (paper, section 3; frames in CONVENTIONS.md).

The formulas of lines and matrices exist twice, in `reference.lines.lines` and
`raster.cameras.cameras`, and not here: a mistake in a formula shared by both renderers would not be
detected.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import overload

from xfrustum.scenes.arguments import one_of, real, reals, settle, whole, wholes
from xfrustum.scenes.errors import InputError


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
#: wide differ by 2e-4 of it: at 1e-12 this is the rounding error of a shear of about one in double
#: precision.
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
    ]  #: up to which surfaces are imaged, toward the viewer and behind the plate
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
