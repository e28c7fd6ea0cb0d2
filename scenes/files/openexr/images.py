"""Hogel images as OpenEXR files (CONVENTIONS.md, "Image files"): one door for reading and writing."""

from __future__ import annotations

from xfrustum.scenes.files.openexr.reader import image_size, read_image
from xfrustum.scenes.files.openexr.writer import ImageWriter, write_image

__all__ = ["ImageWriter", "image_size", "read_image", "write_image"]
