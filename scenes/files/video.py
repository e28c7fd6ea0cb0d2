"""Rows of hogels as videos, through PyAV.

PyAV is an optional part of the installation (`xfrustum[video]`) and is imported only here.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.scenes.disk.input_files import check_allowed, check_declared, regular_size
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.layouts import Pixels
from xfrustum.scenes.files.pictures import Picture

#: FFmpeg's names of codecs that keep every bit of RGB pictures.
LOSSLESS_CODECS = ("ffv1", "huffyuv", "ffvhuff", "rawvideo", "png", "utvideo", "magicyuv", "qtrle")
#: FFmpeg's names of pixel formats that hold 8 bits each of red, green and blue, without subsampling.
RGB_FORMATS = ("rgb24", "bgr24", "bgr0", "rgb0", "bgra", "rgba", "gbrp", "pal8")
#: Bytes of memory that a decoder takes for each pixel of a frame: it keeps some frames of 4 bytes a pixel.
DECODER_BYTES_PER_PIXEL = 64

PADDING_PX = 512  # pixels by which decoders may enlarge a frame's sides for themselves


def _av() -> Any:
    try:
        return import_module("av")
    except ImportError as error:
        raise InputError(
            "videos need the package av, which is not installed: pip install '.[video]' in the checkout "
            "of xfrustum, or convert the videos to pictures"
        ) from error


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """Open a video and its first stream of pictures; FFmpeg's errors become InputErrors."""
    av = _av()
    regular_size(path, "video")
    try:
        with av.open(str(path)) as video:
            stream = video.streams.video[0]
            if stream.codec_context is None:
                raise ValueError("its codec is not known")
            width, height = stream.width, stream.height
            size = DECODER_BYTES_PER_PIXEL * width * height
            check_allowed(path, size, f"a frame of {width} x {height} pixels")
            # A frame may state another size than the file: FFmpeg refuses it before it allocates.
            most = (width + PADDING_PX) * (height + PADDING_PX)
            stream.codec_context.options = {"max_pixels": str(most)}
            stream.codec_context.thread_count = 1
            yield video, stream
    except (av.FFmpegError, IndexError, ValueError) as error:
        raise InputError(f"{path}: is not a video that can be read ({error})") from error


def video_size(path: Path) -> tuple[int, tuple[int, int]]:
    """Return the number of frames of a video, and their width and height; InputError as from `read_video`."""
    with _opened(path) as (video, stream):
        # The header of some videos does not say how many frames there are.
        frames = stream.frames or sum(packet.size > 0 for packet in video.demux(stream))
        return max(1, frames), (stream.width, stream.height)


def read_video(path: Path, frames: int, size: tuple[int, int]) -> Picture:
    """Read the frames of a video as (frames, H, W, 3) uint8; decoding stops at the first that is too many.

    Raises InputError where the file is missing or damaged, has another number of frames (the columns of the
    plate) or another width and height, or PyAV is not installed.
    """
    width, height = size
    check_declared(path, 3 * frames * width * height, f"{frames} frames of {width} x {height} pixels")
    with _opened(path) as (video, stream):
        pixels, count = np.empty((frames, height, width, 3), np.uint8), 0
        for frame in video.decode(stream):
            found = frame.width, frame.height
            if found != size:
                raise InputError(f"{path}: is {found[0]} x {found[1]}, and should be {width} x {height}")
            if count == frames:
                raise InputError(f"{path}: has more than {frames} frames, the columns of the plate")
            pixels[count] = frame.to_ndarray(format="rgb24")
            count += 1
        if count < frames:
            raise InputError(f"{path}: has {count} frames, and the plate {frames} columns")
        context = stream.codec_context
        lossy = context.name not in LOSSLESS_CODECS or context.pix_fmt not in RGB_FORMATS
    return Picture(pixels=pixels, lossy=lossy)


def write_video(path: Path, frames: Pixels) -> None:
    """Write (frames, H, W, 3) uint8 pixels as a video that keeps every bit (FFV1 in AVI)."""
    av = _av()
    with av.open(str(path), "w", format="avi") as video:
        stream = video.add_stream("ffv1", rate=25)
        stream.height, stream.width = frames.shape[1:3]
        stream.pix_fmt = "bgr0"
        for pixels in frames:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
            video.mux(stream.encode(frame))
        video.mux(stream.encode(None))
