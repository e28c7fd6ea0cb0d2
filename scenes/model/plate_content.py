"""A plate as a stream of hogels: the arrays that are wanted, and those of each hogel."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from xfrustum.scenes.arguments import choice, settle, switch
from xfrustum.scenes.arrays import Bytes, Numbers, Singles
from xfrustum.scenes.model.effects import Effect, checked
from xfrustum.scenes.notebook import Brief
from xfrustum.scenes.plate.plate import Aperture


class ColorType(StrEnum):
    """The type in which linear RGB is stored.

    `UINT8` is 255 times the radiance, rounded; radiance outside 0 to 1 is clipped.
    """

    UINT8 = "uint8"
    FLOAT16 = "float16"
    FLOAT32 = "float32"

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """NumPy's name of the type."""
        wanted: DTypeLike = self.value
        return np.dtype(wanted)


class Channel(StrEnum):
    """One of the images of a hogel, in the order in which they are written; color comes last."""

    CERTAINTY = "certainty"
    NORMAL = "normal"
    HEIGHT = "height"
    TRIANGLE = "triangle"
    COLOR = "color"


DRAWN_CHANNELS = (Channel.COLOR, Channel.HEIGHT, Channel.TRIANGLE, Channel.NORMAL)
"""Images that a renderer has; certainty is the truth's alone."""


@dataclass(frozen=True, kw_only=True)
class PlateContent:
    """The images that a stream of hogels carries.

    Attributes
    ----------
    color
        Type of linear RGB.
    ids
        Whether the stream has triangle numbers; asking for the channel is the same.
    channels
        The images, in the order of `Channel`; by default color, and triangle numbers with `ids`.
    effects
        Effects that are simulated; None for those that the scene calls for. More effects do not change the
        pictures.

    Raises
    ------
    InputError
        The type, the switch, a channel or an effect is none, or there is no channel.
    """

    color: ColorType = ColorType.FLOAT16
    ids: bool = False
    channels: tuple[Channel, ...] = ()
    effects: frozenset[Effect] | None = None

    def __post_init__(self) -> None:
        ids = switch(self.ids, "ids")
        asked = {choice(Channel, one, "channels") for one in self.channels or (Channel.COLOR,)}
        channels = tuple(one for one in Channel if one in asked or (ids and one is Channel.TRIANGLE))
        settle(
            self,
            color=choice(ColorType, self.color, "color"),
            ids=Channel.TRIANGLE in channels,
            channels=channels,
            effects=None if self.effects is None else checked(self.effects),
        )


@dataclass(frozen=True, kw_only=True)
class FilmPart:
    """A rectangle of a hogel's film, of whose pixels something is wanted.

    Attributes
    ----------
    columns, rows
        First and last column, and first and last row, inclusive.
    """

    columns: tuple[int, int]
    rows: tuple[int, int]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlateHogel(Brief):
    """The image of one aperture in a stream, row 0 at the top.

    Where only a part of the film was asked for, pixels outside of it mean nothing.

    Attributes
    ----------
    aperture
        Aperture of the image.
    color
        (H, W, 3) linear RGB in the type that was asked for.
    triangle
        (H, W) int32 numbers, -1 where there is no surface; None unless asked for.
    height
        (H, W) float32 height above the plate, NaN where there is no surface; None unless asked for.
    normal
        (H, W, 3) float32 unit normals by the mesh's winding, NaN where there is no surface; None likewise.
    certainty
        (H, W) uint8 `Certainty`; None unless asked for.
    """

    aperture: Aperture
    color: NDArray[Any]
    triangle: Numbers | None
    height: Singles | None = None
    normal: Singles | None = None
    certainty: Bytes | None = None

    def image(self, channel: Channel) -> NDArray[Any]:
        """Return one of the images; it must have been asked for."""
        image: NDArray[Any] | None = getattr(self, channel)
        assert image is not None, f"{channel} was not asked for"
        return image
