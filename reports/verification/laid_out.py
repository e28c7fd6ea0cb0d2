"""Hogel images from files in a layout, and other layouts in which the same files may be meant."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.judging.judged import judge
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.compare.renderer_model.orientations import UPRIGHT, Orientation
from xfrustum.compare.renderer_model.shown_points import shown_points
from xfrustum.reference import Reference
from xfrustum.reports.verification.sources import Problem, Source
from xfrustum.reports.verification.verdict import Hogel, Verification
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.foreign_images import Encoding, StoredPixels, of_stored, read_foreign
from xfrustum.scenes.files.layouts import (
    CUBEVI_TILES,
    LAYOUTS,
    Index,
    Layout,
    Pixels,
    PlateShape,
    layouts_named,
    tiled_views,
)
from xfrustum.scenes.files.pictures import BYTE_LEVELS
from xfrustum.scenes.files.plate_files import FileSet, find_files, with_levels
from xfrustum.scenes.model.hogel_image import NOTHING, HogelCamera, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture, Plate

LAYOUT = "layout"
"""Name of the fault that files are in another layout than stated."""

CONVENTIONAL_FAULTS = {"orientation", "aperture-order", "shift-x", "shift-y", "view-shear"}
"""Faults that files in the right layout have too: where these alone explain the images, it is not doubted."""

MAX_TRIED_HOGELS = 9
"""Largest number of hogels by which another reading is tried."""

MAX_WRONG_IN_RIGHT_READING = 0.1
"""Largest share of wrong pixels under which another reading counts as right: a tenth, as for all that must
explain what is wrong (`compare.diagnosis.evidence`)."""

NOMINAL = DrawnModel()
"""Model of a renderer without any fault."""

TURNED = Orientation(flip_x=True, flip_y=True)
"""Orientation of pictures that are turned by 180 degrees."""


def shape_of(scene: Scene) -> PlateShape:
    """Return the numbers of hogels and pixels that a scene asks for."""
    return PlateShape(hogels=scene.plate.hogels, resolution=scene.frustum.resolution)


@dataclass(kw_only=True, eq=False)
class LaidOut:
    """Files in a layout; `encoding` is the meaning of pictures, OpenEXR files say it themselves."""

    files: FileSet
    reference: Reference
    encoding: Encoding

    def __post_init__(self) -> None:
        self.name = f"{self.files.place}, layout {self.files.words}"

    def check(self, apertures: Sequence[Aperture]) -> None:
        """Raise InputError where there is a file for none of the hogels."""
        if not (self.files.layout.in_hogels and self._fits):
            return
        if not any(self.files.file_of_hogel(*aperture.index) for aperture in apertures):
            raise InputError(f"SOURCE {self.files.place}: has no file of the hogels that are asked for")

    @property
    def _fits(self) -> bool:
        return self.files.shape == shape_of(self.reference.scene)

    def image(self, aperture: Aperture) -> HogelImage:
        """Return the image of an aperture, upright as its layout says."""
        if not self._fits:
            asked, count = shape_of(self.reference.scene).words, len(self.files.files)
            held = f"{count} file{'' if count == 1 else 's'}"
            lacking = f" ({self.files.missing} are not there)" if self.files.missing else ""
            raise Problem(
                f"read as {self.files.layout.name}, the {held} would be {self.files.shape.words}{lacking}, "
                f"and the scene says {asked}"
            )
        camera = self.reference.camera(aperture)
        try:
            path = self.files.file_of_hogel(*aperture.index)
            if path is not None and path.suffix.lower() == ".exr":
                return self._of_exr(path, camera)
            picture = self.files.hogel(*aperture.index)
        except InputError as error:
            raise Problem(str(error)) from error
        if picture.levels is None:
            return _colored(picture.pixels.astype(np.float32), camera)
        rgb = with_levels(picture.pixels, picture.levels, BYTE_LEVELS).astype(np.uint8)
        return of_stored(StoredPixels(rgb=rgb, lossy=picture.lossy), camera, self.encoding)

    def _of_exr(self, path: Path, camera: HogelCamera) -> HogelImage:
        """Return an image with all channels that its file has."""
        image = read_foreign(path, camera, self.encoding)
        found = TURNED if self.files.layout.turned else UPRIGHT
        arrays: dict[str, Any] = {
            name: found.upright(array)
            for name in ("triangle", "object", "position", "normal", "color")
            if (array := getattr(image, name)) is not None
        }
        return replace(image, **arrays)


def _colored(color: np.ndarray[tuple[int, ...], np.dtype[np.float32]], camera: HogelCamera) -> HogelImage:
    """Return an image that has nothing but colors."""
    nothing = np.full(color.shape[:2], NOTHING, dtype=np.int32)
    position = np.full(color.shape, np.nan, dtype=np.float32)
    return HogelImage(camera=camera, triangle=nothing, object=nothing, position=position, color=color)


def is_place(source: str, plate: Plate) -> bool:
    """Return whether a source names a folder, or one picture of a plate of several hogels."""
    with suppress(OSError, ValueError):  # what cannot be the name of a file may still be a pattern
        return Path(source).is_dir() or (plate.hogels != (1, 1) and Path(source).is_file())
    return False


def laid_out(place: Path, layout: str | None, reference: Reference, encoding: Encoding) -> LaidOut:
    """Return the source of files in a stated layout, or in the one that they look like.

    Raises
    ------
    InputError
        The layout does not exist, or the files do not fit it.
    """
    layouts = LAYOUTS if layout is None else layouts_named(layout)
    files = find_files(place, shape_of(reference.scene), layouts)
    return LaidOut(files=files, reference=reference, encoding=encoding)


def other_readings(stated: FileSet, told: PlateShape) -> Iterator[FileSet]:
    """Yield other layouts in which the same files form the plate that is told."""
    readings = (*LAYOUTS, *(other for layout in LAYOUTS for other in mistaken(layout)))
    for layout in readings:
        if layout == stated.layout:
            continue
        try:
            found = find_files(stated.place, told, (layout,))
        except InputError:
            continue
        if found.shape == told and not found.missing:
            yield found


def mistaken(layout: Layout) -> tuple[Layout, ...]:
    """Return what others take for a layout: numbers in the other order, and views from the other side."""
    numbers = layout.stated if layout.name == "quilt" else layout.numbers
    exchanged = (_exchanged(layout, *numbers),) if len(numbers) == 2 else ()
    if layout.name == "quilt":
        return (*exchanged, *(_other_side(one, downward=True) for one in (layout, *exchanged)))
    return (_other_side(layout, downward=False),) if layout.name == "cubevi" else exchanged


def _exchanged(layout: Layout, first: str, second: str) -> Layout:
    """Return a layout whose names state two numbers in the other order."""
    pattern = layout.pattern.replace(f"<{first}>", "<swapped>").replace(f"<{second}>", f"<{first}>")
    words = layout.words.replace("columns x rows", "rows x columns")
    if words == layout.words:
        words = f"{words}, with the two numbers of its names exchanged"
    return replace(layout, pattern=pattern.replace("<swapped>", f"<{second}>"), words=words)


def _other_side(layout: Layout, *, downward: bool) -> Layout:
    """Return a layout of tiles whose view 0 lies at the top left, or at the bottom left."""

    def view(pixels: Pixels, _: Index, tiles: Index) -> Pixels:
        return tiled_views(pixels, tiles or CUBEVI_TILES, downward=downward)

    before, after = ("bottom left", "top left") if downward else ("top left", "bottom left")
    return replace(layout, view=view, words=layout.words.replace(before, after))


def with_layout_named(
    found: Verification, source: Source, verified: Callable[[Source], Verification]
) -> Verification:
    """Return a verification that names the layout of the files if it is another than the stated one."""
    named = {fault.fault for fault in found.diagnosis.faults}
    conventional = bool(named) and named <= CONVENTIONAL_FAULTS
    if not isinstance(source, LaidOut) or found.passed or conventional:
        return found
    for files in other_readings(source.files, shape_of(found.scene)):
        other_source = replace(source, files=files)
        if not _is_right(other_source, found):
            continue
        return _named(found, source.files, files, verified(other_source))
    return found


def _is_right(source: LaidOut, found: Verification) -> bool:
    """Return whether nearly all claims of a few hogels in another reading hold, whatever the other faults."""
    reference, wrong, shown = source.reference, 0, 0
    hogels = found.hogels[:: max(1, len(found.hogels) // MAX_TRIED_HOGELS)]
    for hogel in hogels[:MAX_TRIED_HOGELS]:
        try:
            image = source.image(hogel.aperture)
        except Problem:
            return False
        points = shown_points(reference.scene, NOMINAL, image)
        figures = judge(reference, NOMINAL, image, points, found.limits.judging, explained=False)
        wrong, shown = wrong + figures.limited, shown + figures.shown
    return wrong <= MAX_WRONG_IN_RIGHT_READING * shown


def _named(found: Verification, stated: FileSet, files: FileSet, other: Verification) -> Verification:
    """Return a verification with the layout as a fault, and with the figures of the other reading."""
    fault = Fault(
        fault=LAYOUT,
        value=files.layout.name,
        words=f"files were read as {stated.layout.words}, and hold {files.layout.words}",
        explains=_explained(found, other),
    )
    corrected = {hogel.aperture: hogel.corrected for hogel in other.hogels}
    hogels: tuple[Hogel, ...] = tuple(
        replace(hogel, corrected=corrected[hogel.aperture]) for hogel in found.hogels
    )
    faults = (fault, *other.diagnosis.faults)
    return replace(
        found,
        diagnosis=replace(other.diagnosis, faults=faults, does_not_explain=()),
        hogels=hogels,
    )


def _explained(found: Verification, other: Verification) -> float | None:
    """Return the share of the wrong pixels that the other reading makes right; None where none was read."""
    before = sum(hogel.as_found.wrong for hogel in found.hogels if hogel.as_found is not None)
    after = sum(hogel.corrected.wrong for hogel in other.hogels if hogel.corrected is not None)
    return max(0.0, 1.0 - after / before) if before else None
