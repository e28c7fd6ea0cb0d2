"""The layouts that a set of files looks like, each with the reasons.

Names of files say most: how many numbers they have, and of how many files in which order. Sizes of pictures
say the rest. Whether pictures are what a layout claims, be it turned or counted in another order, no name
says: that is found by comparing them with a scene (`xfrustum verify`).
"""

from __future__ import annotations

import configparser
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from xfrustum.scenes.disk.input_files import read_small
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.layouts.catalogue import LAYOUTS
from xfrustum.scenes.files.layouts.hogel_files import HogelFiles
from xfrustum.scenes.files.layouts.layout import Index, Layout, Naming, PlateShape
from xfrustum.scenes.files.layouts.picture_files import picture_size, picture_text
from xfrustum.scenes.files.layouts.tiles import CUBEVI_TILE_PX, CUBEVI_TILES, CubeVi, Mosaic
from xfrustum.scenes.files.layouts.video import video_size

PARAMETERS_FILE = "parameters.cfg"
"""Name of the file in which the 4D light-field benchmark describes its cameras."""

MAX_PARAMETERS_BYTES = 1 << 16
"""Largest size of such a file that is read; those of the benchmark have two thousand bytes."""

PLATE_FILE = "plate.json"
"""Name of the file in which the script for Blender states the plate whose hogels it renders into a folder."""

