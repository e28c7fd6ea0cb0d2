"""Mesh files: their numbers, normals and colors are those of the file, and no damaged one gets through."""

import base64
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray
from PIL import Image

from tests.support.long_tail import examples
from tests.support.scene_file import film
from xfrustum.cli.main import main
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import (
    DoubleFrustum,
    Frustum,
    InputError,
    Plate,
    Scene,
    SceneObject,
    open_scene,
)
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.geometry.shapes import build_shape, magnification, place, refine, smoothed
from xfrustum.scenes.meshes.mesh_file import load_mesh

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
needs_data = pytest.mark.skipif(
    not DATA.is_dir(), reason="no folder of test data beside the checkout"
)

CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@needs_data
@pytest.mark.parametrize(
    ("name", "triangles"), [("teapot.obj", 6_320), ("CesiumMilkTruck.glb", 3_624)]
)
def test_triangles_are_numbered_as_the_contract_says(name: str, triangles: int) -> None:
    ours = load_mesh(DATA / name)
    parts = trimesh.load_scene(str(DATA / name), process=False)
    for geometry in parts.geometry.values():
        geometry.visual = trimesh.visual.ColorVisuals()  # its textures would be packed for a second
    theirs = parts.to_mesh()
    assert len(ours.faces) == triangles
    np.testing.assert_array_equal(ours.faces, theirs.faces)
    np.testing.assert_array_equal(ours.vertices, theirs.vertices)


@needs_data
def test_parts_keep_their_textures_and_a_part_used_twice_shares_one() -> None:
    truck = load_mesh(DATA / "CesiumMilkTruck.glb")
    assert truck.uv is not None
    assert truck.texture_of_triangle is not None
    assert [texture.shape for texture in truck.textures] == [(2048, 2048, 4)] * 2
    assert np.bincount(truck.texture_of_triangle + 1).tolist() == [344, 1744, 1536]
    textured = truck.faces[truck.texture_of_triangle >= 0]
    assert np.isfinite(truck.uv[textured]).all()


def test_parts_are_placed_and_counted_as_often_as_they_are_used(tmp_path: Path) -> None:
    scene: Any = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(), geom_name="wheel", node_name="left")
    shift = np.eye(4)
    shift[0, 3] = 5
    scene.graph.update("right", matrix=shift, geometry="wheel")
    path = tmp_path / "two.glb"
    scene.export(str(path))
    mesh = load_mesh(path)
    assert len(mesh.faces) == 24
    assert sorted({float(x) for x in mesh.vertices[:, 0]}) == [-0.5, 0.5, 4.5, 5.5]


