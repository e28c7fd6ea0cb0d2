"""Hogel images and other pictures as OpenEXR files (CONVENTIONS.md, "Image files"; docs/adr/0012).

Headers are read alone before pixels are, for the library allocates whatever one declares. Its newer interface
reads, for it raises where the older one ends the process; the older one writes, band by band.
"""

import io
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import Any, TypeVar

import Imath
import numpy as np
import OpenEXR
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from xfrustum.scenes import HogelCamera, HogelImage, InputError
from xfrustum.scenes.arrays import Numbers, Singles
from xfrustum.scenes.disk.durable import new_file
from xfrustum.scenes.disk.input_files import check_declared, head_of
from xfrustum.scenes.model.eye import Eye, EyeImage
from xfrustum.scenes.model.hogel_image import Rendering

Described = TypeVar("Described")
Planes = Mapping[str, NDArray[Any]]  # channels (H, W) by name, each with its own type
CAMERA_ATTRIBUTE, RENDERING_ATTRIBUTE = "xfrustum:camera", "xfrustum:rendering"
EYE_ATTRIBUTE = "xfrustum:eye"
POSITION = ("P.X", "P.Y", "P.Z")
NORMAL = ("N.X", "N.Y", "N.Z")
COLOR = ("R", "G", "B")
VARIANCE = ("variance.R", "variance.G", "variance.B")
HEIGHT, TRIANGLE, OBJECT, CERTAINTY = "Z", "id.triangle", "id.object", "certainty"
_OPTIONAL = {"normal": NORMAL, "color": COLOR, "variance": VARIANCE, "certainty": (CERTAINTY,)}
CHANNELS = (*COLOR, *VARIANCE, *POSITION, *NORMAL, HEIGHT, TRIANGLE, OBJECT, CERTAINTY)
CAMERA_JSON, RENDERING_JSON = TypeAdapter(HogelCamera), TypeAdapter(Rendering)
#: Attributes as JSON, whose numbers are the shortest digits that give the same double again.
EYE_JSON = TypeAdapter(Eye)
MAGIC = bytes.fromhex("762f3101")  # first four bytes of every OpenEXR file
#: Largest number of pixels: OpenEXR's Python module counts a channel's bytes, 4 a pixel, in 32 bits.
MAX_PIXELS = (2**31 - 1) // 4
_PIXEL_TYPES = (np.uint32, np.float16, np.float32)  # types of pixels, in the order of their codes
#: Lock for redirecting what OpenEXR prints: two threads at once would restore each other's file.
_SILENT = threading.Lock()


@contextmanager
def _silence() -> Iterator[None]:
    """Drop what is written within a block: OpenEXR prints errors, which it also raises, and repairs."""
    with _SILENT, os.fdopen(os.dup(2), "wb") as shown, Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
        try:
            with redirect_stdout(io.StringIO()):
                yield
        finally:
            os.dup2(shown.fileno(), 2)


