"""Points, normals, objects and light of decided pixels, compiled by Dr.Jit: one lane for each pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from xfrustum.reference.certify.certify import FirstSurfaces
from xfrustum.reference.devices.arithmetic_jit import JIT, Float32, Float64, Int32, on_device
from xfrustum.reference.devices.strict_jit import strict_arithmetic
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.lines.lines_jit import interleaved, pixel_directions, read_interleaved
from xfrustum.reference.shading.light import Seen
from xfrustum.reference.shading.shading import Shader
from xfrustum.scenes.arrays import Floats, Numbers, Singles
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.room import vectors_with_room


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """What some rows of an image show beside the numbers of triangles.

    Attributes
    ----------
    object
        (rows, W) int32.
    position, normal
        (rows, W, 3) float64.
    color
        (rows, W, 3) float32; None where none was asked for.
    """

    object: Numbers
    position: Floats
    normal: Floats
    color: Singles | None


class JitPictures:
    """Makes what images show of decisions along the lines of one camera.

    Parameters
    ----------
    scene
        Scene that is seen, with at least one triangle.
    shader
        Shader of its surfaces.
    """

    def __init__(self, scene: Scene, shader: Shader) -> None:
        with strict_arithmetic():
            self._normals = JIT.table(scene.normals)
            self._objects = JIT.table(scene.object_of_triangle)
            self._light = shader.on(JIT)

    def points(
        self, layers: Sequence[tuple[Pencil, FirstSurfaces]], rows: range
    ) -> tuple[Numbers, Numbers, Floats]:
        """Return triangles and objects (rows, W) and points (rows, W, 3) that overlaid layers show.

        Parameters
        ----------
        layers
            Lines of each camera, and what is first along them; the last one is on top.
        rows
            Rows of the image.
        """
        shape = len(rows), layers[0][0].resolution[0]
        with strict_arithmetic():
            number, position = Int32(NOTHING), [Float64(np.nan)] * 3
            directions: dict[object, list[Any]] = {}
            for pencil, decided in layers:
                # Cameras that were not fitted to a height have the same lines, from centers of their own.
                film = pencil.shear, pencil.half_extent
                if film not in directions:
                    directions[film] = pixel_directions(pencil, rows)
                triangle, s = decided.device or (on_device(decided.triangle), on_device(decided.s))
                covers = triangle != NOTHING
                number = dr.select(covers, triangle, number)
                position = [
                    dr.select(covers, at + s * along, below)
                    for at, along, below in zip(
                        JIT.constants(pencil.center), directions[film], position, strict=True
                    )
                ]
            (of_triangle,) = self._objects(dr.maximum(number, 0))
            objects = dr.select(number != NOTHING, of_triangle, NOTHING)
            dr.eval(number, objects, *position)
            points = vectors_with_room(shape, np.float64)
            for axis, values in enumerate(position):
                points[..., axis] = values.numpy().reshape(shape)
            return number.numpy().reshape(shape), objects.numpy().reshape(shape), points

    def shown(self, pencil: Pencil, rows: range, decided: FirstSurfaces, *, colored: bool = True) -> Shown:
        """Return what decided rows show.

        Parameters
        ----------
        pencil, rows, decided
            Lines of the camera, rows of the image, and what is first along their lines.
        colored
            Whether color is made.
        """
        shape, size = decided.triangle.shape, decided.triangle.size
        with strict_arithmetic():
            triangle, s = decided.device or (on_device(decided.triangle), on_device(decided.s))
            direction = pixel_directions(pencil, rows)
            center = JIT.constants(pencil.center)
            position = [at + s * along for at, along in zip(center, direction, strict=True)]
            covered, number = triangle != NOTHING, dr.maximum(triangle, 0)
            (of_triangle,) = self._objects(number)
            normal = self._normals(number)
            arrays = {
                "object": interleaved([dr.select(covered, of_triangle, NOTHING)], size),
                "position": interleaved(position, size),
                "normal": interleaved([dr.select(covered, part, np.nan) for part in normal], size),
            }
            if colored:
                seen = Seen(triangle=number, normal=normal, position=position, direction=direction)
                light = [Float32(dr.select(covered, part, 0.0)) for part in self._light.radiance(seen)]
                # Gray has one channel.
                arrays["color"] = interleaved(light if len(light) == 3 else light * 3, size)
            dr.eval(*arrays.values())
            objects = read_interleaved(arrays.pop("object"), shape)
            read = {name: read_interleaved(array, (*shape, 3)) for name, array in arrays.items()}
        return Shown(
            object=objects,
            position=read["position"],
            normal=read["normal"],
            color=read.get("color"),
        )
