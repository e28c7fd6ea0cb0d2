"""`xfrustum verify`: verdict on a foreign renderer, and a diagnosis where it is wrong.

One way: open the source of images, decode a sample of hogels, diagnose it (`compare.diagnosis`),
judge every hogel by the nominal model and by the diagnosed one (`compare.judging`), test the
diagnosis on all of them, and return the record (`verdict.Verification`).
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
from xfrustum.compare.judging.judged import Compared, Figures, Judging, judge
from xfrustum.compare.judging.verdict import Hogel, Limits
from xfrustum.compare.judging.where import places_of
from xfrustum.compare.renderer_model.conventions import ENCODING
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.compare.renderer_model.pictures import drawn_scene, shown_points
from xfrustum.compare.run import images_under_way, in_order
from xfrustum.compare.sampling import PathApertures, PlateSample, SampleRequest
from xfrustum.reference import Reference
from xfrustum.reference.llvm import worker_count
from xfrustum.reports.common.outputs import progress_bar
from xfrustum.reports.scene_check.sight import require_seen
from xfrustum.reports.verification import sources
from xfrustum.reports.verification.other_layouts import with_layout_named
from xfrustum.reports.verification.verdict import Verification
from xfrustum.reports.verification.worst import Pictured, WorstHogels
from xfrustum.scenes import HogelImage, InputError, Scene, open_scene
from xfrustum.scenes.arguments import choice, real, wholes
from xfrustum.scenes.files.foreign_images import Encoding
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.plate.plate import Aperture, ApertureBlocks
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

Item = TypeVar("Item")
#: figures of a hogel as found, and as corrected
FiguresPair = tuple[Figures, Figures]

SAMPLE_SIDE = 5
"""Columns and rows of diagnosed hogels: 25 distinguish all orders of apertures, many times over."""

MAX_SAMPLE_PIXELS, MIN_SAMPLE_HOGELS = 1 << 22, 4
"""Pixels of all diagnosed hogels, which bounds the memory; smallest number of them."""


@dataclass(frozen=True, kw_only=True)
class VerifyOptions:
    """Options of `xfrustum verify`: images, conventions and limits."""

    #: program in place of files, run for each aperture with {x}, {y}, {i}, {j} and {out}
    command: str | None = None
    #: of one run
    timeout_s: float = 60.0
    #: meaning of pictures; None: `rgb`
    encoding: Encoding | str | None = None
    #: of a folder or picture (docs/layouts.md)
    layout: str | None = None
    #: column and row; None: the whole plate
    apertures: Sequence[tuple[int, int]] | None = None
    #: offset that the renderer's author states, scene units
    near: float | None = None
    #: conventions out of `ACCEPTABLE` that are no defects
    accept: Sequence[str] = ()
    #: share of wrong surfaces, colors or outlines of each hogel
    max_wrong: float = MAX_WRONG
    #: distance of 99 of 100 points or outlines; unknown exceeds it; None: no limit
    max_displacement_px: float | None = TOLERANCE_PX
    #: difference of linear radiance that is wrong; None: `COLOR_TOLERANCE`
    max_color: float | None = None
    #: property of plain pictures: `color`, or `geometry`: shown pixels and outlines
    compare: Compared | str = Compared.COLOR
    #: model of the machine that drew; None: any
    device: DeviceModel | None = None
    #: hogels drawn at random, >= 1; None: `apertures`
    sample: int | None = None
    #: share of the plate, 0 to 1, at which growing samples stop
    until: float | None = None
    #: start of the random numbers of a sample
    seed: int = 0
    #: whether to keep all channels of the worst hogels
    channels: bool = False
    #: whether to draw a bar on standard error
    progress: bool = False

    @property
    def limits(self) -> Limits:
        """The limits, and how images are judged."""
        judging = Judging(compared=choice(Compared, self.compare, "compare"))
        if self.max_color is not None:
            judging = replace(judging, color_tolerance=real(self.max_color))
        if self.device is not None:
            judging = replace(judging, device=self.device)
        px = self.max_displacement_px
        return Limits(wrong=self.max_wrong, displacement_px=px, judging=judging)

    def renderer(self, source: str | sources.Renderer | None) -> sources.ForeignRenderer:
        """Return the origin of images: files of a pattern or place, a function, or the command."""
        names = ("command", "encoding", "layout", "near", "timeout_s")
        stated: dict[str, Any] = {name: getattr(self, name) for name in names}
        accept = (self.accept,) if isinstance(self.accept, str) else tuple(self.accept)
        return sources.ForeignRenderer(source=source, accept=accept, **stated)

    def plate_sample(self, scene: Scene) -> PlateSample | None:
        """Return the sample of `sample` or `until`; None without them.

        Images of another renderer may show something in any hogel of the plate.
        """
        if self.sample is None and self.until is None:
            return None
        if self.apertures:
            raise InputError("--sample and --until draw from the whole plate: omit --apertures")
        request = SampleRequest(sample=self.sample, until=self.until, seed=self.seed)
        return PlateSample.from_request(math.prod(scene.plate.hogels), request)

    def judged(self, scene: Scene) -> Sequence[Aperture]:
        """Return the judged apertures, each once; InputError where none sees any object."""
        apertures: Sequence[Aperture] = scene.plate.apertures()
        if (sample := self.plate_sample(scene)) is not None:
            require_seen(scene, apertures)
            return PathApertures(scene.plate, sample.new_places(0))
        if self.apertures:
            pairs = [wholes(index, 2) for index in self.apertures]
            for index, pair in zip(self.apertures, pairs, strict=True):
                if len(pair) < 2:
                    raise InputError(
                        "apertures are pairs of a column and a row, such as (2, 1), not "
                        f"{index!r:.100}"
                    )
            apertures = [scene.plate.aperture(*pair) for pair in dict.fromkeys(pairs)]
        require_seen(scene, apertures)
        return apertures


def verify(
    scene: Scene | str,
    source: str | sources.Renderer | None = None,
    options: VerifyOptions | None = None,
    **fields: Any,
) -> Verification:
    """Judge the hogel images of any renderer, and name its defects.

    `source` is files named by {i} and {j}, a place of files, or a function of scene and aperture;
    single fields of `VerifyOptions` may be passed by name.

    InputError where the scene, the source or an option is not usable, or no aperture sees any
    object.
    """
    opened = open_scene(scene) if isinstance(scene, str) else scene
    options = replace(options or VerifyOptions(), **fields)
    renderer, limits = options.renderer(source), options.limits
    renderer.nominal(opened)
    apertures, reference = options.judged(opened), Reference(opened)
    with renderer.opened(reference) as images:
        images.check(apertures)

        def verified(
            images: sources.Source,
            apertures: Sequence[Aperture],
            sample: PlateSample | None = None,
        ) -> Verification:
            run = Run(
                renderer=renderer,
                reference=reference,
                source=images,
                apertures=apertures,
                limits=limits,
            )
            return run.verified(sample, channels=options.channels, progress=options.progress)

        verification = verified(images, apertures, options.plate_sample(opened))
        # In another layout the same hogels are judged, whatever the bound would be.
        same = [hogel.aperture for hogel in verification.hogels]
        verification = with_layout_named(verification, images, lambda other: verified(other, same))
    return with_tested_diagnosis(verification)


def with_tested_diagnosis(verification: Verification) -> Verification:
    """Name defects only if all hogels pass when corrected for them."""
    return replace(
        verification, diagnosis=with_correction_tested(verification.diagnosis, verification.hogels)
    )


@dataclass(frozen=True, kw_only=True)
class Question:
    """Models by which hogels are judged: as declared, and as diagnosed."""

    #: nominal model with the accepted conventions
    model: RendererModel
    findings: Findings
    #: whether another reading of the pixels is accepted
    accepts_reading: bool


@dataclass(kw_only=True, eq=False)
class Run:
    """One verification under way; images of the sample are kept until they are judged."""

    renderer: sources.ForeignRenderer
    reference: Reference
    source: sources.Source
    apertures: Sequence[Aperture]
    limits: Limits
    kept: dict[Aperture, HogelImage | sources.Problem] = field(default_factory=dict)

    def verified(
        self, sample: PlateSample | None, *, channels: bool, progress: bool
    ) -> Verification:
        """Diagnose some hogels, judge all or a sample, and return the verification."""
        scene, extent = self.reference.scene, None
        total = len(self.apertures) + len(sampled(self.apertures, scene))
        worst, hogels = WorstHogels(scene=scene if channels else None), list[Hogel]()
        with progress_bar(total, "verify", "hogel", shown=progress) as bar:
            question, apertures = self.question(bar.update), self.apertures
            for look in range(1 if sample is None else sample.looks):
                if sample is not None and look:
                    apertures = PathApertures(scene.plate, sample.new_places(look))
                    bar.total += len(apertures)
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
            limits=self.limits,
            diagnosis=question.findings.diagnosis,
            hogels=tuple(hogels),
            worst=worst,
            extent=extent,
        )

    def question(self, done: Callable[[], object] = lambda: None) -> Question:
        """Diagnose a sample of hogels; `done` is called after each."""
        scene, accept = self.reference.scene, self.renderer.accept
        nominal = self.renderer.nominal(scene)
        for aperture in sampled(self.apertures, scene):
            self.kept[aperture] = self._image(aperture)
            done()
        images = [image for image in self.kept.values() if isinstance(image, HogelImage)]
        laid_out = isinstance(self.source, sources.LaidOut)
        of_views = laid_out and not self.source.files.layout.in_hogels  # type: ignore[attr-defined]
        test = TestSet(
            reference=self.reference, images=images, nominal=nominal, judging=self.limits.judging
        )
        findings = diagnose(test, of_views=of_views)
        conventions = [name for name in accept if name != ENCODING]
        return Question(
            model=declared(nominal, findings.diagnosis.model, conventions),
            findings=findings,
            accepts_reading=ENCODING in accept and findings.encoding.reading is not None,
        )

    def hogels(
        self, question: Question, apertures: Iterable[Aperture]
    ) -> Iterator[tuple[Hogel, FiguresPair | None]]:
        """Judge some hogels; yield them in order, with figures where there is an image.

        Images are read in the caller's thread.
        """
        most = images_under_way(math.prod(self.reference.scene.frustum.resolution))
        with ThreadPoolExecutor(worker_count(), thread_name_prefix="judging") as pool:
            images = (
                (
                    aperture,
                    self.kept.pop(aperture) if aperture in self.kept else self._image(aperture),
                )
                for aperture in apertures
            )
            yield from in_order(
                (pool.submit(self._judged, question, *image) for image in images), most
            )

    def pictured(
        self, question: Question, aperture: Aperture, *, channels: bool
    ) -> Pictured | None:
        """Return one hogel in pictures, perhaps with all channels; None where it is missing."""
        worst = WorstHogels(scene=self.reference.scene if channels else None)
        figures = self._judged(question, aperture, self._image(aperture))[1]
        if figures is not None:
            worst.add(aperture, *figures)
        return worst.kept[0] if worst.kept else None

    def _image(self, aperture: Aperture) -> HogelImage | sources.Problem:
        try:
            return self.source.image(aperture)
        except sources.Problem as problem:
            return problem

    def _judged(
        self, question: Question, aperture: Aperture, image: HogelImage | sources.Problem
    ) -> tuple[Hogel, FiguresPair | None]:
        """Judge one hogel; return it with its figures as found and as corrected, or None."""
        if isinstance(image, sources.Problem):
            return Hogel(aperture=aperture, problem=str(image)), None
        findings, limits = question.findings, self.limits
        encoding, model = findings.encoding, findings.diagnosis.model
        decoded = encoding.plainly(image) if question.accepts_reading else image
        # Correction may read nothing in another way than the verdict does, and draw nothing
        # otherwise.
        same = question.model == model and encoding.restoring is None
        same = same and (question.accepts_reading or encoding.reading is None)

        def figures(
            candidate: RendererModel, of: HogelImage, judging: Judging, *, explained: bool
        ) -> Figures:
            points = shown_points(drawn_scene(self.reference, model).scene, model, of)
            return judge(self.reference, candidate, of, points, judging, explained=explained)

        as_found = figures(question.model, decoded, limits.judging, explained=same)
        corrected = as_found
        if not same:
            restored = encoding.read(self.reference, image)
            corrected = figures(model, restored, findings.judging, explained=True)
        hogel = Hogel(
            aperture=aperture,
            checks=limits.checks(as_found),
            as_found=as_found.numbers,
            corrected=corrected.numbers,
            places=places_of(as_found),
            left=corrected.numbers.all_wrong - corrected.rounded,
            mended=limits.mends(as_found, corrected, model),
            storage=image.storage,
        )
        return hogel, (as_found, corrected)


def sampled(apertures: Sequence[Aperture], scene: Scene) -> list[Aperture]:
    """Return the apertures to be diagnosed: spread over the plate, few enough for the memory."""

    def spread(items: Sequence[Item], most: int) -> list[Item]:
        return [
            items[index] for index in np.unique(np.linspace(0, len(items) - 1, most).astype(int))
        ]

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
