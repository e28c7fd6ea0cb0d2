#!/usr/bin/env python3
"""Stand-alone program, run by Blender: renders hogels of a plate with Cycles.

    python render.py --out HOGELS                        with the package bpy, 4.5 or newer
    blender -b -P render.py -- --out HOGELS              in Blender 4.5 or newer
    blender -b MINE.blend -P render.py -- --out HOGELS   your scene, materials and lights untouched

It reads plate.json and scene.npz, which `xfrustum camera SCENE --for blender` wrote next to it, and
does not need xfrustum. Finished hogels are kept: to continue a stopped run, repeat it.

The camera is the crossed frustum itself. Each ray starts at the viewer's end of its pixel's line, a
- reach d, and runs along d = (kx + u tx, ky + v ty, -1) through the aperture a. The hogel shows the
first surface that the ray meets, in one pass and without a near plane.
"""

import argparse
import json
import math
import os
import signal
import struct
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent

Array = np.ndarray[Any, Any]
"""Numbers of any type and shape."""

#: passes and face attributes with triangle and object numbers plus one; 0 is the background
TRIANGLE, OBJECT = "xfrustum_triangle", "xfrustum_object"
#: empty that represents the plate; hogels follow its placement
PLATE_EMPTY = "xfrustum plate"

ENCODINGS = ("triangle-id", "exr", "picture")
LAYOUTS = {
    "hogels": "hogel_{i}x{j}",
    "burnett": "Hogel_{j}x{i}",
    "hocking": "hogel_{i:04}_{columns:04}_{up:04}_{rows:04}",
}
"""Layouts with one file per hogel, by names of files; `xfrustum convert` makes other layouts."""

FILE_SUFFIXES = (".png", ".exr")
"""Suffixes by which --out names a single file; any other name is a folder."""

MIN_VERSION = (4, 5)
"""Oldest version of Blender in which Cycles has cameras as shaders."""

MAX_NUMBER = 1 << 24
"""Bound of numbers that are exact in float32, the type of attributes in Cycles."""

CLIP_START, FAR_FACTOR = 1e-6, 1.01
"""Start of the rays, scene units, and their length in reaches.

Surfaces beyond the reach are left out afterwards, by their positions.
"""

CENTER_FILTER_PX = 0.01
"""Width of the pixel filter for one sample, pixels: the smallest width that Cycles allows.

The camera moves every sample to the center of its pixel; a wider filter could assign the sample to
the next pixel.
"""

INTERRUPTED = 130
"""Exit status after Ctrl-C, as in a shell."""

SHADER = """
shader crossed_frustum(output point position = 0, output vector direction = 0,
                       output color throughput = 1)
{{
    float column = P[0] * {width};
    float row = P[1] * {height};
    if ({centered}) {{
        column = floor(column) + 0.5;
        row = floor(row) + 0.5;
    }}
    float x = {turn} * (2 * column / {width} - 1);
    float y = {turn} * (2 * row / {height} - 1);
    vector line = vector({kx} + x * {tx}, {ky} + y * {ty}, 1);
    position = -{reach} * line;
    direction = line;
}}
"""
"""Camera shader. Camera space has x to the right, y up and z forward; P is the position on the film
from 0 to 1, rows upward."""


class UnusableError(Exception):
    """Problem that the user can solve, in one line."""


# ---------------------------------------------------------------- the plate


def aperture_center(plate: Mapping[str, Any], column: int, row: int) -> tuple[float, float]:
    """Return x and y of an aperture's center in the plate's frame, row 0 at the top."""
    (width, height), (columns, rows) = plate["size"], plate["hogels"]
    return (column + 0.5) * width / columns - width / 2, height / 2 - (row + 0.5) * height / rows


def film(plate: Mapping[str, Any], center: tuple[float, float]) -> tuple[list[float], list[float]]:
    """Return shear k and half-extent t of an aperture's film, slopes."""
    screen = plate["screen"]
    if screen is None:
        return [0.0, 0.0], [math.tan(angle / 2) for angle in plate["fov"]]
    # Slopes are sideways shifts per unit of depth behind the plate.
    behind = -screen["height"]
    shear = [
        (middle - place) / behind for middle, place in zip(screen["center"], center, strict=True)
    ]
    return shear, [size / 2 / abs(behind) for size in screen["size"]]


