"""Both readers agree on every mesh file of the repository and of ../shared.

`python -m tests.second_reader FILE..` compares them on any files.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from tests.scenes.meshes.soups import DATA, INPUTS, SOUP, needs_data
from tests.second_reader import READERS, read
from tests.second_reader.compare import compare, difference, product_triangles
from tests.second_reader.model import Reading
from tests.second_reader.polygons import cut
from tests.second_reader.random_gltf import random_gltf
from tests.second_reader.random_obj import random_obj
from tests.support.long_tail import thinned

CHECKOUT = Path(__file__).resolve().parents[3]
LARGE = 1_000_000  #: size above which files are compared only by the slow tests, bytes

#: Plain shapes, and files of the same shapes with a feature
TWINS = {
    "letter_triangles.obj": "letter_ngon.obj letter_ngon.off letter_ngon.ply",
    "three_blocks_absolute.obj": "three_blocks.obj",
    "noff.off": "bom.obj indented.obj tabs.obj mac_line_ends.obj commented_mtllib.obj 4off.off",
    "box_float.glb": "box_normalized_int16.glb box_uv_uint16.glb",
    "skyline_dense.glb": "skyline_sparse.glb skyline_all_sparse.glb",
    "figure_baked.glb": "figure_skinned.glb",
    "hill_baked.glb": "hill_morph.glb",
    "field_nodes.glb": "field_instanced.glb field_instanced_required.glb",
    "mixed_triangles.glb": "mixed_modes.glb",
    "badge_baked.glb": "badge_under_camera.glb",
}


def files() -> list[Path]:
    """Return the mesh files that git tracks, and the test data beside the checkout."""
    git = ["git", "ls-files"]
    listed = subprocess.run(git, cwd=CHECKOUT, capture_output=True, text=True, check=False).stdout
    paths = [*(CHECKOUT / name for name in listed.splitlines()), *sorted(DATA.rglob("*"))]
    return [path for path in paths if path.suffix.lower() in READERS]


def parameter(path: Path) -> object:
    marks = [pytest.mark.slow] if path.stat().st_size > LARGE else []
    return pytest.param(path, id=path.name, marks=marks)


@pytest.mark.parametrize("path", [parameter(path) for path in files()])
def test_both_readers_agree(path: Path) -> None:
    assert compare(path) is None


@needs_data
@pytest.mark.parametrize(
    ("plain", "feature"),
    [(plain, twin) for plain, names in TWINS.items() for twin in names.split()],
)
def test_twins_have_equal_triangles(plain: str, feature: str) -> None:
    """The product reads one file, the second reader reads its twin; above, they agree on each."""
    reading, triangles = read(INPUTS / feature), product_triangles(INPUTS / plain)
    # One file may store a number in float32 that the other states exactly.
    reading.rounding += 2.0**-24 * float(np.abs(triangles).max())
    assert difference(triangles, reading) is None


@pytest.mark.parametrize("block", thinned(range(8), 4))
def test_files_of_random_features(block: int, tmp_path: Path) -> None:
    for seed in range(25 * block, 25 * block + 25):
        obj = tmp_path / f"{seed}.obj"
        obj.write_bytes(random_obj(seed))
        assert compare(obj) is None, obj.name
        document = random_gltf(seed).save(tmp_path / f"{seed}.glb")
        assert compare(document) is None, document.name


@pytest.mark.parametrize(
    "wrong",
    [
        SOUP[:-1],
        SOUP[:, ::-1],
        SOUP[[0, 1, 2, 2]],
        SOUP + np.eye(4)[:, :3, None] * 2.0**-50,
        np.concatenate([SOUP[:3, [1, 2, 0]], SOUP[3:, [1, 0, 2]]]),
    ],
    ids=["one missing", "turned over", "one twice", "moved by one bit", "one turned over"],
)
def test_a_wrong_reading_differs(wrong: np.ndarray) -> None:
    assert difference(SOUP[::-1, [2, 0, 1]], Reading(list(SOUP))) is None
    assert difference(wrong, Reading(list(SOUP))) is not None


def test_a_fan_of_a_concave_polygon_is_no_cut() -> None:
    letter = np.array([[0, 0, 0], [6, 0, 0], [6, 1, 0], [1, 1, 0], [1, 4, 0], [0, 4, 0.0]])
    fan = np.array([letter[[1, k, k + 1]] for k in (2, 3, 4)] + [letter[[1, 5, 0]]])
    assert difference(fan, Reading([letter])) is not None
    assert difference(np.array(cut(letter)), Reading([letter])) is None
