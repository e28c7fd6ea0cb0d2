"""One hogel on an inspection page: what its channels are, and all their values packed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from xfrustum.reports.inspection.channels import Layer
from xfrustum.reports.inspection.packing import packed, unpacked
from xfrustum.scenes.plate.plate import Aperture

MAX_INSPECTED_PIXELS = 1 << 22
"""Largest number of pixels of a hogel that a page shows. A browser holds a hogel as one string in base64, in
Chromium of at most 2^29 - 24 characters. The channels of truth, image and errors take 103 bytes a pixel, 137
characters, which is 7 % too many for 2^22 pixels. Numbers of triangles, objects and certainty are 20 of these
bytes, and half of them, the upper ones, are always zero and take no room."""


MAX_HOGELS = 12
"""Largest number of hogels of a page and its files: at 512 x 512 pixels each takes from 1 to 8 MB."""


@dataclass(frozen=True, kw_only=True)
class ChannelHead:
    """Name, type (one of `packing.TYPES`) and labels of a channel; see `Channel`."""

    name: str
    kind: str
    labels: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class LayerHead:
    """Name, words and channels of a layer; see `Layer`."""

    name: str
    words: str
    channels: tuple[ChannelHead, ...]


@dataclass(frozen=True, kw_only=True)
class InspectedHogel:
    """One hogel with all its channels.

    Attributes
    ----------
    aperture
        Column and row.
    size
        Width and height in pixels.
    words
        How bad the hogel is, in words.
    layers
        What its channels are.
    stream
        Values of all channels, one layer after the other; see `packed`. Empty where the hogel has more than
        `MAX_INSPECTED_PIXELS`.
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
        fits = width * height <= MAX_INSPECTED_PIXELS
        values = [channel.values for layer in layers for channel in layer.channels]
        return cls(
            aperture=aperture.index,
            size=(width, height),
            words=words,
            layers=tuple(_head(layer) for layer in layers),
            stream=packed(values) if fits else b"",
        )

    @property
    def kinds(self) -> list[str]:
        """Types of all channels, one layer after the other."""
        return [channel.kind for layer in self.layers for channel in layer.channels]

    def values(self) -> dict[str, dict[str, NDArray[Any]]]:
        """Return the (H, W) values by the names of layer and channel; none of a hogel without a stream."""
        if not self.stream:
            return {}
        arrays = iter(unpacked(self.stream, self.kinds, self.size))
        return {
            layer.name: {channel.name: next(arrays) for channel in layer.channels} for layer in self.layers
        }


def _head(layer: Layer) -> LayerHead:
    return LayerHead(
        name=layer.name,
        words=layer.words,
        channels=tuple(
            ChannelHead(name=one.name, kind=str(one.values.dtype), labels=one.labels)
            for one in layer.channels
        ),
    )
