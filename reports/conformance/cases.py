"""What a renderer is handed for a case, and the archive of all cases with their truths.

A case is a folder: scene.obj in double precision and in the order of triangle numbers, scene.glb
for engines, cameras.json and scene.npz as `camera --for json` writes them, and case.json with all
that is asked.
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

from xfrustum.compare.judging.conformance import agrees, digest, restored, stored, trace
from xfrustum.reference import Reference
from xfrustum.reports.common.outputs import json_ready, refused
from xfrustum.reports.exchange.cameras import write_cameras
from xfrustum.scenes import InputError, Scene, SceneObject
from xfrustum.scenes.appearance.display import encoding_curve
from xfrustum.scenes.appearance.sampling import sub_apertures
from xfrustum.scenes.conformance.suite import SUITE, Case, suite_digest
from xfrustum.scenes.disk.archives import read_arrays, read_member
from xfrustum.scenes.disk.durable import TempPath, new_file, scratch_folder
from xfrustum.scenes.disk.input_files import damage_refused, open_input
from xfrustum.scenes.files.exr import write_planes
from xfrustum.scenes.model.hogel_image import HogelImage

DESCRIBED = "archive of a conformance suite", "xfrustum conformance export makes one"
"""Name of an archive in messages, and advice."""

ARCHIVE = f"conformance-{SUITE}.zip"  #: name of the archive in the folder that `--out` names

STORED_TIME = (1997, 1, 1, 0, 0, 0)
"""Time of every file in an archive, so that the same suite makes the same bytes: the year of the paper."""


def described(case: Case, scene: Scene) -> dict[str, Any]:
    """Return case.json: what is asked, of which scene, and how its surfaces are lit."""
    reference = Reference(scene)
    first = np.cumsum([0, *(len(one.faces) for one in scene.objects)]).tolist()
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
                "sub_apertures": [(one.x, one.y) for one in points] if len(points) > 1 else [],
            }
        )
    objects = [
        {
            "name": one.name,
            "first_triangle": first[number],
            "triangles": len(one.faces),
            "smooth": one.vertex_normals is not None,
            "textured": bool(one.textures),
            "colored": one.vertex_colors is not None,
            "material": scene.appearance.material(one.material),
        }
        for number, one in enumerate(scene.objects)
    ]
    environment = scene.appearance.environment
    found: dict[str, Any] = json_ready(
        {
            "suite": SUITE,
            "name": case.name,
            "level": case.level,
            "why": case.why,
            "asked": case.asked,
            "accepted": case.accepted,
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
    return found


def write_case(case: Case, scene: Scene, folder: Path) -> None:
    """Write the folder that a renderer is handed."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "case.json").write_text(
        json.dumps(described(case, scene), indent=1) + "\n", encoding="utf-8"
    )
    write_cameras(scene, "json", folder, case.settings(scene), case.apertures(scene))
    text, materials = _wavefront(scene)
    (folder / "scene.obj").write_text(text, encoding="utf-8")
    if materials:
        (folder / "scene.mtl").write_text(materials, encoding="utf-8")
    for name, pixels in _textures(scene):
        Image.fromarray(pixels).save(folder / name)
    if scene.objects:
        (folder / "scene.glb").write_bytes(_binary_gltf(scene))
    if scene.appearance.environment is not None:
        radiance = scene.appearance.environment.radiance
        planes = {name: radiance[..., place] for place, name in enumerate("RGB")}
        write_planes(folder / "environment.exr", planes)


def _textures(scene: Scene) -> list[tuple[str, Any]]:
    """Return name and pixels of each texture of a scene."""
    return [
        (f"texture_{number}_{place}.png", pixels)
        for number, part in enumerate(scene.objects)
        for place, pixels in enumerate(part.textures)
    ]


def _wavefront(scene: Scene) -> tuple[str, str]:
    """Return scene.obj and scene.mtl: the latter names textures alone, for materials are in case.json."""
    lines, materials, first = ["mtllib scene.mtl"], list[str](), 1
    for number, part in enumerate(scene.objects):
        lines.append(f"o object_{number}")
        places = [f"v {x!r} {y!r} {z!r}" for x, y, z in part.vertices.tolist()]
        if part.vertex_colors is not None:  # as in all files but glTF they are sRGB
            shown = encoding_curve(part.vertex_colors).tolist()
            places = [
                f"{v} {r:.9g} {g:.9g} {b:.9g}" for v, (r, g, b) in zip(places, shown, strict=True)
            ]
        lines += places
        uv, normals = part.uv, part.vertex_normals
        # One of each for every vertex, so that a corner has one number; what a vertex lacks is
        # never named.
        if uv is not None:
            lines += [f"vt {u!r} {v!r}" for u, v in np.nan_to_num(uv).tolist()]
        if normals is not None:
            lines += [f"vn {x!r} {y!r} {z!r}" for x, y, z in np.nan_to_num(normals).tolist()]
        flat = np.full(len(part.faces), normals is None)
        if normals is not None:
            flat |= np.asarray(np.isnan(normals[part.faces]).any(axis=(1, 2)))
        used = None
        before = scene.objects[:number]
        offset_uv = 1 + sum(len(one.vertices) for one in before if one.uv is not None)
        offset_normal = 1 + sum(
            len(one.vertices) for one in before if one.vertex_normals is not None
        )
        for place, face in enumerate(part.faces.tolist()):
            if part.texture_of_triangle is not None and part.texture_of_triangle[place] != used:
                used = int(part.texture_of_triangle[place])
                lines.append(f"usemtl texture_{number}_{used}" if used >= 0 else "usemtl plain")
            corners = []
            for vertex in face:
                t = f"{vertex + offset_uv}" if uv is not None else ""
                n = f"/{vertex + offset_normal}" if not flat[place] else ""
                corners.append(f"{vertex + first}" + (f"/{t}{n}" if t or n else ""))
            lines.append(f"f {' '.join(corners)}")
        first += len(part.vertices)
    for name, _ in _textures(scene):
        materials.append(f"newmtl {name.removesuffix('.png')}\nmap_Kd {name}\n")
    if not materials:
        lines = lines[1:]
    return "\n".join(lines) + "\n", "\n".join(materials)


