"""Channels of a hogel, packed for a page: those of an image file, and what judging has found out."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.judging.judged import Figures
from xfrustum.compare.metrics.error_maps import displacement, judged_pixels
from xfrustum.compare.run import Judge, JudgedFrame, Wanted
from xfrustum.raster.rasterizer import normals_of
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.files.exr import (
    CERTAINTY,
    COLOR,
    HEIGHT,
    OBJECT,
    POSITION,
    TRIANGLE,
    stored_planes,
)
from xfrustum.scenes.model.hogel_image import Certainty, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import digits, percent
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

TRUTH, IMAGE, ERROR = "truth", "image", "error"
"""Names of the layers of a hogel."""

STATE, CORRECTED, LINK, ROUNDING = "state", "state.corrected", "cause", "rounding"
"""Names of the channels of errors that have labels."""

MOVED = ("displacement.X", "displacement.Y")
"""Names of the channels of displacement: columns to the right, rows down, px."""

CERTAINTY_LABELS = {
    Certainty.PROVEN: "proven in floating point",
    Certainty.EXACT: "decided in rational arithmetic",
    Certainty.TIE: "tie, not judged",
    Certainty.UNEXAMINED: "not examined",
}
"""Meanings of the values of `certainty`."""

TYPES = {"float32": "<f4", "uint32": "<u4", "uint8": "u1"}
"""Types of channels by their names on a page: those of the typed arrays of browsers."""

MAX_INSPECTED_PIXELS = 1 << 22
"""Largest number of pixels of a hogel that a page shows. A browser holds a hogel as one string in base64, in
Chromium of at most 2^29 - 24 characters. The channels of truth, image and errors take 103 bytes a pixel, 137
characters, which is 7 % too many for 2^22 pixels. Numbers of triangles, objects and certainty are 20 of these
bytes, and half of them, the upper ones, are always zero and take no room."""

MAX_HOGELS = 12
"""Largest number of hogels of a page and its files: at 512 x 512 pixels each takes several MB."""

DRAWN = Wanted(color=True, causes=True)
"""What frames must be judged with to be inspected: colors and causes."""


@dataclass(frozen=True, kw_only=True)
class ChannelHead:
    """Name, type (one of `TYPES`) and labels of a channel: meanings of the values 0, 1, .. of classes.

    The name is that of the OpenEXR channel where there is one.
    """

    name: str
    kind: str
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class LayerHead:
    """Name (truth, image, error), words for people, and channels of a layer."""

    name: str
    words: str
    channels: tuple[ChannelHead, ...]


Channel = tuple[NDArray[Any], tuple[str, ...]]
"""(H, W) values, float32, uint32 or uint8, and their labels; see `ChannelHead`."""

Layer = tuple[str, str, Mapping[str, Channel]]
"""Name, words, and channels by their names; all channels of a hogel have one size."""


@dataclass(frozen=True, kw_only=True)
class HogelHead:
    """What a page says of a hogel beside its values."""

    aperture: tuple[int, int]  #: column and row
    size: tuple[int, int]  #: width and height in pixels
    words: str  #: how bad the hogel is
    layers: tuple[LayerHead, ...]

    @property
    def head(self) -> dict[str, Any]:
        """These fields alone."""
        return {one.name: getattr(self, one.name) for one in fields(HogelHead)}


@dataclass(frozen=True, kw_only=True)
class InspectedHogel(HogelHead):
    """One hogel with all its channels."""

    #: Values of all channels, one layer after the other, little-endian, as one zlib stream. Empty where the
    #: hogel has more than `MAX_INSPECTED_PIXELS`.
    stream: bytes

    @classmethod
    def of(cls, aperture: Aperture, words: str, layers: Sequence[Layer]) -> InspectedHogel:
        """Pack the layers of a hogel."""
        every = [values for _, _, channels in layers for values, _ in channels.values()]
        height, width = every[0].shape
        stream = b""
        if width * height <= MAX_INSPECTED_PIXELS:
            packed = zlib.compressobj()
            contents = (np.ascontiguousarray(one, TYPES[str(one.dtype)]).tobytes() for one in every)
            stream = b"".join((*map(packed.compress, contents), packed.flush()))
        heads = tuple(
            LayerHead(
                name=name,
                words=shown,
                channels=tuple(
                    ChannelHead(name=one, kind=str(values.dtype), labels=labels)
                    for one, (values, labels) in channels.items()
                ),
            )
            for name, shown, channels in layers
        )
        return cls(aperture=aperture.index, size=(width, height), words=words, layers=heads, stream=stream)

    def values(self) -> dict[str, dict[str, NDArray[Any]]]:
        """Return the (H, W) values by the names of layer and channel; none of a hogel without a stream.

        Raises
        ------
        ValueError
            The stream does not hold these channels.
        """
        found: dict[str, dict[str, NDArray[Any]]] = {}
        content, place = zlib.decompress(self.stream) if self.stream else b"", 0
        for layer in self.layers if self.stream else ():
            found[layer.name] = {}
            for one in layer.channels:
                values = np.frombuffer(content, TYPES[one.kind], math.prod(self.size), place)
                found[layer.name][one.name] = values.reshape(self.size[::-1])
                place += values.nbytes
        if place != len(content):
            raise ValueError(f"{len(content)} bytes are not the channels of {self.size} pixels")
        return found


def image_channels(image: HogelImage, scene: Scene | None = None) -> dict[str, Channel]:
    """Return the channels that an image has in a file, with the bits of that file.

    The height is left out: it is the third coordinate of the position. With a scene, an image without normals
    has those of its triangles: all renderers that name triangles share them. Without, the image is a foreign
    one, and channels in which it says nothing at any pixel are left out.
    """
    if scene is not None and image.normal is None:
        image = replace(image, normal=normals_of(scene, image.triangle))
    planes = stored_planes(image)
    if scene is None:
        planes = {one: values for one, values in planes.items() if np.nan_to_num(values).any()} or planes
    first = [one for one in (*COLOR, TRIANGLE, OBJECT, CERTAINTY, *POSITION) if one in planes]
    labels = {CERTAINTY: tuple(CERTAINTY_LABELS.values())}
    return {
        one: (planes[one], labels.get(one, ())) for one in dict.fromkeys((*first, *planes)) if one != HEIGHT
    }


def _classes(masks: Mapping[str, Mask], otherwise: str) -> Channel:
    """Return a channel of classes: the label of the first mask that has a pixel, else `otherwise`."""
    values = np.zeros(next(iter(masks.values())).shape, dtype=np.uint8)
    for number, mask in reversed(list(enumerate(masks.values(), start=1))):
        values[mask] = number
    return values, (otherwise, *masks)


def _displacements(moved: NDArray[np.floating]) -> dict[str, Channel]:
    """Return (H, W, 2) displacements, px, as two channels, rounded to float32."""
    return {name: (moved[..., axis].astype(np.float32), ()) for axis, name in enumerate(MOVED)}


def inspected_drawings(
    judge: Judge, apertures: Sequence[Aperture], setting: DoubleFrustum, *, causes: bool = True
) -> Iterator[InspectedHogel]:
    """Yield the hogels of some apertures, drawn with a setting, and perhaps the causes of their errors."""
    finish, wanted = partial(inspected_frame, judge.scene), replace(DRAWN, causes=causes)
    with closing(judge.frames(apertures, (setting,), wanted, finish)) as frames:
        yield from frames


def inspected_frame(scene: Scene, frame: JudgedFrame) -> InspectedHogel:
    """Return a frame of our own rasterizer with its truth, errors, and causes where these were asked for."""
    numbers, settings, maps = frame.comparison.numbers, frame.settings, frame.comparison.maps
    words = "" if numbers.surface is None else f"wrong surfaces {percent(numbers.surface.fraction)}"
    if numbers.displacement_px is not None:
        words += f", displacement (p99) {digits(numbers.displacement_px.p99)} px"
    assert maps.surface is not None and maps.outside is not None, "a judge has the scene at hand"
    states = {
        "tie, not judged": ~maps.judged,
        "wrong surface, whose point belongs outside the film": maps.outside,
        "wrong surface": maps.surface,
        "right surface, another triangle": maps.triangle,
    }
    errors = {STATE: _classes(states, "right")}
    if (budget := frame.budget) is not None:
        links = {name: budget.surface_charge == number for number, name in enumerate(budget.links)}
        errors[LINK] = _classes(links, "none")
        errors[ROUNDING] = _classes(budget.explanation.masks, "none")
    errors |= _displacements(maps.displacement)
    drawing = f"rasterizer: near {digits(settings.near)}, {settings.depth_label}"
    layers = [
        (TRUTH, "truth", image_channels(frame.truth, scene)),
        (IMAGE, drawing, image_channels(frame.image, scene)),
        (ERROR, "errors of the image", errors),
    ]
    return InspectedHogel.of(frame.aperture, words, layers)


def inspected_figures(
    scene: Scene, aperture: Aperture, as_found: Figures, corrected: Figures
) -> InspectedHogel:
    """Return a hogel of another renderer, judged as it was found and after correction."""

    def state(figures: Figures) -> Channel:
        masks = {"tie, not judged": ~judged_pixels(figures.answer), "wrong": figures.error}
        return _classes(masks, "right")

    words = f"{as_found.numbers.limited_words} {percent(as_found.numbers.judged_fraction)}"
    errors = {STATE: state(as_found)}
    if corrected is not as_found:
        words += f", corrected {percent(corrected.numbers.judged_fraction)}"
        errors[CORRECTED] = state(corrected)
    if corrected.cause_masks is not None:
        errors[ROUNDING] = _classes(corrected.cause_masks.masks, "none")
    if np.isfinite(as_found.image.position).any():
        errors |= _displacements(displacement(as_found.image, as_found.answer.camera))
    layers = [
        (TRUTH, "what it should show", image_channels(as_found.answer, scene)),
        (IMAGE, "image, upright", image_channels(as_found.image)),
        (ERROR, "errors of the image", errors),
    ]
    return InspectedHogel.of(aperture, words, layers)
