"""Input folders of cases for renderers, and the archive of all cases with truths.

The folder of a case has scene.obj (double precision, in the order of triangle numbers), scene.glb
for engines, cameras.json and scene.npz as written by `camera --for json`, and case.json, which
describes the required images.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from xfrustum.compare.judging.conformance import digest, is_frozen, restored, stored, trace
from xfrustum.reference import Reference
from xfrustum.reports.common.outputs import json_object, refused
from xfrustum.reports.exchange.cameras import write_cameras
from xfrustum.scenes import InputError, Scene, SceneObject
from xfrustum.scenes.appearance import sub_apertures
from xfrustum.scenes.conformance_suite import SUITE, Case, suite_digest
from xfrustum.scenes.disk import (
    TempPath,
    damage_refused,
    new_file,
    open_input,
    read_arrays,
    read_member,
    scratch_folder,
)
from xfrustum.scenes.files.exr import write_planes
from xfrustum.scenes.model.images import HogelImage
from xfrustum.scenes.representation import encoding_curve

#: description of an archive, and advice to the user, in error messages
MESSAGE = "archive of a conformance suite", "xfrustum conformance export makes one"
#: name of the archive in the folder of `--out`
ARCHIVE = f"conformance-{SUITE}.zip"
#: time of every file in an archive, so that equal suites have equal bytes: the paper's year
STORED_TIME = (1997, 1, 1, 0, 0, 0)


def accepted(case: Case) -> str:
    """Return the criterion by which pixels of a case are accepted, one sentence."""
    edge = "wherever no edge lies within rounding of the pixel's center"
    if case.colored:
        text = f"colors within the tolerance, {edge}"
    elif case.encoding == "object-id":
        text = f"the object, {edge}"
    else:
        text = (
            "the triangle, any of a tie, or a neighbor at an edge within rounding of the pixel's "
            f"center; of surfaces that {case.depth} {case.mapping} stores as one depth, either"
        )
    return f"{text}; else at most {100 * case.wrong:g} % of the pixels" if case.wrong else text


def described(case: Case, scene: Scene) -> dict[str, Any]:
    """Return case.json: required images, scene, materials and lights."""
    # Write the film of each aperture, so that renderers need not derive it.
    reference = Reference(scene)
    first = np.cumsum([0, *(len(part.faces) for part in scene.objects)]).tolist()
    apertures = []
    for aperture in case.apertures(scene):
        camera = reference.camera(aperture)
        points = sub_apertures(scene.plate, aperture, scene.sampling.aperture)
        apertures.append(
            {
                "hogel": aperture.index,
                "center": (aperture.x, aperture.y, 0.0),
                "shear": camera.shear,
                "half_extent": camera.half_extent,
                "sub_apertures": [(p.x, p.y) for p in points] if len(points) > 1 else [],
            }
        )
    objects = [
        {
            "name": part.name,
            "first_triangle": first[number],
            "triangles": len(part.faces),
            "smooth": part.vertex_normals is not None,
            "textured": bool(part.textures),
            "colored": part.vertex_colors is not None,
            "material": scene.appearance.material(part.material),
        }
        for number, part in enumerate(scene.objects)
    ]
    environment = scene.appearance.environment
    return json_object(
        {
            "suite": SUITE,
            "name": case.name,
            "level": case.level,
            "why": case.why,
            "asked": case.encoding,
            "accepted": accepted(case),
            "hogels": case.hogels,
            "resolution": scene.frustum.resolution,
            "near": case.near,
            "depth": case.depth,
            "mapping": case.mapping,
            "reach": scene.frustum.reach,
            "plate": scene.plate,
            "fov": scene.frustum.fov,
            "screen": scene.frustum.screen,
            "apertures": apertures,
            "objects": objects,
            "lights": scene.appearance.lights,
            "environment": environment
            and {"file": "environment.exr", "strength": environment.strength},
        }
    )


def write_case(case: Case, scene: Scene, folder: Path) -> None:
    """Write the folder of a case for a renderer."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "case.json").write_text(
        json.dumps(described(case, scene), indent=1) + "\n", encoding="utf-8"
    )
    write_cameras(scene, "json", folder, case.settings(scene), case.apertures(scene))
    textures = {
        f"texture_{number}_{place}": pixels
        for number, part in enumerate(scene.objects)
        for place, pixels in enumerate(part.textures)
    }
    text = _wavefront(scene)
    if textures:
        # The file of materials names only textures; the other properties are in case.json.
        materials = "\n".join(f"newmtl {name}\nmap_Kd {name}.png\n" for name in textures)
        (folder / "scene.mtl").write_text(materials, encoding="utf-8")
        text = f"mtllib scene.mtl\n{text}"
    (folder / "scene.obj").write_text(text, encoding="utf-8")
    for name, pixels in textures.items():
        Image.fromarray(pixels).save(folder / f"{name}.png")
    if scene.objects:
        (folder / "scene.glb").write_bytes(_binary_gltf(scene))
    if scene.appearance.environment is not None:
        radiance = scene.appearance.environment.radiance
        planes = {name: radiance[..., place] for place, name in enumerate("RGB")}
        write_planes(folder / "environment.exr", planes)


