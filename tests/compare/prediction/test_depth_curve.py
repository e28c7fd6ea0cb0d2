"""The U: error against near falls with near-plane error, then rises with depth quantization."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum

NEARS = tuple(10.0**-e for e in (1, 2, 2.5, 3, 3.5, 4, 4.5, 5, 6, 7, 8))
"""Near offsets as fractions of the reach."""

DEPTHS = {
    "d16": (DepthFormat.D16, DepthMapping.STANDARD),
    "d24": (DepthFormat.D24, DepthMapping.STANDARD),
    "d24 reversed": (DepthFormat.D24, DepthMapping.REVERSED),
    "d32f": (DepthFormat.D32F, DepthMapping.STANDARD),
    "d32f reversed": (DepthFormat.D32F, DepthMapping.REVERSED),
}

SNAPPED_SURFACE = 1e-4
"""Vertices snap to 2^-8 px: of pixels along silhouettes, sqrt(2)/2 2^-8 to either side are in doubt, a share
of 0.0055 l / W for silhouettes of l image widths. Half of them flip; the car's are about 7 widths long."""
SNAPPED_TRIANGLE = 1e-3
"""Share of pixels in which snapping changes the triangle, as above: all visible edges are 40 widths long."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    surface: dict[float, float]
    triangle: dict[float, float]


@pytest.fixture(scope="module")
def curves() -> dict[str, Curve]:
    scene = view("car", (320, 320))
    reference = Reference(scene)
    truth = reference.trace(scene.plate.middle)
    found = {name: Curve(surface={}, triangle={}) for name in DEPTHS}
    with Rasterizer(scene) as raster:
        for name, (depth, mapping) in DEPTHS.items():
            for near in NEARS:
                settings = DoubleFrustum(
                    near=near * scene.frustum.longest_reach, depth=depth, mapping=mapping
                )
                drawn = raster.render(scene.plate.middle, settings, normals=False, color=False)
                judged = compare_images(truth, drawn, reference).summary()
                # What belongs outside the film is wrong from half a pixel of displacement on.
                surface = judged["surface"]
                inside = surface["wrong"] - surface["outside"]
                found[name].surface[near] = inside / judged["judged"]
                found[name].triangle[near] = judged["triangle"]["fraction"]
    return found


def slope(curve: dict[float, float], largest: float, smallest: float) -> float:
    """Return the power of near by which an error falls, fitted between two nears."""
    nears = [near for near in curve if smallest * 0.999 <= near <= largest * 1.001]
    errors = [curve[near] for near in nears]
    return float(np.polyfit(np.log(nears), np.log(errors), 1)[0])


@pytest.mark.parametrize("depth", ["d24", "d24 reversed", "d32f", "d32f reversed"])
def test_near_plane_error_is_proportional_to_near(curves: dict[str, Curve], depth: str) -> None:
    curve = curves[depth]
    assert slope(curve.surface, 1e-2, 1e-4) == pytest.approx(1, abs=0.1)
    # At 1e-2 half the pixels show another triangle already: the curve levels off above.
    assert slope(curve.triangle, 1e-3, 1e-5) == pytest.approx(1, abs=0.1)


def test_the_falling_branch_does_not_depend_on_the_depth_format(curves: dict[str, Curve]) -> None:
    for near in (1e-1, 1e-2, 1e-3):
        values = [curve.surface[near] for curve in curves.values()]
        assert max(values) < 1.1 * min(values)


@pytest.mark.parametrize(("depth", "bottom", "top"), [("d16", 1e-4, 0.5), ("d24", 1e-5, 0.05)])
def test_fixed_point_depth_rises_again(
    curves: dict[str, Curve], depth: str, bottom: float, top: float
) -> None:
    surface = curves[depth].surface
    best = min(surface, key=lambda near: surface[near])
    assert bottom / 4 < best < bottom * 4
    rising = [surface[near] for near in sorted(surface) if near <= best]
    assert rising[0] > top
    assert all(smaller >= larger for smaller, larger in pairwise(rising))
    # Resolution n 2^b in w: ten times smaller near, about ten times more lost or swapped.
    if depth == "d24":
        assert 5 < surface[1e-7] / surface[1e-6] < 20


def test_formats_differ_in_where_the_curve_rises(curves: dict[str, Curve]) -> None:
    """Fewer bits rise sooner; fixed point gains little by reversing, for it has equal steps: only rounding
    before the last step is better. Float gains nothing unless it is reversed, and then stays flat."""
    assert curves["d16"].surface[1e-6] > 20 * curves["d24"].surface[1e-6]
    assert curves["d24 reversed"].surface[1e-8] > 0.05
    flat = curves["d32f reversed"]
    for near in (1e-6, 1e-7, 1e-8):
        assert curves["d32f"].surface[near] == pytest.approx(curves["d24"].surface[near], rel=0.5)
        assert flat.surface[near] < SNAPPED_SURFACE and flat.triangle[near] < SNAPPED_TRIANGLE
    assert min(flat.triangle.values()) > 0.5 * flat.triangle[1e-8]
