"""Plates from one layout into another, and from and into Zarr."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

from xfrustum.reports.common.outputs import Staging, check_writable_folder
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.plate.rows import PlateArray, is_group, missing_hogels, open_plate, write_group
from xfrustum.scenes.arguments import choice
from xfrustum.scenes.disk.durable import Aside
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.layouts import (
    LAYOUTS,
    PICTURE_SUFFIXES,
    Layout,
    Naming,
    PlateShape,
    layout_for,
    layouts_named,
)
from xfrustum.scenes.files.pictures import BYTE_LEVELS
from xfrustum.scenes.files.plate_files import (
    PARAMETERS_FILE,
    PlateRows,
    Target,
    WithLevels,
    find_files,
    write_files,
)
from xfrustum.scenes.model.plate_content import Channel, PlateContent
from xfrustum.scenes.model.scene import Scene

ZARR = "zarr"
"""Name under which a Zarr group counts as a layout."""

ZARR_SUFFIX = ".zarr"
"""Suffix of folders that are taken for Zarr groups."""

ONE_PICTURE = ("mosaic", "quilt", "cubevi")
"""Names of layouts of a single picture, which may be written under the name of a file."""


@dataclass(frozen=True, kw_only=True)
class Conversion:
    """What a conversion did.

    Attributes
    ----------
    source, out
        What was read, and the folder or file that was written.
    read_as
        Layout in which the source was read.
    reasons
        What speaks for this layout.
    written_as
        Layout in which it was written.
    hogels, resolution
        Numbers of hogels, and of the pixels of each as they were read.
    files
        Number of files that were written; of Zarr groups, of hogels.
    losses
        What was lost, one clause each; none where every bit was kept.
    notes
        What readers may expect and the files do not have.
    """

    source: Path
    out: Path
    read_as: str
    reasons: tuple[str, ...]
    written_as: str
    hogels: tuple[int, int]
    resolution: tuple[int, int]
    files: int
    losses: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class ConversionOptions:
    """Facts that files may not state themselves.

    Attributes
    ----------
    hogels
        Numbers of columns and rows of hogels, which a mosaic does not state.
    tiles
        Columns and rows of tiles of a quilt to be written.
    suffix
        Suffix of the pictures to be written; None for that of the layout, and .exr for floating point.
    array
        Array of a Zarr group to be read or written: `color` or `triangle`.
    aspect
        Width of the plate over its height, which quilts state; None for that of the numbers of hogels.
    """

    hogels: tuple[int, int] | None = None
    tiles: tuple[int, int] | None = None
    suffix: str | None = None
    array: PlateArray | str | None = None
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
    """Write the plate of a folder, picture or Zarr group in another layout.

    Parameters
    ----------
    source, out
        What is read, and what is written: a folder, a picture, or a Zarr group (NAME.zarr).
    read_as, write_as
        Names of layouts, or `zarr`; None for what the source looks like, and for `zarr` or `hogels` by the
        name of `out`.
    options
        Facts that files do not state.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        The source cannot be read in this layout, or nothing can be written at `out`.
    """
    source, out, options = Path(source), Path(out), options or ConversionOptions()
    target = write_as or (ZARR if out.suffix.lower() == ZARR_SUFFIX else None)
    if target is None:
        raise InputError(
            "say with --to in which layout to write; only names that end in .zarr say it themselves"
        )
    array = None if options.array is None else choice(PlateArray, options.array, "array")
    read = _read(source, read_as, options, array)
    work = _Work(source=source, out=out, read=read, progress=progress)
    if target == ZARR:
        return _into_group(work, array)
    return _into_files(work, layouts_named(target)[0].name, options)


@dataclass(frozen=True, kw_only=True)
class _Read:
    """What was read: pixels, the name of their layout, what speaks for it, and what is missing."""

    plate: PlateRows
    layout: str
    reasons: tuple[str, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class _Work:
    """A conversion under way."""

    source: Path
    out: Path
    read: _Read
    progress: bool

    def done(
        self,
        written: Path,
        layout: str,
        files: int,
        losses: tuple[str, ...] = (),
        notes: tuple[str, ...] = (),
    ) -> Conversion:
        """Return what the conversion did."""
        read = self.read
        return Conversion(
            source=self.source,
            out=written,
            read_as=read.layout,
            reasons=read.reasons,
            written_as=layout,
            hogels=read.plate.shape.hogels,
            resolution=read.plate.shape.resolution,
            files=files,
            losses=losses,
            notes=(*read.notes, *notes),
        )


def _read(source: Path, read_as: str | None, options: ConversionOptions, array: PlateArray | None) -> _Read:
    """Read a source."""
    if read_as == ZARR or (read_as is None and is_group(source)):
        plate = open_plate(source, array)
        missing = missing_hogels(plate)
        told = (f"{missing} hogels are not there and count as empty",) if missing else ()
        reasons = (f"array {plate.array}", plate.shape.words, *told)
        return _Read(plate=plate, layout=ZARR, reasons=reasons, notes=told)
    shape = None if options.hogels is None else PlateShape(hogels=options.hogels, resolution=(1, 1))
    layouts = LAYOUTS if read_as is None else layouts_named(read_as)
    found = find_files(source, shape, layouts)
    if found.missing:
        raise InputError(
            f"{source}: {found.missing} files of the layout {found.layout.name} are not there, "
            f"for a plate of {found.shape.words}"
        )
    if found.beyond:
        advice = "leave out --hogels, or give all of them" if options.hogels else "move the others away"
        raise InputError(
            f"{source}: {found.beyond} of {len(found.files)} files of the layout {found.layout.name} "
            f"lie beyond a plate of {found.shape.words}; {advice}"
        )
    return _Read(plate=found.rows(), layout=found.layout.name, reasons=found.reasons)


def _into_group(work: _Work, array: PlateArray | None) -> Conversion:
    plate, source, out = work.read.plate, work.source, work.out
    chosen = array or PlateArray.COLOR
    if chosen is PlateArray.TRIANGLE and plate.levels is None:
        raise InputError(f"{source}: holds floating-point colors, and no numbers of triangles")
    if plate.levels not in (None, BYTE_LEVELS):
        plate = WithLevels(plate=plate, levels=BYTE_LEVELS if chosen is PlateArray.TRIANGLE else None)
    if out.exists() or out.is_symlink():
        raise InputError(f"{out}: exists; choose another place, for a group is written in one piece")
    columns, rows = plate.shape.hogels
    described: dict[str, object] = {"source": str(source), "layout": work.read.layout}
    try:
        with (
            Aside(out.absolute().parent, folder=True) as aside,
            progress_bar(columns * rows, "convert", "hogel", shown=work.progress) as bar,
        ):
            made = aside.path / "group"
            write_group(plate, made, chosen, described, bar.update)
            made.rename(out)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror}); choose another place") from error
    return work.done(out, ZARR, columns * rows)


def _into_files(work: _Work, layout_name: str, options: ConversionOptions) -> Conversion:
    plate, out = work.read.plate, work.out
    single = layout_name in ONE_PICTURE and out.suffix.lower() in PICTURE_SUFFIXES
    suffix = out.suffix.lower() if single else options.suffix
    layout = layout_for(layout_name, suffix)
    naming = Naming(
        suffix=suffix or layout.suffix,
        stem=_stem(out, layout) if single else "",
        aspect=options.aspect,
        tiles=options.tiles,
    )
    floating = replace(naming, suffix=".exr")
    if suffix is None and plate.levels is None and _is_named(layout, plate.shape, floating):
        naming = floating
    if not _is_named(layout, plate.shape, naming):
        raise InputError(f"files of the layout {layout.name} end in {layout.suffix}, not in {naming.suffix}")
    target = Target(layout=layout, naming=naming)
    files, losses = layout.file_count(plate.shape), target.losses(plate)
    with Staging(out.absolute().parent if single else out) as staging:
        with progress_bar(files, "convert", "file", shown=work.progress) as bar:
            write_files(plate, target, staging.folder, bar.update)
        if layout.name == "hci":
            (staging.folder / PARAMETERS_FILE).write_text(_parameters(plate.shape), encoding="ascii")
        written = staging.commit()
    place = written[0] if single else out
    return work.done(place, layout.name, files, losses, target.notes(plate.shape))


def _is_named(layout: Layout, shape: PlateShape, naming: Naming) -> bool:
    """Return whether files under these names are files of the layout: `pleno` has no other than .ppm."""
    name = Target(layout=layout, naming=naming).file_name(next(layout.indices(shape)), shape)
    return layout.read_name(name) is not None


def _stem(out: Path, layout: Layout) -> str:
    """Return the beginning of the name of a single picture: what follows in quilts' names is their own."""
    return out.stem.partition("_qs")[0] if layout.name == "quilt" else out.stem


