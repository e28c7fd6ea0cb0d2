"""Sweep of a report: every setting drawn and judged at every aperture, in numbers and pictures."""

import math
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np

from xfrustum.compare.metrics.error_maps import PixelSet
from xfrustum.compare.metrics.radiance import STEP
from xfrustum.compare.run import Evaluator, FrameRequest, JudgedFrame, images_under_way, in_order
from xfrustum.compare.scout import AutoApertures
from xfrustum.reference import alone
from xfrustum.reference.alone import AloneNumbers, TracersAlone
from xfrustum.reference.llvm import worker_count
from xfrustum.reports import inspection
from xfrustum.reports.common import provenance
from xfrustum.reports.common.outputs import progress_bar
from xfrustum.reports.error_report import images
from xfrustum.reports.error_report.best import Measurement, Recommendation, best_setting
from xfrustum.reports.error_report.light import LightReport, measure_light
from xfrustum.reports.error_report.request import ReportOptions, geometries_of, geometry_of
from xfrustum.scenes import Aperture, DoubleFrustum, HogelImage
from xfrustum.scenes.model.effects import chosen
from xfrustum.scenes.model.scene import Scene, is_shaded

PAGE_PIXELS = 120_000_000
"""Pixels of all settings together up to which pictures are not reduced.

All pictures of a setting take between a tenth and a fifth of a byte per pixel, so that the page
stays under 30 MB."""

LEFT_OUT = ("causes", "predictions", "frames with exact depth", "traced models")
"""Parts that a report without causes omits."""


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Picture of the truth of an aperture, and the errors of each ray tracer alone.

    `alone` is None where a tracer alone made the truth; `marks` are encoded pictures of the pixels
    by the tracer's name, and as `truth` of all surfaces, empty where no pixel would be wrong.
    """

    picture: bytes
    alone: AloneNumbers | None
    marks: Mapping[str, bytes]


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Measurements of a scene over settings and apertures."""

    scene: Scene
    options: ReportOptions
    apertures: tuple[Aperture, ...]
    #: One for each aperture and setting: all settings of the first aperture first.
    rows: tuple[Measurement, ...]
    truths: tuple[Truth, ...]
    #: what decided the truths; see `reference.alone.DECISIONS`
    decided_by: str
    #: image pixels per picture pixel, along each side
    reduction: int
    versions: Mapping[str, str]
    devices: Mapping[str, str]
    #: name of the model by which rounding is explained
    device_model: str
    #: Seconds of each stage, added up over all frames: `prepare`, `trace`, `raster`, `compare`,
    #: `predict`, `causes`, `pictures` of the page, `alone` for the tracers alone, `inspection` for
    #: that page, and of a shaded scene `light`. Stages run at the same time: the sum exceeds
    #: `wall_s`.
    times_s: Mapping[str, float]
    wall_s: float
    #: Hogels of some apertures, the worst first, drawn with the best setting, with all their
    #: channels.
    inspected: tuple[inspection.InspectedHogel, ...]
    light: LightReport | None

    @cached_property
    def best(self) -> Recommendation:
        """The recommended setting."""
        return best_setting(self.rows)

    @cached_property
    def geometries(self) -> tuple[DoubleFrustum, ...]:
        """Camera geometries of all settings, each once."""
        return geometries_of(row.settings for row in self.rows)

    @property
    def auto(self) -> AutoApertures | None:
        """The scout from which the apertures were chosen; None where they were given."""
        apertures = self.options.apertures
        return apertures if isinstance(apertures, AutoApertures) else None

    def numbered(
        self, aperture: Aperture, geometry: DoubleFrustum
    ) -> list[tuple[int, Measurement]]:
        """Return the rows of an aperture and a geometry, with their numbers."""
        return [
            (number, row)
            for number, row in enumerate(self.rows)
            if row.aperture == aperture and geometry_of(row.settings) == geometry
        ]


def sweep(
    scene: Scene,
    apertures: Sequence[Aperture],
    settings: Sequence[DoubleFrustum],
    options: ReportOptions | None = None,
) -> Sweep:
    """Measure every setting at every aperture, at least one each.

    Only numbers and encoded pictures are kept, so memory does not grow with the float images.
    Raises InputError where there is no usable OpenGL or no such tracer.
    """
    options, begun = options or ReportOptions(), time.perf_counter()
    # Renderers decide themselves what `auto` is: with a tiny near, pictures show surfaces beyond
    # the reach.
    effects = None if options.effects == "auto" else chosen(scene, options.effects)
    decision = alone.Decision(by=options.decided_by, tracer=options.tracer)
    width, height = scene.frustum.resolution
    pixels = width * height * len(apertures) * len(settings)
    # Pictures shrink along both sides, so that their number of pixels shrinks by the square.
    reduction = max(1, math.ceil(math.sqrt(pixels / PAGE_PIXELS)))
    reference = alone.open_reference(scene, decision, effects)
    with Evaluator(scene, reference=reference, effects=effects, model=options.device) as judge:
        seconds = defaultdict(float, prepare=time.perf_counter() - begun)
        row_of, truths = _measure(judge, apertures, settings, options, reduction, seconds)
        rows = tuple(row_of[aperture, setting] for aperture in apertures for setting in settings)
        # The worst hogels of the best setting are drawn again, to be inspected.
        since, taken = time.perf_counter(), best_setting(rows).settings
        worst = sorted(
            (row for row in rows if row.settings == taken), key=lambda row: -row.surface_fraction
        )
        shown = [row.aperture for row in worst[: inspection.MAX_HOGELS]]
        inspected = tuple(inspection.inspected_drawings(judge, shown, taken, causes=options.causes))
        seconds["inspection"] = time.perf_counter() - since
        # The names are read before the context is freed.
        opengl = {f"OpenGL {name}": value for name, value in judge.device.items()}
    since = time.perf_counter()
    light = measure_light(
        scene, apertures, settings, effects=options.effects, progress=options.progress
    )
    if light is not None:
        seconds["light"] = time.perf_counter() - since
    return Sweep(
        scene=scene,
        options=options,
        apertures=tuple(apertures),
        rows=rows,
        truths=tuple(truths[aperture] for aperture in apertures),
        decided_by=judge.reference.decided_by,
        reduction=reduction,
        versions={**provenance.versions(), **judge.reference.versions},
        devices={**provenance.machine(), **opengl},
        device_model=judge.model.name,
        times_s=seconds,
        wall_s=time.perf_counter() - begun,
        inspected=inspected,
        light=light,
    )


