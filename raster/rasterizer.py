"""The paper's double frustum: C, then C* over it (paper, sections 3 to 5)."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType

import moderngl
import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from xfrustum.raster.cameras import FilmWindow
from xfrustum.raster.context import describe, open_context
from xfrustum.raster.depth_formats import MAPPINGS, Mapping
from xfrustum.raster.passes import Pass, drawing_order
from xfrustum.raster.plate_program import picture_program, set_camera
from xfrustum.raster.positions import DrawnBy, Positions
from xfrustum.raster.targets import Target
from xfrustum.scenes.double_frustum import DepthFormat, DoubleFrustum
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.hogel_image import NOTHING, HogelCamera, HogelImage
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.scene import Scene

MAX_TRIANGLES = (1 << 31) // 3
"""Shaders index three values a triangle with signed 32-bit integers."""


class Rasterizer:
    """A scene on the GPU, to be drawn for any aperture and any settings.

    A context manager: leaving it frees the context and everything in it.

    Parameters
    ----------
    scene
        Uploaded once, in float32.

    Raises
    ------
    InputError
        There is no usable OpenGL (see `context.open_context`).
    """

    def __init__(self, scene: Scene) -> None:
        if len(scene.faces) > MAX_TRIANGLES:
            raise InputError(
                f"{scene.name}: {len(scene.faces)} triangles; at most {MAX_TRIANGLES} can be drawn"
            )
        self.scene = scene
        self._context = open_context()
        self.device = describe(self._context)
        self._targets: dict[tuple[tuple[int, int], DepthFormat], Target] = {}
        self._check_room(scene)
        self._object_of_number = np.append(scene.object_of_triangle, np.int32(NOTHING))
        self._upload(scene)

    def __enter__(self) -> Rasterizer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def release(self) -> None:
        """Free the context and everything in it."""
        with self._context:
            for target in self._targets.values():
                target.release()
        self._targets.clear()
        self._context.release()

    def _check_room(self, scene: Scene) -> None:
        """Raise InputError where the device draws no so large image, or has no so large block."""
        limit = int(GL.glGetIntegerv(GL.GL_MAX_TEXTURE_SIZE))
        size = scene.frustum.resolution
        if max(size) > limit:
            device = self.device["renderer"]
            self._context.release()
            raise InputError(
                f"{device} draws at most {limit} x {limit} pixels, not {size[0]} x {size[1]}; "
                "choose a smaller frustum.resolution"
            )
        block = int(GL.glGetIntegerv(GL.GL_MAX_SHADER_STORAGE_BLOCK_SIZE))
        # Vertices are three doubles, normals and indices three 32-bit numbers.
        needed = max(24 * len(scene.vertices), 12 * len(scene.faces))
        if needed > block:
            device = self.device["renderer"]
            self._context.release()
            raise InputError(
                f"{scene.name}: {len(scene.faces):,} triangles on {len(scene.vertices):,} vertices need "
                f"{needed >> 20} MiB in one block, {device} has {block >> 20}; draw a smaller mesh"
            )

    def _upload(self, scene: Scene) -> None:
        self._programs: dict[str, tuple[moderngl.Program, moderngl.VertexArray]] = {}
        if len(scene.faces):
            self._vertices = self._context.buffer(scene.vertices.astype(np.float32).tobytes())
            self._indices = self._context.buffer(scene.faces.astype(np.uint32).tobytes())
            self._normals = self._context.buffer(scene.normals.astype(np.float32).tobytes())
            self._positions = Positions(self._context, scene)

    def _program(self, mapping: Mapping) -> tuple[moderngl.Program, moderngl.VertexArray]:
        """Return the program that stores depth by a mapping, and the mesh for it."""
        if mapping.fragment_depth not in self._programs:
            program = picture_program(self._context, mapping, None)
            mesh = self._context.vertex_array(
                program, [(self._vertices, "3f", "in_position")], index_buffer=self._indices
            )
            self._programs[mapping.fragment_depth] = (program, mesh)
        return self._programs[mapping.fragment_depth]

    def render(
        self, aperture: Aperture, settings: DoubleFrustum, *, normals: bool = True, color: bool = True
    ) -> HogelImage:
        """Draw the hogel image of an aperture.

        Parameters
        ----------
        aperture
            Where the frusta cross.
        settings
            Near plane, depth buffer, cameras.
        normals, color
            Leave out what nobody looks at.

        Raises
        ------
        InputError
            near is not smaller than the reach, or the device cannot draw so large an image.
        """
        settings.check_against(self.scene.frustum)
        # OpenGL draws in whichever context is current: another Rasterizer may have been opened since.
        with self._context:
            target = self._target(settings.depth)
            target.begin()
            passes = drawing_order(self.scene, aperture, settings)
            mapping = MAPPINGS[settings.mapping]
            for number, camera in enumerate(passes):
                target.clear_depth(camera.test.clear)
                self._draw(number, camera, mapping)
            triangle = target.read_triangle()
            return HogelImage(
                camera=self._camera(aperture, settings),
                triangle=triangle,
                object=self._object_of_number[triangle],
                position=self._read_position(target, passes),
                normal=self._normals_of(triangle) if normals else None,
                color=target.read_color() if color else None,
            )

    def _read_position(self, target: Target, passes: Sequence[Pass]) -> NDArray[np.float32]:
        if not passes:
            return np.full((*target.size[::-1], 3), np.nan, dtype=np.float32)
        drawn = [DrawnBy(clip_from_scene=p.clip_from_scene, heights=p.heights) for p in passes]
        return self._positions.read(target, drawn)

    def _draw(self, number: int, camera: Pass, mapping: Mapping) -> None:
        program, mesh = self._program(mapping)
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = camera.test.function
        self._context.front_face = camera.front_face
        GL.glClipControl(GL.GL_LOWER_LEFT, mapping.clip_control)
        program["clip_from_scene"] = tuple(camera.clip_from_scene.T.ravel().tolist())
        set_camera(program, number, camera, mapping)
        self._normals.bind_to_storage_buffer(0)
        mesh.render()

    def _target(self, depth: DepthFormat) -> Target:
        size = self.scene.frustum.resolution
        if (size, depth) not in self._targets:
            self._targets[size, depth] = Target(self._context, size, depth)
        return self._targets[size, depth]

    def _normals_of(self, triangle: NDArray[np.int32]) -> NDArray[np.float32]:
        normals = np.full((*triangle.shape, 3), np.nan, dtype=np.float32)
        covered = triangle != NOTHING
        normals[covered] = self.scene.normals[triangle[covered]]
        return normals

    def _camera(self, aperture: Aperture, settings: DoubleFrustum) -> HogelCamera:
        window = FilmWindow.of(self.scene.frustum, aperture)
        return HogelCamera(
            aperture=aperture,
            resolution=self.scene.frustum.resolution,
            # k is the slope of the axis per unit of depth, away from the viewer.
            shear=(-window.axis[0], -window.axis[1]),
            half_extent=(window.half_width, window.half_height),
            reach=self.scene.frustum.reach,
            scene=self.scene.source,
            scene_hash=self.scene.content_hash,
            renderer=f"raster, {self.device['renderer']}",
            settings=settings,
        )
