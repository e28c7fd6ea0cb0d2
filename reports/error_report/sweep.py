"""Sweep of a report: every setting drawn and judged at every aperture, in numbers and pictures."""

import itertools
import math
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial

import numpy as np

from xfrustum.compare.comparison import STEP, LeftOutNumbers, measure_left_out
from xfrustum.compare.error_maps import PixelSet
from xfrustum.compare.prediction.displacement import measured_eye_error, predicted_eye_error
from xfrustum.compare.run import Evaluator, FrameRequest, JudgedFrame, images_under_way, in_order
from xfrustum.compare.scout import AutoApertures
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference, alone
from xfrustum.reference.alone import AloneNumbers, TracersAlone
from xfrustum.reference.llvm import worker_count
from xfrustum.reference.shading import Shader
from xfrustum.reports import inspection
from xfrustum.reports.common import outputs, pictures
from xfrustum.reports.common.outputs import progress_bar
from xfrustum.reports.error_report.best import (
    Measurement,
    Recommendation,
    best_setting,
    geometries_of,
    geometry_of,
)
from xfrustum.reports.scene_check.effects import EffectRow, effect_rows
from xfrustum.scenes import (
    Aperture,
    Cull,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Fit,
    HogelImage,
    Offset,
    Pivot,
)
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.effects import Effect, Question, chosen, needed
from xfrustum.scenes.model.scene import Scene, is_shaded
from xfrustum.scenes.plate import Frustum

DepthBuffer = tuple[DepthFormat, DepthMapping]

DEFAULT_DEPTHS: tuple[DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.REVERSED),
    (DepthFormat.D32F, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.REVERSED),
)
"""Depth buffers of a report, the cheapest first: the first of equally good ones is recommended."""

DEFAULT_NEARS_PER_REACH = np.geomspace(1e-1, 1e-8, 25)

PAGE_PIXELS = 120_000_000
"""Largest number of pixels of all settings together at which pictures are not reduced.

All pictures of a setting take between a tenth and a fifth of a byte per pixel, so that the page
stays under 30 MB."""

LEFT_OUT = ("causes", "predictions", "frames with exact depth", "traced models")
"""Parts that a report without causes omits."""

