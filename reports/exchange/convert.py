"""Plates converted between layouts of files and Zarr groups (CONVENTIONS.md, "Plates").

Sentences state the evidence for a recognized layout, and the losses of a written layout.
"""

import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from xfrustum.reports.common.outputs import Staging, check_writable_folder, progress_bar, refused
from xfrustum.reports.plate.arrays import (
    ATTRIBUTE,
    COMPRESSOR,
    DAMAGE,
    FINISHED,
    METADATA,
    reason_of,
)
from xfrustum.reports.plate.store import checked_group, read_hogel, read_hogels
from xfrustum.scenes import InputError, Scene
from xfrustum.scenes.arguments import choice
from xfrustum.scenes.arrays import Bytes, Numbers
from xfrustum.scenes.disk import TempPath, check_allowed
from xfrustum.scenes.files import layouts, plate_files
from xfrustum.scenes.files.layouts import Target
from xfrustum.scenes.files.pictures import Encoding, Reading, bytes_of
from xfrustum.scenes.files.plate_files import FileSet, PlateRows
from xfrustum.scenes.model.images import Channel, PlateContent


def layout_reasons(files: FileSet) -> tuple[str, ...]:
    """Return the evidence for the layout of some files, one clause each."""
    count, total = len(files.files), files.layout.file_count(files.shape)
    fit = f"{count} of {count + files.strangers} names fit: {files.layout.meaning}"
    lacking = [f"{files.missing} of {total} files are not there"] if files.missing else []
    return fit, f"such as {files.files[min(files.files)].name}", *lacking, str(files.shape)


def described(files: FileSet) -> str:
    """Return layout and evidence in one line."""
    return f"{files.layout.name} ({'; '.join(layout_reasons(files))})"


def layout_losses(plate: PlateRows, target: Target) -> tuple[str, ...]:
    """Return the data that a layout cannot store, one clause each."""
    clauses, height = [], plate.shape.resolution[1]
    if target.layout.horizontal and height > 1:
        clauses.append(
            f"vertical parallax: of {height} rows of pixels of each hogel, row {height // 2} "
            "(from 0 at the top) is kept"
        )
    if plate.floating and not target.floating:
        clauses.append(
            "floating-point numbers: radiance is clipped to 0 and 1 and rounded to 255 levels"
        )
    return tuple(clauses)


def layout_notes(plate: PlateRows, target: Target) -> tuple[str, ...]:
    """Return the expectations of a layout's readers that its files do not meet."""
    # These facts concern other programs; no pixel of the files shows them.
    if target.layout.name == "burnett":
        return ("its own renderer samples pixels at their corners; re-arranging moves no sample",)
    if target.layout.name != "quilt":
        return ()
    encoding = "pixels are encoded as in the files that were read; displays take them for sRGB"
    if plate.linear:
        chunk = "" if target.floating else " (a PNG file says so: gAMA)"
        encoding = (
            "pixels are linear radiance, as the plate stores them, and displays take them for "
            f"sRGB{chunk}; `view --quilt` writes sRGB"
        )
    spacing = "views are evenly spaced on the film (in tangents), a display's eyes evenly in angle"
    return spacing, encoding


def missing_hogels(count: int) -> tuple[str, ...]:
    """Return the note about hogels that a Zarr group lacks."""
    return (f"{count} hogels are not there and count as empty",) if count else ()


def incomplete(files: FileSet, *, stated: bool) -> str | None:
    """Return the reason why files cannot be converted; None if the plate is complete.

    `stated` is whether the user gave the number of hogels.
    """
    name, shape = files.layout.name, files.shape
    if files.missing:
        return f"{files.missing} files of the layout {name} are not there, for a plate of {shape}"
    if files.beyond:
        advice = "leave out --hogels, or give all of them" if stated else "move the others away"
        return (
            f"{files.beyond} of {len(files.files)} files of the layout {name} lie beyond a plate "
            f"of {shape}; {advice}"
        )
    return None


#: layout name of Zarr groups, and suffix of their folders
ZARR, ZARR_SUFFIX = "zarr", ".zarr"
#: name of the attribute with the source of a converted group
LAYOUT_ATTRIBUTE = "xfrustum:converted"
NUMBERED = Reading(
    encoding=Encoding.TRIANGLE_ID
    #: pixels that hold triangle numbers; see `packed`
)


class PlateArray(StrEnum):
    """Array of a plate."""

    COLOR = "color"
    TRIANGLE = "triangle"


