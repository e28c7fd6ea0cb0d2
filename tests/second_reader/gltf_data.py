"""Container, buffers and accessors of glTF 2.0 (sections 3.6, 4.4 and 5.1 of the specification)."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

from tests.second_reader.model import Refused

COMPONENTS = {
    5120: ("b", 1),
    5121: ("B", 1),
    5122: ("h", 2),
    5123: ("H", 2),
    5125: ("I", 4),
    5126: ("f", 4),
}
LARGEST = {5120: 127, 5121: 255, 5122: 32767, 5123: 65535}  #: of normalized integers (section 3.11)
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
MAGIC, JSON_CHUNK, BINARY_CHUNK = b"glTF", 0x4E4F534A, 0x004E4942

Rows = list[tuple[float, ...]]


class Document:
    """JSON of a file and the bytes of its buffers."""

    def __init__(self, path: Path) -> None:
        text, self.binary = container(path.read_bytes())
        self.folder = path.parent
        try:
            self.json: dict[str, Any] = json.loads(text.removeprefix(b"\xef\xbb\xbf"))
        except ValueError as error:
            raise Refused(f"JSON: {error}") from None
        self.known: dict[int, bytes] = {}

    def item(self, kind: str, index: int) -> dict[str, Any]:
        """Return one entry of a list at the top."""
        items = self.json.get(kind, [])
        if not 0 <= index < len(items):
            raise Refused(f"{kind} has no entry {index}")
        entry: dict[str, Any] = items[index]
        return entry

    def buffer(self, index: int) -> bytes:
        """Return the bytes of a buffer: of a data URI, a file, or the chunk of a GLB."""
        if index not in self.known:
            entry = self.item("buffers", index)
            data = self._bytes(entry, index)
            if len(data) < entry["byteLength"]:
                raise Refused(f"buffer {index} is {len(data)} bytes, not {entry['byteLength']}")
            self.known[index] = data[: entry["byteLength"]]
        return self.known[index]

    def _bytes(self, entry: dict[str, Any], index: int) -> bytes:
        uri = entry.get("uri")
        if uri is None:
            if index != 0 or self.binary is None:
                raise Refused(f"buffer {index} has no data")
            return self.binary
        if uri.startswith("data:"):
            kind, _, data = uri.partition(",")
            try:
                return (
                    base64.b64decode(data) if kind.endswith(";base64") else unquote_to_bytes(data)
                )
            except ValueError as error:
                raise Refused(f"buffer {index}: {error}") from None
        try:
            return (self.folder / unquote(uri)).read_bytes()
        except OSError:
            raise Refused(f"buffer {uri} is not there") from None

    def view(self, index: int) -> tuple[bytes, int | None]:
        """Return the bytes of a buffer view and its stride."""
        view = self.item("bufferViews", index)
        start = view.get("byteOffset", 0)
        data = self.buffer(view["buffer"])[start : start + view["byteLength"]]
        if len(data) < view["byteLength"]:
            raise Refused(f"buffer view {index} ends beyond its buffer")
        return data, view.get("byteStride")

    def accessor(self, index: int) -> Rows:
        """Return the elements of an accessor: sparse ones replaced, normalized integers divided."""
        entry = self.item("accessors", index)
        kind, width, count = entry["componentType"], WIDTHS.get(entry["type"]), entry["count"]
        if width is None or kind not in COMPONENTS:
            raise Refused(f"accessor {index} of {entry['type']}, {kind}")
        rows: Rows = [(0,) * width] * count  # without a buffer view: zeros (3.6.2.3)
        if "bufferView" in entry:
            rows = self.rows(entry["bufferView"], entry.get("byteOffset", 0), (kind, width), count)
        if "sparse" in entry:
            self._replace(rows, entry["sparse"], (kind, width))
        if entry.get("normalized"):
            if kind not in LARGEST:
                raise Refused(f"accessor {index}: {kind} cannot be normalized")
            rows = [tuple(max(value / LARGEST[kind], -1.0) for value in row) for row in rows]
        return rows

    def _replace(self, rows: Rows, sparse: dict[str, Any], form: tuple[int, int]) -> None:
        where, values = sparse["indices"], sparse["values"]
        places = self.rows(
            where["bufferView"],
            where.get("byteOffset", 0),
            (where["componentType"], 1),
            sparse["count"],
        )
        new = self.rows(values["bufferView"], values.get("byteOffset", 0), form, sparse["count"])
        for (place,), row in zip(places, new, strict=True):
            if place >= len(rows):
                raise Refused(f"a sparse accessor replaces element {place} of {len(rows)}")
            rows[int(place)] = row

    def rows(self, view: int, offset: int, form: tuple[int, int], count: int) -> Rows:
        """Read elements of one form, (component type, width), from a buffer view."""
        data, stride = self.view(view)
        letter, size = COMPONENTS[form[0]]
        code = f"<{form[1]}{letter}"
        step = stride or form[1] * size
        if count and offset + step * (count - 1) + form[1] * size > len(data):
            raise Refused(f"buffer view {view} ends before its accessor")
        return [struct.unpack_from(code, data, offset + step * k) for k in range(count)]


def container(data: bytes) -> tuple[bytes, bytes | None]:
    """Return the JSON of a file, and the binary chunk of a GLB."""
    if data[:4] != MAGIC:
        return data, None
    if len(data) < 20:
        raise Refused("the header is cut off")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise Refused(f"GLB version {version}")
    if length > len(data):
        raise Refused(f"header says {length} bytes, file has {len(data)}")
    chunks, place = [], 12
    while place + 8 <= length:
        size, kind = struct.unpack_from("<II", data, place)
        if place + 8 + size > length:
            raise Refused("a chunk is cut off")
        chunks.append((kind, data[place + 8 : place + 8 + size]))
        place += 8 + size
    if not chunks or chunks[0][0] != JSON_CHUNK:
        raise Refused("the first chunk is not JSON")
    binary = next((body for kind, body in chunks[1:2] if kind == BINARY_CHUNK), None)
    return chunks[0][1], binary
