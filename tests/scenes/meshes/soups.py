"""Mesh files for tests, and a comparison of both readers with closed-form shapes."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from tests.second_reader import read
from tests.second_reader.compare import difference, product_triangles
from tests.second_reader.model import Reading
from tests.second_reader.polygons import cut
from xfrustum.scenes.arrays import Floats

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
INPUTS = DATA / "inputs"
needs_data = pytest.mark.skipif(
    not DATA.is_dir(), reason="no folder of test data beside the checkout"
)

#: Asymmetric corners, exact in float32, and the four triangles of their tetrahedron
CORNERS: Floats = np.array([[0, 0, 0], [4, 0, 0], [1, 3, 0], [1, 1, 5]], dtype=np.float64)
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3))
SOUP: Floats = CORNERS[np.array(FACES)]
#: Corners in survey coordinates, which float32 would round to half a meter
UTM: Floats = CORNERS + np.array([500_000.123456789, 5_412_345.987654321, 431.5])


def written(folder: Path, name: str, content: str | bytes) -> Path:
    """Write a file and return its path."""
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def assert_reads(path: Path, polygons: Iterable[ArrayLike], rounding: float = 0.0) -> None:
    """Assert that both readers return triangulations of some polygons (n, 3), in any order."""
    right = Reading([np.asarray(polygon, np.float64) for polygon in polygons], rounding)
    assert difference(product_triangles(path), right) is None, "product"
    second = read(path)
    triangles = np.array([t for polygon in second.polygons for t in cut(polygon)])
    right.rounding = max(rounding, second.rounding)
    assert difference(triangles, right) is None, "second reader"
