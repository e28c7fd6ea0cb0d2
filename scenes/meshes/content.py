"""Content of a mesh file: parts, in the file's coordinates, and textures, each decoded once."""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trimesh.visual.color import srgb_to_linear

from xfrustum.scenes.arrays import Bytes, Floats, Indices, Numbers
from xfrustum.scenes.disk import check_picture_size, open_image, read_input
from xfrustum.scenes.model.scene import UNTEXTURED, UnreadFeature
from xfrustum.scenes.shapes import cofactors

#: Errors that Pillow's plugins raise for damaged files and for variants without a decoder.
_DAMAGED = (
    ArithmeticError, EOFError, LookupError, OSError, RuntimeError, SyntaxError, TypeError,
    ValueError,
    struct.error,
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshPart:
    """Placed triangles of one mesh of a file; parts with the same picture share a texture."""

    vertices: Floats  #: (V, 3) double precision
    faces: Indices  #: (F, 3) int64 indices into `vertices`
    name: str = ""
    uv: Floats | None = None  #: (V, 2), v up
    color: Floats | None = None  #: (V, 3) or (3,) linear RGB
    #: (V, 3) unit normals on the winding's side, NaN where there is none
    normals: Floats | None = None
    picture: Any = None  #: Pillow image of the texture, opened and not yet decoded
    texture: str | None = None  #: name of the texture in the file


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshContent:
    """Parts of a mesh file in the order of their triangle numbers, and the features left out."""

    parts: tuple[MeshPart, ...]
    unread: tuple[UnreadFeature, ...] = ()


def unit_normals(normals: Floats) -> Floats:
    """Return (V, 3) unit normals; NaN for normals that are zero or not finite."""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(normals, axis=1, keepdims=True)
    usable = np.isfinite(length) & (length > 0)
    return np.asarray(np.divide(normals, length, out=np.full(normals.shape, np.nan), where=usable))


def carried(
    matrices: Floats, faces: Indices, normals: Floats | None
) -> tuple[Indices, Floats | None]:
    """Return faces (N, F, 3) and normals (N, V, 3) transformed by (N, 3, 3) matrices.

    For a matrix that mirrors, the winding is reversed, so that the outside remains outside; normals
    remain on the outside.
    """
    mirrored = np.linalg.det(matrices) < 0
    placed = np.repeat(faces[None], len(matrices), axis=0)
    placed[mirrored] = placed[mirrored][..., ::-1]
    if normals is None:
        return placed, None
    sides = np.where(mirrored, -1.0, 1.0)[:, None, None]
    return placed, normals @ (cofactors(matrices) * sides)


def decode_textures(
    path: Path, parts: Sequence[MeshPart]
) -> tuple[tuple[Bytes, ...], Numbers | None, list[UnreadFeature]]:
    """Return decoded textures of parts, their numbers by triangle, and unread textures.

    Pictures are (H, W, 4) uint8 sRGB, row 0 at the top, without duplicates. Numbers (F,) are
    `UNTEXTURED` for triangles without a texture; the array is None if there are no pictures. Unread
    textures are named in the file but not shown, for example because they are damaged.
    """
    pictures: list[Bytes] = []
    unread: list[UnreadFeature] = []
    numbers: dict[tuple[int, str | None, bool], int] = {}
    # Parts share equal pictures, so that a texture of thousands of primitives is decoded once.
    keys = [(id(part.picture), part.texture, part.uv is None) for part in parts]
    for key, part in dict(zip(keys, parts, strict=True)).items():
        picture, name = part.picture, part.texture
        pixels = None if picture is None or part.uv is None else _pixels(path, picture)
        numbers[key] = UNTEXTURED if pixels is None else len(pictures)
        if pixels is not None:
            pictures.append(pixels)
        elif name is not None:
            there = name.startswith("in image") or file_beside(path, name) is not None
            lost = f"{'cannot be read' if there else 'is missing'}; the surface is drawn without it"
            if picture is not None and part.uv is None:
                lost = "is not shown: there are no coordinates"
            unread.append(UnreadFeature(f"texture {name}", lost))
    if not pictures:
        return (), None, unread
    counts = [len(part.faces) for part in parts]
    of_part = np.array([numbers[key] for key in keys], np.int32)
    return tuple(pictures), np.repeat(of_part, counts), unread


def _pixels(path: Path, picture: Any) -> Bytes | None:
    """Return the pixels (H, W, 4) of a Pillow image; None if damaged or with 32-bit channels."""
    check_picture_size(path, *picture.size)  # also for pictures within glTF files
    with suppress(*_DAMAGED):  # Pillow decodes, and detects damage, only here
        if picture.mode == "I;16":  # gray of 16 bits, which Pillow would clip, not scale
            gray = np.round(np.asarray(picture).astype(np.float64) / 257).astype(np.uint8)
            return np.dstack([gray, gray, gray, np.full_like(gray, 255)])
        if picture.mode not in ("I", "F"):  # pixels of 32 bits have no defined scale
            return np.array(picture.convert("RGBA"), dtype=np.uint8)
    return None


def file_beside(path: Path, name: str) -> Path | None:
    """Return a file by its name in the folder of a mesh file or below; None if not found."""
    name, folder = name.strip().replace("\\", "/"), path.parent.resolve()
    # Exporters write absolute paths of their own machine: try the last part of such a path.
    for candidate in (name, name.lstrip("/"), name.rpartition("/")[2]):
        with suppress(ValueError, OSError):  # not a possible file name
            file = (folder / candidate).resolve()
            if candidate and file.is_relative_to(folder) and file.exists():
                return file
    return None


def open_picture(path: Path, name: str) -> Any:
    """Return the undecoded Pillow image of a texture; None if it cannot be opened."""
    file = file_beside(path, name)
    if file is None or not file.is_file() or not file.stat().st_size:
        return None
    return opened(read_input(file, "texture"))


def opened(data: bytes) -> Any:
    """Return the undecoded Pillow image of encoded bytes; None if it cannot be opened."""
    with suppress(*_DAMAGED):
        return open_image(io.BytesIO(data))
    return None


def linear_colors(stored: NDArray[Any]) -> Floats:
    """Return (V, 3) linear RGB of stored sRGB, alpha ignored.

    Integers of 8 and 16 bits are divided by their largest value. Other numbers are divided by 255
    if any exceeds 1, as some exporters of OBJ and PLY write. Results are clipped to 0..1, and NaN
    becomes 0.
    """
    color = stored[:, :3].astype(np.float64)
    if stored.dtype in (np.uint8, np.uint16):
        color = color / (255.0 if stored.dtype == np.uint8 else 65535.0)
    else:
        color = np.where(np.isfinite(color), color, 0.0)
        color = np.clip(color / (255.0 if (color > 1).any() else 1.0), 0.0, 1.0)
    return np.asarray(srgb_to_linear(color), dtype=np.float64)
