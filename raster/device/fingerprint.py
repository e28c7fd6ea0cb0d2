"""Fingerprint of a device: test pictures that reveal its rounding of triangles, depths and texels.

OpenGL 3.3 suffices, so that devices too old to draw hogels can be measured too. Without clip
control, all clip depths are from -1 to 1.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from xfrustum.raster.cameras import INTERNAL_FORMAT
from xfrustum.raster.device.targets import framebuffer, look_up_single_texels
from xfrustum.scenes.arrays import Mask, Singles
from xfrustum.scenes.plate import DepthFormat

#: pixels along each side of the pictures
SIZE = 64
TRIANGLES, EDGES = (
    240,
    160,
)  #: numbers of triangles for measurements of depth, and of coverage
UPRIGHT, FARTHEST = (
    60,
    23,
)  #: number of triangles with sides along rows and columns; log2 of the largest size in pixels
#: seed of the random triangles, equal in all recorded fingerprints
SEED = 11
#: value of pixels without a fragment
EMPTY = -9.0

#: Pairs: depth that the fragment of pixel 0 writes, and the step from pixel to pixel, ULP
WRITTEN = (
    (0.96, 101),
    (0.5, 1021),
    (0.25, 1),
    (0.1, 977),
    (0.001, 4099),
    (1e-6, 65537),
    (0.9999, 1),
)

_READ: dict[DepthFormat, tuple[int, type]] = {
    DepthFormat.D16: (GL.GL_UNSIGNED_SHORT, np.uint16),
    DepthFormat.D24: (GL.GL_UNSIGNED_INT, np.uint32),
    DepthFormat.D32F: (GL.GL_FLOAT, np.float32),
}

_VERTEX = """#version 330
in vec4 p; in vec2 a; smooth out vec2 s; noperspective out vec2 l; flat out vec2 c;
void main() { gl_Position = p; s = a; l = a; c = a; }"""

_OUT = "#version 330\nlayout(location = 0) out vec4 o; layout(location = 1) out vec4 q;\n"

_FRAGMENT = f"""{_OUT}smooth in vec2 s; noperspective in vec2 l; flat in vec2 c;
void main() {{ o = vec4(gl_FragCoord.z, gl_FragCoord.w, s); q = vec4(l, c); }}"""

_PLACE = "ivec2 at = ivec2(gl_FragCoord.xy); int n = at.y * 64 + at.x;"

_WRITES = f"""{_OUT}uniform float base; uniform int step;
void main() {{
    {_PLACE}
    gl_FragDepth = intBitsToFloat(floatBitsToInt(base) + n * step); o = vec4(gl_FragDepth); q = o;
}}"""

_FILTERS = f"""{_OUT}uniform sampler2D t;
void main() {{
    {_PLACE}
    o = texture(t, vec2((0.5 + (float(n) + 0.5) / 4096.0) / 2.0, 0.5)); q = o;
}}"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fingerprint:
    """Pictures drawn by a device, row 0 at the bottom; `vertices` (T, 3, 4) in clip coordinates."""

    device: dict[str, str]
    vertices: Singles
    zero_to_one: NDArray[np.bool_]  #: (T,) whether clip depth runs from 0 to 1, not from -1
    varyings: Singles  #: (T, 3, 2) two varyings of each corner
    stored: dict[DepthFormat, NDArray[Any]]  #: stored depths, in steps of D16 and D24
    #: (T, 64, 64, 4) gl_FragCoord.z and .w, smooth varyings; `EMPTY` without a fragment
    fragment: Singles
    others: Singles  #: (T, 64, 64, 4) noperspective varyings, then flat varyings
    #: for each format, the depths that fragments wrote (float32), and the stored depths
    written: dict[DepthFormat, tuple[Singles, NDArray[Any]]]
    #: (4096,) filtered values at positions between a texel of 0 and a texel of 1, float32
    filtered: Singles
    edge_vertices: Singles  #: (E, 3, 4) triangles with corners at pixel centers, or at 1/512 pixel
    covered: Mask  #: (E, 64, 64) pixels that these triangles cover

    @property
    def drawn(self) -> Mask:
        """(T, 64, 64) pixels with a fragment."""
        return np.asarray(self.fragment[..., 0] != EMPTY)

    @classmethod
    def read(cls, path: Path) -> Fingerprint:
        """Read a recorded fingerprint; D24 is recorded in the upper 24 bits."""
        with np.load(path) as arrays:
            names = json.loads(str(arrays["device"]))
            at = [f"{base:g}" for base, _ in WRITTEN]

            def of(depth: DepthFormat, what: str) -> NDArray[Any]:
                return np.concatenate([arrays[f"written|{depth}|{base}|{what}"] for base in at])

            steps = {depth: _in_steps(depth, arrays[depth.value]) for depth in DepthFormat}
            written = {d: (of(d, "float"), _in_steps(d, of(d, "stored"))) for d in DepthFormat}
            return cls(
                device={name: str(value) for name, value in names.items()},
                zero_to_one=arrays["zero_to_one"] != 0,
                stored=steps,
                written=written,
                fragment=arrays["frag"],
                others=arrays["flat"],
                filtered=arrays["filter|f4"],
                covered=np.unpackbits(arrays["covered"], axis=-1) != 0,
                **{name: arrays[name] for name in ("vertices", "varyings", "edge_vertices")},
            )


