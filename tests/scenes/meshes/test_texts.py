"""OBJ, OFF, PLY and STL as exporters write them: right triangles, or a one-line error."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.scenes.meshes.soups import (
    CORNERS,
    FACES,
    INPUTS,
    SOUP,
    UTM,
    assert_reads,
    needs_data,
    written,
)
from xfrustum.scenes import InputError
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.meshes.mesh_file import load_mesh

Content = str | bytes

OBJ_POINTS = "v 0 0 0\nv 4 0 0\nv 1 3 0\nv 1 1 5\n"
OBJ = OBJ_POINTS + "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
OBJ_ALIKE: dict[str, Content] = {
    "UTF-16": OBJ.encode("utf-16"),
    "mixed line ends": OBJ.replace("\n", "\r\n", 2).replace("\nf", "\rf"),
    "capitals": OBJ.upper(),
    "comment that ends in a backslash": "# C:\\meshes\\\n" + OBJ.replace("f 1 3 2", "f 1 3 2 # \\"),
    "faces first": OBJ[len(OBJ_POINTS) :] + OBJ_POINTS,
    "weights of one": OBJ.replace("0\nv", "0 1.0\nv"),
    "names like statements": "g f 1 2 3\no v 1 2 3\nusemtl f\ns off\nmtllib v 1 2 3.mtl\n" + OBJ,
    "odd separators in names": "# a\x0bf 1 2 3\ng a\x0cf 1\ng b\x1cf\ng a\u2028f\n# \u0085f\n"
    + OBJ,
    "Latin-1": b"# caf\xe9\x85f 1 2 3\ng \xfc\n" + OBJ.encode(),
    "points and lines": OBJ_POINTS + "p 1 2\nl 1 2 3\n" + OBJ[len(OBJ_POINTS) :],
    "materials in turns": OBJ.replace("f 2", "usemtl b\nf 2").replace("f 1", "usemtl a\nf 1"),
}  # fmt: skip

OFF_POINTS = OBJ_POINTS.replace("v ", "")
OFF_FACES = "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"
OFF = f"OFF\n4 4 6\n{OFF_POINTS}{OFF_FACES}"


def off(kind: str, more: str, points: str = OFF_POINTS) -> str:
    """Return an OFF file with header `kind`, and with the numbers `more` added to each vertex."""
    return f"{kind}\n4 4 6\n{points.replace(chr(10), f' {more}{chr(10)}')}{OFF_FACES}"


OFF_ALIKE: dict[str, Content] = {
    "one number a line": OFF.replace(" ", "\n"),
    "comments": "# made\n" + OFF.replace("OFF\n", "OFF # by\n").replace("0\n", "0 # 1 2\n\n"),
    "no header": OFF.removeprefix("OFF\n"),
    "counts beside the header": OFF.replace("OFF\n", "OFF "),
    "colors of faces": OFF.replace("2 1\n", "2 1 7\n").replace("2 3\n", "2 3 0.1 0.2 0.3 1\n"),
    "STCNOFF": off("STCNOFF", "0 0 1 0.5 0.5 0.5 1 0 1"),
    "C4OFF": off("C4OFF", "1 0 0 1", "0 0 0 1\n8 0 0 2\n-4 -12 0 -4\n.5 .5 2.5 .5\n"),
}

CODES = {
    "char": "b", "uchar": "B", "short": "h", "int": "i", "uint": "I", "float": "f", "double": "d"
}  # fmt: skip
ORDERS = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}
PLY_HEADER = """\
ply
format {order} 1.0
element vertex {vertices}
property uchar flag
property {point} x
property {point} y
property {point} z
property list uchar short links
element edge 1
property int vertex1
element face {faces}
property list {count} {index} vertex_indices
property uchar red
end_header
"""


def ply(
    order: str = "",
    types: str = "float uchar int",
    corners: Floats = CORNERS,
    faces: tuple[tuple[int, ...], ...] = FACES,
) -> bytes:
    """Return a PLY file with some types of coordinates, counts and indices, and an edge element."""
    names = dict(zip(("point", "count", "index"), types.split(), strict=True))
    point, count, index = (CODES[name] for name in names.values())
    rows: list[tuple[str, tuple[float, ...]]] = [
        (f"B3{point}Bhh", (7, *row, 2, 1, -2)) for row in corners.astype(point).tolist()
    ]
    rows.append(("i", (0,)))
    for face in faces:
        indices = np.array(face, index).tolist()
        rows.append((f"{count}{len(face)}{index}B", (len(face), *indices, 9)))
    header = PLY_HEADER.format(
        order=ORDERS[order], vertices=len(corners), faces=len(faces), **names
    )
    if order:
        return header.encode() + b"".join(struct.pack(order + form, *row) for form, row in rows)
    return (header + "".join(" ".join(map(repr, row)) + "\n" for _, row in rows)).encode()


PLY, BINARY = ply(), ply("<")
FACES_FIRST = (
    "ply\nformat ascii 1.0\nobj_info 1 2\nelement face 4\nproperty list uchar int vertex_index\n"
    "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
)
HEADER_LINES = BINARY.partition(b"end_header")[0].count(b"\n") + 1
PLY_TYPES = ("float uchar int", "double int uint", "short uint char", "int char short")
PLY_ALIKE: dict[str, Content] = {
    **{f"{ORDERS[order]} of {t}": ply(order, t) for order in ORDERS for t in PLY_TYPES},
    "indices of floats": ply("", "float uchar float"),
    "CR LF": PLY.replace(b"\n", b"\r\n"),
    "UTF-8 mark": b"\xef\xbb\xbf" + PLY,
    "vertex_index": PLY.replace(b"vertex_indices", b"vertex_index"),
    "CR before bytes": BINARY.replace(b"\n", b"\r", HEADER_LINES),
    "faces first": FACES_FIRST + OFF_FACES + OFF_POINTS,
}


def stl(corners: Floats = SOUP, header: bytes = b"") -> bytes:
    """Return a binary STL file."""
    facets = [struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0) for triangle in corners]
    return header.ljust(80, b" ") + struct.pack("<I", len(facets)) + b"".join(facets)


def stl_text(corners: Floats = SOUP, name: str = "") -> str:
    """Return a text STL file of one solid."""
    facets = ""
    for triangle in corners.tolist():
        vertices = "\n".join("    vertex {!r} {!r} {!r}".format(*corner) for corner in triangle)
        facets += f"facet normal 0 0 1\n  outer loop\n{vertices}\n  endloop\nendfacet\n"
    return f"solid {name}\n{facets}endsolid {name}\n"


STL = stl_text()
STL_ALIKE: dict[str, Content] = {
    "binary": stl(),
    "binary that begins with solid": stl(header=b"solid x\nfacet normal 0 0 1"),
    "text": STL,
    "capitals": STL.upper(),
    "name like statements": stl_text(name="facet normal vertex 1 2 3"),
    "two solids": stl_text(SOUP[:2], "a") + stl_text(SOUP[2:], "b").rstrip("\n"),
}
ALIKE = {"obj": OBJ_ALIKE, "off": OFF_ALIKE, "ply": PLY_ALIKE, "stl": STL_ALIKE}


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind, files in ALIKE.items() for name in files]
)
def test_both_readers_read_the_same_tetrahedron(kind: str, name: str, tmp_path: Path) -> None:
    path = written(tmp_path, f"a.{kind}", ALIKE[kind][name])
    assert_reads(path, SOUP, 2.0**-50 if name == "C4OFF" else 0.0)


UTM_LINES = "".join("{!r} {!r} {!r}\n".format(*corner) for corner in UTM.tolist())
UTM_FILES: dict[str, Content] = {
    "a.obj": "".join(f"v {line}\n" for line in UTM_LINES.splitlines()) + OBJ[len(OBJ_POINTS) :],
    "a.off": f"OFF\n4 4 6\n{UTM_LINES}{OFF_FACES}",
    "text.ply": ply("", "double uchar int", UTM),
    "big.ply": ply(">", "double uchar int", UTM),
    "a.stl": stl_text(UTM[np.array(FACES)]),
}


@pytest.mark.parametrize("name", UTM_FILES)
def test_coordinates_of_a_survey_keep_every_bit(name: str, tmp_path: Path) -> None:
    assert_reads(written(tmp_path, name, UTM_FILES[name]), UTM[np.array(FACES)])


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
#: Replacement of a file's line 5, or of all lines from 5, and the error
OBJ_REFUSED = r"""
f 0 1 2: line 5: a corner has an index of 0
f 1 2 5: line 5: faces point past the vertices, of which the file has 4: index 5; export
f 1 2: line 5: a face has 2 corners, and needs three
f 1/1 2/1 3/1: line 5: faces point past the texture coordinates, of which the file has 0
vt 0 0|f 1/1 2/1 3: line 6: some corners of a face have texture coordinates, some have none
f 1/1/1/1 2 3: line 5: a corner has more than three indices
f 1 2 3.5: line 5: a corner is no number
f /1 /2 /3: line 5: a corner has no vertex
f \|1 2 \|3|f 1 2 9: line 8: faces point past the vertices
v 1 2: line 5: a vertex needs three coordinates
v 1 2 3 2: line 5: the fourth coordinate is a weight of rational surfaces, and is 2
v 1 2 3.1+e2: line 5: 'v 1 2 3.1+e2' has a word that is no number
vn 0 1: line 5: a normal (vn) has three numbers
surf 0 1 0 1 1 2 3 4: line 5: 'surf' is a free-form surface
call other.obj: line 5: 'call' is another file or a command
made by hand: line 5: 'made' is no statement of OBJ
f 1 3 2 4: line 5: the face crosses or covers itself
"""

OFF_REFUSED: dict[str, Content] = {
    "line 10: face 3 of 4 is cut off or damaged": OFF[:-4],
    "ends within vertex 1 of 4": OFF[:20],
    "line 10: face 4 of 5 is cut off": OFF.replace("4 4 6", "4 5 6"),
    "line 10: the file goes on after 3 faces": OFF.replace("4 4 6", "4 3 6"),
    "line 3: a vertex has 5 numbers": off("OFF", "9 9"),
    "binary OFF is not read": "OFF BINARY\n\0",
    "nOFF, of any number of dimensions, is not read": "4nOFF\n3\n" + OFF[4:],
    "faces point past the vertices": OFF.replace("3 2 0 3", "3 2 0 4"),
    "corners of faces are not whole numbers": OFF.replace("3 2 0 3", "3 2 0 2.5"),
    "line 5: '1 one 0' has a word that is no number": OFF.replace("1 3 0", "1 one 0"),
    "no triangles: 1 vertices, and no faces of three corners": "OFF\n1 0 0\n0 0 0\n",
    "has no counts": "OFF\n",
}

XYZ = "".join(f"property float {axis}\n" for axis in "xyz")
CLOUD = f"ply\nformat ascii 1.0\nelement vertex 1\n{XYZ}end_header\n0 0 0\n"
SPLAT = "".join(f"property float {name}\n" for name in ("f_dc_0", "opacity", "scale_0", "rot_0"))
PLY_REFUSED: dict[str, Content] = {
    "the header declares 9 lines of elements, and the file has 8": PLY[:-10],
    "declares 9 lines of elements, and the file has 10": PLY + b"3 0 1 2\n",
    "ends within face 1 of 2": ply("<", faces=((0, 1, 3), (0, 2, 3, 1)))[:-3],
    "the header declares 132 bytes of elements, file has 134": BINARY + b"\0\0",
    "has another number of values": PLY.replace(b"3 2 0 3 9", b"3 2 0 3 9 9"),
    "face 0 has 2 corners, and needs three": ply(faces=((0, 1),)),
    "(index 4, 4 vertices)": ply(faces=((0, 1, 2, 4),)),
    "no whole": ply("", "float uchar float").replace(b"3 2.0 0", b"3 2.5 0"),
    "does not fit its type": PLY.replace(b"uchar int", b"uchar char").replace(b" 3 9", b" 300 9"),
    "'property list uchar long": PLY.replace(b"uchar int", b"uchar long"),
    "property y is declared twice": PLY.replace(b"float z", b"float y"),
    "x of vertices is a list, and must be one number": CLOUD.replace(
        "float x", "list uchar float x"
    ),
    "begins with 'ply' and has an 'end_header'": "ply\nformat ascii 1.0\n",
    "line 3: 'element vertex 999": CLOUD.replace("vertex 1", "vertex " + 5000 * "9"),
    "line 2: 'format ascii 2.0'": PLY.replace(b"ascii 1.0", b"ascii 2.0"),
    "no triangles: a point cloud: 1 point, no faces": CLOUD,
    "Gaussian splats: 1 point, no faces": CLOUD.replace(XYZ, XYZ + SPLAT).replace(
        "0 0 0", "0 0 0 0 0 0 0"
    ),
}

STL_REFUSED: dict[str, Content] = {
    "header says 4 triangles = 284 bytes, file has 264": stl()[:-20],
    "header says 4 triangles = 284 bytes, file has 286": stl() + b"\r\n",
    "the file has 50 bytes, fewer than the header of a binary STL": stl()[:50],
    "no triangles": stl(SOUP[:0]),
    "the file is cut off after 4 facets": STL.replace("endsolid", ""),
    "the file is cut off after 3 facets": STL[: STL.rindex("endloop")],
    "line 7: 'vertex 0 0 0' where 'endloop'": STL.replace("  endloop", "vertex 0 0 0\nendloop", 1),
    "has a word that is no number": STL.replace("vertex ", "vertex x", 1),
    "line 4: a vertex needs three coordinates": STL.replace("0.0 0.0 0.0", "1 2", 1),
}
REFUSED: list[tuple[str, Content, str]] = [
    ("a.obj", b"PK\3\4 ..", "a.obj: is an archive, and no OBJ"),
    ("a.obj", b"\n<?xml?>", "a.obj: is XML or HTML, and no OBJ"),
]
for row in OBJ_REFUSED.split("\n")[1:-1]:
    lines, _, reason = row.partition(": ")
    text = SQUARE + lines.replace("|", "\n") + "\nf 1 2 3\n"
    REFUSED.append(("a.obj", text, f"a.obj, {reason}"))
for kind, cases in {"off": OFF_REFUSED, "ply": PLY_REFUSED, "stl": STL_REFUSED}.items():
    REFUSED += [(f"a.{kind}", content, reason) for reason, content in cases.items()]


@pytest.mark.parametrize(("name", "content", "reason"), REFUSED, ids=lambda case: str(case)[:30])
def test_a_damaged_file_is_refused_with_the_place(
    name: str, content: Content, reason: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=re.escape(reason)):
        load_mesh(written(tmp_path, name, content))


@needs_data
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("number_formats.obj", r"number_formats\.obj, line 11: 'v 1e\+2 2\.e\+1 3\.1\+e2'"),
        ("hostile/ply-tristrips.ply", r"triangle strips \(element tristrips\) are not read"),
        ("hostile/3mf-required-extension.3mf", "requires the extension http://x/y"),
    ],
)
def test_shared_files_are_refused_by_name(name: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        load_mesh(INPUTS / name)


def turned_facets() -> bytes:
    """Return facets: the first normal opposes the winding, and the second facet has a color."""
    data = bytearray(stl())
    struct.pack_into("<3f", data, 84, 0, 0, 1)
    struct.pack_into("<H", data, 84 + 50 + 48, 5)
    return bytes(data)


UNREAD: list[tuple[str, Content, list[str]]] = [
    ("a.obj", SQUARE + "l 1 2\nf 1 2 3\n", ["lines (l)"]),
    ("a.obj", SQUARE + "p 1\nf 1 2 3\n", ["points (p)"]),
    ("a.obj", SQUARE + "vp 0 1\ncurv 0 1 1 2\nf 1 2 3\n", ["free-form curves"]),
    ("a.obj", SQUARE + "s 1\nf 1 2 3\n", ["smoothing groups (s)"]),
    ("a.obj", SQUARE + "v 0 0 1 1 0 0\nf 1 2 3\n", ["colors at vertices"]),
    ("a.obj", SQUARE + "mtllib ../a.mtl\nf 1 2 3\n", ["material library ../a.mtl"]),
    ("a.obj", SQUARE + "mtllib empty.mtl\nf 1 2 3\n", ["material library empty.mtl"]),
    ("a.off", off("STOFF", "0 1"), ["texture coordinates"]),
    ("a.off", OFF_ALIKE["colors of faces"], ["colors of faces"]),
    ("a.ply", PLY, ["colors of faces", "element edge"]),
    ("a.stl", turned_facets(), ["attributes of facets", "normals of facets"]),
]


@pytest.mark.parametrize(("name", "content", "features"), UNREAD, ids=lambda case: str(case)[-30:])
def test_features_that_are_not_drawn_are_listed(
    name: str, content: Content, features: list[str], tmp_path: Path
) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    written(tmp_path, "a.mtl", "newmtl a\nmap_Kd w.png\n")  # outside of the mesh's folder
    written(inner, "empty.mtl", "")
    assert [
        feature.feature for feature in load_mesh(written(inner, name, content)).unread
    ] == features


def test_values_at_corners_are_those_of_the_file(tmp_path: Path) -> None:
    """Each corner keeps its texture coordinates, normal of any length, and color."""
    statements = "vt 0.25 0.5\nvt 1\nvn 0 3 4\nvn 0 0 0\nf 1/1/1 2/2/2 3/1/1\n"
    colored = SQUARE.replace("0 0 0", "0 0 0 1 0 0.5")  # only one vertex has a color
    mesh = load_mesh(written(tmp_path, "a.obj", colored + statements))
    first, second = (mesh.vertices.tolist().index(corner) for corner in ([0, 0, 0], [1, 0, 0]))
    assert mesh.vertex_normals is not None and mesh.vertex_colors is not None
    assert mesh.uv is not None and mesh.uv[[first, second]].tolist() == [[0.25, 0.5], [1.0, 0.0]]
    assert mesh.vertex_normals[first].tolist() == [0, 0.6, 0.8]
    assert np.isnan(mesh.vertex_normals[second]).all()
    half = ((0.5 + 0.055) / 1.055) ** 2.4  # sRGB to linear
    np.testing.assert_allclose(mesh.vertex_colors[[first, second]], [[1, 0, half], [1, 1, 1]])
    mesh = load_mesh(written(tmp_path, "a.off", off("CNOFF", "0 3 4 255 0 0 255")))
    assert mesh.vertex_normals is not None and mesh.vertex_colors is not None
    assert mesh.vertex_normals.tolist() == [[0, 0.6, 0.8]] * 4
    assert mesh.vertex_colors.tolist() == [[1, 0, 0]] * 4
    normal = b"".join(b"property float n%c\n" % axis for axis in b"xyz")
    header = PLY.replace(b"property float x", normal + b"property float x")
    mesh = load_mesh(written(tmp_path, "a.ply", header.replace(b"\n7 ", b"\n7 0 3 4 ")))
    assert mesh.vertex_normals is not None
    assert mesh.vertex_normals.tolist() == [[0, 0.6, 0.8]] * 4


def test_textures_and_libraries_of_obj(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2), (255, 0, 0)).save(tmp_path / "a b.png")
    options = "map_Kd -s 2 2 1 -clamp on a b.png\n"
    written(tmp_path, "one.mtl", f"newmtl wood\nKd 1 1 1\nmap_Ks a.png\n{options}newmtl a\nd 1.0\n")
    written(tmp_path, "two.mtl", "newmtl b\nd 0.5\nmap_Kd lost.png\n")
    statements = """\