def _wavefront(scene: Scene) -> str:
    """Return scene.obj without the line that names the file of materials.

    If any vertex of an object has a texture coordinate or a normal, all vertices have one, so that
    a corner has the same number in the lists of positions, texture coordinates and normals. Corners
    without a value do not refer to the list.
    """
    lines = list[str]()
    first, first_uv, first_normal = 1, 1, 1
    for number, part in enumerate(scene.objects):
        lines.append(f"o object_{number}")
        places = [f"v {x!r} {y!r} {z!r}" for x, y, z in part.vertices.tolist()]
        # Colors are in sRGB, as in all files but glTF.
        if part.vertex_colors is not None:
            colors = encoding_curve(part.vertex_colors).tolist()
            places = [
                f"{v} {r:.9g} {g:.9g} {b:.9g}" for v, (r, g, b) in zip(places, colors, strict=True)
            ]
        lines += places
        uv, normals = part.uv, part.vertex_normals
        if uv is not None:
            lines += [f"vt {u!r} {v!r}" for u, v in np.nan_to_num(uv).tolist()]
        flat = np.full(len(part.faces), normals is None)
        if normals is not None:
            lines += [f"vn {x!r} {y!r} {z!r}" for x, y, z in np.nan_to_num(normals).tolist()]
            flat |= np.asarray(np.isnan(normals[part.faces]).any(axis=(1, 2)))
        # `usemtl` applies to all faces up to the next `usemtl`.
        used = None
        for place, face in enumerate(part.faces.tolist()):
            if part.texture_of_triangle is not None and part.texture_of_triangle[place] != used:
                used = int(part.texture_of_triangle[place])
                lines.append(f"usemtl texture_{number}_{used}" if used >= 0 else "usemtl plain")
            corners = []
            for vertex in face:
                t = f"{vertex + first_uv}" if uv is not None else ""
                n = f"/{vertex + first_normal}" if not flat[place] else ""
                corners.append(f"{vertex + first}" + (f"/{t}{n}" if t or n else ""))
            lines.append(f"f {' '.join(corners)}")
        first += len(part.vertices)
        first_uv += len(part.vertices) if uv is not None else 0
        first_normal += len(part.vertices) if normals is not None else 0
    return "\n".join(lines) + "\n"


def _binary_gltf(scene: Scene) -> bytes:
    """Return scene.glb, a mesh per object; coordinates are float32, colors have 8 bits."""
    import trimesh  # noqa: PLC0415 - takes long to load

    def mesh(part: SceneObject) -> Any:
        normals, colors = part.vertex_normals, part.vertex_colors
        # `process=False` keeps vertices and the order of triangles.
        made = trimesh.Trimesh(
            vertices=part.vertices,
            faces=part.faces,
            vertex_normals=None if normals is None else np.nan_to_num(normals),
            vertex_colors=None if colors is None else np.rint(255 * colors).astype(np.uint8),
            process=False,
        )
        if part.uv is not None and part.textures:
            picture = Image.fromarray(part.textures[0])
            made.visual = trimesh.visual.TextureVisuals(uv=np.nan_to_num(part.uv), image=picture)
        return made

    whole = trimesh.Scene()
    # Lengths beyond float32's range overflow here; scene.obj has them.
    with np.errstate(all="ignore"):
        for number, part in enumerate(scene.objects):
            name = f"object_{number}"
            whole.add_geometry(mesh(part), node_name=name, geom_name=name)
        content: bytes = whole.export(file_type="glb", include_normals=True)
    return content


