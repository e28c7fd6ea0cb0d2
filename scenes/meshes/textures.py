"""Textures of a mesh file: pictures decoded once each."""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trimesh.visual.color import srgb_to_linear

from xfrustum.scenes.arrays import Bytes, Floats, Numbers
from xfrustum.scenes.disk import input_files
from xfrustum.scenes.disk.input_files import open_image, read_input
from xfrustum.scenes.meshes.content import MeshPart
from xfrustum.scenes.model.scene import UnreadFeature

#: Errors of Pillow at damage and at variants without a decoder; its plugins differ.
#: differ.
_DAMAGED = (
    ArithmeticError, EOFError, LookupError, OSError, RuntimeError, SyntaxError, TypeError,
    ValueError,
    struct.error,
)  # fmt: skip


def decode_textures(
    path: Path, parts: Sequence[MeshPart]
) -> tuple[tuple[Bytes, ...], Numbers | None, list[UnreadFeature]]:
    """Return decoded textures of parts, their numbers by triangle, and unread textures.

    Pictures are (H, W, 4) uint8 sRGB, row 0 at the top, each different one once; numbers (F,) are
    -1 where a triangle has none, and None where there are no pictures. Unread are textures that the
    file names and that are not shown, such as a damaged one.
    """
    pictures: list[Bytes] = []
    unread: list[UnreadFeature] = []
    # Parts of one picture share it: a texture of thousands of primitives is decoded once.
    keys = [(id(part.picture), part.texture, part.uv is None) for part in parts]
    numbers: dict[tuple[int, str | None, bool], int] = {}
    for part, key in zip(parts, keys, strict=True):
        if key in numbers:
            continue
        pixels, name = None, part.texture
        if part.picture is not None and part.uv is not None:
            input_files.check_picture_size(
                path, *part.picture.size
            )  # pictures within glTF files too
            with suppress(*_DAMAGED):  # Pillow decodes, and finds damage, only here
                if (
                    part.picture.mode == "I;16"
                ):  # gray of 16 bits, which Pillow would clip, not scale
                    gray = np.round(np.asarray(part.picture).astype(np.float64) / 257).astype(
                        np.uint8
                    )
                    pixels = np.dstack([gray, gray, gray, np.full_like(gray, 255)])
                elif part.picture.mode not in ("I", "F"):  # 32 bits a pixel, of any scale
                    pixels = np.array(part.picture.convert("RGBA"), dtype=np.uint8)
        numbers[key] = -1 if pixels is None else len(pictures)
        if pixels is not None:
            pictures.append(pixels)
        elif name is not None:
            there = name.startswith("in image") or file_beside(path, name) is not None
            lost = f"{'cannot be read' if there else 'is missing'}; the surface is drawn without it"
            if part.picture is not None and part.uv is None:
                lost = "is not shown: there are no coordinates"
            unread.append(UnreadFeature(feature=f"texture {name}", consequence=lost))
    indices = [
        np.full(len(part.faces), numbers[key], np.int32)
        for part, key in zip(parts, keys, strict=True)
    ]
    return tuple(pictures), np.concatenate(indices) if pictures else None, unread


def file_beside(path: Path, name: str) -> Path | None:
    """Return the file of a name in a mesh file's folder or below it; None without one."""
    name, folder = name.strip().replace("\\", "/"), path.parent.resolve()
    # Exporters write absolute paths of their own machine: the last part of such a path is tried.
    for candidate in (name, name.lstrip("/"), name.rpartition("/")[2]):
        with suppress(ValueError, OSError):  # no name of a file
            file = (folder / candidate).resolve()
            if candidate and file.is_relative_to(folder) and file.exists():
                return file
    return None


def open_picture(path: Path, name: str) -> Any:
    """Return the undecoded Pillow image of a texture; None where it cannot be opened."""
    file = file_beside(path, name)
    if file is None or not file.is_file() or not file.stat().st_size:
        return None
    return opened(read_input(file, "texture"))


def opened(data: bytes) -> Any:
    """Return the undecoded Pillow image of some bytes; None where it cannot be opened."""
    with suppress(*_DAMAGED):
        return open_image(io.BytesIO(data))
    return None


def linear_colors(stored: NDArray[Any]) -> Floats:
    """Return (V, 3) linear RGB of stored sRGB, alpha ignored.

    Numbers of 8 and 16 bits are shares of the largest. Others are shares of 255 if any is above 1,
    as some exporters of OBJ and PLY write, else of one. They are clipped, NaN to 0.
    """
    color = stored[:, :3].astype(np.float64)
    if stored.dtype in (np.uint8, np.uint16):
        color = color / (255.0 if stored.dtype == np.uint8 else 65535.0)
    else:
        color = np.where(np.isfinite(color), color, 0.0)
        color = np.clip(color / (255.0 if (color > 1).any() else 1.0), 0.0, 1.0)
    return np.asarray(srgb_to_linear(color), dtype=np.float64)
