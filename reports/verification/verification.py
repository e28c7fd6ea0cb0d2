"""`xfrustum verify`: is a renderer that nobody here wrote right, and if not, what is wrong with it?"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from xfrustum.compare.diagnosis.diagnosis import Findings, declared, diagnose
from xfrustum.compare.diagnosis.evidence import Evidence
from xfrustum.compare.extent import require_seen
from xfrustum.compare.judging.judged import Compared, Figures, Judging, judge
from xfrustum.compare.renderer_model.conventions import ACCEPTABLE, ENCODING
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.compare.renderer_model.shown_points import shown_points
from xfrustum.compare.run import images_under_way, in_order
from xfrustum.reference import Reference
from xfrustum.reference.llvm import worker_count
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.verification.laid_out import LaidOut, is_place, laid_out, with_layout_named
from xfrustum.reports.verification.sources import Command, Files, Function, Problem, Renderer, Source
from xfrustum.reports.verification.verdict import Hogel, Limits, Verification, with_correction_tested
from xfrustum.reports.verification.worst_hogels import Pictured, WorstHogels
from xfrustum.scenes import open_scene
from xfrustum.scenes.arguments import choice, real, wholes
from xfrustum.scenes.disk.durable import Aside, scratch_folder
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.foreign_images import Encoding
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture, ApertureBlocks

Item = TypeVar("Item")

SAMPLE_SIDE = 5
"""Columns and rows of hogels that are diagnosed: 25 tell apart all orders of apertures, many times over."""

MAX_SAMPLE_PIXELS, MIN_SAMPLE_HOGELS = 1 << 22, 4
"""Pixels of all diagnosed hogels together, which bounds the memory; and number of hogels that are diagnosed
whatever their size."""


def verify(  # noqa: PLR0913 - one keyword for each option of the command
    scene: Scene | str,
    source: str | Renderer | None = None,
    *,
    command: str | None = None,
    encoding: Encoding | str | None = None,
    layout: str | None = None,
    apertures: Sequence[tuple[int, int]] | None = None,
    near: float | None = None,
    accept: Sequence[str] = (),
    max_wrong: float = 0.01,
    max_displacement_px: float | None = 0.5,
    max_color: float | None = None,
    compare: Compared | str = Compared.COLOR,
    timeout_s: float = 60.0,
    channels: bool = False,
    progress: bool = False,
) -> Verification:
    """Judge the hogel images of any renderer, and say what is wrong with it.

    Parameters
    ----------
    scene, source
        What was to be drawn; and files named by {i} and {j}, a place of files, or a function of both.
    command
        Instead: a program that is run for each aperture, with {x}, {y}, {i}, {j} and {out}.
    encoding, layout
        What pictures mean, `rgb` where nobody says; and the layout of a place of files (docs/layouts.md).
    apertures
        Column and row of each; the whole plate where None.
    near
        The near offset that the renderer's author states; it is then part of the question.
    accept
        Conventions out of `ACCEPTABLE`, of which images are judged by what was found.
    max_wrong
        Limits the share of wrong surfaces of each hogel; of plain pictures, that of wrong colors or outlines.
    max_displacement_px
        Limits how far 99 of 100 surface points or outlines are off; unknown is too far. None: no limit.
    max_color
        Difference of linear radiance beyond which a color is wrong; `COLOR_TOLERANCE` where None.
    compare
        What plain pictures are judged by: `color`, or `geometry`: where they show something, and outlines.
    timeout_s, channels, progress
        Seconds a run of the command may take; whether to keep channels of the worst hogels, and draw a bar.

    Raises
    ------
    InputError
        The scene, the source or an option is not usable, or none of the apertures sees any object.
    """
    opened = open_scene(scene) if isinstance(scene, str) else scene
    limits = limits_of(max_wrong, max_displacement_px, compare, max_color)
    nominal = nominal_model(opened, near, accept)
    asked = asked_apertures(opened, apertures)
    require_seen(opened, asked)
    reference = Reference(opened)
    with opened_source(reference, source, command, encoding, timeout_s, layout) as images:
        images.check(asked)
        run = Run(reference=reference, source=images, asked=asked, limits=limits, channels=channels)
        return run.in_any_layout(nominal, tuple(accept), progress=progress)


def limits_of(
    wrong: float, displacement_px: float | None, compare: Compared | str, max_color: float | None
) -> Limits:
    """Return the limits, and how images are judged."""
    judging = Judging(compared=choice(Compared, compare, "compare"))
    if max_color is not None:
        judging = replace(judging, color_tolerance=real(max_color))
    return Limits(wrong=wrong, displacement_px=displacement_px, judging=judging)


def nominal_model(scene: Scene, near: float | None, accept: Sequence[str]) -> DrawnModel:
    """Return what the renderer's author says of it, if that can be."""
    strange = [name for name in ((accept,) if isinstance(accept, str) else accept) if name not in ACCEPTABLE]
    if strange:
        raise InputError(f"accept: {strange[0]!r} is not one of {', '.join(ACCEPTABLE)}")
    reach = scene.frustum.longest_reach
    if near is not None and not 0 <= real(near) < reach:
        raise InputError(f"near {near} must be at least 0 and smaller than the reach, {reach}")
    return DrawnModel(near=real(near or 0.0))


