"""Mesh files: their numbers, normals and colors are those of the file, and no damaged one gets through."""

import base64
import json
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
from trimesh.exceptions import ExceptionWrapper
from trimesh.exchange.load import mesh_loaders

from tests.support.long_tail import examples
from tests.support.scene_file import film
from xfrustum.cli.main import main
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DoubleFrustum, Frustum, InputError, Plate, Scene, SceneObject, open_scene
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.files.meshes import load_mesh
from xfrustum.scenes.geometry.shapes import build_shape, magnification, place, placement, refine, smoothed

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="no folder of test data beside the checkout")

CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
PLY = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {axis}\n" for axis in "xyz")
PLY += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"


@needs_data
@pytest.mark.parametrize(("name", "triangles"), [("teapot.obj", 6_320), ("CesiumMilkTruck.glb", 3_624)])
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


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("empty.obj", "", "the mesh file is empty"),
        ("no-faces.obj", CORNERS, "no triangles"),
        ("nan.obj", CORNERS.replace("1 0 0", "1 nan 0") + "f 1 2 3\n", "1 of 3 vertices are NaN or infinite"),
        ("infinite.obj", CORNERS.replace("v 1 0 0", "v inf 0 0") + "f 1 2 3\n", "the first is number 1"),
        ("past.obj", CORNERS + "f 1 2 9\n", "faces point past the vertices"),
        ("before.obj", CORNERS + "f -1 -2 -9\n", "faces point past the vertices"),
        ("past.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "face"),
        ("past.ply", PLY + "0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "past the vertices (index 7, 3 vertices)"),
        ("damaged.glb", "hello", "cannot be read"),
        ("damaged.ply", "ply\nnonsense", "damaged"),
        ("points.xyz", "1 2 3\n4 5 6\n", ""),
        ("picture.foo", "x", "use one of"),
    ],
)
def test_a_damaged_mesh_is_one_line_that_names_the_file(
    tmp_path: Path, name: str, text: str, told: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_mesh(path)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value) and told in str(caught.value)


def test_a_placement_that_overflows_is_an_input_error(tmp_path: Path) -> None:
    path = tmp_path / "big.obj"
    path.write_text("v 1e300 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="NaN or infinite in scene coordinates"):
        place(load_mesh(path), np.diag([1e300, 1, 1, 1]))


def test_a_3mf_mesh_without_lxml_is_told_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.3mf"
    trimesh.creation.box().export(path)
    # So trimesh keeps the failure of its own import of lxml.
    failed = ExceptionWrapper(ImportError("No module named 'lxml'"))
    monkeypatch.setitem(mesh_loaders, "3mf", failed)
    with pytest.raises(InputError, match=r"not installed; for 3MF: pip install '\.\[3mf\]'"):
        load_mesh(path)


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
    return Scene(name="one", plate=Plate(size=(1, 1), hogels=(1, 1)), frustum=frustum, objects=(part,))


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
def test_a_node_places_normals_with_its_mesh_also_where_it_mirrors(tmp_path: Path, mirror: float) -> None:
    matrix = np.diag([mirror * 2.0, 0.5, 3.0, 1.0])
    matrix[:3, 3] = (5, 6, 7)
    part = placed_ball(matrix, tmp_path)
    # On the ellipsoid of these half axes the normal is along x / a^2, y / b^2, z / c^2.
    outward = (part.vertices - (5, 6, 7)) / np.array([2.0, 0.5, 3.0]) ** 2
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    # Normals of 32-bit floats, averaged over the facets of an icosphere: not those of the ball exactly.
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
        name="t", vertices=corners, faces=np.array([[0, 1, 2]]), vertex_normals=np.tile(normal, (3, 1))
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


@pytest.mark.parametrize("scale", [1e-25, 1.0, 1e25])
def test_the_size_of_a_placement_does_not_reach_the_normals(scale: float) -> None:
    ball = smoothed(build_shape("sphere"))
    normals = normals_of(place(ball, placement(scale, (10.0, 20.0, 30.0))))
    turned = normals_of(place(ball, placement(1.0, (10.0, 20.0, 30.0))))
    np.testing.assert_allclose(normals, turned, atol=ROUNDING)


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
        name="t", vertices=corners, faces=np.array([[0, 1, 2]]), vertex_normals=normals, vertex_colors=colors
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
        np.testing.assert_allclose(local[inside] @ values[fine.faces[inside]], shares @ coarse, atol=ROUNDING)


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
    np.testing.assert_allclose(normals_of(fine)[: len(box.vertices)], normals_of(coarse), atol=1e-15)


def test_smoothing_joins_vertices_in_one_place_and_keeps_normals_that_are_there() -> None:
    box = build_shape("box")
    loose = SceneObject(
        name="soup", vertices=box.vertices[box.faces].reshape(-1, 3), faces=np.arange(36).reshape(-1, 3)
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


def test_opposite_faces_leave_no_normal() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    part = SceneObject(name="t", vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 1]]))
    normals = normals_of(smoothed(part))
    assert np.isnan(normals).all()


