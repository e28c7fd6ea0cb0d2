"""Hogel images and other pictures as OpenEXR files (CONVENTIONS.md, "Image files"; docs/adr/0012).

The header is read and checked before the pixels, because the library allocates any declared size.
Reading uses the library's newer interface, because the older interface ends the process on errors.
Writing uses the older interface, which accepts an image band by band.
"""

import io
import math
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import Imath
import numpy as np
import OpenEXR
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from xfrustum.scenes import NOTHING, HogelCamera, HogelImage, InputError
from xfrustum.scenes.arrays import Floats, Mask, Numbers, Singles
from xfrustum.scenes.disk import check_declared, head_of, new_file
from xfrustum.scenes.files.channels import (
    ANY_ID,
    CERTAINTY,
    CHANNELS,
    COLOR,
    HEIGHT,
    NORMAL,
    OBJECT,
    POSITION,
    TRIANGLE,
    VARIANCE,
    StoredChannel,
    largest_whole,
    listed,
    located,
    lossy,
    refuse_several,
    uncertainty,
)
from xfrustum.scenes.model.eye import Eye, EyeImage
from xfrustum.scenes.model.images import Rendering

Described = TypeVar("Described")
Planes = Mapping[str, NDArray[Any]]  # channels (H, W) by name, each with its own type
CAMERA_ATTRIBUTE, RENDERING_ATTRIBUTE = "xfrustum:camera", "xfrustum:rendering"
EYE_ATTRIBUTE = "xfrustum:eye"
_OPTIONAL = {"normal": NORMAL, "color": COLOR, "variance": VARIANCE, "certainty": (CERTAINTY,)}
#: attributes as JSON, with the shortest digits from which the same doubles are read
CAMERA_JSON, RENDERING_JSON = TypeAdapter(HogelCamera), TypeAdapter(Rendering)
EYE_JSON = TypeAdapter(Eye)
#: first bytes of every OpenEXR file
MAGIC = bytes.fromhex("762f3101")
#: the library counts the bytes of a channel, 4 per pixel, in 32 bits
MAX_PIXELS = (2**31 - 1) // 4
#: magnitude from which a stored coordinate means that the pixel shows no surface
FAR = 1e10
_PIXEL_TYPES = (np.uint32, np.float16, np.float32)  # in the order of OpenEXR's codes
_SILENT = threading.Lock()  # concurrent redirections would restore each other's file


_DAMAGE = (OSError, RuntimeError, SystemError, LookupError, TypeError, ValueError, MemoryError)


@contextmanager
def _silence() -> Iterator[None]:
    """Suppress output within a block: OpenEXR prints repairs, and errors that it also raises."""
    with _SILENT, os.fdopen(os.dup(2), "wb") as shown, Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
        try:
            with redirect_stdout(io.StringIO()):
                yield
        finally:
            os.dup2(shown.fileno(), 2)


@contextmanager
def _file(path: Path, *, header_only: bool) -> Iterator[OpenEXR.File]:
    """Open a file; convert exceptions of OpenEXR, also within the block, to InputError."""
    try:
        with (
            _silence(),
            OpenEXR.File(str(path), separate_channels=True, header_only=header_only) as file,
        ):
            yield file
    except _DAMAGE as error:
        reason = " ".join(str(error).split())
        raise InputError(
            f"{path}: the OpenEXR image is damaged ({reason}); write it again"
        ) from error


@dataclass(frozen=True, kw_only=True)
class Header:
    """Declarations of all parts of an OpenEXR file of flat pixels."""

    #: attributes by name; each is read from the first part that has it
    attributes: Mapping[str, Any]
    #: W, H of the display window, pixels
    size: tuple[int, int]
    channels: tuple[StoredChannel, ...]
    #: compression of each part
    compressions: tuple[Any, ...]


