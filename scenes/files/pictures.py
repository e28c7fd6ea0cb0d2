"""Pictures, videos (by PyAV, the optional `xfrustum[video]`) and environment maps, to the last bit."""

import io
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, UnidentifiedImageError
from PIL.PngImagePlugin import PngInfo

from xfrustum.scenes.appearance.appearance import Environment
from xfrustum.scenes.arrays import Bytes, Singles
from xfrustum.scenes.disk import input_files
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.exr import MAGIC, image_size, read_rgb_channels, write_planes
from xfrustum.scenes.files.layouts import Pixels

PLENO_LEVELS = (
    1023  # largest level of the 10-bit pictures that JPEG Pleno's test conditions ask for
)
BYTE_LEVELS = 255  # largest level of 8-bit pictures
#: Keyword of the text in a PNG file that says how a single picture is divided, as a JSON object.
TEXT_KEY = "xfrustum:layout"
#: Content of the chunk gAMA of a PNG file whose pixels are linear: an exponent of 1, in 1 /
#: 100,000.
LINEAR_GAMMA = (100_000).to_bytes(4, "big")
#: Pillow's names of formats that change pixels; WebP and others may, but need not.
LOSSY_FORMATS = ("JPEG", "MPO", "JPEG2000")
#: Pillow's names of kinds of pixels that are red, green and blue of 8 bits, or become these
#: unchanged.
RGB_MODES = ("RGB", "RGBA", "P", "L", "1")
#: Header of a binary PPM file: width, height, largest level.
_P6_HEADER = re.compile(rb"P6\s+(?:#[^\n]*\n\s*)*(\d+)\s+(\d+)\s+(\d+)\s")
#: Exceptions by which Pillow says that a file is no picture, or is damaged.
_DAMAGE = (OSError, SyntaxError, ValueError, Image.DecompressionBombError)


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """A picture as its file stores it, row 0 at the top."""

    pixels: Pixels  #: (H, W, 3); (frames, H, W, 3) of a video
    levels: int | None = (
        BYTE_LEVELS  #: the largest level of integers; None of floating-point numbers
    )
    lossy: str = ""  #: name of the file's format where it changes pixels, such as "JPEG"
    linear: bool = False  #: whether a PNG file states that its pixels are linear radiance


def picture_size(path: Path) -> tuple[int, int]:
    """Return the width and height of a picture file in pixels; InputError where it is missing or none."""
    head = input_files.head_of(path, "file")
    if head.startswith(MAGIC):
        return image_size(path)
    if ppm := _P6_HEADER.match(head):
        return int(ppm[1]), int(ppm[2])
    try:
        with input_files.open_input(path, "file") as file, Image.open(file) as picture:
            return picture.size
    except _DAMAGE as error:
        raise InputError(f"{path}: is not a picture that can be read") from error


def picture_text(path: Path) -> dict[str, object]:
    """Return what a PNG file says of its own division; empty where it says nothing."""
    try:
        with input_files.open_input(path, "file") as file, Image.open(file) as picture:
            told = json.loads(getattr(picture, "text", {}).get(TEXT_KEY, "{}"))
    except (*_DAMAGE, RecursionError):
        return {}
    return told if isinstance(told, dict) else {}


def read_picture(path: Path) -> Picture:
    """Read PNG and the like with 8 bits, PPM with up to 16, or OpenEXR; InputError where it is none."""
    head = input_files.head_of(path, "file")
    if head.startswith(MAGIC):
        pixels, read = read_rgb_channels(path, "only pictures in R, G and B are re-arranged")
        half, lossy = pixels.dtype == np.float16, read.lossy("R")
        floats = pixels if half else pixels.astype(np.float32)
        return Picture(pixels=floats, levels=None, lossy=f"OpenEXR {lossy}" if lossy else "")
    if not _P6_HEADER.match(head):
        rgb, lossy = read_rgb(path)
        return Picture(pixels=rgb, lossy=lossy)
    content = input_files.read_input(path, "file")
    found = _P6_HEADER.match(content)
    assert found is not None
    width, height, levels = (int(number) for number in found.groups())
    if not 0 < levels < 1 << 16:
        raise InputError(f"{path}: the image is damaged (largest level {levels})")
    dtype = np.dtype(">u2" if levels > BYTE_LEVELS else np.uint8)
    if len(content) - found.end() < 3 * width * height * dtype.itemsize:
        raise InputError(f"{path}: the image is damaged (it ends too early)")
    stored = np.frombuffer(content, dtype, count=3 * width * height, offset=found.end())
    native = stored.astype(dtype.newbyteorder("="))
    if native.max(initial=0) > levels:
        raise InputError(f"{path}: the image is damaged (a level lies above {levels})")
    return Picture(pixels=native.reshape(height, width, 3), levels=levels)