def _in_steps(depth: DepthFormat, read: NDArray[Any]) -> NDArray[Any]:
    """Convert depths as read to steps of the format: D24 is in the upper 24 of 32 bits."""
    return read >> 8 if depth is DepthFormat.D24 else read


def fingerprint_triangles() -> Iterator[tuple[Singles, Singles]]:
    """Yield clip coordinates (3, 4) and varyings (3, 2) of triangles of every size and slope."""
    rng = np.random.default_rng(SEED)
    for k in range(TRIANGLES):
        kind = k % 6
        size = (20.0, 2.0, 0.5, 0.05, 1.0, 1.0)[kind]
        xy = rng.uniform(-1, 1, (3, 2)) * size + (
            rng.uniform(-0.8, 0.8, 2) if kind in (2, 3) else 0
        )
        w = np.ones(3) if kind in (0, 3) else np.exp(rng.uniform(-4, 4, 3))
        z = rng.uniform(-0.98, 0.98, 3) if kind != 5 else 1 - np.exp(rng.uniform(-14, -8, 3))
        corners = np.concatenate([xy, z[:, None], np.ones((3, 1))], axis=1) * w[:, None]
        varyings = rng.uniform(0, 1, (3, 2)).astype(np.float32)
        if k % 7 == 0:
            varyings[:] = varyings[0]
        yield corners.astype(np.float32), varyings


def edge_triangles() -> Iterator[Singles]:
    """Yield corners (3, 4) of triangles that test coverage.

    The first triangles have corners at pixel centers (edges tie there) or at multiples of 1/512
    pixel. The next triangles have two sides along rows and columns, on pixel centers or half a
    subpixel (of 8 or 4 bits) off: many pixels then reveal the rounding of corners. The last
    triangles are up to 2^23 pixels large.
    """
    rng = np.random.default_rng(SEED)
    places = [
        rng.integers(-40 * 512, 40 * 512, (3, 2)) / 512
        if k % 2
        else rng.integers(-40, 40, (3, 2)) + 0.5
        for k in range(EDGES)
    ]
    for _ in range(UPRIGHT):
        shift = rng.choice((0, 2.0**-9, -(2.0**-9), 2.0**-5, -(2.0**-5)), (2, 2))
        (left, right), (bottom, top) = np.sort(rng.integers(-31, 31, (2, 2)) + 0.5 + shift)
        places.append(
            np.array([(left, bottom), (right, bottom), (left, top)])[:: rng.choice((-1, 1))]
        )
        places[-1] *= rng.choice((-1, 1))
    for doubled in range(6, FARTHEST + 1):
        # One side runs through the window. The third corner is about as far from the middle as the
        # ends of this side.
        along = rng.integers(-(2**doubled), 2**doubled, 2)
        near = rng.integers(-20, 20, 2)
        places += [np.array([near - along, near + along, sign * along[::-1]]) for sign in (-1, 1)]
    for at in places:
        corners = np.ones((3, 4), np.float32)
        corners[:, :2], corners[:, 2] = at / (SIZE / 2), 0
        yield corners


