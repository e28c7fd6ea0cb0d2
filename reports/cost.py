"""`xfrustum cost`: error and time of every configuration, on one scene and machine."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from xfrustum.compare.comparison import compare_images
from xfrustum.compare.planning.ways import (
    TIMED_PASSES,
    PlateWay,
    spread_pixels,
    tile_about,
)
from xfrustum.compare.sampling import displacement_p99, is_beyond
from xfrustum.compare.scout import AutoApertures
from xfrustum.raster import Drawn, Rasterizer
from xfrustum.raster.device.targets import TargetFormat
from xfrustum.raster.plate.directions import DirectionRenderer
from xfrustum.reference import TRACERS, Reference
from xfrustum.reports.common import outputs
from xfrustum.reports.common.outputs import json_object, progress_bar, write_files
from xfrustum.reports.common.templates_environment import html_page, plain_text
from xfrustum.reports.common.timing import CONFIDENCE, FEWEST_REPETITIONS, Timing
from xfrustum.reports.notebook import NotebookRepr
from xfrustum.reports.plate.directions import CONTENT, DEPTH, DirectionsResult, measure_directions
from xfrustum.reports.plotting import INK, Figure, choices, look, styled
from xfrustum.reports.text import DISPLACEMENT_TIE_PX, aligned, displacement_words, require_seen
from xfrustum.scenes import Aperture, HogelImage, InputError, Scene
from xfrustum.scenes.arguments import real, whole
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, needed
from xfrustum.scenes.plate import DepthFormat, DepthMapping, DoubleFrustum, Offset
from xfrustum.scenes.representation import digits, percent
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

FILES = PAGE, DATA = "index.html", "cost.json"

#: Default number of measured pictures per configuration: the minimum for ranking times.
REPEAT = 5

NEARS_PER_REACH = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6)
DEPTHS = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.STANDARD),
    (DepthFormat.D32F, DepthMapping.REVERSED),
    (DepthFormat.D24, DepthMapping.LOGARITHMIC),
    (DepthFormat.D24, DepthMapping.LINEAR),
)
#: Heights of one, two and three cuts in about geometric progression, as planners place them; see
#: docs/method.md, "Splitting".
CUTS_PER_REACH = ((0.1,), (0.03, 0.2), (0.01, 0.05, 0.25))
NEARS_PER_CUT = (1e-1, 1e-2)
#: Near planes of cameras in the aperture, as fractions of the shorter reach. They displace no
#: surface, but leave a gap of this width on both sides of the plate. They are drawn with D32F
#: reversed, which works with any near.
NEARS_WITHOUT_OFFSET_PER_REACH = (1e-2, 1e-3, 1e-4, 1e-5)
#: Near plane at which samples and effects are measured: their cost does not depend on it.
USUAL_NEAR_PER_REACH = 1e-3

#: largest side of the tile whose passes by directions are timed, hogels
TIMED_SIDE = 1024

#: Second, stricter tolerance as a share of the first: 0.1 px for a tolerance of 0.5 px.
STRICTER_FRACTION = 0.2

#: Smallest plotted displacement: 32-bit positions do not resolve smaller ones, and a logarithmic
#: axis has no zero.
SMALLEST_DRAWN_PX = 1e-4


# Ranking
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Way:
    """One way to make a picture."""

    renderer: str
    label: str
    #: group of the option: a depth buffer, or another varied setting
    family: str
    #: None for a tracer
    way: PlateWay | None = None
    configuration: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Option(Way):
    """One way to make a picture, with its error and its time."""

    displacement_p99_px: float
    #: share of judged pixels with the wrong surface
    surface_fraction: float
    #: Seconds of a whole picture with read-back, over repetitions; `gpu_s` and `read_s` are the
    #: seconds of drawing and of reading back, None for a tracer.
    time_s: Timing
    gpu_s: Timing | None = None
    read_s: Timing | None = None
    #: size of the attachments of one image by direction; None for other ways
    memory_bytes: int | None = None

    @property
    def cells(self) -> tuple[str, ...]:
        """Label, time with its interval in ms, and error, as text and notebooks show them."""
        times = (f"{1e3 * value:.2f}" for value in (self.time_s.median, *self.time_s.interval))
        errors = digits(self.displacement_p99_px), percent(self.surface_fraction)
        return self.label, *times, *errors

    def keeps(self, tolerance_px: float) -> bool:
        """Return whether the errors are within a tolerance (`compare.sampling`)."""
        return not is_beyond(self.displacement_p99_px, self.surface_fraction, tolerance_px)

    def beats(self, other: Option) -> bool:
        """Return whether this option is nowhere worse than another, and somewhere better.

        Its time is not worse if its median does not exceed the other's interval. Its time is better
        if it is also distinguishable from the other's.
        """
        mine, its = (
            (option.displacement_p99_px, option.surface_fraction) for option in (self, other)
        )
        worse = mine[0] > its[0] or mine[1] > its[1]
        if worse or self.time_s.median > other.time_s.interval[1]:
            return False
        return mine != its or self.time_s.told_below(other.time_s)


@dataclass(frozen=True, kw_only=True)
class FastestWithin:
    """Options within a tolerance that no other option beats in time.

    `fastest` begins with the option of the least median; the timing intervals of the others overlap
    with its interval. If there were too few repetitions for a ranking (`ranked` is false),
    `fastest` has all options within the tolerance. It is empty if no option is within the
    tolerance.
    """

    tolerance_px: float
    fastest: tuple[Option, ...]
    ranked: bool

    @property
    def option(self) -> Option | None:
        """The fastest option with the least displacement, then the fewest wrong surfaces."""

        def error(candidate: Option) -> tuple[float, ...]:
            # Displacements below the tie are equal: wrong surfaces then decide.
            moved = max(candidate.displacement_p99_px, DISPLACEMENT_TIE_PX)
            return moved, candidate.surface_fraction, candidate.time_s.median

        return min(self.fastest, key=error, default=None)


def pareto(options: Sequence[Option]) -> list[bool]:
    """Return a mask of the options on the Pareto front of time, displacement and wrong surfaces."""
    return [not any(other.beats(option) for other in options) for option in options]


def rank(options: Sequence[Option], tolerance_px: float) -> FastestWithin:
    """Return the fastest options within a tolerance, ties included."""
    ascending = sorted(options, key=lambda option: option.time_s.median)
    allowed = tuple(option for option in ascending if option.keeps(tolerance_px))
    repeated = [option for option in allowed if option.time_s.repetitions >= FEWEST_REPETITIONS]
    # Too few repetitions have no interval, and a single option needs no ranking.
    if len(allowed) < 2 or not repeated:
        return FastestWithin(tolerance_px=tolerance_px, fastest=allowed, ranked=len(allowed) == 1)
    tied = tuple(option for option in repeated if not repeated[0].time_s.told_below(option.time_s))
    return FastestWithin(tolerance_px=tolerance_px, fastest=tied, ranked=True)


def sentences(options: Sequence[Option], tolerance_px: float) -> list[str]:
    """Return sentences: the fastest options within a tolerance and a fifth of it, and advice."""
    mark = "\f"
    values = {
        "loose": rank(options, tolerance_px),
        "strict": rank(options, STRICTER_FRACTION * tolerance_px),
        "kept": sum(option.keeps(tolerance_px) for option in options),
        "fewest": FEWEST_REPETITIONS,
        "max_wrong": MAX_WRONG,
        "paragraph": mark,
    }
    text = plain_text("cost-sentences.txt.j2", values, {"displaced": displacement_words})
    return [" ".join(part.split()) for part in text.split(mark)]


# Measures
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, repr=False)
class CostReport(NotebookRepr):
    """Every option measured on a scene."""

    scene: Scene
    aperture: Aperture
    #: Apertures at which pictures are judged; the worst one counts. None for a single aperture.
    auto: AutoApertures | None
    tolerance_px: float
    options: tuple[Option, ...]
    #: seconds of one-time setup for a scene (buffers, programs, acceleration structures), by
    #: renderer
    upload_s: dict[str, float]
    machine: dict[str, str]
    versions: dict[str, str]
    directions: DirectionsResult

    @cached_property
    def sentences(self) -> list[str]:
        """Sentences: the fastest options within the tolerance and a fifth of it, and advice."""
        return sentences(self.options, self.tolerance_px)

    @property
    def answers(self) -> tuple[FastestWithin, ...]:
        """Fastest options within the tolerance and within a fifth of it."""
        shares = (1.0, STRICTER_FRACTION)
        return tuple(rank(self.options, share * self.tolerance_px) for share in shares)

    @property
    def answer(self) -> str:
        """Recommended option, in one sentence."""
        return self.sentences[-1]

    def ascending(self) -> list[tuple[Option, bool]]:
        """Return options in order of time, and whether they are on the Pareto front."""
        pairs = zip(self.options, pareto(self.options), strict=True)
        return sorted(pairs, key=lambda pair: pair[0].time_s.median)

    def _said(self) -> str:
        column, row = self.aperture.index
        ways = f"{len(self.options)} ways to draw aperture {column},{row}"
        return f"{ways} of {self.scene.name!r}. {self.answer}"

    def summary(self) -> dict[str, Any]:
        """Return everything as one JSON object."""

        def times(timing: Timing | None) -> dict[str, Any] | None:
            """Return the median, the ends, and the interval of the median, of repeated seconds."""
            if timing is None:
                return None
            ends = {"median": timing.median, "low": timing.lowest, "high": timing.highest}
            return {**ends, "interval": timing.interval, "repetitions": timing.repetitions}

        rows = [
            {
                "renderer": option.renderer,
                "label": option.label,
                "family": option.family,
                "way": option.way,
                **option.configuration,
                "error": {
                    "displacement_p99_px": option.displacement_p99_px,
                    "surface_fraction": option.surface_fraction,
                },
                "time_s": times(option.time_s),
                "gpu_s": times(option.gpu_s),
                "read_back_s": times(option.read_s),
                "memory_bytes": option.memory_bytes,
                "pareto": best,
            }
            for option, best in zip(self.options, pareto(self.options), strict=True)
        ]
        answers = []
        for ranking, sentence in zip(self.answers, self.sentences, strict=False):
            # Take the least error among the fastest options, if any option keeps the tolerance.
            option = ranking.option
            answer = {
                "tolerance_px": ranking.tolerance_px,
                "configuration": option and option.label,
                "time_s": times(option.time_s if option else None),
                "ranked": ranking.ranked,
                "fastest": [tied.label for tied in ranking.fastest],
                "sentence": sentence,
            }
            answers.append(answer)
        names = ("upload_s", "machine", "versions")
        return json_object(
            {
                "scene": {"name": self.scene.name, "hash": self.scene.content_hash},
                "aperture": self.aperture.index,
                "apertures": self.auto and choices(self.auto),
                "rows": rows,
                "answers": answers,
                "answer": self.answer,
                "directions": self.directions.summary(),
                **{name: getattr(self, name) for name in names},
            }
        )

    def table(self) -> str:
        """Return the answers, the options on the front as lines, and the recommended option."""
        *answers, answer = self.sentences
        head = ("on the Pareto front", "ms", "from", "to", "99 %, px", "wrong")
        rows = [option.cells for option, best in self.ascending() if best]
        words = self.directions.words(self.scene)
        return "\n".join([*answers, "", aligned([head, *rows]), "", answer, words])


def cost(
    scene: Scene,
    aperture: Aperture | AutoApertures | None = None,
    tolerance_px: float = TOLERANCE_PX,
    *,
    repeat: int = REPEAT,
    progress: bool = False,
) -> CostReport:
    """Measure error and time of every configuration.

    The picture shows one aperture, by default the middle one. If there are several apertures
    (`AutoApertures`), only the first is timed; pictures are judged at all apertures, and the worst
    counts. A second answer is for a fifth of the tolerance. For each configuration `repeat`
    pictures are timed after a warm-up. Configurations take turns, so that a slow minute slows all
    of them down.

    InputError if the tolerance or the number of repetitions is not positive, the aperture sees
    nothing of the objects, or there is no usable OpenGL.
    """
    if not 0 < real(tolerance_px) < math.inf or whole(repeat) < 1:
        raise InputError(
            f"cost: tolerance {tolerance_px} and repetitions {repeat} must be positive"
        )
    chosen = scene.plate.middle if aperture is None else aperture
    apertures = chosen.apertures if isinstance(chosen, AutoApertures) else (chosen,)
    require_seen(scene, apertures)
    upload_s: dict[str, float] = {}
    with ExitStack() as stack:
        begun = time.perf_counter()
        drawers = {"auto": stack.enter_context(Rasterizer(scene))}
        upload_s["raster"] = time.perf_counter() - begun
        # Only a scene that omits effects has a second program to time.
        if needed(scene) != ALL_EFFECTS:
            drawers["all"] = stack.enter_context(Rasterizer(scene, effects=ALL_EFFECTS))
        tracers = {name: Reference(scene, tracer=name) for name in TRACERS}
        for name, reference in tracers.items():
            begun = time.perf_counter()
            # Acceleration structures are built once per scene; a picture's time does not include
            # them.
            reference.build_tracer()
            upload_s[name] = time.perf_counter() - begun
        # Read the device while the contexts are open.
        device = drawers["auto"].device
        ways = {
            place: [*_drawn(scene, place, drawers), *_traced(place, tracers)] for place in apertures
        }
        # At every aperture the first picture is judged and not timed; only the first aperture is
        # timed.
        timed = ways[apertures[0]]
        usual = DoubleFrustum(near=USUAL_NEAR_PER_REACH * scene.frustum.longest_reach)
        turned = measure_directions(tracers["embree"], apertures, usual)
        if turned.errors is not None:
            timed = [*timed, _by_directions(scene, stack)]
        pictures = len(timed) * (len(ways) + repeat)
        with progress_bar(pictures, "cost", "picture", shown=progress) as bar:
            errors = _errors(ways, tracers["embree"], bar.update)
            if turned.errors is not None:
                # Lines by direction have no near offset, so that their displacement is zero.
                errors.append((0.0, turned.errors.fraction))
            seconds = _seconds(timed, repeat, bar.update)
    options = [
        Option(
            displacement_p99_px=p99,
            surface_fraction=wrong,
            **(vars(way) | {name: Timing.from_values(values) for name, values in taken.items()}),
        )
        for (way, _), (p99, wrong), taken in zip(timed, errors, seconds, strict=True)
    ]
    if turned.errors is not None:
        options[-1] = _of_hogels(options[-1], scene)
    libraries = {key: value for used in tracers.values() for key, value in used.versions.items()}
    return CostReport(
        scene=scene,
        aperture=apertures[0],
        auto=chosen if isinstance(chosen, AutoApertures) else None,
        tolerance_px=tolerance_px,
        options=tuple(options),
        upload_s=upload_s,
        machine={
            **outputs.machine(),
            **{f"OpenGL {name}": value for name, value in device.items()},
        },
        versions={**outputs.versions(), **libraries},
        directions=turned,
    )


#: a way to make a picture, and the function that makes the picture
_Made = tuple[Way, Callable[[], HogelImage | Drawn | None]]


def _errors(
    ways: Mapping[Aperture, list[_Made]], reference: Reference, done: Callable[[], object]
) -> list[tuple[float, float]]:
    """Return displacement (p99, px) and wrong surfaces (share) of each way, worst of apertures."""
    errors = [(0.0, 0.0)] * max(map(len, ways.values()))
    for aperture, those in ways.items():
        truth = reference.trace(aperture)
        for number, (way, make) in enumerate(those):
            made = make()
            image = made.image if isinstance(made, Drawn) else made
            assert image is not None, "passes by directions have no image of a hogel"
            judged = compare_images(truth, image, reference, radiance=False)
            assert judged.surface is not None, "the reference has the scene at hand"
            # Tracers draw exact lines: their only errors are wrong surfaces.
            p99 = displacement_p99(judged) if way.renderer == "raster" else 0.0
            worst, wrong = errors[number]
            # The two maxima may come from different apertures: each is a bound for all of them.
            errors[number] = max(worst, p99), max(wrong, judged.surface.fraction)
            done()
    return errors


def _seconds(
    ways: list[_Made], repeat: int, done: Callable[[], object]
) -> list[dict[str, list[float]]]:
    """Return the measured seconds of each way, by fields of `Option`; the ways take turns."""
    seconds: list[dict[str, list[float]]] = [defaultdict(list) for _ in ways]
    # Rounds interleave all ways, so that drift of clock or load affects all of them equally.
    for _ in range(repeat):
        for (_, make), taken in zip(ways, seconds, strict=True):
            begun = time.perf_counter()
            made = make()
            taken["time_s"].append(time.perf_counter() - begun)
            if isinstance(made, Drawn):
                taken["gpu_s"].append(made.gpu_s)
                taken["read_s"].append(made.read_s)
            done()
    return seconds


def _drawn(scene: Scene, aperture: Aperture, drawers: dict[str, Rasterizer]) -> Iterator[_Made]:
    """Yield drawn ways: nears with depth buffers, slabs, nears without offset, samples, effects."""
    reach, units = scene.frustum.longest_reach, scene.units

    def way(
        settings: DoubleFrustum, family: str | None = None, samples: int = 1, effects: str = "auto"
    ) -> _Made:
        drawer = drawers[effects]
        cuts, share = ", ".join(map(digits, settings.slabs)), digits(settings.near / reach)
        label = f"raster, near {digits(settings.near)} {units} ({share} of the reach) "
        label += f"with {settings.depth_label} depth"
        label += f" and cuts at {cuts}" if cuts else ""
        if settings.offset is Offset.NONE:
            label += " and no offset, which leaves a gap at the plate"
        label += f", {samples} aperture samples" if samples > 1 else ""
        label += ", all effects" if effects == "all" else ""
        names = ("near", "depth", "mapping", "slabs", "offset")
        sampling = replace(scene.sampling, aperture=samples)
        described = Way(
            renderer="raster",
            label=label,
            family=family or settings.depth_label,
            way=PlateWay.from_settings(settings),
            configuration={
                **{name: getattr(settings, name) for name in names},
                "aperture_samples": samples,
                "effects": sorted(drawer.effects_for(settings), key=list(Effect).index),
            },
        )
        return described, partial(drawer.draw, aperture, settings, normals=False, sampling=sampling)

    for depth, mapping in DEPTHS:
        for share in NEARS_PER_REACH:
            yield way(DoubleFrustum(near=share * reach, depth=depth, mapping=mapping))
    for cuts in CUTS_PER_REACH:
        for share in NEARS_PER_CUT:
            slabs = tuple(cut * reach for cut in cuts)
            yield way(DoubleFrustum(near=share * slabs[0], slabs=slabs), f"{len(cuts) + 1} slabs")
    usual = DoubleFrustum(near=USUAL_NEAR_PER_REACH * reach)
    stays = replace(
        usual, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED, offset=Offset.NONE
    )
    for share in NEARS_WITHOUT_OFFSET_PER_REACH:
        yield way(replace(stays, near=share * min(scene.frustum.reach)), "no offset")
    samples = scene.sampling.aperture
    for count in sorted({2, samples} if samples > 1 else ()):
        yield way(usual, "aperture samples", count)
    if "all" in drawers:
        yield way(usual, "all effects", effects="all")


def _by_directions(scene: Scene, stack: ExitStack) -> _Made:
    """Return the way by directions, and the function that draws some passes over the plate."""
    tile = tile_about(scene.plate, scene.plate.middle, TIMED_SIDE)
    renderer = stack.enter_context(DirectionRenderer(scene, tile, CONTENT, DEPTH))
    pixels, count = spread_pixels(scene.frustum, TIMED_PASSES), math.prod(scene.frustum.resolution)
    columns, rows = tile.size
    described = Way(
        renderer="raster",
        label=f"raster, by directions with {DEPTH.upper()} linear depth, a hogel's share of "
        f"{count:,} passes over {columns:,} x {rows:,}",
        family="directions",
        way=PlateWay.DIRECTIONS,
        configuration={
            "depth": DEPTH,
            "mapping": DepthMapping.LINEAR,
            "effects": sorted(renderer.effects, key=list(Effect).index),
        },
    )

    def draw() -> None:
        for _ in renderer.images(pixels):
            pass

    draw()
    return described, draw


def _of_hogels(option: Option, scene: Scene) -> Option:
    """Return an option with the time of all passes per hogel, extrapolated from timed passes."""
    columns, rows = tile_about(scene.plate, scene.plate.middle, TIMED_SIDE).size
    passes = math.prod(scene.frustum.resolution)
    timed = len(spread_pixels(scene.frustum, TIMED_PASSES))
    size = TargetFormat(depth=DEPTH, content=CONTENT).bytes_per_pixel * columns * rows
    share = option.time_s.divided_by(columns * rows * timed / passes)
    return replace(option, time_s=share, memory_bytes=size)


def _traced(aperture: Aperture, tracers: Mapping[str, Reference]) -> Iterator[_Made]:
    """Yield each tracer alone, and the certified truth."""
    for name, reference in tracers.items():
        label = f"{name} alone, float32, nothing proven"
        yield Way(renderer=name, label=label, family=name), partial(reference.propose, aperture)
    truth = Way(
        renderer="certified",
        label="the certified truth",
        family="certified truth",
        configuration={"certified": True},
    )
    yield truth, partial(tracers["embree"].trace, aperture)


# Page
# -------------------------------------------------------------------------------------------------


def write_cost(measured: CostReport, out: Path) -> tuple[Path, ...]:
    """Write index.html and cost.json to a folder, all or nothing; InputError on failure."""
    values = {
        "cost": measured,
        "chosen": () if measured.auto is None else choices(measured.auto),
        "confidence": CONFIDENCE,
        "rows": measured.ascending(),
        "tolerances": [share * measured.tolerance_px for share in (1.0, STRICTER_FRACTION)],
        "figure": trade_off_figure(measured.options, measured.tolerance_px),
    }
    return write_files(out, {PAGE: html_page("cost.html.j2", values), DATA: measured.summary()})


def trade_off_figure(options: Sequence[Option], tolerance_px: float) -> Figure:
    """Draw the displacement of every option against its time; options on the front are filled."""
    pairs, data = list(zip(options, pareto(options), strict=True)), list[Figure]()
    for place, family in enumerate(dict.fromkeys(option.family for option in options)):
        mine = [(option, best) for option, best in pairs if option.family == family]
        (color, symbol), times = look(place), [option.time_s for option, _ in mine]
        # Bars from the lowest to the highest repetition.
        bars = {
            "array": [1000 * (timing.highest - timing.median) for timing in times],
            "arrayminus": [1000 * (timing.median - timing.lowest) for timing in times],
        }
        marker = {
            "symbol": [symbol + ("" if best else "-open") for _, best in mine],
            "size": [12 if best else 8 for _, best in mine],
            "color": color,
        }
        points = {
            "x": [1000 * timing.median for timing in times],
            "y": [max(option.displacement_p99_px, SMALLEST_DRAWN_PX) for option, _ in mine],
            "error_x": {"type": "data", "symmetric": False, "thickness": 0.8, "width": 0, **bars},
            "name": family,
            "mode": "markers",
            "marker": marker,
            "text": [
                f"{option.label}<br>wrong surface {percent(option.surface_fraction)}"
                for option, _ in mine
            ],
            "hovertemplate": "%{text}<br>%{x:.3g} ms, %{y:.3g} px<extra></extra>",
        }
        data.append(points)
    # The two lines are less than a decade apart: put one label above its line, the other below.
    limits = {"bottom": tolerance_px, "top": STRICTER_FRACTION * tolerance_px}
    across = {
        "type": "line",
        "xref": "x domain",
        "x0": 0,
        "x1": 1,
        "line": {"color": INK, "dash": "dot", "width": 1},
    }
    at_end = {"x": 1, "xref": "x domain", "xanchor": "right", "showarrow": False}
    # A range of less than a decade may have no power of ten; plotly's bare digits mislead there.
    ticks = [digit * 10.0**power for power in range(-2, 6) for digit in (1, 2, 3, 5, 7)]
    labels = {"tickvals": ticks, "ticktext": [f"{value:g}" for value in ticks]}
    decades = {"type": "log", "exponentformat": "power", "dtick": 1}
    layout = {
        "height": 520,
        "xaxis": {"title": "time of a picture with read-back, ms", "type": "log", **labels},
        "yaxis": {"title": "99th percentile of displacement, px", **decades},
        # Shapes on a logarithmic axis take values, annotations their logarithms.
        "shapes": [{**across, "y0": limit, "y1": limit} for limit in limits.values()],
        "annotations": [
            {"text": f"{limit:g} px", "y": math.log10(limit), "yanchor": anchor, **at_end}
            for anchor, limit in limits.items()
        ],
    }
    return styled(data, layout)