def read_header(path: Path) -> Header:
    """Return the header; InputError for other formats, deep pixels, or too large a size."""
    if head_of(path, "image file", len(MAGIC)) != MAGIC:
        raise InputError(f"{path}: is not an OpenEXR image")
    with _file(path, header_only=True) as file:
        # Copy the attributes: OpenEXR empties its own objects.
        headers = [dict(file.header(part)) for part in range(len(file.parts))]
        kinds = {header["type"] for header in headers}
        if not kinds <= {OpenEXR.scanlineimage, OpenEXR.tiledimage}:
            raise ValueError("it has deep pixels; only flat pixels are read")
        sizes = [_size(header["dataWindow"]) for header in headers]
        size = _size(headers[0]["displayWindow"])
        counts = [len(header["channels"]) for header in headers]
        channels = tuple(
            StoredChannel(
                part=part,
                part_name=str(header.get("name", part)) if len(headers) > 1 else "",
                name=channel.name,
            )
            for part, header in enumerate(headers)
            for channel in header["channels"]
        )
        attributes: dict[str, Any] = {}
        for header in reversed(headers):
            attributes |= header
    # Each channel is read in its data window, and copied into a plane of the display window.
    pixels = sum(
        count * (math.prod(part) + math.prod(size))
        for count, part in zip(counts, sizes, strict=True)
    )
    # A pixel of a channel has at most 4 bytes.
    check_declared(path, 4 * pixels, "pixels")
    compressions = tuple(header["compression"] for header in headers)
    return Header(attributes=attributes, size=size, channels=channels, compressions=compressions)


def _size(window: Any) -> tuple[int, int]:
    (left, top), (right, bottom) = (corner.tolist() for corner in window)
    if right < left or bottom < top:
        raise ValueError(f"a window from {left}, {top} to {right}, {bottom} is empty")
    return right - left + 1, bottom - top + 1


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadPlanes:
    """Channels of a file by their names in CONVENTIONS.md."""

    #: (H, W) of the display window, types as stored
    planes: dict[str, NDArray[Any]]
    header: Header
    places: dict[str, StoredChannel]

    def lossy(self, name: str) -> str | None:
        """Return the compression that changed a channel's values; None if it is lossless."""
        place = self.places[name]
        return lossy(place.name, self.planes[name].dtype, self.header.compressions[place.part])


def read_channels(path: Path, names: Sequence[str]) -> ReadPlanes:
    """Return all channels in `names` that a file has, from any part; see `located`.

    Pixels of the display window outside the data window are 0, or NaN in positions, heights and
    normals. Raises InputError as `read_header` does, and if a channel lies in several parts or
    lacks pixels.
    """
    header = read_header(path)
    # Do not guess one of several candidates.
    places, several = located(header.channels, names)
    refuse_several(path, several)
    with _file(path, header_only=False) as file:
        planes = {}
        for name, place in places.items():
            channel = file.channels(place.part)[place.name]
            if (channel.xSampling, channel.ySampling) != (1, 1):
                raise InputError(
                    f"{path}: channel {place.words} is subsampled; write every pixel of it"
                )
            windows = file.header(place.part)["dataWindow"], header.attributes["displayWindow"]
            planes[name] = _in_display(channel.pixels, *windows, name)
    return ReadPlanes(planes=planes, header=header, places=places)


def _in_display(pixels: NDArray[Any], data: Any, display: Any, name: str) -> NDArray[Any]:
    """Return the pixels (H, W) of the display window from the pixels of the data window."""
    missing = np.nan if name in (*POSITION, *NORMAL, HEIGHT) else 0
    # Rows and columns of the display window, counted from the first row and column of the data
    # window.
    rows, columns = (
        np.arange(display[0][axis], display[1][axis] + 1) - data[0][axis] for axis in (1, 0)
    )
    (height, width), whole = pixels.shape, np.full((len(rows), len(columns)), missing, pixels.dtype)
    row, column = (rows >= 0) & (rows < height), (columns >= 0) & (columns < width)
    whole[np.ix_(row, column)] = pixels[np.ix_(rows[row], columns[column])]
    return whole


def read_rgb_channels(path: Path, advice: str) -> tuple[NDArray[Any], ReadPlanes]:
    """Return R, G and B, (H, W, 3), and the channels; InputError with `advice` if incomplete."""
    read = read_channels(path, COLOR)
    missing = [name for name in COLOR if name not in read.planes]
    if missing:
        raise InputError(
            f"{path}: has no channel {missing[0]}; {advice}; it has {listed(read.header.channels)}"
        )
    return np.stack([read.planes[name] for name in COLOR], axis=-1), read


