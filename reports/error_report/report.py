"""`xfrustum report`: rasterizes and judges every setting at every aperture, and writes what it found.

Its index.html, report.json, measurements.parquet and inspect.html appear together or not at all.
Beside its rows a report says of light: which effects are drawn, what the bent eye vector costs, and
what a rasterizer misses.
"""

import math
import re
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from xfrustum.compare.extent import require_seen
from xfrustum.compare.metrics.error_maps import CONFIDENCE, PixelSet
from xfrustum.compare.metrics.radiance import STEP, LeftOutNumbers, measure_left_out
from xfrustum.compare.prediction.eye_vector import measured_eye_error, predicted_eye_error
from xfrustum.compare.run import (
    Evaluator,
    FrameRequest,
    JudgedFrame,
    images_under_way,
    in_order,
)
from xfrustum.compare.scout import AutoApertures
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference, alone
from xfrustum.reference.alone import AloneNumbers, TracersAlone
from xfrustum.reference.llvm import worker_count
from xfrustum.reference.shading.shading import Shader
from xfrustum.reports import inspection
from xfrustum.reports.common import provenance
from xfrustum.reports.common.outputs import Staging, json_object, progress_bar
from xfrustum.reports.common.records import table_of
from xfrustum.reports.common.templates_environment import address
from xfrustum.reports.error_report import best, images
from xfrustum.reports.error_report.best import Measurement, Recommendation, ReportOptions, TableRow
from xfrustum.reports.error_report.page import render_page
from xfrustum.reports.inspection import Inspection, PlateMap
from xfrustum.reports.scout import scout_record
from xfrustum.scenes import (
    Aperture,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    HogelImage,
    InputError,
)
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.model.effects import Decision, Effect, Question, chosen, decide, needed
from xfrustum.scenes.model.scene import Scene, is_shaded
from xfrustum.scenes.representation import counted, digits, percent


@dataclass(frozen=True, kw_only=True)
class EyeError:
    """What the bent eye vector costs at one near plane: root mean squares over points and channels.

    `predicted` by closed form, at the truth's surface points; `measured` at the points that the
    device drew, with its float32 arithmetic.
    """

    near: float
    predicted: float
    measured: float


@dataclass(frozen=True, kw_only=True, eq=False)
class MissedLight:
    """The light that a rasterizer misses in one aperture's image."""

    aperture: Aperture
    numbers: LeftOutNumbers
    #: Addresses of the truth with shadows and interreflection, and of its difference from the truth
    #: without
    picture: str
    difference: str


@dataclass(frozen=True, kw_only=True, eq=False)
class LightReport:
    """What a report says about light beside its rows."""

    scene: Scene
    names: str  #: of the effects, as `--effects` takes them
    #: For every effect: whether the scene calls for it, and why.
    decisions: tuple[Decision, ...]
    #: Whether the rasterizer's images with all effects and with those called for are the same, bit
    #: by bit.
    same_bits: bool
    #: Error by near; empty where no highlight and no reflection is drawn.
    eye: tuple[EyeError, ...]
    #: Missed light by aperture; empty where no light transport is asked for.
    missed: tuple[MissedLight, ...]

    @property
    def record(self) -> dict[str, Any]:
        """The numbers as report.json has them."""
        return {
            "effects": self.names,
            "decisions": self.decisions,
            "same_bits": self.same_bits,
            "sampling": self.scene.sampling,
            "eye_vector": self.eye,
            "left_out": [
                {"aperture": part.aperture.index, **json_object(part.numbers)}
                for part in self.missed
            ],
        }

    def sentences(self) -> Iterator[str]:
        """Say in words how much light is missed."""
        pixels = self.scene.frustum.resolution[0] * self.scene.frustum.resolution[1]
        for part in self.missed:
            numbers = part.numbers
            yield (
                f"Aperture {part.aperture.column},{part.aperture.row}: light transport changes "
                f"{numbers.pixels:,} pixels ({percent(numbers.pixels / pixels)}), "
                f"{numbers.darker:,} of them to darker; rms {digits(numbers.rms)} in radiance, "
                f"after noise of {digits(numbers.rms_noise)} is taken off."
            )


