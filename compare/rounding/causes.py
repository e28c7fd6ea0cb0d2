"""The one classifier of causes: edge, order, lost, or unexplained.

A picture may show another triangle at a pixel than exact cameras do, because rasterizing adds three things to
exact lines: vertices are rounded (to float32, then to the subpixel grid), depth is rounded (to float32, then
to the format), and the depth buffer starts at a clear value that a surface must beat. Each leaves its mark
(docs/method.md):

* edge: the pixel's center lies within those roundings of an edge of one of the two triangles, or of an edge
  that clipping makes: a cut by the near plane or the reach, the film's border, a seam;
* order: both triangles cover the pixel, and their stored depths differ by less than the roundings of depth;
* lost: the stored depth of the expected surface differs by less than that from the clear value, and what is
  shown covers the pixel.

A pixel that bears no mark is unexplained: somebody's bug. The classifier knows nothing of settings or of
models of renderers. It takes cameras; `xfrustum.compare.attribution.explain` makes them for our rasterizer,
`xfrustum.compare.judging.foreign_cameras` for somebody else's renderer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.rounding.cameras import RoundingCamera
from xfrustum.compare.rounding.clip_seams import distance_to_border, distance_to_segments, seams
from xfrustum.compare.rounding.depth import Depths, depths
from xfrustum.compare.rounding.edges import PixelIndex, PixelTriangles, placement
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.notebook.shown import Brief


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Causes(Brief):
    """Pixels that show another triangle than expected, each under one heading.

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
        return {name: int(mask.sum()) for name, mask in vars(self).items()}

    def within(self, pixels: Mask) -> Causes:
        """Return the causes of some of the pixels."""
        return Causes(**{name: mask & pixels for name, mask in vars(self).items()})

    def joined(self, other: Causes) -> Causes:
        """Return the causes of these pixels and of others."""
        return Causes(**{name: mask | getattr(other, name) for name, mask in vars(self).items()})


def find_causes(
    triangles: Floats,
    cameras: Sequence[RoundingCamera],
    expected: HogelImage,
    shown: HogelImage,
    wrong: Mask,
) -> Causes:
    """Find the cause of every wrong pixel.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners of the scene's triangles.
    cameras
        All cameras that may have drawn the picture.
    expected
        What the cameras show without rounding, or with another depth buffer. Its ties need no exception:
        they lie on an edge, or at one depth.
    shown
        The picture. It may name triangles that the scene does not have.
    wrong
        (H, W) pixels at which the two name different triangles.
    """
    rows, columns = np.nonzero(wrong)
    if not len(rows):
        return Causes(**{name: np.zeros_like(wrong) for name in ("edge", "order", "lost", "unexplained")})
    pixels = (columns, rows)
    before, after = (_marks(triangles, cameras, image, pixels) for image in (expected, shown))
    edge = before.near_edge | after.near_edge | _near_border(cameras, pixels)
    # A depth test chooses only among triangles that cover the pixel. Centers that only rounding brings inside
    # a triangle are near its edge, and have their cause already.
    chosen = np.flatnonzero(before.possible & after.possible & ~edge)
    order, lost = np.zeros_like(edge), np.zeros_like(edge)
    if len(chosen):
        places = (columns[chosen], rows[chosen])
        stored = (_stored(triangles, cameras, image, places) for image in (expected, shown))
        both = list(zip(*stored, strict=True))
        order[chosen] = _any(one.indistinguishable_from(other) for one, other in both)
        lost[chosen] = _any(one.lost() for one, _ in both)
        lost &= ~order
    # Seams take long to find, and are looked for where nothing else explains the pixel.
    rest = np.flatnonzero(~(edge | order | lost))
    edge[rest] = _near_seam(triangles, cameras, (expected, shown), (columns[rest], rows[rest]))
    found = {"edge": edge, "order": order, "lost": lost, "unexplained": ~(edge | order | lost)}
    return Causes(**{name: _scattered(wrong, values) for name, values in found.items()})


def misplaced_pixels(triangles: Floats, cameras: Sequence[RoundingCamera], shown: HogelImage) -> Mask:
    """Return the pixels (H, W) whose centers lie outside the triangles shown there, by more than rounding."""
    where: Mask = np.not_equal(shown.triangle, NOTHING)
    rows, columns = np.nonzero(where)
    possible = np.zeros(len(rows), dtype=np.bool_)
    for part in _drawn_by(triangles, cameras, shown, (columns, rows)):
        placed = placement(part.shown, part.camera.pencil, part.camera.precision)
        possible[part.places] |= placed.possible
    return _scattered(where, ~possible)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Part:
    """Pixels that one camera may have drawn: their places in a list of pixels, and one triangle each."""

    camera: RoundingCamera
    places: Indices
    shown: PixelTriangles


