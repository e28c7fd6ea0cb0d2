"""Results in blocks: a folder of Parquet files, one for each block, each complete or absent.

A part is written under a temporary name and renamed when it is on the disk, so that an existing
part is a finished block. Its pages have Parquet's own checksums; a part with a wrong checksum
counts as missing. The folder has a description of the work, and other work cannot continue it.
"""

import io
import json
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from xfrustum.reports.common.outputs import json_object, refused
from xfrustum.scenes import InputError
from xfrustum.scenes.disk import read_input, write_file
from xfrustum.scenes.model.scene import Scene, look_hash

#: Name of the description beside the parts; readers of Parquet skip names with a leading `_`.
DESCRIPTION = "_description.json"

#: Largest number of changed values in a message, and largest length of an old and a new value
#: together: hashes and long text help no reader.
MAX_NAMED_VALUES, MAX_VALUES_CHARACTERS = 3, 80


#: Key of the metadata of a part, with its number of rows and its schema: Parquet's checksums cover
#: only the pages, and a flipped bit in the footer could rename a column.
ROWS_AND_SCHEMA = b"xfrustum:rows"


def parquet_bytes(table: pa.Table) -> bytes:
    """Return a table as a Parquet file with checksums; equal tables give equal bytes."""
    buffer = io.BytesIO()
    described = table.replace_schema_metadata({ROWS_AND_SCHEMA: _rows_and_schema(table)})
    # Use Arrow's names of nested fields, so that a table is read with the schema that it had.
    pq.write_table(described, buffer, write_page_checksum=True, use_compliant_nested_type=False)
    return buffer.getvalue()


def read_parquet(path: Path, columns: list[str] | None = None) -> pa.Table | None:
    """Return the table of a file of `parquet_bytes`; None if it is missing or damaged."""
    try:
        content = io.BytesIO(read_input(path, "table"))
        table = pq.read_table(content, page_checksum_verification=True)
        table.validate(full=True)
    except (InputError, OSError, MemoryError, ValueError, pa.ArrowException):
        return None
    described = (table.schema.metadata or {}).get(ROWS_AND_SCHEMA)
    table = table.replace_schema_metadata(None)
    if described != _rows_and_schema(table):
        return None
    return table if columns is None else table.select(columns)


def _rows_and_schema(table: pa.Table) -> bytes:
    fields = table.schema.to_string(show_field_metadata=False, show_schema_metadata=False)
    return f"{table.num_rows} rows of {fields}".encode()