MAX_PLATE_BYTES = 1 << 24
"""Largest size of such a file that is read: room for a hundred thousand objects with their colors."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FileSet:
    """Files that are read in a layout.

    Attributes
    ----------
    place
        Folder or file that was named.
    layout
        Layout in which the files are read.
    files
        Paths by the numbers that their names state.
    shape
        Shape of the plate that they form.
    missing
        Number of files that the layout has for such a plate and that are not there.
    beyond
        Number of files that are there and that the layout does not have for such a plate.
    strangers
        Number of pictures in the folder whose names are none of this layout.
    reasons
        What speaks for the layout, one clause each.
    """

    place: Path
    layout: Layout
    files: dict[Index, Path]
    shape: PlateShape
    missing: int
    beyond: int
    strangers: int
    reasons: tuple[str, ...]

    @property
    def words(self) -> str:
        """The layout, the shape and the reasons in one line."""
        return f"{self.layout.name} ({'; '.join(self.reasons)})"


def looks_like(
    place: Path, told: PlateShape | None = None, layouts: Sequence[Layout] = LAYOUTS
) -> tuple[FileSet, ...]:
    """Return the layouts that files look like, the likeliest first.

    Parameters
    ----------
    place
        A folder of files, or a single picture.
    told
        Shape of the plate where somebody knows it, as the scene does.
    layouts
        Layouts that come into question.

    Raises
    ------
    InputError
        There are no such files, or none of the layouts fits; the message says why for the likeliest.
    """
    paths = pictures_at(place)
    found: list[FileSet] = []
    problems: list[str] = []
    # Somebody who states a layout knows more than the size of a picture does.
    stated = len({layout.name for layout in layouts}) == 1
    for layout in layouts:
        indices = [(index, path) for path in paths if (index := layout.index_of(path.name)) is not None]
        named = dict(indices)
        # A layout of one picture fits a folder of one.
        if not named or (() in named and len(paths) > 1):
            continue
        try:
            _check_different(indices, named)
            found.append(_examined(place, layout, named, told, all_files=len(paths), stated=stated))
        except InputError as error:
            problems.append(f"{layout.name}: {error}")
    if not found:
        some = f", such as {paths[0].name}" if paths else ""
        held = f"its files ({len(paths)} pictures{some})"
        likely = _by_names(paths)
        why = f"{held} have names of no layout"
        if stated and likely is not None:
            why = f"{held} are not named as those of {layouts[0].name}; they look like {likely}"
        if problems:
            # For a single picture the last layout, a mosaic, is the likeliest.
            why = problems[-1 if len(paths) == 1 else 0]
        names = f" {layouts[0].name}" if stated else ""
        raise InputError(f"{place}: cannot be read in the layout{names or ' that it looks like'}: {why}")

    def doubts(one: FileSet) -> tuple[bool, bool, bool, int]:
        order = next(number for number, layout in enumerate(layouts) if layout is one.layout)
        return told is not None and one.shape != told, one.strangers > 0, one.missing > 0, order

    return tuple(sorted(found, key=doubts))


def _by_names(paths: Sequence[Path]) -> str | None:
    """Return the likeliest layout whose names all files have; None where there is none that needs numbers."""
    for layout in LAYOUTS:
        if all(layout.index_of(path.name) for path in paths):
            return layout.name
    return None


def _check_different(indices: Sequence[tuple[Index, Path]], named: dict[Index, Path]) -> None:
    """Raise InputError where two names state the same numbers: which picture is meant, nobody could tell."""
    for index, path in indices:
        if named[index] != path:
            raise InputError(
                f"{path.name} and {named[index].name} state the same numbers; keep one of them in the folder"
            )


def pictures_at(place: Path) -> list[Path]:
    """Return the files that layouts are made of; ground truths and hidden files are none.

    Raises
    ------
    InputError
        There is no such folder or file, or the folder has no pictures.
    """
    if not place.is_dir():
        picture_or_video_exists(place)
        return [place]
    try:
        paths = sorted(place.iterdir())
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({error.strerror})") from error
    known = (".png", ".ppm", ".exr", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".avi")
    pictures = [p for p in paths if p.suffix.lower() in known and not p.name.startswith((".", "gt_"))]
    if not pictures:
        raise InputError(f"{place}: has no pictures; name a folder of pictures, or one picture")
    return pictures


def picture_or_video_exists(place: Path) -> None:
    """Raise InputError unless there is such a file."""
    if not place.exists():
        raise InputError(f"{place}: no such file or folder; name a folder of pictures, or one picture")


def _examined(
    place: Path,
    layout: Layout,
    named: dict[Index, Path],
    told: PlateShape | None,
    *,
    all_files: int,
    stated: bool,
) -> FileSet:
    """Return the set of some files in a layout.

    Raises
    ------
    InputError
        What the files say does not fit together.
    """
    first, strangers = named[min(named)], all_files - len(named)
    if first.suffix.lower() == ".avi":
        frames, size = video_size(first)
        told = PlateShape(hogels=(frames, 1), resolution=size)
    else:
        size = picture_size(first)
        told = _told_by_files(layout, first) or told
    shape = layout.shape_of(list(named), size, told)
    expected = {part.index for part in layout.parts(shape, Naming(tiles=_tiles(named)))}
    missing = len(expected - named.keys())
    reasons = [f"{len(named)} of {len(named) + strangers} names fit: {layout.words}", f"such as {first.name}"]
    if len(named) == 1:
        reasons = [layout.words]
        reasons += _only_picture(layout, size, told, stated=stated)
    if missing:
        reasons.append(f"{missing} of {len(expected)} files are not there")
    reasons.append(shape.words)
    return FileSet(
        place=place,
        layout=layout,
        files=named,
        shape=shape,
        missing=missing,
        beyond=len(named.keys() - expected),
        strangers=strangers,
        reasons=tuple(reasons),
    )


def _tiles(named: dict[Index, Path]) -> tuple[int, int] | None:
    index = next(iter(named))
    return (index[0], index[1]) if len(named) == 1 and len(index) == 2 else None


def _only_picture(
    layout: Layout, size: tuple[int, int], told: PlateShape | None, *, stated: bool
) -> list[str]:
    """Return what the size of a single picture says.

    Raises
    ------
    InputError
        The size speaks for another layout.
    """
    if isinstance(layout, CubeVi):
        full = tuple(count * px for count, px in zip(CUBEVI_TILES, CUBEVI_TILE_PX, strict=True))
        columns, rows = CUBEVI_TILES
        of_scene = told is not None and told.resolution[0] == columns * rows and told.resolution[1] == 1
        if size != full and not of_scene and not stated:
            raise InputError(
                f"the picture is {size[0]} x {size[1]}, and a CubeVi picture {full[0]} x {full[1]}"
            )
        return [f"the picture is {size[0]} x {size[1]}"]
    return ["the number of hogels is told"] if isinstance(layout, Mosaic) else []


def _told_by_files(layout: Layout, first: Path) -> PlateShape | None:
    """Return the shape that a picture or the file beside it states; None where they state none."""
    if isinstance(layout, Mosaic):
        told = picture_text(first)
        try:
            return PlateShape(hogels=told["hogels"], resolution=told["resolution"])  # type: ignore[arg-type]
        except (KeyError, InputError):
            return None
    if isinstance(layout, HogelFiles):
        return _told_by_plate(first.parent / PLATE_FILE)
    cameras = camera_counts(first.parent / PARAMETERS_FILE) if layout.name == "hci" else None
    return None if cameras is None else PlateShape(hogels=(1, 1), resolution=cameras)


def _told_by_plate(path: Path) -> PlateShape | None:
    """Return the shape that the plate.json beside hogels states; None where it states none."""
    if not path.is_file():
        return None
    try:
        stated = json.loads(read_small(path, "description of a plate", MAX_PLATE_BYTES))
        (columns, rows), (width, height) = stated["hogels"], stated["resolution"]
        return PlateShape(hogels=(int(columns), int(rows)), resolution=(int(width), int(height)))
    except (InputError, UnicodeDecodeError, KeyError, TypeError, ValueError):
        return None


def camera_counts(path: Path) -> tuple[int, int] | None:
    """Return num_cams_x and num_cams_y of a parameters.cfg; None where it does not state them."""
    if not path.is_file():
        return None
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(read_small(path, "file of parameters", MAX_PARAMETERS_BYTES).decode())
        values = {key: value for section in parser.values() for key, value in section.items()}
        return int(values["num_cams_x"]), int(values["num_cams_y"])
    except (configparser.Error, UnicodeDecodeError, KeyError, ValueError):
        return None