# Brightness of mesh files against pixels computed by hand: nothing that trimesh makes up is drawn.

# Every file shows one sheet that faces the viewer and a white light from there, on a material that is diffuse
# alone: by CONVENTIONS.md, "Light", a pixel of it has the radiance DIFFUSE times the albedo. The files are
# written here, number by number, and not by trimesh.

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


def assert_albedo(scene: Scene, albedo: tuple[float, ...]) -> None:
    np.testing.assert_allclose(radiance(scene), DIFFUSE * np.array(albedo), rtol=FLOAT32_ROUNDING)


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
    lines += ["f " + " ".join(corner.format(number) for number in face) for face in ((1, 2, 3), (1, 3, 4))]
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
        {"componentType": FLOAT, "count": 4, "type": "VEC3", "min": [-40, -40, 0], "max": [40, 40, 0]},
        {"componentType": FLOAT, "count": 4, "type": "VEC2"},
        {"componentType": SHORT, "count": 6, "type": "SCALAR"},
    ]
    primitive: dict[str, Any] = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2}
    if colors is not None:
        arrays.append(np.tile(colors, (4, 1)))
        accessors.append({"componentType": kind, "count": 4, "type": "VEC4", "normalized": kind != FLOAT})
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


@pytest.mark.parametrize("smooth", [False, True])
def test_a_mesh_is_as_bright_with_texture_coordinates_as_without(tmp_path: Path, smooth: bool) -> None:
    """Coordinates place a texture. Where there is none they change nothing."""
    for coordinates in (False, True):
        obj = write_obj(tmp_path / f"{coordinates}.obj", coordinates=coordinates)
        assert_albedo(sheet_scene(tmp_path, obj, smooth=smooth), WHITE)
        ply = write_ply(tmp_path / f"{coordinates}.ply", (), (), coordinates=coordinates)
        assert_albedo(sheet_scene(tmp_path, ply, smooth=smooth), WHITE)


def test_colors_at_vertices_are_as_bright_with_texture_coordinates_as_without(tmp_path: Path) -> None:
    shares = (0.5, 0.25, 0.002)
    albedo = (((0.5 + 0.055) / 1.055) ** 2.4, ((0.25 + 0.055) / 1.055) ** 2.4, 0.002 / 12.92)
    for coordinates in (False, True):
        obj = write_obj(tmp_path / f"{coordinates}.obj", coordinates=coordinates, colors=shares)
        assert_albedo(sheet_scene(tmp_path, obj), albedo)