#mtllib x.mtl
mtllib one.mtl two.mtl # here
vt 0 0
vt 1 0
vt 1 1
usemtl wood # oak
f 1/1 2/2 3/3
usemtl a
f 1 3 4
usemtl b
f 1/1 2/2 4/3
usemtl c
f 2 3 4
"""
    mesh = load_mesh(written(tmp_path, "a.obj", SQUARE + statements))
    assert mesh.texture_of_triangle is not None  # the last material comes first
    assert mesh.texture_of_triangle.tolist() == [-1, -1, -1, 0]
    assert [feature.feature for feature in mesh.unread] == [
        "material c",
        "statements d, map_Kd -clamp, map_Kd -s, map_Ks of materials",
        "texture lost.png",
    ]


def test_faces_of_ply_have_texture_coordinates_of_their_own(tmp_path: Path) -> None:
    """Two squares share an edge, with different texture coordinates; v points up."""
    file = """\
ply
format ascii 1.0
element vertex 6
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
property list uchar float texcoord
end_header
0 0 0
1 0 0
1 1 0
0 1 0
2 0 0
2 1 0
4 0 1 2 3 8 0 0 1 0 1 1 0 1
4 1 4 5 2 8 0.5 0 0 0 0 0.5 0.5 0.5
"""
    mesh = load_mesh(written(tmp_path, "a.ply", file))
    assert mesh.uv is not None
    x, y = np.moveaxis(mesh.vertices[mesh.faces], 2, 0)[:2]
    # Texture coordinates of the first square equal its x and y. The first halves of both squares
    # precede the second halves.
    first = np.array([[True], [False]] * 2)
    expected = np.stack([np.where(first, x, (2 - x) / 2), np.where(first, y, y / 2)], axis=-1)
    np.testing.assert_array_equal(mesh.uv[mesh.faces], expected)
