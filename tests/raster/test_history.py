"""A picture depends on what is asked for, and not on what was drawn before it."""

from __future__ import annotations

import random

import numpy as np
import pytest

from tests.support.views import reversed_d32f, view
from xfrustum.raster import Rasterizer
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum

SIZE = (96, 72)


def leave_wrong(what: str) -> None:
    """Leave a state behind as code past moderngl could."""
    from OpenGL import GL  # noqa: PLC0415 - the package chooses its platform first

    match what:
        case "scissor":
            GL.glEnable(GL.GL_SCISSOR_TEST)
            GL.glScissor(0, 0, 3, 3)
        case "depth range":
            GL.glDepthRange(0.25, 0.5)
        case "depth mask":
            GL.glDepthMask(GL.GL_FALSE)
        case "depth clamp":
            GL.glEnable(GL.GL_DEPTH_CLAMP)
        case "color mask":
            GL.glColorMask(GL.GL_FALSE, GL.GL_TRUE, GL.GL_TRUE, GL.GL_TRUE)
        case "lines":
            GL.glPolygonMode(GL.GL_FRONT_AND_BACK, GL.GL_LINE)
        case "discard":
            GL.glEnable(GL.GL_RASTERIZER_DISCARD)
        case "provoking vertex":
            GL.glProvokingVertex(GL.GL_FIRST_VERTEX_CONVENTION)
        case "clip control":
            GL.glClipControl(GL.GL_UPPER_LEFT, GL.GL_NEGATIVE_ONE_TO_ONE)
        case "culling":
            GL.glEnable(GL.GL_CULL_FACE)
            GL.glFrontFace(GL.GL_CW)
        case "row length":
            GL.glPixelStorei(GL.GL_PACK_ROW_LENGTH, 200)
        case "offset":
            GL.glEnable(GL.GL_POLYGON_OFFSET_FILL)
            GL.glPolygonOffset(1e4, 1e4)


LEFT = (
    "scissor",
    "depth range",
    "depth mask",
    "depth clamp",
    "color mask",
    "lines",
    "discard",
    "provoking vertex",
    "clip control",
    "culling",
    "row length",
    "offset",
)


@pytest.mark.parametrize("what", LEFT)
def test_no_state_that_was_left_behind_changes_a_bit(what: str) -> None:
    """The scene has triangles across the near planes and beyond the film on both sides of the plate."""
    scene = view("crossing", SIZE)
    settings = DoubleFrustum(near=0.1 * scene.frustum.longest_reach, depth=DepthFormat.D24)
    with Rasterizer(scene) as rasterizer:
        first = rasterizer.render(scene.plate.middle, settings)
        with rasterizer._context:
            leave_wrong(what)
        second = rasterizer.render(scene.plate.middle, settings)
    for name in ("triangle", "position", "color"):
        np.testing.assert_array_equal(getattr(second, name), getattr(first, name))


def test_a_scene_drawn_after_many_others_in_any_order_has_the_same_bits() -> None:
    """Rasterizers and plates of other scenes are open beside it, and draw in between."""
    scenes = [view(name, SIZE) for name in ("car", "large-triangles", "asymmetric-recentered")]
    near = [0.1 * scene.frustum.longest_reach for scene in scenes]
    settings = [
        (index, setting)
        for index, n in enumerate(near)
        for setting in (
            reversed_d32f(n),
            DoubleFrustum(near=n / 1e4, depth=DepthFormat.D16, mapping=DepthMapping.GL),
        )
    ]
    alone = {}
    for index, setting in settings:
        with Rasterizer(scenes[index]) as rasterizer:
            alone[index, setting] = rasterizer.render(scenes[index].plate.middle, setting)
    rasterizers = [Rasterizer(scene) for scene in scenes]
    try:
        order = settings * 4
        random.Random(1997).shuffle(order)
        for number, (index, setting) in enumerate(order):
            if number % 8 == 0:
                with PlateRenderer(scenes[index], setting) as plate:
                    list(plate.hogels([scenes[index].plate.middle]))
            drawn = rasterizers[index].render(scenes[index].plate.middle, setting)
            for name in ("triangle", "position", "color"):
                np.testing.assert_array_equal(getattr(drawn, name), getattr(alone[index, setting], name))
    finally:
        for rasterizer in rasterizers:
            rasterizer.release()
