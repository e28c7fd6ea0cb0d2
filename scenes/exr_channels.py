"""Names and types of an image's OpenEXR channels, and its camera as text (design, section 7)."""

from __future__ import annotations

from typing import Any

import Imath
from pydantic import TypeAdapter

from xfrustum.scenes.hogel_image import HogelCamera

CAMERA_ATTRIBUTE = "xfrustum:camera"
POSITION = ("P.X", "P.Y", "P.Z")
NORMAL = ("N.X", "N.Y", "N.Z")
COLOR = ("R", "G", "B")
VARIANCE = ("variance.R", "variance.G", "variance.B")
HEIGHT, TRIANGLE, OBJECT, CERTAINTY = "Z", "id.triangle", "id.object", "certainty"
CHANNELS = (*COLOR, *VARIANCE, *POSITION, *NORMAL, HEIGHT, TRIANGLE, OBJECT, CERTAINTY)

CAMERA_JSON = TypeAdapter(HogelCamera)
"""Writes the shortest digits that give the same double again."""


def pixel_type(name: str) -> Any:
    """Return the stored type of a channel: unsigned numbers, or 32-bit floats."""
    numbers = name in (TRIANGLE, OBJECT, CERTAINTY)
    return Imath.PixelType(Imath.PixelType.UINT if numbers else Imath.PixelType.FLOAT)