@dataclass(frozen=True, kw_only=True)
class GroupPlate:
    """A plate in a Zarr group; triangle numbers are pixels as in `--encoding triangle-id`."""

    rows: PlateRows
    array: PlateArray
    #: number of hogels that were never drawn, >= 0; 0 if the group does not state it
    missing: int
    #: function that returns the hogel of a column and a row as stored, or None if it was never
    #: drawn; InputError if it is damaged
    hogel: Callable[[int, int], NDArray[Any] | None]


def open_plate(place: Path, array: PlateArray | None = None) -> GroupPlate:
    """Return a plate's pixels, by default its colors or, without colors, its triangle numbers."""
    group = checked_group(place)
    try:
        names = [name for name in PlateArray if name in group]
        chosen = array or (names[0] if names else PlateArray.COLOR)
        if chosen not in names:
            raise InputError(
                f"{place}: has no array {chosen}; is it a plate that `xfrustum plate` drew?"
            )
        stored, flags = group[chosen], group.get(FINISHED)
    except DAMAGE as error:
        raise InputError(f"{place}: is no plate that can be read ({reason_of(error)})") from error
    colored, drawn = chosen is PlateArray.COLOR, ATTRIBUTE in group.attrs
    if (
        not isinstance(stored, zarr.Array)
        or stored.ndim != (5 if colored else 4)
        or stored.dtype.kind not in ("uif" if colored else "ui")
    ):
        raise InputError(f"{place}: array {chosen} is not that of a plate")
    rows, columns, height, width = (int(count) for count in stored.shape[:4])
    shape = layouts.PlateShape(hogels=(columns, rows), resolution=(width, height))
    # Zarr allocates whole chunks and shards, and a group may declare them arbitrarily large.
    largest = max(
        math.prod(stored.shape[2:]), math.prod(stored.chunks), math.prod(stored.shards or ())
    )
    check_allowed(place, largest * stored.dtype.itemsize, f"one hogel or chunk of {chosen}")
    dtype = stored.dtype if colored else np.dtype(np.uint8)
    if dtype not in (np.uint8, np.float16, np.float32):
        raise InputError(
            f"{place}: array {chosen} has type {dtype}, and not uint8, float16 or float32"
        )
    finished = flags if isinstance(flags, zarr.Array) and flags.shape == (rows, columns) else None
    # Unfinished hogels are empty; groups of other programs may lack the files of empty hogels.
    done = np.ones((rows, columns), dtype=np.bool_)
    try:
        if finished is not None:
            flagged = np.asarray(finished[:]) != 0
            missing = int(np.count_nonzero(~flagged))
            done = flagged if drawn else done
        elif stored.shards is None and stored.chunks == (1, 1, *stored.shape[2:]):
            missing = rows * columns - stored.nchunks_initialized
        else:
            missing = 0
    except DAMAGE as error:
        raise InputError(f"{place}: array {FINISHED} is damaged; draw the plate again") from error

    must_exist = drawn and finished is not None

    def hogel(column: int, number: int) -> NDArray[Any] | None:
        if not done[number, column]:
            return None
        image: NDArray[Any] = read_hogel(place, stored, column, number, must_exist=must_exist)
        return image

    def row(number: int) -> layouts.Pixels:
        pixels = plate_files.empty_row(shape, dtype)
        chosen = np.flatnonzero(done[number]).tolist()
        for column, image in read_hogels(place, stored, number, chosen, must_exist=must_exist):
            pixels[column] = image if colored else packed(image)
        return pixels

    plate = PlateRows(shape=shape, dtype=dtype, row=row, linear=colored and drawn)
    return GroupPlate(rows=plate, array=chosen, missing=missing, hogel=hogel)


def write_group(
    plate: PlateRows,
    place: Path,
    array: PlateArray,
    description: dict[str, object],
    done: Callable[[], object] = lambda: None,
) -> None:
    """Write a plate into a new Zarr group, a chunk per hogel, and call `done` after each."""
    group = zarr.create_group(place, attributes={LAYOUT_ATTRIBUTE: description})
    colored = array is PlateArray.COLOR
    shape = plate.shape.array if colored else plate.shape.array[:4]
    stored = group.create_array(
        array,
        shape=shape,
        chunks=(1, 1, *shape[2:]),
        dtype=plate.dtype if colored else np.dtype(np.int32),
        compressors=[COMPRESSOR],
        fill_value=0 if colored else -1,
        dimension_names=("row", "column", "v", "u", "rgb")[: len(shape)],
        # Without this, hogels of zeros have no files and look like missing hogels.
    ).with_config({"write_empty_chunks": True})
    for row in range(shape[0]):
        for column, hogel in enumerate(plate.row(row)):
            stored[row, column] = hogel if colored else NUMBERED.numbers(NUMBERED.packed(hogel))
            done()