def measure_light(
    scene: Scene,
    apertures: Sequence[Aperture],
    settings: Sequence[DoubleFrustum],
    *,
    effects: str = "auto",
    progress: bool = False,
) -> LightReport | None:
    """Measure what a report says about light beside its rows; None where a scene says nothing of light.

    Light that is missed is measured at all apertures of the report, everything else at the first
    one.
    """
    if not is_shaded(scene):
        return None
    first, drawn, asked = apertures[0], [], Question(settings=(settings[0],))
    for names in ("auto", "all"):
        with Rasterizer(scene, effects=chosen(scene, names, question=asked)) as rasterizer:
            image = rasterizer.render(first, settings[0], normals=False)
            arrays = (image.color, image.triangle, image.position)
            drawn.append([array.tobytes() for array in arrays if array is not None])
    shows_eye = bool(needed(scene) & {Effect.SPECULAR, Effect.REFLECTION})
    nears = sorted({one.near for one in settings}, reverse=True) if shows_eye else []
    lit = apertures if scene.transport.simulated else []
    eye, missed = [], []
    steps = len(nears) + 2 * len(lit) * scene.sampling.aperture
    with progress_bar(steps, "light", "measurement", shown=progress) as bar:
        if nears:
            once, shader = replace(scene, sampling=Sampling()), Shader(scene)
            surfaces = Reference(once).trace(first)
            with Rasterizer(once) as rasterizer:
                for near in nears:
                    # With a depth buffer that loses nothing.
                    exact = DoubleFrustum(
                        near=near, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED
                    )
                    shown = rasterizer.render(first, exact, normals=False)
                    errors = (
                        predicted_eye_error(scene, surfaces, near),
                        measured_eye_error(shader, shown),
                    )
                    predicted, measured = (
                        float(np.sqrt(np.mean(one**2))) if one.size else 0.0 for one in errors
                    )
                    eye.append(EyeError(near=near, predicted=predicted, measured=measured))
                    bar.update()
        for aperture in lit:
            left_out = measure_left_out(scene, aperture, bar.update)
            truth = Reference(scene).trace(aperture, Sampling())
            full = (left_out.without + left_out.difference.mean).astype(np.float32)
            missed.append(
                MissedLight(
                    aperture=aperture,
                    numbers=left_out.numbers,
                    picture=address(images.picture(replace(truth, color=full))),
                    difference=address(images.radiance_map(left_out.difference.mean)),
                )
            )
    return LightReport(
        scene=scene,
        names=effects,
        decisions=decide(scene),
        same_bits=drawn[0] == drawn[1],
        eye=tuple(eye),
        missed=tuple(missed),
    )


PAGE_PIXELS = 120_000_000
"""Pixels of all settings together up to which pictures are shown in full; those of larger sweeps are reduced.
All pictures of a setting take between a tenth and a fifth of a byte per pixel, so that the page
stays under
30 MB."""

