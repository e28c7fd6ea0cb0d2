"""Surveys of the plates of other renderers: each hogel judged as `verify` does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from xfrustum.reports.cluster.job import Session
from xfrustum.reports.cluster.rows_job import RowsJob
from xfrustum.reports.common.json_ready import json_object
from xfrustum.reports.common.records import table_of
from xfrustum.reports.survey.hogels import ShownHogel
from xfrustum.reports.survey.rows import ForeignRow
from xfrustum.reports.verification.file_state import require_same_images, state_of_files
from xfrustum.reports.verification.laid_out import is_place
from xfrustum.reports.verification.sources import absolute_pattern, folder_named_from
from xfrustum.reports.verification.verdict import Limits
from xfrustum.reports.verification.verification import HogelVerifier, checked_files
from xfrustum.scenes.files.foreign_images import Encoding
from xfrustum.scenes.files.layouts.detection import PARAMETERS_FILE, pictures_at
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Plate


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

        Parameters
        ----------
        scene
            Scene of the plate.
        told
            Function that is told which layout a folder or picture looks like, where none is stated.

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
        return state_of_files(self._names(plate))

    def _names(self, plate: Plate) -> Iterator[str]:
        """Yield the paths of all files that images are read from."""
        if self.layout is None:
            for aperture in plate.apertures():
                yield self.pattern.format(i=aperture.column, j=aperture.row)
            return
        place = Path(self.pattern)
        yield from map(
            str, (*pictures_at(place), (place if place.is_dir() else place.parent) / PARAMETERS_FILE)
        )


@dataclass(frozen=True, kw_only=True)
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
        """Word by which the dashboard groups its tasks."""
        return "survey-images"

    @contextmanager
    def open(self, scene: Scene | None = None) -> Iterator[ForeignSession]:
        """Open the scene, and diagnose the renderer: every process for itself, with the same outcome.

        Raises
        ------
        InputError
            The scene or the images are others than those of the command.
        """
        here = self.scene_here(scene)
        require_same_images(self.plate.pattern, self.plate.state(here.plate), self.state)
        verifier = HogelVerifier(
            here,
            self.plate.pattern,
            encoding=self.plate.encoding,
            layout=self.plate.layout,
            limits=Limits(displacement_px=self.tolerance_px),
            near=self.plate.near,
            accept=self.plate.accept,
        )
        yield ForeignSession(self, verifier)


class ForeignSession(Session):
    """A judge of one renderer's hogels, for the blocks of one survey."""

    def __init__(self, job: ForeignJob, verifier: HogelVerifier) -> None:
        self._job, self._verifier = job, verifier

    def make(self, number: int) -> None:
        """Judge the hogels of a block, and write their rows."""
        job = self._job
        hogels = map(self._verifier.hogel, job.blocks.apertures(number))
        rows = [ForeignRow.of(one.told_from(job.plate.named_from)) for one in hogels]
        job.parts.write(number, table_of(ForeignRow, rows))

    def shown(self, column: int, row: int, setting: int) -> ShownHogel:
        """Return truth, image and errors of one hogel, as pictures and as channels."""
        del setting  # there is one
        found = self._verifier.pictured(self._verifier.aperture(column, row))
        if found is None:
            return ShownHogel(pictures={}, inspected=None)
        return ShownHogel(pictures=found.pictures, inspected=found.inspected)