# Request
# --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """Settings, apertures and measurements of a report; None selects the default.

    Every combination of the nears, depth buffers and camera geometries is measured.
    """

    #: offsets, scene units, each between 0 and the reach; None for `default_nears`
    nears: Sequence[float] | None = None
    #: None for the middle one and, if the frustum is recentered, two corners. For `AutoApertures`
    #: the page has a map of the plate.
    apertures: Sequence[Aperture] | AutoApertures | None = None
    depths: Sequence[DepthBuffer] | None = None
    #: None for both pivots in a recentered frustum, else for the aperture
    pivots: Sequence[Pivot] | None = None
    fits: Sequence[Fit | float] | None = None
    offsets: Sequence[Offset] | None = None
    slabs: Sequence[tuple[float, ...]] | None = None
    cull: Cull = Cull.NONE
    tracer: str = "embree"
    #: simulated effects, as `--effects` takes them: `auto`, `all`, or names between commas
    effects: str = "auto"
    #: source of the truths: `certified`, or the name of a tracer whose hits are not certified
    decided_by: str = alone.CERTIFIED
    #: whether to predict errors and to charge wrong pixels to causes
    causes: bool = True
    #: model that explains rounding; None selects the recorded model of the current device
    device: DeviceModel | None = None
    #: whether to show a progress bar on standard error
    progress: bool = False


def default_nears(frustum: Frustum) -> tuple[float, ...]:
    """Return 25 offsets in scene units, logarithmic, from 1e-1 to 1e-8 of the longest reach."""
    return tuple(float(share) * frustum.longest_reach for share in DEFAULT_NEARS_PER_REACH)


def settings_of(frustum: Frustum, options: ReportOptions) -> tuple[DoubleFrustum, ...]:
    """Return all settings of a report, by geometry, then by depth buffer, then by near.

    InputError if settings make no sense for the frustum.
    """
    usual = options.nears is None
    nears = dict.fromkeys(default_nears(frustum) if options.nears is None else options.nears)
    buffers = dict.fromkeys(DEFAULT_DEPTHS if options.depths is None else options.depths)
    grid = []
    for geometry, (depth, mapping), near in itertools.product(
        geometry_grid(frustum, options), buffers, nears
    ):
        # Cameras without an offset need a near plane closer than the first cut; other default
        # nears are left out.
        first = min((*geometry.slabs, *frustum.reach))
        if usual and geometry.offset is Offset.NONE and near >= first:
            continue
        setting = replace(geometry, near=near, depth=depth, mapping=mapping, cull=options.cull)
        setting.check_against(frustum)
        grid.append(setting)
    return tuple(grid)


def geometry_grid(frustum: Frustum, options: ReportOptions) -> tuple[DoubleFrustum, ...]:
    """Return every combination of pivot, fit, offset and cuts; the cuts change fastest."""
    # A centered frustum has no shear, so that both pivots draw the same picture.
    both = frustum.recentered and options.pivots is None
    pivots = tuple(Pivot) if both else (Pivot.APERTURE,)
    product = itertools.product(
        pivots if options.pivots is None else options.pivots,
        (None,) if options.fits is None else options.fits,
        (Offset.PLATE,) if options.offsets is None else options.offsets,
        ((),) if options.slabs is None else options.slabs,
    )
    return geometries_of(
        DoubleFrustum(near=1.0, pivot=pivot, fit=fit, offset=offset, slabs=tuple(cuts))
        for pivot, fit, offset, cuts in product
        # Without an offset the camera's center is the aperture: both pivots draw the same picture.
        if not (both and pivot is Pivot.CAMERA and offset is Offset.NONE)
    )


# Measurement
# --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Picture of an aperture's truth, and the errors of each uncertified ray tracer."""

    picture: bytes
    #: errors of the tracers; None if an uncertified tracer made the truth
    alone: AloneNumbers | None


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Measurements of a scene over settings and apertures."""

    scene: Scene
    options: ReportOptions
    apertures: tuple[Aperture, ...]
    #: a row for each aperture and setting, aperture by aperture
    rows: tuple[Measurement, ...]
    truths: tuple[Truth, ...]
    #: source of the truths; see `reference.alone.DECISIONS`
    decided_by: str
    #: image pixels per picture pixel, along each side
    reduction: int
    versions: Mapping[str, str]
    devices: Mapping[str, str]
    #: name of the model by which rounding is explained
    device_model: str
    #: Seconds of each stage, added up over all frames: `prepare`, `trace`, `raster`, `compare`,
    #: `predict`, `causes`, `pictures` of the page, `alone` for the uncertified tracers,
    #: `inspection` for the inspection page, and for a shaded scene `light`. Stages run at the same
    #: time: the sum exceeds `wall_s`.
    times_s: Mapping[str, float]
    wall_s: float
    #: some apertures, the worst first, drawn with the best setting and all channels
    inspected: tuple[inspection.InspectedHogel, ...]
    light: "LightReport | None"

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
        """Scan of the plate that chose the apertures; None if the apertures were given."""
        apertures = self.options.apertures
        return apertures if isinstance(apertures, AutoApertures) else None

    def numbered(
        self, aperture: Aperture, geometry: DoubleFrustum
    ) -> list[tuple[int, Measurement]]:
        """Return the rows of an aperture and a geometry, each with its number in the sweep."""
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
    """Measure every setting at every aperture; there must be at least one of each.

    Only numbers and encoded pictures are kept, so memory does not grow with the float images.
    Raises InputError if there is no usable OpenGL or no such tracer.
    """
    options, begun = options or ReportOptions(), time.perf_counter()
    # Each renderer resolves `auto` itself: with a tiny near, pictures show surfaces beyond the
    # reach, which may need more effects.
    effects = None if options.effects == "auto" else chosen(scene, options.effects)
    decision = alone.Decision(by=options.decided_by, tracer=options.tracer)
    pixels = math.prod(scene.frustum.resolution) * len(apertures) * len(settings)
    # Reduction along both sides reduces the number of pixels by the square.
    reduction = max(1, math.ceil(math.sqrt(pixels / PAGE_PIXELS)))
    reference = alone.open_reference(scene, decision, effects)
    with Evaluator(scene, reference=reference, effects=effects, model=options.device) as judge:
        prepare_s = time.perf_counter() - begun
        row_of, truths, seconds = _measure(judge, apertures, settings, options, reduction)
        rows = tuple(row_of[place] for place in itertools.product(apertures, settings))
        # The worst hogels of the best setting are drawn again, to be inspected.
        since, best = time.perf_counter(), best_setting(rows).settings
        worst = sorted(apertures, key=lambda aperture: -row_of[aperture, best].surface_fraction)
        shown = worst[: inspection.MAX_HOGELS]
        inspected = tuple(inspection.inspected_drawings(judge, shown, best, causes=options.causes))
        inspection_s = time.perf_counter() - since
        # Read the names before the context is freed.
        opengl = {f"OpenGL {name}": value for name, value in judge.device.items()}
    since = time.perf_counter()
    light = measure_light(scene, apertures, settings, options) if is_shaded(scene) else None
    lit_s = {} if light is None else {"light": time.perf_counter() - since}
    return Sweep(
        scene=scene,
        options=options,
        apertures=tuple(apertures),
        rows=rows,
        truths=tuple(truths[aperture] for aperture in apertures),
        decided_by=judge.reference.decided_by,
        reduction=reduction,
        versions={**outputs.versions(), **judge.reference.versions},
        devices={**outputs.machine(), **opengl},
        device_model=judge.model.name,
        times_s={"prepare": prepare_s, **seconds, "inspection": inspection_s, **lit_s},
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
) -> tuple[
    dict[tuple[Aperture, DoubleFrustum], Measurement], dict[Aperture, Truth], dict[str, float]
]:
    """Draw and judge every setting at every aperture; add up the seconds of each stage."""
    scene, shaded, seconds = judge.scene, is_shaded(judge.scene), defaultdict[str, float](float)
    rows, truths = {}, {}
    certified = judge.reference.decided_by == alone.CERTIFIED
    tracers = TracersAlone(scene) if certified else None
    # Colors of scenes without materials and lights do not test the rasterizer, and take time.
    request = FrameRequest(color=True, radiance=shaded, perceptual=shaded, causes=options.causes)
    row_of = partial(_row, scene, reduction, pictures.LatestPictures())
    most = images_under_way(math.prod(scene.frustum.resolution))
    with (
        progress_bar(
            len(apertures) * len(settings), "report", "image", shown=options.progress
        ) as bar,
        ThreadPoolExecutor(worker_count(), thread_name_prefix="pictures") as pool,
        closing(judge.frames(apertures, settings, request)) as frames,
    ):
        # Pictures are encoded in threads of their own while the evaluator judges the next frames.
        tasks = (pool.submit(row_of, frame) for frame in frames)
        for row, truth, pictures_s in in_order(tasks, most):
            aperture = row.aperture
            rows[aperture, row.settings] = row
            stages = {**asdict(row.times_s), "pictures": pictures_s}
            if aperture in truths:
                # Each frame of an aperture has the time of the aperture's truth; count it once.
                stages["trace"] = 0.0
            else:
                begun = time.perf_counter()
                errors = tracers.find(truth).numbers if tracers else None
                seconds["alone"] += time.perf_counter() - begun
                truths[aperture] = Truth(picture=pictures.picture(truth, reduction), alone=errors)
            for stage, taken in stages.items():
                seconds[stage] += taken
            bar.set_postfix_str(f"aperture {aperture.column},{aperture.row}", refresh=False)
            bar.update()
    return rows, truths, seconds


def _row(
    scene: Scene, reduction: int, latest: pictures.LatestPictures, frame: JudgedFrame
) -> tuple[Measurement, HogelImage, float]:
    """Return the row of a frame, its truth, and the seconds of encoding its pictures."""
    begun, reach = time.perf_counter(), scene.frustum.longest_reach
    comparison, budget, charge = frame.comparison, frame.budget, None
    assert comparison.errors.surface is not None, "a sweep has the scene at hand"
    wrong = {"surface": PixelSet.from_mask(comparison.errors.surface)}
    if comparison.colors is not None:
        # Colors of pixels that are not judged are NaN, and count as right.
        with np.errstate(invalid="ignore"):
            off = np.abs(comparison.colors.error).max(axis=-1) > STEP
        wrong["radiance"] = PixelSet.from_mask(off)
    if budget is not None:
        # Chains with culling number their links differently from the palette: convert the numbers.
        palette = list(pictures.CAUSE_COLORS)
        places = np.array([palette.index(name) for name in budget.links], dtype=np.int8)
        charge = np.where(budget.surface_charge >= 0, places[budget.surface_charge], -1)
        charge[budget.explanation.unexplained & (charge >= 0)] = len(palette)
    scale = reach, pictures.height_range(scene, reach)
    row = Measurement(
        aperture=frame.aperture,
        settings=frame.settings,
        comparison=comparison.numbers,
        causes=budget.causes if budget else (),
        unexplained=budget.explanation.counts()["unexplained"] if budget else None,
        predicted=frame.prediction,
        times_s=frame.times,
        gpu_s=frame.gpu_s,
        wrong=wrong,
        pictures=latest.encode(comparison, charge, scale, reduction),
    )
    return row, frame.truth, time.perf_counter() - begun


# Light
# --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class EyeError:
    """Radiance error caused by the bent eye vector at one near: rms over points and channels."""

    near: float
    #: by closed form, at the truth's surface points
    predicted: float
    #: at the points that the device drew, with its float32 arithmetic
    measured: float


@dataclass(frozen=True, kw_only=True, eq=False)
class MissedLight:
    """The light that a rasterizer misses in one aperture's image."""

    aperture: Aperture
    numbers: LeftOutNumbers
    #: encoded truth with shadows and interreflection
    picture: bytes
    #: encoded difference from the truth without light transport
    difference: bytes


