"""A scene's triangles on the GPU, in float32: corners, and what is interpolated between them."""

from __future__ import annotations

import moderngl
import numpy as np

from xfrustum.raster.device.numbered_mesh import number_triangles
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.model.scene import Scene

NORMALS = 0
"""Binding of the triangles' own normals, as in surface.glsl."""

ATTRIBUTES = {"in_position": 3, "in_normal": 3, "in_color": 3, "in_uv": 2}
"""Numbers per vertex of each attribute of hogel.vert."""


class Mesh:
    """Corners, indices and normals, uploaded once; other attributes are uploaded when first asked for.

    Texture coordinates are float32 like the rest: at coordinate U, a texture of W texels is looked up to
    within about U W 2^-24 of a texel.

    Parameters
    ----------
    context
        The current context.
    scene
        Scene with at least one triangle.
    """

    def __init__(self, context: moderngl.Context, scene: Scene) -> None:
        self._context = context
        self._scene = scene
        self._indices = context.buffer(scene.faces.astype(np.uint32).tobytes())
        self._normals = context.buffer(scene.normals.astype(np.float32).tobytes())
        self._attributes: dict[str, moderngl.Buffer] = {}

    def drawn_by(self, program: moderngl.Program, *, numbered: bool = False) -> moderngl.VertexArray:
        """Return the mesh for a program, with the attributes that it reads.

        Parameters
        ----------
        program
            Program that draws it.
        numbered
            Whether triangles have the numbers of their last vertices; such a mesh has positions alone.
        """
        if numbered:
            mesh = number_triangles(self._scene.faces)
            positions = self._context.buffer(attribute_of(self._scene, "in_position")[mesh.source].tobytes())
            indices = self._context.buffer(mesh.faces.tobytes())
            return self._context.vertex_array(program, [(positions, "3f", "in_position")], index_buffer=indices)
        read = [name for name in ATTRIBUTES if name in program]
        content = [(self._attribute(name), f"{ATTRIBUTES[name]}f", name) for name in read]
        return self._context.vertex_array(program, content, index_buffer=self._indices)

    def bind(self) -> None:
        """Bind the normals for the shaders."""
        self._normals.bind_to_storage_buffer(NORMALS)

    def _attribute(self, name: str) -> moderngl.Buffer:
        if name not in self._attributes:
            self._attributes[name] = self._context.buffer(attribute_of(self._scene, name).tobytes())
        return self._attributes[name]


def attribute_of(scene: Scene, name: str) -> Singles:
    """Return an attribute of all vertices; zero at vertices without it, which no triangle then reads.

    Parameters
    ----------
    scene
        Scene with the vertices.
    name
        A name out of `ATTRIBUTES`.
    """
    if name == "in_position":
        return scene.vertices.astype(np.float32)
    surface = scene.surface
    found = {"in_normal": surface.vertex_normals, "in_color": surface.vertex_colors, "in_uv": surface.uv}
    values = found[name]
    if values is None:
        return np.zeros((len(scene.vertices), ATTRIBUTES[name]), dtype=np.float32)
    return np.ascontiguousarray(np.nan_to_num(values, nan=0.0).astype(np.float32))
