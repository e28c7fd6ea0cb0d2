"""OBJ as people have it: the triangles of the plain twin, or one line that says why not."""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.scenes.meshes.soups import INPUTS, area, soup, written
from xfrustum.scenes import InputError
from xfrustum.scenes.meshes.mesh_file import load_mesh

needs_data = pytest.mark.skipif(
    not INPUTS.is_dir(), reason="no folder of test data beside the checkout"
)

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
PLAIN = SQUARE + "f 1 2 3\nf 1 3 4\n"

ALIKE = {
    "UTF-8 mark": b"\xef\xbb\xbf" + PLAIN.encode(),
    "UTF-16": PLAIN.encode("utf-16"),
    "CR": PLAIN.replace("\n", "\r").encode(),
    "mixed line ends": PLAIN.replace("\n", "\r\n", 2).replace("\nf", "\rf").encode(),
    "tabs": PLAIN.replace(" ", "\t").encode(),
    "indents": PLAIN.replace("v ", "  v  ").replace("f ", "\tf ").encode(),
    "capitals": PLAIN.upper().encode(),
    "no last line end": PLAIN.rstrip().encode(),
    "comments": PLAIN.replace("0\n", "0 # here\n").replace("f 1 2 3", "f 1 2 3# f 9 9 9").encode(),
    "a comment that ends in a backslash": b"# C:\\meshes\\\n" + PLAIN.encode(),
    "a comment within a line that does": PLAIN.replace("f 1 2 3", "f 1 2 3 # \\").encode(),
    "continued lines": PLAIN.replace("f 1 2 3", "f 1 \\\n2 \\\r\n 3")
    .replace("v 1 1", "v 1\\\n 1")
    .encode(),
    "faces first": ("f 1 2 3\nf 1 3 4\n" + SQUARE).encode(),
    "relative": (SQUARE[:24] + "f -3 -2 -1\n" + SQUARE[24:] + "f -4 -2 -1\n").encode(),
    "number formats": PLAIN.replace("1 0 0", "+1. 0e0 -.0")
    .replace("0 1 0", "0 1E+0 0.0E-5")
    .encode(),
    "weights of one": PLAIN.replace("0\nv", "0 1.0\nv").encode(),
    "a quadrilateral": (SQUARE + "f 1 2 3 4\n").encode(),
    "blank lines": PLAIN.replace("\n", "\n \n\n").encode(),
}


@pytest.mark.parametrize("content", ALIKE.values(), ids=ALIKE)
def test_the_same_square_however_it_is_written(content: bytes, tmp_path: Path) -> None:
    plain = soup(written(tmp_path, "plain.obj", PLAIN))
    np.testing.assert_array_equal(soup(written(tmp_path, "other.obj", content)), plain)


@needs_data
@pytest.mark.parametrize(
    ("name", "twin"),
    [
        ("three_blocks.obj", "three_blocks_absolute.obj"),
        ("indented.obj", "tabs.obj"),
        ("bom.obj", "mac_line_ends.obj"),
        ("bom.obj", "indented.obj"),
        ("commented_mtllib.obj", "bom.obj"),
    ],
)
def test_shared_twins_have_equal_triangles(name: str, twin: str) -> None:
    np.testing.assert_array_equal(soup(INPUTS / name), soup(INPUTS / twin))


@needs_data
def test_concave_faces_have_the_area_of_their_twin_of_triangles() -> None:
    assert area(INPUTS / "letter_triangles.obj") == 3520.0
    for name in ("letter_ngon.obj", "letter_ngon.off", "letter_ngon.ply"):
        assert len(load_mesh(INPUTS / name).faces) == 44
        assert area(INPUTS / name) == pytest.approx(3520.0, rel=1e-14)
    assert area(INPUTS / "hostile" / "obj-concave.obj") == 4.0
    assert area(INPUTS / "hostile" / "obj-lost-faces.obj") == 16.0


