"""Zip packages of meshes for tests: 3MF and 3DXML, written part by part."""

import io
import zipfile
from collections.abc import Mapping, Sequence

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
DASSAULT = (
    'xmlns="http://www.3ds.com/xsd/3DXML" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
)
_START = (
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Id="r" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel" '
    'Target="/3D/3dmodel.model"/></Relationships>'
)


def zipped(parts: Mapping[str, str]) -> bytes:
    """Return a reproducible zip archive of text files."""
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in parts.items():
            archive.writestr(zipfile.ZipInfo(name), text)
    return held.getvalue()


def threemf(model: str, parts: Mapping[str, str] | None = None, attributes: str = "") -> bytes:
    """Return a 3MF file with the content of its root model, and with other parts."""
    models = {"3D/3dmodel.model": model, **(parts or {})}
    spaces = f'xmlns="{CORE}" xmlns:p="{PRODUCTION}"'
    return zipped(
        {
            "_rels/.rels": _START,
            **{
                name: f"<model {spaces} {attributes}>{content}</model>"
                for name, content in models.items()
            },
        }
    )


def mesh_xml(vertices: Sequence[Sequence[float]], faces: Sequence[Sequence[int]]) -> str:
    """Return a mesh element of 3MF."""
    points = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in vertices)
    corners = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    return f"<mesh><vertices>{points}</vertices><triangles>{corners}</triangles></mesh>"


def threedxml(
    representation: str, matrices: Sequence[str] = ("1 0 0 0 1 0 0 0 1 0 0 0",), more: str = ""
) -> bytes:
    """Return a 3DXML file of two objects with five vertices, and of its representation."""
    instances = "".join(
        f'<Instance3D id="{number}" name="i"><IsAggregatedBy>1</IsAggregatedBy>'
        f"<IsInstanceOf>2</IsInstanceOf>"
        f"<RelativeMatrix>{matrix}</RelativeMatrix></Instance3D>"
        for number, matrix in enumerate(matrices, 20)
    )
    structure = (
        f'<ProductStructure root="1"><Reference3D id="1" name="r"/><Reference3D id="2" name="p"/>'
        f"{instances}"
        '<ReferenceRep id="3" name="g" format="TESSELLATED" associatedFile="urn:3DXML:b.3DRep"/>'
        '<InstanceRep id="4" name="x"><IsAggregatedBy>2</IsAggregatedBy>'
        "<IsInstanceOf>3</IsInstanceOf>"
        "</InstanceRep></ProductStructure>"
    )
    buffer = "<VertexBuffer><Positions>0 0 0,1 0 0,1 1 0,0 1 0,0 0 1</Positions></VertexBuffer>"
    return zipped(
        {
            "Manifest.xml": f"<Manifest {DASSAULT}><Root>a.3dxml</Root></Manifest>",
            "a.3dxml": f"<Model_3dxml {DASSAULT}>{structure}{more}</Model_3dxml>",
            "b.3DRep": f"<X {DASSAULT}><Root><Rep>{representation}{buffer}</Rep></Root></X>",
        }
    )
