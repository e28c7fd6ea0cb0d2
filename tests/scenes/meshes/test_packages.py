"""3MF and 3DXML: each object where the file says, once; and formats that are refused by name."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.scenes.meshes.soups import INPUTS, soup, written
from tests.support.packages import mesh_xml, threedxml, threemf, zipped
from xfrustum.scenes import InputError
from xfrustum.scenes.meshes.mesh_file import load_mesh

SQUARE = mesh_xml([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
TOP = mesh_xml([(0, 0, 0), (1, 0, 0), (0, 0, 1)], [(0, 1, 2)])


def test_numbers_of_objects_belong_to_their_part(tmp_path: Path) -> None:
    parts = {
        f"3D/{name}.model": f'<resources><object id="1">{mesh}</object></resources>'
        for name, mesh in (("a", SQUARE), ("b", TOP))
    }
    components = (
        '<component objectid="1" p:path="/3D/a.model"/>'
        '<component objectid="1" p:path="/3D/b.model" transform="1 0 0 0 1 0 0 0 1 5 0 0"/>'
    )
    model = f'<resources><object id="7"><components>{components}</components></object></resources>'
    model += '<build><item objectid="7"/></build>'
    found = soup(written(tmp_path, "a.3mf", threemf(model, parts, 'requiredextensions="p"')))
    plain = (
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 5 0 0\nv 6 0 0\nv 5 0 1\nf 1 2 3\nf 1 3 4\nf 5 6 7\n"
    )
    np.testing.assert_array_equal(found, soup(written(tmp_path, "a.obj", plain)))


def test_triangles_of_3mf_are_numbered_as_by_trimesh(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.3, (1, 2, 3))
    scene.add_geometry(trimesh.creation.box(), geom_name="box", transform=turn)
    scene.add_geometry(
        trimesh.creation.icosphere(subdivisions=1), transform=np.diag([2.0, 3, -1, 1])
    )
    scene.graph.update("again", matrix=turn @ turn, geometry="box")
    scene.export(str(tmp_path / "a.3mf"))
    ours, theirs = (
        load_mesh(tmp_path / "a.3mf"),
        trimesh.load_scene(str(tmp_path / "a.3mf"), process=False),
    )
    mesh = theirs.to_mesh()
    np.testing.assert_allclose(ours.vertices[ours.faces], mesh.vertices[mesh.faces], atol=1e-14)


OBJECT = f'<resources><object id="1">{SQUARE}</object></resources>'
ITEM = '<build><item objectid="1"/></build>'
TEN = '<component objectid="{}"/>' * 10
CHAIN = "".join(
    f'<object id="{n}"><components>{TEN.replace("{}", str(n - 1))}</components></object>'
    for n in range(2, 12)
)


def damaged(package: bytes) -> bytes:
    """Return a package whose last part begins with a block that deflate does not have."""
    start = package.rindex(b"3D/3dmodel.model", 0, package.index(b"PK\1\2")) + len(
        "3D/3dmodel.model"
    )
    return package[:start] + b"\xff" * 8 + package[start + 8 :]


REFUSED = {
    "unknown extension": (
        threemf(OBJECT + ITEM, attributes='requiredextensions="q" xmlns:q="http://x/y"'),
        r"requires the extension http://x/y, which is not read",
    ),
    "beam lattice": (
        threemf(OBJECT.replace("</mesh>", '<b:beamlattice xmlns:b="x"/></mesh>') + ITEM),
        r"object 1 of 3D/3dmodel.model is made of 'beamlattice'",
    ),
    "a missing object": (
        threemf(OBJECT + '<build><item objectid="2"/></build>'),
        "object 2 of .* is not there",
    ),
    "a missing part": (
        threemf(OBJECT + '<build><item objectid="1" p:path="/3D/x.model"/></build>'),
        "has no part 3D/x.model",
    ),
    "a circle": (
        threemf(
            '<resources><object id="1"><components><component objectid="1"/></components></object>'
            f"</resources>{ITEM}"
        ),
        "in a circle",
    ),
    "ten billion instances": (
        threemf(
            f'<resources><object id="1">{SQUARE}</object>{CHAIN}</resources>'
            '<build><item objectid="11"/></build>'
        ),
        "placing its objects, .* GiB",
    ),
    "a broken number": (
        threemf(OBJECT.replace('x="1"', 'x="one"') + ITEM),
        "numbers that are damaged",
    ),
    "a missing coordinate": (
        threemf(OBJECT.replace('x="1"', "") + ITEM),
        "numbers that are damaged",
    ),
    "a corner that is no whole number": (
        threemf(OBJECT.replace('v3="2"', 'v3="1.7"') + ITEM),
        "has corners of triangles that are no whole numbers",
    ),
    "a broken transform": (
        threemf(OBJECT + '<build><item objectid="1" transform="1 2 3"/></build>'),
        "12 numbers",
    ),
    "past the vertices": (
        threemf(OBJECT.replace('v1="0"', 'v1="9"') + ITEM),
        "faces point past the vertices",
    ),
    "broken XML": (
        threemf("<resources>"),
        "is no package with a part 3D/3dmodel.model that can be read",
    ),
    "a damaged stream": (
        damaged(threemf(OBJECT + ITEM)),
        "is no package with a part .* that can be read",
    ),
    "an unknown encoding": (
        zipped({"_rels/.rels": '<?xml version="1.0" encoding="foo-8"?><a/>'}),
        "is no package with a part _rels/.rels that can be read .*foo-8",
    ),
    "nothing built": (threemf(OBJECT), "no triangles"),
}


@pytest.mark.parametrize(("content", "told"), REFUSED.values(), ids=REFUSED)
def test_3mf_that_cannot_be_read_right_is_refused(
    content: bytes, told: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=told):
        load_mesh(written(tmp_path, "a.3mf", content))


@pytest.mark.skipif(not INPUTS.is_dir(), reason="no folder of test data beside the checkout")
def test_the_shared_3mf_with_a_required_extension_is_refused() -> None:
    with pytest.raises(InputError, match="requires the extension http://x/y"):
        load_mesh(INPUTS / "hostile" / "3mf-required-extension.3mf")


def test_units_and_colors_of_3mf_are_listed(tmp_path: Path) -> None:
    colored = OBJECT.replace('id="1"', 'id="1" pid="5"')
    mesh = load_mesh(written(tmp_path, "a.3mf", threemf(colored + ITEM, attributes='unit="inch"')))
    assert [one.feature for one in mesh.unread] == ["unit inch", "materials and colors"]


FACE, STRIP = '<Face triangles="0 1 2"/>', '<Face strips="0 1 2 3,0 1 4" fans="0 1 2 3"/>'
PLACES = ("1 0 0 0 1 0 0 0 1 0 0 0", "0 1 0 -1 0 0 0 0 1 5 6 7")


def test_each_face_of_3dxml_is_read_once_and_the_finest_level_alone(tmp_path: Path) -> None:
    plain = soup(
        written(
            tmp_path, "a.3dxml", threedxml(f"<Faces>{FACE}</Faces><Faces>{STRIP}</Faces>", PLACES)
        )
    )
    assert len(plain) == 2 * 6
    coarse = '<PolygonalLOD accuracy="{}"><Faces>{}</Faces></PolygonalLOD>'
    for content in (
        f"<Faces>{FACE}{STRIP}</Faces>",
        coarse.format("5", '<Face triangles="0 1 3"/>') + f"<Faces>{FACE}{STRIP}</Faces>",
        coarse.format("5", '<Face triangles="0 1 3"/>') + coarse.format("0.1", FACE + STRIP),
    ):
        np.testing.assert_array_equal(
            soup(written(tmp_path, "b.3dxml", threedxml(content, PLACES))), plain
        )


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (
            threedxml(f"<Faces>{FACE}</Faces>", more='<GeneralAttributes visible="false"/>'),
            "hides some",
        ),
        (threedxml('<Faces><Face triangles="0 1 5"/></Faces>'), "faces point past the vertices"),
        (threedxml('<Faces><Face triangles="0 1"/></Faces>'), "numbers that are damaged"),
        (threedxml('<PolygonalLOD accuracy=""/>'), "PolygonalLOD whose accuracy is no number"),
        (threedxml(f"<Faces>{FACE}</Faces>", ("1 0 0",)), "RelativeMatrix needs 12 numbers"),
        (threedxml(f"<Faces>{FACE}</Faces>").replace(b"a.3dxml", b"c.3dxml", 1), "3dxml"),
    ],
)
def test_3dxml_that_cannot_be_read_right_is_refused(
    content: bytes, told: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=told):
        load_mesh(written(tmp_path, "a.3dxml", content))


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("a.dae", "is COLLADA, which is not read; export the mesh as glTF"),
        ("a.zip", "is packed; unpack it first"),
        ("a.xaml", "is of a format that is not read"),
        ("a.dxf", "is a CAD drawing"),
        ("a.xyz", "is a point cloud; give it a mesh with faces"),
        ("a.foo", "use one of 3dxml, 3mf, glb, gltf, obj, off, ply, stl"),
    ],
)
def test_formats_that_nobody_vouches_for_are_refused_by_name(
    name: str, told: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=told):
        load_mesh(written(tmp_path, name, "x"))
