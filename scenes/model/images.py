"""Images that renderers return: of a hogel, by direction, and of a plate as a stream of hogels.

A hogel image shows the surfaces visible from one aperture, per pixel. An image by direction has one
pixel of all hogels of a tile: a plate is a stack of hogels or a stack of images by direction, and
both have the same pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from enum import IntEnum, StrEnum
from functools import cached_property, partial
from json import dumps
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from xfrustum.scenes.appearance import Sampling, Transport
from xfrustum.scenes.arguments import choice, settle, switch
from xfrustum.scenes.arrays import Bytes, Floats, Indices, Mask, Numbers, Singles
from xfrustum.scenes.model.effects import Effect, checked
from xfrustum.scenes.model.scene import read_only
from xfrustum.scenes.plate import Aperture, DoubleFrustum, PlateTile
from xfrustum.scenes.representation import NO_UNIT, SCENE_UNITS, Labelled, ShortRepr, dataset

if TYPE_CHECKING:
    import xarray


#: Additional arrays of an image, coordinates of the whole image, and attributes, by name.
Labels = tuple[dict[str, Labelled], dict[str, Labelled], dict[str, Any]]
NOTHING = -1  #: triangle and object number of a pixel that shows no surface


class Certainty(IntEnum):
    """Method by which the truth of a pixel was determined."""

    #: computed in floating point, with error bounds that exclude every other result
    PROVEN = 0
    EXACT = 1  #: computed in rational arithmetic
    #: equal in exact arithmetic: coincident surfaces, or a line exactly through a shared edge
    TIE = 2
    UNEXAMINED = 3  #: not certified: result of a tracer


@dataclass(frozen=True, kw_only=True)
class HogelCamera:
    """Crossed frustum that an image must show, in double precision.

    The lines of the aperture are P(s) = (x, y, 0) + s (kx + u tx, ky + v ty, -1).
    """

    aperture: Aperture
    resolution: tuple[int, int]  #: W, H in pixels
    shear: tuple[float, float]  #: k, slopes per unit of depth
    half_extent: tuple[float, float]  #: t, slopes per unit of depth
    reach: tuple[float, float]  #: toward the viewer and behind the plate, scene units
    scene: str  #: name or path from which the scene can be opened again
    scene_hash: str  #: content hash, which proves that the scene is unchanged
    renderer: str  #: name of the renderer, with version or device
    settings: DoubleFrustum | None = None  #: settings that drew the image; None for other renderers
    #: light paths per pixel over which color was averaged; None if no paths were traced
    light_paths: int | None = None


@dataclass(frozen=True, kw_only=True)
class Rendering:
    """Simulated effects in the color of an image; transport is None without light paths."""

    effects: tuple[Effect, ...]
    sampling: Sampling
    transport: Transport | None = None

    @classmethod
    def from_effects(
        cls, effects: Iterable[Effect], sampling: Sampling, transport: Transport | None = None
    ) -> Rendering:
        """Return the rendering with its effects in order."""
        ordered = tuple(sorted(set(effects), key=list(Effect).index))
        return cls(effects=ordered, sampling=sampling, transport=transport)


class SurfaceImage(ShortRepr):
    """An image whose pixels show surfaces."""

    triangle: Numbers
    object: Numbers
    position: NDArray[np.floating]
    color: Singles | None
    certainty: Bytes | None
    uncertainty: Floats | None = None

    @property
    def covered(self) -> Mask:
        """Pixels that show a surface."""
        raise NotImplementedError

    def _labels(self, units: str) -> Labels:
        """Return additional arrays, coordinates and attributes by name, with units of length."""
        raise NotImplementedError

    def to_xarray(self, units: str = SCENE_UNITS) -> xarray.Dataset:
        """Return the arrays with labels, as an `xarray.Dataset` with the names of stored plates.

        Dimensions are v and u, the film coordinates of the pixels' centers (v upward, u to the
        right, from -1 to 1), and rgb or xyz; numbers of the camera are attributes. `units` names
        the scene's unit of length (`scene.units`), which images do not store. Raises InputError if
        xarray is not installed.
        """
        images, places, attributes = self._labels(units)
        surfaces = {
            "triangle": Labelled(self.triangle, "triangle number, -1 for no surface"),
            "object": Labelled(self.object, "object number, -1 for no surface"),
            "height": Labelled(self.position[..., 2], "height above the plate", units),
            "position": Labelled(self.position, "visible surface point", units, last="xyz"),
            "color": Labelled(self.color, "linear radiance", NO_UNIT),
            "certainty": Labelled(
                self.certainty, "0 proven, 1 decided exactly, 2 tie, 3 not examined"
            ),
        }
        return dataset({**surfaces, **images}, places, attributes)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class HogelImage(SurfaceImage):
    """The image of one aperture. Row 0 is at the top; arrays are (H, W) or (H, W, 3)."""

    camera: HogelCamera
    triangle: Numbers  #: int32, `NOTHING` where there is no surface
    object: Numbers  #: int32, `NOTHING` where there is no surface
    #: Visible surface point in scene units, NaN without a surface: float64 from a reference,
    #: float32 from a rasterizer. Our rasterizers return a view of a structure of arrays.
    position: NDArray[np.floating]
    #: unit normal, oriented by the mesh's winding; NaN where there is no surface
    normal: NDArray[np.floating] | None = None
    color: Singles | None = None  #: linear RGB
    #: variance of a color that is a mean over light paths; None without noise
    variance: Singles | None = None
    certainty: Bytes | None = None  #: uint8 `Certainty`; None in images that are not certified
    #: (N, 3) row, column, triangle of surfaces that share a tie; None if not certified
    tied_triangles: Indices | None = None
    #: function that computes `overruled` with a float32 tracer; None if not certified
    second_opinion: Callable[[], Mask] | None = None
    #: simulated effects of the color; None if unknown or without color
    rendering: Rendering | None = None
    #: (H, W, 3) error bounds of coordinates by their storage; None if they are exact in float32.
    uncertainty: Floats | None = None
    #: name of a file format that changed the pixels, such as "JPEG, lossy"
    storage: str | None = None

    @cached_property
    def overruled(self) -> Mask | None:
        """Pixels where the float32 tracer shows another triangle; None if not certified."""
        return None if self.second_opinion is None else self.second_opinion()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for pickling: the evaluated second opinion, without the scene."""
        overruled = self.overruled
        return vars(self) | {
            "second_opinion": None if overruled is None else partial(np.asarray, overruled)
        }

    @cached_property
    def covered(self) -> Mask:
        """Pixels that show a surface, by number, or by position in images without numbers."""
        return read_only((self.triangle != NOTHING) | np.isfinite(self.height))

    @cached_property
    def off_plate(self) -> Mask:
        """Pixels that show a surface off the plate at a known position."""
        # Test the axes separately, because NumPy's reduction over such a short axis is ten times
        # slower.
        x, y, z = (self.position[..., axis] for axis in range(3))
        return read_only(self.covered & np.isfinite(x) & np.isfinite(y) & np.isfinite(z) & (z != 0))

    @property
    def height(self) -> NDArray[np.floating]:
        """Height above the plate, NaN where there is no surface."""
        return self.position[..., 2]

    def at(self, pixels: Indices) -> HogelImage:
        """Return a one-row image of pixels by their flat indices, without normals and colors."""
        names = ("triangle", "object", "position", "certainty")
        arrays = {name: value for name in names if (value := getattr(self, name)) is not None}
        some = {name: a.reshape(-1, *a.shape[2:])[pixels][None] for name, a in arrays.items()}
        return HogelImage(camera=self.camera, **some)

    def _labels(self, units: str) -> Labels:
        camera = self.camera
        at = camera.aperture
        places = {
            "column": Labelled(at.column, "column of the hogel, from the left"),
            "row": Labelled(at.row, "row of the hogel, from the top"),
            "x": Labelled(at.x, "x of the aperture", units),
            "y": Labelled(at.y, "y of the aperture", units),
        }
        names = ("shear", "half_extent", "reach", "scene", "scene_hash", "renderer", "light_paths")
        facts = {name: getattr(camera, name) for name in names}
        attributes = {
            "aperture": list(at.index),
            **{
                name: list(fact) if isinstance(fact, tuple) else fact
                for name, fact in facts.items()
            },
            "settings": None if camera.settings is None else dumps(asdict(camera.settings)),
        }
        variance = "variance of the color, which is a mean over light paths"
        images = {
            "normal": Labelled(
                self.normal, "unit normal by the mesh's winding", NO_UNIT, last="xyz"
            ),
            "variance": Labelled(self.variance, variance, NO_UNIT),
        }
        return images, places, attributes


