"""`xfrustum verify`: verdict on a foreign renderer, and a diagnosis of wrong images.

Steps: test the request, open the source of images, decode and diagnose a sample of hogels
(`compare.diagnosis`), judge every hogel by the nominal and by the diagnosed model
(`compare.judging`), test the diagnosis on all hogels, and return the record
(`verdict.Verification`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from xfrustum.compare.diagnosis.diagnosis import (
    Findings,
    declared,
    diagnose,
    with_correction_tested,
)
from xfrustum.compare.diagnosis.testset import TestSet
from xfrustum.compare.judging.judged import Figures, Judging, judge
from xfrustum.compare.judging.verdict import Hogel
from xfrustum.compare.renderer_model.conventions import ENCODING
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.compare.renderer_model.pictures import drawn_scene, shown_points
from xfrustum.compare.run import images_under_way, in_order
from xfrustum.reference import Reference
from xfrustum.reference.llvm import worker_count
from xfrustum.reference.truth import with_references
from xfrustum.reports.common.outputs import progress_bar
from xfrustum.reports.verification.request import Renderer, Request, VerifyOptions
from xfrustum.reports.verification.sources import Problem, Source, opened
from xfrustum.reports.verification.verdict import Verification, WorstHogels
from xfrustum.scenes import HogelImage, Scene, open_scene
from xfrustum.scenes.plate import Aperture, ApertureBlocks

Item = TypeVar("Item")
#: figures of a hogel as delivered, and as corrected
FiguresPair = tuple[Figures, Figures]

SAMPLE_SIDE = 5
"""Columns and rows of diagnosed hogels: 25 hogels distinguish all orders of apertures."""

MAX_SAMPLE_PIXELS, MIN_SAMPLE_HOGELS = 1 << 22, 4
"""Largest number of pixels of all diagnosed hogels, which bounds memory; smallest number of
hogels."""


def verify(
    scene: Scene | str,
    source: str | Renderer | None = None,
    options: VerifyOptions | None = None,
    **fields: Any,
) -> Verification:
    """Judge the hogel images of any renderer, and name its defects.

    `source` is a pattern of files with {i} and {j}, a folder, a file, or a function of scene and
    aperture. Fields of `VerifyOptions` may be passed by name.

    Raises InputError if the scene, the source or an option is unusable, or no aperture shows any
    object.
    """
    options = replace(options or VerifyOptions(), **fields)
    usable = open_scene(scene) if isinstance(scene, str) else scene
    request = Request.from_options(usable, source, options)
    reference = Reference(usable)
    with opened(request, reference) as images:
        images.check(request.apertures)
        verification = Run(request=request, reference=reference, source=images).verified()
    return with_tested_diagnosis(verification)


def with_tested_diagnosis(verification: Verification) -> Verification:
    """Name defects only if all hogels pass when corrected for them."""
    tested = with_correction_tested(verification.diagnosis, verification.hogels)
    return replace(verification, diagnosis=tested)


@dataclass(frozen=True, kw_only=True)
class Question:
    """Declared and diagnosed models by which hogels are judged."""

    #: nominal model with the accepted conventions
    model: RendererModel
    findings: Findings
    #: whether an encoding other than the requested encoding is accepted
    accepts_reading: bool

    @property
    def corrects(self) -> bool:
        """True if the correction changes the encoding or the model of the verdict."""
        encoding = self.findings.encoding
        reads = encoding.reading is not None and not self.accepts_reading
        return (
            reads or encoding.restoring is not None or self.model != self.findings.diagnosis.model
        )


@dataclass(kw_only=True, eq=False)
class Run:
    """A running verification; images of the diagnosed sample are kept until they are judged."""

    request: Request
    reference: Reference
    source: Source
    kept: dict[Aperture, HogelImage | Problem] = field(default_factory=dict)

    def verified(self) -> Verification:
        """Diagnose some hogels, judge all hogels or a sample, and return the verification."""
        request, hogels, extent = self.request, list[Hogel](), None
        scene, sample, options = request.scene, request.sample, request.options
        total = len(request.apertures) + len(sampled(request.apertures, scene))
        worst = WorstHogels(scene=scene if options.channels else None)
        with progress_bar(total, "verify", "hogel", shown=options.progress) as bar:
            question = self.question(bar.update)
            for look in range(request.looks):
                apertures = request.apertures_of(look)
                bar.total += len(apertures) if look else 0
                for hogel, figures in self.hogels(question, apertures):
                    if figures is not None:
                        worst.add(hogel.aperture, *figures)
                    hogels.append(hogel)
                    bar.update()
                if sample is not None:
                    extent = sample.extent(len(hogels), look)
                    if extent.decides(sum(not hogel.passed for hogel in hogels)):
                        break
        return Verification(
            scene=scene,
            source=self.source.name,
            limits=request.limits,
            diagnosis=question.findings.diagnosis,
            hogels=tuple(hogels),
            worst=tuple(worst.kept),
            extent=extent,
            truth_by=request.truth_by,
        )

    @property
    def judging(self) -> Judging:
        """Requested comparison of images, with the cameras of the source."""
        return replace(self.request.limits.judging, directions=self.source.directions)

    def question(self, done: Callable[[], object] = lambda: None) -> Question:
        """Diagnose a sample of hogels; `done` is called after each."""
        request, images = self.request, list[HogelImage]()
        for aperture in sampled(request.apertures, request.scene):
            image = self.kept[aperture] = self._image(aperture)
            images += [image] if isinstance(image, HogelImage) else []
            done()
        test = TestSet(
            reference=self.reference,
            images=images,
            nominal=request.nominal,
            judging=self.judging,
        )
        findings = diagnose(test, of_views=self.source.of_views)
        conventions = [name for name in request.accept if name != ENCODING]
        return Question(
            model=declared(request.nominal, findings.diagnosis.model, conventions),
            findings=findings,
            accepts_reading=ENCODING in request.accept and findings.encoding.reading is not None,
        )

    def hogels(
        self, question: Question, apertures: Iterable[Aperture]
    ) -> Iterator[tuple[Hogel, FiguresPair | None]]:
        """Judge hogels and yield them in order, with figures if there is an image.

        Images are read in the caller's thread.
        """
        most = images_under_way(math.prod(self.request.scene.frustum.resolution))
        with ThreadPoolExecutor(worker_count(), thread_name_prefix="judging") as pool:
            judged = with_references(self.reference, self.request.truth_by, apertures)
            tasks = (
                pool.submit(self._judged, question, aperture, self._image(aperture), reference)
                for aperture, reference in judged
            )
            yield from in_order(tasks, most)

    def figures(self, question: Question, aperture: Aperture) -> FiguresPair | None:
        """Return the figures of one hogel; None if it is missing."""
        return self._judged(question, aperture, self._image(aperture), self.reference)[1]

    def _image(self, aperture: Aperture) -> HogelImage | Problem:
        if aperture in self.kept:
            return self.kept.pop(aperture)
        try:
            return self.source.image(aperture)
        except Problem as problem:
            return problem

    def _judged(
        self,
        question: Question,
        aperture: Aperture,
        image: HogelImage | Problem,
        reference: Reference,
    ) -> tuple[Hogel, FiguresPair | None]:
        """Judge a hogel; return it with its figures as delivered and as corrected, or None."""
        if isinstance(image, Problem):
            return Hogel(aperture=aperture, problem=str(image)), None
        findings, limits = question.findings, self.request.limits
        encoding, model = findings.encoding, findings.diagnosis.model
        scene = drawn_scene(reference, model).scene
        decoded = encoding.plainly(image) if question.accepts_reading else image
        points = shown_points(scene, model, decoded)
        explained = not question.corrects
        as_found = corrected = judge(
            reference, question.model, decoded, points, self.judging, explained=explained
        )
        if question.corrects:
            restored = encoding.read(reference, image)
            points = shown_points(scene, model, restored)
            corrected = judge(reference, model, restored, points, findings.judging, explained=True)
        hogel = Hogel.from_figures(limits, aperture, model, as_found, corrected)
        return hogel, (as_found, corrected)


def sampled(apertures: Sequence[Aperture], scene: Scene) -> list[Aperture]:
    """Return the apertures to diagnose: spread over the plate, within the bound of memory."""

    def spread(items: Sequence[Item], most: int) -> list[Item]:
        places = np.unique(np.linspace(0, len(items) - 1, most).astype(int))
        return [items[place] for place in places]

    pixels = math.prod(scene.frustum.resolution)
    count = int(np.clip(MAX_SAMPLE_PIXELS // pixels, MIN_SAMPLE_HOGELS, SAMPLE_SIDE**2))
    side = max(2, int(np.sqrt(count)))
    if isinstance(apertures, ApertureBlocks):
        columns, rows = (spread(range(hogels), side) for hogels in scene.plate.hogels)
        return [scene.plate.aperture(column, row) for row in rows for column in columns]
    columns = spread(sorted({aperture.column for aperture in apertures}), side)
    rows = spread(sorted({aperture.row for aperture in apertures}), side)
    chosen = [a for a in apertures if a.column in columns and a.row in rows]
    return spread(list(apertures), count) if len(chosen) < min(side, len(apertures)) else chosen
