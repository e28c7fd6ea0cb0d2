"""Outlines of meshes as they are seen from the side or from above."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw
from skimage.measure import approximate_polygon, find_contours

from xfrustum.compare.extent import triangles_in_chunks
from xfrustum.reports.scene_check.picture_frame import HEIGHT, WIDTH, PictureFrame, View
from xfrustum.scenes.model.scene import SceneObject

FINER = 2
"""Cells of the mask per pixel of the picture, in either direction."""

SMALL_CELLS = 1.0
"""Triangles no larger than this many cells are marked by their corners alone."""

TOLERANCE_CELLS = 0.7
"""How far an outline may be from the mask's own, which is a staircase of one cell."""

Outline = list[tuple[float, float]]


def outlines(part: SceneObject, frame: PictureFrame, view: View) -> list[Outline]:
    """Return closed outlines of an object within a frame, pixels from the frame's top left.

    Holes are outlines of their own, to be filled by the even-odd rule. Every triangle is projected; what is
    thinner than a cell of the mask is shown as thick as one.
    """
    size = int(FINER * WIDTH), int(FINER * HEIGHT)
    mask = Image.new("1", size)
    draw = ImageDraw.Draw(mask)
    small = np.zeros((size[1], size[0]), dtype=bool)
    for triangles in triangles_in_chunks(part):
        corners = frame.place(triangles[..., [2, view.axis]].reshape(-1, 2)).reshape(-1, 3, 2) * FINER
        low, high = corners.min(axis=1), corners.max(axis=1)
        within = ((high >= 0) & (low <= size)).all(axis=1)
        tiny = (high - low).max(axis=1) <= SMALL_CELLS
        columns, rows = corners[within & tiny].reshape(-1, 2).astype(np.int64).T
        inside = (columns >= 0) & (columns < size[0]) & (rows >= 0) & (rows < size[1])
        small[rows[inside], columns[inside]] = True
        # Pillow draws what it can hold; what is far outside is outside all the same.
        for triangle in np.clip(corners[within & ~tiny], -1e6, 1e6).reshape(-1, 6).tolist():
            draw.polygon(triangle, fill=1, outline=1)
    # A border, so that outlines that leave the frame are closed along it.
    filled = np.pad(small | np.asarray(mask), 1).astype(np.float64)
    found = []
    for contour in find_contours(filled, 0.5):
        rows_of, columns_of = approximate_polygon(contour, TOLERANCE_CELLS).T - 0.5
        found.append(list(zip((columns_of / FINER).tolist(), (rows_of / FINER).tolist(), strict=True)))
    return found