def _binary_gltf(scene: Scene) -> bytes:
    """Return scene.glb, with a mesh for each object; coordinates are float32, colors have 8 bits."""
    import trimesh  # noqa: PLC0415 - takes long to load

    def mesh(part: SceneObject) -> Any:
        normals, colors = part.vertex_normals, part.vertex_colors
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
    with np.errstate(all="ignore"):  # lengths beyond float32's range: scene.obj has them all
        for number, part in enumerate(scene.objects):
            whole.add_geometry(
                mesh(part), node_name=f"object_{number}", geom_name=f"object_{number}"
            )
        found: bytes = whole.export(file_type="glb", include_normals=True)
    return found


# Truths: traced, or out of an archive

Truths = Callable[[Case, Scene], list[HogelImage]]
"""Gives the truth of each hogel of a case."""


def traced(case: Case, scene: Scene) -> list[HogelImage]:
    """Trace the truth of each hogel of a case, and compare it with the frozen one."""
    reference = Reference(scene)
    truths = [trace(case, reference, aperture) for aperture in case.apertures(scene)]
    if not agrees(case, truths):
        raise RuntimeError(
            f"{case.name}: the truth has digest {digest(truths)}, and the suite {case.digest}: this program "
            "or a library of it makes another scene or another truth"
        )
    return truths


@dataclass(frozen=True, kw_only=True)
class Archive:
    """A file that `conformance export` has written: cases as renderers are handed them, and their truths."""

    path: Path

    def __call__(self, case: Case, scene: Scene) -> list[HogelImage]:
        """Unpack the truth of each hogel of a case; InputError where the archive has another one."""
        reference, truths, archive = Reference(scene), [], _open_archive(self.path)
        try:
            for number, aperture in enumerate(case.apertures(scene)):
                name = f"truths/{case.name}/{number}.npz"
                with damage_refused(self.path, *DESCRIBED):
                    content = read_member(archive, name, self.path)
                arrays = read_arrays(self.path, *DESCRIBED, content)
                truths.append(restored(scene, reference.camera(aperture), arrays))
        except (ValueError, KeyError, IndexError, TypeError) as error:
            raise InputError(
                f"{self.path}: {case.name} in it is damaged ({error}); export it again"
            ) from error
        if not agrees(case, truths):
            raise InputError(
                f"{self.path}: has another truth of {case.name} than suite {SUITE}; export it again"
            )
        return truths


@cache
def _open_archive(path: Path) -> zipfile.ZipFile:
    file = open_input(path, *DESCRIBED)
    with damage_refused(path, *DESCRIBED):
        found = zipfile.ZipFile(file)
        told = dict(json.loads(read_member(found, "suite.json", path)))
    if told.get("digest") != suite_digest():
        raise InputError(
            f"{path}: is of suite {told.get('suite')}, and not of this {SUITE}; export it again"
        )
    return found


def open_archive(path: Path) -> Archive:
    """Return an archive; InputError where the file is none of this suite."""
    _open_archive(path)
    return Archive(path=path)


def export(
    cases: Sequence[Case], out: Path, told: Callable[[Case], object] = lambda case: None
) -> Path:
    """Write the archive of some cases into a folder, and return its path; `told` is called after each."""
    with refused(f"--out {out}: cannot write there"):
        out.mkdir(parents=True, exist_ok=True)
        path = out / ARCHIVE
        with new_file(path) as aside, zipfile.ZipFile(aside, "w") as archive:

            def add(name: str, content: bytes) -> None:
                entry = zipfile.ZipInfo(name, STORED_TIME)
                archive.writestr(entry, content, zipfile.ZIP_DEFLATED, 9)

            add("suite.json", json.dumps({"suite": SUITE, "digest": suite_digest()}).encode())
            for case in cases:
                scene = case.open()
                with TempPath(scratch_folder(), folder=True) as folder:
                    write_case(case, scene, folder.path)
                    for file in sorted(folder.path.iterdir()):
                        add(f"cases/{case.name}/{file.name}", file.read_bytes())
                for number, truth in enumerate(traced(case, scene)):
                    buffer = io.BytesIO()
                    np.savez(buffer, **stored(truth))  # type: ignore[arg-type]  # names are no options
                    add(f"truths/{case.name}/{number}.npz", buffer.getvalue())
                told(case)
    return path
