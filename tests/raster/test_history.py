"""Pictures depend only on their request, not on pictures drawn before."""

from __future__ import annotations

import random
from collections.abc import Callable

from tests.support.images import assert_same
from tests.support.views import reversed_d32f, view
from xfrustum.raster import Rasterizer
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum

SIZE = (96, 72)
DRAWN = ("triangle", "position", "color")


def left_behind() -> dict[str, Callable[[], object]]:
    """Return functions, by name, that change OpenGL states without moderngl."""
    from OpenGL import GL  # noqa: PLC0415 - the package chooses its platform first

    return {
        "scissor": lambda: (GL.glEnable(GL.GL_SCISSOR_TEST), GL.glScissor(0, 0, 3, 3)),
        "depth range": lambda: GL.glDepthRange(0.25, 0.5),
        "depth mask": lambda: GL.glDepthMask(GL.GL_FALSE),
        "depth clamp": lambda: GL.glEnable(GL.GL_DEPTH_CLAMP),
        "color mask": lambda: GL.glColorMask(GL.GL_FALSE, GL.GL_TRUE, GL.GL_TRUE, GL.GL_TRUE),
        "lines": lambda: GL.glPolygonMode(GL.GL_FRONT_AND_BACK, GL.GL_LINE),
        "discard": lambda: GL.glEnable(GL.GL_RASTERIZER_DISCARD),
        "provoking vertex": lambda: GL.glProvokingVertex(GL.GL_FIRST_VERTEX_CONVENTION),
        "clip control": lambda: GL.glClipControl(GL.GL_UPPER_LEFT, GL.GL_NEGATIVE_ONE_TO_ONE),
        "culling": lambda: (GL.glEnable(GL.GL_CULL_FACE), GL.glFrontFace(GL.GL_CW)),
        "row length": lambda: GL.glPixelStorei(GL.GL_PACK_ROW_LENGTH, 200),
        "offset": lambda: (GL.glEnable(GL.GL_POLYGON_OFFSET_FILL), GL.glPolygonOffset(1e4, 1e4)),
    }


def test_no_state_that_was_left_behind_changes_a_bit() -> None:
    """The scene has triangles across the near planes, and beyond the film on both sides."""
    scene = view("crossing", SIZE)
    settings = DoubleFrustum(near=0.1 * scene.frustum.longest_reach, depth=DepthFormat.D24)
    for leave in left_behind().values():
        with Rasterizer(scene) as rasterizer:
            first = rasterizer.render(scene.plate.middle, settings)
            with rasterizer._context:
                leave()
            assert_same(rasterizer.render(scene.plate.middle, settings), first, *DRAWN)


def test_a_scene_drawn_after_many_others_in_any_order_has_the_same_bits() -> None:
    """Rasterizers and plates of other scenes stay open and draw in between."""
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
        order = settings * 2
        random.Random(1997).shuffle(order)
        for number, (index, setting) in enumerate(order):
            if number % 4 == 0:
                with PlateRenderer(scenes[index], setting) as plate:
                    list(plate.hogels([scenes[index].plate.middle]))
            drawn = rasterizers[index].render(scenes[index].plate.middle, setting)
            assert_same(drawn, alone[index, setting], *DRAWN)
    finally:
        for rasterizer in rasterizers:
            rasterizer.release()
