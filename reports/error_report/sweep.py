"""The main job: trace the truth once per aperture, rasterize every setting, compare each."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.attribution.budget import Budget
from xfrustum.compare.metrics.comparison import Comparison
from xfrustum.compare.metrics.paired import PixelSet
from xfrustum.compare.metrics.radiance import STEP
from xfrustum.compare.run import Judge, JudgedFrame, Wanted
from xfrustum.compare.scout import AutoApertures
from xfrustum.reference.alone import TracersAlone
from xfrustum.reference.plain import CERTIFIED, CERTIFIED_DECISION, Decision, open_reference
from xfrustum.reports.common import provenance
from xfrustum.reports.common.geometry import CameraGeometry, geometries_of
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.raster_command import plan_command
from xfrustum.reports.error_report import images
from xfrustum.reports.error_report.best import Recommendation, best_setting
from xfrustum.reports.error_report.causes import CAUSE_COLORS
from xfrustum.reports.error_report.measurement import (
    Measurement,
    RasterParts,
    SettingPictures,
    StageParts,
    TracersAlonePictured,
)
from xfrustum.reports.inspection.channels import MAX_HOGELS, InspectedHogel, inspected_drawings
from xfrustum.scenes.model.effects import chosen
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene, is_shaded
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture

DepthBuffer = tuple[DepthFormat, DepthMapping]

DEFAULT_DEPTHS: tuple[DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.REVERSED),
    (DepthFormat.D32F, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.REVERSED),
)
"""Depth buffers of a report, the cheapest first: where windows are equally good, the first is recommended."""

DEFAULT_NEAR_COUNT = 25
_LARGEST_NEAR_PER_REACH, _SMALLEST_NEAR_PER_REACH = 1e-1, 1e-8

PAGE_PIXELS = 120_000_000
"""Pixels of all settings together up to which pictures are shown in full; those of larger sweeps are reduced.
All pictures of a setting take between a tenth and a fifth of a byte per pixel, so that the page stays under
30 MB."""


LEFT_OUT = ("causes", "predictions", "frames with exact depth", "traced models")
"""Parts that a report without causes leaves out: the causes of wrong pixels, predictions by closed forms, and
what causes alone need, which are frames with exact depth and the traced images of the cameras' models."""


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Everything measured on a scene.

    Attributes
    ----------
    rows, pictures
        One of each per aperture and setting, in the same order: all settings of the first
        aperture first.
    alone
        What each ray tracer alone would have got wrong, per aperture; empty where a tracer alone made the
        truths.
    decided_by
        What decided the truths; see `reference.plain.DECISIONS`.
    reduction
        Image pixels per picture pixel, along each side.
    times_s
        Seconds of each stage, added up over all frames: `prepare`, `trace`, `raster`, `compare`, `predict`,
        `causes`, `pictures` of the page, `alone` for the tracers alone, `inspection` for that page, and
        `light` for the light of a shaded scene. Stages run at the same time: the sum exceeds `wall_s`.
    wall_s
        Wall seconds of everything.
    charged
        Whether wrong pixels were charged to causes, and errors predicted.
    auto
        The scout from which the apertures were chosen; None where they were given.
    inspected
        Hogels of some apertures, the worst first, drawn with the best setting, with all their channels.
    """

    scene: Scene
    apertures: tuple[Aperture, ...]
    rows: tuple[Measurement, ...]
    pictures: tuple[SettingPictures, ...]
    truths: tuple[bytes, ...]
    alone: tuple[TracersAlonePictured, ...]
    decided_by: str
    reduction: int
    versions: Mapping[str, str]
    devices: Mapping[str, str]
    times_s: Mapping[str, float]
    wall_s: float
    charged: bool = True
    auto: AutoApertures | None = None
    inspected: tuple[InspectedHogel, ...] = ()

    @cached_property
    def best(self) -> Recommendation:
        """The recommended setting."""
        return best_setting(self.rows)

    def with_stage(self, name: str, seconds: float) -> Sweep:
        """Return the sweep with one more stage, which was done after all others."""
        return replace(self, times_s={**self.times_s, name: seconds}, wall_s=self.wall_s + seconds)

    @cached_property
    def geometries(self) -> tuple[CameraGeometry, ...]:
        """Camera geometries of all settings, each once."""
        return geometries_of(row.settings for row in self.rows)

    def numbered(self, aperture: Aperture, geometry: CameraGeometry) -> list[tuple[int, Measurement]]:
        """Return the rows of an aperture and a geometry, with their numbers."""
        return [
            (number, row)
            for number, row in enumerate(self.rows)
            if row.aperture == aperture and CameraGeometry.of(row.settings) == geometry
        ]

    @property
    def coverage_sentence(self) -> str:
        """What the hogels leave out of the plate, and the command that asks; empty where they are all."""
        columns, rows = self.scene.plate.hogels
        measured = len(self.apertures)
        if measured >= columns * rows:
            return ""
        return (
            f"Measured at {measured:,} of {columns * rows:,} hogels, and others may need other settings: "
            f"{plan_command(self.scene)} says what holds for the whole plate."
        )

    @property
    def left_out_sentence(self) -> str:
        """What the sweep was asked to leave out, in words; empty where that is nothing."""
        if self.charged:
            return ""
        return (
            f"Left out, as asked for: {', '.join(LEFT_OUT[:-1])} and {LEFT_OUT[-1]}. Wrong pixels are "
            "counted and shown, and not explained."
        )

    @property
    def cost_sentence(self) -> str:
        """What measuring took, in words."""
        count = len(self.truths)
        frames = "a raster frame" if len(self.rows) == 1 else f"{len(self.rows)} raster frames"
        if self.decided_by == CERTIFIED:
            truths = "the certified truth" if count == 1 else f"{count} certified truths"
        else:
            truths = f"{'the picture' if count == 1 else f'{count} pictures'} by {self.decided_by} alone"
        return (
            f"Measured in {self.wall_s:.2f} s of wall time, in which stages ran side by side: {frames} with "
            f"read-back {self.times_s['raster']:.2f} s, {truths} {self.times_s['trace']:.2f} s, the page's "
            f"pictures {self.times_s['pictures']:.2f} s."
        )


def default_nears(frustum: Frustum) -> tuple[float, ...]:
    """Return 25 offsets in scene units, logarithmic, from 1e-1 down to 1e-8 of the longest reach."""
    fractions = np.geomspace(_LARGEST_NEAR_PER_REACH, _SMALLEST_NEAR_PER_REACH, DEFAULT_NEAR_COUNT)
    return tuple(float(fraction) * frustum.longest_reach for fraction in fractions)


def settings_grid(
    nears: Iterable[float],
    depths: Iterable[DepthBuffer],
    geometries: Iterable[CameraGeometry] = (CameraGeometry(),),
) -> tuple[DoubleFrustum, ...]:
    """Return every near with every depth buffer and camera geometry: all nears of the first buffer first.

    The buffers of the first geometry come before those of the second.
    """
    nears, depths = tuple(nears), tuple(depths)
    return tuple(
        geometry.with_depth(near, depth, mapping)
        for geometry in geometries
        for depth, mapping in depths
        for near in nears
    )


@dataclass(frozen=True, kw_only=True)
class How:
    """How a sweep is made.

    Attributes
    ----------
    causes
        Whether wrong pixels are charged to causes, and errors predicted.
    progress
        Whether there is a progress bar on standard error.
    """

    decision: Decision = CERTIFIED_DECISION
    effects: str = "auto"
    causes: bool = True
    progress: bool = False


def sweep(
    scene: Scene, apertures: Sequence[Aperture], settings: Sequence[DoubleFrustum], how: How | None = None
) -> Sweep:
    """Measure every setting at every aperture.

    Only numbers and encoded pictures are kept, so memory does not grow with the float images.

    Parameters
    ----------
    apertures, settings
        At least one aperture and one setting.
    how
        How the sweep is made; as `How()` says where None.

    Raises
    ------
    InputError
        No usable OpenGL context, or an unknown tracer.
    """
    how, begun = how or How(), time.perf_counter()
    # Renderers decide themselves what `auto` is: with a tiny near, pictures show surfaces beyond the reach.
    effects = None if how.effects == "auto" else chosen(scene, how.effects)
    with Judge(scene, reference=open_reference(scene, how.decision, effects), effects=effects) as judge:
        reduction = _reduction(scene.frustum, len(apertures) * len(settings))
        measured = _Measured(seconds={"prepare": time.perf_counter() - begun})
        with progress_bar(len(apertures) * (1 + len(settings)), "report", "image", shown=how.progress) as bar:
            for done in _measure(judge, apertures, settings, reduction, how, measured):
                bar.set_postfix_str(done, refresh=False)
                bar.update()
        rows = [measured.rows[aperture, setting] for aperture in apertures for setting in settings]
        since = time.perf_counter()
        inspected = _inspected(judge, [row for row, _ in rows], causes=how.causes)
        measured.seconds["inspection"] = time.perf_counter() - since
        opengl = {f"OpenGL {name}": value for name, value in judge.device.items()}
    return Sweep(
        scene=scene,
        apertures=tuple(apertures),
        rows=tuple(row for row, _ in rows),
        pictures=tuple(pictures for _, pictures in rows),
        truths=tuple(measured.truths),
        alone=tuple(measured.alone),
        decided_by=judge.reference.decided_by,
        reduction=reduction,
        versions={**provenance.versions(), **judge.reference.versions},
        devices={**provenance.machine(), **opengl},
        times_s=measured.seconds,
        wall_s=time.perf_counter() - begun,
        charged=how.causes,
        inspected=inspected,
    )


@dataclass(frozen=True, kw_only=True)
class _Measured:
    """What a sweep keeps: rows with their pictures, pictures of truths, the tracers alone, and seconds."""

    seconds: dict[str, float]
    rows: dict[tuple[Aperture, DoubleFrustum], tuple[Measurement, SettingPictures]] = field(
        default_factory=dict
    )
    truths: list[bytes] = field(default_factory=list)
    alone: list[TracersAlonePictured] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class _Finished:
    """What is kept of a judged frame: its row, its pictures with their seconds, and for a while its truth."""

    row: Measurement
    pictures: SettingPictures
    pictures_s: float
    truth: HogelImage


def _measure(
    judge: Judge,
    apertures: Sequence[Aperture],
    settings: Sequence[DoubleFrustum],
    reduction: int,
    how: How,
    measured: _Measured,
) -> Iterable[str]:
    """Draw and judge every setting at every aperture, and yield what is done, in words, after each image."""
    shaded = is_shaded(judge.scene)
    # Where a scene says nothing of light, colors say nothing of the rasterizer, and take time.
    wanted = Wanted(color=True, radiance=shaded, perceptual=shaded, causes=how.causes)
    finish = partial(_finish, judge.scene, reduction)
    tracers = TracersAlone(judge.scene) if judge.reference.decided_by == CERTIFIED else None
    seconds, left = measured.seconds, 0
    with closing(judge.frames(apertures, settings, wanted, finish)) as frames:
        for one in frames:
            row, at = one.row, f"aperture {one.row.aperture.column},{one.row.aperture.row}"
            measured.rows[row.aperture, row.settings] = row, one.pictures
            stages = {**asdict(row.times_s), "pictures": one.pictures_s}
            if left == 0:
                left = len(set(settings))
                begun = time.perf_counter()
                measured.truths.append(images.picture(one.truth, reduction))
                drawn = time.perf_counter()
                if tracers is not None:
                    measured.alone.append(_alone(tracers, one.truth, reduction))
                stages["pictures"] += drawn - begun
                stages["alone"] = time.perf_counter() - drawn
                yield f"{at}: truth"
            else:
                stages["trace"] = 0.0
            left -= 1
            for stage, taken in stages.items():
                seconds[stage] = seconds.get(stage, 0.0) + taken
            yield f"{at}: near {row.settings.near:.3g}"


def _alone(tracers: TracersAlone, truth: HogelImage, reduction: int) -> TracersAlonePictured:
    found = tracers.find(truth)
    return TracersAlonePictured(
        numbers=found.numbers, pictures=images.alone_pictures(truth, found.wrong, reduction)
    )


def _finish(scene: Scene, reduction: int, frame: JudgedFrame) -> _Finished:
    """Return the row of a frame and its pictures, encoded in the thread that has judged it."""
    begun, reach, budget = time.perf_counter(), scene.frustum.longest_reach, frame.budget
    pictures = images.setting_pictures(
        frame.comparison,
        None if budget is None else _charges(budget),
        (reach, images.height_range(scene, reach)),
        reduction,
    )
    row = Measurement(
        aperture=frame.aperture,
        settings=frame.settings,
        comparison=frame.comparison.numbers,
        causes=() if budget is None else budget.causes,
        unexplained=None if budget is None else budget.explanation.counts()["unexplained"],
        shear=None if budget is None else budget.start.shear,
        predicted=frame.prediction,
        times_s=frame.times,
        parts_s=StageParts(raster=RasterParts(gpu=frame.gpu_s)),
        wrong=_wrong_pixels(frame.comparison),
    )
    return _Finished(row=row, pictures=pictures, pictures_s=time.perf_counter() - begun, truth=frame.truth)


def _charges(budget: Budget) -> NDArray[np.int8]:
    """Return the place in `CAUSE_COLORS` of each wrong surface's link, (H, W), or the place after all."""
    places = np.array([list(CAUSE_COLORS).index(name) for name in budget.links], dtype=np.int8)
    wrong = budget.surface_charge >= 0
    charge = budget.surface_charge.copy()
    charge[wrong] = places[charge[wrong]]
    charge[budget.explanation.unexplained & wrong] = len(CAUSE_COLORS)
    return charge


def _wrong_pixels(comparison: Comparison) -> dict[str, PixelSet]:
    found = {}
    if comparison.errors.surface is not None:
        found["surface"] = PixelSet.of(comparison.errors.surface)
    if comparison.colors is not None:
        with np.errstate(invalid="ignore"):
            found["radiance"] = PixelSet.of(np.abs(comparison.colors.error).max(axis=-1) > STEP)
    return found


def _inspected(judge: Judge, rows: Sequence[Measurement], *, causes: bool) -> tuple[InspectedHogel, ...]:
    """Return the hogels where the best setting is worst, drawn anew with it."""
    best = best_setting(rows).settings
    drawn = sorted((row for row in rows if row.settings == best), key=lambda row: -row.surface_fraction)
    apertures = [row.aperture for row in drawn[:MAX_HOGELS]]
    return tuple(inspected_drawings(judge, apertures, best, causes=causes))


def _reduction(frustum: Frustum, count: int) -> int:
    width, height = frustum.resolution
    return max(1, math.ceil(math.sqrt(width * height * count / PAGE_PIXELS)))
