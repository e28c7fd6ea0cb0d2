"""Names and types of an image's OpenEXR channels; its camera and rendering as text.

See CONVENTIONS.md, "Image files".
"""

from __future__ import annotations

from typing import Any

import Imath
from pydantic import TypeAdapter

from xfrustum.scenes.model.hogel_image import HogelCamera
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


def pixel_type(name: str) -> Any:
    """Return the stored type of a channel: unsigned numbers, or 32-bit floats."""
    numbers = name in (TRIANGLE, OBJECT, CERTAINTY)
    return Imath.PixelType(Imath.PixelType.UINT if numbers else Imath.PixelType.FLOAT)