def image_size(path: str | Path) -> tuple[int, int]:
    """Return W, H of an image file with any camera; raises InputError as `read_header` does."""
    return read_header(Path(path)).size


def read_image(
    path: str | Path,
    camera: HogelCamera | None = None,
    *,
    partial: bool = False,
    counted: str | None = None,
) -> HogelImage:
    """Read the image of any renderer; absent channels are None, NaN, or `NOTHING`.

    Parameters
    ----------
    camera
        Camera of files that state none; with `partial`, camera of all files.
    partial
        Whether any of `CHANNELS` suffices; else `id.triangle` or `P.X P.Y P.Z` is required.
    counted
        Meaning of a channel `id`, `TRIANGLE` or `OBJECT`; without it the channel only marks
        pixels without a surface.

    Raises
    ------
    InputError
        The file is missing, is damaged, has no camera, or has another size than its camera's film.
    """
    path = Path(path)
    read = read_channels(path, (*CHANNELS, ANY_ID))
    planes, header = read.planes, read.header
    if counted is not None and ANY_ID in planes and counted not in planes:
        planes[counted], read.places[counted] = planes[ANY_ID], read.places[ANY_ID]
    # Ignore a camera stored by another renderer: its image is judged as the stated hogel.
    own = None if partial else _described(path, header.attributes, CAMERA_ATTRIBUTE, CAMERA_JSON)
    camera = own or camera
    if camera is None:
        raise InputError(
            f"{path}: has no {CAMERA_ATTRIBUTE} attribute; state the camera of the image"
        )
    usable = planes.keys() & ({*CHANNELS} if partial else {TRIANGLE, *POSITION})
    if not usable:
        missing = (
            f"none of {' '.join(CHANNELS)}" if partial else "neither id.triangle nor P.X P.Y P.Z"
        )
        advice = "write one of them"
        if planes.keys() == {ANY_ID}:
            advice = "state with --encoding triangle-id or object-id what id counts"
        raise InputError(f"{path}: has {missing}; {advice}; it has {listed(header.channels)}")
    width, height = header.size
    if (width, height) != tuple(camera.resolution):
        film = f"{camera.resolution[0]} x {camera.resolution[1]}"
        raise InputError(
            f"{path}: is {width} x {height}, but its camera says {film}; render it again at that "
            "size"
        )
    position = _vectors(path, planes, POSITION)
    doubt = None if position is None else _uncertainty(path, read)
    if position is None:
        position = np.full((height, width, 3), np.nan, dtype=np.float32)
        position[..., 2] = planes.get(HEIGHT, np.nan)
    nowhere = _background(read, position, camera)
    certainty = planes.get(CERTAINTY)
    rendering = None
    if not partial:
        rendering = _described(path, header.attributes, RENDERING_ATTRIBUTE, RENDERING_JSON)
    return HogelImage(
        camera=camera,
        triangle=_numbers(path, TRIANGLE, read),
        object=_numbers(path, OBJECT, read),
        position=np.where(nowhere[..., None], np.float32(np.nan), position),
        normal=_vectors(path, planes, NORMAL),
        color=_vectors(path, planes, COLOR),
        variance=_vectors(path, planes, VARIANCE),
        certainty=None if certainty is None else certainty.astype(np.uint8),
        rendering=rendering,
        uncertainty=doubt,
        storage=_storage(read),
    )


def _background(read: ReadPlanes, position: Singles, camera: HogelCamera) -> Mask:
    """Return the pixels (H, W) that show no surface.

    Triangle or object numbers decide, if stored. Otherwise a position means no surface if it is not
    finite, 0 in all coordinates, or at least `FAR` in one coordinate: many renderers store such
    values. A surface point at the origin is not lost: the origin is in the plate, where a true
    hogel shows only the center of its own aperture.
    """
    numbers = [read.planes[name] for name in (TRIANGLE, OBJECT, ANY_ID) if name in read.places]
    if any(plane.any() for plane in numbers):  # numbers that no shader has set are all 0
        nowhere: Mask = np.logical_and.reduce([plane == 0 for plane in numbers])
        return nowhere
    # After lossy compression, 0 may be read as another number.
    exact = [name in read.places and read.lossy(name) is None for name in POSITION]
    axes = np.flatnonzero(exact).tolist()
    largest = np.abs(position[..., axes or [2]]).max(axis=-1).astype(np.float64)  # NaN if any is
    nowhere = ~((largest > 0) & (largest < max(FAR, *camera.reach)))
    # The same point in all pixels is a background, too, if all numbers are 0.
    return nowhere | bool(numbers and (position == position[0, 0]).all())