#: function of a case and its scene that returns the truth of each hogel
Truths = Callable[[Case, Scene], list[HogelImage]]


def traced(case: Case, scene: Scene) -> list[HogelImage]:
    """Trace the truth of each hogel of a case; RuntimeError if it differs from the suite's."""
    reference = Reference(scene)
    truths = [trace(case, reference, aperture) for aperture in case.apertures(scene)]
    if not is_frozen(case, truths):
        raise RuntimeError(
            f"{case.name}: the truth has digest {digest(truths)}, and the suite {case.digest}: "
            "this program or a library of it makes another scene or another truth"
        )
    return truths


@dataclass(frozen=True, kw_only=True)
class Archive:
    """Archive of cases and truths; InputError if it belongs to another suite."""

    path: Path

    def __post_init__(self) -> None:
        _open_archive(self.path)

    def __call__(self, case: Case, scene: Scene) -> list[HogelImage]:
        """Return the truth of each hogel of a case; InputError if the archive has other truths."""
        reference, truths, archive = Reference(scene), [], _open_archive(self.path)
        try:
            for number, aperture in enumerate(case.apertures(scene)):
                name = f"truths/{case.name}/{number}.npz"
                with damage_refused(self.path, *MESSAGE):
                    content = read_member(archive, name, self.path)
                arrays = read_arrays(self.path, *MESSAGE, content)
                truths.append(restored(scene, reference.camera(aperture), arrays))
        except (ValueError, KeyError, IndexError, TypeError) as error:
            raise InputError(
                f"{self.path}: {case.name} in it is damaged ({error}); export it again"
            ) from error
        if not is_frozen(case, truths):
            raise InputError(
                f"{self.path}: has another truth of {case.name} than suite {SUITE}; export it again"
            )
        return truths


@cache
def _open_archive(path: Path) -> zipfile.ZipFile:
    file = open_input(path, *MESSAGE)
    with damage_refused(path, *MESSAGE):
        archive = zipfile.ZipFile(file)
        stated = dict(json.loads(read_member(archive, "suite.json", path)))
    if stated.get("digest") != suite_digest():
        raise InputError(
            f"{path}: is of suite {stated.get('suite')}, and not of this {SUITE}; export it again"
        )
    return archive


def export(cases: Sequence[Case], out: Path, done: Callable[[], object] = lambda: None) -> Path:
    """Write an archive of cases into a folder and return its path; call `done` after each case."""
    with refused(f"--out {out}: cannot write there"):
        out.mkdir(parents=True, exist_ok=True)
        path = out / ARCHIVE
        with new_file(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:

            def add(name: str, content: bytes) -> None:
                entry = zipfile.ZipInfo(name, STORED_TIME)
                archive.writestr(entry, content, zipfile.ZIP_DEFLATED, 9)

            add("suite.json", json.dumps({"suite": SUITE, "digest": suite_digest()}).encode())
            for case in cases:
                # Entries are sorted and have equal dates, so that equal suites give equal archives.
                scene = case.open()
                with TempPath(scratch_folder(), folder=True) as folder:
                    write_case(case, scene, folder.path)
                    for file in sorted(folder.path.iterdir()):
                        add(f"cases/{case.name}/{file.name}", file.read_bytes())
                for number, truth in enumerate(traced(case, scene)):
                    buffer = io.BytesIO()
                    np.savez(buffer, **stored(truth))  # type: ignore[arg-type]  # names, no options
                    add(f"truths/{case.name}/{number}.npz", buffer.getvalue())
                done()
    return path