def write_picture(path: Path, picture: Picture, text: dict[str, object] | None = None) -> None:
    """Write a picture in the format of the suffix: .png (8 bits), .ppm (8 to 16) or .exr (floating point).

    PNG files state the text, the division of the picture. Raises InputError where the format cannot
    hold it, OSError where the file cannot be written.
    """
    suffix, pixels = path.suffix.lower(), np.array(picture.pixels, order="C")
    if suffix == ".png" and pixels.dtype == np.uint8:
        info, buffer = PngInfo(), io.BytesIO()
        if text:
            info.add_text(TEXT_KEY, json.dumps(text))
        if picture.linear:
            info.add(b"gAMA", LINEAR_GAMMA)
        Image.fromarray(pixels).save(buffer, "PNG", pnginfo=info)
        path.write_bytes(buffer.getvalue())
    elif suffix == ".ppm" and picture.levels is not None:
        height, width = pixels.shape[:2]
        stored = pixels.astype(">u2" if picture.levels > BYTE_LEVELS else np.uint8)
        path.write_bytes(f"P6\n{width} {height}\n{picture.levels}\n".encode() + stored.tobytes())
    elif suffix == ".exr" and picture.levels is None:
        write_planes(path, {name: pixels[..., channel] for channel, name in enumerate("RGB")})
    else:
        raise InputError(
            f"{path}: cannot hold {pixels.dtype.name}; .png holds 8 bits, .ppm integers, .exr floating point"
        )


def read_rgb(path: Path, resolution: tuple[int, int] | None = None) -> tuple[Bytes, str]:
    """Return the pixels (H, W, 3) of a picture, and the name of its format if that changes pixels, else "".

    Raises InputError where the file is damaged, no picture of `RGB_MODES`, or not of the scene's
    resolution.
    """
    try:
        with (
            input_files.bounded_memory(path),
            input_files.open_input(path, "file") as file,
            Image.open(file) as picture,
        ):
            if resolution is not None and picture.size != resolution:
                found, said = (" x ".join(map(str, size)) for size in (picture.size, resolution))
                raise InputError(f"{path}: is {found}, but the scene says {said}")
            input_files.check_picture_size(path, *picture.size)
            if picture.mode not in RGB_MODES:
                raise InputError(
                    f"{path}: has mode {picture.mode}; write 8 bits each of red, green and blue"
                )
            kind = picture.format if picture.format in LOSSY_FORMATS else None
            # A file of several JPEG pictures.
            return np.asarray(picture.convert("RGB")), "JPEG" if kind == "MPO" else kind or ""
    except UnidentifiedImageError as error:
        raise InputError(f"{path}: is not an image that can be read") from error
    except _DAMAGE as error:
        raise InputError(f"{path}: the image is damaged ({error})") from error


# Videos

