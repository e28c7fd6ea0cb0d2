"""Second reader of mesh files, written from the formats' specifications, for tests only.

It is slow and plain: one loop per rule. It shares no code with `xfrustum.scenes`, so that an error
of one reader does not recur in the other. `python -m tests.second_reader FILE..` compares both
readers.
"""

from collections.abc import Callable
from pathlib import Path

from tests.second_reader import gltf, packages, ply, texts
from tests.second_reader.model import Reading, Refused

READERS: dict[str, Callable[[Path], Reading]] = {
    ".obj": texts.read_obj,
    ".off": texts.read_off,
    ".stl": texts.read_stl,
    ".ply": ply.read_ply,
    ".glb": gltf.read_gltf,
    ".gltf": gltf.read_gltf,
    ".3mf": packages.read_3mf,
    ".3dxml": packages.read_3dxml,
}


def read(path: Path) -> Reading:
    """Read a mesh file; raise Refused if the file is invalid or unsupported."""
    if path.suffix.lower() not in READERS:
        raise Refused(f"format {path.suffix}")
    return READERS[path.suffix.lower()](path).checked()
