"""Plates from one layout into another, from and into Zarr groups (CONVENTIONS.md, "Plates"), and as drawn."""

import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from xfrustum.reports.common.outputs import Staging, check_writable_folder, progress_bar, refused
from xfrustum.reports.common.templates_environment import plain_text
from xfrustum.reports.plate.store import (
    ATTRIBUTE,
    COMPRESSOR,
    DAMAGE,
    FINISHED,
    METADATA,
    open_group,
    told,
)
from xfrustum.reports.plate.stored import checked_group, read_hogel
from xfrustum.scenes import InputError, Scene
from xfrustum.scenes.arguments import choice
from xfrustum.scenes.arrays import Bytes, Numbers
from xfrustum.scenes.disk.durable import TempPath
from xfrustum.scenes.disk.input_files import check_allowed
from xfrustum.scenes.files import layouts, plate_files
from xfrustum.scenes.files.foreign_images import Encoding, Reading, bytes_of
from xfrustum.scenes.files.pictures import BYTE_LEVELS
from xfrustum.scenes.model.plate_content import Channel, PlateContent

LAYOUT_ATTRIBUTE = (
    "xfrustum:converted"  # of converted groups, says from what; drawn ones have another
)


NUMBERED = Reading(
    encoding=Encoding.TRIANGLE_ID
)  #: how pictures hold numbers of triangles; see `packed`


class PlateArray(StrEnum):
    """The arrays of a plate."""

    COLOR = "color"
    TRIANGLE = "triangle"


def is_group(place: Path) -> bool:
    """Return whether a folder is a Zarr group."""
    return (place / METADATA).is_file()


@dataclass(kw_only=True, eq=False)
class GroupRows(plate_files.PlateRows):
    """The pixels of a plate in a Zarr group; numbers of triangles as in `--encoding triangle-id`."""

    place: Path
    stored: zarr.Array[Any]
    array: PlateArray


def open_plate(place: Path, array: PlateArray | None) -> GroupRows:
    """Return a plate's pixels, by default its colors or else its numbers; InputError where it is none."""
    group = checked_group(place)
    try:
        names = [name for name in PlateArray if name in group]
        chosen = array or (names[0] if names else PlateArray.COLOR)
        if chosen not in names:
            raise InputError(
                f"{place}: has no array {chosen}; is it a plate that `xfrustum plate` drew?"
            )
        stored, flags = group[chosen], group.get(FINISHED) if ATTRIBUTE in group.attrs else None
    except DAMAGE as error:
        raise InputError(f"{place}: is no plate that can be read ({told(error)})") from error
    dimensions = 5 if chosen is PlateArray.COLOR else 4
    if (
        not isinstance(stored, zarr.Array)
        or stored.ndim != dimensions
        or stored.dtype.kind not in "uif"
    ):
        raise InputError(f"{place}: array {chosen} is not that of a plate")
    rows, columns, height, width = (int(count) for count in stored.shape[:4])
    shape = layouts.PlateShape(hogels=(columns, rows), resolution=(width, height))
    largest = max(
        math.prod(stored.shape[2:]), math.prod(stored.chunks), math.prod(stored.shards or ())
    )
    check_allowed(place, largest * stored.dtype.itemsize, f"one hogel or chunk of {chosen}")
    floating = stored.dtype.kind == "f"
    dtype = stored.dtype if chosen is PlateArray.COLOR else np.dtype(np.uint8)
    if dtype not in (np.uint8, np.float16, np.float32):
        raise InputError(
            f"{place}: array {chosen} has type {dtype}, and not uint8, float16 or float32"
        )

    # Hogels that were not drawn stay empty; groups of others may leave out the files of empty ones.
    finished = flags if isinstance(flags, zarr.Array) and flags.shape == (rows, columns) else None

    def row(number: int) -> layouts.Pixels:
        pixels = plate_files.empty_row(found)
        for column in (
            range(columns) if finished is None else np.flatnonzero(finished[number]).tolist()
        ):
            hogel = read_hogel(place, stored, column, number, must_exist=finished is not None)
            pixels[column] = hogel if chosen is PlateArray.COLOR else packed(hogel)
        return pixels

    found = GroupRows(
        place=place,
        stored=stored,
        array=chosen,
        shape=shape,
        levels=None if floating else BYTE_LEVELS,
        dtype=dtype,
        row=row,
        linear=chosen is PlateArray.COLOR and ATTRIBUTE in group.attrs,
    )
    return found


