"""Files of a block's hogels: Zarr shards, whose index tells which hogels are there, and single chunks.

A shard is the chunks of its hogels, one after the other, and an index at its end: for each chunk its first
byte and its number of bytes, both `ABSENT` where there is none, as 64-bit numbers; then the index's CRC-32C
(Zarr v3, codec `sharding_indexed`). Hogels lie in the order of rows, so that equal hogels make equal files,
whatever the order in which they were drawn. A block of one hogel is stored as its chunk alone.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import google_crc32c
import numpy as np

from xfrustum.reports.plate.chunks import is_frame, opened

ABSENT = 2**64 - 1
"""First byte and number of bytes of a chunk that is not there."""

_INDEX_ENTRY = np.dtype("<u8")
_CHECKSUM_BYTES = 4


@dataclass(frozen=True, kw_only=True)
class BlockFile:
    """What a file holds of a block: the places of its chunks.

    Attributes
    ----------
    path
        Path of the file.
    places
        First byte and number of bytes of each chunk that is there and whole, by its number in the block.
    damaged
        Numbers of chunks that are there and not whole; all numbers where the file is no shard at all.
    """

    path: Path
    places: Mapping[int, tuple[int, int]]
    damaged: frozenset[int]

    def chunks(self) -> dict[int, bytes]:
        """Return the chunks that are whole, by their numbers."""
        if not self.places:
            return {}
        data = self.path.read_bytes()
        return {number: data[start : start + size] for number, (start, size) in self.places.items()}


def read_places(path: Path, chunks: int, content_bytes: int) -> BlockFile:
    """Look at a block's file without decompressing anything.

    Parameters
    ----------
    path
        Path of the file, which need not exist.
    chunks
        Number of chunks of a whole block; a block of one is no shard.
    content_bytes
        Number of bytes of a chunk when it is decompressed.
    """
    every = frozenset(range(chunks))
    with opened(path) as file:
        if file is None:
            there = path.exists() or path.is_symlink()
            return BlockFile(path=path, places={}, damaged=every if there else frozenset())
        descriptor, size = file
        index = {0: (0, size)} if chunks == 1 else _index(descriptor, size, chunks)
        if index is None:
            return BlockFile(path=path, places={}, damaged=every)
        places = {
            number: place for number, place in index.items() if is_frame(descriptor, place, content_bytes)
        }
    return BlockFile(path=path, places=places, damaged=frozenset(index) - frozenset(places))


def _index(descriptor: int, size: int, chunks: int) -> dict[int, tuple[int, int]] | None:
    """Return the places of the chunks that a shard has; None where its index is not whole."""
    length = 2 * _INDEX_ENTRY.itemsize * chunks
    body = size - length - _CHECKSUM_BYTES
    if body < 0:
        return None
    try:
        read = os.pread(descriptor, length + _CHECKSUM_BYTES, body)
    except OSError:
        return None
    index, checksum = read[:length], read[length:]
    if checksum != _checksum(index):
        return None
    entries = np.frombuffer(index, _INDEX_ENTRY).reshape(chunks, 2).tolist()
    places = {number: (start, count) for number, (start, count) in enumerate(entries) if start != ABSENT}
    return places if all(start + count <= body for start, count in places.values()) else None


def assembled(chunks: Mapping[int, bytes], count: int) -> bytes:
    """Return the file of a block.

    Parameters
    ----------
    chunks
        Chunks by their numbers in the block.
    count
        Number of chunks of a whole block.
    """
    if count == 1:
        return chunks[0]
    index = np.full((count, 2), ABSENT, dtype=_INDEX_ENTRY)
    place = 0
    for number in sorted(chunks):
        index[number] = place, len(chunks[number])
        place += len(chunks[number])
    entries = index.tobytes()
    return b"".join([*(chunks[number] for number in sorted(chunks)), entries, _checksum(entries)])


def _checksum(data: bytes) -> bytes:
    return int(google_crc32c.value(data)).to_bytes(_CHECKSUM_BYTES, "little")
