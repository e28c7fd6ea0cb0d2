"""Reading hogel images from OpenEXR files, by this or any other renderer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import Imath
import numpy as np
import OpenEXR
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from xfrustum.scenes.arrays import Numbers, Singles
from xfrustum.scenes.disk.quiet import without_messages_of_failure
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.openexr.channels import (
    CAMERA_ATTRIBUTE,
    CAMERA_JSON,
    CERTAINTY,
    CHANNELS,
    COLOR,
    HEIGHT,
    NORMAL,
    OBJECT,
    POSITION,
    RENDERING_ATTRIBUTE,
    RENDERING_JSON,
    TRIANGLE,
    VARIANCE,
)
from xfrustum.scenes.files.openexr.header import check_header
from xfrustum.scenes.model.hogel_image import NOTHING, HogelCamera, HogelImage

Described = TypeVar("Described")
Found = TypeVar("Found")

_NUMPY_TYPES = {
    Imath.PixelType.UINT: np.uint32,
    Imath.PixelType.HALF: np.float16,
    Imath.PixelType.FLOAT: np.float32,
}


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
    planes, header = _read_planes(path)
    own = None if partial else _described(path, header, CAMERA_ATTRIBUTE, CAMERA_JSON)
    found = own or camera
    if found is None:
        raise InputError(f"{path}: has no {CAMERA_ATTRIBUTE} attribute; say which camera it answers for")
    if not planes:
        wanted = " ".join(CHANNELS) if partial else "id.triangle nor P.X P.Y P.Z"
        raise InputError(f"{path}: has {'none of' if partial else 'neither'} {wanted}; write one of them")
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


def image_size(path: str | Path) -> tuple[int, int]:
    """Return W, H of an image file, whatever camera it names.

    Raises
    ------
    InputError
        The file is missing or damaged.
    """
    return _guarded(Path(path), lambda file: _size(file.header()))


def _read_planes(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the contract's channels that the file has, (H, W) each, and its header."""

    def read(file: OpenEXR.InputFile) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        header = file.header()
        if not file.isComplete():
            raise OSError("rows are missing")
        width, height = _size(header)
        present = {name: header["channels"][name] for name in CHANNELS if name in header["channels"]}
        for name, channel in present.items():
            if (channel.xSampling, channel.ySampling) != (1, 1):
                raise InputError(f"{path}: channel {name} is subsampled; write every pixel of it")
        raw = file.channels(list(present)) if present else []
        planes = {
            name: np.frombuffer(data, dtype=_NUMPY_TYPES[channel.type.v]).reshape(height, width)
            for (name, channel), data in zip(present.items(), raw, strict=True)
        }
        return planes, header

    return _guarded(path, read)


def _guarded(path: Path, read: Callable[[OpenEXR.InputFile], Found]) -> Found:
    """Return the result of reading a file; any exception that OpenEXR raises becomes an InputError."""
    check_header(path)
    try:
        # OpenEXR also prints its errors.
        with without_messages_of_failure():
            return read(OpenEXR.InputFile(str(path)))
    except (OSError, RuntimeError, KeyError, TypeError, ValueError, MemoryError) as error:
        raise InputError(f"{path}: the OpenEXR image is damaged ({error}); write it again") from error


def _size(header: dict[str, Any]) -> tuple[int, int]:
    """Return W, H of the pixels that a file has."""
    window = header["dataWindow"]
    return window.max.x - window.min.x + 1, window.max.y - window.min.y + 1


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