def missing_hogels(rows: GroupRows) -> int:
    """Return the number of hogels that were never drawn; 0 where others' groups do not say it."""
    place, stored = rows.place, rows.stored
    try:
        finished = open_group(place).get(FINISHED)
        if isinstance(finished, zarr.Array) and finished.shape == stored.shape[:2]:
            return int(np.count_nonzero(np.asarray(finished[:]) == 0))
        if stored.shards is None and stored.chunks == (1, 1, *stored.shape[2:]):
            return int(stored.shape[0] * stored.shape[1] - stored.nchunks_initialized)
        return 0
    except DAMAGE as error:
        raise InputError(f"{place}: array {FINISHED} is damaged; draw the plate again") from error


def write_group(
    plate: plate_files.PlateRows,
    place: Path,
    array: PlateArray,
    description: dict[str, object],
    done: Callable[[], object] = lambda: None,
) -> None:
    """Write a plate into a new Zarr group with a chunk for each hogel; after each `done` is called."""
    group = zarr.create_group(place, attributes={LAYOUT_ATTRIBUTE: description})
    shape = plate.shape.array if array is PlateArray.COLOR else plate.shape.array[:4]
    names = ("row", "column", "v", "u", "rgb")
    stored = group.create_array(
        array,
        shape=shape,
        chunks=(1, 1, *shape[2:]),
        dtype=plate.dtype if array is PlateArray.COLOR else np.dtype(np.int32),
        compressors=[COMPRESSOR],
        fill_value=-1 if array is PlateArray.TRIANGLE else 0,
        dimension_names=names[: len(shape)],
    ).with_config({"write_empty_chunks": True})
    for row in range(shape[0]):
        for column, hogel in enumerate(plate.row(row)):
            stored[row, column] = (
                hogel if array is PlateArray.COLOR else NUMBERED.numbers(NUMBERED.packed(hogel))
            )
            done()


def packed(triangle: Numbers) -> Bytes:
    """Return numbers (.., -1 for nothing) as pixels (.., 3): number + 1 is 65536 red + 256 green + blue."""
    number = triangle.astype(np.int64) + 1
    if number.max(initial=0) >= 1 << 24:
        raise InputError("numbers of triangles above 16,777,214 do not fit into pictures of 8 bits")
    return bytes_of(number)


ZARR, ZARR_SUFFIX = "zarr", ".zarr"
"""Name under which a Zarr group counts as a layout, and suffix of folders that are taken for groups."""

ONE_PICTURE = ("mosaic", "quilt", "cubevi")
"""Names of layouts of a single picture, which may be written under the name of a file."""


@dataclass(frozen=True, kw_only=True)
class Conversion:
    """What a conversion did."""

    source: Path
    out: Path  #: folder or file that was written
    read_as: str
    reasons: tuple[str, ...]  #: what speaks for the layout that was read
    written_as: str
    hogels: tuple[int, int]
    resolution: tuple[int, int]  #: pixels of each hogel as they were read
    files: int  #: of Zarr groups, the number of hogels
    losses: tuple[str, ...]  #: one clause each; none where every bit was kept
    notes: tuple[str, ...]  #: what readers may expect and the files do not have


@dataclass(frozen=True, kw_only=True)
class ConversionOptions:
    """Facts that files may not state themselves."""

    hogels: tuple[int, int] | None = None  #: columns and rows, which a mosaic does not state
    tiles: tuple[int, int] | None = None  #: columns and rows of tiles of a quilt to be written
    suffix: str | None = (
        None  #: of pictures to be written; None for the layout's, .exr for floating point
    )
    array: PlateArray | str | None = None  #: of a Zarr group to be read or written
    aspect: float | None = None  #: width of the plate over its height; None for that of the hogels