class _Canvas:
    """Two float32 pictures with a depth buffer of each format, in the current context."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        pictures = {
            GL.GL_COLOR_ATTACHMENT0 + number: self._texture(GL.GL_RGBA32F) for number in range(2)
        }
        self._framebuffers = {
            depth: framebuffer(
                {**pictures, GL.GL_DEPTH_ATTACHMENT: self._texture(internal)}, [0, 1]
            )
            for depth, internal in INTERNAL_FORMAT.items()
        }

    @staticmethod
    def _texture(internal: int) -> int:
        texture = int(GL.glGenTextures(1))
        GL.glBindTexture(GL.GL_TEXTURE_2D, texture)
        is_depth = internal in INTERNAL_FORMAT.values()
        layout = (GL.GL_DEPTH_COMPONENT if is_depth else GL.GL_RGBA), GL.GL_FLOAT
        GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, internal, SIZE, SIZE, 0, *layout, None)
        look_up_single_texels(GL.GL_TEXTURE_2D, texture)
        return texture

    def draw(
        self, program: moderngl.Program, corners: Singles, depth: DepthFormat, content: str
    ) -> None:
        """Draw corners with the attributes of `content` into cleared pictures."""
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._framebuffers[depth])
        GL.glViewport(0, 0, SIZE, SIZE)
        self._context.enable_only(moderngl.DEPTH_TEST)
        GL.glDepthFunc(GL.GL_ALWAYS)
        for picture in range(2):
            GL.glClearBufferfv(GL.GL_COLOR, picture, np.full(4, EMPTY, np.float32))
        GL.glClearBufferfv(GL.GL_DEPTH, 0, np.zeros(1, np.float32))
        names = [name for name in ("p", "a") if name in program]
        buffer = self._context.buffer(np.ascontiguousarray(corners, dtype=np.float32).tobytes())
        vertices = self._context.vertex_array(program, [(buffer, content, *names)])
        vertices.render(moderngl.TRIANGLES)
        vertices.release()
        buffer.release()

    def depth(self, depth: DepthFormat) -> NDArray[Any]:
        """Return the depths of the latest drawing, in steps of their format."""
        kind, dtype = _READ[depth]
        into: NDArray[Any] = np.empty((SIZE, SIZE), dtype)
        GL.glReadPixels(0, 0, SIZE, SIZE, GL.GL_DEPTH_COMPONENT, kind, into)
        return _in_steps(depth, into)

    def picture(self, number: int) -> Singles:
        """Return one of the pictures."""
        GL.glReadBuffer(GL.GL_COLOR_ATTACHMENT0 + number)
        into: Singles = np.empty((SIZE, SIZE, 4), np.float32)
        GL.glReadPixels(0, 0, SIZE, SIZE, GL.GL_RGBA, GL.GL_FLOAT, into)
        return into


def draw_fingerprint(context: moderngl.Context, device: dict[str, str]) -> Fingerprint:
    """Draw the fingerprint of the current context's device, in one or two seconds in software."""
    canvas, clip_control = _Canvas(context), bool(GL.glClipControl)
    program = context.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)
    vertices, varyings, zero_to_one = [], [], []
    fragment: list[Singles] = []
    others: list[Singles] = []
    stored: dict[DepthFormat, list[NDArray[Any]]] = {depth: [] for depth in DepthFormat}
    for number, (corners, values) in enumerate(fingerprint_triangles()):
        from_zero = bool(number % 2) and clip_control
        if clip_control:
            GL.glClipControl(
                GL.GL_LOWER_LEFT, GL.GL_ZERO_TO_ONE if from_zero else GL.GL_NEGATIVE_ONE_TO_ONE
            )
        for depth, pictures in stored.items():
            canvas.draw(program, np.concatenate([corners, values], axis=1), depth, "4f 2f")
            pictures.append(canvas.depth(depth))
        for pictures, number_of in ((fragment, 0), (others, 1)):
            pictures.append(canvas.picture(number_of))
        vertices.append(corners)
        varyings.append(values)
        zero_to_one.append(from_zero)
    edges, covered = list(edge_triangles()), []
    for corners in edges:
        canvas.draw(
            program,
            np.concatenate([corners, np.zeros((3, 2), np.float32)], axis=1),
            DepthFormat.D32F,
            "4f 2f",
        )
        covered.append(canvas.picture(0)[..., 0] != EMPTY)
    return Fingerprint(
        device=device,
        vertices=np.array(vertices),
        varyings=np.array(varyings),
        zero_to_one=np.array(zero_to_one),
        stored={depth: np.array(pictures) for depth, pictures in stored.items()},
        fragment=np.array(fragment),
        others=np.array(others),
        written=_written(context, canvas),
        filtered=_filtered(context, canvas),
        edge_vertices=np.array(edges),
        covered=np.array(covered),
    )


_WHOLE = np.array([[-1, -1, 0, 1], [3, -1, 0, 1], [-1, 3, 0, 1]], np.float32)
_WHOLE_VERTEX = "#version 330\nin vec4 p; void main() { gl_Position = p; }"


def _written(
    context: moderngl.Context, canvas: _Canvas
) -> dict[DepthFormat, tuple[Singles, NDArray[Any]]]:
    """Return depths written by fragments, and the depths stored by each format."""
    program = context.program(vertex_shader=_WHOLE_VERTEX, fragment_shader=_WRITES)
    depths = {}
    for depth in DepthFormat:
        pairs = []
        for base, step in WRITTEN:
            program["base"], program["step"] = base, step
            canvas.draw(program, _WHOLE, depth, "4f")
            pairs.append((canvas.picture(0)[..., 0].ravel(), canvas.depth(depth).ravel()))
        wrote, kept = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        depths[depth] = (wrote, kept)
    return depths


def _filtered(context: moderngl.Context, canvas: _Canvas) -> Singles:
    """Return filtered values at 4,096 positions between a texel of 0 and a texel of 1."""
    program = context.program(vertex_shader=_WHOLE_VERTEX, fragment_shader=_FILTERS)
    texture = context.texture((2, 1), 1, np.array([0, 1], np.float32).tobytes(), dtype="f4")
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    texture.repeat_x = texture.repeat_y = False
    texture.use(0)
    canvas.draw(program, _WHOLE, DepthFormat.D32F, "4f")
    texture.release()
    return np.ascontiguousarray(canvas.picture(0)[..., 0].ravel())
