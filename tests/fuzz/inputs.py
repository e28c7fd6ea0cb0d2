"""Seeds of mutation: valid input files of every kind, and commands that read them.

Most inputs are only read, by commands of `entries`, because a verdict takes a hundred times as
long. `share` sets the relative number of inputs of a seed.
"""

import io
import json
import shlex
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path, PurePosixPath

import numpy as np
import trimesh
from PIL import Image

from tests.support.environment_maps import write_map
from tests.support.gltf_writer import TENT, Writer
from tests.support.packages import mesh_xml, threedxml, threemf
from tests.support.scene_file import film, named, part
from xfrustum.scenes.model.device_model import H100, SOFTPIPE

SCENE = named("small", "mm") + film((10.0, 8.0), (3, 2), (16, 12), (60.0, 50.0), (20.0, 20.0))

NAMES_FILE = "names.json"
"""List of the names of pictures in a folder `in`; the pictures are written, not the list."""

SHEARED = SCENE.replace(
    "fov_deg = [60.0, 50.0]",
    "screen = { height = -15.0, center = [0.0, 1.0], size = [20.0, 16.0] }",
)

SHAPE = part("sphere", 5.0, (0.0, 1.0, -4.0), rotate_deg=[0.0, 35.0, 0.0])

LIT = """
[[object]]
shape = "box"
transform = [[2.0, 0.0, 0.0, 1.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]]
material = "paint"
smooth = true
[material]
[material.paint]
ambient = 0.2
diffuse = [0.42, 0.05, 0.05]
specular = 0.35
exponent = 50.0
reflectivity = 0.16
[[light]]
direction = [-2.0, 3.0, 2.0]
color = [1.0, 0.9, 0.8]
[environment]
map = "map.exr"
strength = 0.5
[sampling]
supersample = 2
multisample = 1
aperture = 4
[transport]
shadows = false
samples = 4
"""


@dataclass(frozen=True)
class Seed:
    """A valid input: files, the file to mutate, and the command that reads them."""

    name: str  #: unique name of the seed; names of findings begin with it
    files: Mapping[str, bytes]  #: content by name, relative to the folder that the command runs in
    mutated: str  #: name of the mutated file; empty if the command line is mutated
    line: str  #: arguments of `xfrustum`, quoted as for a shell
    left: str = ""  #: outputs that may remain at exit status 0 or 1, separated by spaces
    share: int = 1  #: number of inputs relative to a seed of share 1
    how: str = "mutated"  #: name of the function of `mutations` that damages the file
    #: path pattern of the files that the mutated JSON list names, and content of each file
    listed: tuple[str, bytes] | None = None

    @property
    def command(self) -> tuple[str, ...]:
        """Arguments of `xfrustum`."""
        return tuple(shlex.split(self.line))

    @property
    def outputs(self) -> frozenset[str]:
        """Files and folders that the command may leave if it ends with 0 or 1."""
        return frozenset(self.left.split())


def with_payload(seed: Seed, payload: bytes) -> dict[str, bytes]:
    """Return the files of a seed, with another content of the mutated file."""
    if seed.listed is None:
        return packed({**seed.files, seed.mutated: payload})
    pattern, content = seed.listed
    others = {name: data for name, data in seed.files.items() if name != seed.mutated}
    return packed({**others, **{pattern.format(name): content for name in json.loads(payload)}})


