"""3MF (core specification 1.4, production extension 1.2) and 3DXML (version 4)."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import cast
from xml.etree import ElementTree

from tests.second_reader.model import Reading, Refused
from tests.second_reader.placement import Placement, identity, stated

Element = ElementTree.Element

CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
#: Extensions that may be required: production is read, materials and sets do not change geometry.
HARMLESS = {
    PRODUCTION,
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
}
MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
DEEPEST = 100


def _archive(path: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(path)
    except zipfile.BadZipFile as error:
        raise Refused(str(error)) from None


def _part(archive: zipfile.ZipFile, name: str) -> bytes:
    names = {one.lower(): one for one in archive.namelist()}  # part names ignore case (OPC 6.2.2.3)
    real = names.get(name.lstrip("/").lower())
    if real is None:
        raise Refused(f"part {name} is not there")
    return archive.read(real)


def _xml(data: bytes) -> Element:
    try:
        return ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        raise Refused(f"XML: {error}") from None


def read_3mf(path: Path) -> Reading:
    """Read what the build of a 3MF file places, in the file's own unit."""
    with _archive(path) as archive:
        package = Package(archive)
        build = package.model(package.root).find(f"{CORE}build")
        for item in [] if build is None else build.findall(f"{CORE}item"):
            place = item.get(f"{{{PRODUCTION}}}path", package.root)
            package.place(place, _attribute(item, "objectid"), _transform(item), 0)
        return package.reading