LEFT_OUT = ("causes", "predictions", "frames with exact depth", "traced models")
"""Parts that a report without causes leaves out: the causes of wrong pixels, predictions by closed forms, and
what causes alone need, which are frames with exact depth and the traced images of the cameras' models."""


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What is kept of the truth of an aperture: its picture, and what each ray tracer alone would get wrong.

    `alone` is None where a tracer alone made the truth; `marks` are encoded pictures of the pixels
    by the tracer's name, and as `truth` of all surfaces, empty where no pixel would be wrong.
    """

    picture: bytes
    alone: AloneNumbers | None
    marks: Mapping[str, bytes]


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Everything measured on a scene, as options ask for it."""

    scene: Scene
    options: ReportOptions
    apertures: tuple[Aperture, ...]
    #: One for each aperture and setting: all settings of the first aperture first.
    rows: tuple[Measurement, ...]
    truths: tuple[Truth, ...]
    decided_by: str  #: what decided the truths; see `reference.alone.DECISIONS`
    reduction: int  #: image pixels per picture pixel, along each side
    versions: Mapping[str, str]
    devices: Mapping[str, str]
    device_model: str  #: name of the model by which rounding is explained
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
        return best.best_setting(self.rows)

    @cached_property
    def geometries(self) -> tuple[DoubleFrustum, ...]:
        """Camera geometries of all settings, each once."""
        return best.geometries_of(row.settings for row in self.rows)

    @property
    def auto(self) -> AutoApertures | None:
        """The scout from which the apertures were chosen; None where they were given."""
        given = self.options.apertures
        return given if isinstance(given, AutoApertures) else None

    def numbered(
        self, aperture: Aperture, geometry: DoubleFrustum
    ) -> list[tuple[int, Measurement]]:
        """Return the rows of an aperture and a geometry, with their numbers."""
        return [
            (number, row)
            for number, row in enumerate(self.rows)
            if row.aperture == aperture and best.geometry_of(row.settings) == geometry
        ]

    @property
    def coverage_sentence(self) -> str:
        """What the hogels leave out of the plate, and the command that asks; empty where they are all."""
        measured, hogels = len(self.apertures), math.prod(self.scene.plate.hogels)
        if measured >= hogels:
            return ""
        return (
            f"Measured at {measured:,} of {hogels:,} hogels, and others may need other settings: "
            f"{provenance.scene_command('plan', self.scene)} says what holds for the whole plate."
        )

    @property
    def left_out_sentence(self) -> str:
        """What the sweep was asked to leave out, in words; empty where that is nothing."""
        if self.options.causes:
            return ""
        return (
            f"Left out, as asked for: {', '.join(LEFT_OUT[:-1])} and {LEFT_OUT[-1]}. Wrong pixels are "
            "counted and shown, and not explained."
        )

    @property
    def cost_sentence(self) -> str:
        """What measuring took, in words."""
        truths = counted(len(self.truths), "certified truth")
        if self.decided_by != alone.CERTIFIED:
            truths = f"{counted(len(self.truths), 'picture')} by {self.decided_by} alone"
        frames = counted(len(self.rows), "raster frame")
        return (
            f"Measured in {self.wall_s:.2f} s of wall time, in which stages ran side by side: {frames} with "
            f"read-back {self.times_s['raster']:.2f} s, {truths} {self.times_s['trace']:.2f} s, the page's "
            f"pictures {self.times_s['pictures']:.2f} s."
        )