def packed(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return files, with folders named .npz or .zip packed into archives.

    A damaged member thus lies in a valid archive with correct checksums.
    """
    result = dict(files)
    parents = {parent for name in files for parent in PurePosixPath(name).parents}
    folders = [parent for parent in parents if parent.suffix in (".npz", ".zip")]
    for folder in sorted(folders, key=lambda path: -len(path.parts)):
        held = io.BytesIO()
        with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in [name for name in result if PurePosixPath(name).is_relative_to(folder)]:
                inside = str(PurePosixPath(name).relative_to(folder))
                archive.writestr(zipfile.ZipInfo(inside), result.pop(name))
        result[str(folder)] = held.getvalue()
    return result


def _also(seeds: list[Seed], word: str, line: str, left: str = "", share: int = 1) -> list[Seed]:
    """Return copies of seeds with another command and `share` times as many inputs."""
    return [
        replace(seed, name=f"{seed.name}-{word}", line=line, left=left, share=share)
        for seed in seeds
    ]


def _of_scene(seeds: list[Seed]) -> list[Seed]:
    """Return seeds of scenes that are traced or checked, but mostly only read."""
    read = _also(seeds, "read", "read-scene scene.toml", share=8)
    return [*seeds, *read, *_also(seeds, "check", "check scene.toml")]


def _of_mesh(name: str, data: bytes, title: str = "", **more: bytes) -> Seed:
    """Return the seed of a mesh file; `more` are referenced files, with `_` for the dot."""
    scene = SCENE + f'\n[[object]]\nmesh = "{name}"\nscale = 4.0\ntranslate = [0.0, 0.0, -3.0]\n'
    files = {"scene.toml": scene.encode(), name: data}
    files |= {k.replace("_", "."): v for k, v in more.items()}
    return Seed(title or f"mesh-{name.replace('.', '-')}", files, name, _TRACE, "out.exr")


_TRACE = "trace scene.toml --out out.exr --quiet"
_CONVERT = "--to hogels --quiet --json"
_PLATE = "plate scene.toml --near 0.1 --ids --out p.zarr --quiet --json"
_SHAPE_SCENE = (SCENE + SHAPE).encode()


def scenes() -> list[Seed]:
    """Return scene files that contain every table."""
    texts = {"shape": SCENE + SHAPE, "lit": SCENE + LIT, "sheared": SHEARED + SHAPE + SHAPE}
    sky = _map("map.exr")
    seeds = []
    for name, text in texts.items():
        files = {"scene.toml": text.encode(), "map.exr": sky}
        seeds.append(Seed(f"scene-{name}", files, "scene.toml", _TRACE, "out.exr"))
    return _of_scene(seeds)


OBJ = b"""\
# a comment
mtllib a.mtl
o part
usemtl m
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
vt 0 0
vt 1 0
vt 0 1
vn 0 0 1
f 1/1/1 2/2/1 3/3/1
f 1/1 2/2 4/3
f 1//1 3//1 4//1
"""
STRIPS = '<Faces><Face strips="0 1 2 3" triangles="0 1 4"/></Faces>'
LIBRARY = b"newmtl m\nKd 0.5 0.5 0.5\nmap_Kd skin.png\n"


def meshes() -> list[Seed]:
    """Return a mesh of every supported format."""
    box = trimesh.creation.box()
    box.visual.vertex_colors = np.arange(32, dtype=np.uint8).reshape(8, 4)
    gltf = trimesh.exchange.gltf.export_gltf(trimesh.Scene(box), embed_buffers=True)
    wood = _of_mesh("a.obj", OBJ, a_mtl=LIBRARY, skin_png=_picture())
    return _of_scene(
        [
            wood,
            _of_mesh("a.ply", box.export(file_type="ply", encoding="ascii")),
            _of_mesh("a.stl", bytes(box.export(file_type="stl"))),
            _of_mesh("a.off", box.export(file_type="off").encode()),
            _of_mesh("a.gltf", gltf["model.gltf"]),
            _of_mesh("a.glb", bytes(box.export(file_type="glb"))),
            _of_mesh("a.3mf", _threemf()),
            _of_mesh("a.3dxml", threedxml(STRIPS)),
            _of_mesh("a.ply", bytes(box.export(file_type="ply")), "mesh-ply-binary"),
            _of_mesh("a.stl", box.export(file_type="stl_ascii").encode(), "mesh-stl-ascii"),
            replace(wood, name="mesh-mtl", mutated="a.mtl"),
            replace(wood, name="mesh-texture", mutated="skin.png"),
        ]
    )


def instances() -> list[Seed]:
    """Return glTF meshes that are placed by instances, joints and morph targets."""
    writer = Writer()
    targets = [{"POSITION": writer.array(TENT * np.float32(0.1))}]
    joints = writer.array(np.zeros((5, 4), "<u1"))
    weights = writer.array(np.tile(np.array([255, 0, 0, 0], "<u1"), (5, 1)), normalized=True)
    mesh = writer.tent(targets=targets, attributes={"JOINTS_0": joints, "WEIGHTS_0": weights})
    places = writer.array(np.arange(9, dtype="<f4").reshape(3, 3))
    node = writer.node(mesh=mesh, weights=[0.5], translation=[1, 0, 0])
    attributes = {"attributes": {"TRANSLATION": places, "SCALE": places}}
    writer.extend("nodes", node, "EXT_mesh_gpu_instancing", attributes)
    writer.node(mesh=mesh, skin=writer.add("skins", joints=[node]))
    with tempfile.TemporaryDirectory() as folder:
        paths = [writer.save(Path(folder) / name) for name in ("b.glb", "b.gltf")]
        return _of_scene([_of_mesh(path.name, path.read_bytes()) for path in paths])


PATCHES = """\
2
3 3
{corners}
1 2
{low}
"""


def patches() -> list[Seed]:
    """Return a file of two Bezier patches."""
    fine = [f"{x / 3:.3f} {y / 3:.3f} {0.2 * x * y / 9:.3f}" for x, y in np.ndindex(4, 4)]
    low = [f"{x:.1f} {y:.1f} 1.0" for x, y in np.ndindex(2, 3)]
    text = PATCHES.format(corners="\n".join(fine), low="\n".join(low))
    return _of_scene([_of_mesh("a.bpt", text.encode(), "patches-two")])


def images() -> list[Seed]:
    """Return hogel images as OpenEXR: a truth and a raster."""
    packed = {"truth.exr": _hogel("trace"), "raster.exr": _hogel("raster --near 0.1")}
    plain = {name: _unpacked(data) for name, data in packed.items()}
    line = "compare truth.exr raster.exr --json"
    return [
        Seed(f"exr-{how}-{name.split('.')[0]}", files, name, line)
        for how, files in (("packed", packed), ("plain", plain))
        for name in files
    ]


def environments() -> list[Seed]:
    """Return latitude-longitude maps, OpenEXR and Radiance HDR."""
    seeds = []
    for suffix in ("exr", "hdr"):
        name = f"map.{suffix}"
        files = {"scene.toml": (SCENE + LIT).replace("map.exr", name).encode(), name: _map(name)}
        seeds.append(Seed(f"environment-{suffix}", files, name, _TRACE, "out.exr"))
    return _of_scene(seeds)


def pictures() -> list[Seed]:
    """Return pictures of a foreign renderer; one of them is mutated."""
    line = "verify scene.toml {{i}}x{{j}}.{suffix} --apertures 1,1 --encoding triangle-id"
    line += " --junit out.xml --json --quiet"
    seeds = []
    for suffix in ("png", "bmp", "tif", "exr"):
        data = _hogel("trace") if suffix == "exr" else _picture((16, 12), suffix)
        name = f"1x1.{suffix}"
        files = {"scene.toml": _SHAPE_SCENE, name: data}
        seed = Seed(f"picture-{suffix}", files, name, line.format(suffix=suffix), "out.xml")
        seeds += [seed, *_also([seed], "read", f"read-picture scene.toml {name}", share=99)]
    return seeds


def attributes() -> list[Seed]:
    """Return hogel images; each has one damaged attribute."""
    files = {"scene.toml": _SHAPE_SCENE}
    files |= {"truth.exr": _hogel("trace"), "1x1.exr": _hogel("raster --near 0.1")}
    read = "read-picture scene.toml 1x1.exr"
    seed = Seed("exr-attributes-read", files, "1x1.exr", read, share=9, how="mutated_header")
    compare = "compare truth.exr 1x1.exr --json"
    return [seed, replace(seed, name="exr-attributes-compare", line=compare, share=1)]


_NAMES = {
    "hogels": [f"hogel_{i}x{j}.png" for i in range(3) for j in range(2)],
    "hocking": [f"hogel_{i:04}_0003_{j:04}_0002.png" for i in range(3) for j in range(2)],
    "columns": [f"Hogel_Column_{i}.png" for i in range(3)],
    "views": [f"{r}_{c}.png" for r in range(2) for c in range(3)],
    "stanford": [f"out_0{r}_0{c}_0.{r}_-0.{c}.png" for r in range(2) for c in range(3)],
    "quilt": ["a_qs4x2a1.5.png"],
}


def names() -> list[Seed]:
    """Return folders of pictures in several layouts; their file names are mutated."""
    line, listed = f"convert in out {_CONVERT}", ("in/{}", _picture((4, 4)))
    return [
        Seed(
            f"names-{layout}",
            {NAMES_FILE: json.dumps(names).encode()},
            NAMES_FILE,
            line,
            "out",
            how="mutated_names",
            listed=listed,
        )
        for layout, names in _NAMES.items()
    ]


def parts() -> list[Seed]:
    """Return parts of a survey; one part, or the description, is mutated."""
    line = "survey scene.toml --near 0.1 --all --workers 1 --out s --quiet"
    files = _made(line, {"scene.toml": _SHAPE_SCENE})
    inside = sorted(name for name in files if name.startswith("s/survey.parquet/"))[:3]
    return [Seed(f"parts-{n}", files, name, "read-parts s") for n, name in enumerate(inside)]


def devices() -> list[Seed]:
    """Return device files with every key."""
    line = "budget scene.toml --near 0.1 --json --device device.json"
    seeds = []
    for name, model in {"card": H100, "software": SOFTPIPE}.items():
        text = json.dumps({"renderer": "any", "model": model.as_json(), "subpixel_bits": 8})
        files = {"scene.toml": _SHAPE_SCENE, "device.json": text.encode()}
        seeds.append(Seed(f"device-{name}", files, "device.json", line))
    return [*seeds, *_also(seeds, "read", "read-device device.json", share=9)]


def recordings() -> list[Seed]:
    """Return a recording of one frame, mutated as a whole or in one member."""
    numbers = np.zeros((12, 16), dtype=np.int32)
    numbers[:, :8] = -1
    device = {"vendor": "Mesa", "renderer": "llvmpipe", "version": "4.5", "subpixel_bits": "8"}
    arrays = {"device": np.array(json.dumps(device)), "scene.toml|0.1|d24|standard|1,1": numbers}
    inside = {}
    for name, array in arrays.items():
        held = io.BytesIO()
        np.save(held, array)
        inside[f"frames.npz/{name}.npy"] = held.getvalue()
    members = {"scene.toml": _SHAPE_SCENE, **inside}
    line = "device --replay frames.npz --json --quiet"
    whole = Seed("replay-whole", packed(members), "frames.npz", line)
    return [whole, *(Seed(f"replay-{n}", members, name, line) for n, name in enumerate(inside))]


def archives() -> list[Seed]:
    """Return an archive of two conformance cases, mutated as a whole or in one member."""
    cases = "L0-behind", "L0-colors"
    (content,) = _made(f"conformance export --case {','.join(cases)} --out a --quiet", {}).values()
    images = {
        name.replace("truth/", f"images/{case}/"): data
        for case in cases
        for name, data in _made(f"conformance show {case} --out .", {}).items()
        if name.startswith("truth/")
    }
    members = _members("truth.zip", content)
    for name in [name for name in members if name.startswith("truth.zip/truths/")]:
        members |= _members(name, members.pop(name))
    members = {
        name: data for name, data in members.items() if name.endswith((".npy", "suite.json"))
    }
    whole, files, result = {**packed(members), **images}, {**members, **images}, list[Seed]()
    for case in cases:
        line = f"conformance judge images --truth truth.zip --case {case} --json --quiet"
        seeds = [Seed(f"archive-{case}-whole", whole, "truth.zip", line)]
        for name in members:
            if f"/{case}/0.npz" in name or name.endswith("suite.json"):
                title = f"archive-{case}-{PurePosixPath(name).stem}"
                seeds.append(Seed(title, files, name, line))
        result += [*seeds, *_also(seeds, "read", f"read-archive truth.zip {case}", share=9)]
    return result


def _members(name: str, content: bytes) -> dict[str, bytes]:
    """Return the members of an archive; their names begin with the archive's name."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {f"{name}/{member}": archive.read(member) for member in archive.namelist()}


PATTERN_LINES = """\
verify scene.toml {i}x{j}.png --apertures 1,1 --encoding triangle-id --quiet
view scene.toml --eye 0,0,300 --resolution 4,4 --images {i}x{j}.png --encoding triangle-id --quiet
verify scene.toml --command 'true {i}{j}{x:f}{out}' --encoding triangle-id --apertures 1,1 --quiet
"""


def patterns() -> list[Seed]:
    """Return command lines with patterns of file names, and with renderer commands."""
    files = {f"{i}x{j}.png": _picture((16, 12)) for i in range(3) for j in range(2)}
    files["scene.toml"] = _SHAPE_SCENE
    lines = enumerate(PATTERN_LINES.splitlines())
    return [Seed(f"pattern-{number}", files, "", line, "out") for number, line in lines]


def stores() -> list[Seed]:
    """Return a plate of six hogels as a Zarr store; its metadata or a chunk is mutated."""
    files = {"scene.toml": _SHAPE_SCENE}
    files |= _made(f"{_PLATE} --apertures *,*", files)
    inside = [name for name in files if name.startswith("p.zarr")]
    documents = [name for name in inside if name.endswith(".json")]
    chunks = sorted(set(inside) - set(documents))[:2]
    seeds = [
        Seed(f"zarr-{number}", files, name, f"{_PLATE} --check --apertures 0-1,0", "p.zarr")
        for number, name in enumerate((*documents, *chunks))
    ]
    return [*seeds, *_also(seeds, "convert", f"convert p.zarr out {_CONVERT}", "out", share=19)]


COMMAND_LINES = """\
trace scene.toml --aperture 1,1 --out out.exr --quiet
raster scene.toml --aperture 1,1 --near 0.1 --depth d24 --mapping reversed --slabs 2 --out out.exr
raster scene.toml --near 0.1 --pivot camera --fit 10 --offset none --camera c-star --out out.exr
compare truth.exr truth.exr --json --out out
scenes --json
plate scene.toml --near 0.1 --apertures 0-1,0;*,1 --color uint8 --out out.zarr --quiet
verify scene.toml {i}x{j}.exr --apertures 1,1;0,0 --max-wrong 1% --accept near --out out --quiet
budget scene.toml --near 0.1 --json
"""


def commands() -> list[Seed]:
    """Return command lines of every cheap command."""
    files = {"scene.toml": _SHAPE_SCENE}
    files |= dict.fromkeys(("truth.exr", "1x1.exr", "0x0.exr"), _hogel("trace"))
    left, lines = "out.exr out out.zarr", enumerate(COMMAND_LINES.splitlines())
    return [Seed(f"command-{number}", files, "", line, left) for number, line in lines]


KINDS: dict[str, Callable[[], list[Seed]]] = {
    "scene": scenes,
    "mesh": meshes,
    "instances": instances,
    "patches": patches,
    "exr": images,
    "exr-attributes": attributes,
    "names": names,
    "parts": parts,
    "device": devices,
    "replay": recordings,
    "archive": archives,
    "pattern": patterns,
    "environment": environments,
    "picture": pictures,
    "zarr": stores,
    "command": commands,
}
"""The seeds of each kind of input."""


def _threemf() -> bytes:
    """Return a 3MF file of two objects; a component places one of them."""
    square = mesh_xml([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    turned = '<component objectid="1" transform="0 1 0 -1 0 0 0 0 1 1 2 3"/>'
    objects = (
        f'<object id="1">{square}</object><object id="2"><components>{turned}</components></object>'
    )
    return threemf(
        f'<resources>{objects}</resources><build><item objectid="1"/><item objectid="2"/></build>'
    )


def _picture(size: tuple[int, int] = (8, 4), suffix: str = "png") -> bytes:
    pixels = np.arange(size[0] * size[1] * 3, dtype=np.uint8).reshape(size[1], size[0], 3) % 40
    pixels[..., :2] = 0
    held = io.BytesIO()
    Image.fromarray(pixels).save(held, format={"tif": "tiff"}.get(suffix, suffix))
    return held.getvalue()


def _map(name: str) -> bytes:
    pixels = np.linspace(0.01, 2, 8 * 4 * 3, dtype=np.float32).reshape(4, 8, 3)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write_map(path, pixels)
        return path.read_bytes()


@cache
def _hogel(line: str) -> bytes:
    """Return a command's image of the middle hogel."""
    line = f"{line} scene.toml --aperture 1,1 --out out.exr"
    return _made(line, {"scene.toml": _SHAPE_SCENE})["out.exr"]


def _made(line: str, files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files that a command writes in a separate process: OpenGL forbids forks."""
    with tempfile.TemporaryDirectory() as name:
        folder, program = Path(name), [sys.executable, "-m", "xfrustum", *line.split()]
        for file, data in files.items():
            (folder / file).write_bytes(data)
        subprocess.run(program, cwd=folder, check=True, capture_output=True)
        made = {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file()
        }
        return {name: data for name, data in made.items() if PurePosixPath(name).name not in files}


def _unpacked(data: bytes) -> bytes:
    """Return an OpenEXR file without compression, so that damage reaches the pixels."""
    import OpenEXR

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "image.exr"
        path.write_bytes(data)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            file.header()["compression"] = OpenEXR.NO_COMPRESSION
            file.write(str(path.with_name("plain.exr")))
        return path.with_name("plain.exr").read_bytes()
