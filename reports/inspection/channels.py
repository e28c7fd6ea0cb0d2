"""Channels of a hogel: those of an image file, and what judging has found out, each an array with a name."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.raster.rasterizer import normals_of
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.files.openexr.channels import (
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """One number of every pixel.

    Attributes
    ----------
    name
        Name of the channel; that of the OpenEXR channel where there is one.
    values
        (H, W) float32, uint32 or uint8 values.
    labels
        Meanings of the values 0, 1, .., where these are classes.
    """

    name: str
    values: NDArray[Any]
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """Channels that belong together: a truth, an image, or errors.

    Attributes
    ----------
    name
        `TRUTH`, `IMAGE` or `ERROR`.
    words
        What the layer shows, for people.
    channels
        Channels of one size.
    """

    name: str
    words: str
    channels: tuple[Channel, ...]


def image_layer(name: str, words: str, image: HogelImage, *, said: bool = False) -> Layer:
    """Return the channels that an image has in a file, with the bits of that file.

    The height is left out: it is the third coordinate of the position.

    Parameters
    ----------
    name, words
        Name of the layer, and what it shows.
    image
        Image whose channels are returned.
    said
        Whether channels in which a foreign image says nothing at any pixel are left out.
    """
    planes = stored_planes(image)
    if said:
        spoken = {one: values for one, values in planes.items() if np.nan_to_num(values).any()}
        planes = spoken or planes
    names = (*COLOR, TRIANGLE, OBJECT, CERTAINTY, *POSITION)
    first = [one for one in names if one in planes]
    others = [one for one in planes if one not in names and one != HEIGHT]
    return Layer(
        name=name,
        words=words,
        channels=tuple(_stored(one, planes[one]) for one in (*first, *others)),
    )


def with_normals(image: HogelImage, scene: Scene) -> HogelImage:
    """Return an image with the normals of its triangles: all renderers that name triangles share them."""
    return image if image.normal is not None else replace(image, normal=normals_of(scene, image.triangle))


def _stored(name: str, values: NDArray[Any]) -> Channel:
    labels = tuple(CERTAINTY_LABELS.values()) if name == CERTAINTY else ()
    return Channel(name=name, values=values, labels=labels)


def classes(name: str, shape: tuple[int, int], masks: dict[str, Mask], otherwise: str) -> Channel:
    """Return a channel of classes: the label of the first mask that has a pixel, else `otherwise`."""
    values = np.zeros(shape, dtype=np.uint8)
    for number, mask in reversed(list(enumerate(masks.values(), start=1))):
        values[mask] = number
    return Channel(name=name, values=values, labels=(otherwise, *masks))


def displacement_channels(moved: NDArray[np.floating]) -> tuple[Channel, ...]:
    """Return (H, W, 2) displacements, px, as two channels, rounded to float32."""
    return tuple(
        Channel(name=name, values=np.ascontiguousarray(moved[..., axis], dtype=np.float32))
        for axis, name in enumerate(MOVED)
    )