def _parameters(shape: PlateShape) -> str:
    """Return the part of a parameters.cfg that the pictures decide."""
    (columns, rows), (width, height) = shape.hogels, shape.resolution
    return (
        "[intrinsics]\n"
        f"image_resolution_x_px = {columns}\nimage_resolution_y_px = {rows}\n\n"
        f"[extrinsics]\nnum_cams_x = {width}\nnum_cams_y = {height}\n"
    )


DRAWING_SUFFIX = ".drawing.zarr"
"""Ending of the name of a group that is kept only until the files are written. A run that was stopped goes on
with it."""


@dataclass(frozen=True, kw_only=True)
class LaidOutPlate:
    """The places of a plate that is drawn into a Zarr group and written in a layout.

    Attributes
    ----------
    out
        Place that was asked for: NAME.zarr for a group, with the files beside it in NAME-LAYOUT; any other
        name for the files alone.
    layout
        Name of the layout.
    """

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
        return self.out.with_name(f"{self.out.stem}-{self.layout}") if self.keeps_group else self.out

    def check(self, scene: Scene, content: PlateContent, *, judged: bool) -> None:
        """Raise InputError where the files could not be written, or would lose what was asked for.

        Parameters
        ----------
        scene
            Scene of the plate.
        content
            Images that are stored.
        judged
            Whether measures are stored beside them.
        """
        if not {Channel.COLOR, Channel.TRIANGLE} & {*content.channels}:
            raise InputError(
                "--layout writes colors or triangle numbers: ask for color or triangle among --channels"
            )
        if not self.keeps_group and (judged or len(content.channels) > 1):
            raise InputError(
                f"--out {self.out}: files in a layout hold one image of each hogel, and no measures; "
                f"let the name end in {ZARR_SUFFIX}, and the Zarr group with all of them stays"
            )
        shape = PlateShape(hogels=scene.plate.hogels, resolution=scene.frustum.resolution)
        for layout in layouts_named(self.layout):
            # A layout that has no place for such a plate says so here.
            layout.stem(next(layout.indices(shape)), shape, Naming())
        single = self.layout in ONE_PICTURE and self.files.suffix.lower() in PICTURE_SUFFIXES
        check_writable_folder(self.files.absolute().parent if single else self.files)

    def write(self, scene: Scene) -> Conversion:
        """Write the files of a plate that is drawn, and remove the group unless it is to be kept.

        Raises
        ------
        InputError
            The files cannot be written.
        """
        width, height = scene.plate.size
        options = ConversionOptions(aspect=width / height)
        done = convert(self.group, self.files, ZARR, self.layout, options)
        if not self.keeps_group:
            shutil.rmtree(self.group)
        return done
