"""What a survey judges: hogels that our rasterizer draws, or those of another renderer, block by block."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from xfrustum.compare.run import Judge, JudgedFrame
from xfrustum.reports.blocks import device_index
from xfrustum.reports.common.json_ready import json_object
from xfrustum.reports.common.records import table_of
from xfrustum.reports.error_report.images import SURFACE_COLOR, displacement_map, mask, media_type, picture
from xfrustum.reports.inspection.channels import DRAWN, InspectedHogel, inspected_frame
from xfrustum.reports.parts import HogelBlock, RowsJob
from xfrustum.reports.survey.rows import Device, DrawnRow, ForeignRow
from xfrustum.reports.verification.laid_out import is_place
from xfrustum.reports.verification.sources import (
    absolute_pattern,
    folder_named_from,
    require_same_images,
    state_of_files,
)
from xfrustum.reports.verification.verdict import Limits
from xfrustum.reports.verification.verification import HogelVerifier, checked_files
from xfrustum.scenes.files.foreign_images import Encoding
from xfrustum.scenes.files.plate_files import PARAMETERS_FILE, pictures_at
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Plate

MAX_PICTURE_PX = 512
"""Longest side of a picture on the page; larger images are reduced."""


@dataclass(frozen=True, kw_only=True)
class ShownHogel:
    """Pictures of one hogel, data URLs by what they show, and all its channels; none where it is missing."""

    pictures: dict[str, str]
    inspected: InspectedHogel | None


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnJob(RowsJob):
    """A survey of what our rasterizer draws with some settings; the tracer gives truths a second opinion."""

    settings: tuple[DoubleFrustum, ...]
    tracer: str
    tolerance_px: float

    @property
    def name(self) -> str:
        """Word for the work."""
        return "survey"

    @contextmanager
    def open(self) -> Iterator[DrawnSession]:
        """Open the renderers of the scene."""
        with Judge(self.scene, self.tracer) as judge:
            yield DrawnSession(self, judge)


class DrawnSession:
    """A judge of one scene, for the blocks of one survey."""

    def __init__(self, job: DrawnJob, judge: Judge) -> None:
        self._job, self._judge = job, judge

    def make(self, block: HogelBlock) -> None:
        """Judge the hogels of a block, and write their rows."""
        job = self._job
        device = Device(renderer=self._judge.device["renderer"], index=device_index())
        hogels = self._judge.stream(block.apertures(job.scene.plate), job.settings, images=True, causes=True)
        rows = [
            DrawnRow.of(hogel.aperture, setting, drawing, job.tolerance_px, device)
            for hogel in hogels
            for setting, drawing in enumerate(hogel.drawings)
        ]
        job.parts.write(block.number, table_of(DrawnRow, rows))

    def shown(self, index: tuple[int, int], setting: int) -> ShownHogel:
        """Return truth, drawing and errors of one hogel, as pictures and as channels."""
        scene = self._job.scene
        apertures, settings = [scene.plate.aperture(*index)], [self._job.settings[setting]]
        with closing(self._judge.frames(apertures, settings, DRAWN, partial(_shown, scene))) as frames:
            return next(frames)


def _shown(scene: Scene, frame: JudgedFrame) -> ShownHogel:
    truth, maps = frame.truth, frame.comparison.maps
    reduction = -(-max(truth.camera.resolution) // MAX_PICTURE_PX)
    assert maps.surface is not None, "a judge has the scene at hand"
    encoded = {
        "truth": picture(truth, reduction),
        "drawing": picture(frame.image, reduction),
        "displacement": displacement_map(frame.comparison.errors.moved, reduction),
        "wrong surfaces": mask(maps.surface, SURFACE_COLOR, reduction),
    }
    return ShownHogel(
        pictures={name: data_url(content) for name, content in encoded.items()},
        inspected=inspected_frame(scene, frame),
    )


def data_url(content: bytes) -> str:
    """Return an encoded picture as an address that a page holds within itself."""
    return f"data:{media_type(content)};base64,{base64.b64encode(content).decode()}"


@dataclass(frozen=True, kw_only=True)
class ForeignPlate:
    """The hogel images of another renderer, and what is known of them; see `verify`.

    Attributes
    ----------
    pattern
        Names of its files, with {i} for the column and {j} for the row; or a folder or picture in a layout.
    encoding
        What pictures mean; None for `rgb`.
    near
        Near offset that the renderer is known to have.
    accept
        Conventions that are no faults.
    layout
        Layout of a folder or picture; None for the one that it looks like.
    named_from
        Folder from which the user named the files, for what is written of them; None of absolute names.
    """

    pattern: str
    encoding: Encoding | None = None
    near: float | None = None
    accept: tuple[str, ...] = ()
    layout: str | None = None
    named_from: Path | None = None

    @property
    def description(self) -> dict[str, Any]:
        """The plate as the folder of a survey describes it, wherever its files were named from."""
        return {name: value for name, value in json_object(self).items() if name != "named_from"}

    def found(self, scene: Scene, told: Callable[[str], object]) -> ForeignPlate:
        """Return the plate by its absolute path, with the layout in which its files are read.

        Where no layout is stated, `told` is called with the one that a folder or picture looks like.

        Raises
        ------
        InputError
            There is no file of any hogel, or the files do not fit the layout.
        """
        named = is_place(self.pattern, scene.plate) or self.layout is not None
        place = str(Path(self.pattern).absolute()) if named else absolute_pattern(self.pattern)
        files = checked_files(scene, place, self.layout)
        if files is not None and self.layout is None:
            told(f"{self.pattern} looks like {files.words}")
        return replace(
            self,
            pattern=place,
            layout=None if files is None else files.layout.name,
            named_from=folder_named_from(self.pattern),
        )

    def state(self, plate: Plate) -> str:
        """Return a digest of the names, sizes and times of all image files: it changes when any is written.

        Every row depends on images all over the plate, from which the renderer's faults are diagnosed.
        """
        if self.layout is None:
            names = (self.pattern.format(i=one.column, j=one.row) for one in plate.apertures())
            return state_of_files(names)
        place = Path(self.pattern)
        beside = (place if place.is_dir() else place.parent) / PARAMETERS_FILE
        return state_of_files(map(str, (*pictures_at(place), beside)))


@dataclass(frozen=True, kw_only=True, eq=False)
class ForeignJob(RowsJob):
    """A survey of another renderer's plate.

    Attributes
    ----------
    plate
        Images that are judged.
    state
        Digest of the images, `ForeignPlate.state`: a process that finds others refuses.
    tolerance_px
        Limit of the 99th percentile of displacement; that of wrong pixels is `verify`'s.
    """

    plate: ForeignPlate
    state: str
    tolerance_px: float
    draws = False

    @property
    def name(self) -> str:
        """Word for the work."""
        return "survey-images"

    @contextmanager
    def open(self) -> Iterator[ForeignSession]:
        """Diagnose the renderer: every process for itself, with the same outcome.

        Raises
        ------
        InputError
            The images are others than those of the command.
        """
        plate = self.plate
        require_same_images(plate.pattern, plate.state(self.scene.plate), self.state)
        verifier = HogelVerifier(
            self.scene,
            plate.pattern,
            encoding=plate.encoding,
            layout=plate.layout,
            limits=Limits(displacement_px=self.tolerance_px),
            near=plate.near,
            accept=plate.accept,
        )
        yield ForeignSession(self, verifier)


class ForeignSession:
    """A judge of one renderer's hogels, for the blocks of one survey."""

    def __init__(self, job: ForeignJob, verifier: HogelVerifier) -> None:
        self._job, self._verifier = job, verifier

    def make(self, block: HogelBlock) -> None:
        """Judge the hogels of a block, and write their rows."""
        job = self._job
        hogels = map(self._verifier.hogel, block.apertures(job.scene.plate))
        rows = [ForeignRow.of(one.told_from(job.plate.named_from)) for one in hogels]
        job.parts.write(block.number, table_of(ForeignRow, rows))

    def shown(self, index: tuple[int, int], setting: int) -> ShownHogel:
        """Return truth, image and errors of one hogel, as pictures and as channels."""
        del setting  # there is one
        found = self._verifier.pictured(self._verifier.aperture(*index))
        if found is None:
            return ShownHogel(pictures={}, inspected=None)
        return ShownHogel(pictures=found.pictures, inspected=found.inspected)


def shown_hogel(session: DrawnSession | ForeignSession, index: tuple[int, int], setting: int) -> ShownHogel:
    """Return what a page shows of one hogel; a question to the workers."""
    return session.shown(index, setting)