def _measure(
    judge: Evaluator,
    apertures: Sequence[Aperture],
    settings: Sequence[DoubleFrustum],
    options: ReportOptions,
    reduction: int,
    seconds: dict[str, float],
) -> tuple[dict[tuple[Aperture, DoubleFrustum], Measurement], dict[Aperture, Truth]]:
    """Draw and judge every setting at every aperture; add up the seconds of each stage."""
    scene, rows, truths = judge.scene, {}, {}
    tracers = TracersAlone(scene) if judge.reference.decided_by == alone.CERTIFIED else None
    shaded = is_shaded(scene)
    # Colors of scenes without materials and lights do not test the rasterizer, and take time.
    request = FrameRequest(color=True, radiance=shaded, perceptual=shaded, causes=options.causes)
    total = len(apertures) * (1 + len(settings))
    most, latest = images_under_way(math.prod(scene.frustum.resolution)), images.LatestPictures()
    with (
        progress_bar(total, "report", "image", shown=options.progress) as bar,
        ThreadPoolExecutor(worker_count(), thread_name_prefix="pictures") as pool,
        closing(judge.frames(apertures, settings, request)) as frames,
    ):
        # Pictures are encoded in threads of their own while the evaluator judges the next frames.
        tasks = (pool.submit(_measured, scene, reduction, latest, frame) for frame in frames)
        for row, truth, pictures_s in in_order(tasks, most):
            aperture, at = row.aperture, f"aperture {row.aperture.column},{row.aperture.row}"
            rows[aperture, row.settings] = row
            stages = {**asdict(row.times_s), "pictures": pictures_s, "alone": 0.0}
            # All frames of an aperture carry the time of its truth; it counts once.
            if aperture in truths:
                # All frames of an aperture have the time of its truth.
                stages["trace"] = 0.0
            else:
                since = time.perf_counter()
                picture = images.picture(truth, reduction)
                drawn = time.perf_counter()
                stages["pictures"] += drawn - since
                errors = tracers.find(truth) if tracers else None
                marks = images.alone_pictures(truth, errors.wrong, reduction) if errors else {}
                truths[aperture] = Truth(
                    picture=picture, alone=errors.numbers if errors else None, marks=marks
                )
                stages["alone"] = time.perf_counter() - drawn
                bar.set_postfix_str(f"{at}: truth", refresh=False)
                bar.update()
            for stage, taken in stages.items():
                seconds[stage] += taken
            bar.set_postfix_str(f"{at}: near {row.settings.near:.3g}", refresh=False)
            bar.update()
    return rows, truths


def _measured(
    scene: Scene, reduction: int, latest: images.LatestPictures, frame: JudgedFrame
) -> tuple[Measurement, HogelImage, float]:
    """Return the row of a frame, its truth, and the seconds of encoding its pictures."""
    begun, reach = time.perf_counter(), scene.frustum.longest_reach
    comparison, budget, charge, wrong = frame.comparison, frame.budget, None, {}
    if budget is not None:
        # The place in `CAUSE_COLORS` of each wrong surface's link, (H, W), or the place after all.
        places = np.array(
            [list(images.CAUSE_COLORS).index(name) for name in budget.links], dtype=np.int8
        )
        is_wrong, charge = budget.surface_charge >= 0, budget.surface_charge.copy()
        # Links of a chain with culling are not numbered as the palette is: places translate.
        charge[is_wrong] = places[charge[is_wrong]]
        charge[budget.explanation.unexplained & is_wrong] = len(images.CAUSE_COLORS)
    scale = reach, images.height_range(scene, reach)
    if comparison.errors.surface is not None:
        wrong["surface"] = PixelSet.from_mask(comparison.errors.surface)
    # Colors of pixels that are not judged are NaN, and count as right.
    if comparison.colors is not None:
        with np.errstate(invalid="ignore"):
            wrong["radiance"] = PixelSet.from_mask(
                np.abs(comparison.colors.error).max(axis=-1) > STEP
            )
    row = Measurement(
        aperture=frame.aperture,
        settings=frame.settings,
        comparison=comparison.numbers,
        causes=() if budget is None else budget.causes,
        unexplained=None if budget is None else budget.explanation.counts()["unexplained"],
        shear=None if budget is None else budget.start.shear,
        predicted=frame.prediction,
        times_s=frame.times,
        gpu_s=frame.gpu_s,
        wrong=wrong,
        pictures=latest.encode(comparison, charge, scale, reduction),
    )
    return row, frame.truth, time.perf_counter() - begun
