"""The pixels of a plate, written into files in any layout."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.layouts.layout import Layout, Naming, Part, Pixels, PlateShape, as_plate, row_of
from xfrustum.scenes.files.layouts.picture_files import (
    BYTE_LEVELS,
    PLENO_LEVELS,
    Picture,
    write_picture,
)
from xfrustum.scenes.files.layouts.reading import PlateRows, whole_plate, with_levels
from xfrustum.scenes.files.layouts.tiles import CUBEVI_TILE_PX, CubeVi, Mosaic, Quilt
from xfrustum.scenes.files.layouts.video import write_video


@dataclass(frozen=True, kw_only=True)
class Target:
    """What is to be written.

    Attributes
    ----------
    layout
        Layout of the files.
    naming
        Suffix and other facts that names state.
    """

    layout: Layout
    naming: Naming

    def levels(self, before: int | None) -> int | None:
        """Return the largest level of the files' pixels; None where they are floating-point numbers.

        Raises
        ------
        InputError
            Files with this suffix are not written.
        """
        suffix = self.naming.suffix
        if suffix == ".ppm":
            return PLENO_LEVELS if self.layout.name == "pleno" else before or BYTE_LEVELS
        if suffix in (".png", ".avi"):
            return BYTE_LEVELS
        if suffix == ".exr":
            return None
        raise InputError(f"files that end in {suffix} are not written; choose .png, .ppm or .exr")

    def files(self, shape: PlateShape) -> int:
        """Return the number of files of a plate."""
        return sum(1 for _ in self.layout.parts(shape, self.naming))

    def losses(self, plate: PlateRows) -> tuple[str, ...]:
        """Return what is lost when a plate is written, one clause each; none where every bit is kept."""
        return tuple(self._losses(plate))

    def _losses(self, plate: PlateRows) -> Iterator[str]:
        height, after = plate.shape.resolution[1], self.levels(plate.levels)
        if self.layout.horizontal and height > 1:
            yield (
                f"vertical parallax: of {height} rows of pixels of each hogel, row {height // 2} "
                f"(from 0 at the top) is kept"
            )
        if plate.levels is None and after is not None:
            yield f"floating-point numbers: radiance is clipped to 0 and 1 and rounded to {after} levels"
        elif plate.levels is not None and after is not None and after < plate.levels:
            yield f"levels: {plate.levels} are rounded to {after}"

    def notes(self, shape: PlateShape) -> tuple[str, ...]:
        """Return what readers of this layout may expect and files do not have, one sentence each."""
        if self.layout.name == "burnett":
            return ("its own renderer samples pixels at their corners; re-arranging moves no sample",)
        if isinstance(self.layout, Quilt):
            return (
                "views are evenly spaced on the film (in tangents), and a display's eyes evenly in angle",
            )
        if isinstance(self.layout, CubeVi) and shape.hogels != CUBEVI_TILE_PX:
            size = f"{CUBEVI_TILE_PX[0]} x {CUBEVI_TILE_PX[1]}"
            return (f"the display has tiles of {size} pixels, and this plate {shape.words}",)
        return ()


def write_files(
    plate: PlateRows, target: Target, folder: Path, done: Callable[[], object] = lambda: None
) -> None:
    """Write a plate into a folder; `done` is called after each file.

    Where each file has pixels of one row of hogels alone, no more than a row is held in memory.

    Raises
    ------
    InputError
        The layout has no place for such a plate, or the files cannot hold its pixels.
    OSError
        A file cannot be written.
    """
    shape = plate.shape
    levels = target.levels(plate.levels)
    text: dict[str, object] | None = None
    if isinstance(target.layout, Mosaic):
        text = {"layout": target.layout.name, "hogels": shape.hogels, "resolution": shape.resolution}
    for part, pixels_of_plate in _with_pixels(plate, target):
        stored = np.ascontiguousarray(part.select(pixels_of_plate))
        width, height = part.size
        pixels = stored.reshape(*(() if part.frames is None else (part.frames,)), height, width, 3)
        picture = Picture(pixels=with_levels(pixels, plate.levels, levels), levels=levels)
        if part.frames is None:
            write_picture(folder / part.name, picture, text)
        else:
            write_video(folder / part.name, picture.pixels)
        done()


def _with_pixels(plate: PlateRows, target: Target) -> Iterator[tuple[Part, Pixels]]:
    """Yield the files of a plate, each with an array of the plate's axes that has its pixels, row by row."""
    parts: dict[int, list[Part]] = {}
    for part in target.layout.parts(plate.shape, target.naming):
        row = row_of(part, plate.shape)
        if row is None:
            pixels = whole_plate(plate).pixels
            yield from ((one, pixels) for one in target.layout.parts(plate.shape, target.naming))
            return
        parts.setdefault(row, []).append(part)
    for row, held in sorted(parts.items()):
        pixels = as_plate(plate.row(row), plate.shape)
        yield from ((part, pixels) for part in held)