@contextmanager
def _file(path: Path, *, header_only: bool) -> Iterator[OpenEXR.File]:
    """Open a file; whatever OpenEXR raises then and within the block becomes an InputError."""
    try:
        with _silence(), OpenEXR.File(str(path), separate_channels=True, header_only=header_only) as file:
            yield file
    except (OSError, RuntimeError, SystemError, LookupError, TypeError, ValueError, MemoryError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: the OpenEXR image is damaged ({reason}); write it again") from error


def read_header(path: Path) -> tuple[dict[str, Any], tuple[int, int]]:
    """Return header and W, H; InputError where it is no OpenEXR image of flat pixels, or too large."""
    if head_of(path, "image file", len(MAGIC)) != MAGIC:
        raise InputError(f"{path}: is not an OpenEXR image")
    with _file(path, header_only=True) as file:
        header: dict[str, Any] = dict(file.header())  # OpenEXR empties its own
        if len(file.parts) != 1 or header["type"] not in (OpenEXR.scanlineimage, OpenEXR.tiledimage):
            raise ValueError("it has several parts or deep pixels; only one part of flat ones is read")
        (left, top), (right, bottom) = (corner.tolist() for corner in header["dataWindow"])
        size = right - left + 1, bottom - top + 1
        count = len(header["channels"])
    check_declared(path, 4 * count * size[0] * size[1], "pixels")
    return header, size


def read_channels(path: Path, names: Sequence[str]) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return those of some channels that a file has, (H, W) each with its own type, and its header.

    Raises InputError as `read_header`, or where a channel does not have every pixel.
    """
    header, _ = read_header(path)
    with _file(path, header_only=False) as file:
        present = {name: channel for name, channel in file.channels().items() if name in names}
        for name, channel in present.items():
            if (channel.xSampling, channel.ySampling) != (1, 1):
                raise InputError(f"{path}: channel {name} is subsampled; write every pixel of it")
        return {name: channel.pixels for name, channel in present.items()}, header


def read_rgb_channels(path: Path, advice: str) -> tuple[NDArray[Any], dict[str, Any]]:
    """Return R, G and B as (H, W, 3), and the header; an InputError with the advice where one is missing."""
    planes, header = read_channels(path, COLOR)
    missing = [name for name in COLOR if name not in planes]
    if missing:
        raise InputError(f"{path}: has no channel {missing[0]}; {advice}")
    return np.stack([planes[name] for name in COLOR], axis=-1), header


def image_size(path: str | Path) -> tuple[int, int]:
    """Return W, H of an image file, whatever camera it names; InputError as from `read_header`."""
    return read_header(Path(path))[1]


def read_image(path: str | Path, camera: HogelCamera | None = None, *, partial: bool = False) -> HogelImage:
    """Read an image by any renderer; channels that the file lacks are absent, NaN, or `NOTHING`.

    The camera given is that of files that name none; with `partial` it is that of all, and any of `CHANNELS`
    will do. Otherwise there must be `id.triangle`, or `P.X P.Y P.Z`. Raises InputError where the file is
    missing, damaged, without a camera, or of another size than its camera's.
    """
    path = Path(path)
    planes, header = read_channels(path, CHANNELS)
    own = None if partial else _described(path, header, CAMERA_ATTRIBUTE, CAMERA_JSON)
    found = own or camera
    if found is None:
        raise InputError(f"{path}: has no {CAMERA_ATTRIBUTE} attribute; say which camera it answers for")
    if not planes:
        wanted = "none of " + " ".join(CHANNELS) if partial else "neither id.triangle nor P.X P.Y P.Z"
        raise InputError(f"{path}: has {wanted}; write one of them")
    height, width = next(iter(planes.values())).shape
    if (width, height) != tuple(found.resolution):
        said = f"{found.resolution[0]} x {found.resolution[1]}"
        raise InputError(
            f"{path}: is {width} x {height}, but its camera says {said}; render it again at that size"
        )
    position = _vectors(path, planes, POSITION)
    if position is None and TRIANGLE not in planes and not partial:
        raise InputError(f"{path}: has neither id.triangle nor P.X P.Y P.Z; write one of them")
    if position is None:
        position = np.full((height, width, 3), np.nan, dtype=np.float32)
        position[..., 2] = planes.get(HEIGHT, np.nan)
    certainty = planes.get(CERTAINTY)
    nothing = np.zeros((height, width), np.uint32)
    return HogelImage(
        camera=found,
        triangle=_numbers(path, TRIANGLE, planes.get(TRIANGLE, nothing)),
        object=_numbers(path, OBJECT, planes.get(OBJECT, nothing)),
        position=position,
        normal=_vectors(path, planes, NORMAL),
        color=_vectors(path, planes, COLOR),
        variance=_vectors(path, planes, VARIANCE),
        certainty=None if certainty is None else certainty.astype(np.uint8),
        rendering=None if partial else _described(path, header, RENDERING_ATTRIBUTE, RENDERING_JSON),
    )


def _described(
    path: Path, header: dict[str, Any], name: str, kind: TypeAdapter[Described]
) -> Described | None:
    """Return the object that an attribute of the header describes; None where there is no such attribute."""
    if name not in header:
        return None
    try:
        return kind.validate_json(header[name])
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"]) or "JSON"
        reason = f"{key}: {first['msg']}"
    except InputError as error:
        reason = str(error)
    what = name.removeprefix("xfrustum:")
    raise InputError(f"{path}: its {name} attribute is not a {what} ({reason}); write it again")


def _vectors(path: Path, planes: Planes, names: tuple[str, str, str]) -> Singles | None:
    """Return three channels as (H, W, 3), or None where the file has none of them."""
    missing = [name for name in names if name not in planes]
    if len(missing) == len(names):
        return None
    if missing:
        raise InputError(f"{path}: has no channel {missing[0]} beside the others of {' '.join(names)}")
    return np.stack([planes[name] for name in names], axis=-1).astype(np.float32, copy=False)


def _numbers(path: Path, name: str, plane: NDArray[Any]) -> Numbers:
    """Return numbers from a channel that stores them plus one; some renderers write no others than floats."""
    largest = np.iinfo(np.int32).max
    if not ((plane >= 0) & (plane <= largest) & (plane == np.floor(plane))).all():
        raise InputError(f"{path}: channel {name} must hold whole numbers from 0 to {largest}, number + 1")
    return np.asarray(plane.astype(np.int64) - 1, dtype=np.int32)


def stored_planes(image: HogelImage | EyeImage) -> dict[str, NDArray[Any]]:
    """Return every channel that an image has, by its name, (H, W), with the type and bits of a file."""
    planes: dict[str, NDArray[Any]] = {
        HEIGHT: image.position[..., 2].astype(np.float32),
        TRIANGLE: (image.triangle + 1).astype(np.uint32),
        OBJECT: (image.object + 1).astype(np.uint32),
    }
    if image.certainty is not None:
        planes[CERTAINTY] = image.certainty.astype(np.uint32)
    vectors = {POSITION: image.position, COLOR: image.color}
    if isinstance(image, HogelImage):
        vectors |= {NORMAL: image.normal, VARIANCE: image.variance}
    for names, array in vectors.items():
        if array is not None:
            planes |= {name: array[..., axis].astype(np.float32) for axis, name in enumerate(names)}
    return planes


@contextmanager
def _rows(
    path: Path, size: tuple[int, int], types: Mapping[str, np.dtype[Any]], attributes: Mapping[str, bytes]
) -> Iterator[Callable[[Planes], None]]:
    """Write a lossless file from the top down: yield the function that writes the next rows of channels."""
    header: dict[str, Any] = OpenEXR.Header(*size)
    header["compression"] = Imath.Compression(Imath.Compression.ZIP_COMPRESSION)
    header["channels"] = {
        name: Imath.Channel(Imath.PixelType(_PIXEL_TYPES.index(kind.type))) for name, kind in types.items()
    }
    # This is OpenEXR's older interface: the newer one writes whole images only.
    file = OpenEXR.OutputFile(str(path), {**header, **attributes})

    def write(planes: Planes) -> None:
        data = {name: np.ascontiguousarray(planes[name]).tobytes() for name in types}
        file.writePixels(data, len(planes[next(iter(types))]))

    try:
        yield write
    except BaseException:
        with suppress(OSError, RuntimeError):
            file.close()
        raise
    file.close()
    # OpenEXR reports no errors in the last bytes that it writes, so that its last row is read.
    with _silence():
        written = OpenEXR.InputFile(str(path))
        if not written.isComplete():
            raise OSError("what was written is not complete")
        written.channel(next(iter(types)), scanLine1=size[1] - 1, scanLine2=size[1] - 1)


@contextmanager
def image_writer(
    path: str | Path, camera: HogelCamera, arrays: Sequence[str] = (), rendering: Rendering | None = None
) -> Iterator[Callable[[HogelImage], None]]:
    """Write an image from the top down, band by band: yield the function that takes the next band.

    A band is an image of full width and any number of rows; `arrays` names the optional arrays that all have.
    The file appears, in place of an older one, when the block ends without an exception. Raises InputError
    where it cannot be written, or the image has more than `MAX_PIXELS`.
    """
    path, (width, height), written = Path(path), camera.resolution, 0
    if width * height > MAX_PIXELS:
        raise InputError(
            f"{path}: an image of {width} x {height} pixels is more than OpenEXR writes here, "
            f"{MAX_PIXELS:,}; lower frustum.resolution"
        )
    names = [*POSITION, HEIGHT, TRIANGLE, OBJECT, *(name for one in arrays for name in _OPTIONAL[one])]
    numbers = (TRIANGLE, OBJECT, CERTAINTY)
    types = {name: np.dtype(np.uint32 if name in numbers else np.float32) for name in names}
    attributes = {CAMERA_ATTRIBUTE: CAMERA_JSON.dump_json(camera)}
    if rendering is not None:
        attributes[RENDERING_ATTRIBUTE] = RENDERING_JSON.dump_json(rendering)
    aside = path

    @contextmanager
    def refused(advice: str) -> Iterator[None]:
        try:
            yield
        except (OSError, RuntimeError) as error:
            reason = " ".join(str(getattr(error, "strerror", None) or error).split())
            # OpenEXR names the file that was set aside, which does not exist afterwards.
            reason = reason.replace(str(aside), path.name)
            raise InputError(f"{path}: cannot write the image ({reason}); {advice}") from error

    def write_band(band: HogelImage) -> None:
        nonlocal written
        rows, columns = band.triangle.shape
        if columns != width or written + rows > height:
            raise ValueError(f"a band of {columns} x {rows} at row {written} leaves {width} x {height}")
        with refused("check the disk"):
            write(stored_planes(band))
        written += rows

    with ExitStack() as stack:
        with refused("choose another folder"):
            aside = stack.enter_context(new_file(path))
            write = stack.enter_context(_rows(aside, camera.resolution, types, attributes))
        yield write_band
        if written != height:
            raise ValueError(f"only {written} of {height} rows were written")
        with refused("check the disk"):
            stack.close()


def write_image(path: str | Path, image: HogelImage) -> None:
    """Write an image: floats in 32 bits, numbers plus one, lossless; InputError where that fails."""
    arrays = [name for name in _OPTIONAL if getattr(image, name) is not None]
    with image_writer(path, image.camera, arrays, image.rendering) as write:
        write(image)


def write_planes(path: Path, planes: Planes, attributes: Mapping[str, bytes] | None = None) -> None:
    """Write channels (H, W) with their own types, not set aside first; InputError where that fails."""
    height, width = next(iter(planes.values())).shape
    types = {name: plane.dtype for name, plane in planes.items()}
    try:
        with _rows(path, (width, height), types, attributes or {}) as write:
            write(planes)
    except (OSError, RuntimeError) as error:
        raise InputError(f"{path.name}: cannot write the image; free some space") from error


def write_eye_image(path: Path, image: EyeImage) -> None:
    """Write what an eye sees, with the eye in the header; see `write_planes`."""
    write_planes(path, stored_planes(image), {EYE_ATTRIBUTE: EYE_JSON.dump_json(image.eye)})
