"""Surveys of our own rasterizer: each hogel drawn with every setting and judged by its truth."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

from xfrustum.compare.run import Judge, JudgedFrame
from xfrustum.reports.blocks import device_index
from xfrustum.reports.cluster.job import Session
from xfrustum.reports.cluster.rows_job import RowsJob
from xfrustum.reports.common.records import table_of
from xfrustum.reports.error_report.images import SURFACE_COLOR, displacement_map, mask, media_type, picture
from xfrustum.reports.inspection.drawn import WANTED, inspected_frame
from xfrustum.reports.inspection.hogels import InspectedHogel
from xfrustum.reports.survey.rows import Device, DrawnRow, JudgedWith
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

MAX_PICTURE_PX = 512
"""Longest side of a picture on the page; larger images are reduced."""

Pictures = dict[str, str]
"""Data URLs of the pictures of one hogel, by what they show."""


@dataclass(frozen=True, kw_only=True)
class ShownHogel:
    """What a page shows of one hogel.

    Attributes
    ----------
    pictures
        Its pictures; none where it is missing.
    inspected
        All its channels; None where it is missing.
    """

    pictures: Pictures
    inspected: InspectedHogel | None


@dataclass(frozen=True, kw_only=True)
class HogelsJob(RowsJob):
    """A survey of what our rasterizer draws.

    Attributes
    ----------
    settings
        Settings that every hogel is drawn with.
    tracer
        Tracer that gives the truth a second opinion.
    tolerance_px
        Displacement beyond which a hogel is counted.
    """

    settings: tuple[DoubleFrustum, ...]
    tracer: str
    tolerance_px: float

    @property
    def name(self) -> str:
        """Word by which the dashboard groups its tasks."""
        return "survey"

    @contextmanager
    def open(self, scene: Scene | None = None) -> Iterator[HogelsSession]:
        """Open the scene and its renderers."""
        with Judge(self.scene_here(scene), self.tracer) as judge:
            yield HogelsSession(self, judge)


class HogelsSession(Session):
    """A judge of one scene, for the blocks of one survey."""

    def __init__(self, job: HogelsJob, judge: Judge) -> None:
        self._job, self._judge = job, judge

    def make(self, number: int) -> None:
        """Judge the hogels of a block, and write their rows."""
        job, judge = self._job, self._judge
        judged = JudgedWith(
            tolerance_px=job.tolerance_px,
            reach=judge.scene.frustum.longest_reach,
            device=Device(renderer=judge.device["renderer"], index=device_index()),
        )
        hogels = judge.stream(job.blocks.apertures(number), job.settings, images=True, causes=True)
        rows = [
            DrawnRow.of(hogel.aperture, setting, drawing, judged)
            for hogel in hogels
            for setting, drawing in enumerate(hogel.drawings)
        ]
        job.parts.write(number, table_of(DrawnRow, rows))

    def shown(self, column: int, row: int, setting: int) -> ShownHogel:
        """Return truth, drawing and errors of one hogel, as pictures and as channels."""
        aperture = self._judge.scene.plate.aperture(column, row)
        settings, finish = [self._job.settings[setting]], partial(_shown, self._judge.scene)
        with closing(self._judge.frames([aperture], settings, WANTED, finish)) as frames:
            return next(frames)


def _shown(scene: Scene, frame: JudgedFrame) -> ShownHogel:
    truth, maps = frame.truth, frame.comparison.maps
    reduction = -(-max(truth.camera.resolution) // MAX_PICTURE_PX)
    assert maps.surface is not None, "a judge has the scene at hand"
    encoded = {
        "truth": picture(truth, reduction),
        "drawing": picture(frame.image, reduction),
        "displacement": displacement_map(maps.displacement, reduction),
        "wrong surfaces": mask(maps.surface, SURFACE_COLOR, reduction),
    }
    return ShownHogel(
        pictures={name: data_url(content) for name, content in encoded.items()},
        inspected=inspected_frame(scene, frame),
    )


def worst_hogel(session: Any, column: int, row: int, setting: int) -> ShownHogel:
    """Return what a page shows of one hogel; the question that a team of workers is asked."""
    found: ShownHogel = session.shown(column, row, setting)
    return found


def data_url(content: bytes) -> str:
    """Return an encoded picture as an address that a page holds within itself."""
    return f"data:{media_type(content)};base64,{base64.b64encode(content).decode()}"
