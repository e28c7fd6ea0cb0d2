"""`xfrustum explain`: what a scene calls for, what bounds errors at each depth, and what a viewer sees.

The answer comes from the scene alone: `scenes.model.effects` decides what an image may show and
whether leaving it out changes a bit, and closed forms say what near offset, depth buffer, shear and
band limiting do.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from xfrustum.compare.extent import depth_bins, require_seen
from xfrustum.compare.prediction import band_limiting
from xfrustum.compare.prediction.depth import smallest_separation
from xfrustum.reference import TRACERS
from xfrustum.reports.common.outputs import json_object, progress_bar
from xfrustum.reports.common.templates_environment import Filters, plain_text
from xfrustum.reports.common.timing import FEWEST_DIFFERENCES, median_interval
from xfrustum.scenes import Aperture, DoubleFrustum, InputError, Scene
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.arguments import whole
from xfrustum.scenes.model.effects import (
    ALL_EFFECTS,
    Effect,
    Question,
    SlabContent,
    decide,
    slab_contents,
)
from xfrustum.scenes.notebook import NotebookRepr, aligned, counted, digits, percent
from xfrustum.tolerances import TOLERANCE_PX

REPEAT = FEWEST_DIFFERENCES  #: measured pairs of images for each effect, where costs are measured
DEFAULT_NEAR_PER_REACH = 1e-3  #: near where none is asked for

EXAMPLE_SUB_APERTURES = (1, 16, 256, 4096)
"""Numbers of sub-apertures whose errors are told: none but the middle, and what one might pay for."""

MEASURED_PATHS = 4
"""Light paths per pixel with which light transport is timed: its time is proportional to their number."""

PROCEDURE = (
    "each image with and without the effect, in turn, the first of a pair in alternation, after one of each "
    "that warms up; medians, of the differences for costs; color only, one sample unless samples are what is "
    "measured; light transport from its time for 4 paths a pixel"
)
"""How costs are measured, in words."""

RENDERERS = ("raster", "reference")  #: names of the renderers whose costs are measured

Cost = dict[str, Any]
"""Seconds that an effect adds to an image: median, `spread` and `interval` of differences of pairs, whether
it is `resolved` from zero, and the median of the image `without` it."""

Image = Callable[[], object]


def cost(with_it: Image, without_it: Image, repeat: int) -> Cost:
    """Return the time that the first of two images takes beyond the second.

    After one pair that warms up, the images of a pair are made in alternating order: the second may
    find caches filled, or a processor slowed down.
    """
    differences, plain = [], []
    for turn in range(repeat + 1):
        taken = {}
        for image in (with_it, without_it) if turn % 2 else (without_it, with_it):
            begun = time.perf_counter()
            image()
            taken[image] = time.perf_counter() - begun
        more, less = taken[with_it], taken[without_it]
        if turn:
            differences.append(more - less)
            plain.append(less)
    low, high = median_interval(differences)
    quartiles = statistics.quantiles(differences, n=4) if repeat > 1 else differences * 3
    return {
        "seconds": statistics.median(differences),
        "spread": (quartiles[2] - quartiles[0]) / 2,
        "interval": (low, high),
        "resolved": repeat >= FEWEST_DIFFERENCES and (low > 0 or high < 0),
        "without": statistics.median(plain),
    }


def _costs(plan: EffectsPlan, name: str, used: frozenset[Effect]) -> dict[str, Cost]:
    """Return the cost by renderer of an effect, added to those used or taken away, or of a setting."""
    # Renderers are loaded only where something is measured.
    from xfrustum.raster import Rasterizer  # noqa: PLC0415
    from xfrustum.reference import Reference  # noqa: PLC0415
    from xfrustum.reference.transport import PathTracer  # noqa: PLC0415

    scene, asked = plan.scene, plan.scene.sampling
    if name in ("shadows", "interreflection"):
        tracer, few = PathTracer(scene), Transport(samples=MEASURED_PATHS, **{name: True})
        found = cost(lambda: tracer.render(plan.aperture, few), lambda: None, plan.repeat)
        factor = scene.transport.samples / MEASURED_PATHS
        longer = {key: factor * found[key] for key in ("seconds", "spread")}
        return {
            "reference": found
            | longer
            | {"interval": tuple(factor * end for end in found["interval"])}
        }
    # Sampling and effects of both images; None for the effects that the scene calls for.
    one: tuple[Sampling, frozenset[Effect] | None]
    other: tuple[Sampling, frozenset[Effect] | None] = Sampling(), None
    renderers: Sequence[str] = RENDERERS
    if name == "antialiasing":
        smooth = asked.supersample > 1 or asked.multisample > 1
        one = replace(asked, aperture=1) if smooth else Sampling(supersample=2), None
    elif name == "band-limiting":
        one = Sampling(aperture=asked.aperture if asked.aperture > 1 else 4), None
    else:
        more = ALL_EFFECTS if name == "all" else used | {Effect(name)}
        fewer = used if name == "all" else used - {Effect(name)}
        one, other = (Sampling(), more), (Sampling(), fewer)
        # A true line meets the same surface first, whichever cameras would draw it.
        renderers = RENDERERS if (more ^ fewer) - {Effect.C, Effect.C_STAR} else RENDERERS[:1]

    def image(renderer: str, sampling: Sampling, effects: frozenset[Effect] | None) -> Image:
        if renderer == "reference":
            reference = Reference(scene, plan.tracer, effects)
            return lambda: reference.trace(plan.aperture, sampling)
        rasterizer = stack.enter_context(Rasterizer(scene, effects))
        return lambda: rasterizer.render(
            plan.aperture, plan.settings, normals=False, sampling=sampling
        )

    with ExitStack() as stack:
        return {by: cost(image(by, *one), image(by, *other), plan.repeat) for by in renderers}


@dataclass(frozen=True, kw_only=True)
class Row:
    """One effect, or a setting of the scene: whether it is used, and the fact that decided it."""

    name: str
    used: bool
    reason: str
    objects: tuple[
        int, ...
    ] = ()  #: those that call for it, and those that would if an image could show them
    out_of_sight: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True, repr=False)
class EffectsPlan(NotebookRepr):
    """The effects that one image will have, decided before anything runs, and their measured costs."""

    scene: Scene
    aperture: Aperture
    settings: DoubleFrustum
    tracer: str
    rows: tuple[Row, ...]
    slabs: tuple[SlabContent, ...]  #: of both cameras, from the back
    depths: dict[str, Any]
    #: Costs by renderer of each row by its name, and of `all` local effects beyond those used
    costs: dict[str, dict[str, Cost]] = field(default_factory=dict)
    repeat: int = 0

    def _said(self) -> str:
        column, row = self.aperture.index
        used, left_out = (
            ", ".join(one.name for one in self.rows if one.used is wanted) or "nothing"
            for wanted in (True, False)
        )
        return f"aperture {column},{row} of {self.scene.name!r} calls for {used}; it is drawn without {left_out}"

    def summary(self) -> dict[str, Any]:
        """Return the object that `explain --json` prints."""
        sampling, scene, cameras = self.scene.sampling, self.scene, (Effect.C, Effect.C_STAR)

        def by_renderer(of: str, name: str) -> dict[str, Any]:
            """Return a number of a cost by each renderer; None where it was not measured or means nothing."""
            return {one: self.costs.get(of, {}).get(one, {}).get(name) for one in RENDERERS}

        named = {
            "cost_s": "seconds",
            "spread_s": "spread",
            "interval_s": "interval",
            "resolved": "resolved",
        }
        effects = [
            {
                name: getattr(row, name)
                for name in ("name", "used", "reason", "objects", "out_of_sight")
            }
            | {key: by_renderer(row.name, name) for key, name in named.items()}
            for row in self.rows
        ]
        objects = []
        for number, part in enumerate(scene.objects):
            z, rows = part.vertices[:, 2], [row for row in self.rows if number in row.objects]
            objects.append(
                {
                    "number": number,
                    "name": part.name,
                    "heights": (z.min(), z.max()),
                    "in_sight": any(row.name in cameras for row in rows),
                    "effects": [row.name for row in rows if row.used and row.name not in cameras],
                }
            )
        # The rasterizer's passes: slabs that have something in them, of the cameras that are used.
        used = {row.name for row in self.rows if row.used}
        drawn = [slab for slab in self.slabs if slab.triangles and slab.camera.value in used]
        kinds = ("surfaces", "reflections") if Effect.REFLECTION in used else ("surfaces",)
        found = {
            "scene": {"name": scene.name, "hash": scene.content_hash},
            "units": scene.units,
            "aperture": self.aperture.index,
            "effects": effects,
            "objects": objects,
            "depths": self.depths,
            "cameras": list(dict.fromkeys(slab.camera for slab in drawn)),
            "slabs": self.slabs,
            "passes": [
                {"camera": slab.camera, "heights": slab.heights, "draws": kind}
                for kind in kinds
                for slab in drawn
            ],
            "samples": {"pixel": sampling.supersample**2}
            | {name: getattr(sampling, name) for name in ("multisample", "aperture")},
            "transport": scene.transport,
            "tracer": self.tracer,
            "image_s": by_renderer("all", "without"),
            "left_out_s": by_renderer("all", "seconds"),
            "left_out_interval_s": by_renderer("all", "interval"),
            "repeat": self.repeat,
            "procedure": PROCEDURE,
        }
        return json_object(found)

    def table(self) -> str:
        """Return the plan as text: the effects, then what is drawn, sampled and traced."""
        units, told, measured = self.scene.units, self.summary(), RENDERERS if self.repeat else ()
        effects = [("effect", "", *measured, "because")]
        for row in self.rows:
            costs = (_time(self.costs[row.name].get(name)) for name in measured)
            effects.append((row.name, "used" if row.used else "left out", *costs, row.reason))
        head = (
            f"|z| ({units})",
            "surface",
            "near offset",
            "pivot camera",
            "separation",
            "blur",
            "sub-apertures",
        )
        by_depth: list[tuple[str, ...]] = [head]
        for one in self.depths["rows"]:
            least, largest = (
                digits(blur) if math.isfinite(blur) else "any" for blur in one["blur_px"]
            )
            cells = (
                f"{digits(one['nearest'])} to {digits(one['farthest'])} {one['side']}",
                percent(one["share"]),
                f"{digits(one['near_px'])} px",
                f"{digits(one['shear_px'])} px",
                f"{digits(one['separation'])} {units}",
                f"{least} to {largest} px",
                _points(one["sub_apertures"]),
            )
            by_depth.append(cells)
        values = {
            "plan": self,
            "told": told,
            "depths": self.depths,
            "default_near": self.settings.near == default_near(self.scene),
            "units": units,
            "effects": aligned(effects, str.ljust),
            "by_depth": aligned(by_depth, str.ljust),
            "transport": [
                name for name in ("shadows", "interreflection") if told["transport"][name]
            ],
        }
        filters: Filters = {"time": _time, "duration": _duration, "points": _points}
        return plain_text("explain.txt.j2", values, filters).removesuffix("\n")


def explain(
    scene: Scene,
    aperture: Aperture | None = None,
    settings: DoubleFrustum | None = None,
    *,
    tracer: str = "embree",
    repeat: int = 0,
    progress: bool = False,
) -> EffectsPlan:
    """Say what an image of a scene calls for and, if asked, measure what each effect costs here and now.

    The image is of the middle aperture, with both cameras and no slabs, where none is asked for.
    `repeat` is the number of measured pairs of images for each effect; 0 measures nothing, and
    answers from the scene alone. InputError where the settings make no sense for the scene, the
    aperture sees nothing of the objects, or there is no usable OpenGL.
    """
    aperture = aperture or scene.plate.middle
    settings = settings or DoubleFrustum(near=default_near(scene))
    settings.check_against(scene.frustum)
    if whole(repeat) < 0:
        raise InputError(f"explain: repetitions must be a count from 0, not {repeat!r}")
    if tracer not in TRACERS:
        raise InputError(f"tracer must be one of {', '.join(TRACERS)}, not {tracer!r}")
    require_seen(scene, [aperture])
    question = Question(camera=settings.camera, apertures=(aperture,), settings=(settings,))
    decided = [asdict(one) for one in decide(scene, question=question)]
    rows = [Row(name=one.pop("effect"), **one) for one in decided]
    # What changes the picture is simulated only if it is asked for.
    sampling, transport = scene.sampling, scene.transport
    side, many, points = sampling.supersample, sampling.multisample, sampling.aperture
    paths = f"{transport.samples} light paths a pixel"
    smooth = f"{side} x {side} points a pixel and {counted(many, 'coverage sample')} are asked for"
    for name, used, asked, cheap in (
        ("antialiasing", side > 1 or many > 1, smooth, "2 x 2 points a pixel"),
        ("band-limiting", points > 1, f"{points} sub-apertures are asked for", "4 sub-apertures"),
        ("shadows", transport.shadows, f"asked for, with {paths}", paths),
        ("interreflection", transport.interreflection, f"asked for, with {paths}", paths),
    ):
        unasked = f"not asked for{f'; the cost is that of {cheap}' if repeat else ''}"
        rows.append(Row(name=name, used=used, reason=asked if used else unasked))
    plan = EffectsPlan(
        scene=scene,
        aperture=aperture,
        settings=settings,
        tracer=tracer,
        rows=tuple(rows),
        slabs=slab_contents(scene, settings),
        depths=depths(scene, aperture, settings),
        repeat=repeat,
    )
    if not repeat:
        return plan
    effects = frozenset(Effect(row.name) for row in rows[: len(decided)] if row.used)
    costs: dict[str, dict[str, Cost]] = {}
    with progress_bar(len(rows) + 1, "explain", "effect", shown=progress) as bar:
        for name in (*(row.name for row in rows), "all"):
            costs[name] = _costs(plan, name, effects)
            bar.update()
    return replace(plan, costs=costs)


def default_near(scene: Scene) -> float:
    """Return the near offset where none is asked for."""
    return DEFAULT_NEAR_PER_REACH * scene.frustum.longest_reach


def depths(scene: Scene, aperture: Aperture, settings: DoubleFrustum) -> dict[str, Any]:
    """Return the content of an aperture's frustum by depth, with errors in closed form: `depths` in JSON.

    The near offset displaces what lies below the first cut, and a fit makes that less: without an
    own one the first slab is fitted to its cut. Cameras of the other slabs stand in the aperture.
    """
    film, screen = np.array(scene.frustum.resolution), scene.frustum.screen
    corner, contrast = math.hypot(*film) / 2, band_limiting.contrast_of(scene, [aperture])
    fitted = settings.fitted_height(scene.frustum) if settings.slabs else None
    sheared = 0.0
    if screen is not None:
        # A shear of n per depth moves the film by (W/2 kx/tx, H/2 ky/ty) pixels; k/t is the
        # distance from aperture to the screen's middle, in half sizes of the screen.
        away = np.subtract(screen.center, (aperture.x, aperture.y)) / (np.array(screen.size) / 2)
        sheared = float(np.hypot(*(film / 2 * away)))
    rows: list[dict[str, Any]] = []
    nears, areas = list(settings.slabs), []
    for one in depth_bins(scene, [aperture]):
        sections = settings.sections(scene.frustum.reach[1 if one.behind else 0])
        of_fit = 1.0 if fitted is None else abs(1 - one.nearest / fitted)
        moved = 0.0
        if one.nearest < sections[0][1]:
            moved = settings.near / (one.nearest + settings.near)
            nears.append(
                one.nearest * TOLERANCE_PX / max(corner * of_fit - TOLERANCE_PX, TOLERANCE_PX)
            )
        # The farthest content is ordered in the slab that draws it. The first slab's camera has
        # stepped back; those of the others stand in the aperture.
        low, high = next((ends for ends in sections if one.farthest <= ends[1]), sections[-1])
        back, near = (settings.near, settings.near) if low == 0 else (0.0, low)
        w = np.array([one.farthest + back])
        separation = smallest_separation(w, near, high + back, settings.depth, settings.mapping)
        widest, least = band_limiting.blurs(scene, one)
        areas.append(widest)
        rows.append(
            {
                "side": "behind" if one.behind else "before",
                **{name: getattr(one, name) for name in ("heights", "nearest", "farthest")},
                "triangles": one.triangles,
                "share": one.share,
                "near_px": corner * moved * of_fit,
                "shear_px": sheared * moved,
                "separation": float(separation[0]),
                "blur_px": (least, max(widest)),
                "sub_apertures": band_limiting.sub_apertures_for(widest, contrast),
            }
        )
    counts = [row["sub_apertures"] for row in rows]

    def levels(count: int) -> float:
        return (
            max((band_limiting.error_bound(count, one, contrast) for one in areas), default=0.0)
            / band_limiting.LEVEL
        )

    return {
        "rows": rows,
        "near": settings.near,
        "largest_near": min(nears, default=0.0) or None,
        "tolerance_px": TOLERANCE_PX,
        "contrast": contrast,
        "sub_apertures": None if None in counts else max(filter(None, counts), default=1),
        "cuts": settings.slabs,
        "band_errors": [{"sub_apertures": n, "levels": levels(n)} for n in EXAMPLE_SUB_APERTURES],
    }


def _time(found: Cost | None) -> str:
    """Write a cost, or the interval of its repetitions where it cannot be told from nothing."""
    if found is None or found["resolved"]:
        return "-" if found is None else _duration(found["seconds"])
    return f"not told ({' to '.join(map(_duration, found['interval']))})"


def _points(count: int | None) -> str:
    return "over 65,536" if count is None else f"{count:,}"


def _duration(seconds: float) -> str:
    return f"{digits(seconds)} s" if abs(seconds) >= 1 else f"{digits(1e3 * seconds)} ms"


def viewer_record(scene: Scene, distance: float, settings: DoubleFrustum) -> dict[str, Any]:
    """Return what a display can show to a viewer at a distance, and whether a near offset is seen there.

    The key `viewer` of `explain --viewer --json`. All surfaces within the reach count, as if every
    one were seen; InputError where one lies behind the viewer.
    """
    # Eyes are measured with the reference, which takes longer to load than all the rest takes to
    # answer.
    from xfrustum.compare.eye import noticeable  # noqa: PLC0415
    from xfrustum.compare.planning.viewer import CRACK, STEREO, ViewerRequirement, binding  # noqa: PLC0415

    viewer, display = noticeable.Viewer(distance=distance), noticeable.Display.from_scene(scene)
    content = noticeable.surface_content(scene)
    noticeable.require_before_viewer(scene, content, viewer)
    requirement = ViewerRequirement(viewer=viewer, display=display, content=content)
    found, noticed = requirement.limits_with(settings), requirement.noticed(settings)
    binds = binding(found)
    return {
        "limits": noticeable.display_limits(scene, viewer),
        "near": settings.near,
        "near_limits": found,
        "largest_unseen_near": math.inf if binds is None else binds.largest_near,
        "stereo_change_arcsec": noticed[STEREO][0] if STEREO in noticed else None,
        "crack_arcmin": noticed[CRACK][0] if CRACK in noticed else None,
        "seen": any(there > allowed for there, allowed, _ in noticed.values()),
        "bent": scene.frustum.recentered,
    }


def viewer_table(record: dict[str, Any], units: str) -> str:
    """Return the same as lines of text."""

    def depth(value: float) -> str:
        return "any depth" if math.isinf(value) else f"{digits(value)} {units}"

    values = {**record, "units": units, "inf": math.inf}
    return plain_text("explain-viewer.txt.j2", values, {"depth": depth}).removesuffix("\n")
