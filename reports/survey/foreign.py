"""Surveys of the plates of other renderers: each hogel judged as `verify` does."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from xfrustum.reports.cluster.blocks import Blocks
from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.cluster.job import Job, Session
from xfrustum.reports.cluster.parts import Parts
from xfrustum.reports.cluster.ticket import SceneTicket
from xfrustum.reports.common.records import table_of
from xfrustum.reports.survey.hogels import ShownHogel
from xfrustum.reports.survey.rows import ForeignRow
from xfrustum.reports.verification.verdict import Limits
from xfrustum.reports.verification.verification import HogelVerifier
from xfrustum.scenes.files.foreign_images import Encoding
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Plate


@dataclass(frozen=True, kw_only=True)
class ForeignPlate:
    """The hogel images of another renderer, and what is known of them; see `verify`.

    Attributes
    ----------
    pattern
        Names of its files, with {i} for the column and {j} for the row.
    encoding
        What pictures mean; None for `rgb`.
    near
        Near offset that the renderer is known to have.
    accept
        Conventions that are no faults.
    """

    pattern: str
    encoding: Encoding | None = None
    near: float | None = None
    accept: tuple[str, ...] = ()

    def state(self, plate: Plate) -> str:
        """Return a digest of the names, sizes and times of all image files: it changes when any is written.

        Every row depends on images all over the plate, from which the renderer's faults are diagnosed.
        """
        digest = hashlib.sha256()
        for aperture in plate.apertures():
            path = self.pattern.format(i=aperture.column, j=aperture.row)
            try:
                found = os.stat(path)  # noqa: PTH116 - a Path for each of millions of names takes as long again
            except OSError:
                continue
            digest.update(f"{path}\0{found.st_size}\0{found.st_mtime_ns}\n".encode(errors="surrogateescape"))
        return digest.hexdigest()


@dataclass(frozen=True, kw_only=True)
class ForeignJob(Job):
    """A survey of another renderer's plate.

    Attributes
    ----------
    ticket
        The scene.
    plate
        Images that are judged.
    tolerance_px
        Limit of the 99th percentile of displacement; that of wrong pixels is `verify`'s.
    blocks
        Blocks of the hogels that are judged.
    parts
        Folder of the rows.
    """

    ticket: SceneTicket
    plate: ForeignPlate
    tolerance_px: float
    blocks: Blocks
    parts: Parts

    @property
    def name(self) -> str:
        """Word by which the dashboard groups its tasks."""
        return "survey-images"

    def finished(self, number: int) -> bool:
        """Return whether a block has its part."""
        return self.parts.finished(number)

    def claims(self) -> Claims:
        """Return the claims of the folder of parts."""
        return self.parts.claims()

    @contextmanager
    def open(self, scene: Scene | None = None) -> Iterator[ForeignSession]:
        """Open the scene, and diagnose the renderer: every process for itself, with the same outcome."""
        verifier = HogelVerifier(
            self.ticket.open() if scene is None else scene,
            self.plate.pattern,
            encoding=self.plate.encoding,
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
        rows = [ForeignRow.of(self._verifier.hogel(aperture)) for aperture in job.blocks.apertures(number)]
        job.parts.write(number, table_of(ForeignRow, rows))

    def shown(self, column: int, row: int, setting: int) -> ShownHogel:
        """Return truth, image and errors of one hogel, as pictures and as channels."""
        del setting  # there is one
        found = self._verifier.pictured(self._verifier.aperture(column, row))
        if found is None:
            return ShownHogel(pictures={}, inspected=None)
        return ShownHogel(pictures=found.pictures, inspected=found.inspected)