@dataclass(frozen=True, kw_only=True, eq=False)
class LightReport:
    """Light of a report, in addition to its rows."""

    #: every effect: whether the scene needs it, and why
    decisions: tuple[EffectRow, ...]
    #: whether images with all effects and with only the needed effects are equal bit by bit
    same_bits: bool
    #: error by near; empty if no highlight and no reflection is drawn
    eye: tuple[EyeError, ...]
    #: missed light by aperture; empty without light transport
    missed: tuple[MissedLight, ...]


def measure_light(
    scene: Scene,
    apertures: Sequence[Aperture],
    settings: Sequence[DoubleFrustum],
    options: ReportOptions,
) -> LightReport:
    """Measure the light of a report, for a scene with materials or lights.

    Missed light is measured at all apertures of the report, everything else at the first aperture.
    """
    first, drawn, question = apertures[0], [], Question(settings=(settings[0],))
    for names in ("auto", "all"):
        with Rasterizer(scene, effects=chosen(scene, names, question=question)) as rasterizer:
            image = rasterizer.render(first, settings[0], normals=False)
            arrays = (image.color, image.triangle, image.position)
            drawn.append([array.tobytes() for array in arrays if array is not None])
    shows_eye = bool(needed(scene) & {Effect.SPECULAR, Effect.REFLECTION})
    nears = sorted({setting.near for setting in settings}, reverse=True) if shows_eye else []
    lit = apertures if scene.transport.simulated else ()
    steps = len(nears) + 2 * len(lit) * scene.sampling.aperture
    with progress_bar(steps, "light", "measurement", shown=options.progress) as bar:
        return LightReport(
            decisions=tuple(effect_rows(scene)),
            same_bits=drawn[0] == drawn[1],
            eye=_eye_errors(scene, first, nears, bar.update),
            missed=tuple(_missed_light(scene, aperture, bar.update) for aperture in lit),
        )


