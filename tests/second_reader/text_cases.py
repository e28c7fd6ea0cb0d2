"""Small OBJ, OFF, PLY and STL files for the neighbours of each known fault, with their shapes."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from tests.second_reader.making import CORNERS, FACES, SOUP, Case, case, ply, stl, stl_text
from tests.second_reader.model import Floats

POINTS = "v 0 0 0\nv 4 0 0\nv 1 3 0\nv 1 1 5\n"
NAMES = "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
#: Letter C, counterclockwise, of 8 corners, one more on a straight side; no fan of it is right.
LETTER: Floats = np.array(
    [[0, 0], [3, 0], [6, 0], [6, 1], [1, 1], [1, 4], [6, 4], [6, 5], [0, 5]], dtype=np.float64
)
#: Quad whose third corner is turned inward: the fan of its first corner has a triangle turned over.
DART: Floats = np.array([[4, -4], [1, 0], [4, 4], [0, 0]], dtype=np.float64)
STAIR: Floats = np.array(
    [[0, 0], [4, 0], [4, 1], [3, 1], [3, 2], [2, 2], [2, 3], [0, 3]], dtype=np.float64
)


def cases() -> list[Case]:
    """Return all cases."""
    makers: list[Callable[[], Iterator[Case]]] = [
        obj_lines,
        obj_indices,
        obj_polygons,
        obj_hard_polygons,
        obj_refusals,
        off_kinds,
        off_layouts,
        off_refusals,
        ply_kinds,
        ply_refusals,
        stl_kinds,
    ]
    return [one for maker in makers for one in maker()]


def obj_lines() -> Iterator[Case]:
    whole = POINTS + NAMES
    yield case("bom_crlf.obj", b"\xef\xbb\xbf" + whole.replace("\n", "\r\n").encode())
    yield case("cr.obj", whole.replace("\n", "\r"))
    yield case(
        "tabs_indents.obj",
        "\n".join("\t  " + line.replace(" ", "\t ") for line in whole.splitlines()),
    )
    yield case("no_last_line_end.obj", whole.rstrip("\n"))
    yield case(
        "continued.obj",
        whole.replace("f 1 3 2", "f 1 \\\n 3 \\\n2").replace("v 4 0 0", "v 4\\\n0 0"),
    )
    yield case("continued_crlf.obj", whole.replace("f 1 3 2", "f 1 \\\n 3 2").replace("\n", "\r\n"))
    yield case(
        "comments_in_lines.obj",
        whole.replace("v 4 0 0", "v 4 0 0 # 9 9").replace("f 1 3 2", "f 1 3 2#4"),
    )
    yield case("commented_statements.obj", "# v 9 9 9\n#f 1 1 1\n" + whole)
    yield case("capitals.obj", whole.replace("v ", "V ").replace("f ", "F "), may_refuse=True)
    names = "g f 1 2 3\no v 1 2 3\nusemtl f\ns off\nmtllib v 1 2 3.mtl\n"
    yield case("names_like_statements.obj", names + whole)
    odd = "# a\x0bf 1 2 3\ng a\x0cf 1 2 3\ng b\x1cf 1 2 3\n"
    yield case("odd_separators_in_names.obj", odd + whole)
    yield case("line_separator_in_a_name.obj", "g a\u2028f 1 2 3\n# b\u0085f 1 2 3\n" + whole)
    yield case("latin1.obj", b"# caf\xe9\x85f 1 2 3\ng \xfc\n" + whole.encode())
    yield case("empty_lines.obj", "\n\n \t\n" + whole.replace("\n", "\n\n \n"))
    yield case("weights_of_one.obj", POINTS.replace("\n", " 1.0\n") + NAMES)
    yield case("colors.obj", POINTS.replace("\n", " 0.5 0.25 1\n") + NAMES)
    yield case("some_colors.obj", whole.replace("v 4 0 0", "v 4 0 0 0.1 0.2 0.3"))
    numbers = "v +0 -0 0.\nv 4.e0 .0 0e5\nv 1E+0 3.000 -0.0\nv 10e-1 +1. 5\n"
    yield case("forms_of_numbers.obj", numbers + NAMES)
    far = CORNERS + np.array([500_000.123456789, 5_412_345.987654321, 431.5])
    lines = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in far.tolist())
    yield case("utm.obj", lines + NAMES, far[FACES])
    yield case("points_and_lines_between.obj", POINTS + "p 1 2\nl 1 2 3\n" + NAMES)


def obj_indices() -> Iterator[Case]:
    blocks, shapes = "", []
    for k in range(3):
        corners = CORNERS + np.array([10.0 * k, 0, 0])
        blocks += "".join(f"v {x} {y} {z}\n" for x, y, z in corners.tolist())
        blocks += "vt 0 0\nvt 1 0\nvt 1 1\n" * (k + 1) + "vn 0 0 1\n" * k + "vn 1 0 0\n"
        blocks += "f -4/-3/-1 -2/-2/-1 -3/-1/-1\nf -4//-1 -3//-1 -1//-1\nf -3/-1 -2/-2 -1/-3\nf -2 -4 -1\n"
        shapes.append(corners[FACES])
    yield case("relative_in_blocks.obj", blocks, np.concatenate(shapes))
    mixed = POINTS + "f -4 3 -3\nf 1 -3 4\n" + "v 9 9 9\nf -4 -3 -2\nf 3 1 4\n"
    yield case("relative_and_absolute.obj", mixed)
    yield case("faces_before_vertices.obj", NAMES + POINTS, may_refuse=True)
    texture = "vt 0 0\nvt 1 0\nvt 1 1\n"
    some = "f 1/1 3/2 2/3\nf 1 2 4\nf 2/1 3/2 4/3\nf 3 1 4\n"
    yield case("some_faces_with_texture.obj", POINTS + texture + some)
    normals = "vn 0 0 1\nvn 1 0 0\n"
    three = "f 1/1/1 3/2/1 2/3/1\nf 1//2 2//1 4//2\nf 2/1 3/2 4/3\nf 3 1 4\n"
    yield case("four_forms_of_corners.obj", POINTS + texture + normals + three)
    materials = "usemtl a\nf 1 3 2\nusemtl b\nf 1 2 4\nusemtl a\nf 2 3 4\nusemtl b\nf 3 1 4\n"
    yield case("materials_in_turns.obj", POINTS + materials)
    again = POINTS + POINTS + "o a\nf 1 3 2\nf 5 6 8\no b\nf 2 7 4\no a\nf 3 5 4\n"
    yield case("doubled_vertices.obj", again)


def placed(outline: Floats, kind: str) -> Floats:
    """Return an outline in a plane: xy, yz, zx, turned over, or oblique and far from the origin."""
    x, y = outline.T
    zero = np.zeros(len(outline))
    if kind == "oblique":
        across, along = np.array([2.0, 1, 2]), np.array([-2.0, 2, 1])
        return np.asarray(np.outer(x, across) + np.outer(y, along) + np.array([1000.0, -2000, 500]))
    if kind == "over":
        return np.column_stack([x, y, zero])[::-1]
    axes = {"xy": (x, y, zero), "yz": (zero, x, y), "zx": (y, zero, x)}
    return np.column_stack(axes[kind])


def obj_polygons() -> Iterator[Case]:
    outlines = {"letter": LETTER, "dart": DART, "stair": STAIR}
    for name, outline in outlines.items():
        for kind in ("xy", "yz", "zx", "over", "oblique"):
            for first in (0, 2):
                corners = np.roll(placed(outline, kind), first, axis=0)
                lines = "".join(f"v {a!r} {b!r} {c!r}\n" for a, b, c in corners.tolist())
                face = "f " + " ".join(str(k + 1) for k in range(len(corners))) + "\n"
                yield case(f"{name}_{kind}_{first}.obj", lines + face, [corners])
    quad = np.array([[0, 0, 0], [4, 0, 1], [4, 4, 0], [0, 4, 1]], dtype=np.float64)
    lines = "".join(f"v {a} {b} {c}\n" for a, b, c in quad.tolist())
    yield case("warped_quad.obj", lines + "f 1 2 3 4\n", [quad])
    yield case(
        "polygons_and_triangles.obj",
        lines + "f 1 2 3 4\nf 4 3 1\nf -4 -3 -2\n",
        [quad, quad[[3, 2, 0]], quad[:3]],
    )


def obj_hard_polygons() -> Iterator[Case]:
    comb = [[2 * (k // 2) + k % 2, 5 * (k % 2)] for k in range(20)] + [[20, -1], [0, -1]]
    far = np.array(comb[::-1]) / 1024
    hole = [[3, 3], [3, 7], [7, 7], [7, 3], [3, 3]]
    outlines: dict[str, ArrayLike] = {
        "comb": comb[::-1],
        "comb_far": far + np.array([500_000, 5_412_345]),
        "keyhole": [[0, 0], [10, 0], [10, 10], [0, 10], [0, 0], *hole],
        "corner_twice": [[0, 0], [4, 0], [4, 0], [1, 1], [0, 4]],
        "straight_corners": [[0, 0], [1, 0], [2, 0], [3, 0], [3, 3], [0, 3], [0, 2], [0, 1]],
        "spike": [[0, 0], [4, 0], [4, 4], [6, 6], [4, 4], [0, 4]],
        "thin": LETTER * np.array([1, 2.0**-30]),
        "line": [[0, 0], [1, 0], [3, 0], [2, 0]],
    }
    crossing: dict[str, ArrayLike] = {
        "bow": [[0, 0], [4, 4], [4, 0], [0, 4]],
        "uneven_bow": [[0, 0], [4, 4], [6, 0], [0, 4]],
        "pentagram": [[10, 0], [-8, 6], [3, -10], [3, 10], [-8, -6]],
    }
    for name, outline in {**outlines, **crossing}.items():
        corners = placed(np.asarray(outline, dtype=np.float64), "xy")
        lines = "".join(f"v {a!r} {b!r} {c!r}\n" for a, b, c in corners.tolist())
        face = "f " + " ".join(str(k + 1) for k in range(len(corners))) + "\n"
        triangle = "v 0 0 9\nv 1 0 9\nv 0 1 9\nf -3 -2 -1\n"
        alone = np.array([[0.0, 0, 9], [1, 0, 9], [0, 1, 9]])
        yield case(
            f"{name}.obj", lines + face + triangle, None if name in crossing else [corners, alone]
        )


def obj_refusals() -> Iterator[Case]:
    for name, line in {
        "index_zero": "f 0 1 2",
        "index_too_large": "f 1 2 5",
        "too_far_back": "f -5 -1 -2",
        "half": "f 1.5 2 3",
        "letters": "f a b c",
        "two_corners": "f 1 2",
        "no_corners": "f",
        "empty_index": "f /1 /2 /3",
        "four_parts": "f 1/1/1/1 2/1/1/1 3/1/1/1",
        "two_numbers": "v 1 2",
        "word": "v 1 2 three",
        "inf": "v 1 2 inf",
        "nan": "v nan 0 0",
        "comma": "v 1,5 2 3",
        "five_numbers": "v 1 2 3 4 5",
        "weight": "v 1 2 3 2",
        "surface": "cstype bezier\ndeg 1 1\nsurf 0 1 0 1 1 2 3 4\nparm u 0 1\nparm v 0 1\nend",
    }.items():
        used = "f 1 2 -1\n" if line.startswith("v") else ""
        yield case(f"{name}.obj", POINTS + NAMES + line + "\n" + used, None)
    yield case(
        "control_byte_in_a_number.obj", (POINTS + NAMES).replace("v 4 0 0", "v \x14.0 0 0"), None
    )
    yield case(
        "control_byte_for_a_number.obj", POINTS + NAMES.replace("f 1 3 2", "f 1 3 2 \x1d"), None
    )
    yield case(
        "control_byte_for_a_coordinate.obj", (POINTS + NAMES).replace("v 4 0 0", "v 4 0 \x11"), None
    )
    yield case("cut_off_in_a_face.obj", POINTS + NAMES + "f 1 2", None)
    yield case("empty.obj", "", None)
    yield case("vertices_alone.obj", POINTS, None)


def off_kinds() -> Iterator[Case]:
    def rows(extra: str, corners: Floats = CORNERS) -> str:
        return "".join(
            " ".join(f"{value!r}" for value in corner) + f" {extra}\n"
            for corner in corners.tolist()
        )

    faces = "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"
    kinds = {
        "OFF": "",
        "COFF": "0.1 0.2 0.3 1",
        "NOFF": "0 0 1",
        "STOFF": "0.25 0.75",
        "CNOFF": "0 0 1 255 0 0 255",
        "STCNOFF": "0 1 0 0.5 0.5 0.5 1 0 1",
    }
    for kind, extra in kinds.items():
        yield case(f"kind_{kind}.off", f"{kind}\n4 4 6\n{rows(extra)}{faces}")
    weights = np.array([[1.0], [2], [-4], [0.5]])
    four = np.hstack([CORNERS * weights, weights])
    yield case("kind_4OFF.off", f"4OFF\n4 4 6\n{rows('', four)}{faces}")
    yield case("kind_C4OFF.off", f"C4OFF\n4 4 6\n{rows('1 0 0 1', four)}{faces}")
    yield case("kind_nOFF.off", f"nOFF\n3\n4 4 6\n{rows('')}{faces}", may_refuse=True)
    for name, more in {"": 0, "N": 3, "C": 4, "ST": 2}.items():
        body = struct.pack(">3i", 4, 4, 6)
        for corner in CORNERS:
            body += struct.pack(f">{3 + more}f", *corner, *[0.5] * more)
        for number, face in enumerate(FACES):
            colors = [0.25] * (number if number < 3 else 4)
            body += struct.pack(f">5i{len(colors)}f", 3, *face, len(colors), *colors)
        yield case(f"binary_{name}OFF.off", f"{name}OFF BINARY\n".encode() + body, may_refuse=True)


def off_layouts() -> Iterator[Case]:
    tail = POINTS.replace("v ", "") + "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"
    whole = "OFF\n4 4 0\n" + tail
    yield case("counts_beside_the_word.off", "OFF 4 4 0\n" + tail)
    yield case("without_the_word.off", "4 4 0\n" + tail)
    yield case("crlf.off", whole.replace("\n", "\r\n"))
    yield case("bom.off", b"\xef\xbb\xbf" + whole.encode())
    yield case("a_number_a_line.off", whole.replace(" ", "\n"))
    yield case(
        "comments.off",
        "# made\nOFF # by\n4 4 0 # hand 1 2 3\n\n" + tail.replace("\n", " # 1 2 3\n"),
    )
    colors = ["", " 7", " 0.1 0.2 0.3", " 255 0 0 255"]
    faces = "".join(
        f"3 {a} {b} {c}{color}\n" for (a, b, c), color in zip(FACES.tolist(), colors, strict=True)
    )
    yield case("colors_of_faces.off", "OFF\n4 4 0\n" + POINTS.replace("v ", "") + faces)
    letter = placed(LETTER, "yz")
    rows = "".join(f"{a} {b} {c}\n" for a, b, c in letter.tolist())
    face = f"{len(letter)} " + " ".join(map(str, range(len(letter))))
    yield case(
        "letter_colored.off",
        f"OFF\n{len(letter)} 2 0\n{rows}{face} 0.5 0.5 0.5\n3 0 1 3\n",
        [letter, letter[[0, 1, 3]]],
    )


def off_refusals() -> Iterator[Case]:
    points = POINTS.replace("v ", "")
    for name, text in {
        "too_few_faces": f"OFF\n4 2 0\n{points}3 0 1 2\n",
        "too_few_vertices": "OFF\n4 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "too_many_faces": f"OFF\n4 1 0\n{points}3 0 1 2\n3 0 2 3\n",
        "index": f"OFF\n4 1 0\n{points}3 0 1 4\n",
        "negative_index": f"OFF\n4 1 0\n{points}3 0 1 -1\n",
        "word": f"OFF\n4 1 0\n{points.replace('5', 'five')}3 0 1 2\n",
        "infinity": "4OFF\n3 1 0\n0 0 0 1\n1 0 0 0\n0 1 0 1\n3 0 1 2\n",
        "no_faces": f"OFF\n4 0 0\n{points}",
        "four_dimensions": "nOFF\n4\n3 1 0\n0 0 0 1\n1 0 0 1\n0 1 0 1\n3 0 1 2\n",
        "kind": f"XOFF\n4 1 0\n{points}3 0 1 2\n",
    }.items():
        yield case(f"{name}.off", text, None)
    damaged = points.replace("4 0 0", "\x14.0 0 0")
    yield case("control_byte_in_a_number.off", f"OFF\n4 1 0\n{damaged}3 0 1 2\n", None)
    body = struct.pack(">3i", 4, 1, 0) + CORNERS.astype(">f4").tobytes()
    yield case("binary_cut_off.off", b"OFF BINARY\n" + body + struct.pack(">3i", 3, 0, 1), None)


def ply_kinds() -> Iterator[Case]:
    letter = placed(LETTER, "zx")
    faces = FACES.tolist()
    orders = {"": "text", "<": "little", ">": "big"}
    types = [
        ("float", "uchar", "int"),
        ("double", "int", "uchar"),
        ("float32", "uint8", "uint"),
        ("float64", "char", "short"),
        ("short", "ushort", "ushort"),
        ("int", "uint", "char"),
        ("char", "short", "int8"),
    ]
    for order, name in orders.items():
        for number, kind in enumerate(types):
            yield case(f"{name}_{number}.ply", ply(order, kind, faces, CORNERS))
        polygons = [list(range(len(letter))), [0, 1, 3], [3, 1, 0, 8]]
        shapes = [letter, letter[[0, 1, 3]], letter[[3, 1, 0, 8]]]
        yield case(f"{name}_letter.ply", ply(order, types[0], polygons, letter), shapes)
    far = CORNERS + np.array([500_000.123456789, 5_412_345.987654321, 431.5])
    for order, name in orders.items():
        yield case(
            f"utm_{name}.ply", ply(order, ("double", "uchar", "int"), faces, far), far[FACES]
        )
    text = ply("", types[0], faces, CORNERS)
    yield case("crlf.ply", text.replace(b"\n", b"\r\n"))
    yield case("vertex_index.ply", text.replace(b"vertex_indices", b"vertex_index"))
    head = "ply\nformat ascii 1.0\nobj_info 1 2\nelement face 4\nproperty list uchar int vertex_indices\n"
    head += "element vertex 4\nproperty float z\nproperty float x\nproperty float y\nend_header\n"
    rows = "".join(f"3 {a} {b} {c}\n" for a, b, c in faces) + "".join(
        f"{z} {x} {y}\n" for x, y, z in CORNERS.tolist()
    )
    yield case("faces_first.ply", head + rows)


def ply_refusals() -> Iterator[Case]:
    types = ("float", "uchar", "int")
    text, binary = (ply(order, types, FACES.tolist(), CORNERS) for order in ("", "<"))
    yield case("cut_off.ply", binary[:-4], None)
    yield case("text_cut_off.ply", text[: text.rindex(b"3 2 0")], None)
    yield case("header_cut_off.ply", text[:100], None)
    yield case("index.ply", ply("", types, [[0, 1, 4]], CORNERS), None)
    yield case("negative_index.ply", ply("<", types, [[0, 1, -1]], CORNERS), None)
    yield case("no_faces.ply", ply("<", types, [], CORNERS), None)
    yield case(
        "property_twice.ply",
        text.replace(b"property float z\n", b"property float y\nproperty float z\n"),
        None,
    )
    damaged = text.replace(b"7 4.0 0.0 0.0", b"7 \x14.0 0.0 0.0")
    yield case("control_byte_in_a_number.ply", damaged, None)
    yield case("words.ply", text.replace(b"7 4.0", b"7 four"), None)
    head = b"ply\nformat ascii 1.0\nelement vertex 1\n"
    cloud = head + b"property float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n"
    yield case("cloud.ply", cloud, None)
    splat = cloud.replace(
        b"end_header",
        b"property float f_dc_0\nproperty float scale_0\nproperty float rot_0\nend_header",
    )
    yield case("splats.ply", splat.replace(b"0 0 0", b"0 0 0 1 1 1"), None)
    strips = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    start = cloud.decode().replace("vertex 1", "vertex 4").replace("end_header\n0 0 0\n", strips)
    yield case("strips.ply", start + POINTS.replace("v ", "") + "6 0 1 2 -1 1 3\n", None)


def stl_kinds() -> Iterator[Case]:
    text = stl_text(SOUP, "of four triangles")
    yield case("text.stl", text)
    yield case("text_crlf_tabs.stl", text.replace("\n", "\r\n").replace("  ", "\t"))
    yield case("text_capitals.stl", text.upper().replace("E+", "e+"))
    yield case("text_without_name.stl", stl_text(SOUP))
    yield case("text_name_like_statements.stl", stl_text(SOUP, "facet normal vertex 1 2 3"))
    yield case("text_of_solids.stl", stl_text(SOUP[:2], "a") + stl_text(SOUP[2:], "b"))
    yield case("text_one_line_end_missing.stl", text.rstrip("\n"))
    far = SOUP + np.array([500_000.123456789, 5_412_345.987654321, 431.5])
    yield case("text_utm.stl", stl_text(far), far)
    yield case("binary.stl", stl(SOUP))
    yield case("binary_that_says_solid.stl", stl(SOUP, b"solid made by hand"))
    yield case("binary_that_says_solid_and_facet.stl", stl(SOUP, b"solid x\nfacet normal 0 0 1"))
    yield case("binary_big.stl", stl(SOUP, order=">"), None)
    yield case("binary_cut_off.stl", stl(SOUP)[:-20], None)
    yield case("binary_too_long.stl", stl(SOUP) + bytes(50), None)
    yield case("binary_empty.stl", stl(SOUP[:0]), None)
    yield case("text_cut_off.stl", text[: text.rindex("endloop")], None)
    yield case("text_cut_off_after_a_facet.stl", text[: text.rindex("endsolid")], None)
    yield case("text_cut_off_in_a_number.stl", text[: text.rindex("5.0")], None)
    corner = "    vertex 1.0 1.0 5.0\n"
    yield case("text_four_corners.stl", text.replace(corner, corner * 2, 1), None)
    yield case("text_control_byte_in_a_number.stl", text.replace("4.0", "\x14.0"), None)
    yield case("text_word.stl", text.replace("4.0", "four"), None)