def convert(
    source: Path | str,
    out: Path | str,
    read_as: str | None = None,
    write_as: str | None = None,
    options: ConversionOptions | None = None,
    *,
    progress: bool = False,
) -> Conversion:
    """Write the plate of a folder, picture or Zarr group (NAME.zarr) in another layout.

    Layouts are named, or `zarr`; None for what the source looks like, and for `zarr` by the name of
    `out`.

    InputError where the source cannot be read in this layout, or nothing can be written at `out`.
    """
    source, out, options = Path(source), Path(out), options or ConversionOptions()
    target = write_as or (ZARR if out.suffix.lower() == ZARR_SUFFIX else None)
    if target is None:
        raise InputError(
            "say with --to in which layout to write; only names that end in .zarr say it themselves"
        )
    array = None if options.array is None else choice(PlateArray, options.array, "array")
    plate: plate_files.PlateRows
    missing: tuple[str, ...] = ()
    if read_as == ZARR or (read_as is None and is_group(source)):
        plate = group = open_plate(source, array)
        if count := missing_hogels(group):
            missing = (f"{count} hogels are not there and count as empty",)
        layout, reasons = ZARR, (f"array {group.array}", plate.shape.words, *missing)
    else:
        found = _files_at(source, read_as, options)
        plate, layout, reasons = found.rows(), found.layout.name, found.reasons
    done = Conversion(
        source=source,
        out=out,
        read_as=layout,
        reasons=reasons,
        written_as=target,
        hogels=plate.shape.hogels,
        resolution=plate.shape.resolution,
        files=0,
        losses=(),
        notes=missing,
    )
    if target == ZARR:
        return _into_group(done, plate, array or PlateArray.COLOR, progress=progress)
    done = replace(done, written_as=layouts.layouts_named(target)[0].name)
    return _into_files(done, plate, options, progress=progress)


def _files_at(source: Path, read_as: str | None, options: ConversionOptions) -> plate_files.FileSet:
    """Return the files of a whole plate; InputError where some are missing or lie beyond it."""
    shape = (
        None
        if options.hogels is None
        else layouts.PlateShape(hogels=options.hogels, resolution=(1, 1))
    )
    found = plate_files.find_files(
        source, shape, layouts.LAYOUTS if read_as is None else layouts.layouts_named(read_as)
    )
    if found.missing:
        raise InputError(
            f"{source}: {found.missing} files of the layout {found.layout.name} are not there, "
            f"for a plate of {found.shape.words}"
        )
    if found.beyond:
        advice = (
            "leave out --hogels, or give all of them" if options.hogels else "move the others away"
        )
        raise InputError(
            f"{source}: {found.beyond} of {len(found.files)} files of the layout {found.layout.name} "
            f"lie beyond a plate of {found.shape.words}; {advice}"
        )
    return found


def _into_group(
    done: Conversion, plate: plate_files.PlateRows, array: PlateArray, *, progress: bool
) -> Conversion:
    source, out = done.source, done.out
    if array is PlateArray.TRIANGLE and plate.levels is None:
        raise InputError(f"{source}: holds floating-point colors, and no numbers of triangles")
    if plate.levels not in (None, BYTE_LEVELS):
        plate = plate_files.plate_with_levels(
            plate, BYTE_LEVELS if array is PlateArray.TRIANGLE else None
        )
    if out.exists() or out.is_symlink():
        raise InputError(
            f"{out}: exists; choose another place, for a group is written in one piece"
        )
    columns, rows = plate.shape.hogels
    described: dict[str, object] = {"source": str(source), "layout": done.read_as}
    with (
        refused(f"{out}: cannot be written", "choose another place"),
        TempPath(out.absolute().parent, folder=True) as aside,
        progress_bar(columns * rows, "convert", "hogel", shown=progress) as bar,
    ):
        made = aside.path / "group"
        write_group(plate, made, array, described, bar.update)
        made.rename(out)
    return replace(done, files=columns * rows)