def test_a_material_library_gives_its_texture_and_not_its_colors(tmp_path: Path) -> None:
    """CONVENTIONS.md, Light: colors of other materials than glTF's are not read."""
    write_picture(tmp_path / "wood.png")
    (tmp_path / "m.mtl").write_text(
        "newmtl plain\nKd 0.2 0.3 0.4\nnewmtl wood\nKd 0.2 0.3 0.4\nmap_Kd wood.png\n"
    )
    for coordinates in (False, True):
        name = f"plain-{coordinates}.obj"
        write_obj(tmp_path / name, coordinates=coordinates, head="mtllib m.mtl", material="plain")
        scene = sheet_scene(tmp_path, name)
        assert scene.warnings == ()
        assert_albedo(scene, WHITE)
    head = "# made by hand\nmtllib m.mtl"
    name = write_obj(tmp_path / "wood.obj", coordinates=True, head=head, material="wood")
    scene = sheet_scene(tmp_path, name)
    assert scene.warnings == ()
    assert_albedo(scene, PAINTED)
    # A material that no library has.
    name = write_obj(tmp_path / "none.obj", coordinates=True, material="wood")
    assert_albedo(sheet_scene(tmp_path, name), WHITE)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_gray_textures_count_though_trimesh_makes_up_the_same_and_pillow_clips_16_bits(
    tmp_path: Path, kind: type[np.unsignedinteger[Any]]
) -> None:
    Image.fromarray(np.full((2, 2), 100 * np.iinfo(kind).max // 255, kind)).save(tmp_path / "gray.png")
    (tmp_path / "m.mtl").write_text("newmtl gray\nmap_Kd gray.png\n")
    name = write_obj(tmp_path / "gray.obj", coordinates=True, head="mtllib m.mtl", material="gray")
    assert_albedo(sheet_scene(tmp_path, name), (linear(100),) * 3)


@pytest.mark.parametrize(
    ("kind", "values", "albedo"),
    [
        ("uchar", STORED, PAINTED),
        ("ushort", (40000, 20000, 500), tuple(linear(part, 65535) for part in (40000, 20000, 500))),
        ("float", (1.0, 0.5, 0.0), (1.0, ((0.5 + 0.055) / 1.055) ** 2.4, 0.0)),
        ("float", STORED, PAINTED),
        ("int", STORED, PAINTED),
    ],
)
def test_ply_colors_of_any_type_are_decoded_from_srgb(
    tmp_path: Path, kind: str, values: tuple[float, ...], albedo: tuple[float, ...]
) -> None:
    properties = tuple(f"{kind} {name}" for name in ("red", "green", "blue"))
    for coordinates in (False, True):
        name = write_ply(tmp_path / f"{coordinates}.ply", properties, values, coordinates=coordinates)
        assert_albedo(sheet_scene(tmp_path, name), albedo)


def test_gltf_colors_are_linear_and_multiply_each_other(tmp_path: Path) -> None:
    write_picture(tmp_path / "wood.png")
    factor = (0.5, 0.25, 0.002)
    base = {"pbrMetallicRoughness": {"baseColorFactor": [*factor, 1.0]}}
    textured = {"pbrMetallicRoughness": {"baseColorFactor": [*factor, 1.0], "baseColorTexture": {"index": 0}}}
    half = np.array([[0.5, 1.0, 0.002, 1.0]], "<f4")
    bytes_ = np.array([[188, 64, 3, 255]], "u1")
    words = np.array([[40000, 20000, 500, 65535]], "<u2")
    of_bytes, of_words = (188 / 255, 64 / 255, 3 / 255), (40000 / 65535, 20000 / 65535, 500 / 65535)
    product = tuple(one * two for one, two in zip(factor, (0.5, 1.0, 0.002), strict=True))
    files: list[tuple[dict[str, Any], tuple[float, ...]]] = [
        ({}, WHITE),
        ({"material": {}}, WHITE),
        ({"material": base}, factor),
        ({"colors": half, "kind": FLOAT}, (0.5, 1.0, 0.002)),
        ({"colors": bytes_}, of_bytes),
        ({"colors": words, "kind": SHORT}, of_words),
        ({"colors": words, "kind": SHORT, "material": {}}, of_words),
        ({"colors": half, "kind": FLOAT, "material": base}, product),
        (
            {"material": textured, "image": "wood.png"},
            tuple(one * two for one, two in zip(factor, PAINTED, strict=True)),
        ),
    ]
    for number, (content, albedo) in enumerate(files):
        name = write_gltf(tmp_path / f"{number}.gltf", **content)
        assert_albedo(sheet_scene(tmp_path, name), albedo)


def named_in_vain(folder: Path) -> list[tuple[str, str]]:
    """Write mesh files that name what is not there, and return each with what must be said of it."""
    (folder / "m.mtl").write_text("newmtl wood\nmap_Kd lost.png\n")
    (folder / "bad.png").write_bytes(b"no picture")
    (folder / "b.mtl").write_text("newmtl wood\nmap_Kd bad.png\n")
    texture = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    uses: dict[str, Any] = {"coordinates": True, "material": "wood"}
    head, glossy = "comment TextureFile lost.png", "KHR_materials_pbrSpecularGlossiness"
    return [
        (write_obj(folder / "a.obj", head="mtllib m.mtl", **uses), "texture lost.png is missing"),
        (write_obj(folder / "b.obj", head="mtllib b.mtl", **uses), "texture bad.png cannot be read"),
        (write_obj(folder / "c.obj", head="mtllib lost.mtl", **uses), "material library lost.mtl is missing"),
        (write_ply(folder / "d.ply", (), (), coordinates=True, head=head), "texture lost.png is missing"),
        (write_gltf(folder / "e.gltf", material=texture, image="lost.png"), "texture lost.png is missing"),
        (write_gltf(folder / "f.gltf", material={"extensions": {glossy: {}}}), glossy),
    ]


def test_a_texture_that_is_named_and_missing_is_a_warning_that_names_it(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for mesh, told in named_in_vain(tmp_path):
        scene = sheet_scene(tmp_path, mesh)
        [line] = scene.warnings
        assert mesh in line
        assert told in line
        assert_albedo(scene, WHITE)
    capfd.readouterr()
    assert main(["explain", scene.source, "--repeat", "0", "--json"]) == 0
    printed = capfd.readouterr()
    assert printed.err == f"xfrustum: warning: {line}\n"
    rows = {row["name"]: row for row in json.loads(printed.out)["effects"]}
    assert rows["textures"]["reason"] == "no object has a texture"