def _eye_errors(
    scene: Scene, aperture: Aperture, nears: Sequence[float], done: Callable[[], object]
) -> tuple[EyeError, ...]:
    """Return the error caused by the bent eye vector at some nears, with D32F reversed depth."""
    if not nears:
        return ()
    errors: list[EyeError] = []
    # Use single samples: averages would mix the eye vectors of several points.
    once, shader = replace(scene, sampling=Sampling()), Shader(scene)
    surfaces = Reference(once).trace(aperture)
    with Rasterizer(once) as rasterizer:
        for near in nears:
            exact = DoubleFrustum(near=near, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED)
            shown = rasterizer.render(aperture, exact, normals=False)
            predicted, measured = (
                float(np.sqrt(np.mean(error**2))) if error.size else 0.0
                for error in (
                    predicted_eye_error(scene, surfaces, near),
                    measured_eye_error(shader, shown),
                )
            )
            errors.append(EyeError(near=near, predicted=predicted, measured=measured))
            done()
    return tuple(errors)


def _missed_light(scene: Scene, aperture: Aperture, done: Callable[[], object]) -> MissedLight:
    """Return the light that an image without light transport misses."""
    left_out = measure_left_out(scene, aperture, done)
    truth = Reference(scene).trace(aperture, Sampling())
    # The truth with transport is the sum of the measured parts: nothing is traced twice.
    full = (left_out.without + left_out.difference.mean).astype(np.float32)
    return MissedLight(
        aperture=aperture,
        numbers=left_out.numbers,
        picture=pictures.picture(replace(truth, color=full)),
        difference=pictures.radiance_map(left_out.difference.mean),
    )