def _uncertainty(path: Path, read: ReadPlanes) -> Floats | None:
    """Return error bounds (H, W, 3) of stored coordinates; None if storage is exact.

    Raises InputError if all three channels have lossy compression, or if any has B44.
    """
    places = [read.places[name] for name in POSITION]
    kinds = [read.lossy(name) for name in POSITION]
    if None not in kinds or any(kind is not None and kind.startswith("B44") for kind in kinds):
        place, kind = next(pair for pair in zip(places, kinds, strict=True) if pair[1] is not None)
        raise InputError(
            f"{path}: channel {place.words} is stored with {kind}, which changes its values; "
            "write P.X P.Y P.Z with the compression ZIP"
        )
    # Only DWA has a level, which bounds the error of a coefficient.
    level = read.header.attributes.get("dwaCompressionLevel")
    bounds = [
        uncertainty(read.planes[name], place.name, read.header.compressions[place.part], level)
        for name, place in zip(POSITION, places, strict=True)
    ]
    if all(bound is None for bound in bounds):
        return None
    exact = np.zeros(read.planes[POSITION[0]].shape)
    return np.stack([exact if bound is None else bound for bound in bounds], axis=-1)


def _storage(read: ReadPlanes) -> str | None:
    """Return a description of the channels' lossy compression; None if all are lossless."""
    kinds = sorted({kind for name in read.places if (kind := read.lossy(name)) is not None})
    return f"OpenEXR {' and '.join(kinds)}, lossy" if kinds else None


def _described(
    path: Path, header: Mapping[str, Any], name: str, kind: TypeAdapter[Described]
) -> Described | None:
    """Return the object that an attribute of the header describes; None if it is missing."""
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
    """Return three channels as (H, W, 3), or None if the file has none of them."""
    missing = [name for name in names if name not in planes]
    if len(missing) == len(names):
        return None
    if missing:
        raise InputError(
            f"{path}: has no channel {missing[0]} beside the other channels of {' '.join(names)}"
        )
    return np.stack([planes[name] for name in names], axis=-1).astype(np.float32, copy=False)


def _numbers(path: Path, name: str, read: ReadPlanes) -> Numbers:
    """Return numbers from a channel that stores number + 1 as integers or floats."""
    plane = read.planes.get(name)
    if plane is None:
        return np.full(read.header.size[::-1], NOTHING, np.int32)
    largest = np.iinfo(np.int32).max
    if plane.dtype == np.float16:  # infinity of float32 compares as a number beyond `largest`
        plane = plane.astype(np.float32)
    if not ((plane >= 0) & (plane <= largest) & (plane == np.floor(plane))).all():
        raise InputError(
            f"{path}: channel {name} must hold whole numbers from 0 to {largest}, number + 1"
        )
    if (kind := read.lossy(name)) is not None:
        raise InputError(
            f"{path}: channel {name} is stored with {kind}, which changes numbers; write ZIP"
        )
    compression = read.header.compressions[read.places[name].part]
    exact = largest_whole(read.planes[name].dtype, compression)
    if plane.max(initial=0) > exact:
        raise InputError(
            f"{path}: channel {name} holds numbers above {exact:,}, which its type rounds; write "
            "unsigned integers"
        )
    return np.asarray(plane.astype(np.int64) - 1, dtype=np.int32)


