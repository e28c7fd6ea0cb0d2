"""Textures of a mesh file: pictures decoded once each."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from xfrustum.scenes.arrays import Bytes, Numbers
from xfrustum.scenes.disk import input_files
from xfrustum.scenes.meshes.content import MeshPart
from xfrustum.scenes.model.scene import UnreadFeature


def decode_textures(
    path: Path, parts: Sequence[MeshPart]
) -> tuple[tuple[Bytes, ...], Numbers | None, list[UnreadFeature]]:
    """Return decoded textures of a mesh file's parts, texture numbers of triangles, and unread textures.

    Pictures are (H, W, 4) uint8 sRGB, row 0 at the top, each different one once; numbers (F,) are -1 where a
    triangle has none, and None where there are no pictures. Unread are textures that the file names and that
    are not shown, such as a damaged one.
    """
    pictures: list[Bytes] = []
    unread: list[UnreadFeature] = []
    index_of_name: dict[str, int] = {}
    for part in parts:
        if part.name in index_of_name:
            continue
        pixels, name = None, part.texture
        if part.picture is not None:
            input_files.check_picture_size(path, *part.picture.size)  # pictures within glTF files too
            with suppress(OSError, SyntaxError, ValueError):  # Pillow decodes, and finds damage, only here
                if part.picture.mode == "I;16":  # gray of 16 bits, which Pillow would clip, not scale
                    gray = np.round(np.asarray(part.picture).astype(np.float64) / 257).astype(np.uint8)
                    pixels = np.dstack([gray, gray, gray, np.full_like(gray, 255)])
                elif part.picture.mode not in ("I", "F"):  # 32 bits a pixel, of any scale
                    pixels = np.array(part.picture.convert("RGBA"), dtype=np.uint8)
        index_of_name[part.name] = -1 if pixels is None else len(pictures)
        if pixels is not None:
            pictures.append(pixels)
            if part.uv is None:
                unread.append(
                    UnreadFeature(
                        feature=f"texture {name}", consequence="is not shown: there are no coordinates"
                    )
                )
        elif name is not None:
            there = name.startswith("in image") or (path.parent / name).is_file()
            lost = "cannot be read" if there else "is missing"
            unread.append(
                UnreadFeature(
                    feature=f"texture {name}", consequence=f"{lost}; the surface is drawn without it"
                )
            )
    indices = [np.full(len(part.faces), index_of_name[part.name], np.int32) for part in parts]
    return tuple(pictures), np.concatenate(indices) if pictures else None, unread
