"""Why does the rasterizer show another triangle than its own cameras, traced exactly?

Rasterizing adds three things to the exact lines of C and C*: vertices are rounded (to float32,
then to the subpixel grid), depth is rounded (to float32, then to the format), and the depth
buffer starts at a clear value that a surface must beat. Each leaves its mark (docs/method.md):

* edge: the pixel's center lies within those roundings of an edge of one of the two triangles,
  or of a cut by the near plane or the reach;
* order: both triangles cover the pixel, and are closer in stored depth than its roundings;
* lost: the surface is closer to the clear value than that, and what is shown covers the pixel.

What bears no mark is unexplained: somebody's bug.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.compare.rounding.depth import Depths, depths
from xfrustum.compare.rounding.edges import covers, placement
from xfrustum.reference.lines.lines import model_cameras
from xfrustum.scenes.arrays import Indices, Mask
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """Pixels where raster and model show different triangles, each under one heading.

    Attributes
    ----------
    edge, order, lost, unexplained
        (H, W) masks that exclude each other.
    """

    edge: Mask
    order: Mask
    lost: Mask
    unexplained: Mask

    def counts(self) -> dict[str, int]:
        """Return the number of pixels under each heading."""
        return {name: int(getattr(self, name).sum()) for name in ("edge", "order", "lost", "unexplained")}

    def within(self, pixels: Mask) -> Explanation:
        """Return the explanation of some pixels."""
        return Explanation(**{name: mask & pixels for name, mask in vars(self).items()})

    def joined(self, other: Explanation) -> Explanation:
        """Return the explanation of these pixels and of others."""
        return Explanation(**{name: mask | getattr(other, name) for name, mask in vars(self).items()})


def explain(scene: Scene, model: HogelImage, raster: HogelImage, subpixel_bits: int) -> Explanation:
    """Explain every pixel where the raster shows another triangle than the traced model.

    Parameters
    ----------
    scene
        What both show.
    model
        Of `Reference.trace_model` with the raster's settings; or a raster image with another depth
        buffer, to explain what depth alone has changed.
    raster
        Its camera carries the settings it was drawn with.
    subpixel_bits
        Of the device that drew it.
    """
    settings = raster.camera.settings
    assert settings is not None
    # Ties of the model need no exception: they lie on an edge, or at one depth.
    wrong = model.triangle != raster.triangle
    rows, columns = np.nonzero(wrong)
    cameras = model_cameras(scene.frustum, raster.camera.aperture, settings)

    edge = np.zeros(len(rows), dtype=np.bool_)
    # A depth test chooses only among triangles that cover the pixel: on the model's side they do.
    at_choice = raster.triangle[rows, columns] == NOTHING
    shown_by: list[tuple[Indices, Depths]] = []
    for image in (model, raster):
        triangle = image.triangle[rows, columns]
        height = image.height[rows, columns]
        shown, camera_of = Depths.nothing(len(rows)), np.full(len(rows), -1)
        # What lies in a cut may have been drawn by the cameras on either side of it.
        for number, camera in enumerate(cameras):
            low, high = camera.heights
            some = np.flatnonzero((triangle != NOTHING) & (height >= low) & (height <= high))
            corners = scene.triangles[triangle[some]]
            pixels = (columns[some], rows[some])
            placed = placement(corners, camera.pencil, pixels, subpixel_bits, settings.mapping)
            edge[some] |= placed.near_edge
            if image is raster:
                at_choice[some] |= covers(corners, camera.pencil, pixels)
            shown.put(some, depths(corners, camera.pencil, pixels, settings, subpixel_bits))
            camera_of[some] = number
        shown_by.append((camera_of, shown))

    (expected_by, expected), (drawn_by, drawn) = shown_by
    order = at_choice & (expected_by == drawn_by) & expected.indistinguishable_from(drawn)
    lost = at_choice & expected.lost()
    return Explanation(
        edge=_scatter(wrong, edge),
        order=_scatter(wrong, order & ~edge),
        lost=_scatter(wrong, lost & ~order & ~edge),
        unexplained=_scatter(wrong, ~(edge | order | lost)),
    )


def misplaced(scene: Scene, raster: HogelImage, subpixel_bits: int) -> Mask:
    """Return the pixels whose centers the triangles drawn there do not reach, (H, W).

    Surface points of the raster are computed on the drawn triangle, for the pixel's center
    (docs/adr/0005): this is the other half of the measurement, that the triangle was drawn
    where its camera puts it.

    Parameters
    ----------
    scene, raster
        What was drawn, by which settings.
    subpixel_bits
        Of the device that drew it.
    """
    settings = raster.camera.settings
    assert settings is not None
    rows, columns = np.nonzero(raster.triangle != NOTHING)
    height = raster.height[rows, columns]
    possible = np.zeros(len(rows), dtype=np.bool_)
    for camera in model_cameras(scene.frustum, raster.camera.aperture, settings):
        low, high = camera.heights
        some = np.flatnonzero((height >= low) & (height <= high))
        corners = scene.triangles[raster.triangle[rows[some], columns[some]]]
        pixels = (columns[some], rows[some])
        possible[some] |= placement(corners, camera.pencil, pixels, subpixel_bits, settings.mapping).possible
    mask = np.zeros(raster.triangle.shape, dtype=np.bool_)
    mask[rows, columns] = ~possible
    return mask


def _scatter(where: Mask, values: Mask) -> Mask:
    mask = np.zeros_like(where)
    mask[where] = values
    return mask