def sweep(
    scene: Scene,
    apertures: Sequence[Aperture],
    settings: Sequence[DoubleFrustum],
    options: ReportOptions | None = None,
) -> Sweep:
    """Measure every setting at every aperture, at least one each; options say how.

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
    reduction = max(1, math.ceil(math.sqrt(pixels / PAGE_PIXELS)))
    reference = alone.open_reference(scene, decision, effects)
    with Evaluator(scene, reference=reference, effects=effects, model=options.device) as judge:
        seconds = defaultdict(float, prepare=time.perf_counter() - begun)
        found, truths = _measure(judge, apertures, settings, options, reduction, seconds)
        rows = tuple(found[aperture, setting] for aperture in apertures for setting in settings)
        # The hogels where the best setting is worst are drawn anew with it, to be inspected.
        since, taken = time.perf_counter(), best.best_setting(rows).settings
        worst = sorted(
            (one for one in rows if one.settings == taken), key=lambda one: -one.surface_fraction
        )
        shown = [row.aperture for row in worst[: inspection.MAX_HOGELS]]
        inspected = tuple(inspection.inspected_drawings(judge, shown, taken, causes=options.causes))
        seconds["inspection"] = time.perf_counter() - since
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
    # Where a scene says nothing of light, colors say nothing of the rasterizer, and take time.
    wanted = FrameRequest(color=True, radiance=shaded, perceptual=shaded, causes=options.causes)
    total = len(apertures) * (1 + len(settings))
    most = images_under_way(math.prod(scene.frustum.resolution))
    with (
        progress_bar(total, "report", "image", shown=options.progress) as bar,
        ThreadPoolExecutor(worker_count(), thread_name_prefix="pictures") as pool,
        closing(judge.frames(apertures, settings, wanted)) as frames,
    ):
        tasks = (pool.submit(_measured, scene, reduction, frame) for frame in frames)
        for row, truth, pictures_s in in_order(tasks, most):
            aperture, at = row.aperture, f"aperture {row.aperture.column},{row.aperture.row}"
            rows[aperture, row.settings] = row
            stages = {**asdict(row.times_s), "pictures": pictures_s, "alone": 0.0}
            if aperture in truths:
                stages["trace"] = 0.0  # all frames of an aperture have the time of its truth
            else:
                since = time.perf_counter()
                picture = images.picture(truth, reduction)
                drawn = time.perf_counter()
                stages["pictures"] += drawn - since
                found = tracers.find(truth) if tracers else None
                marks = images.alone_pictures(truth, found.wrong, reduction) if found else {}
                truths[aperture] = Truth(
                    picture=picture, alone=found.numbers if found else None, marks=marks
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
    scene: Scene, reduction: int, frame: JudgedFrame
) -> tuple[Measurement, HogelImage, float]:
    """Return the row of a frame, its truth, and the seconds that its pictures took to encode."""
    begun, reach = time.perf_counter(), scene.frustum.longest_reach
    comparison, budget, charge, wrong = frame.comparison, frame.budget, None, {}
    if budget is not None:
        # The place in `CAUSE_COLORS` of each wrong surface's link, (H, W), or the place after all.
        places = np.array(
            [list(images.CAUSE_COLORS).index(name) for name in budget.links], dtype=np.int8
        )
        is_wrong, charge = budget.surface_charge >= 0, budget.surface_charge.copy()
        charge[is_wrong] = places[charge[is_wrong]]
        charge[budget.explanation.unexplained & is_wrong] = len(images.CAUSE_COLORS)
    scale = reach, images.height_range(scene, reach)
    if comparison.errors.surface is not None:
        wrong["surface"] = PixelSet.from_mask(comparison.errors.surface)
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
        pictures=images.setting_pictures(comparison, charge, scale, reduction),
    )
    return row, frame.truth, time.perf_counter() - begun


FILES = ("index.html", "report.json", "measurements.parquet", inspection.PAGE)
"""Names of the files that a report writes; what is too large for its inspection page has files of its own."""


@dataclass(frozen=True, kw_only=True)
class ReportFiles:
    """The files of a report, and what it found."""

    html: Path
    json: Path
    parquet: Path
    inspection: Path
    #: The best setting with its numbers at the worst aperture, in words, and the command that draws
    #: with it.
    best: Recommendation
    sentence: str
    command: str
    #: The object in report.json.
    content: dict[str, Any]
    #: Further sentences: how much of the plate was measured, and what is left out; and the time
    #: that it took.
    notes: tuple[str, ...]
    cost: str

    @property
    def places(self) -> dict[str, Path]:
        """Paths of all files by their kind."""
        return {kind: getattr(self, kind) for kind in ("html", "json", "parquet", "inspection")}


def default_folder(scene: Scene) -> Path:
    """Return where a report goes unless told otherwise: `report/NAME` in the current folder."""
    name = re.sub(r"[^\w.-]+", "-", scene.name).strip("-.") or "scene"
    return Path("report") / name


def make_report(
    scene: Scene, out: Path | str | None = None, options: ReportOptions | None = None
) -> ReportFiles:
    """Measure the error of a scene over settings and write its page, numbers and inspection (`FILES`).

    They go into the folder `out`, by default `default_folder`, where no file appears before all are
    complete.

    InputError where a setting makes no sense, there is nothing to measure or to see, the folder
    cannot be written, or there is no OpenGL.
    """
    options = options or ReportOptions()
    given = scene.default_apertures() if options.apertures is None else options.apertures
    apertures = tuple(dict.fromkeys(given.apertures if isinstance(given, AutoApertures) else given))
    settings = best.settings_of(scene.frustum, options)
    if not settings or not apertures:
        raise InputError(
            "nothing to measure: give at least one near, one depth format and one aperture"
        )
    require_seen(scene, apertures)
    with Staging(default_folder(scene) if out is None else Path(out), FILES) as staging:
        measured = sweep(scene, apertures, settings, options)
        chosen, frustum = measured.best, scene.frustum
        said = best.sentence(
            measured.rows, scene.units, frustum.longest_reach, recentered=frustum.recentered
        )
        if measured.decided_by != alone.CERTIFIED:
            said = f"{said.removesuffix('.')} ({provenance.unexamined_truth(measured.decided_by)})."
        command = provenance.raster_command(scene, chosen.aperture, chosen.settings)
        staging.write(FILES[0], render_page(measured, said, command))
        rows = [row for row in measured.rows if row.settings == chosen.settings]
        shares = [(*row.aperture.index, row.surface_fraction) for row in rows]
        drawn = f"near {digits(chosen.settings.near)}, {chosen.settings.depth_label}"
        inspected = Inspection(
            command="report",
            scene=scene,
            told=f"The apertures of the report, drawn with its best setting: {drawn}.",
            hogels=measured.inspected,
            plate_map=PlateMap.from_values(scene.plate, "Share of wrong surfaces", shares),
        )
        inspection.write_inspection(staging.folder, inspected)
        content = report_content(measured, said, command)
        staging.write(FILES[1], content)
        write_parquet(measured, staging.folder / FILES[2])
        with inspection.replacing_inspection(staging.out):
            staging.commit()
    notes = [measured.coverage_sentence, measured.left_out_sentence]
    notes += measured.light.sentences() if measured.light else ()
    kinds = zip(("html", "json", "parquet", "inspection"), FILES, strict=True)
    return ReportFiles(
        **{kind: staging.out / name for kind, name in kinds},
        best=chosen,
        sentence=said,
        command=command,
        content=content,
        notes=tuple(filter(None, notes)),
        cost=measured.cost_sentence,
    )


def write_parquet(measured: Sweep, path: Path) -> None:
    """Write one row per aperture and setting, whose columns follow from `TableRow`."""
    scene = measured.scene
    made_by = {
        "scene_name": scene.name,
        "scene_source": scene.source,
        "scene_hash": scene.content_hash,
    }
    made_by |= {"units": scene.units, "decided_by": measured.decided_by}
    made_by |= {f"version_{name}": version for name, version in measured.versions.items()}
    made_by |= {f"device_{name}": value for name, value in measured.devices.items()}
    rows = [row.table_row(scene.frustum.longest_reach, made_by) for row in measured.rows]
    pq.write_table(table_of(TableRow, rows), path.absolute())


def report_content(measured: Sweep, said: str, command: str) -> dict[str, Any]:
    """Return the object in report.json; the headline and the command to be copied are made already."""
    scene, reach = measured.scene, measured.scene.frustum.longest_reach

    def recommended(one: Recommendation) -> dict[str, Any]:
        names = ("surface_fraction", "displacement_p99_px", "radiance_fraction", "window")
        return {
            **json_object(one.settings),
            "near_per_reach": one.settings.near / reach,
            **{name: getattr(one, name) for name in names},
            # The one with most wrong surfaces.
            "aperture": one.aperture.index,
        }

    found = {
        "scene": {
            "name": scene.name,
            "source": scene.source,
            "hash": scene.content_hash,
            "units": scene.units,
            "objects": len(scene.objects),
            "triangles": len(scene.faces),
            "plate": scene.plate,
            "frustum": scene.frustum,
        },
        "apertures": measured.apertures,
        "best": {
            "sentence": said,
            **recommended(measured.best),
            "command": command,
            "plan_command": provenance.scene_command("plan", scene),
            "confidence": CONFIDENCE,
        },
        "best_per_depth": list(map(recommended, best.best_per_depth(measured.rows))),
        "best_per_geometry": list(map(recommended, best.best_per_geometry(measured.rows))),
        "rows": [
            {
                "aperture": row.aperture.index,
                **json_object(row.numbers(reach)),
                "causes": row.causes,
            }
            for row in measured.rows
        ],
        # Where a tracer alone made the truths, there is nothing to compare it with.
        "tracers_alone": [
            {"aperture": aperture.index, **json_object(truth.alone)}
            for aperture, truth in zip(measured.apertures, measured.truths, strict=True)
            if truth.alone is not None
        ],
        "decided_by": measured.decided_by,
        "versions": measured.versions,
        "devices": measured.devices,
        "device_model": measured.device_model,
        "times_s": measured.times_s,
        "cost": {
            "wall_s": measured.wall_s,
            "frames_s": measured.times_s["raster"],
            "truths_s": measured.times_s["trace"],
            "pictures_s": measured.times_s["pictures"],
        },
        "shading": measured.light and measured.light.record,
        "scout": scout_record(measured.auto) if measured.auto else None,
        "left_out": () if measured.options.causes else LEFT_OUT,
    }
    return json_object(found)
