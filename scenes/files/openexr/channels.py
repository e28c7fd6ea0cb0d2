"""Names, types and pixels of an image's OpenEXR channels; its camera and rendering as text.

See CONVENTIONS.md, "Image files".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import Imath
import numpy as np
import OpenEXR
from numpy.typing import NDArray
from pydantic import TypeAdapter

from xfrustum.scenes.model.eye_image import EyeImage
from xfrustum.scenes.model.hogel_image import HogelCamera, HogelImage
from xfrustum.scenes.model.rendering import Rendering

CAMERA_ATTRIBUTE, RENDERING_ATTRIBUTE = "xfrustum:camera", "xfrustum:rendering"
POSITION = ("P.X", "P.Y", "P.Z")
NORMAL = ("N.X", "N.Y", "N.Z")
COLOR = ("R", "G", "B")
VARIANCE = ("variance.R", "variance.G", "variance.B")
HEIGHT, TRIANGLE, OBJECT, CERTAINTY = "Z", "id.triangle", "id.object", "certainty"
CHANNELS = (*COLOR, *VARIANCE, *POSITION, *NORMAL, HEIGHT, TRIANGLE, OBJECT, CERTAINTY)

CAMERA_JSON = TypeAdapter(HogelCamera)
"""The camera as JSON, whose numbers are the shortest digits that give the same double again."""

RENDERING_JSON = TypeAdapter(Rendering)
"""The rendering as JSON."""


def lossless_header(resolution: tuple[int, int], types: Mapping[str, Any]) -> dict[str, Any]:
    """Return the header of a lossless file of W x H pixels; its channels have some pixel types by name."""
    header: dict[str, Any] = OpenEXR.Header(*resolution)
    header["compression"] = Imath.Compression(Imath.Compression.ZIP_COMPRESSION)
    header["channels"] = {name: Imath.Channel(kind) for name, kind in types.items()}
    return header


def stored_planes(image: HogelImage | EyeImage) -> dict[str, NDArray[Any]]:
    """Return every channel that an image has, by its name, (H, W), with the type and bits of a file."""
    planes: dict[str, NDArray[Any]] = {
        HEIGHT: image.position[..., 2].astype(np.float32),
        TRIANGLE: (image.triangle + 1).astype(np.uint32),
        OBJECT: (image.object + 1).astype(np.uint32),
    }
    if image.certainty is not None:
        planes[CERTAINTY] = image.certainty.astype(np.uint32)
    vectors: list[tuple[tuple[str, str, str], NDArray[Any] | None]] = [
        (POSITION, image.position),
        (COLOR, image.color),
    ]
    if isinstance(image, HogelImage):
        vectors += [(NORMAL, image.normal), (VARIANCE, image.variance)]
    for names, array in vectors:
        if array is not None:
            planes |= {name: array[..., axis].astype(np.float32) for axis, name in enumerate(names)}
    return planes


def pixel_type(name: str) -> Any:
    """Return the stored type of a channel: unsigned numbers, or 32-bit floats."""
    numbers = name in (TRIANGLE, OBJECT, CERTAINTY)
    return Imath.PixelType(Imath.PixelType.UINT if numbers else Imath.PixelType.FLOAT)