def asked_apertures(scene: Scene, indices: Sequence[tuple[int, int]] | None) -> Sequence[Aperture]:
    """Return the apertures of some indices, each once; all of the plate, row by row, where there are none."""
    if not indices:
        return scene.plate.apertures()
    pairs = [wholes(index, 2) for index in indices]
    for given, pair in zip(indices, pairs, strict=True):
        if len(pair) < 2:
            raise InputError(f"apertures are pairs of a column and a row, such as (2, 1), not {given!r:.100}")
    return [scene.plate.aperture(*pair) for pair in dict.fromkeys(pairs)]


@contextmanager
def opened_source(
    reference: Reference,
    source: str | Renderer | None,
    command: str | None,
    encoding: Encoding | str | None,
    timeout_s: float,
    layout: str | None,
) -> Iterator[Source]:
    """Open a source, with a folder of its own for what a command writes."""
    if (source is None) == (command is None):
        raise InputError("give either SOURCE, a pattern of files with {i} and {j}, or --command")
    if layout is not None and not isinstance(source, str):
        raise InputError("layout is that of files; name their folder as SOURCE")
    meant = Encoding.RGB if encoding is None else choice(Encoding, encoding, "encoding")
    if command is not None:
        if not real(timeout_s) > 0:
            raise InputError(f"timeout must be positive, not {timeout_s}")
        suffix = ".exr" if encoding is None else ".png"
        with Aside(scratch_folder(), folder=True) as aside:
            yield Command(
                template=command,
                reference=reference,
                encoding=meant,
                folder=aside.path,
                timeout_s=timeout_s,
                suffix=suffix,
            )
    elif isinstance(source, str):
        yield _files(reference, source, meant, layout)
    else:
        assert source is not None
        yield Function(function=source, reference=reference)


def _files(reference: Reference, source: str, encoding: Encoding, layout: str | None) -> Files | LaidOut:
    """Return the files of a pattern, or those of a place in a layout."""
    if layout is not None or is_place(source, reference.scene.plate):
        return laid_out(Path(source), layout, reference, encoding)
    return Files(pattern=source, reference=reference, encoding=encoding)


FiguresPair = tuple[Figures, Figures]
"""Figures of a hogel as found, and as corrected."""


@dataclass(frozen=True, kw_only=True)
class Question:
    """What hogels are judged by: how the renderer is supposed to draw, and how it draws and stores.

    `read_as_found` says whether another reading of the pixels is accepted.
    """

    asked: DrawnModel
    found: Findings
    read_as_found: bool

    @property
    def reads_all_as_found(self) -> bool:
        """Whether correction reads nothing in another way than the verdict does."""
        encoding = self.found.encoding
        return encoding.restoring is None and (self.read_as_found or encoding.reading is None)


