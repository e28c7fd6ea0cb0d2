"""What a survey judges: hogels that our rasterizer draws, or those of another renderer, block by block."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial

from xfrustum.compare.run import Judge, JudgedFrame
from xfrustum.reference import Reference
from xfrustum.reports.blocks import device_index
from xfrustum.reports.common.records import table_of
from xfrustum.reports.error_report.images import SURFACE_COLOR, displacement_map, mask, media_type, picture
from xfrustum.reports.inspection.channels import DRAWN, InspectedHogel, inspected_frame
from xfrustum.reports.parts import HogelBlock, RowsJob
from xfrustum.reports.survey.rows import Device, DrawnRow, ForeignRow
from xfrustum.reports.verification.sources import ForeignRenderer
from xfrustum.reports.verification.verdict import Limits
from xfrustum.reports.verification.verification import Question, Run
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

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


@dataclass(frozen=True, kw_only=True, eq=False)
class ForeignJob(RowsJob):
    """A survey of another renderer's files; `state` is their digest, by which others are refused."""

    renderer: ForeignRenderer
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
        scene, renderer, asked = self.scene, self.renderer, self.scene.plate.apertures()
        renderer.require_state(asked, self.state)
        reference, limits = Reference(scene), Limits(displacement_px=self.tolerance_px)
        with renderer.opened(reference) as source:
            run = Run(renderer=renderer, reference=reference, source=source, asked=asked, limits=limits)
            question = run.question()
            run.kept.clear()  # few hogels of the sample are this process's own: all are read anew
            yield ForeignSession(self, run, question)


class ForeignSession:
    """A judge of one renderer's hogels, for the blocks of one survey."""

    def __init__(self, job: ForeignJob, run: Run, question: Question) -> None:
        self._job, self._run, self._question = job, run, question

    def make(self, block: HogelBlock) -> None:
        """Judge the hogels of a block, and write their rows."""
        job = self._job
        judged = self._run.hogels(self._question, block.apertures(job.scene.plate))
        rows = [ForeignRow.of(hogel.told_from(job.renderer.named_from)) for hogel, _ in judged]
        job.parts.write(block.number, table_of(ForeignRow, rows))

    def shown(self, index: tuple[int, int], setting: int) -> ShownHogel:
        """Return truth, image and errors of one hogel, as pictures and as channels."""
        del setting  # there is one
        aperture = self._job.scene.plate.aperture(*index)
        found = self._run.pictured(self._question, aperture, channels=True)
        if found is None:
            return ShownHogel(pictures={}, inspected=None)
        return ShownHogel(pictures=found.pictures, inspected=found.inspected)


def shown_hogel(session: DrawnSession | ForeignSession, index: tuple[int, int], setting: int) -> ShownHogel:
    """Return what a page shows of one hogel; a question to the workers."""
    return session.shown(index, setting)
