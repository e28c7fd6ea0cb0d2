"""A plate as a stream of hogels: the arrays that are wanted, and those of each hogel."""

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
    """The type in which linear RGB is stored; uint8 is 255 times the radiance, clipped and rounded."""

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


#: Images that a renderer has; certainty is the truth's alone.
DRAWN_CHANNELS = (Channel.COLOR, Channel.HEIGHT, Channel.TRIANGLE, Channel.NORMAL)


@dataclass(frozen=True, kw_only=True)
class PlateContent:
    """The images that a stream of hogels carries; InputError for unknown types, channels and effects."""

    color: ColorType = ColorType.FLOAT16  #: type of linear RGB
    ids: bool = (
        False  #: whether the stream has triangle numbers; asking for the channel is the same
    )
    channels: tuple[Channel, ...] = ()  #: in the order of `Channel`; by default color, and `ids`
    effects: frozenset[Effect] | None = (
        None  #: None for those that the scene calls for: the same pictures
    )

    def __post_init__(self) -> None:
        ids = switch(self.ids, "ids")
        asked = {choice(Channel, one, "channels") for one in self.channels or (Channel.COLOR,)}
        channels = tuple(
            one for one in Channel if one in asked or (ids and one is Channel.TRIANGLE)
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
    """A rectangle of a hogel's film, of whose pixels something is wanted; both ends belong to it."""

    columns: tuple[int, int]
    rows: tuple[int, int]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlateHogel(ShortRepr):
    """The image of one aperture, row 0 at the top; outside the part asked for pixels mean nothing."""

    aperture: Aperture
    color: NDArray[Any]  #: (H, W, 3) linear RGB in the type that was asked for
    triangle: Numbers | None  #: (H, W), -1 where there is no surface
    height: Singles | None = None  #: (H, W) above the plate, NaN where there is no surface
    normal: Singles | None = None  #: (H, W, 3) unit, by the mesh's winding, NaN likewise
    certainty: Bytes | None = None  #: (H, W) uint8 `Certainty`

    def image(self, channel: Channel) -> NDArray[Any]:
        """Return one of the images; it must have been asked for."""
        image: NDArray[Any] | None = getattr(self, channel)
        assert image is not None, f"{channel} was not asked for"
        return image