REFUSED = [
    ("f 0 1 2", "line 5: a corner has an index of 0"),
    ("f 1 2 5", "line 5: faces point past the vertices, of which the file has 4: index 5; export"),
    ("f 1 2 -5", "line 5: faces point past the vertices, of which the file has 4: index -5"),
    ("f 1", "line 5: a face has 1 corner, and needs three"),
    ("f 1 2", "line 5: a face has 2 corners, and needs three"),
    ("f 1/1 2/1 3/1", "line 5: faces point past the texture coordinates, of which the file has 0"),
    (
        "vt 0 0\nf 1/1 2/1 3",
        "line 6: some corners of a face have texture coordinates, some have none",
    ),
    ("f 1/0 2/0 3/0", "line 5: a corner has an index of 0"),
    ("f 1/1/1/1 2 3", "line 5: a corner has more than three indices"),
    ("f 1 2 x", "line 5: a corner is no number"),
    ("f 1 2 3.5", "line 5: a corner is no number"),
    ("f /1 /2 /3", "line 5: a corner has no vertex"),
    ("f \\\n1 2 \\\n3\nf 1 2 9", "line 8: faces point past the vertices"),
    ("v 1 2\nf 1 2 3", "line 5: a vertex needs three coordinates"),
    (
        "v 1 2 3 2\nf 1 2 3",
        "line 5: the fourth coordinate is a weight of rational surfaces, and is 2; export polygons",
    ),
    ("v 1 2 3.1+e2\nf 1 2 3", "line 5: 'v 1 2 3.1+e2' has a word that is no number"),
    ("v 1 2 1d5\nf 1 2 3", "line 5: 'v 1 2 1d5' has a word that is no number"),
    ("v 1,5 2 3\nf 1 2 3", "line 5: 'v 1,5 2 3' has a word that is no number"),
    ("vn 0 1\nf 1 2 3", "line 5: a normal (vn) has three numbers"),
    ("surf 0 1 0 1 1 2 3 4\nf 1 2 3", "line 5: 'surf' is a free-form surface"),
    ("call other.obj\nf 1 2 3", "line 5: 'call' is another file or a command"),
    ("made by hand\nf 1 2 3", "line 5: 'made' is no statement of OBJ"),
    ("\u00a0", "line 5: '\\xa0' is no statement of OBJ"),
    ("\u2028", "line 5: '\\u2028' is no statement of OBJ"),
    ("f 1 3 2 4", "line 5: the face crosses or covers itself"),
]


@pytest.mark.parametrize(
    ("statement", "told"), REFUSED, ids=[statement for statement, _ in REFUSED]
)
def test_a_damaged_statement_is_refused_with_its_line(
    statement: str, told: str, tmp_path: Path
) -> None:
    path = written(tmp_path, "a.obj", SQUARE + statement + "\nf 1 2 3\n")
    with pytest.raises(InputError, match=re.escape(f"a.obj, {told}")):
        load_mesh(path)


@needs_data
def test_a_number_that_is_none_is_refused_in_the_shared_file() -> None:
    with pytest.raises(
        InputError, match=r"number_formats\.obj, line 11: 'v 1e\+2 2\.e\+1 3\.1\+e2'"
    ):
        load_mesh(INPUTS / "number_formats.obj")


UNREAD = [
    ("l 1 2", "lines (l)"),
    ("p 1", "points (p)"),
    ("vp 0 1\ncurv 0 1 1 2", "free-form curves"),
    ("s 1", "smoothing groups (s)"),
    ("v 0 0 1 1 0 0", "colors at vertices"),
]


@pytest.mark.parametrize(("statement", "feature"), UNREAD, ids=[feature for _, feature in UNREAD])
def test_a_statement_that_is_not_drawn_is_listed(
    statement: str, feature: str, tmp_path: Path
) -> None:
    path = written(tmp_path, "a.obj", SQUARE + statement + "\nf 1 2 3\n")
    assert [one.feature for one in load_mesh(path).unread] == [feature]


