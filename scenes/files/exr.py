"""Hogel images and other pictures as OpenEXR files (CONVENTIONS.md, "Image files").

All of OpenEXR goes through this module (docs/adr/0012-openexr-by-its-own-library.md). A header is checked
before the library sees it, for its Python binding ends the process at a name that is no UTF-8, and allocates
whatever a header declares. Layout: "OpenEXR File Layout", Academy Software Foundation, sections "Header" and
"Attribute types".
"""

from __future__ import annotations

import os
import struct
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import Imath
import numpy as np
import OpenEXR
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from xfrustum.scenes.arrays import Numbers, Singles
from xfrustum.scenes.disk.durable import AllOrNothing, NewFile
from xfrustum.scenes.disk.input_files import check_declared, check_image_file
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.eye import Eye, EyeImage
from xfrustum.scenes.model.hogel_image import NOTHING, HogelCamera, HogelImage, Rendering

Described = TypeVar("Described")

CAMERA_ATTRIBUTE, RENDERING_ATTRIBUTE = "xfrustum:camera", "xfrustum:rendering"
EYE_ATTRIBUTE = "xfrustum:eye"
POSITION = ("P.X", "P.Y", "P.Z")
NORMAL = ("N.X", "N.Y", "N.Z")
COLOR = ("R", "G", "B")
VARIANCE = ("variance.R", "variance.G", "variance.B")
HEIGHT, TRIANGLE, OBJECT, CERTAINTY = "Z", "id.triangle", "id.object", "certainty"
CHANNELS = (*COLOR, *VARIANCE, *POSITION, *NORMAL, HEIGHT, TRIANGLE, OBJECT, CERTAINTY)

CAMERA_JSON = TypeAdapter(HogelCamera)
"""The camera as JSON, whose numbers are the shortest digits that give the same double again."""

RENDERING_JSON, EYE_JSON = TypeAdapter(Rendering), TypeAdapter(Eye)

MAGIC = bytes.fromhex("762f3101")
"""First four bytes of every OpenEXR file."""

MAX_PIXELS = (2**31 - 1) // 4
"""Largest number of pixels: OpenEXR's Python module counts a channel's bytes, 4 a pixel, in 32 bits."""

_VERSION, _LONG_NAMES, _DEEP, _SEVERAL_PARTS = 2, 0x400, 0x800, 0x1000
"""Version number, and flags above it."""

_PIXEL_TYPES = (np.uint32, np.float16, np.float32)
"""Types of pixels, in the order of their codes."""

_KNOWN_TYPES = (
    " box2i box2f chlist chromaticities compression double envmap float floatvector int keycode lineOrder "
    "m33f m33d m44f m44d preview rational string stringvector tiledesc timecode v2i v2f v2d v3i v3f v3d "
)
"""Attribute types of the format; the binding raises an obscure error at any other."""

LARGEST_HEADER = 1 << 20
"""Largest size of a header, in bytes: names, a camera, and a preview picture fit."""

LARGEST_SIDE = 1 << 24
"""Largest number of pixels along a side: single precision cannot count more."""


class _Damaged(Exception):
    """A header breaks the rules of the format; the message says how."""


class _Header:
    """Bytes of a header, read from the front."""

    def __init__(self, data: bytes, longest: int = 31) -> None:
        self.data, self.at, self.longest = data, 0, longest

    def take(self, count: int) -> bytes:
        if count < 0 or self.at + count > len(self.data):
            raise _Damaged("it ends within the header")
        self.at += count
        return self.data[self.at - count : self.at]

    def whole(self, code: str) -> tuple[int, ...]:
        return struct.unpack(f"<{code}", self.take(struct.calcsize(f"<{code}")))

    def text(self) -> str:
        """Return a text that ends in a zero byte."""
        end = self.data.find(b"\0", self.at, self.at + self.longest + 1)
        if end < 0:
            raise _Damaged(f"a name is longer than {self.longest} bytes, or has no end")
        raw = self.take(end + 1 - self.at)[:-1]
        return _decoded(raw, f"the name {raw[:40]!r}")


def _decoded(raw: bytes, what: str) -> str:
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        raise _Damaged(f"{what} is no UTF-8") from error


def check_header(path: Path) -> None:
    """Refuse an OpenEXR file whose header is damaged, or that declares far more pixels than it holds.

    Raises
    ------
    InputError
        The header is damaged or declares too much, or the file is no OpenEXR image of flat pixels.
    """
    check_image_file(path)
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_HEADER)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if data[: len(MAGIC)] != MAGIC:
        raise InputError(f"{path}: is not an OpenEXR image")
    try:
        declared = _declared_bytes(_Header(data[len(MAGIC) :]))
    except _Damaged as error:
        raise InputError(f"{path}: the OpenEXR image is damaged ({error}); write it again") from error
    check_declared(path, declared, "pixels")


