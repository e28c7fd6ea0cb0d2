"""Draw calls during which other threads run Python."""

from __future__ import annotations

import ctypes

import moderngl
from OpenGL import GL

INDEX_BYTES = 4
"""Bytes of an index of a mesh: its corners are numbered in 32 bits."""


def draw_triangles(mesh: moderngl.VertexArray, *, first: int = 0, count: int | None = None) -> None:
    """Draw triangles of a mesh by its program.

    A software renderer handles vertices within the call, and moderngl's own holds Python's lock meanwhile.

    Parameters
    ----------
    mesh
        Mesh with indices of 32 bits.
    first, count
        First index that is used, and number of indices; all of the mesh where None.
    """
    GL.glUseProgram(mesh.program.glo)
    GL.glBindVertexArray(mesh.glo)
    indices = mesh.vertices if count is None else count
    GL.glDrawElements(GL.GL_TRIANGLES, indices, GL.GL_UNSIGNED_INT, ctypes.c_void_p(INDEX_BYTES * first))