#: FFmpeg's names of codecs that keep every bit of RGB pictures.
LOSSLESS_CODECS = ("ffv1", "huffyuv", "ffvhuff", "rawvideo", "png", "utvideo", "magicyuv", "qtrle")
#: FFmpeg's names of pixel formats that hold 8 bits each of red, green and blue, without
#: subsampling.
RGB_FORMATS = ("rgb24", "bgr24", "bgr0", "rgb0", "bgra", "rgba", "gbrp", "pal8")
#: Bytes of memory that a decoder takes for each pixel of a frame: it keeps some frames of 4 bytes a
#: pixel.
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
    input_files.regular_size(path, "video")
    try:
        with av.open(str(path)) as video:
            stream = video.streams.video[0]
            if stream.codec_context is None:
                raise ValueError("its codec is not known")
            width, height = stream.width, stream.height
            size = DECODER_BYTES_PER_PIXEL * width * height
            input_files.check_allowed(path, size, f"a frame of {width} x {height} pixels")
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

    Raises InputError where the file is missing, damaged or of another shape, or PyAV is not
    installed.
    """
    width, height = size
    input_files.check_declared(
        path, 3 * frames * width * height, f"{frames} frames of {width} x {height} pixels"
    )
    with _opened(path) as (video, stream):
        pixels, count = np.empty((frames, height, width, 3), np.uint8), 0
        for frame in video.decode(stream):
            found = frame.width, frame.height
            if found != size:
                raise InputError(
                    f"{path}: is {found[0]} x {found[1]}, and should be {width} x {height}"
                )
            if count == frames:
                raise InputError(f"{path}: has more than {frames} frames, the columns of the plate")
            pixels[count] = frame.to_ndarray(format="rgb24")
            count += 1
        if count < frames:
            raise InputError(f"{path}: has {count} frames, and the plate {frames} columns")
        context = stream.codec_context
        lossless = context.name in LOSSLESS_CODECS and context.pix_fmt in RGB_FORMATS
        lossy = "" if lossless else f"{context.name} video"
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


# Environment maps

#: Header of a Radiance picture: lines up to an empty one, then its size.
_HDR_HEADER = re.compile(rb"#\?[^\n]*\n(?:[^\n]+\n)*\n([-+][XY]) (\d{1,9}) ([-+][XY]) (\d{1,9})\n")
#: Widths of rows that may be run-length encoded, which begin with 2, 2 and the width.
_RUN_WIDTHS = range(8, 1 << 15)


def read_environment(path: Path, *, strength: float = 1.0) -> Environment:
    """Read a latitude-longitude map as it is stored, in linear RGB; OpenEXR or Radiance HDR.

    Raises InputError where the file is missing, damaged, not RGB, or has radiance that is negative
    or not finite.
    """
    with input_files.bounded_memory(path):
        if input_files.head_of(path, "environment map", len(MAGIC)) == MAGIC:
            radiance, read = read_rgb_channels(path, "an environment map is an RGB picture")
            attributes = read.header.attributes
            if str(attributes["dataWindow"]) != str(attributes["displayWindow"]):
                raise InputError(
                    f"{path}: is a part of a picture only; an environment map has all directions"
                )
        else:
            radiance = _of_radiance(path)
        return Environment(radiance=radiance.astype(np.float32), strength=strength, name=str(path))


def _of_radiance(path: Path) -> Singles:
    """Return the pixels of a Radiance picture: Greg Ward, "Real Pixels", Graphics Gems II (1991)."""
    content = input_files.read_input(path, "environment map")
    found = _HDR_HEADER.match(content)
    if found is None:
        raise InputError(f"{path}: is not an OpenEXR or Radiance HDR picture; convert it to one")
    if b"FORMAT=32-bit_rle_xyze" in found[0]:
        raise InputError(f"{path}: is stored in XYZ; an environment map is an RGB picture")
    if (found[1], found[3]) != (b"-Y", b"+X"):
        raise InputError(f"{path}: is not stored row by row from the top left; write it so")
    height, width = int(found[2]), int(found[4])
    input_files.check_picture_size(path, width, height)
    stored = np.frombuffer(content, np.uint8)
    pixels, at = np.empty((height, width, 4), np.uint8), found.end()
    for row in pixels:
        at = _read_row(path, stored, at, row)
    exponent = pixels[..., 3:].astype(np.int32)
    scale = np.where(exponent == 0, 0, np.ldexp(np.float32(1), exponent - 136)).astype(np.float32)
    return pixels[..., :3] * scale


def _read_row(path: Path, stored: Bytes, at: int, row: Bytes) -> int:
    """Fill a row (W, 4) from the bytes at a place, and return the place behind it."""
    width = len(row)
    mark = np.array((2, 2, width >> 8, width & 255), np.uint8)
    if width not in _RUN_WIDTHS or not np.array_equal(stored[at : at + 4], mark):
        flat = stored[at : at + 4 * width]
        if flat.size < 4 * width or (flat.reshape(-1, 4)[:, :3] == 1).all(axis=1).any():
            raise InputError(
                f"{path}: the environment map is damaged, or of before 1991; write it again"
            )
        row[:] = flat.reshape(width, 4)
        return at + 4 * width
    at += 4
    for component in row.T:
        done = 0
        while done < width:
            # A code above 128 repeats the next value; another is the number of values that follow.
            code = int(stored[at]) if at + 1 < stored.size else 0
            count = code - 128 if code > 128 else code
            values = stored[at + 1 : at + 2] if code > 128 else stored[at + 1 : at + 1 + count]
            if not 0 < count <= width - done or values.size != (1 if code > 128 else count):
                raise InputError(
                    f"{path}: the environment map is damaged (a run of a row); write it again"
                )
            component[done : done + count] = values
            done, at = done + count, at + 1 + values.size
    return at