def _declared_bytes(header: _Header) -> int:
    """Return the bytes of pixels that the first part declares."""
    (version,) = header.whole("I")
    if version & 0xFF != _VERSION:
        raise _Damaged(f"its version is {version & 0xFF}, not {_VERSION}")
    if version & _DEEP:
        raise _Damaged("it has deep pixels; only flat ones are read")
    if version & _SEVERAL_PARTS:
        raise _Damaged("it has several parts; only files of one part are read")
    header.longest = 255 if version & _LONG_NAMES else 31
    pixel_bytes = pixels = None
    while name := header.text():
        kind, (length,) = header.text(), header.whole("i")
        value = _Header(header.take(length), header.longest)
        if not kind or f" {kind} " not in _KNOWN_TYPES:
            raise _Damaged(f"its attribute {name} has the unknown type {kind[:40]}")
        if kind == "string":
            _decoded(value.data, f"its attribute {name}")
        if name == "channels":
            pixel_bytes = _bytes_of_channels(value)
        elif name == "dataWindow":
            left, top, right, bottom = value.whole("iiii")
            width, height = right - left + 1, bottom - top + 1
            if not (1 <= width <= LARGEST_SIDE and 1 <= height <= LARGEST_SIDE):
                raise _Damaged(f"its data window is {width} x {height} pixels")
            pixels = width * height
    if pixel_bytes is None or pixels is None:
        raise _Damaged("it declares no channels, or no data window")
    return pixel_bytes * pixels


def _bytes_of_channels(value: _Header) -> int:
    """Return the bytes of one pixel in all channels."""
    total = 0
    while value.text():
        kind, _, x, y = value.whole("iiii")  # the second holds a flag and three reserved bytes
        if not 0 <= kind < len(_PIXEL_TYPES):
            raise _Damaged(f"a channel has the unknown pixel type {kind}")
        if min(x, y) < 1:
            raise _Damaged("a channel has no sampling")
        total += np.dtype(_PIXEL_TYPES[kind]).itemsize
    return total


_SILENT = threading.Lock()
"""Lock for redirecting standard error: two threads at once would restore each other's file."""


@contextmanager
def _silence() -> Iterator[None]:
    """Drop what is written to standard error: OpenEXR prints its errors too, and repairs that it makes."""
    with _SILENT, os.fdopen(os.dup(2), "wb") as shown, Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(shown.fileno(), 2)


@contextmanager
def _opened(path: Path) -> Iterator[OpenEXR.InputFile]:
    """Open a file whose header is checked; any exception that OpenEXR raises becomes an InputError."""
    check_header(path)
    try:
        with _silence():
            file = OpenEXR.InputFile(str(path))
            if not file.isComplete():
                raise OSError("rows are missing")
            yield file
    except (OSError, RuntimeError, SystemError, LookupError, TypeError, ValueError, MemoryError) as error:
        raise InputError(f"{path}: the OpenEXR image is damaged ({error}); write it again") from error