def test_a_mesh_with_a_comment_that_is_no_utf_8_and_a_3mf_mesh_are_read(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    box = trimesh.creation.box()
    latin = "# gezählt von Müller\n".encode("latin-1")
    (tmp_path / "box.obj").write_bytes(latin + trimesh.exchange.obj.export_obj(box).encode())
    (tmp_path / "late.obj").write_bytes(b"#" * 3000 + b"\n" + (tmp_path / "box.obj").read_bytes())
    box.export(tmp_path / "box.3mf")
    for name in ("box.obj", "late.obj", "box.3mf"):
        assert len(load_mesh(tmp_path / name).faces) == 12
    assert capfd.readouterr().err == ""


def test_a_placement_that_overflows_is_an_input_error(tmp_path: Path) -> None:
    path = tmp_path / "big.obj"
    path.write_text("v 1e300 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="NaN or infinite in scene coordinates"):
        place(load_mesh(path), np.diag([1e300, 1, 1, 1]))


# Normals and colors of meshes: those of the file, carried along by placing and refining.

ROUNDING = 1e-12
"""A few dozen operations of doubles on values of size one round to 1e-14; matrices here may be so close to
singular that they lose two digits more."""

MATRICES = npst.arrays(np.float64, (3, 3), elements=st.floats(-2, 2)).filter(
    lambda matrix: abs(matrix[0] @ np.cross(matrix[1], matrix[2])) > 0.1
)
VECTORS = npst.arrays(np.float64, (3, 3), elements=st.floats(-1, 1))


def written(folder: Path, name: str, text: str) -> SceneObject:
    (folder / name).write_text(text)
    return load_mesh(folder / name)


def alone(part: SceneObject) -> Scene:
    frustum = Frustum(resolution=(4, 4), reach=(10.0, 10.0), fov=(1.0, 1.0))
    return Scene(
        name="one", plate=Plate(size=(1, 1), hogels=(1, 1)), frustum=frustum, objects=(part,)
    )


def normals_of(part: SceneObject) -> Floats:
    assert part.vertex_normals is not None
    return part.vertex_normals


def colors_of(part: SceneObject) -> Floats:
    assert part.vertex_colors is not None
    return part.vertex_colors


def winding_normals(part: SceneObject) -> Floats:
    a, b, c = np.moveaxis(part.vertices[part.faces], 1, 0)
    return np.cross(b - a, c - a)


def test_normals_are_those_of_the_file_and_not_made_up(tmp_path: Path) -> None:
    flat = written(tmp_path, "flat.obj", CORNERS + "f 1 2 3\n")
    assert flat.vertex_normals is None and flat.vertex_colors is None
    normals = "vn 0 0 2\nvn 0 3 4\nvn 0 0 0\n"
    part = written(tmp_path, "own.obj", CORNERS + normals + "f 1//1 2//2 3//3\n")
    order = np.argsort(part.vertices @ [1, 2, 0])
    expected = np.array([[0, 0, 1], [0, 0.6, 0.8], [np.nan] * 3])
    np.testing.assert_allclose(normals_of(part)[order], expected)
    header = "ply\nformat ascii 1.0\nelement vertex 3\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    part = written(tmp_path, "n.ply", header + "0 0 0 0 0 1\n1 0 0 0 1 0\n0 1 0 1 0 0\n3 0 1 2\n")
    np.testing.assert_array_equal(normals_of(part), [[0, 0, 1], [0, 1, 0], [1, 0, 0]])


def placed_ball(matrix: Floats, folder: Path) -> SceneObject:
    """Return a glTF file's ball, with its normals, placed by its node."""
    ball = trimesh.creation.icosphere(subdivisions=1)
    assert len(ball.vertex_normals) == len(ball.vertices)  # now the exporter finds them
    scene: Any = trimesh.Scene()
    scene.add_geometry(ball, transform=matrix)
    path = folder / "ball.glb"
    scene.export(str(path), include_normals=True)
    return load_mesh(path)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_a_node_places_normals_with_its_mesh_also_where_it_mirrors(
    tmp_path: Path, mirror: float
) -> None:
    matrix = np.diag([mirror * 2.0, 0.5, 3.0, 1.0])
    matrix[:3, 3] = (5, 6, 7)
    part = placed_ball(matrix, tmp_path)
    # On the ellipsoid of these half axes the normal is along x / a^2, y / b^2, z / c^2.
    outward = (part.vertices - (5, 6, 7)) / np.array([2.0, 0.5, 3.0]) ** 2
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    # Normals of 32-bit floats, averaged over the facets of an icosphere: not those of the ball
    # exactly.
    assert (np.einsum("vx,vx->v", outward, normals_of(part)) > 0.99).all()
    agree = np.einsum("fx,fcx->fc", winding_normals(part), normals_of(part)[part.faces])
    assert (agree > 0).all(), "on the side that the winding faces"


@settings(deadline=None, derandomize=True)
@given(matrix=MATRICES, corners=VECTORS, shift=st.tuples(*[st.floats(-3, 3)] * 3))
def test_a_placed_normal_stays_upright_on_the_side_that_the_winding_faces(
    matrix: Floats, corners: Floats, shift: tuple[float, float, float]
) -> None:
    """Whatever the matrix, mirrors included: the moved normal is that of the moved triangle."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    if np.linalg.norm(normal) < 0.05:
        return
    part = SceneObject(
        name="t",
        vertices=corners,
        faces=np.array([[0, 1, 2]]),
        vertex_normals=np.tile(normal, (3, 1)),
    )
    scene_from_mesh = np.eye(4)
    scene_from_mesh[:3, :3], scene_from_mesh[:3, 3] = matrix, shift
    moved = place(part, scene_from_mesh)
    [upright] = winding_normals(moved)
    for kept in normals_of(moved):
        cosine = kept @ upright / np.linalg.norm(kept) / np.linalg.norm(upright)
        assert cosine == pytest.approx(1, abs=1e-9)
    lengths = [np.linalg.norm(matrix @ direction) for direction in np.eye(3)]
    assert max(lengths) <= magnification(scene_from_mesh) * (1 + ROUNDING)


@examples(30)
@given(
    normals=VECTORS,
    colors=VECTORS,
    weights=st.tuples(st.floats(0, 1), st.floats(0, 1)),
    levels=st.integers(1, 3),
)
def test_refining_leaves_what_is_interpolated_over_a_triangle_as_it_was(
    normals: Floats, colors: Floats, weights: tuple[float, float], levels: int
) -> None:
    one, two = sorted(weights)
    shares = np.array([one, two - one, 1 - two])
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    part = SceneObject(
        name="t",
        vertices=corners,
        faces=np.array([[0, 1, 2]]),
        vertex_normals=normals,
        vertex_colors=colors,
    )
    fine = refine(alone(part), levels).objects[0]
    point = shares @ corners
    # The part of the triangle that the point lies in, and its place there.
    local = [
        np.linalg.solve(np.vstack([fine.vertices[face].T[:2], np.ones(3)]), [*point[:2], 1])
        for face in fine.faces
    ]
    inside = int(np.argmax([min(place) for place in local]))
    for coarse, values in ((normals, normals_of(fine)), (colors, colors_of(fine))):
        np.testing.assert_allclose(
            local[inside] @ values[fine.faces[inside]], shares @ coarse, atol=ROUNDING
        )


def test_a_corner_without_a_normal_leaves_all_of_its_triangle_flat_however_fine() -> None:
    normals = np.array([[0.0, 0, 1], [0, 0, 1], [np.nan] * 3, [0, 0, 1]])
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, -1, 0]])
    part = SceneObject(
        name="t", vertices=corners, faces=np.array([[0, 1, 2], [1, 0, 3]]), vertex_normals=normals
    )
    fine = refine(alone(part), 2).objects[0]
    smooth = np.isfinite(normals_of(fine)[fine.faces]).all(axis=(1, 2))
    assert smooth.tolist() == [False] * 16 + [True] * 16


def test_smoothing_does_not_depend_on_how_flat_faces_are_cut() -> None:
    """Every face of a box in two triangles, or in eight: the corners have the same normals."""
    box = build_shape("box")
    fine = smoothed(refine(alone(box), 1).objects[0])
    coarse = smoothed(box)
    np.testing.assert_allclose(
        normals_of(fine)[: len(box.vertices)], normals_of(coarse), atol=1e-15
    )


def test_smoothing_joins_vertices_in_one_place_and_keeps_normals_that_are_there() -> None:
    box = build_shape("box")
    loose = SceneObject(
        name="soup",
        vertices=box.vertices[box.faces].reshape(-1, 3),
        faces=np.arange(36).reshape(-1, 3),
    )
    normals = normals_of(smoothed(loose))
    np.testing.assert_allclose(normals, np.sign(loose.vertices) / np.sqrt(3), atol=1e-15)
    own = np.full((8, 3), np.nan)
    own[5] = (0, 1, 0)
    kept = normals_of(smoothed(replace(box, vertex_normals=own)))
    np.testing.assert_array_equal(kept[5], [0, 1, 0])
    assert np.isfinite(kept).all()


@pytest.mark.parametrize("size", [1e-150, 1.0, 1e150])
def test_smoothing_a_sphere_of_any_size_gives_about_its_radii(size: float) -> None:
    """24 bands of 7.5 degrees: a mean of the facets around a point is off by far less than one of them."""
    ball = build_shape("sphere")
    ball = smoothed(replace(ball, vertices=ball.vertices * size))
    outward = ball.vertices / size / 0.5
    assert np.einsum("vx,vx->v", outward, normals_of(ball)).min() > np.cos(np.radians(0.5))


# Brightness of mesh files against pixels computed by hand: nothing that trimesh makes up is drawn.

# Every file shows one sheet that faces the viewer and a white light from there, on a material that
# is diffuse alone: by CONVENTIONS.md, "Light", a pixel of it has the radiance DIFFUSE times the
# albedo. The files are written here, number by number, and not by trimesh.

DIFFUSE = 0.5
FLOAT32_ROUNDING = 1e-5
"""Largest relative error: the rasterizer shades in some ten operations of 32-bit floats, 6e-8 each."""

SHEET = ((-40.0, -40.0, 0.0), (40.0, -40.0, 0.0), (40.0, 40.0, 0.0), (-40.0, 40.0, 0.0))
COORDINATES = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
STORED = (188, 64, 3)
"""A color in 8 bits: bright, dark, and on the straight part of sRGB."""

FLOAT, SHORT, BYTE = 5126, 5123, 5121
"""Component types of glTF."""


def linear(stored: int, full_scale: int = 255) -> float:
    """Return linear light of an sRGB value, by the definition in IEC 61966-2-1."""
    share = stored / full_scale
    return share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4


def sheet_scene(folder: Path, mesh: str, *, smooth: bool = False) -> Scene:
    """Return the scene of a mesh file that lies in a folder."""
    path = folder / "scene.toml"
    path.write_text(
        film((8.0, 6.0), hogels=(3, 3), resolution=(9, 7), fov_deg=(40.0, 30.0), reach=(20.0, 20.0))
        + f"""
        [[object]]
        mesh = "{mesh}"
        translate = [0.0, 0.0, -10.0]
        material = "matt"
        smooth = {str(smooth).lower()}
        [material.matt]
        ambient = 0.0
        diffuse = {DIFFUSE}
        [[light]]
        direction = [0.0, 0.0, 1.0]
        """
    )
    return open_scene(str(path))


def radiance(scene: Scene) -> Floats:
    """Return the middle pixel's color, the same in the reference's and in the rasterizer's image."""
    aperture = scene.plate.middle
    truth = Reference(scene).trace(aperture).color
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(aperture, DoubleFrustum(near=0.01)).color
    assert truth is not None
    assert drawn is not None
    np.testing.assert_allclose(drawn, truth, rtol=FLOAT32_ROUNDING)
    return np.asarray(truth[3, 4], dtype=np.float64)


def write_obj(
    path: Path,
    *,
    coordinates: bool = False,
    head: str = "",
    colors: tuple[float, ...] = (),
    material: str | None = None,
) -> str:
    """Write the sheet as OBJ and return the file's name."""
    lines = [head] if head else []
    lines += ["v " + " ".join(map(str, (*corner, *colors))) for corner in SHEET]
    lines += [f"vt {u} {v}" for u, v in COORDINATES if coordinates]
    lines += [f"usemtl {material}"] if material else []
    corner = "{0}/{0}" if coordinates else "{0}"
    lines += [
        "f " + " ".join(corner.format(number) for number in face) for face in ((1, 2, 3), (1, 3, 4))
    ]
    path.write_text("\n".join(lines) + "\n")
    return path.name


def write_ply(
    path: Path,
    properties: tuple[str, ...],
    values: tuple[float, ...],
    *,
    coordinates: bool = False,
    head: str = "",
) -> str:
    """Write the sheet as PLY, with more properties of its vertices, and return the file's name."""
    placed = ("float s", "float t") if coordinates else ()
    names = ("float x", "float y", "float z", *properties, *placed)
    lines = ["ply", "format ascii 1.0", *([head] if head else []), "element vertex 4"]
    lines += [f"property {name}" for name in names]
    lines += ["element face 2", "property list uchar int vertex_indices", "end_header"]
    for corner, uv in zip(SHEET, COORDINATES, strict=True):
        lines.append(" ".join(map(str, (*corner, *values, *(uv if coordinates else ())))))
    path.write_text("\n".join([*lines, "3 0 1 2", "3 0 2 3"]) + "\n")
    return path.name


def write_gltf(
    path: Path,
    *,
    material: dict[str, Any] | None = None,
    colors: NDArray[Any] | None = None,
    kind: int = BYTE,
    image: str | None = None,
) -> str:
    """Write the sheet as glTF with texture coordinates, and return the file's name."""
    arrays = [
        np.array(SHEET, "<f4"),
        np.array(COORDINATES, "<f4"),
        np.array([0, 1, 2, 0, 2, 3], "<u2"),
    ]
    accessors: list[dict[str, Any]] = [
        {
            "componentType": FLOAT,
            "count": 4,
            "type": "VEC3",
            "min": [-40, -40, 0],
            "max": [40, 40, 0],
        },
        {"componentType": FLOAT, "count": 4, "type": "VEC2"},
        {"componentType": SHORT, "count": 6, "type": "SCALAR"},
    ]
    primitive: dict[str, Any] = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2}
    if colors is not None:
        arrays.append(np.tile(colors, (4, 1)))
        accessors.append(
            {"componentType": kind, "count": 4, "type": "VEC4", "normalized": kind != FLOAT}
        )
        primitive["attributes"]["COLOR_0"] = 3
    views, data = [], b""
    for number, array in enumerate(arrays):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        accessors[number]["bufferView"] = number
        data += array.tobytes() + bytes(-array.nbytes % 4)
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": len(data), "uri": uri}],
        "bufferViews": views,
        "accessors": accessors,
    }
    if material is not None:
        tree["materials"], primitive["material"] = [material], 0
    if image is not None:
        tree["images"], tree["textures"] = [{"uri": image}], [{"source": 0}]
    path.write_text(json.dumps(tree))
    return path.name


