"""3MF (core specification 1.4, production extension 1.2) and 3DXML (version 4)."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from tests.second_reader.model import ROUNDING, Floats, Placement, Reading, Refused

NAMESPACE = "http://schemas.microsoft.com/3dmanufacturing/"
#: Extensions that may be required: production is supported; materials and sets keep geometry
HARMLESS = [
    NAMESPACE + name for name in ("production/2015/06", "material/2015/02", "trianglesets/2021/07")
]
DEEPEST = 100


def read_3mf(path: Path) -> Reading:
    """Read the build of a 3MF file, in the file's unit."""
    return _read(path, _read_3mf)


def read_3dxml(path: Path) -> Reading:
    """Read the instances of a 3DXML product structure, each representation at its finest level."""
    return _read(path, _read_3dxml)


class _Package:
    """Parts of an archive, and the reading so far."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self.archive, self.reading = archive, Reading()
        # Part names are case-insensitive (OPC 6.2.2.3).
        self.names = {name.lower(): name for name in archive.namelist()}
        self.spaces: dict[str, str] = {}  #: namespaces by prefix, for the latest part

    def xml(self, name: str) -> Element:
        data = self.archive.read(self.names[name.lstrip("/").lower()])
        events = ElementTree.iterparse(io.BytesIO(data), events=("start-ns",))
        self.spaces = dict(pair for _, pair in events)
        return ElementTree.fromstring(data)

    def add(self, points: Floats, faces: list[list[int]], place: Placement) -> None:
        """Add triangles; mirrored triangles keep their outside (3MF, 3.3)."""
        vertices, sizes = place.of(points, np.abs(points))
        if not place.exact and len(points):
            self.reading.rounding = max(self.reading.rounding, ROUNDING * float(sizes.max()))
        for a, b, c in faces:
            self.reading.add(vertices, [a, c, b] if place.mirrors else [a, b, c])


def _read(path: Path, reader: Callable[[_Package], None]) -> Reading:
    try:
        with zipfile.ZipFile(path) as archive:
            package = _Package(archive)
            reader(package)
            return package.reading
    except (
        zipfile.BadZipFile,
        LookupError,
        ValueError,
        TypeError,
        ElementTree.ParseError,
    ) as error:
        raise Refused(f"{type(error).__name__}: {error}") from error
    except RecursionError as error:
        raise Refused("objects in a circle") from error


def _numbers(text: str, columns: int) -> Floats:
    return np.array([float(word) for word in text.replace(",", " ").split()]).reshape(-1, columns)


def _transform(text: str | None) -> Placement:
    """Read three columns of a matrix that multiplies column vectors, and the translation."""
    if text is None:
        return Placement()
    rows = np.eye(4)
    rows[:3] = _numbers(text, 12).reshape(4, 3).T
    return Placement(rows)


def _read_3mf(package: _Package) -> None:
    relations = package.xml("_rels/.rels")
    [root] = [
        item.attrib["Target"] for item in relations if item.get("Type", "").endswith("/3dmodel")
    ]
    path = f"{{{HARMLESS[0]}}}path"

    def place(part: str, reference: Element, outer: Placement) -> None:
        """Add the object of a build item or component: its mesh, or its components (4.1, 4.2)."""
        other = reference.get(path)
        if other is not None and part != root and reference.tag.endswith("component"):
            raise Refused("a component outside the root model has a path")
        part, name = other or part, reference.attrib["objectid"]
        [item] = [it for it in model(part).iterfind(".//{*}object") if it.get("id") == name]
        inner = outer @ _transform(reference.get("transform"))
        if (mesh := item.find("{*}mesh")) is not None:
            points = [
                [float(v.attrib[axis]) for axis in "xyz"]
                for v in mesh.iterfind("{*}vertices/{*}vertex")
            ]
            faces = [
                [int(t.attrib[k]) for k in ("v1", "v2", "v3")]
                for t in mesh.iterfind("{*}triangles/{*}triangle")
            ]
            package.add(np.array(points).reshape(-1, 3), faces, inner)
        for component in item.iterfind("{*}components/{*}component"):
            place(part, component, inner)

    def model(part: str) -> Element:
        element = package.xml(part)
        for prefix in element.get("requiredextensions", "").split():
            if package.spaces.get(prefix) not in HARMLESS:
                raise Refused(f"required extension {prefix} = {package.spaces.get(prefix)}")
        return element

    for item in model(root).iterfind("{*}build/{*}item"):
        place(root, item, Placement())


def _read_3dxml(package: _Package) -> None:
    manifest = package.xml("Manifest.xml")
    root = package.xml((manifest.findtext("{*}Root") or "").strip())
    structure = root.find("{*}ProductStructure")
    if structure is None:
        raise Refused("no product structure")

    def enter(reference: str, outer: Placement, depth: int) -> None:
        """Draw the representations of a reference and of its child references."""
        if depth > DEEPEST:
            raise Refused("instances in a circle")
        for instance in structure:
            if instance.findtext("{*}IsAggregatedBy", "").strip() != reference:
                continue
            target = instance.findtext("{*}IsInstanceOf", "").strip()
            if instance.tag.endswith("InstanceRep"):
                [item] = [r for r in structure.iterfind("{*}ReferenceRep") if r.get("id") == target]
                part = item.attrib["associatedFile"].removeprefix("urn:3DXML:")
                for rep in package.xml(part).iterfind("{*}Root//{*}Rep"):
                    draw(rep, outer)
            else:
                enter(target, outer @ _transform(instance.findtext("{*}RelativeMatrix")), depth + 1)

    def draw(rep: Element, place: Placement) -> None:
        """Draw the Faces of a representation itself; the Faces of PolygonalLOD are coarser."""
        points = _numbers(rep.findtext("{*}VertexBuffer/{*}Positions", ""), 3)
        for face in rep.iterfind("{*}Faces/{*}Face"):
            p = [int(word) for word in face.get("triangles", "").split()]
            faces = [p[i : i + 3] for i in range(0, len(p), 3)]
            for strip in face.get("strips", "").split(","):
                p = [int(word) for word in strip.split()]
                faces += [[p[i], p[i + 1 + i % 2], p[i + 2 - i % 2]] for i in range(len(p) - 2)]
            for fan in face.get("fans", "").split(","):
                p = [int(word) for word in fan.split()]
                faces += [[p[0], p[i + 1], p[i + 2]] for i in range(len(p) - 2)]
            package.add(points, faces, place)

    enter(structure.get("root", ""), Placement(), 0)