@dataclass(frozen=True, kw_only=True)
class ParquetParts:
    """Parts of one result in the folder `name` of `out`; InputError if `out` is not writable."""

    out: Path
    name: str

    @property
    def folder(self) -> Path:
        """Folder of the parts."""
        return self.out / self.name

    def path(self, number: int) -> Path:
        """Return the file of a block."""
        return self.folder / f"part-{number:07d}.parquet"

    def open(self, description: dict[str, Any]) -> None:
        """Make the folder or check that it belongs to this work; safe with concurrent processes.

        The description has all inputs that determine the rows, in JSON's own types. InputError if
        the folder has other content.
        """
        path, expected = self.folder / DESCRIPTION, json.loads(json.dumps(description))
        with self._writing():
            self.folder.mkdir(parents=True, exist_ok=True)
            # Keep this order: another process writes its description before anything else.
            if any(self.folder.iterdir()) and not os.path.lexists(path):
                raise InputError(
                    f"--out {self.out}: {self.name} exists and was not begun by this command; "
                    "choose another place"
                )
            if not os.path.lexists(path):
                write_file(path, json.dumps(expected, indent=1).encode(), host=self.out)
        try:
            stored = json.loads(self.read_beside(DESCRIPTION) or b"")
        except (ValueError, RecursionError):
            stored = None
        if stored != expected:
            raise InputError(
                f"--out {self.out}: was begun with {differences_words(stored, expected)}; give "
                f"what it was begun with, or another place, or delete {self.folder} to begin anew"
            )

    def finished(self, number: int) -> bool:
        """Return whether a block has an undamaged part."""
        return read_parquet(self.path(number)) is not None

    def damaged(self, number: int) -> bool:
        """Return whether something else exists at the path of a block's part."""
        return os.path.lexists(self.path(number)) and not self.finished(number)

    def tell_damaged(self, numbers: Iterable[int], note: Callable[[str], object]) -> None:
        """Report the number of damaged parts among some blocks."""
        whole = list(numbers)
        if damaged := sum(map(self.damaged, whole)):
            note(
                f"{damaged} of {len(whole)} blocks in {self.folder} are damaged, and are made again"
            )

    def write(self, number: int, table: pa.Table) -> None:
        """Write the part of a block to the disk."""
        path = self.path(number)
        with self._writing():
            if os.path.lexists(path) and not path.is_file():
                # `write_file` would write into a pipe or a device: remove it.
                path.unlink()
            write_file(path, parquet_bytes(table), host=self.out)

    def read(self, number: int, columns: list[str] | None = None) -> pa.Table:
        """Return the rows of a finished block; InputError if it is missing or damaged."""
        table = read_parquet(self.path(number), columns)
        if table is None:
            raise InputError(
                f"{self.path(number)}: is missing or damaged; repeat the command to make it again"
            )
        return table

    def write_beside(self, name: str, content: bytes) -> None:
        """Write a file beside the parts, whole or not at all."""
        with self._writing():
            write_file(self.folder / name, content, host=self.out)

    def read_beside(self, name: str) -> bytes | None:
        """Return a regular file beside the parts; None if there is none."""
        try:
            return read_input(self.folder / name, "file")
        except InputError:
            return None

    def remove(self, name: int | str) -> None:
        """Remove the part of a block, or a file beside the parts."""
        path = self.path(name) if isinstance(name, int) else self.folder / name
        with self._writing():
            path.unlink(missing_ok=True)

    def _writing(self) -> Any:
        return refused(f"--out {self.out}: cannot write there")


def scene_description(scene: Scene) -> dict[str, Any]:
    """Return the properties of a scene that determine results, in JSON's types."""
    parts = {name: getattr(scene, name) for name in ("plate", "frustum", "sampling", "transport")}
    hashes = {"content": scene.content_hash, "look": look_hash(scene)}
    return json_object({**hashes, **parts, "version": metadata.version("xfrustum")})


def differences_words(stored: object, expected: object) -> str:
    """Return the differences of two JSON objects: "other settings (near was 0.1, now 0.2)"."""
    if not (isinstance(stored, dict) and isinstance(expected, dict)):
        return "another description"
    parts = []
    for key in dict.fromkeys((*expected, *stored)):
        was, now = (dict(_leaves(side.get(key), (key,))) for side in (stored, expected))
        changed = [
            f"{path[-1]} was {was[path]}, now {now[path]}"
            for path in was
            if was[path] != now.get(path, was[path])
            and len(was[path] + now[path]) <= MAX_VALUES_CHARACTERS
        ]
        if was != now:
            # "Content" has no plural.
            article = "other" if key.split()[0].endswith("s") or key == "content" else "another"
            values = "; ".join(changed[:MAX_NAMED_VALUES])
            parts.append(f"{article} {key}" + (f" ({values})" if values else ""))
    *first, last = parts or ["another description"]
    return f"{', '.join(first)} and {last}" if first else last


def _leaves(value: object, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield path and text of each value within a value; a list of plain values is one value."""
    if isinstance(value, dict):
        for key, member in value.items():
            yield from _leaves(member, (*path, key))
    elif isinstance(value, list) and any(isinstance(member, dict | list) for member in value):
        for number, member in enumerate(value):
            yield from _leaves(member, (*path[:-1], f"{number}", path[-1]))
    else:
        yield path, json.dumps(value, ensure_ascii=False, default=str)
