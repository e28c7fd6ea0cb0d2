"""Eyes in front of the plate, the pixels of hogels in their view, and their pictures."""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from xfrustum.scenes.appearance import additive_recurrence
from xfrustum.scenes.arguments import InputError, choice, real, reals, settle, wholes
from xfrustum.scenes.arrays import Bytes, Floats, Indices, Mask, Numbers, Singles
from xfrustum.scenes.model.images import NOTHING, Labels, SurfaceImage
from xfrustum.scenes.representation import Labelled, ShortRepr

#: Default resolution of an eye's film, and the largest number of its pixels (100 bytes each).
RESOLUTION, MAX_EYE_PIXELS = (400, 300), 1 << 24
#: Number of points of the pupil for means of color: enough for a smooth blur of a few pixels.
PUPIL_POINTS = 16


class Beam(StrEnum):
    """Profile of a hogel's beam: uniform (the nearest pixel) or linear (a mean of four pixels)."""

    BOX = "box"
    TENT = "tent"


@dataclass(frozen=True, kw_only=True)
class Eye:
    """Eye whose film is the rectangle of the plate, divided into equal cells; row 0 is at the top.

    Raises InputError if the eye is in or behind the plate, if a number is not finite, or if there
    are too many pixels.
    """

    position: tuple[
        float, float, float
    ]  #: center of the pupil, scene units; z > 0, in front of the plate
    #: W, H in pixels
    resolution: tuple[int, int] = RESOLUTION
    #: diameter of the pupil, scene units; 0 for a pinhole
    pupil: float = 0.0
    #: height z, below the eye, of the plane in focus; without a pupil it has no effect
    focus: float = 0.0
    beam: Beam = Beam.BOX

    def __post_init__(self) -> None:
        position, size = reals(self.position, 3), wholes(self.resolution, 2)
        if not all(map(math.isfinite, position)) or not position[2] > 0:
            raise InputError(
                f"an eye needs a position X,Y,Z before the plate, Z > 0, not {self.position!r}: "
                "the plate is z = 0, and the viewer is at positive z"
            )
        if min(size) < 1 or size[0] * size[1] > MAX_EYE_PIXELS:
            raise InputError(
                f"an eye's resolution must be two counts with at most {MAX_EYE_PIXELS} pixels, "
                f"not {self.resolution!r}"
            )
        pupil, focus = real(self.pupil), real(self.focus)
        if not (math.isfinite(pupil) and pupil >= 0):
            raise InputError(f"an eye's pupil must be a diameter of at least 0, not {self.pupil!r}")
        if not (math.isfinite(focus) and focus < position[2]):
            raise InputError(
                f"an eye's focus must be a height below the eye's own, {position[2]}, not "
                f"{self.focus!r}"
            )
        beam = choice(Beam, self.beam, "beam")
        settle(self, position=position, resolution=size, pupil=pupil, focus=focus, beam=beam)

    @property
    def pupil_points(self) -> Floats:
        """(N, 2) evenly spread points of the pupil, relative to its center, scene units."""
        if self.pupil == 0:
            return np.zeros((1, 2))
        # Equal areas: the radius is the square root of an evenly spread number.
        share, turn = additive_recurrence(PUPIL_POINTS).T
        radius, angle = np.sqrt(share) * self.pupil / 2, 2 * np.pi * turn
        return np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=-1)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class HogelPixels(ShortRepr):
    """Hogel and pixel for each pixel of an eye's film, and two factors of its weight.

    Columns (W,) depend only on the column of the eye's film, and rows (H,) only on its row. Columns
    and rows are -1 if the ray meets no hogel.
    """

    hogel_column: Indices
    film_column: Indices
    hogel_row: Indices
    film_row: Indices
    column_weight: Floats
    row_weight: Floats

    @property
    def columns(self) -> Indices:
        """Columns of the eye's film whose rays meet a hogel's film."""
        return np.flatnonzero(self.film_column >= 0)

    @property
    def rows(self) -> Indices:
        """Rows of the eye's film whose rays meet a hogel's film."""
        return np.flatnonzero(self.film_row >= 0)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Replay(ShortRepr):
    """All pixels of hogels in the view of an eye."""

    #: pixels that show surfaces: closest to the rays through the pupil's center
    shown: HogelPixels
    #: pixels whose weighted sum is the color
    colors: tuple[HogelPixels, ...]

    @property
    def hogels(self) -> tuple[tuple[int, int], ...]:
        """Column and row of every hogel with a pixel in the view, row by row."""
        indices: set[tuple[int, int]] = set()
        for pixels in (self.shown, *self.colors):
            columns = np.unique(pixels.hogel_column[pixels.columns]).tolist()
            rows = np.unique(pixels.hogel_row[pixels.rows]).tolist()
            indices.update((column, row) for row in rows for column in columns)
        return tuple(sorted(indices, key=lambda index: (index[1], index[0])))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class EyeImage(SurfaceImage):
    """Picture of one eye. Row 0 is at the top; arrays are (H, W) or (H, W, 3)."""

    eye: Eye
    #: surface on the ray through the pupil's center, `NOTHING` where there is none
    triangle: Numbers
    #: object number, `NOTHING` where there is none
    object: Numbers
    #: surface point, scene units; NaN without a surface, or if unknown
    position: Floats
    #: linear RGB, averaged over the pupil and over beams; None if not known
    color: Singles | None = None
    #: uint8 `Certainty` per pixel; None without certification
    certainty: Bytes | None = None

    @property
    def covered(self) -> Mask:
        """Pixels that show a surface."""
        return np.asarray((self.triangle != NOTHING) | (self.object != NOTHING))

    def _labels(self, units: str) -> Labels:
        eye = self.eye
        places = {
            f"eye_{name}": Labelled(value, f"{name} of the eye", units)
            for name, value in zip("xyz", eye.position, strict=True)
        }
        return {}, places, {"pupil": eye.pupil, "focus": eye.focus, "beam": str(eye.beam)}
