"""3MF and 3DXML: each object where the file places it, once; formats that are refused by name."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import ArrayLike

from tests.scenes.meshes.soups import CORNERS, FACES, SOUP, assert_reads, written
from tests.support.packages import mesh_xml, threedxml, threemf, zipped
from xfrustum.scenes import InputError
from xfrustum.scenes.meshes.mesh_file import load_mesh

MESH = mesh_xml(CORNERS.tolist(), FACES)
OTHER = CORNERS * [1, 1, -1] + [0, 0, 20]
OBJECT = f'<resources><object id="1">{MESH}</object></resources>'
ITEM = '<build><item objectid="1"/></build>'
TURN = "0 1 0 -1 0 0 0 0 1 5 6 7"  #: a quarter turn about z, x to y, then a shift
MIRROR = "-1 0 0 0 1 0 0 0 2 0 0 0"
TURNED = SOUP @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [5, 6, 7]
MIRRORED = (SOUP * [-1, 1, 2])[:, ::-1]


def group(number: int, *components: str) -> str:
    """Return an object of components."""
    parts = "".join(f"<component {component}/>" for component in components)
    return f'<object id="{number}"><components>{parts}</components></object>'


def model(resources: str, *items: str) -> str:
    """Return the content of a model part."""
    build = "".join(f"<item {item}/>" for item in items)
    return f"<resources>{resources}</resources><build>{build}</build>"


ONE = f'<object id="1">{MESH}</object>'
OTHER_PARTS = {
    "3D/a.model": f"<resources>{ONE}</resources>",
    "3D/b.model": (
        f'<resources><object id="1">{mesh_xml(OTHER.tolist(), FACES)}</object></resources>'
    ),
}  # fmt: skip
TWO_PARTS = ('objectid="1" p:path="/3D/a.model"', 'objectid="1" p:path="/3D/b.model"')
PLACED: dict[str, tuple[bytes, Iterable[ArrayLike]]] = {
    "built twice, turned": (
        threemf(model(ONE, f'objectid="1" transform="{TURN}"', 'objectid="1"')),
        [*TURNED, *SOUP],
    ),
    "mirrored": (threemf(model(ONE, f'objectid="1" transform="{MIRROR}"')), MIRRORED),
    "mirrored twice": (
        threemf(
            model(
                ONE + group(2, f'objectid="1" transform="{MIRROR}"'),
                f'objectid="2" transform="{MIRROR}"',
            )
        ),
        SOUP * [1, 1, 4],
    ),
    "not built": (threemf(model(ONE + group(2, 'objectid="1"'), 'objectid="1"')), SOUP),
    "one number in two parts": (
        threemf(model(group(7, *TWO_PARTS), 'objectid="7"'), OTHER_PARTS, 'requiredextensions="p"'),
        [*SOUP, *OTHER[np.array(FACES)]],
    ),
}


@pytest.mark.parametrize("name", PLACED)
def test_objects_of_3mf_are_where_the_file_places_them(name: str, tmp_path: Path) -> None:
    content, triangles = PLACED[name]
    assert_reads(written(tmp_path, "a.3mf", content), triangles)


def test_triangles_of_3mf_are_numbered_as_by_trimesh(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.3, (1, 2, 3))
    scene.add_geometry(trimesh.creation.box(), geom_name="box", transform=turn)
    ball = trimesh.creation.icosphere(subdivisions=1)
    scene.add_geometry(ball, transform=np.diag([2.0, 3, -1, 1]))
    scene.graph.update("again", matrix=turn @ turn, geometry="box")
    path = tmp_path / "a.3mf"
    scene.export(str(path))
    ours, mesh = load_mesh(path), trimesh.load_scene(str(path), process=False).to_mesh()
    np.testing.assert_allclose(ours.vertices[ours.faces], mesh.vertices[mesh.faces], atol=1e-14)


CHAIN = "".join(group(n, *[f'objectid="{n - 1}"'] * 10) for n in range(2, 12))


def damaged(package: bytes) -> bytes:
    """Return a package whose last part begins with a block that deflate does not have."""
    name = b"3D/3dmodel.model"
    start = package.rindex(name, 0, package.index(b"PK\1\2")) + len(name)
    return package[:start] + b"\xff" * 8 + package[start + 8 :]


REFUSED_3MF = {
    "requires the extension http://x/y, which is not read": threemf(
        OBJECT + ITEM, attributes='requiredextensions="q" xmlns:q="http://x/y"'
    ),
    r"object 1 of 3D/3dmodel.model is made of 'beamlattice'": threemf(
        OBJECT.replace("</mesh>", '<b:beamlattice xmlns:b="x"/></mesh>') + ITEM
    ),
    "object 2 of .* is not there": threemf(OBJECT + ITEM.replace("1", "2")),
    "has no part 3D/x.model": threemf(model(ONE, 'objectid="1" p:path="/3D/x.model"')),
    "in a circle": threemf(model(group(1, 'objectid="1"'), 'objectid="1"')),
    "placing its objects, .* GiB": threemf(model(ONE + CHAIN, 'objectid="11"')),
    "numbers that are damaged": threemf(OBJECT.replace('x="4.0"', 'x="one"') + ITEM),
    "numbers that .* damaged": threemf(OBJECT.replace('x="4.0"', "") + ITEM),
    "corners of triangles that are no whole numbers": threemf(
        OBJECT.replace('v3="3"', 'v3="1.7"') + ITEM
    ),
    "12 numbers": threemf(model(ONE, 'objectid="1" transform="1 2 3"')),
    "faces point past the vertices": threemf(OBJECT.replace('v1="0"', 'v1="9"') + ITEM),
    "is no package with a part 3D/3dmodel.model that can be read": threemf("<resources>"),
    "is no package with a part .* that can be read": damaged(threemf(OBJECT + ITEM)),
    "is no package with a part _rels/.rels that can be read .*foo-8": zipped(
        {"_rels/.rels": '<?xml version="1.0" encoding="foo-8"?><a/>'}
    ),
    "no triangles": threemf(OBJECT),
}

FACE, STRIP = '<Face triangles="0 1 2"/>', '<Face strips="0 1 2 3,0 1 4" fans="0 1 2 3"/>'
FACES_3DXML = f"<Faces>{FACE}</Faces>"
REFUSED_3DXML = {
    "hides some": threedxml(FACES_3DXML, more='<GeneralAttributes visible="false"/>'),
    "faces point past the vertices": threedxml('<Faces><Face triangles="0 1 5"/></Faces>'),
    "numbers that are damaged": threedxml('<Faces><Face triangles="0 1"/></Faces>'),
    "PolygonalLOD whose accuracy is no number": threedxml('<PolygonalLOD accuracy=""/>'),
    "RelativeMatrix needs 12 numbers": threedxml(FACES_3DXML, ("1 0 0",)),
    "3dxml": threedxml(FACES_3DXML).replace(b"a.3dxml", b"c.3dxml", 1),
}
REFUSED_BY_NAME = {
    "is COLLADA, which is not read; export the mesh as glTF": "a.dae",
    "is packed; unpack it first": "a.zip",
    "is of a format that is not read": "a.xaml",
    "is a CAD drawing": "a.dxf",
    "is a point cloud; give it a mesh with faces": "a.xyz",
    "use one of 3dxml, 3mf, glb, gltf, obj, off, ply, stl": "a.foo",
}
REFUSED = [
    *[("a.3mf", content, reason) for reason, content in REFUSED_3MF.items()],
    *[("a.3dxml", content, reason) for reason, content in REFUSED_3DXML.items()],
    *[(name, b"x", reason) for reason, name in REFUSED_BY_NAME.items()],
]


@pytest.mark.parametrize(("name", "content", "reason"), REFUSED, ids=[r for *_, r in REFUSED])
def test_packages_that_would_be_misread_are_refused(
    name: str, content: bytes, reason: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=reason):
        load_mesh(written(tmp_path, name, content))


def test_units_and_colors_of_3mf_are_listed(tmp_path: Path) -> None:
    colored = OBJECT.replace('id="1"', 'id="1" pid="5"')
    mesh = load_mesh(written(tmp_path, "a.3mf", threemf(colored + ITEM, attributes='unit="inch"')))
    assert [feature.feature for feature in mesh.unread] == ["unit inch", "materials and colors"]


COARSE = '<PolygonalLOD accuracy="{}"><Faces>{}</Faces></PolygonalLOD>'


@pytest.mark.parametrize(
    ("content", "plain"),
    [
        (f"<Faces>{FACE}</Faces><Faces>{STRIP}</Faces>", True),
        (f"<Faces>{FACE}{STRIP}</Faces>", True),
        (COARSE.format("5", '<Face triangles="0 1 3"/>') + f"<Faces>{FACE}{STRIP}</Faces>", True),
        (COARSE.format("5", FACE) + COARSE.format("0.1", FACE + STRIP), False),
    ],
)
def test_each_face_of_3dxml_is_read_once_and_the_finest_level_alone(
    content: str, plain: bool, tmp_path: Path
) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1.0]])  # of `threedxml`
    faces = [[0, 1, 2], [0, 1, 2], [1, 3, 2], [0, 1, 4], [0, 1, 2], [0, 2, 3]]
    turned = points @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [5, 6, 7]
    path = written(tmp_path, "a.3dxml", threedxml(content, ("1 0 0 0 1 0 0 0 1 0 0 0", TURN)))
    triangles = [*points[faces], *turned[faces]]
    if plain:
        assert_reads(path, triangles)
    mesh = load_mesh(path)
    assert sorted(mesh.vertices[mesh.faces].sum(axis=(1, 2))) == sorted(
        triangle.sum() for triangle in triangles
    )
