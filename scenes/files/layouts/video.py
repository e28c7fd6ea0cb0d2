"""Rows of hogels as videos, through PyAV.

PyAV is an optional part of the installation (`xfrustum[video]`) and is imported only here.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.scenes.disk.input_files import check_declared, regular_size
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.layouts.layout import Pixels
from xfrustum.scenes.files.layouts.picture_files import Picture

LOSSLESS_CODECS = ("ffv1", "huffyuv", "ffvhuff", "rawvideo", "png", "utvideo", "magicyuv", "qtrle")
"""FFmpeg's names of codecs that keep every bit of RGB pictures."""

RGB_FORMATS = ("rgb24", "bgr24", "bgr0", "rgb0", "bgra", "rgba", "gbrp", "pal8")
"""FFmpeg's names of pixel formats that hold 8 bits each of red, green and blue, without subsampling."""


def _av() -> Any:
    try:
        return import_module("av")
    except ImportError as error:
        raise InputError(
            "videos need the package av, which is not installed: pip install '.[video]' in the checkout "
            "of xfrustum, or convert the videos to pictures"
        ) from error


def video_size(path: Path) -> tuple[int, tuple[int, int]]:
    """Return the number of frames of a video, and their width and height in pixels.

    Raises
    ------
    InputError
        The file is missing or damaged, or PyAV is not installed.
    """
    av = _av()
    regular_size(path, "video")
    try:
        with av.open(str(path)) as video:
            stream = video.streams.video[0]
            # The header of some videos does not say how many frames there are.
            frames = stream.frames or sum(1 for _ in video.decode(stream))
            return frames, (stream.width, stream.height)
    except (av.FFmpegError, IndexError, ValueError) as error:
        raise InputError(f"{path}: is not a video that can be read ({error})") from error


def read_video(path: Path) -> Picture:
    """Read all frames of a video as (frames, H, W, 3) uint8.

    Raises
    ------
    InputError
        The file is missing or damaged, or PyAV is not installed.
    """
    av = _av()
    frames, (width, height) = video_size(path)
    check_declared(path, 3 * frames * width * height, f"{frames} frames of {width} x {height} pixels")
    try:
        with av.open(str(path)) as video:
            stream = video.streams.video[0]
            context = stream.codec_context
            lossy = context.name not in LOSSLESS_CODECS or context.pix_fmt not in RGB_FORMATS
            pixels = [frame.to_ndarray(format="rgb24") for frame in video.decode(stream)]
    except (av.FFmpegError, IndexError, ValueError) as error:
        raise InputError(f"{path}: the video is damaged ({error})") from error
    if not pixels:
        raise InputError(f"{path}: the video has no frame")
    return Picture(pixels=np.stack(pixels), lossy=lossy)


def write_video(path: Path, frames: Pixels) -> None:
    """Write (frames, H, W, 3) uint8 pixels as a video that keeps every bit (FFV1 in AVI).

    Raises
    ------
    InputError
        PyAV is not installed.
    OSError
        The file cannot be written.
    """
    av = _av()
    with av.open(str(path), "w", format="avi") as video:
        stream = video.add_stream("ffv1", rate=25)
        stream.height, stream.width = frames.shape[1:3]
        stream.pix_fmt = "bgr0"
        for pixels in frames:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
            video.mux(stream.encode(frame))
        video.mux(stream.encode(None))
