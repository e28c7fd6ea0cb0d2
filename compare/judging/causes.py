"""Why a renderer whose settings are known still shows another triangle here and there.

The causes are those of our own rasterizer (`xfrustum.compare.attribution.explain`), with bounds that hold for
renderers whose precision nobody has stated.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.compare.rounding.clip_seams import distance_to_segments, seams
from xfrustum.compare.rounding.depth import depths
from xfrustum.compare.rounding.edges import covers, placement
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.arrays import Indices, Mask
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

SUBPIXEL_BITS = 4
"""Fewest that OpenGL allows (GL_SUBPIXEL_BITS): what may be asked of any rasterizer."""

SNAPPED_PX = math.sqrt(2) / 2 * 2.0**-SUBPIXEL_BITS
"""How far corners are moved that snap to the nearest subpixel: half a step of either coordinate."""

CAUSES = ("edge", "order", "lost", "unexplained")
"""The center lies on an edge to within rounding, be it one that clipping made; two surfaces lie closer in
depth than it is stored; a surface lies so close to the clear value; none of these."""

NO_NEAR = 1e-6
"""Stands for near 0, as a part of the reach, where depth is taken to be stored in 32 bits."""


def cause_masks(
    scene: Scene, model: DrawnModel, traced: HogelImage, image: HogelImage, wrong: Mask
) -> dict[str, Mask]:
    """Return which wrong pixels have which cause, (H, W) each.

    Parameters
    ----------
    scene
        What both show.
    model
        How the renderer draws, as found.
    traced
        What that makes exactly.
    image
        What the renderer showed, upright.
    wrong
        (H, W) pixels with different triangles.
    """
    rows, columns = np.nonzero(wrong)
    edge = _on_border(model, traced, columns, rows)
    possible = np.zeros((2, len(rows)), dtype=np.bool_)
    settings = _settings(scene, model)
    stored = []
    for index, shown in enumerate((traced, image)):
        numbers = shown.triangle[rows, columns]
        some = np.flatnonzero((numbers != NOTHING) & (numbers < len(scene.faces)))
        per_camera = []
        for side in (1, -1):
            pencil = _seen_by(scene, model, traced.camera.aperture, side)
            corners = scene.triangles[numbers[some]]
            pixels = (columns[some], rows[some])
            placed = placement(corners, pencil, pixels, SUBPIXEL_BITS, settings.mapping)
            edge[some] |= placed.near_edge
            possible[index, some] |= covers(corners, pencil, pixels) | placed.possible
            found = depths(corners, pencil, pixels, settings, SUBPIXEL_BITS)
            depth = np.full((3, len(rows)), np.nan)
            depth[:, some] = found.depth, found.tolerance, found.clear
            per_camera.append(depth)
        possible[index] |= numbers == NOTHING
        stored.append(np.stack(per_camera))
    with np.errstate(invalid="ignore"):
        close = np.abs(stored[0][:, 0] - stored[1][:, 0]) <= stored[0][:, 1] + stored[1][:, 1]
        cleared = np.abs(stored[0][:, 0] - stored[0][:, 2]) <= stored[0][:, 1]
    order = possible.all(axis=0) & close.any(axis=0) & ~edge
    lost = possible[1] & cleared.any(axis=0) & ~edge & ~order
    rest = ~(edge | order | lost)
    seam = np.flatnonzero(rest)
    seam = seam[_on_seams(scene, model, (traced, image), columns[seam], rows[seam])]
    edge[seam], rest[seam] = True, False
    masks = {name: np.zeros_like(wrong) for name in CAUSES}
    for name, mask in zip(CAUSES, (edge, order, lost, rest), strict=True):
        masks[name][rows[mask], columns[mask]] = True
    return masks


def causes(
    scene: Scene, model: DrawnModel, traced: HogelImage, image: HogelImage, wrong: Mask
) -> dict[str, int]:
    """Return how many wrong pixels have which cause; see `cause_masks`."""
    masks = cause_masks(scene, model, traced, image, wrong)
    return {name: int(mask.sum()) for name, mask in masks.items()}


def _on_border(model: DrawnModel, traced: HogelImage, columns: Indices, rows: Indices) -> Mask:
    """Return which pixels are sampled on the film's own border, where clipping cuts every triangle.

    Only shifted samples lie there: those of the outermost pixels, half a pixel from their centers.
    """
    width, height = traced.camera.resolution
    off = np.full(len(rows), np.inf)
    for place, extent in ((columns + 0.5 + model.shift[0], width), (rows + 0.5 + model.shift[1], height)):
        off = np.minimum(off, np.minimum(np.abs(place), np.abs(place - extent)))
    return np.asarray(off <= SNAPPED_PX)


def _on_seams(
    scene: Scene,
    model: DrawnModel,
    images: tuple[HogelImage, HogelImage],
    columns: Indices,
    rows: Indices,
) -> Mask:
    """Return which pixels are sampled where clipping may have split a triangle that either image shows."""
    points = np.stack((columns + 0.5 + model.shift[0], rows + 0.5 + model.shift[1]), axis=1)
    pencils = [_seen_by(scene, model, images[0].camera.aperture, side) for side in (1, -1)]
    found = np.zeros(len(points), dtype=np.bool_)
    for image in images:
        shown = image.triangle[rows, columns]
        for number in np.unique(shown[(shown != NOTHING) & (shown < len(scene.faces))]).tolist():
            here = shown == number
            for pencil in pencils:
                split = seams(scene.triangles[number], pencil, model.shift)
                found[here] |= distance_to_segments(points[here], split) <= SNAPPED_PX
    return found


def _settings(scene: Scene, model: DrawnModel) -> DoubleFrustum:
    near = model.near or NO_NEAR * scene.frustum.longest_reach
    if model.near:
        return DoubleFrustum(near=near)
    return DoubleFrustum(near=near, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED)


def _seen_by(scene: Scene, model: DrawnModel, aperture: Aperture, side: int) -> Pencil:
    """Return the lines of a camera; with a near plane, for depth, also where it has none."""
    pencil = model.pencil(scene, aperture, side)
    if model.near:
        return pencil
    end = max(abs(s) for s in pencil.s_range)
    begin = NO_NEAR * scene.frustum.longest_reach / model.scene_scale
    return replace(pencil, s_range=(begin, end) if side > 0 else (-end, -begin))
