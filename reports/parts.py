"""A folder of Parquet parts: one for each block, each there whole or not at all.

A part is written aside and renamed when it is on the disk: a part that is there is a block that is
finished, whatever happened to the process that wrote it. A part carries a digest of its bytes: one
that does not agree was damaged from outside, and counts as missing. The folder says what its rows
were made from, and refuses to be continued with anything else.
"""

import hashlib
import io
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from xfrustum.reports.common.outputs import json_object, refused
from xfrustum.scenes import InputError
from xfrustum.scenes.disk.durable import write_file
from xfrustum.scenes.disk.input_files import read_input
from xfrustum.scenes.model.scene import Scene, look_hash

DESCRIPTION = "_description.json"
"""File beside the parts; readers of Parquet leave out names that begin like this."""

_DIGEST = re.compile(rb"xfrustum:sha256[^0-9a-f]{1,8}([0-9a-f]{64})")
"""Digest of a part in the part itself, among the key-value pairs of Parquet's footer: the SHA-256 of the file
with zeros in place of the digest."""

_NO_DIGEST = b"0" * 64

MAX_NAMED_VALUES, MAX_VALUES_CHARACTERS = 3, 80
"""Values of one part of a description that are told with what they were and what they are now, and longest
text of both: hashes and longer texts tell a reader nothing."""


@dataclass(frozen=True, kw_only=True)
class ParquetParts:
    """The parts of one result, in the folder `name` of `out`; InputError where they cannot be written."""

    out: Path
    name: str

    @property
    def folder(self) -> Path:
        """The folder of parts."""
        return self.out / self.name

    def path(self, number: int) -> Path:
        """Return the file of a block."""
        return self.folder / f"part-{number:07d}.parquet"

    def open(self, description: dict[str, Any]) -> None:
        """Make the folder, or see that it belongs to the same result; several processes may do so at once.

        The description is everything that decides the rows, in JSON's own types. InputError where
        the folder holds something else.
        """
        path, wanted = self.folder / DESCRIPTION, json.loads(json.dumps(description))
        with refused(f"--out {self.out}: cannot write there"):
            self.folder.mkdir(parents=True, exist_ok=True)
            # In this order: another process writes its description before anything else.
            if any(self.folder.iterdir()) and not os.path.lexists(path):
                raise InputError(
                    f"--out {self.out}: {self.name} exists and was not begun by this command; "
                    "choose another place"
                )
            if not os.path.lexists(path):
                write_file(path, json.dumps(wanted, indent=1).encode(), host=self.out)
        try:
            found = json.loads(_regular(path) or b"")
        except (ValueError, RecursionError):
            found = None
        if found != wanted:
            raise InputError(
                f"--out {self.out}: was begun with {differences_words(found, wanted)}; "
                f"give what it was begun with, or another place, or delete {self.folder} to begin anew"
            )

    def finished(self, number: int) -> bool:
        """Return whether a block's part is there, and is as it was written."""
        return self._content(number) is not None

    def damaged(self, number: int) -> bool:
        """Return whether there is something in the place of a block's part that is none."""
        return os.path.lexists(self.path(number)) and not self.finished(number)

    def tell_damaged(self, numbers: Iterable[int], told: Callable[[str], object]) -> None:
        """Say how many of some blocks are damaged, for they are made again."""
        whole = list(numbers)
        if damaged := sum(map(self.damaged, whole)):
            told(
                f"{damaged} of {len(whole)} blocks in {self.folder} are damaged, and are made again"
            )

    def write(self, number: int, table: pa.Table) -> None:
        """Write the part of a block; afterwards it is finished, and on the disk."""
        buffer = io.BytesIO()
        with pq.ParquetWriter(buffer, table.schema) as writer:
            writer.write_table(table)
            writer.add_key_value_metadata({"xfrustum:sha256": _NO_DIGEST.decode()})
        content = buffer.getvalue()
        digest = hashlib.sha256(content).hexdigest().encode()
        before, _, after = content.rpartition(_NO_DIGEST)
        path = self.path(number)
        with refused(f"--out {self.out}: cannot write there"):
            if os.path.lexists(path) and not path.is_file():
                path.unlink()  # such as a pipe, which a file would be written into
            write_file(path, before + digest + after, host=self.out)

    def read(self, number: int, columns: list[str] | None = None) -> pa.Table:
        """Return the rows of a finished block; InputError where it has been damaged since."""
        content = self._content(number)
        if content is None:
            raise InputError(
                f"{self.path(number)}: is missing or damaged; repeat the command to make it again"
            )
        return pq.read_table(io.BytesIO(content), columns=columns)

    def _content(self, number: int) -> bytes | None:
        """Return the bytes of a block's part; None where it is missing, no file, or damaged."""
        content = _regular(self.path(number))
        found = list(_DIGEST.finditer(content or b""))
        if content is None or not found:
            return None
        begin, end = found[-1].span(1)
        without = hashlib.sha256(content[:begin] + _NO_DIGEST + content[end:])
        return content if without.hexdigest().encode() == found[-1][1] else None

    def write_beside(self, name: str, content: bytes) -> None:
        """Write a file beside the parts, whole or not at all."""
        with refused(f"--out {self.out}: cannot write there"):
            write_file(self.folder / name, content, host=self.out)

    def read_beside(self, name: str) -> bytes | None:
        """Return a file beside the parts; None where there is none."""
        return _regular(self.folder / name)

    def remove(self, name: int | str) -> None:
        """Remove the part of a block, which is unfinished afterwards, or a file beside the parts."""
        with refused(f"--out {self.out}: cannot write there"):
            (self.path(name) if isinstance(name, int) else self.folder / name).unlink(
                missing_ok=True
            )


