"""OFF: every header, any line breaks, and counts that must be right."""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.scenes.meshes.soups import INPUTS, soup, written
from xfrustum.scenes import InputError
from xfrustum.scenes.meshes.mesh_file import load_mesh

needs_data = pytest.mark.skipif(
    not INPUTS.is_dir(), reason="no folder of test data beside the checkout"
)

PLAIN = "OFF\n4 2 5\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"

ALIKE = {
    "one number a line": PLAIN.replace(" ", "\n"),
    "one line": PLAIN.replace("\n", " "),
    "comments": "# a square\n" + PLAIN.replace("0\n", "0 # here\n\n"),
    "CR": PLAIN.replace("\n", "\r"),
    "no header": PLAIN.removeprefix("OFF\n"),
    "counts beside the header": PLAIN.replace("OFF\n", "OFF "),
    "no number of edges": PLAIN.replace("4 2 5", "4 2"),
    "a quadrilateral": PLAIN.replace("4 2 5", "4 1 4").replace("3 0 1 2\n3 0 2 3", "4 0 1 2 3"),
    "colors of faces": PLAIN.replace("3 0 1 2", "3 0 1 2 255 0 0").replace(
        "3 0 2 3", "3 0 2 3 0.5 0.5 0.5 1"
    ),
    "4OFF": PLAIN.replace("OFF", "4OFF")
    .replace("0\n", "0 2\n")
    .replace("1 0 0 2", "2 0 0 2")
    .replace("1 1 0 2", "2 2 0 2")
    .replace("0 1 0 2", "0 2 0 2"),
    "CNOFF": PLAIN.replace("OFF", "CNOFF").replace("0\n", "0 0 0 3 1 0 0 1\n"),
    "COFF of three": PLAIN.replace("OFF", "COFF").replace("0\n", "0 255 0 0\n"),
    "STOFF": PLAIN.replace("OFF", "STOFF").replace("0\n", "0 0.5 0.5\n"),
}


@pytest.mark.parametrize("content", ALIKE.values(), ids=ALIKE)
def test_the_same_square_however_it_is_written(content: str, tmp_path: Path) -> None:
    plain = soup(written(tmp_path, "plain.off", PLAIN))
    np.testing.assert_array_equal(soup(written(tmp_path, "other.off", content)), plain)


@needs_data
def test_shared_files_are_their_twins() -> None:
    np.testing.assert_array_equal(soup(INPUTS / "4off.off"), soup(INPUTS / "bom.obj"))
    np.testing.assert_array_equal(soup(INPUTS / "noff.off"), soup(INPUTS / "bom.obj"))
    np.testing.assert_array_equal(
        soup(INPUTS / "letter_ngon.off"), soup(INPUTS / "letter_ngon.obj")
    )


def test_normals_and_colors_are_read(tmp_path: Path) -> None:
    mesh = load_mesh(written(tmp_path, "a.off", ALIKE["CNOFF"]))
    assert mesh.vertex_normals is not None and mesh.vertex_normals.tolist() == [[0, 0, 1]] * 4
    assert mesh.vertex_colors is not None and mesh.vertex_colors.tolist() == [[1, 0, 0]] * 4


REFUSED = {
    "cut off within a face": (PLAIN[:-4], "line 8: face 1 of 2 is cut off or damaged"),
    "cut off within vertices": (PLAIN[:20], "ends within vertex 1 of 4"),
    "a face too few": (PLAIN.replace("4 2 5", "4 3 5"), "line 8: face 2 of 3 is cut off"),
    "a face too many": (PLAIN.replace("4 2 5", "4 1 5"), "line 8: the file goes on after 1 faces"),
    "more numbers than the header says": (
        PLAIN.replace("0\n", "0 9 9\n"),
        "line 3: a vertex has 5 numbers",
    ),
    "flat points": (
        PLAIN.replace("0\n", "\n"),
        "line 3: a vertex has 2 numbers, and the header says 3",
    ),
    "binary": ("OFF BINARY\n\x00\x00", "binary OFF is not read"),
    "dimensions": ("4nOFF\n3\n" + PLAIN[4:], "nOFF, of any number of dimensions, is not read"),
    "past the vertices": (PLAIN.replace("3 0 2 3", "3 0 2 4"), "faces point past the vertices"),
    "before the vertices": (PLAIN.replace("3 0 2 3", "3 0 2 -1"), "faces point past the vertices"),
    "a broken index": (
        PLAIN.replace("3 0 2 3", "3 0 2 2.5"),
        "corners of faces are not whole numbers",
    ),
    "words": (PLAIN.replace("1 1 0", "1 one 0"), "line 5: '1 one 0' has a word that is no number"),
    "no faces": ("OFF\n1 0 0\n0 0 0\n", "no triangles: 1 vertices, and no faces of three corners"),
    "nothing": ("OFF\n", "has no counts"),
}


@pytest.mark.parametrize(("content", "told"), REFUSED.values(), ids=REFUSED)
def test_a_damaged_file_is_refused_with_the_place(content: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=re.escape(told)):
        load_mesh(written(tmp_path, "a.off", content))