def write_picture(path: Path, color: tuple[int, ...] = STORED) -> str:
    Image.new("RGB", (4, 2), color).save(path)
    return path.name


PAINTED = tuple(linear(part) for part in STORED)
WHITE = (1.0, 1.0, 1.0)


HALF, QUARTER, LITTLE = (
    ((0.5 + 0.055) / 1.055) ** 2.4,
    ((0.25 + 0.055) / 1.055) ** 2.4,
    0.002 / 12.92,
)
"""Linear light of sRGB values of 0.5, 0.25 and 0.002, the last on the straight part."""

WORDS = (40000, 20000, 500)
"""A color in 16 bits."""


def objs(folder: Path) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Write OBJ files, and yield their names and what albedo they have.

    A material library gives its texture and not its colors, which are a warning: only those of
    glTF's materials are read.
    """
    write_picture(folder / "wood.png")
    (folder / "m.mtl").write_text(
        "newmtl plain\nKd 0.2 0.3 0.4\nnewmtl wood\nKd 0.2 0.3 0.4\nmap_Kd wood.png\n"
    )
    for uv in (False, True):
        yield write_obj(folder / f"white-{uv}.obj", coordinates=uv), WHITE
        colors = (0.5, 0.25, 0.002)
        yield (
            write_obj(folder / f"colors-{uv}.obj", coordinates=uv, colors=colors),
            (HALF, QUARTER, LITTLE),
        )
        head = "mtllib m.mtl"
        yield (
            write_obj(folder / f"plain-{uv}.obj", coordinates=uv, head=head, material="plain"),
            WHITE,
        )
    head = "# made by hand\nmtllib m.mtl"
    yield write_obj(folder / "wood.obj", coordinates=True, head=head, material="wood"), PAINTED
    yield write_obj(folder / "no-library.obj", coordinates=True, material="wood"), WHITE
    # trimesh makes up the same gray where there is no texture, and Pillow clips 16 bits.
    for kind in (np.uint8, np.uint16):
        gray, name = np.full((2, 2), 100 * np.iinfo(kind).max // 255, kind), f"gray-{kind.__name__}"
        Image.fromarray(gray).save(folder / f"{name}.png")
        (folder / f"{name}.mtl").write_text(f"newmtl gray\nmap_Kd {name}.png\n")
        head = f"mtllib {name}.mtl"
        made = write_obj(folder / f"{name}.obj", coordinates=True, head=head, material="gray")
        yield made, (linear(100),) * 3


def plys(folder: Path) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Write PLY files with colors of every type, and yield their names and what albedo they have."""
    yield write_ply(folder / "white.ply", (), (), coordinates=True), WHITE
    for number, (kind, values, albedo) in enumerate(
        [
            ("uchar", STORED, PAINTED),
            ("ushort", WORDS, tuple(linear(part, 65535) for part in WORDS)),
            ("float", (1.0, 0.5, 0.0), (1.0, HALF, 0.0)),
            ("float", STORED, PAINTED),
            ("int", STORED, PAINTED),
        ]
    ):
        colors = tuple(f"{kind} {name}" for name in ("red", "green", "blue"))
        yield (
            write_ply(folder / f"{number}.ply", colors, values, coordinates=number % 2 == 0),
            albedo,
        )


