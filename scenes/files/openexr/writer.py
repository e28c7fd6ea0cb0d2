"""Writing hogel images as OpenEXR files, band by band, aside and then renamed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR

from xfrustum.scenes.disk.durable import AllOrNothing, NewFile
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.openexr.channels import (
    CAMERA_ATTRIBUTE,
    CAMERA_JSON,
    CERTAINTY,
    COLOR,
    HEIGHT,
    NORMAL,
    OBJECT,
    POSITION,
    RENDERING_ATTRIBUTE,
    RENDERING_JSON,
    TRIANGLE,
    VARIANCE,
    lossless_header,
    pixel_type,
    stored_planes,
)
from xfrustum.scenes.files.openexr.whole import check_whole
from xfrustum.scenes.model.hogel_image import HogelCamera, HogelImage
from xfrustum.scenes.model.rendering import Rendering

MAX_PIXELS = (2**31 - 1) // 4
"""Largest number of pixels: OpenEXR's Python module counts a channel's bytes, 4 a pixel, in 32 bits."""


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
    normals, color, variance, certainty
        Whether the bands have these arrays.
    rendering
        Effects and samples of the whole image's color; None where they are not known.

    Raises
    ------
    InputError
        The file cannot be written, or the image has more than `MAX_PIXELS`.
    """

    def __init__(  # noqa: PLR0913 - one parameter per optional part of the file
        self,
        path: str | Path,
        camera: HogelCamera,
        *,
        normals: bool = False,
        color: bool = False,
        variance: bool = False,
        certainty: bool = False,
        rendering: Rendering | None = None,
    ) -> None:
        self._path = Path(path)
        self._camera = camera
        self._next_row = 0
        self._channels = (
            *(COLOR if color else ()),
            *(VARIANCE if variance else ()),
            *POSITION,
            *(NORMAL if normals else ()),
            HEIGHT,
            TRIANGLE,
            OBJECT,
            *((CERTAINTY,) if certainty else ()),
        )
        width, height = camera.resolution
        if width * height > MAX_PIXELS:
            raise InputError(
                f"{self._path}: an image of {width} x {height} pixels is more than OpenEXR writes here, "
                f"{MAX_PIXELS:,}; lower frustum.resolution"
            )
        header = lossless_header(camera.resolution, {name: pixel_type(name) for name in self._channels})
        header[CAMERA_ATTRIBUTE] = CAMERA_JSON.dump_json(camera)
        if rendering is not None:
            header[RENDERING_ATTRIBUTE] = RENDERING_JSON.dump_json(rendering)
        try:
            self._new = NewFile(self._path)
        except OSError as error:
            raise InputError(
                f"{self._path}: cannot write the image ({error.strerror}); choose another folder"
            ) from error
        try:
            # This is OpenEXR's older interface: the newer one writes whole images only.
            self._file = OpenEXR.OutputFile(self._new.open_name, header)
        except BaseException as error:
            self._new.discard()
            if not isinstance(error, OSError):
                raise
            raise InputError(
                f"{self._path}: cannot write the image (OpenEXR cannot open it); choose another folder"
            ) from error

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
        if width != self._camera.resolution[0] or first_row + rows > self._camera.resolution[1]:
            raise ValueError(
                f"a band of {width} x {rows} at row {first_row} leaves {self._camera.resolution}"
            )
        planes = stored_planes(band)
        pixels = {name: np.ascontiguousarray(planes[name]).tobytes() for name in self._channels}
        try:
            self._file.writePixels(pixels, rows)
        except (OSError, RuntimeError) as error:
            raise self._refused(error) from error
        self._next_row += rows

    def commit(self) -> None:
        """Put the complete file under its name, once it is on the disk."""
        if self._next_row != self._camera.resolution[1]:
            self.discard()
            raise ValueError(f"only {self._next_row} of {self._camera.resolution[1]} rows were written")
        try:
            self._file.close()
            # OpenEXR does not report errors in the last bytes that it writes.
            check_whole(self._new.aside, self._camera.resolution[1])
            self._new.commit()
        except (OSError, RuntimeError) as error:
            raise self._refused(error) from error
        finally:
            self._new.discard()

    def discard(self) -> None:
        """Leave no trace."""
        try:
            self._file.close()
        finally:
            self._new.discard()

    def _refused(self, error: OSError | RuntimeError) -> InputError:
        reason = " ".join(str(getattr(error, "strerror", None) or error).split())
        # OpenEXR names the file that was set aside, which does not exist afterwards.
        reason = reason.replace(self._new.open_name, self._path.name)
        return InputError(f"{self._path}: cannot write the image ({reason}); check the disk")


def write_image(path: str | Path, image: HogelImage) -> None:
    """Write an image: floats in 32 bits, numbers plus one, lossless.

    Raises
    ------
    InputError
        The file cannot be written; nothing is left behind.
    """
    with ImageWriter(
        path,
        image.camera,
        normals=image.normal is not None,
        color=image.color is not None,
        variance=image.variance is not None,
        certainty=image.certainty is not None,
        rendering=image.rendering,
    ) as writer:
        writer.write_rows(0, image)