def stored_planes(image: HogelImage | EyeImage) -> dict[str, NDArray[Any]]:
    """Return every channel of an image, (H, W), by name, with the types of a file."""
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
    path: Path,
    size: tuple[int, int],
    types: Mapping[str, np.dtype[Any]],
    attributes: Mapping[str, bytes],
) -> Iterator[Callable[[Planes], None]]:
    """Write a lossless file from the top down: yield a function that writes the next rows."""
    # Names and number types of attributes follow from the library's default header.
    header: dict[str, Any] = OpenEXR.Header(*size)
    header["compression"] = Imath.Compression(Imath.Compression.ZIP_COMPRESSION)
    header["channels"] = {
        name: Imath.Channel(Imath.PixelType(_PIXEL_TYPES.index(kind.type)))
        for name, kind in types.items()
    }
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
    # OpenEXR reports no errors in the last bytes that it writes: read the last row to find them.
    with _silence():
        written = OpenEXR.InputFile(str(path))
        if not written.isComplete():
            raise OSError("the written file is not complete")
        written.channel(next(iter(types)), scanLine1=size[1] - 1, scanLine2=size[1] - 1)


@contextmanager
def image_writer(
    path: str | Path,
    camera: HogelCamera,
    arrays: Sequence[str] = (),
    rendering: Rendering | None = None,
) -> Iterator[Callable[[HogelImage], None]]:
    """Write an image from the top down: yield a function that writes the next band.

    A band is an image of full width and any number of rows; `arrays` lists its optional arrays. The
    file replaces an older file when the block ends without an exception. Raises InputError if the
    file cannot be written, or the image exceeds `MAX_PIXELS`.
    """
    path, (width, height), written = Path(path), camera.resolution, 0
    if width * height > MAX_PIXELS:
        raise InputError(
            f"{path}: an image of {width} x {height} pixels is more than OpenEXR writes here, "
            f"{MAX_PIXELS:,}; lower frustum.resolution"
        )
    names = [*POSITION, HEIGHT, TRIANGLE, OBJECT]
    names += [name for array in arrays for name in _OPTIONAL[array]]
    numbers = (TRIANGLE, OBJECT, CERTAINTY)
    types = {name: np.dtype(np.uint32 if name in numbers else np.float32) for name in names}
    attributes = {CAMERA_ATTRIBUTE: CAMERA_JSON.dump_json(camera)}
    if rendering is not None:
        attributes[RENDERING_ATTRIBUTE] = RENDERING_JSON.dump_json(rendering)
    temporary = path

    @contextmanager
    def refused(advice: str) -> Iterator[None]:
        try:
            yield
        except (OSError, RuntimeError) as error:
            reason = " ".join(str(getattr(error, "strerror", None) or error).split())
            # OpenEXR's message names the temporary file, which does not exist afterwards.
            reason = reason.replace(str(temporary), path.name)
            raise InputError(f"{path}: cannot write the image ({reason}); {advice}") from error

    def write_band(band: HogelImage) -> None:
        nonlocal written
        rows, columns = band.triangle.shape
        if columns != width or written + rows > height:
            raise ValueError(
                f"a band of {columns} x {rows} at row {written} leaves {width} x {height}"
            )
        with refused("check the disk"):
            write(stored_planes(band))
        written += rows

    with ExitStack() as stack:
        with refused("choose another folder"):
            temporary = stack.enter_context(new_file(path))
            write = stack.enter_context(_rows(temporary, camera.resolution, types, attributes))
        yield write_band
        if written != height:
            raise ValueError(f"only {written} of {height} rows were written")
        with refused("check the disk"):
            stack.close()


def write_image(path: str | Path, image: HogelImage) -> None:
    """Write an image losslessly: 32-bit floats, numbers plus one; InputError if that fails."""
    arrays = [name for name in _OPTIONAL if getattr(image, name) is not None]
    with image_writer(path, image.camera, arrays, image.rendering) as write:
        write(image)


def write_planes(path: Path, planes: Planes, attributes: Mapping[str, bytes] | None = None) -> None:
    """Write channels (H, W) of any type into a file in place; InputError if that fails."""
    height, width = next(iter(planes.values())).shape
    types = {name: plane.dtype for name, plane in planes.items()}
    # Write in place: callers write into a temporary folder, which is renamed as a whole.
    try:
        with _rows(path, (width, height), types, attributes or {}) as write:
            write(planes)
    except (OSError, RuntimeError) as error:
        raise InputError(f"{path.name}: cannot write the image; free some space") from error


def write_eye_image(path: Path, image: EyeImage) -> None:
    """Write the image of an eye, with the eye in the header; see `write_planes`."""
    write_planes(path, stored_planes(image), {EYE_ATTRIBUTE: EYE_JSON.dump_json(image.eye)})
