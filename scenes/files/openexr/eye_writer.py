"""Writing what an eye sees as OpenEXR: the channels of hogel images, and the eye in the header."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
from pydantic import TypeAdapter

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.openexr.channels import lossless_header, pixel_type, stored_planes
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
    planes = stored_planes(image)
    height, width = image.triangle.shape
    header = lossless_header((width, height), {name: pixel_type(name) for name in planes})
    header[EYE_ATTRIBUTE] = EYE_JSON.dump_json(image.eye)
    try:
        file = OpenEXR.OutputFile(str(path), header)
        file.writePixels(
            {name: np.ascontiguousarray(plane).tobytes() for name, plane in planes.items()}, height
        )
        file.close()
    except (OSError, RuntimeError) as error:
        raise InputError(f"{path.name}: cannot write the image; free some space") from error