def packed(triangle: Numbers) -> Bytes:
    """Return numbers (.., -1 for nothing) as pixels (.., 3): 65536 red + 256 green + blue - 1."""
    number = triangle.astype(np.int64) + 1
    if number.max(initial=0) >= 1 << 24:
        raise InputError("numbers of triangles above 16,777,214 do not fit into pictures of 8 bits")
    return bytes_of(number)


@dataclass(frozen=True, kw_only=True)
class Conversion:
    """Result of a conversion."""

    source: Path
    #: folder or file that was written
    out: Path
    read_as: str
    #: evidence for the layout that was read, one clause each
    reasons: tuple[str, ...]
    written_as: str
    hogels: tuple[int, int]
    #: width and height of each hogel as read, pixels
    resolution: tuple[int, int]
    #: number of written files; for a Zarr group, the number of hogels
    files: int
    #: data that the layout cannot store; empty if every bit was kept
    losses: tuple[str, ...]
    #: expectations of readers that the files do not meet
    notes: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class ConversionOptions:
    """Facts that files need not state themselves."""

    #: columns and rows of hogels, which a mosaic does not state
    hogels: tuple[int, int] | None = None
    #: columns and rows of tiles of a quilt to be written
    tiles: tuple[int, int] | None = None
    #: .png or .exr; None: .exr for floating point, else .png
    suffix: str | None = None
    #: array of a Zarr group to be read or written
    array: PlateArray | str | None = None
    #: width over height of the plate; None: ratio of hogels
    aspect: float | None = None


def convert(
    source: Path | str,
    out: Path | str,
    read_as: str | None = None,
    write_as: str | None = None,
    options: ConversionOptions | None = None,
    *,
    progress: bool = False,
) -> Conversion:
    """Write the plate of a folder, a picture or a Zarr group (NAME.zarr) in another layout.

    Parameters
    ----------
    read_as, write_as
        Name of a layout, or `zarr`. Without `read_as`, the names of files decide; without
        `write_as`, `out` must be a Zarr group by its name.

    Raises
    ------
    InputError
        The source cannot be read in this layout, or nothing can be written at `out`.
    """
    source, out, options = Path(source), Path(out), options or ConversionOptions()
    target = write_as or (ZARR if out.suffix.lower() == ZARR_SUFFIX else None)
    if target is None:
        raise InputError(
            "give the layout to write with --to; only names that end in .zarr state it themselves"
        )
    array = None if options.array is None else choice(PlateArray, options.array, "array")
    if read_as == ZARR or (read_as is None and (source / METADATA).is_file()):
        group = open_plate(source, array)
        plate, layout, notes = group.rows, ZARR, missing_hogels(group.missing)
        reasons = (f"array {group.array}", str(plate.shape), *notes)
    else:
        files = _files_at(source, read_as, options)
        plate, layout, notes = files.rows(), files.layout.name, ()
        reasons = layout_reasons(files)
    losses: tuple[str, ...] = ()
    if target == ZARR:
        if array is PlateArray.TRIANGLE and plate.floating:
            raise InputError(f"{source}: holds floating-point colors, and no numbers of triangles")
        described: dict[str, object] = {"source": str(source), "layout": layout}
        _into_group(plate, out, array or PlateArray.COLOR, described, progress=progress)
        count = math.prod(plate.shape.hogels)
    else:
        form = _target(plate, out, target, options)
        target, losses = form.layout.name, layout_losses(plate, form)
        out, count = _into_files(plate, out, form, progress=progress)
        notes += layout_notes(plate, form)
    return Conversion(
        source=source,
        out=out,
        read_as=layout,
        reasons=reasons,
        written_as=target,
        hogels=plate.shape.hogels,
        resolution=plate.shape.resolution,
        files=count,
        losses=losses,
        notes=notes,
    )


def _files_at(source: Path, read_as: str | None, options: ConversionOptions) -> plate_files.FileSet:
    """Return the files of a whole plate; InputError if the plate is incomplete."""
    shape = None
    if options.hogels is not None:
        shape = layouts.PlateShape(hogels=options.hogels, resolution=(1, 1))
    rows = layouts.LAYOUTS if read_as is None else layouts.layouts_named(read_as)
    files = plate_files.find_files(source, shape, rows)
    if problem := incomplete(files, stated=options.hogels is not None):
        raise InputError(f"{source}: {problem}")
    return files


