"""Shaders and the triangles that they draw: programs, vertex buffers, and surface points of pixels.

Shaders are assembled from the folder `shaders` for a choice of effects. Triangles are on the GPU in
float32. A compute pass returns the surface points of pixels from their triangle numbers.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from typing import Protocol, TypeVar

import moderngl
import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from xfrustum.raster.cameras import Mapping as OpenGLMapping
from xfrustum.raster.cameras import Pass
from xfrustum.scenes.arrays import Indices, Singles
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.scene import Scene, read_only

#: Effects computed in the picture's shaders; other effects are separate cameras or passes
SHADING = (
    Effect.SMOOTH_NORMALS,
    Effect.VERTEX_COLORS,
    Effect.TEXTURES,
    Effect.AMBIENT,
    Effect.DIFFUSE,
    Effect.SPECULAR,
)

#: names that a shader tests with `#ifdef`, and their values
Defines = Mapping[str, str]


def shader(name: str) -> str:
    """Return a file of the folder `shaders`, with its includes replaced by the included files."""
    text = (files("xfrustum.raster") / "shaders" / name).read_text()
    lines = []
    for line in text.splitlines():
        word, _, included = line.partition(" ")
        lines.append(shader(included.strip('"')) if word == "#include" else line)
    return "\n".join(lines) + "\n"


def defined(source: str, defines: Defines) -> str:
    """Return a shader with definitions inserted after the first line, the GLSL version."""
    version, rest = source.split("\n", 1)
    return "\n".join(
        (version, *(f"#define {name} {value}" for name, value in defines.items()), rest)
    )


def defines_of(effects: Iterable[Effect]) -> dict[str, str]:
    """Return the definitions that enable the effects of `SHADING` in the shaders."""
    chosen = frozenset(effects)
    return {effect.name: "1" for effect in SHADING if effect in chosen}


def picture_defines(mapping: OpenGLMapping, effects: Iterable[Effect] | None) -> dict[str, str]:
    """Return the definitions for hogel.frag: depth and effects; no color if `effects` is None."""
    depth = {"FRAGMENT_DEPTH": f"({mapping.fragment_depth})"} if mapping.fragment_depth else {}
    return depth if effects is None else {"SHADED": "1", **defines_of(effects), **depth}


def reflection_defines(effects: Iterable[Effect]) -> dict[str, str]:
    """Return the definitions for reflection.frag, with or without smooth normals."""
    return defines_of(frozenset(effects) & {Effect.SMOOTH_NORMALS})


def program(context: moderngl.Context, fragment: str, defines: Defines) -> moderngl.Program:
    """Return the program of `hogel.vert` and a fragment shader."""
    return context.program(
        vertex_shader=defined(shader("hogel.vert"), defines),
        fragment_shader=defined(shader(fragment), defines),
    )


def assign(program: moderngl.Program, **uniforms: object) -> None:
    """Set the uniforms that the program has; the compiler drops unused uniforms."""
    for name, value in uniforms.items():
        if name in program:
            program[name] = value


def set_camera(program: moderngl.Program, number: int, camera: Pass, size: tuple[int, int]) -> None:
    """Set the uniforms of a camera with its number in drawing order, and W, H of the image."""
    near, far = camera.planes
    assign(
        program,
        clip_from_scene=tuple(camera.clip_from_scene.T.ravel().tolist()),
        near=near,
        far=far,
        conjugate=1.0 if camera.orthoscopic else -1.0,
        pixels=tuple(float(n) for n in size),
        camera=number,
    )
    if "line_of_pixel" in program:
        program["line_of_pixel"] = tuple(camera.line_of_pixel.T.ravel().tolist())


def set_facing(context: moderngl.Context, camera: Pass) -> None:
    """Set the winding of faces turned to a camera, and the culled faces."""
    context.front_face = camera.front_face
    if camera.culled_face is None:
        context.disable(moderngl.CULL_FACE)
    else:
        context.cull_face = camera.culled_face
        context.enable(moderngl.CULL_FACE)


_Scalar = TypeVar("_Scalar", bound=np.generic)


@dataclass(frozen=True, kw_only=True, eq=False)
class NumberedMesh:
    """Mesh in which the last vertex of each triangle carries the triangle's number.

    The order of triangles and corners is unchanged; vertices are duplicated. `gl_PrimitiveID` is
    not used: it restarts with every draw, and with it Mesa's software pipeline processes three
    vertices per triangle. A flat varying takes its value from the last corner of a triangle: if
    this corner has its own vertex, the vertex number is the triangle number.
    """

    #: (N,) number of the scene's vertex that each vertex copies. The first F vertices are the last
    #: corners of the triangles.
    source: Indices
    faces: NDArray[np.uint32]  #: (F, 3) uint32 into `source`

    def ends(self, values: NDArray[_Scalar]) -> NDArray[_Scalar]:
        """Return values (N, ..) of vertices: values (F, ..) of triangles at last vertices, or 0."""
        others = np.zeros((len(self.source) - len(values), *values.shape[1:]), values.dtype)
        return np.concatenate((values, others))


def number_triangles(faces: Indices) -> NumberedMesh:
    """Return the mesh of faces (F, 3) in which the last corner of triangle t is vertex t.

    Each of the other two corners uses the copy of its vertex with the largest number up to t, or
    else the copy with the smallest number above t. Neighboring triangles then share vertices that
    are still in the vertex cache. Vertices that are never a last corner have one copy each, after
    all other copies.
    """
    count = len(faces)
    last = faces[:, 2]
    # Sort all copies by vertex and then by triangle; the stable sort keeps the order by triangle.
    copies = np.argsort(last, kind="stable")
    owner = last[copies]
    numbered = np.empty((count, 3), dtype=np.int64)
    numbered[:, 2] = np.arange(count)
    # Combine vertex and triangle of each copy into one ascending key: a search for the key of
    # (vertex, triangle) returns the next copy.
    keys = owner * count + copies
    without_copy = np.setdiff1d(faces[:, :2], last)
    for corner in (0, 1):
        vertex = faces[:, corner]
        following = np.searchsorted(keys, vertex * count + np.arange(count), side="right")
        before, after = np.maximum(following - 1, 0), np.minimum(following, count - 1)
        chosen = np.where(owner[before] == vertex, copies[before], copies[after])
        has_copy = (owner[before] == vertex) | (owner[after] == vertex)
        extra = count + np.searchsorted(without_copy, vertex)
        numbered[:, corner] = np.where(has_copy, chosen, extra)
    return NumberedMesh(
        source=read_only(np.concatenate([last, without_copy])),
        faces=read_only(numbered.astype(np.uint32)),
    )


#: binding of the triangles' own normals, as in surface.glsl
NORMALS = 0

#: Numbers per vertex of each attribute of hogel.vert
ATTRIBUTES = {"in_position": 3, "in_normal": 3, "in_color": 3, "in_uv": 2}

#: Tolerance of heights, relative to the largest length along z, within which a triangle counts as
#: on one side of the plate. Clip depth is a sum of two float32 products, each with an error of
#: about 2^-22 of this length, and is proportional to the distance from the near plane. Any device
#: clips a triangle completely if all its corners are in front of the near plane by this tolerance,
#: and the near plane is at the plate or beyond it.
SIDE_SLACK = 2.0**-10


class Mesh:
    """Corners, indices and normals of triangles, uploaded once; other attributes on first use.

    In float32, the position of a texture lookup at coordinate U, in a texture of W texels, has an
    error of about U W 2^-24 texels.
    """

    def __init__(self, context: moderngl.Context, scene: Scene) -> None:
        self._context = context
        self._scene = scene
        self._indices = context.buffer(scene.faces.astype(np.uint32).tobytes())
        self._normals = context.buffer(scene.normals.astype(np.float32).tobytes())
        self._attributes: dict[str, moderngl.Buffer] = {}
        self._sides: dict[int, moderngl.Buffer | None] = {}

    def drawn_by(self, program: moderngl.Program) -> moderngl.VertexArray:
        """Return the mesh with the attributes that a program reads."""
        read = [name for name in ATTRIBUTES if name in program]
        content = [(self._attribute(name), f"{ATTRIBUTES[name]}f", name) for name in read]
        return self._context.vertex_array(program, content, index_buffer=self._indices)

    @staticmethod
    def side_of(heights: tuple[float, float]) -> int:
        """Return the side of the plate of a range of z: 1 in front, -1 behind, 0 for both."""
        return -1 if heights[1] <= 0 else 1 if heights[0] >= 0 else 0

    def numbered(self, program: moderngl.Program, side: int) -> moderngl.VertexArray | None:
        """Return a mesh of positions in which last vertices carry triangle numbers.

        Triangles on the other side of the plate (`side_of`) are left out; None if no triangle
        remains.
        """
        if side not in self._sides:
            lowest, highest = self._scene.height_ranges
            largest = max(
                self._scene.frustum.longest_reach, -float(lowest.min()), float(highest.max())
            )
            slack = SIDE_SLACK * largest
            kept = {
                -1: lowest <= slack,
                0: np.ones(len(lowest), dtype=np.bool_),
                1: highest >= -slack,
            }[side]
            faces = self._numbered.faces[kept]
            # A buffer cannot be empty.
            self._sides[side] = self._context.buffer(faces.tobytes()) if len(faces) else None
        indices = self._sides[side]
        if indices is None:
            return None
        return self._context.vertex_array(
            program, [(self._numbered_positions, "3f", "in_position")], index_buffer=indices
        )

    @cached_property
    def _numbered(self) -> NumberedMesh:
        return number_triangles(self._scene.faces)

    @cached_property
    def _numbered_positions(self) -> moderngl.Buffer:
        positions = attribute_of(self._scene, "in_position")[self._numbered.source]
        return self._context.buffer(positions.tobytes())

    def bind(self) -> None:
        """Bind the normals for the shaders."""
        self._normals.bind_to_storage_buffer(NORMALS)

    def _attribute(self, name: str) -> moderngl.Buffer:
        if name not in self._attributes:
            self._attributes[name] = self._context.buffer(attribute_of(self._scene, name).tobytes())
        return self._attributes[name]


def attribute_of(scene: Scene, name: str) -> Singles:
    """Return one of `ATTRIBUTES` of all vertices; zeros, never used, at vertices without it."""
    if name == "in_position":
        return scene.vertices.astype(np.float32)
    surface = scene.surface
    arrays = {
        "in_normal": surface.vertex_normals,
        "in_color": surface.vertex_colors,
        "in_uv": surface.uv,
    }
    values = arrays[name]
    if values is None:
        return np.zeros((len(scene.vertices), ATTRIBUTES[name]), dtype=np.float32)
    return np.ascontiguousarray(np.nan_to_num(values, nan=0.0).astype(np.float32))


#: pixels of a work group, as in position.comp
GROUP = 256

#: number of work groups per dispatch that every device supports
MAX_GROUPS = 65535

#: Bytes of a point, three float32. Points are read in parts that fit into one storage block.
BYTES_PER_POINT = 12


class Identified(Protocol):
    """Picture with triangle and camera numbers that a shader can look up."""

    @property
    def size(self) -> tuple[int, int]:
        """W, H in pixels."""

    def bind_identity(self, unit: int) -> None:
        """Bind the identities as a texture for a shader."""


class Positions:
    """Triangles of a scene (at least one) in double precision on the GPU, and the compute pass."""

    def __init__(self, context: moderngl.Context, scene: Scene) -> None:
        self._context = context
        self._largest_block = int(GL.glGetIntegerv(GL.GL_MAX_SHADER_STORAGE_BLOCK_SIZE))
        self._vertices = context.buffer(scene.vertices.tobytes())
        self._faces = context.buffer(scene.faces.astype(np.uint32).tobytes())
        self._program = context.compute_shader(shader("position.comp"))
        self._program["nothing"] = float("nan")

    def read(self, target: Identified, drawn: Sequence[Pass], pixels: Indices) -> Singles:
        """Return surface points (3, N) of a picture, scene units, NaN without a surface.

        `pixels` (N,) are numbers of pixels, row by row from the top.
        """
        program = self._program
        most = min(self._largest_block // BYTES_PER_POINT, MAX_GROUPS * GROUP)
        target.bind_identity(0)
        result = np.empty((3, len(pixels)), np.float32)
        for start in range(0, len(pixels), most):
            part = pixels[start : start + most]
            numbers = self._context.buffer(part.astype(np.uint32).tobytes())
            points = self._context.buffer(reserve=BYTES_PER_POINT * len(part))
            for binding, buffer in enumerate(
                (self._vertices, self._faces, points, numbers), start=1
            ):
                buffer.bind_to_storage_buffer(binding)
            program["count"] = len(part)
            for number, camera in enumerate(drawn):
                program["camera"], program["cuts"] = number, camera.heights
                program["clip_from_scene"] = tuple(camera.clip_from_scene.T.ravel().tolist())
                program.run(-(-len(part) // GROUP))
            # The pass writes x of all points, then y, then z.
            GL.glMemoryBarrier(GL.GL_BUFFER_UPDATE_BARRIER_BIT)
            read = np.frombuffer(points.read(), dtype=np.float32)
            result[:, start : start + most] = read.reshape(3, -1)
            points.release()
            numbers.release()
        return result