class Package:
    """Model parts of a 3MF file; an object's id belongs to its part."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self.archive, self.reading = archive, Reading()
        self.models: dict[str, Element] = {}
        relations = _xml(_part(archive, "_rels/.rels"))
        targets = [one.get("Target", "") for one in relations if one.get("Type") == MODEL]
        if len(targets) != 1:
            raise Refused(f"{len(targets)} root models")
        self.root = targets[0]

    def model(self, name: str) -> Element:
        """Parse a model part, or refuse it for an extension that it requires."""
        if name not in self.models:
            data = _part(self.archive, name)
            root = _xml(data)
            spaces = _namespaces(data)
            for prefix in root.get("requiredextensions", "").split():
                if spaces.get(prefix) not in HARMLESS:
                    raise Refused(f"required extension {prefix} = {spaces.get(prefix)}")
            self.models[name] = root
        return self.models[name]

    def place(self, part: str, name: str, placed: Placement, depth: int) -> None:
        """Add an object of a part: its mesh, or its components (4.1, 4.2)."""
        if depth > DEEPEST:
            raise Refused("components in a circle")
        found = [one for one in self.model(part).iter(f"{CORE}object") if one.get("id") == name]
        if len(found) != 1:
            raise Refused(f"{len(found)} objects {name} in {part}")
        mesh, components = found[0].find(f"{CORE}mesh"), found[0].find(f"{CORE}components")
        if mesh is not None:
            self.add(mesh, placed)
        for one in [] if components is None else components.findall(f"{CORE}component"):
            other = one.get(f"{{{PRODUCTION}}}path")
            if other is not None and part != self.root:
                raise Refused("a component outside the root model has a path")
            self.place(
                other or part, _attribute(one, "objectid"), placed @ _transform(one), depth + 1
            )

    def add(self, mesh: Element, placed: Placement) -> None:
        """Add triangles; a mirrored shape keeps the sign of its volume (3.3)."""
        vertices = []
        for one in mesh.iterfind(f"{CORE}vertices/{CORE}vertex"):
            point = _floats([_attribute(one, name) for name in "xyz"])
            vertices.append(placed.of(point, [abs(value) for value in point], 0.0))
        for one in mesh.iterfind(f"{CORE}triangles/{CORE}triangle"):
            corners = _integers(
                [_attribute(one, name) for name in ("v1", "v2", "v3")], len(vertices)
            )
            if placed.mirrors():
                corners = [corners[0], corners[2], corners[1]]
            self.reading.add(
                [vertices[k][0] for k in corners],
                max(bound for k in corners for bound in vertices[k][1]),
            )


def _namespaces(data: bytes) -> dict[str, str]:
    """Return the namespace of each prefix, which ElementTree forgets."""
    found: dict[str, str] = {}
    for _, pair in ElementTree.iterparse(io.BytesIO(data), events=("start-ns",)):
        prefix, uri = cast(tuple[str, str], pair)
        found[prefix] = uri
    return found


def _attribute(element: Element, name: str) -> str:
    value = element.get(name)
    if value is None:
        raise Refused(f"{element.tag} without {name}")
    return value


def _floats(words: Iterable[str]) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError as error:
        raise Refused(str(error)) from None


def _integers(words: Iterable[str], count: int) -> list[int]:
    values = [int(value) for value in _floats(words)]
    if not all(0 <= value < count for value in values):
        raise Refused(f"corner {max(values)} of {count} vertices")
    return values


def _columns(text: str) -> Placement:
    """Read the three columns of a matrix that multiplies columns, and the translation."""
    values = _floats(text.split())
    if len(values) != 12:
        raise Refused(f"a transform of {len(values)} numbers")
    return stated([*(values[k::3] for k in range(3)), [0.0, 0.0, 0.0, 1.0]])


def _transform(element: Element) -> Placement:
    """Read `m00 m01 m02 m10 .. m32`: points are rows, multiplied from the left (3.3)."""
    text = element.get("transform")
    if text is None:
        return stated(identity())
    return _columns(text)


def read_3dxml(path: Path) -> Reading:
    """Read the instances of a 3DXML product structure, each representation at its finest."""
    with _archive(path) as archive:
        manifest = _xml(_part(archive, "Manifest.xml"))
        names = [one.text for one in manifest.iter() if _name(one) == "Root"]
        if len(names) != 1 or not names[0]:
            raise Refused(f"{len(names)} roots in the manifest")
        return Structure(archive, _xml(_part(archive, names[0].strip()))).reading


def _name(element: Element) -> str:
    return element.tag.rsplit("}", 1)[-1]


def _text(element: Element, name: str) -> str | None:
    return next(((one.text or "").strip() for one in element if _name(one) == name), None)


class Structure:
    """References, their instances and representations."""

    def __init__(self, archive: zipfile.ZipFile, root: Element) -> None:
        self.archive, self.reading = archive, Reading()
        structures = [one for one in root.iter() if _name(one) == "ProductStructure"]
        if len(structures) != 1:
            raise Refused(f"{len(structures)} product structures")
        self.items = list(structures[0])
        names = [one.get("id") for one in self.items]
        if len(set(names)) < len(names):
            raise Refused("two items of one id")
        self.enter(structures[0].get("root", ""), stated(identity()), 0)

    def enter(self, reference: str, placed: Placement, depth: int) -> None:
        """Draw the representations of a reference and the references that it holds."""
        if depth > DEEPEST:
            raise Refused("instances in a circle")
        for one in self.items:
            if _text(one, "IsAggregatedBy") != reference:
                continue
            target = _text(one, "IsInstanceOf") or ""
            if _name(one) == "InstanceRep":
                self.representation(target, placed)
            elif _name(one) == "Instance3D":
                self.enter(target, placed @ _relative(_text(one, "RelativeMatrix")), depth + 1)

    def representation(self, name: str, placed: Placement) -> None:
        """Draw the file of a ReferenceRep."""
        for one in self.items:
            if _name(one) == "ReferenceRep" and one.get("id") == name:
                part = one.get("associatedFile", "").removeprefix("urn:3DXML:")
                root = _xml(_part(self.archive, part))
                for child in root:
                    if _name(child) == "Root":
                        self.rep(child, placed)

    def rep(self, element: Element, placed: Placement) -> None:
        """Draw a representation by its own Faces; those of PolygonalLOD are coarser."""
        vertices = next((one for one in element if _name(one) == "VertexBuffer"), None)
        for one in element:
            if _name(one) == "Rep":
                self.rep(one, placed)
            elif _name(one) == "Faces":
                if vertices is None:
                    raise Refused("faces without a vertex buffer")
                self.faces(one, vertices, placed)

    def faces(self, faces: Element, buffer: Element, placed: Placement) -> None:
        """Add the triangles, strips and fans of each Face once."""
        text = _text(buffer, "Positions") or ""
        points = [_floats(point.split()) for point in text.split(",") if point.strip()]
        vertices = [placed.of(point, [abs(value) for value in point], 0.0) for point in points]
        for face in faces:
            for a, b, c in _face(face, len(vertices)):
                corners = (a, c, b) if placed.mirrors() else (a, b, c)
                bound = max(bound for k in corners for bound in vertices[k][1])
                self.reading.add([vertices[k][0] for k in corners], bound)


def _face(face: Element, count: int) -> list[tuple[int, int, int]]:
    p = _integers(face.get("triangles", "").split(), count)
    found = [(p[i], p[i + 1], p[i + 2]) for i in range(0, len(p) - 2, 3)]
    for strip in face.get("strips", "").split(","):
        p = _integers(strip.split(), count)
        found += [(p[i], p[i + 1 + i % 2], p[i + 2 - i % 2]) for i in range(len(p) - 2)]
    for fan in face.get("fans", "").split(","):
        p = _integers(fan.split(), count)
        found += [(p[0], p[i + 1], p[i + 2]) for i in range(len(p) - 2)]
    return found


def _relative(text: str | None) -> Placement:
    """Read the three columns of the rotation and the translation."""
    if text is None:
        return stated(identity())
    return _columns(text)