def _into_group(
    plate: PlateRows,
    out: Path,
    array: PlateArray,
    described: dict[str, object],
    *,
    progress: bool,
) -> None:
    """Write a plate into a new Zarr group."""
    if out.exists() or out.is_symlink():
        raise InputError(
            f"{out}: exists; choose another place, for a group is written in one piece"
        )
    with (
        refused(f"{out}: cannot be written", "choose another place"),
        TempPath(out.absolute().parent, folder=True) as temporary,
        progress_bar(math.prod(plate.shape.hogels), "convert", "hogel", shown=progress) as bar,
    ):
        # The rename makes the group appear as a whole.
        made = temporary.path / "group"
        write_group(plate, made, array, described, bar.update)
        made.rename(out)


def is_one_file(out: Path, layout: str) -> bool:
    """Return whether a layout is written as a single file of this name, not as a folder."""
    return layout in layouts.SINGLE_PICTURES and out.suffix.lower() in layouts.PICTURE_SUFFIXES


def _target(plate: PlateRows, out: Path, name: str, options: ConversionOptions) -> layouts.Target:
    """Return layout and names of the files to be written; InputError for wrong options."""
    layout, single = layouts.layouts_named(name)[0], is_one_file(out, name)
    suffix = out.suffix.lower() if single else options.suffix
    suffix = suffix or (".exr" if plate.floating else ".png")
    if suffix not in (".png", ".exr"):
        raise InputError(f"files that end in {suffix} are not written; choose .png or .exr")
    # The part of a quilt's name after _qs is generated.
    stem = out.stem.partition("_qs")[0] if name == "quilt" else out.stem
    form = layouts.Target(
        layout=layout,
        suffix=suffix,
        stem=stem if single else "",
        aspect=options.aspect,
        tiles=options.tiles,
    )
    # Before the work, refuse fewer tiles than views.
    form.stated(plate.shape)
    return form


def _into_files(
    plate: PlateRows, out: Path, form: layouts.Target, *, progress: bool
) -> tuple[Path, int]:
    """Write a plate into files; return their folder, or the single file, and their number."""
    single, count = is_one_file(out, form.layout.name), form.layout.file_count(plate.shape)
    with Staging(out.absolute().parent if single else out) as staging:
        with progress_bar(count, "convert", "file", shown=progress) as bar:
            plate_files.write_files(plate, form, staging.folder, bar.update)
        written = staging.commit()
    return out.with_name(written[0].name) if single else out, count


#: suffix of a group that is removed after the files of the layout are written
DRAWING_SUFFIX = ".drawing.zarr"


@dataclass(frozen=True, kw_only=True)
class LaidOutPlate:
    """Paths of a plate that is drawn into NAME.zarr and written as files of a layout."""

    out: Path
    layout: str

    @property
    def keeps_group(self) -> bool:
        """True if the group stays after the files are written."""
        return self.out.suffix.lower() == ZARR_SUFFIX

    @property
    def group(self) -> Path:
        """The group that the plate is drawn into; a stopped run continues with it."""
        return self.out if self.keeps_group else self.out.with_name(self.out.name + DRAWING_SUFFIX)

    @property
    def files(self) -> Path:
        """The folder of the files, or the one picture."""
        laid_out = self.out.with_name(f"{self.out.stem}-{self.layout}")
        return laid_out if self.keeps_group else self.out

    def check(self, scene: Scene, content: PlateContent, *, judged: bool) -> None:
        """Raise InputError if the files cannot be written, or would lose images or measures."""
        if not {Channel.COLOR, Channel.TRIANGLE} & {*content.channels}:
            raise InputError(
                "--layout writes colors or triangle numbers: add color or triangle to --channels"
            )
        if not self.keeps_group and (judged or len(content.channels) > 1):
            raise InputError(
                f"--out {self.out}: files in a layout hold one image of each hogel, and no "
                f"measures; let the name end in {ZARR_SUFFIX}, and the Zarr group with all of them "
                "stays"
            )
        (layout, *_), resolution = layouts.layouts_named(self.layout), scene.frustum.resolution
        shape = layouts.PlateShape(hogels=scene.plate.hogels, resolution=resolution)
        layouts.Target(layout=layout).stated(shape)
        single = is_one_file(self.files, self.layout)
        check_writable_folder(self.files.absolute().parent if single else self.files)

    def write(self, scene: Scene) -> Conversion:
        """Write the files of a drawn plate, and remove the group unless it is to be kept."""
        width, height = scene.plate.size
        options = ConversionOptions(aspect=width / height)
        done = convert(self.group, self.files, ZARR, self.layout, options)
        if not self.keeps_group:
            shutil.rmtree(self.group)
        return done
