"""Small 3MF and 3DXML files for the neighbours of each known fault, with their shapes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tests.second_reader import making
from tests.second_reader.making import CORNERS, FACES, SOUP, Case, case, moved, scale, shift
from tests.second_reader.making import model_3mf as model
from tests.second_reader.making import object_3mf as mesh
from tests.second_reader.making import package_3mf as package
from tests.second_reader.making import transform_3mf as transform

MAIN = "3D/3dmodel.model"


def cases() -> list[Case]:
    """Return all cases."""
    return [*threemf(), *threemf_refusals(), *threedxml()]


def item(name: int, more: str = "") -> str:
    return f'<item objectid="{name}" {more}/>'


def component(name: int, more: str = "") -> str:
    return f'<component objectid="{name}" {more}/>'


def group(name: int, *components: str) -> str:
    return (
        f'<object id="{name}" type="model"><components>{"".join(components)}</components></object>'
    )


def placed(matrix: np.ndarray) -> str:
    return f'transform="{transform(matrix)}"'


def threemf() -> Iterator[Case]:
    yield case("one.3mf", package({MAIN: model(mesh(1), item(1))}))
    yield case(
        "root_elsewhere.3mf",
        package({"Other/part.model": model(mesh(1), item(1))}, "Other/part.model"),
    )
    yield case("not_built.3mf", package({MAIN: model(mesh(1) + mesh(2, CORNERS * 2), item(1))}))
    turned = shift(1, 2, 3) @ making.quarter_turn() @ scale(2, 1, 1)
    twice = model(mesh(1), item(1, placed(turned)) + item(1))
    yield case("built_twice.3mf", package({MAIN: twice}), [*moved(turned), *SOUP])
    yield case(
        "mirrored.3mf",
        package({MAIN: model(mesh(1), item(1, placed(scale(-1, 1, 2))))}),
        moved(scale(-1, 1, 2)),
    )
    inner, middle, outer = (
        scale(2, 1, 1),
        making.quarter_turn() @ shift(5, 0, 0),
        shift(0, 0, 7) @ scale(1, -1, 1),
    )
    deep = (
        mesh(1)
        + group(2, component(1), component(1, placed(inner)))
        + group(3, component(2, placed(middle)))
    )
    soup = [moved(outer @ middle), moved(outer @ middle @ inner)]
    yield case(
        "components.3mf", package({MAIN: model(deep, item(3, placed(outer)))}), np.concatenate(soup)
    )
    other = CORNERS * [1, 1, -1] + [0, 0, 20]
    parts = {
        MAIN: model(
            mesh(1), item(1) + item(1, 'p:path="/3D/other.model"'), 'requiredextensions="p"'
        ),
        "3D/other.model": model(mesh(1, other)),
    }
    yield case("one_id_in_two_parts.3mf", package(parts), [*SOUP, *other[FACES]])
    nested = {
        MAIN: model(
            group(
                2,
                component(5, f'p:path="/3D/a.model" {placed(inner)}'),
                component(5, 'p:path="/3D/b.model"'),
            ),
            item(2),
        ),
        "3D/a.model": model(mesh(1) + group(5, component(1, placed(middle)))),
        "3D/b.model": model(mesh(1, other) + group(5, component(1))),
    }
    yield case("components_in_parts.3mf", package(nested), [*moved(inner @ middle), *other[FACES]])
    space = 'xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02" requiredextensions="m"'
    yield case("materials_required.3mf", package({MAIN: model(mesh(1), item(1), space)}))


def threemf_refusals() -> Iterator[Case]:
    space = 'xmlns:b="http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02" requiredextensions="p b"'
    yield case("beams_required.3mf", package({MAIN: model(mesh(1), item(1), space)}), None)
    yield case("no_such_object.3mf", package({MAIN: model(mesh(1), item(2))}), None)
    yield case("corner.3mf", package({MAIN: model(mesh(1, CORNERS[:3]), item(1))}), None)
    yield case(
        "circle.3mf",
        package({MAIN: model(group(1, component(2)) + group(2, component(1)), item(1))}),
        None,
    )
    yield case("empty_build.3mf", package({MAIN: model(mesh(1))}), None)
    yield case(
        "no_such_part.3mf",
        package({MAIN: model(mesh(1), item(1, 'p:path="/3D/gone.model"'))}),
        None,
    )
    yield case(
        "transform.3mf",
        package({MAIN: model(mesh(1), item(1, 'transform="1 0 0 0 1 0 0 0 1"'))}),
        None,
    )
    yield case("no_archive.3mf", b"PK\3\4 and no more", None)


def threedxml() -> Iterator[Case]:
    def package_of(rep: str, matrix: str = "1 0 0 0 1 0 0 0 1 0 0 0", more: str = "") -> bytes:
        space = 'xmlns="http://www.3ds.com/xsd/3DXML" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
        structure = (
            f"<Model_3dxml {space}><Header><SchemaVersion>4.0</SchemaVersion></Header>"
            '<ProductStructure root="1"><Reference3D xsi:type="Reference3DType" id="1" name="top"/>'
            '<Reference3D xsi:type="Reference3DType" id="2" name="part"/>'
            '<ReferenceRep xsi:type="ReferenceRepType" id="3" name="rep" format="TESSELLATED" version="1.2" '
            'associatedFile="urn:3DXML:part.3DRep"/>'
            '<Instance3D xsi:type="Instance3DType" id="4" name="i"><IsAggregatedBy>1</IsAggregatedBy>'
            f"<IsInstanceOf>2</IsInstanceOf><RelativeMatrix>{matrix}</RelativeMatrix></Instance3D>"
            '<InstanceRep xsi:type="InstanceRepType" id="5" name="r"><IsAggregatedBy>2</IsAggregatedBy>'
            f"<IsInstanceOf>3</IsInstanceOf></InstanceRep>{more}</ProductStructure></Model_3dxml>"
        )
        bag = f'<Root xsi:type="BagRepType" id="1">{rep}</Root>'
        part = f'<XMLRepresentation version="1.2" {space}>{bag}</XMLRepresentation>'
        manifest = "<Manifest><Root>top.3dxml</Root></Manifest>"
        return making.archive(
            {"Manifest.xml": manifest, "top.3dxml": structure, "part.3DRep": part}
        )

    positions = ", ".join(f"{x:g} {y:g} {z:g}" for x, y, z in CORNERS.tolist())
    normals = ", ".join(["0 0 1"] * len(CORNERS))
    buffer = f"<VertexBuffer><Positions>{positions}</Positions><Normals>{normals}</Normals></VertexBuffer>"

    def rep(faces: str, before: str = "") -> str:
        start = '<Rep xsi:type="PolygonalRepType" id="2" accuracy="0.01" solid="1">'
        return f"{start}{before}<Faces>{faces}</Faces>{buffer}</Rep>"

    def words(faces: np.ndarray) -> str:
        return " ".join(map(str, faces.ravel().tolist()))

    whole = f'<Face triangles="{words(FACES)}"/>'
    yield case("one.3dxml", package_of(rep(whole)))
    two = f'<Face triangles="{words(FACES[:2])}"/><Face triangles="{words(FACES[2:])}"/>'
    yield case("two_faces.3dxml", package_of(rep(two)))
    coarse = '<PolygonalLOD accuracy="1"><Faces><Face triangles="0 1 2"/></Faces></PolygonalLOD>'
    yield case("levels.3dxml", package_of(rep(two, coarse)))
    mixed = '<Face strips="0 2 1 3" fans="3 0 1 2,0 1 2" triangles="1 2 3"/>'
    right = CORNERS[[[1, 2, 3], [0, 2, 1], [2, 3, 1], [3, 0, 1], [3, 1, 2], [0, 1, 2]]]
    yield case("strips_and_fans.3dxml", package_of(rep(mixed)), right)
    matrix = shift(1, 2, 3) @ making.quarter_turn()
    numbers = " ".join(f"{value:g}" for value in matrix[:3].T.ravel())
    yield case("placed.3dxml", package_of(rep(whole), numbers), moved(matrix))
    aside = (
        '<Reference3D xsi:type="Reference3DType" id="8" name="aside"/>'
        '<Instance3D xsi:type="Instance3DType" id="9" name="j"><IsAggregatedBy>8</IsAggregatedBy>'
        "<IsInstanceOf>2</IsInstanceOf><RelativeMatrix>1 0 0 0 1 0 0 0 1 50 0 0</RelativeMatrix></Instance3D>"
    )
    yield case("not_below_the_root.3dxml", package_of(rep(whole), more=aside))