def _into_files(
    done: Conversion, plate: plate_files.PlateRows, options: ConversionOptions, *, progress: bool
) -> Conversion:
    out, shape = done.out, plate.shape
    single = done.written_as in ONE_PICTURE and out.suffix.lower() in layouts.PICTURE_SUFFIXES
    suffix = out.suffix.lower() if single else options.suffix
    layout = layouts.layout_for(done.written_as, suffix)
    # What follows in the names of quilts is their own.
    stem = out.stem.partition("_qs")[0] if layout.name == "quilt" else out.stem
    naming = layouts.Naming(
        suffix=suffix or layout.suffix,
        stem=stem if single else "",
        aspect=options.aspect,
        tiles=options.tiles,
    )

    def named(naming: layouts.Naming) -> bool:  # `pleno` has no other files than .ppm
        name = plate_files.Target(layout=layout, naming=naming).file_name(
            next(layout.indices(shape)), shape
        )
        return layout.read_name(name) is not None

    floating = replace(naming, suffix=".exr")
    if suffix is None and plate.levels is None and named(floating):
        naming = floating
    if not named(naming):
        raise InputError(
            f"files of the layout {layout.name} end in {layout.suffix}, not in {naming.suffix}"
        )
    target = plate_files.Target(layout=layout, naming=naming)
    files, losses = layout.file_count(shape), target.losses(plate)
    with Staging(out.absolute().parent if single else out) as staging:
        with progress_bar(files, "convert", "file", shown=progress) as bar:
            plate_files.write_files(plate, target, staging.folder, bar.update)
        if layout.name == "hci":
            # The part of a parameters.cfg that the pictures decide.
            staging.write(plate_files.PARAMETERS_FILE, plain_text("parameters.cfg.j2", vars(shape)))
        written = staging.commit()
    notes = (*done.notes, *target.notes(plate))
    return replace(done, out=written[0] if single else out, files=files, losses=losses, notes=notes)


DRAWING_SUFFIX = ".drawing.zarr"
"""Ending of the name of a group that is kept only until the files are written. A run that was stopped goes on
with it."""


@dataclass(frozen=True, kw_only=True)
class LaidOutPlate:
    """The places of a plate that is drawn into NAME.zarr and laid out in NAME-LAYOUT, or laid out alone."""

    out: Path
    layout: str

    @property
    def keeps_group(self) -> bool:
        """Whether the group stays when the files are written."""
        return self.out.suffix.lower() == ZARR_SUFFIX

    @property
    def group(self) -> Path:
        """The group that the plate is drawn into."""
        return self.out if self.keeps_group else self.out.with_name(self.out.name + DRAWING_SUFFIX)

    @property
    def files(self) -> Path:
        """The folder of the files, or the one picture."""
        return (
            self.out.with_name(f"{self.out.stem}-{self.layout}") if self.keeps_group else self.out
        )

    def check(self, scene: Scene, content: PlateContent, *, judged: bool) -> None:
        """Raise InputError where the files could not be written, or would lose images or measures."""
        if not {Channel.COLOR, Channel.TRIANGLE} & {*content.channels}:
            raise InputError(
                "--layout writes colors or triangle numbers: ask for color or triangle among --channels"
            )
        if not self.keeps_group and (judged or len(content.channels) > 1):
            raise InputError(
                f"--out {self.out}: files in a layout hold one image of each hogel, and no measures; "
                f"let the name end in {ZARR_SUFFIX}, and the Zarr group with all of them stays"
            )
        shape = layouts.PlateShape(hogels=scene.plate.hogels, resolution=scene.frustum.resolution)
        for layout in layouts.layouts_named(self.layout):
            # A layout that has no place for such a plate says so here.
            layout.stem(next(layout.indices(shape)), shape, layouts.Naming())
        single = (
            self.layout in ONE_PICTURE and self.files.suffix.lower() in layouts.PICTURE_SUFFIXES
        )
        check_writable_folder(self.files.absolute().parent if single else self.files)

    def write(self, scene: Scene) -> Conversion:
        """Write the files of a plate that is drawn, and remove the group unless it is to be kept."""
        width, height = scene.plate.size
        done = convert(
            self.group, self.files, ZARR, self.layout, ConversionOptions(aspect=width / height)
        )
        if not self.keeps_group:
            shutil.rmtree(self.group)
        return done