def gltfs(folder: Path) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Write glTF files, and yield their names and albedos: colors are linear and multiply each other."""
    write_picture(folder / "wood.png")
    factor, half = (0.5, 0.25, 0.002), (0.5, 1.0, 0.002)
    base: dict[str, Any] = {"baseColorFactor": [*factor, 1.0]}
    textured = {"pbrMetallicRoughness": {**base, "baseColorTexture": {"index": 0}}}
    base = {"pbrMetallicRoughness": base}
    floats: dict[str, Any] = {"colors": np.array([[*half, 1.0]], "<f4"), "kind": FLOAT}
    words: dict[str, Any] = {"colors": np.array([[*WORDS, 65535]], "<u2"), "kind": SHORT}
    for number, (content, albedo) in enumerate(
        [
            ({}, WHITE),
            ({"material": base}, factor),
            (floats, half),
            ({"colors": np.array([[*STORED, 255]], "u1")}, tuple(part / 255 for part in STORED)),
            ({**words, "material": {}}, tuple(part / 65535 for part in WORDS)),
            ({**floats, "material": base}, tuple(np.multiply(factor, half))),
            ({"material": textured, "image": "wood.png"}, tuple(np.multiply(factor, PAINTED))),
        ]
    ):
        yield write_gltf(folder / f"{number}.gltf", **content), albedo


@pytest.mark.parametrize("files", [objs, plys, gltfs])
def test_a_mesh_is_as_bright_as_its_file_says_with_texture_coordinates_or_without(
    files: Callable[[Path], Iterator[tuple[str, tuple[float, ...]]]], tmp_path: Path
) -> None:
    """Coordinates place a texture. Where there is none they change nothing."""
    for number, (name, albedo) in enumerate(files(tmp_path)):
        scene = sheet_scene(tmp_path, name, smooth=number % 2 == 1)
        assert [line for line in scene.warnings if "statements Kd" not in line] == [], name
        np.testing.assert_allclose(
            radiance(scene), DIFFUSE * np.array(albedo), FLOAT32_ROUNDING, err_msg=name
        )


def named_in_vain(folder: Path) -> list[tuple[str, str]]:
    """Write mesh files that name what is not there, and return each with what must be said of it."""
    (folder / "m.mtl").write_text("newmtl wood\nmap_Kd lost.png\n")
    (folder / "bad.png").write_bytes(b"no picture")
    (folder / "b.mtl").write_text("newmtl wood\nmap_Kd bad.png\n")
    (folder / "empty.png").touch()
    (folder / "e.mtl").write_text("newmtl wood\nmap_Kd empty.png\n")
    dds = np.zeros(32, "<u4")
    dds[[0, 1, 3, 4, 19, 20, 21]] = [0x20534444, 124, 4, 4, 32, 4, 0x3F3F3F3F]
    (folder / "strange.dds").write_bytes(dds.tobytes())  # of compression "????"
    (folder / "s.mtl").write_text("newmtl wood\nmap_Kd strange.dds\n")
    inside = "data:image/vnd-ms.dds;base64," + base64.b64encode(dds.tobytes()).decode()
    texture = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    uses: dict[str, Any] = {"coordinates": True, "material": "wood"}
    head, glossy = "comment TextureFile lost.png", "KHR_materials_pbrSpecularGlossiness"
    return [
        (write_obj(folder / "a.obj", head="mtllib m.mtl", **uses), "texture lost.png is missing"),
        (
            write_obj(folder / "b.obj", head="mtllib b.mtl", **uses),
            "texture bad.png cannot be read",
        ),
        (
            write_obj(folder / "c.obj", head="mtllib lost.mtl", **uses),
            "material library lost.mtl is missing",
        ),
        (
            write_ply(folder / "d.ply", (), (), coordinates=True, head=head),
            "texture lost.png is missing",
        ),
        (
            write_gltf(folder / "e.gltf", material=texture, image="lost.png"),
            "texture lost.png is missing",
        ),
        (write_gltf(folder / "f.gltf", material={"extensions": {glossy: {}}}), glossy),
        (
            write_obj(folder / "g.obj", head="mtllib e.mtl", **uses),
            "texture empty.png cannot be read",
        ),
        (
            write_obj(folder / "h.obj", head="mtllib s.mtl", **uses),
            "texture strange.dds cannot be read",
        ),
        (write_gltf(folder / "i.gltf", material=texture, image="."), "texture . cannot be read"),
        (
            write_gltf(folder / "j.gltf", material=texture, image="empty.png"),
            "empty.png cannot be read",
        ),
        (
            write_gltf(folder / "k.gltf", material=texture, image=inside),
            "in image 0 of the file itself",
        ),
    ]


def test_a_texture_that_is_named_and_missing_is_a_warning_that_names_it(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for mesh, told in named_in_vain(tmp_path):
        scene = sheet_scene(tmp_path, mesh)
        [line] = scene.warnings
        assert mesh in line
        assert told in line
        np.testing.assert_allclose(radiance(scene), DIFFUSE, FLOAT32_ROUNDING)
    capfd.readouterr()
    assert main(["check", scene.source, "--json"]) == 0
    printed = capfd.readouterr()
    assert printed.err == f"xfrustum: warning: {line}\n"
    rows = {row["name"]: row for row in json.loads(printed.out)["effects"]}
    assert rows["textures"]["reason"] == "no object has a texture"
