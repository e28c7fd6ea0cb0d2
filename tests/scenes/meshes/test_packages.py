"""3MF and 3DXML: each object once, in the place that the file states; formats refused by name."""

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
ONE = f'<object id="1">{MESH}</object>'
ITEM = 'objectid="1"'
TURN = "0 1 0 -1 0 0 0 0 1 5 6 7"  #: a quarter turn about z, x to y, then a translation
MIRROR = f'{ITEM} transform="-1 0 0 0 1 0 0 0 2 0 0 0"'
TURNED = SOUP @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [5, 6, 7]
MIRRORED = (SOUP * [-1, 1, 2])[:, ::-1]


def group(number: int, *components: str) -> str:
    """Return an object that consists of components."""
    parts = "".join(f"<component {component}/>" for component in components)
    return f'<object id="{number}"><components>{parts}</components></object>'


def model(resources: str, *items: str) -> str:
    """Return the content of a model part."""
    build = "".join(f"<item {item}/>" for item in items)
    return f"<resources>{resources}</resources><build>{build}</build>"


OTHER_PARTS = {
    "3D/a.model": model(ONE),
    "3D/b.model": model(ONE.replace(MESH, mesh_xml(OTHER.tolist(), FACES))),
}
TWO_PARTS = [f'{ITEM} p:path="{part}"' for part in OTHER_PARTS]
PLACED: dict[str, tuple[bytes, Iterable[ArrayLike]]] = {
    "built twice, turned": (
        threemf(model(ONE, f'{ITEM} transform="{TURN}"', ITEM)),
        [*TURNED, *SOUP],
    ),
    "mirrored": (threemf(model(ONE, MIRROR)), MIRRORED),
    "mirrored twice": (
        threemf(model(ONE + group(2, MIRROR), MIRROR.replace("1", "2", 1))),
        SOUP * [1, 1, 4],
    ),
    "not built": (threemf(model(ONE + group(2, ITEM), ITEM)), SOUP),
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
WHOLE = model(ONE, ITEM)
LATTICE = '<b:beamlattice xmlns:b="x"/></mesh>'
UNKNOWN = 'requiredextensions="q" xmlns:q="http://x/y"'


def damaged(package: bytes) -> bytes:
    """Return a package whose last part starts with an invalid deflate block."""
    name = b"3D/3dmodel.model"
    start = package.rindex(name, 0, package.index(b"PK\1\2")) + len(name)
    return package[:start] + b"\xff" * 8 + package[start + 8 :]


def edited(old: str, new: str) -> bytes:
    """Return the package of one object, with an edit of its model part."""
    return threemf(WHOLE.replace(old, new))


REFUSED_3MF = {
    "requires the extension http://x/y, which is not read": threemf(WHOLE, attributes=UNKNOWN),
    "object 1 of 3D/3dmodel.model is made of 'beamlattice'": edited("</mesh>", LATTICE),
    "object 2 of .* is not there": threemf(model(ONE, 'objectid="2"')),
    "has no part 3D/x.model": threemf(model(ONE, f'{ITEM} p:path="/3D/x.model"')),
    "in a circle": threemf(model(group(1, ITEM), ITEM)),
    "placing its objects, .* GiB": threemf(model(ONE + CHAIN, 'objectid="11"')),
    "numbers that are damaged": edited('x="4.0"', 'x="one"'),
    "numbers that .* damaged": edited('x="4.0"', ""),
    "corners of triangles that are no whole numbers": edited('v3="3"', 'v3="1.7"'),
    "12 numbers": threemf(model(ONE, f'{ITEM} transform="1 2 3"')),
    "faces point past the vertices .index 5, 4 vertices": threemf(
        model(ONE.replace('v1="0"', 'v1="5"') + ONE.replace('"1"', '"2"', 1), ITEM, 'objectid="2"')
    ),
    "is no package with a part 3D/3dmodel.model that can be read": threemf("<resources>"),
    "is no package with a part .* that can be read": damaged(threemf(WHOLE)),
    "is no package with a part _rels/.rels that can be read .*foo-8": zipped(
        {"_rels/.rels": '<?xml version="1.0" encoding="foo-8"?><a/>'}
    ),
    "no triangles": threemf(model(ONE)),
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
REFUSED = {
    **{reason: ("a.3mf", content) for reason, content in REFUSED_3MF.items()},
    **{reason: ("a.3dxml", content) for reason, content in REFUSED_3DXML.items()},
    **{reason: (name, b"x") for reason, name in REFUSED_BY_NAME.items()},
}


@pytest.mark.parametrize("reason", REFUSED)
def test_packages_that_would_be_misread_are_refused(reason: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=reason):
        load_mesh(written(tmp_path, *REFUSED[reason]))


def test_units_and_colors_of_3mf_are_listed(tmp_path: Path) -> None:
    colored = threemf(WHOLE.replace('id="1"', 'id="1" pid="5"', 1), attributes='unit="inch"')
    mesh = load_mesh(written(tmp_path, "a.3mf", colored))
    assert [feature.feature for feature in mesh.unread] == ["unit inch", "materials and colors"]


COARSE = '<PolygonalLOD accuracy="{}"><Faces>{}</Faces></PolygonalLOD>'


@pytest.mark.parametrize(
    ("content", "finest_is_own"),
    [
        (f"<Faces>{FACE}</Faces><Faces>{STRIP}</Faces>", True),
        (COARSE.format("5", '<Face triangles="0 1 3"/>') + f"<Faces>{FACE}{STRIP}</Faces>", True),
        (COARSE.format("5", FACE) + COARSE.format("0.1", FACE + STRIP), False),
    ],
)
def test_each_face_of_3dxml_is_read_once_and_the_finest_level_alone(
    content: str, finest_is_own: bool, tmp_path: Path
) -> None:
    """The second reader reads only the faces of the representation itself."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1.0]])  # of `threedxml`
    plain = points[[[0, 1, 2], [0, 1, 2], [1, 3, 2], [0, 1, 4], [0, 1, 2], [0, 2, 3]]]
    turned = plain @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [5, 6, 7]
    path = written(tmp_path, "a.3dxml", threedxml(content, ("1 0 0 0 1 0 0 0 1 0 0 0", TURN)))
    triangles = np.concatenate([plain, turned])
    if finest_is_own:
        assert_reads(path, triangles)
    mesh = load_mesh(path)
    sums = mesh.vertices[mesh.faces].sum(axis=(1, 2))
    assert sorted(sums) == sorted(triangles.sum(axis=(1, 2)))
