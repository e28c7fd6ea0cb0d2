"""Writing what an eye sees as OpenEXR: the channels of hogel images, and the eye in the header."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import Imath
import numpy as np
import OpenEXR
from numpy.typing import NDArray
from pydantic import TypeAdapter

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.openexr.channels import (
    CERTAINTY,
    COLOR,
    HEIGHT,
    OBJECT,
    POSITION,
    TRIANGLE,
    pixel_type,
)
from xfrustum.scenes.model.eye import Eye
from xfrustum.scenes.model.eye_image import EyeImage

EYE_ATTRIBUTE = "xfrustum:eye"
"""Attribute of the header that holds the eye as JSON."""

EYE_JSON = TypeAdapter(Eye)


def write_eye_image(path: Path, image: EyeImage) -> None:
    """Write what an eye sees: floats in 32 bits, numbers plus one, lossless.

    The file is written under its own name: the caller puts it in place.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    planes: dict[str, NDArray[Any]] = {
        TRIANGLE: (image.triangle + 1).astype(np.uint32),
        OBJECT: (image.object + 1).astype(np.uint32),
        HEIGHT: image.position[..., 2].astype(np.float32),
    }
    if image.certainty is not None:
        planes[CERTAINTY] = image.certainty.astype(np.uint32)
    for names, array in ((POSITION, image.position), (COLOR, image.color)):
        if array is not None:
            planes |= {name: array[..., axis].astype(np.float32) for axis, name in enumerate(names)}
    height, width = image.triangle.shape
    header = OpenEXR.Header(width, height)
    header["compression"] = Imath.Compression(Imath.Compression.ZIP_COMPRESSION)
    header["channels"] = {name: Imath.Channel(pixel_type(name)) for name in planes}
    header[EYE_ATTRIBUTE] = EYE_JSON.dump_json(image.eye)
    try:
        file = OpenEXR.OutputFile(str(path), header)
        file.writePixels(
            {name: np.ascontiguousarray(plane).tobytes() for name, plane in planes.items()}, height
        )
        file.close()
    except (OSError, RuntimeError) as error:
        raise InputError(f"{path.name}: cannot write the image; free some space") from error
