"""Channels of a hogel, packed for a page: those of an image file, and what judging has found out."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.attribution.budget import Budget
from xfrustum.compare.judging.judged import Figures
from xfrustum.compare.metrics.error_maps import ErrorMaps, displacement, judged_pixels
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


@dataclass(frozen=True, kw_only=True)
class InspectedHogel:
    """One hogel with all its channels.

    Attributes
    ----------
    aperture, size
        Column and row; width and height in pixels.
    words
        How bad the hogel is, in words.
    layers
        What its channels are.
    stream
        Values of all channels, one layer after the other, little-endian, as one zlib stream. Empty where the
        hogel has more than `MAX_INSPECTED_PIXELS`.
    """

    aperture: tuple[int, int]
    size: tuple[int, int]
    words: str
    layers: tuple[LayerHead, ...]
    stream: bytes

    @classmethod
    def of(cls, aperture: Aperture, words: str, layers: Sequence[Layer]) -> InspectedHogel:
        """Pack the layers of a hogel; all channels have one size."""
        height, width = layers[0].channels[0].values.shape
        stream = b""
        if width * height <= MAX_INSPECTED_PIXELS:
            packed = zlib.compressobj()
            parts = [packed.compress(one.content) for layer in layers for one in layer.channels]
            stream = b"".join((*parts, packed.flush()))
        heads = tuple(
            LayerHead(name=one.name, words=one.words, channels=tuple(c.head for c in one.channels))
            for one in layers
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """One number of every pixel: (H, W) float32, uint32 or uint8 values; see `ChannelHead`."""

    name: str
    values: NDArray[Any]
    labels: tuple[str, ...] = ()

    @property
    def head(self) -> ChannelHead:
        """What a page says of it."""
        return ChannelHead(name=self.name, kind=str(self.values.dtype), labels=self.labels)

    @property
    def content(self) -> bytes:
        """The values as bytes."""
        return np.ascontiguousarray(self.values, TYPES[str(self.values.dtype)]).tobytes()


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """Channels of one size that belong together, and what they show."""

    name: str
    words: str
    channels: tuple[Channel, ...]


def image_layer(name: str, words: str, image: HogelImage, *, said: bool = False) -> Layer:
    """Return the channels that an image has in a file, with the bits of that file.

    The height is left out: it is the third coordinate of the position. With `said` channels in which a
    foreign image says nothing at any pixel are left out, too.
    """
    planes = stored_planes(image)
    if said:
        planes = {one: values for one, values in planes.items() if np.nan_to_num(values).any()} or planes
    names = (*COLOR, TRIANGLE, OBJECT, CERTAINTY, *POSITION)
    ordered = [one for one in names if one in planes]
    ordered += [one for one in planes if one not in names and one != HEIGHT]
    labels = {CERTAINTY: tuple(CERTAINTY_LABELS.values())}
    channels = (Channel(name=one, values=planes[one], labels=labels.get(one, ())) for one in ordered)
    return Layer(name=name, words=words, channels=tuple(channels))


def classes(name: str, shape: tuple[int, int], masks: Mapping[str, Mask], otherwise: str) -> Channel:
    """Return a channel of classes: the label of the first mask that has a pixel, else `otherwise`."""
    values = np.zeros(shape, dtype=np.uint8)
    for number, mask in reversed(list(enumerate(masks.values(), start=1))):
        values[mask] = number
    return Channel(name=name, values=values, labels=(otherwise, *masks))


def _displacements(moved: NDArray[np.floating]) -> tuple[Channel, ...]:
    """Return (H, W, 2) displacements, px, as two channels, rounded to float32."""
    return tuple(
        Channel(name=name, values=moved[..., axis].astype(np.float32)) for axis, name in enumerate(MOVED)
    )


def _with_normals(image: HogelImage, scene: Scene) -> HogelImage:
    """Return an image with the normals of its triangles: all renderers that name triangles share them."""
    return image if image.normal is not None else replace(image, normal=normals_of(scene, image.triangle))


# Hogels that our own rasterizer draws


def inspected_drawings(
    judge: Judge, apertures: Sequence[Aperture], setting: DoubleFrustum, *, causes: bool = True
) -> Iterator[InspectedHogel]:
    """Yield the hogels of some apertures, drawn with a setting, and perhaps the causes of their errors."""
    finish, wanted = partial(inspected_frame, judge.scene), replace(DRAWN, causes=causes)
    with closing(judge.frames(apertures, (setting,), wanted, finish)) as frames:
        yield from frames


def inspected_frame(scene: Scene, frame: JudgedFrame) -> InspectedHogel:
    """Return a frame of a scene with its truth, its errors, and their causes where these were asked for."""
    numbers, settings = frame.comparison.numbers, frame.settings
    words = "" if numbers.surface is None else f"wrong surfaces {percent(numbers.surface.fraction)}"
    if numbers.displacement_px is not None:
        words += f", displacement (p99) {digits(numbers.displacement_px.p99)} px"
    drawing = f"rasterizer: near {digits(settings.near)}, {settings.depth_label}"
    errors = _drawn_errors(frame.comparison.maps, frame.budget)
    return InspectedHogel.of(
        frame.aperture,
        words,
        [
            image_layer(TRUTH, "truth", _with_normals(frame.truth, scene)),
            image_layer(IMAGE, drawing, _with_normals(frame.image, scene)),
            Layer(name=ERROR, words="errors of the image", channels=errors),
        ],
    )


def _drawn_errors(maps: ErrorMaps, budget: Budget | None) -> tuple[Channel, ...]:
    """Return what judging has found out, and the causes that it is charged to where these were found."""
    surface, outside, shape = maps.surface, maps.outside, maps.judged.shape
    assert surface is not None and outside is not None, "a judge has the scene at hand"
    states = {
        "tie, not judged": ~maps.judged,
        "wrong surface, whose point belongs outside the film": outside,
        "wrong surface": surface,
        "right surface, another triangle": maps.triangle,
    }
    causes: tuple[Channel, ...] = ()
    if budget is not None:
        links = {name: budget.surface_charge == number for number, name in enumerate(budget.links)}
        causes = (
            classes(LINK, shape, links, "none"),
            classes(ROUNDING, shape, budget.explanation.masks, "none"),
        )
    return (classes(STATE, shape, states, "right"), *causes, *_displacements(maps.displacement))


# Hogels of other renderers


def inspected_figures(
    scene: Scene, aperture: Aperture, as_found: Figures, corrected: Figures
) -> InspectedHogel:
    """Return a hogel of a scene, judged as it was found and after correction."""
    words = f"{as_found.limited_words} {percent(as_found.judged_fraction)}"
    if corrected is not as_found:
        words += f", corrected {percent(corrected.judged_fraction)}"
    errors = _foreign_errors(as_found, corrected)
    return InspectedHogel.of(
        aperture,
        words,
        [
            image_layer(TRUTH, "what it should show", _with_normals(as_found.answer, scene)),
            image_layer(IMAGE, "image, upright", as_found.image, said=True),
            Layer(name=ERROR, words="errors of the image", channels=errors),
        ],
    )


def _foreign_errors(as_found: Figures, corrected: Figures) -> tuple[Channel, ...]:
    """Return what is wrong before and after correction, and how far points are from where they belong."""

    def state(name: str, figures: Figures) -> Channel:
        masks = {"tie, not judged": ~judged_pixels(figures.answer), "wrong": figures.error}
        return classes(name, figures.error.shape, masks, "right")

    found = [state(STATE, as_found)]
    if corrected is not as_found:
        found.append(state(CORRECTED, corrected))
    if corrected.cause_masks is not None:
        found.append(classes(ROUNDING, corrected.error.shape, corrected.cause_masks.masks, "none"))
    if np.isfinite(as_found.image.position).any():
        found += _displacements(displacement(as_found.image, as_found.answer.camera))
    return tuple(found)
