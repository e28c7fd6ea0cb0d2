"""Triangle soups of mesh files, by which twins are compared."""

from pathlib import Path

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.meshes.mesh_file import load_mesh

INPUTS = Path(__file__).resolve().parents[4] / "shared" / "data" / "inputs"


def soup(path: Path) -> Floats:
    """Return (F, 9) corners of a mesh's triangles, each from its least corner on, in ascending order."""
    mesh = load_mesh(path)
    found = []
    for triangle in mesh.vertices[mesh.faces].tolist():
        least = triangle.index(min(triangle))
        found.append(
            [number for corner in triangle[least:] + triangle[:least] for number in corner]
        )
    return np.array(sorted(found))


def area(path: Path) -> float:
    """Return the area of a mesh's triangles."""
    mesh = load_mesh(path)
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def written(folder: Path, name: str, content: str | bytes) -> Path:
    """Write a file and return its path."""
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path