def read_channels(path: Path, names: Sequence[str]) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return those of some channels that a file has, (H, W) each with its own type, and its header.

    Raises
    ------
    InputError
        The file is missing or damaged, or a channel does not have every pixel.
    """
    with _opened(path) as file:
        header = file.header()
        width, height = _size(header)
        present = {name: header["channels"][name] for name in names if name in header["channels"]}
        for name, channel in present.items():
            if (channel.xSampling, channel.ySampling) != (1, 1):
                raise InputError(f"{path}: channel {name} is subsampled; write every pixel of it")
        raw = file.channels(list(present)) if present else []
        planes: dict[str, NDArray[Any]] = {
            name: np.frombuffer(data, dtype=_PIXEL_TYPES[channel.type.v]).reshape(height, width)
            for (name, channel), data in zip(present.items(), raw, strict=True)
        }
        return planes, header


def image_size(path: str | Path) -> tuple[int, int]:
    """Return W, H of an image file, whatever camera it names.

    Raises
    ------
    InputError
        The file is missing or damaged.
    """
    with _opened(Path(path)) as file:
        return _size(file.header())


def _size(header: dict[str, Any]) -> tuple[int, int]:
    """Return W, H of the pixels that a file has."""
    window = header["dataWindow"]
    return window.max.x - window.min.x + 1, window.max.y - window.min.y + 1


def read_image(path: str | Path, camera: HogelCamera | None = None, *, partial: bool = False) -> HogelImage:
    """Read an image by this or any other renderer.

    Channels that the file lacks are absent, NaN, or `NOTHING` in the image; it must have
    `id.triangle`, or `P.X P.Y P.Z`, or both.

    Parameters
    ----------
    path
        Path of the file.
    camera
        Camera of an image whose file names none, such as the truth's camera.
    partial
        Whether to take any of the channels of `CHANNELS`, and the camera given whatever the file says.

    Raises
    ------
    InputError
        The file is missing, damaged, without a camera, or of another size than its camera's.
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
        raise InputError(
            f"{path}: is {width} x {height}, but its camera says "
            f"{found.resolution[0]} x {found.resolution[1]}; render it again at that size"
        )
    position = _vectors(path, planes, POSITION)
    if position is None and TRIANGLE not in planes and not partial:
        raise InputError(f"{path}: has neither id.triangle nor P.X P.Y P.Z; write one of them")
    if position is None:
        position = np.full((height, width, 3), np.nan, dtype=np.float32)
        position[..., 2] = planes.get(HEIGHT, np.nan)
    certainty = planes.get(CERTAINTY)
    return HogelImage(
        camera=found,
        triangle=_numbers(path, planes, TRIANGLE, (height, width)),
        object=_numbers(path, planes, OBJECT, (height, width)),
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


def _vectors(path: Path, planes: dict[str, NDArray[Any]], names: tuple[str, str, str]) -> Singles | None:
    """Return three channels as (H, W, 3), or None where the file has none of them."""
    missing = [name for name in names if name not in planes]
    if len(missing) == len(names):
        return None
    if missing:
        raise InputError(f"{path}: has no channel {missing[0]} beside the others of {' '.join(names)}")
    return np.stack([planes[name] for name in names], axis=-1).astype(np.float32, copy=False)


def _numbers(path: Path, planes: dict[str, NDArray[Any]], name: str, shape: tuple[int, int]) -> Numbers:
    """Return numbers from a channel that stores them plus one; `NOTHING` where there is no channel.

    Floats are accepted if they are whole numbers: some renderers write no other channels.
    """
    plane = planes.get(name)
    if plane is None:
        return np.full(shape, NOTHING, dtype=np.int32)
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
    vectors: list[tuple[tuple[str, str, str], NDArray[Any] | None]] = [
        (POSITION, image.position),
        (COLOR, image.color),
    ]
    if isinstance(image, HogelImage):
        vectors += [(NORMAL, image.normal), (VARIANCE, image.variance)]
    for names, array in vectors:
        if array is not None:
            planes |= {name: array[..., axis].astype(np.float32) for axis, name in enumerate(names)}
    return planes


class _Rows:
    """An OpenEXR file that is written from the top down, lossless, with channels of some types."""

    def __init__(
        self, path: Path, size: tuple[int, int], types: dict[str, np.dtype[Any]], attributes: dict[str, bytes]
    ) -> None:
        self._path, self._height, self._names = path, size[1], list(types)
        header: dict[str, Any] = OpenEXR.Header(*size)
        header["compression"] = Imath.Compression(Imath.Compression.ZIP_COMPRESSION)
        header["channels"] = {
            name: Imath.Channel(Imath.PixelType(_PIXEL_TYPES.index(kind.type)))
            for name, kind in types.items()
        }
        # This is OpenEXR's older interface: the newer one writes whole images only.
        self._file = OpenEXR.OutputFile(str(path), header | attributes)

    def write(self, planes: dict[str, NDArray[Any]], rows: int) -> None:
        self._file.writePixels(
            {name: np.ascontiguousarray(planes[name]).tobytes() for name in self._names}, rows
        )

    def close(self) -> None:
        """Close the file and read its last row: OpenEXR reports no errors in the last bytes it writes."""
        self._file.close()
        with _silence():
            file = OpenEXR.InputFile(str(self._path))
            if not file.isComplete():
                raise OSError("what was written is not complete")
            last = self._height - 1
            file.channel(self._names[0], scanLine1=last, scanLine2=last)

    def discard(self) -> None:
        with suppress(OSError, RuntimeError):
            self._file.close()


class ImageWriter(AllOrNothing):
    """Writes an image band by band, from the top down, in the memory of one band.

    A context manager. The file appears under its name when the block ends without an exception,
    complete, and not at all otherwise.

    Parameters
    ----------
    path
        Path of the file; a file that exists is replaced at the end.
    camera
        Frustum of the whole image; its resolution is the size of the image.
    arrays
        Names of the bands' optional arrays: `normal`, `color`, `variance`, `certainty`.
    rendering
        Effects and samples of the whole image's color; None where they are not known.

    Raises
    ------
    InputError
        The file cannot be written, or the image has more than `MAX_PIXELS`.
    """

    def __init__(
        self,
        path: str | Path,
        camera: HogelCamera,
        *,
        arrays: Sequence[str] = (),
        rendering: Rendering | None = None,
    ) -> None:
        self._path, self._size, self._next_row = Path(path), camera.resolution, 0
        width, height = camera.resolution
        if width * height > MAX_PIXELS:
            raise InputError(
                f"{self._path}: an image of {width} x {height} pixels is more than OpenEXR writes here, "
                f"{MAX_PIXELS:,}; lower frustum.resolution"
            )
        optional = {"normal": NORMAL, "color": COLOR, "variance": VARIANCE, "certainty": (CERTAINTY,)}
        names = [*POSITION, HEIGHT, TRIANGLE, OBJECT, *(name for one in arrays for name in optional[one])]
        numbers = (TRIANGLE, OBJECT, CERTAINTY)
        types = {name: np.dtype(np.uint32 if name in numbers else np.float32) for name in names}
        attributes = {CAMERA_ATTRIBUTE: CAMERA_JSON.dump_json(camera)}
        if rendering is not None:
            attributes[RENDERING_ATTRIBUTE] = RENDERING_JSON.dump_json(rendering)
        try:
            self._new = NewFile(self._path)
        except OSError as error:
            raise self._refused(error, "choose another folder") from error
        try:
            self._file = _Rows(self._new.aside, self._size, types, attributes)
        except BaseException as error:
            self._new.discard()
            if not isinstance(error, OSError | RuntimeError | ValueError):
                raise
            raise self._refused(error, "choose another folder") from error

    def write_rows(self, first_row: int, band: HogelImage) -> None:
        """Write the next rows.

        Parameters
        ----------
        first_row
            Image row of the band's row 0; bands come in order and leave no row out.
        band
            Image with arrays of full width and any number of rows.
        """
        if first_row != self._next_row:
            raise ValueError(f"rows from {first_row} do not follow the {self._next_row} rows written")
        rows, width = band.triangle.shape
        if width != self._size[0] or first_row + rows > self._size[1]:
            raise ValueError(f"a band of {width} x {rows} at row {first_row} leaves {self._size}")
        try:
            self._file.write(stored_planes(band), rows)
        except (OSError, RuntimeError) as error:
            raise self._refused(error, "check the disk") from error
        self._next_row += rows

    def commit(self) -> None:
        """Put the complete file under its name, once it is on the disk."""
        if self._next_row != self._size[1]:
            self.discard()
            raise ValueError(f"only {self._next_row} of {self._size[1]} rows were written")
        try:
            self._file.close()
            self._new.commit()
        except (OSError, RuntimeError) as error:
            raise self._refused(error, "check the disk") from error
        finally:
            self._new.discard()

    def discard(self) -> None:
        """Leave no trace."""
        try:
            self._file.discard()
        finally:
            self._new.discard()

    def _refused(self, error: Exception, advice: str) -> InputError:
        reason = " ".join(str(getattr(error, "strerror", None) or error).split())
        # OpenEXR names the file that was set aside, which does not exist afterwards.
        if hasattr(self, "_new"):
            reason = reason.replace(str(self._new.aside), self._path.name)
        return InputError(f"{self._path}: cannot write the image ({reason}); {advice}")


def write_image(path: str | Path, image: HogelImage) -> None:
    """Write an image: floats in 32 bits, numbers plus one, lossless.

    Raises
    ------
    InputError
        The file cannot be written; nothing is left behind.
    """
    arrays = [n for n in ("normal", "color", "variance", "certainty") if getattr(image, n) is not None]
    with ImageWriter(path, image.camera, arrays=arrays, rendering=image.rendering) as writer:
        writer.write_rows(0, image)


def write_planes(
    path: Path, planes: dict[str, NDArray[Any]], attributes: dict[str, bytes] | None = None
) -> None:
    """Write channels (H, W) with their own types under a file's own name; the caller puts it in place.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    height, width = next(iter(planes.values())).shape
    types = {name: plane.dtype for name, plane in planes.items()}
    try:
        file = _Rows(path, (width, height), types, attributes or {})
        file.write(planes, height)
        file.close()
    except (OSError, RuntimeError) as error:
        raise InputError(f"{path.name}: cannot write the image; free some space") from error


def write_eye_image(path: Path, image: EyeImage) -> None:
    """Write what an eye sees, with the eye in the header; see `write_planes`."""
    write_planes(path, stored_planes(image), {EYE_ATTRIBUTE: EYE_JSON.dump_json(image.eye)})
