"""Zip archives and .npz files from outside: no pickles, and memory bounded by the file's size."""

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.disk.input_files import check_declared, damage_refused, read_input


def read_member(archive: zipfile.ZipFile, name: str, path: Path) -> bytes:
    """Return a member of the archive in a file; InputError where it declares too much memory.

    Raises whatever `zipfile` raises of damage: call it within `damage_refused`.
    """
    check_declared(path, archive.getinfo(name).file_size, f"unpacking {name}")
    return archive.read(name)  # `zipfile` reads no more than the member declares


def read_arrays(
    path: Path, what: str, advice: str, content: bytes | None = None
) -> dict[str, NDArray[Any]]:
    """Return the arrays of a .npz file, or of its `content`, by their names.

    InputError where it is damaged, declares too much memory, or has members other than plain
    arrays.
    """
    content = read_input(path, what, advice) if content is None else content
    arrays: dict[str, NDArray[Any]] = {}
    with damage_refused(path, what, advice), zipfile.ZipFile(io.BytesIO(content)) as archive:
        check_declared(
            path, sum(member.file_size for member in archive.infolist()), "unpacking its arrays"
        )
        for name in archive.namelist():
            # The header is at most 10,000 bytes, and holds literals alone.
            member = io.BytesIO(read_member(archive, name, path))
            arrays[name.removesuffix(".npy")] = np.lib.format.read_array(member, allow_pickle=False)
    return arrays
