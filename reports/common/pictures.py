"""Encoded pictures of truths, frames and errors, on the same scales everywhere.

Error maps take a `reduction`, the number of image pixels per picture pixel along each side; a
block shows its worst pixel.
"""

from __future__ import annotations

import io
import math
import zlib
from collections import deque
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from skimage.measure import block_reduce

from xfrustum.compare.prediction.predict import CULLING
from xfrustum.compare.rounding.triangles import (
    FLOAT32_ROUNDING,
    POSITION_ROUNDINGS,
    largest_tolerance,
)
from xfrustum.scenes import HogelImage
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.representation import LEVELS, encoding_curve

if TYPE_CHECKING:
    from xfrustum.compare.comparison import Comparison
    from xfrustum.scenes.model.scene import Scene

DISPLACEMENT_RANGE_PX = (1e-3, 1e2)
"""Ends of the logarithmic scale; the lower end is the resolution of 32-bit positions."""
LARGEST_HEIGHT_ERROR = 1e-2
"""Upper end of the logarithmic scale on both sides of zero, as a fraction of the longest reach."""
RADIANCE_RANGE = (1e-4, 1.0)
"""Ends of the logarithmic scale, linear radiance; the lower end is a fortieth of an 8-bit step."""
SURFACE_COLOR = "rgb(224, 49, 49)"
TRIANGLE_COLOR = "rgb(245, 135, 0)"
CAUSE_COLORS = {
    "near offset": "rgb(0,114,178)",
    "pivot": "rgb(86,180,233)",
    "fit": "rgb(204,121,167)",
    "slabs": "rgb(0,158,115)",
    CULLING: "rgb(90,90,90)",
    "rasterization": "rgb(230,159,0)",
    "depth": "rgb(213,94,0)",
}
"""Palette of Okabe and Ito, distinct for any color vision, and gray, in the order of links."""
UNEXPLAINED_COLOR = "rgb(255,0,255)"
"""Color of unexplained pixels, which are charged to rounding without a cause."""

#: number of latest frames whose pictures may be reused
KEPT_FRAMES = 3
_STEPS, _HEIGHT_STEPS = 40, 15
VIRIDIS = "440154 482878 3e4989 31688e 26828e 1f9e89 35b779 6ece58 b5de2b fde725"
INFERNO = "000004 1b0c41 4a0c6b 781c6d a52c60 cf4446 ed6925 fb9b06 f7d13d fcffa4"
BLUE_RED = "053061 2166ac 4393c3 92c5de d1e5f0 f7f7f7 fddbc7 f4a582 d6604d b2182b 67001f"
"""Colors of plotly's scales at equal distances, copied because plotly takes a second to load."""


def scale_colors(anchors: str, places: Floats) -> list[str]:
    """Return the colors of a scale at positions from 0 to 1, as CSS."""
    colors = np.array([list(bytes.fromhex(color)) for color in anchors.split()])
    ends = np.linspace(0, 1, len(colors))
    levels = np.stack([np.interp(places, ends, channel) for channel in colors.T], axis=1)
    return [f"rgb({red}, {green}, {blue})" for red, green, blue in np.rint(levels).astype(int)]


def rgb(color: str) -> tuple[int, ...]:
    """Return the levels of a color in CSS, such as `rgb(224, 49, 49)`."""
    return tuple(map(int, color.removeprefix("rgb(").removesuffix(")").split(",")))


DISPLACEMENT_SCALE = scale_colors(VIRIDIS, np.linspace(0, 1, _STEPS))
RADIANCE_SCALE = scale_colors(INFERNO, np.linspace(0.15, 1, _STEPS))
"""Colors of the scales of displacement and radiance errors, smallest first."""
HEIGHT_SCALE = scale_colors(BLUE_RED, np.linspace(0, 1, 2 * _HEIGHT_STEPS + 1))
"""Colors of the height scale, from farther (blue) to nearer (red)."""
_UNTEXTURED_GRAY = 0.4
_KEPT_BITS = 0b11111100
"""Mask that drops the last two bits of each channel: they are invisible but half of the file."""
_ENCODED = np.rint(LEVELS * encoding_curve(np.linspace(0, 1, 4097))).astype(np.uint8) & _KEPT_BITS
"""sRGB levels of linear values from 0 to 1, at most 0.8 of a level apart."""


