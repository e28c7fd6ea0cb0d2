"""A plate as a stream of hogels: requested images, and the arrays of each hogel."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from xfrustum.scenes.arguments import choice, settle, switch
from xfrustum.scenes.arrays import Bytes, Numbers, Singles
from xfrustum.scenes.model.effects import Effect, checked
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.scenes.representation import ShortRepr


class ColorType(StrEnum):
    """Type of stored linear RGB; uint8 is 255 times the radiance, clipped and rounded."""

    UINT8 = "uint8"
    FLOAT16 = "float16"
    FLOAT32 = "float32"

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """NumPy type."""
        name: DTypeLike = self.value
        return np.dtype(name)


class Channel(StrEnum):
    """One of the images of a hogel, in the order in which they are written; color comes last."""

    CERTAINTY = "certainty"
    NORMAL = "normal"
    HEIGHT = "height"
    TRIANGLE = "triangle"
    COLOR = "color"


#: Images that a renderer has; only the truth has certainty.
DRAWN_CHANNELS = (Channel.COLOR, Channel.HEIGHT, Channel.TRIANGLE, Channel.NORMAL)


@dataclass(frozen=True, kw_only=True)
class PlateContent:
    """Images of a stream of hogels; InputError for unknown types, channels and effects."""

    color: ColorType = ColorType.FLOAT16  #: type of linear RGB
    ids: bool = False  #: true if the stream has triangle numbers, as with channel `TRIANGLE`
    channels: tuple[Channel, ...] = ()  #: in the order of `Channel`; by default color and `ids`
    #: None selects the effects that the scene needs, which give the same pictures
    effects: frozenset[Effect] | None = None

    def __post_init__(self) -> None:
        ids = switch(self.ids, "ids")
        requested = {
            choice(Channel, channel, "channels") for channel in self.channels or (Channel.COLOR,)
        }
        channels = tuple(
            channel
            for channel in Channel
            if channel in requested or (ids and channel is Channel.TRIANGLE)
        )
        settle(
            self,
            color=choice(ColorType, self.color, "color"),
            ids=Channel.TRIANGLE in channels,
            channels=channels,
            effects=None if self.effects is None else checked(self.effects),
        )


@dataclass(frozen=True, kw_only=True)
class FilmPart:
    """Rectangle of requested pixels of a hogel's film, with both ends included."""

    columns: tuple[int, int]
    rows: tuple[int, int]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlateImages(ShortRepr):
    """Images in the types of a plate, row 0 on top; pixels outside the request are undefined."""

    color: NDArray[Any] | None  #: (H, W, 3) linear RGB in the requested type
    triangle: Numbers | None  #: (H, W), -1 where there is no surface
    height: Singles | None = None  #: (H, W) above the plate, NaN where there is no surface
    normal: Singles | None = None  #: (H, W, 3) unit, by the mesh's winding, NaN likewise
    certainty: Bytes | None = None  #: (H, W) uint8 `Certainty`

    def image(self, channel: Channel) -> NDArray[Any]:
        """Return one of the requested images."""
        image: NDArray[Any] | None = getattr(self, channel)
        assert image is not None, f"{channel} was not asked for"
        return image


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlateHogel(PlateImages):
    """The images of one aperture."""

    aperture: Aperture
    color: NDArray[Any]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlateDirection(PlateImages):
    """Images of one pixel of all hogels of a tile, with one pixel for each hogel."""

    pixel: tuple[int, int]  #: column and row in every hogel
