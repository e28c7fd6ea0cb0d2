"""Files of hogels in plain Python, from what Cycles renders: PNG, and OpenEXR without compression.

Blender's own Python has no library that writes OpenEXR channels of whole numbers. `render.py` imports this
file from the folder in which both lie.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

TRIANGLE, OBJECT = "xfrustum_triangle", "xfrustum_object"
"""Names of the passes, and of the attributes of faces, that hold numbers from 1; 0 is nothing."""

Array = np.ndarray[Any, Any]
"""Numbers of any type and shape."""


class UnreadableError(Exception):
    """A file that is written otherwise than this script asks Blender to write it."""


def png(pixels: Array) -> bytes:
    """Return (H, W, 3) uint8 pixels as a PNG file."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return (
            struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
        )

    height, width, _ = pixels.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), pixels.reshape(height, -1)], axis=1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(rows.tobytes(), 6)), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def exr(planes: Mapping[str, Array]) -> bytes:
    """Return (H, W) planes of float32 or uint32 as an OpenEXR file without compression."""
    names = sorted(planes)
    height, width = planes[names[0]].shape

    def attribute(name: str, kind: str, content: bytes) -> bytes:
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<I", len(content)) + content

    kinds = {name: 0 if planes[name].dtype == np.uint32 else 2 for name in names}
    channels = b"".join(name.encode() + b"\0" + struct.pack("<IIII", kinds[name], 0, 1, 1) for name in names)
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    header = b"".join(
        (
            struct.pack("<II", 20000630, 2),
            attribute("channels", "chlist", channels + b"\0"),
            attribute("compression", "compression", b"\0"),
            attribute("dataWindow", "box2i", window),
            attribute("displayWindow", "box2i", window),
            attribute("lineOrder", "lineOrder", b"\0"),
            attribute("pixelAspectRatio", "float", struct.pack("<f", 1)),
            attribute("screenWindowCenter", "v2f", struct.pack("<ff", 0, 0)),
            attribute("screenWindowWidth", "float", struct.pack("<f", 1)),
            b"\0",
        )
    )
    lines = [
        b"".join(planes[name][row].astype("<u4" if kinds[name] == 0 else "<f4").tobytes() for name in names)
        for row in range(height)
    ]
    start = len(header) + 8 * height
    offsets = start + np.cumsum([0, *(8 + len(line) for line in lines[:-1])])
    body = b"".join(struct.pack("<iI", row, len(line)) + line for row, line in enumerate(lines))
    table: bytes = offsets.astype("<u8").tobytes()
    return header + table + body


def exr_planes(content: bytes) -> dict[str, Array]:
    """Return the (H, W) planes of an OpenEXR file as Blender writes it: one part, lines, no compression."""
    _, flags = struct.unpack_from("<II", content)
    if flags & ~0x4FF:
        raise UnreadableError(
            "Blender wrote an OpenEXR file of several parts, which this script does not read"
        )
    place, attributes = 8, {}
    while content[place]:
        name, kind = (part.decode() for part in content[place:].split(b"\0", 2)[:2])
        place += len(name) + len(kind) + 2
        (size,) = struct.unpack_from("<I", content, place)
        attributes[name] = content[place + 4 : place + 4 + size]
        place += 4 + size
    left, top, right, bottom = struct.unpack("<iiii", attributes["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    if attributes["compression"] != b"\0":
        raise UnreadableError("Blender wrote a compressed OpenEXR file, which this script does not read")
    names, kinds, listed = [], [], attributes["channels"]
    while listed[0]:
        channel, rest = listed.split(b"\0", 1)
        names.append(channel.decode())
        kinds.append({0: "<u4", 1: "<f2", 2: "<f4"}[struct.unpack_from("<I", rest)[0]])
        listed = rest[16:]
    line = np.dtype(
        [("y", "<i4"), ("size", "<u4"), *((n, k, (width,)) for n, k in zip(names, kinds, strict=True))]
    )
    rows = np.frombuffer(content, line, count=height, offset=place + 1 + 8 * height)
    return {name: rows[name].astype(np.float32) for name in names}


def encoded(
    planes: Mapping[str, Array], plate: Mapping[str, Any], to_plate: Array, encoding: str, mesh: Path
) -> bytes:
    """Return a hogel's file from the passes that Cycles wrote, by the names of their channels.

    It is PNG for the encoding `triangle-id`, OpenEXR for `exr`; `to_plate` takes the world to the plate's
    frame, `mesh` is the file of the scene's triangles. Surfaces beyond the reach are left out: no other
    surface can lie before them on the pixel's line. Raises UnreadableError where numbers are missing.
    """
    world = np.stack(_named(planes, "Position.X", "Position.Y", "Position.Z"), axis=-1).astype(np.float64)
    position = world @ to_plate[:3, :3].T + to_plate[:3, 3]
    shown = (_named(planes, "Combined.A")[0] > 0) & (position[..., 2] >= -plate["reach"][1])
    numbers = {
        attribute: np.where(shown, np.rint(plane), 0).astype(np.uint32)
        for attribute in (TRIANGLE, OBJECT)
        for name, plane in planes.items()
        if f".{attribute}." in name
    }
    if encoding == "triangle-id":
        if not numbers:
            raise UnreadableError(
                "only the mesh of the scene file has numbers of triangles; use --encoding exr"
            )
        number = numbers[TRIANGLE]
        return png(np.stack((number >> 16, number >> 8 & 255, number & 255), axis=-1).astype(np.uint8))
    points = np.where(shown, np.moveaxis(position, -1, 0), np.nan)
    written: dict[str, Array] = dict(zip(("P.X", "P.Y", "P.Z", "Z"), (*points, points[2]), strict=True))
    if numbers:
        written |= dict(zip(("N.X", "N.Y", "N.Z"), _normals(numbers[TRIANGLE], mesh), strict=True))
    else:
        written |= _seen(planes, shown, to_plate)
    stored: dict[str, Array] = {name: plane.astype(np.float32) for name, plane in written.items()}
    if numbers:
        stored |= {"id.triangle": numbers[TRIANGLE], "id.object": numbers[OBJECT]}
    return exr(stored)


def _seen(planes: Mapping[str, Array], shown: Array, to_plate: Array) -> dict[str, Array]:
    """Return the normals, in the plate's frame, and the colors that Cycles saw."""
    seen = np.stack(_named(planes, "Normal.X", "Normal.Y", "Normal.Z"), axis=-1)
    turned = seen @ (to_plate[:3, :3] / np.linalg.norm(to_plate[:3, 0])).T
    normals = np.where(shown, np.moveaxis(turned, -1, 0), np.nan)
    colors = np.where(shown, _named(planes, "Combined.R", "Combined.G", "Combined.B"), 0)
    return dict(zip(("N.X", "N.Y", "N.Z", "R", "G", "B"), (*normals, *colors), strict=True))


def _named(planes: Mapping[str, Array], *channels: str) -> list[Array]:
    """Return the planes of channels, whatever the view layer is called."""
    return [next(plane for name, plane in planes.items() if name.endswith(f".{end}")) for end in channels]


def _normals(number: Array, mesh: Path) -> Iterator[Array]:
    """Yield x, y and z of the normals of numbered triangles by their winding, NaN where there is none."""
    with np.load(mesh) as stored:
        corners = stored["vertices"][stored["faces"]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(invalid="ignore", divide="ignore"):
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    for axis in range(3):
        yield np.append(np.nan, normal[:, axis])[number]
