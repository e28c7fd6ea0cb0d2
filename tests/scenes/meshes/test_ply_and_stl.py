"""PLY and STL: what the header declares, no more and no less."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.scenes.meshes.soups import INPUTS, soup, written
from xfrustum.scenes import InputError
from xfrustum.scenes.meshes.mesh_file import load_mesh

needs_data = pytest.mark.skipif(
    not INPUTS.is_dir(), reason="no folder of test data beside the checkout"
)

POINTS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 2, 0))
POLYGONS = ((0, 1, 2, 3), (2, 4, 3))
HEAD = (
    "ply\nformat {} 1.0\nelement vertex 5\nproperty {point} x\nproperty {point} y\nproperty {point} z\n"
    "element face 2\nproperty list {length} {index} vertex_indices\nend_header\n"
)
CODES = {
    "char": "b",
    "uchar": "B",
    "short": "h",
    "int": "i",
    "uint": "I",
    "float": "f",
    "double": "d",
}


def head(form: str, *, point: str = "float", length: str = "uchar", index: str = "int") -> str:
    return HEAD.format(form, point=point, length=length, index=index)


def text(header: str = "") -> str:
    """Return the square and the triangle beside it as text."""
    lines = [" ".join(map(str, point)) for point in POINTS]
    lines += [" ".join(map(str, (len(one), *one))) for one in POLYGONS]
    return (header or head("ascii")) + "\n".join(lines) + "\n"


def binary(order: str, *, point: str = "float", length: str = "uchar", index: str = "int") -> bytes:
    """Return the same in binary, big (`>`) or little endian."""
    name = {">": "binary_big_endian", "<": "binary_little_endian"}[order]
    data = head(name, point=point, length=length, index=index).encode()
    data += b"".join(struct.pack(f"{order}3{CODES[point]}", *one) for one in POINTS)
    for one in POLYGONS:
        data += struct.pack(f"{order}{CODES[length]}", len(one)) + struct.pack(
            f"{order}{len(one)}{CODES[index]}", *one
        )
    return data


ALIKE = {
    "doubles": text(head("ascii", point="double")),
    "indices of floats": text(head("ascii", index="float")),
    "CR LF": text().replace("\n", "\r\n"),
    "CR": text().replace("\n", "\r"),
    "UTF-8 mark": b"\xef\xbb\xbf" + text().encode(),
    "vertex_index": text().replace("vertex_indices", "vertex_index"),
    "little endian": binary("<"),
    "big endian": binary(">"),
    "big endian of doubles": binary(">", point="double", length="int", index="uint"),
    "short indices": binary("<", index="short"),
    "binary indices of floats": binary("<", index="float"),
    "CR before bytes": binary("<").replace(b"\n", b"\r", HEAD.count("\n")),
}


@pytest.mark.parametrize("content", ALIKE.values(), ids=ALIKE)
def test_the_same_polygons_however_they_are_written(content: str | bytes, tmp_path: Path) -> None:
    plain = soup(written(tmp_path, "plain.ply", text()))
    assert len(plain) == 3
    np.testing.assert_array_equal(soup(written(tmp_path, "other.ply", content)), plain)


@needs_data
def test_concave_polygons_are_those_of_the_twin() -> None:
    np.testing.assert_array_equal(
        soup(INPUTS / "letter_ngon.ply"), soup(INPUTS / "letter_ngon.obj")
    )


CLOUD = "ply\nformat ascii 1.0\nelement vertex 1\n{}end_header\n0 0 0{}\n"
XYZ = "property float x\nproperty float y\nproperty float z\n"
SPLAT = "".join(f"property float {name}\n" for name in ("f_dc_0", "opacity", "scale_0", "rot_0"))

PLY_REFUSED = {
    "cut off": (text()[:-8], "the header declares 7 lines of elements, and the file has 6"),
    "too long": (
        text() + "3 0 1 2\n",
        "the header declares 7 lines of elements, and the file has 8",
    ),
    "cut off in binary": (binary("<")[:-3], "ends within face 1 of 2: the file is cut off"),
    "cut off in binary vertices": (
        binary("<")[: len(head("binary_little_endian")) + 30],
        "the file is cut off",
    ),
    "too long in binary": (
        binary("<") + b"\0\0",
        "the header declares 90 bytes of elements, file has 92",
    ),
    "a short line": (text().replace("1 1 0", "1 1"), "line 12: has another number of values"),
    "a long line": (text().replace("1 1 0", "1 1 0 0"), "line 12: has another number of values"),
    "a list too long": (
        text().replace("3 2 4 3", "4 2 4 3"),
        "line 16: has another number of values",
    ),
    "two corners": (text().replace("3 2 4 3", "2 2 4"), "face 1 has 2 corners, and needs three"),
    "past the vertices": (text().replace("3 2 4 3", "3 2 5 3"), "(index 5, 5 vertices)"),
    "a broken index": (
        text(head("ascii", index="float")).replace("3 2 4 3", "3 2 4 3.5"),
        "no whole numbers",
    ),
    "does not fit": (
        text(head("ascii", index="char")).replace("3 2 4 3", "3 2 4 300"),
        "does not fit its type",
    ),
    "unknown type": (
        text().replace("list uchar int", "list uchar long"),
        "line 8: 'property list uchar long",
    ),
    "nothing behind the header": (
        head("ascii"),
        "declares 7 lines of elements, and the file has 0",
    ),
    "a list of x": (
        CLOUD.format(XYZ.replace("float x", "list uchar float x"), ""),
        "x of vertices is a list, and must be one number",
    ),
    "no header": ("ply\nformat ascii 1.0\n", "begins with 'ply' and has an 'end_header'"),
    "version": (text().replace("ascii 1.0", "ascii 2.0"), "line 2: 'format ascii 2.0'"),
    "a point cloud": (CLOUD.format(XYZ, ""), "no triangles: a point cloud: 1 point, no faces"),
    "splats": (
        CLOUD.format(XYZ + SPLAT, " 0 0 0 0"),
        "no triangles: Gaussian splats: 1 point, no faces",
    ),
}


@pytest.mark.parametrize(("content", "told"), PLY_REFUSED.values(), ids=PLY_REFUSED)
def test_a_damaged_ply_is_refused_with_the_place(
    content: str | bytes, told: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=re.escape(told)):
        load_mesh(written(tmp_path, "a.ply", content))


@needs_data
def test_triangle_strips_are_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"triangle strips \(element tristrips\) are not read"):
        load_mesh(INPUTS / "hostile" / "ply-tristrips.ply")


def test_elements_that_are_not_drawn_are_listed(tmp_path: Path) -> None:
    edges = "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header"
    mesh = load_mesh(written(tmp_path, "a.ply", text().replace("end_header", edges) + "0 1\n"))
    assert [one.feature for one in mesh.unread] == ["element edge"]


BALL = trimesh.creation.icosphere(subdivisions=1)  # 80 triangles
STL = bytes(BALL.export(file_type="stl"))
STL_TEXT = BALL.export(file_type="stl_ascii")


def test_stl_in_text_and_in_binary_are_one_mesh(tmp_path: Path) -> None:
    binary_soup = soup(written(tmp_path, "a.stl", STL))
    assert len(binary_soup) == 80
    solid = written(tmp_path, "solid.stl", b"solid of facets".ljust(80) + STL[80:])
    np.testing.assert_array_equal(soup(solid), binary_soup)
    for name, content in (
        ("b.stl", STL_TEXT),
        ("c.stl", STL_TEXT.upper()),
        ("d.stl", STL_TEXT.replace("\n", "\r")),
    ):
        np.testing.assert_allclose(
            soup(written(tmp_path, name, content)), binary_soup, atol=2.0**-24
        )


STL_REFUSED = {
    "cut off": (STL[:-20], "header says 80 triangles = 4,084 bytes, file has 4,064"),
    "too long": (STL + b"\r\n", "header says 80 triangles = 4,084 bytes, file has 4,086"),
    "cut off, named solid": (
        b"solid".ljust(80) + STL[80:-20],
        "header says 80 triangles = 4,084 bytes",
    ),
    "a header alone": (STL[:50], "the file has 50 bytes, fewer than the header of a binary STL"),
    "no triangles": (STL[:80] + bytes(4), "no triangles"),
    "text without its end": (
        STL_TEXT.replace("endsolid", ""),
        "the file is cut off after 80 facets",
    ),
    "text cut off in a facet": (
        STL_TEXT[: STL_TEXT.rindex("endloop")],
        "the file is cut off after 79 facets",
    ),
    "a facet of four": (
        STL_TEXT.replace("endloop", "vertex 0 0 0\nendloop", 1),
        "line 7: 'vertex 0 0 0' where 'endloop'",
    ),
    "a broken vertex": (STL_TEXT.replace("vertex ", "vertex x", 1), "has a word that is no number"),
    "a flat vertex": (
        "solid\nfacet normal 0 0 1\nouter loop\nvertex 1 2\nvertex 1 2 3\nvertex 1 2 3\nendloop\n"
        "endfacet\n"
        "endsolid\n",
        "line 4: a vertex needs three coordinates",
    ),
}


@pytest.mark.parametrize(("content", "told"), STL_REFUSED.values(), ids=STL_REFUSED)
def test_a_damaged_stl_is_refused_with_the_numbers(
    content: str | bytes, told: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=re.escape(told)):
        load_mesh(written(tmp_path, "a.stl", content))


def test_attributes_and_normals_of_facets_that_say_otherwise_are_listed(tmp_path: Path) -> None:
    facets = np.frombuffer(
        STL, np.dtype([("normal", "<f4", 3), ("rest", "<f4", 9), ("color", "<u2")]), offset=84
    ).copy()
    facets["normal"][:3] *= -1
    facets["color"][0] = 5
    mesh = load_mesh(written(tmp_path, "a.stl", STL[:84] + facets.tobytes()))
    assert [one.feature for one in mesh.unread] == ["attributes of facets", "normals of facets"]
    assert "3 oppose the order" in mesh.unread[1].consequence