def test_vertices_without_a_color_beside_vertices_with_one_are_white(tmp_path: Path) -> None:
    colored = written(tmp_path, "a.obj", "v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    colors = load_mesh(colored).vertex_colors
    assert colors is not None and colors.tolist() == [[1, 0, 0], [1, 1, 1], [1, 1, 1]]


def test_a_texture_shows_on_the_faces_that_have_coordinates_alone(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2), (255, 0, 0)).save(tmp_path / "a b.png")
    library = "newmtl wood\nKd 1 1 1\nmap_Ks a.png\nmap_Kd -s 2 2 1 -clamp on a b.png\n"
    written(tmp_path, "m.mtl", library)
    faces = "vt 0 0\nvt 1 0\nvt 1 1\nusemtl wood # oak\nf 1/1 2/2 3/3\nf 1 3 4\n"
    mesh = load_mesh(
        written(tmp_path, "a.obj", "#mtllib x.mtl\nmtllib m.mtl # here\n" + SQUARE + faces)
    )
    assert mesh.texture_of_triangle is not None and mesh.texture_of_triangle.tolist() == [0, -1]
    [options] = mesh.unread
    assert options.feature == "statements map_Kd -clamp, map_Kd -s, map_Ks of materials"


def test_all_libraries_are_read_and_what_they_lack_is_listed(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2)).save(tmp_path / "w.png")
    written(tmp_path, "one.mtl", "newmtl a\nd 1.0\n")
    written(tmp_path, "two.mtl", "newmtl b\nmap_Kd w.png\nd 0.5\n")
    statements = "mtllib one.mtl two.mtl\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\nusemtl b\nf 1/1 2/1 3/1\nusemtl c\n"
    mesh = load_mesh(written(tmp_path, "a.obj", SQUARE + statements + "f 1 3 4\n"))
    assert mesh.texture_of_triangle is not None and mesh.texture_of_triangle.tolist() == [-1, 0, -1]
    assert [one.feature for one in mesh.unread] == ["material c", "statements d of materials"]


@pytest.mark.parametrize(
    ("content", "told"), [(b"PK\3\4 ..", "an archive"), (b"\n<?xml?>", "XML or HTML")]
)
def test_what_is_no_obj_is_named(content: bytes, told: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"a\.obj: is {told}, and no OBJ"):
        load_mesh(written(tmp_path, "a.obj", content))


def test_an_empty_library_is_listed(tmp_path: Path) -> None:
    written(tmp_path, "m.mtl", "")
    mesh = load_mesh(written(tmp_path, "a.obj", "mtllib m.mtl\n" + PLAIN))
    assert [one.feature for one in mesh.unread] == ["material library m.mtl"]


def test_faces_of_a_material_come_together_and_the_last_material_first(tmp_path: Path) -> None:
    faces = "usemtl b\nf 1 2 3\nusemtl a\nf 1 3 4\nusemtl b\nf 2 3 4\nusemtl c\nf 1 2 4\n"
    plain = SQUARE + "f 1 2 4\nf 1 3 4\nf 1 2 3\nf 2 3 4\n"
    np.testing.assert_array_equal(
        soup(written(tmp_path, "a.obj", SQUARE + faces)), soup(written(tmp_path, "b.obj", plain))
    )


def test_a_library_or_texture_outside_the_folder_is_not_opened(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    written(tmp_path, "secret.mtl", "newmtl a\nmap_Kd w.png\n")
    mesh = load_mesh(written(inner, "a.obj", "mtllib ../secret.mtl\n" + PLAIN))
    assert [one.feature for one in mesh.unread] == ["material library ../secret.mtl"]


@needs_data
@pytest.mark.parametrize("name", ["beetle-alt.obj", "stanford-bunny.obj", "teapot.obj"])
def test_triangles_and_vertices_are_those_of_trimesh(name: str) -> None:
    ours = load_mesh(INPUTS.parent / name)
    theirs = trimesh.load_mesh(str(INPUTS.parent / name), process=False)
    np.testing.assert_array_equal(ours.faces, theirs.faces)
    np.testing.assert_array_equal(ours.vertices, theirs.vertices)


def test_coordinates_of_a_survey_keep_every_bit(tmp_path: Path) -> None:
    words = ["5412345.678901", "325678.90123456", "0.1"]
    path = written(tmp_path, "utm.obj", f"v {' '.join(words)}\n{SQUARE}f 1 2 3\n")
    mesh = load_mesh(path)
    assert [float(word) for word in words] in mesh.vertices.tolist()