def height_range(scene: Scene | None, reach: float) -> tuple[float, float]:
    """Return both ends of the scale of height errors, as fractions of the longest reach.

    Errors below the lower end are white. The lower end is the largest rounding error of a 32-bit
    surface point at the distance of the reach (`compare.rounding.triangles`), rounded up to 1, 2 or
    5 times a power of ten. With a scene, the distance is at least the scene's largest coordinate.
    """
    rounding = POSITION_ROUNDINGS * FLOAT32_ROUNDING
    if scene is not None:
        rounding = max(rounding, largest_tolerance(scene) / reach)
    power = math.floor(math.log10(rounding))
    low = next(end for digit in (1, 2, 5, 10) if (end := float(f"{digit}e{power}")) >= rounding)
    # A far vertex could make a scale of less than a decade: limit the lower end to a tenth of the
    # upper.
    return min(low, LARGEST_HEIGHT_ERROR / 10), LARGEST_HEIGHT_ERROR


class LatestPictures:
    """Encoded pictures of the latest frames, reused for equal frames.

    Different depth buffers of the same cameras often draw equal frames, with equal error maps.
    """

    def __init__(self) -> None:
        self._latest: deque[tuple[tuple[NDArray[Any] | None, ...], dict[str, bytes]]]
        self._latest = deque(maxlen=KEPT_FRAMES)

    def encode(
        self,
        comparison: Comparison,
        charge: NDArray[np.int8] | None,
        scale: tuple[float, tuple[float, float]],
        reduction: int,
    ) -> dict[str, bytes]:
        """Encode a raster image and its errors, by name.

        `charge` (H, W) is the index in `CAUSE_COLORS` of the link that makes a pixel wrong:
        negative at right pixels, and one past the last index at unexplained pixels; None without
        causes. `scale` has the longest reach in scene units, and the ends of a `height_range`.
        """
        errors, colors = comparison.errors, comparison.colors
        frame = errors.moved, charge, errors.raster.color
        for earlier, pictures in tuple(self._latest):
            if all(map(_equal, earlier, frame)):
                return pictures
        surface = np.zeros_like(errors.triangle) if errors.surface is None else errors.surface
        pictures = {
            "raster": picture(errors.raster, reduction),
            "displacement": displacement_map(errors.moved, reduction),
            "surface": mask(surface, SURFACE_COLOR, reduction),
            "triangle": mask(errors.triangle, TRIANGLE_COLOR, reduction),
            "height": height_map(errors.height, *scale, reduction),
        }
        if charge is not None:
            palette = [*CAUSE_COLORS.values(), UNEXPLAINED_COLOR]
            pictures["causes"] = class_map((charge + 1).astype(np.uint8), palette, reduction)
        if colors is not None:
            pictures["radiance"] = radiance_map(colors.error, reduction)
        self._latest.append((frame, pictures))
        return pictures


def _equal(mine: NDArray[Any] | None, its: NDArray[Any] | None) -> bool:
    return mine is its or (mine is not None and its is not None and np.array_equal(mine, its))


def picture(image: HogelImage, reduction: int = 1) -> bytes:
    """Encode the color image as WebP in sRGB, transparent where there is no surface."""
    share = image.covered.astype(np.float32)
    if image.color is None:
        linear = np.full((*share.shape, 3), _UNTEXTURED_GRAY, dtype=np.float32)
    else:
        # NaN is black.
        linear = np.fmax(image.color, 0.0)
        np.minimum(linear, 1.0, out=linear)
    if reduction > 1:
        block = (reduction, reduction)
        linear = block_reduce(linear * share[..., None], (*block, 1), np.mean)
        share = block_reduce(share, block, np.mean)
        linear /= np.where(share > 0, share, 1.0)[..., None]
    entries = linear * np.float32(len(_ENCODED) - 1) + np.float32(0.5)
    levels = _ENCODED.take(entries.astype(np.uint16))
    alpha = np.rint(LEVELS * share).astype(np.uint8)
    pixels = np.concatenate((levels, alpha[..., None]), axis=-1)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "WEBP", lossless=True, quality=0, method=0)
    return buffer.getvalue()