def scene_description(scene: Scene) -> dict[str, Any]:
    """Return what of a scene decides results, in JSON's types: a folder knows it again by this."""
    parts = {name: getattr(scene, name) for name in ("plate", "frustum", "sampling", "transport")}
    hashes = {"content": scene.content_hash, "look": look_hash(scene)}
    return json_object({**hashes, **parts, "version": metadata.version("xfrustum")})


def _regular(path: Path) -> bytes | None:
    """Return the content of a regular file; None where there is none."""
    try:
        return read_input(path, "file")
    except InputError:
        return None


def differences_words(found: object, wanted: object) -> str:
    """Return what differs between two JSON objects, such as "other settings (near was 0.1, now 0.2)"."""
    if not (isinstance(found, dict) and isinstance(wanted, dict)):
        return "another description"
    parts = []
    for key in dict.fromkeys((*wanted, *found)):
        was, now = (dict(_leaves(one.get(key), (key,))) for one in (found, wanted))
        changed = [
            f"{path[-1]} was {was[path]}, now {now[path]}"
            for path in was
            if was[path] != now.get(path, was[path])
            and len(was[path] + now[path]) <= MAX_VALUES_CHARACTERS
        ]
        if was != now:
            # "Content" has no plural.
            article = "other" if key.split()[0].endswith("s") or key == "content" else "another"
            told = "; ".join(changed[:MAX_NAMED_VALUES])
            parts.append(f"{article} {key}" + (f" ({told})" if told else ""))
    *first, last = parts or ["another description"]
    return f"{', '.join(first)} and {last}" if first else last


def _leaves(value: object, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield the name of each value within a value, and its text; lists of plain values are one."""
    if isinstance(value, dict):
        for key, one in value.items():
            yield from _leaves(one, (*path, key))
    elif isinstance(value, list) and any(isinstance(one, dict | list) for one in value):
        for number, one in enumerate(value):
            yield from _leaves(one, (*path[:-1], f"{number}", path[-1]))
    else:
        yield path, json.dumps(value, ensure_ascii=False, default=str)