def _drawn_by(
    triangles: Floats, cameras: Sequence[RoundingCamera], image: HogelImage, pixels: PixelIndex
) -> Iterator[_Part]:
    """Yield for each camera the pixels whose triangle it may have drawn.

    A surface that lies in a cut between two slabs may have been drawn by the cameras on either side of it.
    """
    columns, rows = pixels
    number, height = image.triangle[rows, columns], image.height[rows, columns]
    exists = (number != NOTHING) & (number < len(triangles))
    for camera in cameras:
        places = np.flatnonzero(exists & camera.may_draw(height))
        yield _Part(
            camera=camera,
            places=places,
            shown=PixelTriangles.of(triangles, number[places], (columns[places], rows[places])),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Marks:
    """Marks of rounding of the triangles that an image shows at N pixels.

    Attributes
    ----------
    near_edge
        (N,) rounding may have put the pixel's center on the wrong side of an edge.
    possible
        (N,) the pixel shows nothing, or a triangle within whose rounded edges its center lies.
    """

    near_edge: Mask
    possible: Mask


def _marks(
    triangles: Floats, cameras: Sequence[RoundingCamera], image: HogelImage, pixels: PixelIndex
) -> _Marks:
    columns, rows = pixels
    near_edge = np.zeros(len(rows), dtype=np.bool_)
    possible = image.triangle[rows, columns] == NOTHING
    for part in _drawn_by(triangles, cameras, image, pixels):
        if not len(part.places):
            continue
        placed = placement(part.shown, part.camera.pencil, part.camera.precision)
        near_edge[part.places] |= placed.near_edge
        possible[part.places] |= placed.possible
    return _Marks(near_edge=near_edge, possible=possible)


def _stored(
    triangles: Floats, cameras: Sequence[RoundingCamera], image: HogelImage, pixels: PixelIndex
) -> list[Depths]:
    """Return the depths (N,) that an image's triangles have at pixels in the buffer of each camera."""
    return [
        depths(part.shown, part.camera.pencil, part.camera.precision).at(part.places, len(pixels[0]))
        for part in _drawn_by(triangles, cameras, image, pixels)
    ]


def _near_border(cameras: Sequence[RoundingCamera], pixels: PixelIndex) -> Mask:
    """Return which pixels are sampled on the film's own border, where clipping cuts every triangle.

    Only shifted samples lie there: those of the outermost pixels, half a pixel from their centers.
    """
    near = np.zeros(len(pixels[0]), dtype=np.bool_)
    for camera in cameras:
        if camera.film_shift is not None:
            points = _sampled(pixels, camera.film_shift)
            near |= distance_to_border(points, camera.pencil.resolution) <= camera.precision.snap_px
    return near


def _near_seam(
    triangles: Floats, cameras: Sequence[RoundingCamera], images: Sequence[HogelImage], pixels: PixelIndex
) -> Mask:
    """Return which pixels are sampled where clipping may have split a triangle that either image shows."""
    columns, rows = pixels
    near = np.zeros(len(rows), dtype=np.bool_)
    for camera in cameras:
        if camera.film_shift is None:
            continue
        points = _sampled(pixels, camera.film_shift)
        for image in images:
            shown = image.triangle[rows, columns]
            for number in np.unique(shown[(shown != NOTHING) & (shown < len(triangles))]).tolist():
                here = shown == number
                split = seams(triangles[number], camera.pencil, camera.film_shift)
                near[here] |= distance_to_segments(points[here], split) <= camera.precision.snap_px
    return near


def _sampled(pixels: PixelIndex, shift: tuple[float, float]) -> Floats:
    """Return where pixels are sampled, (N, 2) in pixels from the film's left and upper border."""
    columns, rows = pixels
    return np.stack((columns + 0.5 + shift[0], rows + 0.5 + shift[1]), axis=1)


def _any(masks: Iterator[Mask]) -> Mask:
    return np.asarray(np.logical_or.reduce(list(masks)))


def _scattered(where: Mask, values: Mask) -> Mask:
    """Return values (N,) of the pixels where a mask (H, W) is true, as a mask of all pixels."""
    mask = np.zeros_like(where)
    mask[where] = values
    return mask