def stacked(bands: Sequence[HogelImage]) -> HogelImage:
    """Join bands of rows of an image, from the top, with the arrays that all bands have."""
    if len(bands) == 1:
        return bands[0]
    names = ("camera", "rendering", "storage")
    whole: dict[str, Any] = {name: getattr(bands[0], name) for name in names}
    opinions = [band.second_opinion for band in bands if band.second_opinion is not None]
    opinion = (
        None
        if len(opinions) < len(bands)
        else lambda: np.concatenate([decide() for decide in opinions])
    )
    whole["second_opinion"] = opinion
    for name in (item.name for item in fields(HogelImage) if item.name not in whole):
        parts = [getattr(band, name) for band in bands]
        whole[name] = None if any(part is None for part in parts) else np.concatenate(parts)
    return HogelImage(**whole)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DirectionImage(ShortRepr):
    """True image by direction of a tile; arrays are (rows, columns) of hogels, row 0 on top.

    Each pixel is equal, bit for bit, to the same pixel in the image of its hogel.
    """

    tile: PlateTile
    pixel: tuple[int, int]  #: column and row of the pixel in every hogel
    triangle: Numbers  #: int32, -1 where there is no surface
    position: Floats  #: (rows, columns, 3) surface points, scene units; NaN where there is none
    normal: Floats | None  #: (rows, columns, 3) unit normals by the mesh's winding
    color: NDArray[Any] | None  #: (rows, columns, 3) linear RGB
    certainty: Bytes  #: uint8 `Certainty`
    tied_triangles: (
        Indices  #: (N, 3) row, column of the tile, triangle of surfaces that share a tie
    )


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
    """Image of a hogel; members are in the order of writing, and color is last."""

    CERTAINTY = "certainty"
    NORMAL = "normal"
    HEIGHT = "height"
    TRIANGLE = "triangle"
    COLOR = "color"


#: Images of a drawn hogel; only certified truths have the channel certainty.
DRAWN_CHANNELS = (Channel.COLOR, Channel.HEIGHT, Channel.TRIANGLE, Channel.NORMAL)


@dataclass(frozen=True, kw_only=True)
class PlateContent:
    """Images of a stream of hogels; InputError for unknown types, channels and effects."""

    color: ColorType = ColorType.FLOAT16  #: type of linear RGB
    ids: bool = False  #: true if the stream has triangle numbers, as with channel `TRIANGLE`
    channels: tuple[Channel, ...] = ()  #: in the order of `Channel`; by default color and `ids`
    #: None selects the effects that the scene needs; these effects give the same pictures
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
    normal: Singles | None = None  #: (H, W, 3) unit, by the mesh's winding, NaN without a surface
    certainty: Bytes | None = None  #: (H, W) uint8 `Certainty`

    def image(self, channel: Channel) -> NDArray[Any]:
        """Return one of the requested images."""
        image: NDArray[Any] | None = getattr(self, channel)
        assert image is not None, f"{channel} was not requested"
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
