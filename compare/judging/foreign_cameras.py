"""The cameras of a foreign renderer, with bounds of rounding for a precision that nobody has stated."""

from __future__ import annotations

from dataclasses import replace

from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.compare.rounding.cameras import Precision, RoundingCamera
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping
from xfrustum.scenes.plate.plate import Aperture

SUBPIXEL_BITS = 4
"""Fewest subpixel bits that OpenGL allows (GL_SUBPIXEL_BITS): every rasterizer has at least so many."""

OFFSET_PRECISION = Precision(
    subpixel_bits=SUBPIXEL_BITS, depth=DepthFormat.D24, mapping=DepthMapping.STANDARD
)
"""Precision of a renderer with a near offset: the usual depth buffer."""

CENTERED_PRECISION = Precision(
    subpixel_bits=SUBPIXEL_BITS, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED
)
"""Precision of a renderer whose cameras stand in the aperture itself: its depth must hold any ratio of near
to far, which no buffer of fixed point does."""

NEAR_PLANE_PER_REACH = 1e-6
"""Near plane of a camera that stands in the aperture, as a part of the reach: such a camera has none, but
depths are stored relative to one."""


def foreign_cameras(scene: Scene, model: DrawnModel, aperture: Aperture) -> tuple[RoundingCamera, ...]:
    """Return C and C* of a renderer, which may have drawn any surface, and may clip at their films' borders.

    Parameters
    ----------
    scene
        Scene that the renderer draws.
    model
        How the renderer draws, as found.
    aperture
        Aperture of the scene that is drawn.
    """
    # One depth buffer serves both cameras: where one of them stands in the aperture, it holds any ratio.
    offset = all(model.camera(side).near for side in (1, -1))
    return tuple(
        RoundingCamera(
            pencil=_with_near_plane(scene, model, aperture, side),
            precision=OFFSET_PRECISION if offset else CENTERED_PRECISION,
            film_shift=model.camera(side).shift,
        )
        for side in (1, -1)
    )


def _with_near_plane(scene: Scene, model: DrawnModel, aperture: Aperture, side: int) -> Pencil:
    """Return the lines of C (side 1) or C* (side -1), which have a near plane even where near is 0."""
    pencil = model.pencil(scene, aperture, side)
    if model.camera(side).near:
        return pencil
    end = max(abs(s) for s in pencil.s_range)
    begin = NEAR_PLANE_PER_REACH * scene.frustum.longest_reach / model.scene_scale
    return replace(pencil, s_range=(begin, end) if side > 0 else (-end, -begin))