@dataclass(kw_only=True, eq=False)
class Run:
    """One verification under way."""

    reference: Reference
    source: Source
    asked: Sequence[Aperture]
    limits: Limits
    channels: bool = False
    kept: dict[Aperture, HogelImage | Problem] = field(default_factory=dict)

    def in_any_layout(self, nominal: DrawnModel, accept: tuple[str, ...], *, progress: bool) -> Verification:
        """Return the verification, which names the layout of files if it is another than the stated one."""

        def verified(one: Source) -> Verification:
            return replace(self, source=one, kept={}).verified(nominal, accept, progress=progress)

        found = with_layout_named(verified(self.source), self.source, verified)
        # Accepted conventions are right as found already: correction has nothing to say of them.
        return found if accept else with_correction_tested(found)

    def verified(self, nominal: DrawnModel, accept: tuple[str, ...], *, progress: bool) -> Verification:
        """Diagnose a sample, judge every hogel, and return the verification."""
        sample = sampled(self.asked, self.reference.scene)
        with progress_bar(len(self.asked) + len(sample), "verify", "hogel", shown=progress) as bar:
            question = self.question(sample, nominal, accept, bar.update)
            worst, hogels = WorstHogels(scene=self.reference.scene if self.channels else None), []
            for hogel, figures in self.hogels(question, self.asked):
                if figures is not None:
                    worst.add(hogel.aperture, *figures)
                hogels.append(hogel)
                bar.update()
        return Verification(
            scene=self.reference.scene,
            source=self.source.name,
            limits=self.limits,
            diagnosis=question.found.diagnosis,
            hogels=tuple(hogels),
            worst=worst,
        )

    def question(
        self,
        sample: Sequence[Aperture],
        nominal: DrawnModel,
        accept: tuple[str, ...],
        done: Callable[[], object] = lambda: None,
    ) -> Question:
        """Diagnose a sample of hogels, and return what all are judged by; `done` is called after each."""
        for aperture in sample:
            self.kept[aperture] = self._had(aperture)
            done()
        images = [image for image in self.kept.values() if isinstance(image, HogelImage)]
        of_views = isinstance(self.source, LaidOut) and not self.source.files.layout.in_hogels
        evidence = Evidence(
            reference=self.reference, images=images, nominal=nominal, judging=self.limits.judging
        )
        found = diagnose(evidence, of_views=of_views)
        conventions = [name for name in accept if name != ENCODING]
        return Question(
            asked=declared(nominal, found.diagnosis.model, conventions),
            found=found,
            read_as_found=ENCODING in accept and found.encoding.reading is not None,
        )

    def hogels(
        self, question: Question, apertures: Iterable[Aperture]
    ) -> Iterator[tuple[Hogel, FiguresPair | None]]:
        """Judge some hogels; yield them in their order, each with its figures where it has an image."""
        most = images_under_way(math.prod(self.reference.scene.frustum.resolution))
        with ThreadPoolExecutor(worker_count(), thread_name_prefix="judging") as pool:
            yield from in_order(
                (pool.submit(self._hogel, question, one) for one in self._images(apertures)), most
            )

    def _images(self, apertures: Iterable[Aperture]) -> Iterator[tuple[Aperture, HogelImage | Problem]]:
        """Yield the image of each hogel; the renderer is asked in the caller's thread."""
        for aperture in apertures:
            kept = aperture in self.kept
            yield aperture, self.kept.pop(aperture) if kept else self._had(aperture)

    def _had(self, aperture: Aperture) -> HogelImage | Problem:
        try:
            return self.source.image(aperture)
        except Problem as problem:
            return problem

    def judged(self, question: Question, aperture: Aperture) -> tuple[Hogel, FiguresPair | None]:
        """Judge one hogel alone; see `_hogel`."""
        return self._hogel(question, (aperture, self._had(aperture)))

    def pictured(self, question: Question, aperture: Aperture, *, channels: bool) -> Pictured | None:
        """Return one hogel in pictures, with all its channels if asked; None where it is missing."""
        worst = WorstHogels(scene=self.reference.scene if channels else None)
        figures = self.judged(question, aperture)[1]
        if figures is not None:
            worst.add(aperture, *figures)
        return worst.kept[0] if worst.kept else None

    def _hogel(
        self, question: Question, one: tuple[Aperture, HogelImage | Problem]
    ) -> tuple[Hogel, FiguresPair | None]:
        """Judge one hogel; return it with its figures as found and as corrected, where it has an image."""
        aperture, image = one
        if isinstance(image, Problem):
            return Hogel(aperture=aperture, problem=str(image)), None
        encoding, found = question.found.encoding, question.found.diagnosis.model
        given = encoding.plainly(image) if question.read_as_found else image
        read, judging = encoding.read(self.reference, image), self.limits.judging
        same = question.asked == found and question.reads_all_as_found
        as_found = self._judged(question.asked, found, given, judging, explained=same)
        corrected = as_found
        if not same:
            corrected = self._judged(found, found, read, question.found.judging, explained=True)
        judged = Hogel(
            aperture=aperture,
            checks=self.limits.checks(as_found),
            as_found=as_found.numbers,
            corrected=corrected.numbers,
        )
        return judged, (as_found, corrected)

    def _judged(
        self, asked: DrawnModel, found: DrawnModel, image: HogelImage, judging: Judging, *, explained: bool
    ) -> Figures:
        points = shown_points(self.reference.scene, found, image)
        return judge(self.reference, asked, image, points, judging, explained=explained)


def sampled(apertures: Sequence[Aperture], scene: Scene) -> list[Aperture]:
    """Return the apertures to be diagnosed: spread over the plate, few enough for the memory."""
    width, height = scene.frustum.resolution
    count = int(np.clip(MAX_SAMPLE_PIXELS // (width * height), MIN_SAMPLE_HOGELS, SAMPLE_SIDE**2))
    side = max(2, int(np.sqrt(count)))
    if isinstance(apertures, ApertureBlocks):
        columns, rows = (_spread(range(count), side) for count in scene.plate.hogels)
        return [scene.plate.aperture(column, row) for row in rows for column in columns]
    columns = _spread(sorted({aperture.column for aperture in apertures}), side)
    rows = _spread(sorted({aperture.row for aperture in apertures}), side)
    chosen = [a for a in apertures if a.column in columns and a.row in rows]
    if len(chosen) < min(side, len(apertures)):
        chosen = _spread(list(apertures), count)
    return chosen


def _spread(items: Sequence[Item], count: int) -> list[Item]:
    """Return at most so many items, evenly spread."""
    return [items[index] for index in np.unique(np.linspace(0, len(items) - 1, count).astype(int))]