def displacement_map(length: Floats, reduction: int = 1) -> bytes:
    """Encode (H, W) lengths of displacements as PNG, transparent where undefined.

    The scale is logarithmic over `DISPLACEMENT_RANGE_PX`; values beyond its ends get the end
    colors.
    """

    def index(values: NDArray[np.floating]) -> Floats:
        level = np.floor(_level(values, DISPLACEMENT_RANGE_PX, _STEPS))
        return 1 + np.clip(level, 0, _STEPS - 1)

    return _error_map(length, index, DISPLACEMENT_SCALE, reduction)


def height_map(
    height: NDArray[np.floating], reach: float, heights: tuple[float, float], reduction: int = 1
) -> bytes:
    """Encode the signed (H, W) height error as PNG, transparent where undefined.

    Red is nearer to the viewer than the truth, blue farther; the scale is logarithmic between the
    ends of a `height_range`, in fractions of the reach.
    """

    def index(error: NDArray[np.floating]) -> Floats:
        level = np.clip(_level(np.abs(error) / reach, heights, _HEIGHT_STEPS), 0, _HEIGHT_STEPS)
        step: Floats = np.copysign(np.ceil(level), error)
        return 1 + _HEIGHT_STEPS + step

    return _error_map(height, index, HEIGHT_SCALE, reduction)


def radiance_map(error: NDArray[np.floating], reduction: int = 1) -> bytes:
    """Encode the size of the radiance error (H, W, 3) as PNG, by the worst channel.

    The scale is logarithmic over `RADIANCE_RANGE`; smaller errors and pixels that are not judged
    are transparent.
    """

    def index(size: NDArray[np.floating]) -> Floats:
        step: Floats = 1 + np.floor(_level(size, RADIANCE_RANGE, _STEPS))
        return step.clip(0, _STEPS)

    return _error_map(np.abs(error).max(axis=-1), index, RADIANCE_SCALE, reduction)


def mask(wrong: Mask, color: str, reduction: int = 1) -> bytes:
    """Encode an (H, W) mask as PNG: the color where it is set, transparent elsewhere."""
    return class_map(wrong.astype(np.uint8), [color], reduction)


def class_map(index: NDArray[np.uint8], colors: Sequence[str], reduction: int = 1) -> bytes:
    """Encode classes of pixels (H, W) as PNG: class 1 has the first color; 0 is transparent.

    A block shows its largest class number.
    """
    if reduction > 1:
        index = block_reduce(index, (reduction, reduction), np.max)
    encoded = Image.fromarray(index)
    encoded.putpalette(_palette(tuple(colors)))
    buffer = io.BytesIO()
    # The data are noise and long runs: searching only for runs makes files as small as compression
    # level 6, in a third of the time.
    encoded.save(buffer, "PNG", transparency=0, compress_type=zlib.Z_RLE)
    return buffer.getvalue()


# Parsing the colors takes as long as drawing with them.
@cache
def _palette(colors: tuple[str, ...]) -> bytes:
    return np.rint([(0, 0, 0), *(rgb(color) for color in colors)]).astype(np.uint8).tobytes()


def _error_map(
    error: NDArray[np.floating],
    index: Callable[[NDArray[np.floating]], Floats],
    colors: Sequence[str],
    reduction: int,
) -> bytes:
    """Encode errors (H, W) by positions on a scale of colors; undefined errors are transparent."""
    if reduction > 1:
        # The largest and the smallest error of each block, NaN where all are undefined.
        finite, block = np.where(np.isfinite(error), error, np.nan), (reduction, reduction)
        above, below = (
            block_reduce(finite, block, end.reduce, np.nan) for end in (np.fmax, np.fmin)
        )
        error = np.where(above >= -below, above, below)
    known = np.isfinite(error)
    shown = np.zeros(known.shape, dtype=np.uint8)
    shown[known] = index(error[known])
    return class_map(shown, colors)


def _level(values: NDArray[np.floating], ends: tuple[float, float], steps: int) -> Floats:
    """Return positions of values on a logarithmic scale, from 0 to `steps` at its ends."""
    low, high = np.log10(ends)
    with np.errstate(divide="ignore"):
        level: Floats = (np.log10(values) - low) / (high - low) * steps
    return level
