"""What a survey judges: hogels that our rasterizer draws, or those of another renderer, block by block."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass

from xfrustum.compare.run import Judge, JudgedFrame
from xfrustum.compare.sampling import aperture_at
from xfrustum.reference import Reference
from xfrustum.reports.blocks import Job, device_index
from xfrustum.reports.common.records import table_of
from xfrustum.reports.common.templates_environment import address
from xfrustum.reports.error_report.images import SURFACE_COLOR, displacement_map, mask, picture
from xfrustum.reports.inspection import DRAWN, InspectedHogel, inspected_frame
from xfrustum.reports.parts import Parts
from xfrustum.reports.survey.rows import Device, DrawnRow, ForeignRow
from xfrustum.reports.verification.sources import ForeignRenderer
from xfrustum.reports.verification.verdict import Limits
from xfrustum.reports.verification.verification import Run
from xfrustum.scenes import Aperture, DoubleFrustum, Frustum, Scene

MAX_PICTURE_PX = 512  # longest side of a picture on the page; larger images are reduced
PIXELS_PER_BLOCK = 1 << 22
"""Pixels that are drawn and judged in a block, those that a hogel costs anyway included: 10 to 60 s of one
core, while a task costs a scheduler a few milliseconds."""

PIXELS_PER_HOGEL = 1 << 16
"""Pixels that take as long as what a hogel costs however small it is: on the car, whose triangles are all
transformed for each drawing and each link of its error budget, about as many as 256 x 256."""

MIN_BLOCKS = 16
"""Number of blocks that even a small sample is cut into where it has as many hogels, for several workers."""


def hogels_per_block(hogels: int, frustum: Frustum, settings: int) -> int:
    """Return how many of some hogels a block has; it depends on the work, never on the number of workers."""
    cost = (math.prod(frustum.resolution) + PIXELS_PER_HOGEL) * settings
    return max(1, min(PIXELS_PER_BLOCK // cost, math.ceil(hogels / MIN_BLOCKS)))


@dataclass(frozen=True, kw_only=True)
class HogelBlock:
    """Some hogels by their places on the path of `aperture_at`, and the number of their part."""

    number: int
    places: Sequence[int]


@dataclass(frozen=True, kw_only=True)
class ShownHogel:
    """Pictures of one hogel, data URLs by what they show, and all its channels; none where it is missing."""

    pictures: dict[str, str]
    inspected: InspectedHogel | None


@dataclass(frozen=True)
class Session:
    """What judges the hogels of a survey in one process."""

    make: Callable[[HogelBlock], None]  # writes the rows of a block
    shown: Callable[[tuple[int, int], int], ShownHogel]  # of a column and row, and the number of a setting


@dataclass(frozen=True, kw_only=True, eq=False)
class SurveyJob(Job):
    """Hogels of a scene that are judged in blocks, each of which becomes a part of rows."""

    scene: Scene
    parts: Parts
    tolerance_px: float

    def finished(self, block: HogelBlock) -> bool:
        """Return whether a block has its part."""
        return self.parts.finished(block.number)

    def size(self, block: HogelBlock) -> int:
        """Return the number of hogels of a block."""
        return len(block.places)

    def words(self, block: HogelBlock) -> str:
        """Return the number of a block, and its first aperture."""
        return "block {} (from aperture {},{})".format(block.number, *self.apertures(block)[0].index)

    def apertures(self, block: HogelBlock) -> list[Aperture]:
        """Return the hogels of a block, in their order."""
        return [aperture_at(self.scene.plate, place) for place in block.places]


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnJob(SurveyJob):
    """A survey of what our rasterizer draws with some settings; the tracer gives truths a second opinion."""

    name = "survey"
    settings: tuple[DoubleFrustum, ...]
    tracer: str

    @contextmanager
    def open(self) -> Iterator[Session]:
        """Open the renderers of the scene."""

        def make(block: HogelBlock) -> None:
            hogels = judge.stream(self.apertures(block), self.settings, images=True, causes=True)
            rows = [
                DrawnRow.of(hogel.aperture, setting, drawing, self.tolerance_px, device)
                for hogel in hogels
                for setting, drawing in enumerate(hogel.drawings)
            ]
            self.parts.write(block.number, table_of(DrawnRow, rows))

        def shown(index: tuple[int, int], setting: int) -> ShownHogel:
            apertures, settings = [self.scene.plate.aperture(*index)], [self.settings[setting]]
            with closing(judge.frames(apertures, settings, DRAWN, self._shown)) as frames:
                return next(frames)

        with Judge(self.scene, self.tracer) as judge:
            device = Device(judge.device["renderer"], device_index())
            yield Session(make, shown)

    def _shown(self, frame: JudgedFrame) -> ShownHogel:
        """Return truth, drawing and errors of one hogel, as pictures and as channels."""
        wrong = frame.comparison.maps.surface
        reduction = -(-max(self.scene.frustum.resolution) // MAX_PICTURE_PX)
        assert wrong is not None, "a judge has the scene at hand"
        pictures = {
            "truth": picture(frame.truth, reduction),
            "drawing": picture(frame.image, reduction),
            "displacement": displacement_map(frame.comparison.errors.moved, reduction),
            "wrong surfaces": mask(wrong, SURFACE_COLOR, reduction),
        }
        urls = {name: address(encoded) for name, encoded in pictures.items()}
        return ShownHogel(pictures=urls, inspected=inspected_frame(self.scene, frame))


@dataclass(frozen=True, kw_only=True, eq=False)
class ForeignJob(SurveyJob):
    """A survey of another renderer's files; `state` is their digest, by which others are refused."""

    name = "survey-images"
    draws = False
    renderer: ForeignRenderer
    state: str

    @contextmanager
    def open(self) -> Iterator[Session]:
        """Diagnose the renderer: every process for itself, with the same outcome."""
        renderer, asked = self.renderer, self.scene.plate.apertures()
        renderer.require_state(asked, self.state)
        reference, limits = Reference(self.scene), Limits(displacement_px=self.tolerance_px)

        def make(block: HogelBlock) -> None:
            judged = run.hogels(question, self.apertures(block))
            rows = [ForeignRow.of(hogel.told_from(renderer.named_from)) for hogel, _ in judged]
            self.parts.write(block.number, table_of(ForeignRow, rows))

        def shown(index: tuple[int, int], setting: int) -> ShownHogel:
            found = run.pictured(question, self.scene.plate.aperture(*index), channels=True)
            pictures, inspected = (found.pictures, found.inspected) if found else ({}, None)
            return ShownHogel(pictures=pictures, inspected=inspected)

        with renderer.opened(reference) as source:
            run = Run(renderer=renderer, reference=reference, source=source, asked=asked, limits=limits)
            question = run.question()
            run.kept.clear()  # few hogels of the sample are this process's own: all are read anew
            yield Session(make, shown)


def shown_hogel(session: Session, index: tuple[int, int], setting: int) -> ShownHogel:
    """Return what a page shows of one hogel; a question to the workers."""
    return session.shown(index, setting)