def shader_of(
    plate: Mapping[str, Any], index: tuple[int, int], scale: float, *, centered: bool, turned: bool
) -> str:
    """Return the camera shader of an aperture of a scaled plate."""
    (kx, ky), (tx, ty) = film(plate, aperture_center(plate, *index))
    width, height = plate["resolution"]
    numbers = {"kx": kx, "ky": ky, "tx": tx, "ty": ty, "reach": plate["reach"][0] * scale}
    return SHADER.format(
        width=float(width),
        height=float(height),
        centered=int(centered),
        turn=-1 if turned else 1,
        # Nine digits restore a float32, the precision of the shading language; parentheses separate
        # signs from operators.
        **{name: f"({value:.9g})" for name, value in numbers.items()},
    )


# ---------------------------------------------------------------- files
#
# Blender's Python has no library that writes OpenEXR channels of whole numbers.


def png(pixels: Array) -> bytes:
    """Return (H, W, 3) uint8 pixels as a PNG file."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + content))
        return struct.pack(">I", len(content)) + kind + content + check

    height, width, _ = pixels.shape
    # Each PNG row begins with its filter type, 0 for none.
    rows = np.concatenate([np.zeros((height, 1), np.uint8), pixels.reshape(height, -1)], axis=1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = (
        chunk(b"IHDR", header),
        chunk(b"IDAT", zlib.compress(rows.tobytes(), 6)),
        chunk(b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def exr(planes: Mapping[str, Array]) -> bytes:
    """Return (H, W) planes of float32 or uint32 as an OpenEXR file without compression."""
    # OpenEXR requires channels in alphabetical order, in the header and in each line.
    names = sorted(planes)
    height, width = planes[names[0]].shape
    kinds = {name: 0 if planes[name].dtype == np.uint32 else 2 for name in names}
    channels = b"".join(
        name.encode() + b"\0" + struct.pack("<IIII", kinds[name], 0, 1, 1) for name in names
    )
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    attributes = (
        ("channels", "chlist", channels + b"\0"),
        ("compression", "compression", b"\0"),
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", b"\0"),
        ("pixelAspectRatio", "float", struct.pack("<f", 1)),
        ("screenWindowCenter", "v2f", struct.pack("<ff", 0, 0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1)),
    )
    header = struct.pack("<II", 20000630, 2)
    for name, kind, content in attributes:
        header += f"{name}\0{kind}\0".encode() + struct.pack("<I", len(content)) + content
    lines = [
        b"".join(
            planes[name][row].astype("<u4" if kinds[name] == 0 else "<f4").tobytes()
            for name in names
        )
        for row in range(height)
    ]
    # Line data follow the header's final zero byte and one 8-byte offset per line.
    start = len(header) + 1 + 8 * height
    offsets = start + np.cumsum([0, *(8 + len(line) for line in lines[:-1])])
    body = b"".join(struct.pack("<iI", row, len(line)) + line for row, line in enumerate(lines))
    table: bytes = offsets.astype("<u8").tobytes()
    return header + b"\0" + table + body


def exr_planes(content: bytes) -> dict[str, Array]:
    """Return the (H, W) planes of Blender's OpenEXR: one part, scan lines, no compression."""
    _, flags = struct.unpack_from("<II", content)
    place, attributes = 8, {}
    while content[place]:
        name, kind = (part.decode() for part in content[place:].split(b"\0", 2)[:2])
        place += len(name) + len(kind) + 2
        (size,) = struct.unpack_from("<I", content, place)
        attributes[name] = content[place + 4 : place + 4 + size]
        place += 4 + size
    # The low byte is the version and 0x400 allows long names; any other flag means tiles or parts.
    if flags & ~0x4FF or attributes["compression"] != b"\0":
        raise UnusableError(
            "Blender wrote an OpenEXR file of several parts or with compression; this script reads "
            "neither"
        )
    left, top, right, bottom = struct.unpack("<iiii", attributes["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    types: dict[str, Any] = {}
    listed = attributes["channels"]
    while listed[0]:
        channel, rest = listed.split(b"\0", 1)
        types[channel.decode()] = {0: "<u4", 1: "<f2", 2: "<f4"}[struct.unpack_from("<I", rest)[0]]
        # Type, linearity and two sampling rates take 16 bytes.
        listed = rest[16:]
    line = np.dtype(
        [("y", "<i4"), ("size", "<u4"), *((name, kind, (width,)) for name, kind in types.items())]
    )
    rows = np.frombuffer(content, line, count=height, offset=place + 1 + 8 * height)
    return {name: rows[name].astype(np.float32) for name in types}


def encoded(
    planes: Mapping[str, Array], plate: Mapping[str, Any], to_plate: Array, encoding: str
) -> bytes:
    """Return the file of a hogel from the passes of Cycles, by the names of their channels.

    The encoding `triangle-id` gives PNG, `exr` OpenEXR; `to_plate` maps the world to the plate's
    frame. Surfaces beyond the reach are left out: they are first hits, so that no other surface
    lies in front of them on the pixel's line.
    """

    # Return (channels, H, W); the view layer may have any name.
    def named(*channels: str) -> Array:
        ends = (
            next(plane for name, plane in planes.items() if name.endswith(f".{end}"))
            for end in channels
        )
        return np.stack(list(ends)).astype(np.float64)

    position = (
        np.moveaxis(named("Position.X", "Position.Y", "Position.Z"), 0, -1) @ to_plate[:3, :3].T
    )
    position += to_plate[:3, 3]
    # Rays begin at the reach on the viewer's side: only far surfaces can lie beyond it.
    shown = (named("Combined.A")[0] > 0) & (position[..., 2] >= -plate["reach"][1])
    numbers = {
        # Cycles stores attributes as float32, which is exact for ids below 2^24; 0 is the
        # background.
        attribute: np.where(shown, np.rint(plane), 0).astype(np.uint32)
        for attribute in (TRIANGLE, OBJECT)
        for name, plane in planes.items()
        if f".{attribute}." in name
    }
    if encoding == "triangle-id":
        if not numbers:
            raise UnusableError(
                "only the mesh of the scene file has numbers of triangles; use --encoding exr"
            )
        number = numbers[TRIANGLE]
        return png(
            np.stack((number >> 16, number >> 8 & 255, number & 255), axis=-1).astype(np.uint8)
        )
    points = np.where(shown, np.moveaxis(position, -1, 0), np.nan)
    written: dict[str, Array] = dict(
        zip(("P.X", "P.Y", "P.Z", "Z"), (*points, points[2]), strict=True)
    )
    # Normals of triangles by their winding, NaN where there is no triangle.
    if numbers:
        with np.load(HERE / "scene.npz") as stored:
            corners = stored["vertices"][stored["faces"]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        with np.errstate(invalid="ignore", divide="ignore"):
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        normals = np.moveaxis(
            # Id 0, the background, selects the NaN row: ids begin at one.
            np.concatenate([np.full((1, 3), np.nan), normal])[numbers[TRIANGLE]],
            -1,
            0,
        )
    else:  # normals and colors of Cycles
        seen = np.moveaxis(named("Normal.X", "Normal.Y", "Normal.Z"), 0, -1)
        # `to_plate` is a rotation with a uniform scale; divide by the scale for normals.
        seen = seen @ (to_plate[:3, :3] / np.linalg.norm(to_plate[:3, 0])).T
        normals = np.where(shown, np.moveaxis(seen, -1, 0), np.nan)
        colors = np.where(shown, named("Combined.R", "Combined.G", "Combined.B"), 0)
        written |= dict(zip("RGB", colors, strict=True))
    written |= dict(zip(("N.X", "N.Y", "N.Z"), normals, strict=True))
    stored_planes: dict[str, Array] = {
        name: plane.astype(np.float32) for name, plane in written.items()
    }
    if numbers:
        stored_planes |= {"id.triangle": numbers[TRIANGLE], "id.object": numbers[OBJECT]}
    return exr(stored_planes)


def put(path: Path, content: bytes) -> None:
    """Write a file, whole or not at all."""
    # Same folder, hence same file system: the rename is atomic.
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_bytes(content)
    temporary.replace(path)


# ---------------------------------------------------------------- a run of hours


def interruptions() -> list[int]:
    """Return a list to which Ctrl-C appends from now on, in place of ending the program.

    Cycles calls back into Python while it renders, and a KeyboardInterrupt in that call is lost.
    """
    pressed: list[int] = []

    def note(number: int, _frame: object) -> None:
        pressed.append(number)
        # A signal handler may not enter buffered streams again.
        os.write(2, b"this hogel is finished first\n")

    signal.signal(signal.SIGINT, note)
    return pressed


def hide_known_complaints() -> None:
    """Hide two harmless tracebacks that Blender prints when it is a Python module.

    The module lacks oslquery, which lists a shader's parameters, and the camera's shader has none.
    Blender also queries the session of renderers after their removal.
    """
    shown, unraisable = sys.excepthook, sys.unraisablehook

    def show(kind: Any, error: BaseException, trace: Any) -> None:
        if getattr(error, "name", None) != "oslquery":
            shown(kind, error, trace)

    def show_unraisable(hook: Any) -> None:
        error = hook.exc_value
        if not (isinstance(error, ReferenceError) and "CyclesRender" in str(error)):
            unraisable(hook)

    sys.excepthook, sys.unraisablehook = show, show_unraisable


# ---------------------------------------------------------------- Blender


def blender_modules() -> tuple[Any, Any, Any]:
    """Return `bpy`, the module of Cycles, and `mathutils`."""
    try:
        import bpy  # noqa: PLC0415
    except ImportError as error:
        raise UnusableError(
            "needs Blender: run it by `blender -b -P render.py --`, or by a Python with the "
            "package bpy; scripts/make_blender_venv.sh of xfrustum's checkout makes one "
            "(build/blender/bin/python)"
        ) from error
    if bpy.app.version[:2] < MIN_VERSION:
        raise UnusableError(
            "needs Blender 4.5 or newer, in which cameras can be shaders; this is "
            f"{bpy.app.version_string}"
        )
    import _cycles  # noqa: PLC0415
    import mathutils  # noqa: PLC0415

    return bpy, _cycles, mathutils


def build_scene(bpy: Any, mathutils: Any, plate: Mapping[str, Any]) -> None:
    """Make the scene of the scene file: meshes with numbers of triangles and objects, lights."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with np.load(HERE / "scene.npz") as stored:
        mesh = {name: stored[name] for name in stored.files}
    if len(mesh["faces"]) >= MAX_NUMBER - 1:
        raise UnusableError(
            f"the scene has {len(mesh['faces']):,} triangles; Cycles passes on numbers up to "
            f"{MAX_NUMBER:,}"
        )
    collection = bpy.context.scene.collection
    for number, name in enumerate(plate["objects"]):
        first, last = mesh["first_triangle"][number : number + 2]
        low, high = mesh["first_vertex"][number : number + 2]
        made = bpy.data.meshes.new(name)
        vertices, faces = mesh["vertices"][low:high], mesh["faces"][first:last] - low
        made.vertices.add(len(vertices))
        made.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
        made.loops.add(faces.size)
        made.loops.foreach_set("vertex_index", faces.astype(np.int32).ravel())
        made.polygons.add(len(faces))
        made.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
        for attribute, values in (
            (TRIANGLE, np.arange(first, last)),
            (OBJECT, np.full(len(faces), number)),
        ):
            numbers = made.attributes.new(attribute, "FLOAT", "FACE")
            numbers.data.foreach_set("value", (values + 1).astype(np.float32))
        made.update()
        made.materials.append(material(bpy, name, plate["colors"][number]))
        collection.objects.link(bpy.data.objects.new(name, made))
    for number, light in enumerate(plate["lights"]):
        sun = bpy.data.lights.new(f"light {number}", "SUN")
        strength = max(*light["color"], 1e-9)
        sun.energy, sun.color = math.pi * strength, [part / strength for part in light["color"]]
        lamp = bpy.data.objects.new(sun.name, sun)
        lamp.rotation_euler = (
            mathutils.Vector(light["direction"]).to_track_quat("Z", "Y").to_euler()
        )
        collection.objects.link(lamp)
    for layer in bpy.context.scene.view_layers:
        for name in (TRIANGLE, OBJECT):
            passed = layer.aovs.add()
            passed.name, passed.type = name, "VALUE"


def material(bpy: Any, name: str, color: Sequence[float]) -> Any:
    """Return a matte material that also writes the numbers of triangles and objects."""
    made = bpy.data.materials.new(name)
    if made.node_tree is None:
        made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    out, matte = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    matte.inputs["Color"].default_value = (*(min(part, 1.0) for part in color), 1.0)
    tree.links.new(matte.outputs[0], out.inputs["Surface"])
    for attribute in (TRIANGLE, OBJECT):
        number, written = (
            tree.nodes.new("ShaderNodeAttribute"),
            tree.nodes.new("ShaderNodeOutputAOV"),
        )
        number.attribute_name, number.attribute_type = attribute, "GEOMETRY"
        written.aov_name = attribute
        tree.links.new(number.outputs["Fac"], written.inputs["Value"])
    return made


def plate_empty(bpy: Any, plate: Mapping[str, Any]) -> Any:
    """Return the empty that represents the plate, a new one in the origin if necessary."""
    empty = bpy.data.objects.get(PLATE_EMPTY)
    if empty is None:
        empty = bpy.data.objects.new(PLATE_EMPTY, None)
        empty.empty_display_type, empty.empty_display_size = "ARROWS", max(plate["size"]) / 2
        bpy.context.scene.collection.objects.link(empty)
        bpy.context.view_layer.update()
    return empty


def placed(empty: Any) -> tuple[Array, float]:
    """Return the (4, 4) matrix from the plate's frame to the world, and its scale."""
    matrix = np.array(empty.matrix_world, dtype=np.float64)
    scales = np.linalg.norm(matrix[:3, :3], axis=0)
    gram = matrix[:3, :3].T @ matrix[:3, :3]
    if not np.allclose(gram, np.diag([scales[0] ** 2] * 3), rtol=1e-5, atol=1e-5 * scales[0] ** 2):
        raise UnusableError(
            f"the empty {PLATE_EMPTY!r} must be scaled by the same factor along x, y and z"
        )
    if np.linalg.det(matrix[:3, :3]) < 0:
        raise UnusableError(f"the empty {PLATE_EMPTY!r} must not be mirrored")
    return matrix, float(scales[0])


def set_renderer(
    bpy: Any, plate: Mapping[str, Any], encoding: str, samples: int | None, scale: float
) -> None:
    """Set Cycles for an encoding: `triangle-id` takes one sample and no bounces."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = plate["resolution"]
    scene.render.resolution_percentage = 100
    scene.render.use_border = scene.render.use_motion_blur = False
    scene.render.use_persistent_data = True
    scene.render.use_compositing = scene.render.use_sequencer = False
    scene.cycles.device = "CPU"
    if samples:
        scene.cycles.samples = samples
    if encoding != "picture":
        if encoding == "triangle-id" or not samples:
            scene.cycles.samples = 1
        scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", CENTER_FILTER_PX
        scene.render.film_transparent = True
        if encoding == "triangle-id":
            scene.cycles.max_bounces = 0
        for layer in scene.view_layers:
            layer.use_pass_combined = layer.use_pass_position = layer.use_pass_normal = True
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "IMAGE" if encoding == "picture" else "MULTI_LAYER_IMAGE"
    if encoding == "picture":
        image.file_format, image.color_mode, image.color_depth = "PNG", "RGB", "8"
    else:
        image.file_format, image.color_depth, image.exr_codec = "OPEN_EXR_MULTILAYER", "32", "NONE"
        if hasattr(image, "use_exr_interleave"):
            image.use_exr_interleave = True
    camera = bpy.data.cameras.new("xfrustum aperture")
    camera.type, camera.clip_start = "CUSTOM", CLIP_START
    # The longest line per unit of depth belongs to one of the plate's corners.
    columns, rows = plate["hogels"]
    corners = ((0, 0), (columns - 1, 0), (0, rows - 1), (columns - 1, rows - 1))
    films = (film(plate, aperture_center(plate, *index)) for index in corners)
    lengths = (math.hypot(abs(kx) + tx, abs(ky) + ty, 1.0) for (kx, ky), (tx, ty) in films)
    camera.clip_end = FAR_FACTOR * scale * sum(plate["reach"]) * max(lengths)
    eye = bpy.data.objects.new(camera.name, camera)
    scene.collection.objects.link(eye)
    scene.camera = eye


# ---------------------------------------------------------------- hogels


def render_hogels(
    arguments: argparse.Namespace,
    plate: Mapping[str, Any],
    apertures: Sequence[tuple[int, int]],
    say: Callable[[str], None],
) -> None:
    """Render the missing hogels."""
    bpy, cycles, mathutils = blender_modules()
    if arguments.blend:
        bpy.ops.wm.open_mainfile(filepath=str(arguments.blend))
    own = not bpy.data.filepath
    if own:
        build_scene(bpy, mathutils, plate)
    encoding = arguments.encoding or ("triangle-id" if own else "picture")
    empty = plate_empty(bpy, plate)
    if arguments.save:
        bpy.ops.wm.save_as_mainfile(filepath=str(arguments.save.resolve()), copy=True)
        say(f"{arguments.save}: the scene with the empty {PLATE_EMPTY!r}")
    if arguments.out is None:
        return
    matrix, scale = placed(empty)
    set_renderer(bpy, plate, encoding, arguments.samples, scale)
    paths = files_of(arguments, plate, apertures, ".exr" if encoding == "exr" else ".png")
    missing = [index for index in apertures if arguments.again or not paths[index].exists()]
    say(f"{len(missing)} hogels to render, {len(apertures) - len(missing)} found")
    if arguments.out.suffix.lower() not in FILE_SUFFIXES:
        # Readers of the folder take the number of hogels from this file.
        arguments.out.mkdir(parents=True, exist_ok=True)
        put(arguments.out / "plate.json", (HERE / "plate.json").read_bytes())
    hide_known_complaints()
    pressed, start = interruptions(), time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        for number, index in enumerate(missing):
            began = time.monotonic()
            if pressed:
                raise KeyboardInterrupt
            shifted = np.eye(4)
            shifted[:2, 3] = aperture_center(plate, *index)
            stands = matrix @ shifted
            stands[:3, :3] /= scale
            how = {"centered": encoding != "picture", "turned": arguments.layout == "burnett"}
            source, compiled = Path(scratch, f"{number}.osl"), Path(scratch, f"{number}.oso")
            source.write_text(shader_of(plate, index, scale, **how), encoding="ascii")
            if not cycles.osl_compile(str(source), str(compiled)):
                raise UnusableError(
                    "Cycles cannot compile the camera's shader: is it built with OSL?"
                )
            eye = bpy.context.scene.camera
            eye.matrix_world = mathutils.Matrix(stands.tolist())
            eye.data.custom_mode, eye.data.custom_filepath = "EXTERNAL", str(compiled)
            rendered = Path(scratch) / ("hogel.png" if encoding == "picture" else "hogel.exr")
            bpy.context.scene.render.filepath = str(rendered)
            bpy.ops.render.render(write_still=True)
            content = rendered.read_bytes()
            if encoding != "picture":
                content = encoded(exr_planes(content), plate, np.linalg.inv(matrix), encoding)
            paths[index].parent.mkdir(parents=True, exist_ok=True)
            put(paths[index], content)
            now, more = time.monotonic(), len(missing) - number - 1
            left = (
                f", about {(now - start) / (number + 1) * more:.0f} s for {more} more"
                if more
                else ""
            )
            say(f"hogel {index[0]},{index[1]}: {now - began:.3f} s{left}  {paths[index]}")


def files_of(
    arguments: argparse.Namespace,
    plate: Mapping[str, Any],
    apertures: Sequence[tuple[int, int]],
    suffix: str,
) -> dict[tuple[int, int], Path]:
    """Return the file of each aperture; --out with a suffix names a single file."""
    out = arguments.out
    if out.suffix.lower() in FILE_SUFFIXES:
        if len(apertures) > 1:
            raise UnusableError(
                f"--out {out} is one file for {len(apertures)} apertures: give a folder"
            )
        if out.suffix.lower() != suffix:
            raise UnusableError(
                f"--out {out}: this encoding is written to files that end in {suffix}"
            )
        return {apertures[0]: out}
    (columns, rows), pattern = plate["hogels"], LAYOUTS[arguments.layout] + suffix
    return {
        (i, j): out / pattern.format(i=i, j=j, up=rows - 1 - j, columns=columns, rows=rows)
        for i, j in apertures
    }


def parsed(argv: Sequence[str]) -> argparse.Namespace:
    """Return the options of a command line."""
    parser = argparse.ArgumentParser(
        prog="render.py", description="Render hogels of a plate with Cycles."
    )
    parser.add_argument("--apertures", metavar="I,J;I,J", help="column,row of each [default: all]")
    parser.add_argument("--out", type=Path, help="folder of the hogels, or one hogel's file")
    parser.add_argument(
        "--encoding", choices=ENCODINGS, help="[default: triangle-id; picture for a .blend]"
    )
    parser.add_argument(
        "--layout", choices=LAYOUTS, default="hogels", help="names and orientation of the files"
    )
    parser.add_argument("--blend", type=Path, help="a scene of yours instead of the scene file's")
    parser.add_argument(
        "--samples", type=int, help="samples per pixel [default: 1 for numbers; else the scene's]"
    )
    parser.add_argument(
        "--save", type=Path, help="write the scene with the plate's empty as a .blend file"
    )
    parser.add_argument(
        "--again", action="store_true", help="render hogels anew that are there already"
    )
    arguments = parser.parse_args(argv)
    if arguments.out is None and arguments.save is None:
        parser.error("give --out, --save or both")
    return arguments


def chosen(plate: Mapping[str, Any], text: str | None) -> list[tuple[int, int]]:
    """Return the apertures of --apertures, else of plate.json, else of the whole plate."""
    columns, rows = plate["hogels"]
    if text is None:
        named = plate["apertures"] or [(i, j) for j in range(rows) for i in range(columns)]
        return [(int(i), int(j)) for i, j in named]
    try:
        pairs = [tuple(int(part) for part in pair.split(",")) for pair in text.split(";")]
        indices = [(i, j) for i, j in pairs]
    except ValueError as error:
        raise UnusableError(
            f"--apertures {text!r} is not a list of column,row such as 40,30;0,0"
        ) from error
    for i, j in indices:
        if not (0 <= i < columns and 0 <= j < rows):
            raise UnusableError(
                f"aperture {i},{j} lies outside the plate of {columns} x {rows} hogels"
            )
    return indices


def main(argv: Sequence[str]) -> int:
    """Render, and return the exit status: 0 done, 2 wrong input, 130 interrupted."""
    arguments = parsed(argv)
    try:
        plate = json.loads((HERE / "plate.json").read_text(encoding="utf-8"))
        apertures = chosen(plate, arguments.apertures)
        render_hogels(arguments, plate, apertures, lambda line: print(line, flush=True))
    except (UnusableError, OSError) as error:
        print(f"render.py: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("render.py: interrupted; repeat the command to continue", file=sys.stderr)
        return INTERRUPTED
    return 0


if __name__ == "__main__":
    # Blender's own arguments end at --.
    inside = "--" in sys.argv
    sys.exit(main(sys.argv[sys.argv.index("--") + 1 :] if inside else sys.argv[1:]))
