"""Sentences of an error report: the recommendation, and the causes that dominate."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby

from xfrustum.compare.beyond import is_beyond
from xfrustum.compare.prediction.chain import CULLING, LINKS
from xfrustum.reference.alone import CERTIFIED
from xfrustum.reports.common.provenance import scene_command
from xfrustum.reports.error_report.best import (
    DISPLACEMENT_TIE_PX,
    SURFACE_TIE_FRACTION,
    Measurement,
    Recommendation,
    Window,
    best_setting,
    can_be_judged,
    equally_good,
    grouped,
)
from xfrustum.reports.error_report.light import LightReport
from xfrustum.reports.error_report.request import GEOMETRY, geometries_of, geometry_of
from xfrustum.reports.error_report.sweep import LEFT_OUT, Sweep
from xfrustum.scenes import DoubleFrustum, Offset, Pivot
from xfrustum.scenes.representation import counted, digits, percent, plain
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

#: largest number of hogels that the recommendation names
MAX_NAMED_HOGELS = 5


CAUSE_WORDS = {
    "near offset": "the near offset",
    "pivot": "the shear about the wrong point",
    "fit": "the fit",
    "slabs": "the cuts into slabs",
    CULLING: "culling",
    "rasterization": "rasterization",
    "depth": "the depth buffer",
}
"""Phrases for the causes."""


def cause_words(row: Measurement, name: str) -> str:
    """Return the phrase for a cause; without an offset the first link is the gap."""
    # Cameras in the aperture displace nothing, but their near planes clip a gap at the plate.
    if name == LINKS[0] and row.settings.offset is Offset.NONE:
        return "the gap at the plate"
    return CAUSE_WORDS[name]


def geometry_names(geometries: Sequence[DoubleFrustum]) -> dict[DoubleFrustum, str]:
    """Return a distinct name of each geometry.

    A single geometry is named by its unusual parts, such as `pivot camera, no offset`, if any.
    """
    varied = [
        name for name in GEOMETRY if len({getattr(geometry, name) for geometry in geometries}) > 1
    ]
    # Any near will do: only the geometry is compared.
    usual = DoubleFrustum(near=1.0)

    def words(geometry: DoubleFrustum) -> Iterator[str]:
        heights = " and ".join(map(digits, geometry.slabs))
        fit = digits(geometry.fit) if isinstance(geometry.fit, float) else geometry.fit
        phrases = {
            "pivot": f"pivot {geometry.pivot}",
            "fit": f"fit {fit}",
            "offset": "no offset" if geometry.offset is Offset.NONE else "offset to the plate",
            "slabs": f"cuts at {heights}" if heights else "no cuts",
        }
        for name in GEOMETRY:
            if name in varied or (not varied and getattr(geometry, name) != getattr(usual, name)):
                yield "usual fit" if name == "fit" and geometry.fit is None else phrases[name]

    return {geometry: ", ".join(words(geometry)) for geometry in geometries}


def recommendation(
    rows: Sequence[Measurement], units: str, reach: float, *, recentered: bool = True
) -> str:
    """Return the recommendation: the best near planes and depth buffer, with their errors.

    `units` and `reach` are the scene's length unit, and its larger reach in it. The pivot of a
    frustum that is not recentered, hence not sheared, changes nothing and is not named.
    """
    # Unique indices in the order of measurement.
    indices = dict.fromkeys(row.aperture.index for row in rows)
    named = "; ".join(f"{column},{row}" for column, row in list(indices)[:MAX_NAMED_HOGELS])
    named += "; .." if len(indices) > MAX_NAMED_HOGELS else ""
    where = f"At hogel {named}:" if len(indices) == 1 else f"At {len(indices)} hogels ({named}):"
    if not any(row.comparison.judged for row in rows):
        return f"{where} nothing can be judged: every pixel of the truth is a tie."
    if not can_be_judged(rows):
        return (
            f"{where} there is nothing to judge: "
            "neither the truth nor any raster image shows a surface."
        )
    best = best_setting(rows)

    # The cameras, where there are others or they are not the usual ones.
    geometries = geometries_of(
        row.settings if recentered else replace(row.settings, pivot=Pivot.APERTURE) for row in rows
    )
    own = best.settings if recentered else replace(best.settings, pivot=Pivot.APERTURE)
    name = geometry_names(geometries)[geometry_of(own)]
    cameras = f" and {name}" if name else ""

    nears, near = best.window.nears, digits(best.settings.near)
    equally = f"; the {nears} nears measured there are equally good. At {near} {units}, "
    colors = ""
    if best.radiance_fraction is not None:
        colors = f"{percent(best.radiance_fraction)} are off in color by more than a level of 255, "
    elsewhere = gap = ""
    # The gap is no displacement and no wrong surface where it is empty: the errors do not show it.
    if best.settings.offset is Offset.NONE:
        gap = (
            " The cameras stay in the aperture and clip all that is closer than near: a gap of "
            f"{near} {units} on each side of the plate."
        )
    if best.displaced_aperture != best.aperture and best.displacement_p99_px > DISPLACEMENT_TIE_PX:
        elsewhere = (
            f" (the worst at {best.displaced_aperture.column},{best.displaced_aperture.row})"
        )
    return (
        f"{where} {_praise(best, rows)} near {near_range(best.window)} {units} "
        f"({near_range(best.window, reach)} of the reach) "
        f"with {best.settings.depth_label} depth{cameras}"
        f"{equally if nears > 1 else '. '}{_wrong(best, rows)}, {colors}"
        f"and {where_it_lies(best.displacement_p99_px)}{elsewhere}.{gap}"
    )


def _praise(best: Recommendation, rows: Sequence[Measurement]) -> str:
    """Return the rating of the best setting by the tolerances."""
    limits = f"{TOLERANCE_PX:g} px and {percent(MAX_WRONG)} wrong surfaces"
    every = {row.settings for row in rows}
    kept = every - {
        row.settings
        for row in rows
        if is_beyond(row.displacement_p99_px, row.surface_fraction, TOLERANCE_PX)
    }
    if best.settings in kept:
        return "the one setting measured:" if len(every) == 1 else f"best of {len(every)} settings:"
    # A single setting has no rank, only compliance.
    if len(every) == 1:
        return f"the one setting measured does not keep to {limits}:"
    if not kept:
        return f"no setting measured keeps to {limits}. The least bad of {len(every)}:"
    return f"best of {len(every)} settings by wrong surfaces, though only others keep to {limits}:"


def _wrong(best: Recommendation, rows: Sequence[Measurement]) -> str:
    """Return the share of wrong surfaces, its aperture, and the cause if one prevails."""
    apertures = len({row.aperture for row in rows})
    place = f"{best.aperture.column},{best.aperture.row}"
    where = f" at the worst of {apertures} apertures ({place})" if apertures > 1 else ""
    share = f"{percent(best.surface_fraction)} of the judged pixels show the wrong surface{where}"
    worst = next(
        row for row in rows if row.settings == best.settings and row.aperture == best.aperture
    )
    # A cause is named only with a majority of the wrong pixels; otherwise the name misleads.
    most = max(worst.causes, key=lambda cause: cause.surface, default=None)
    wrong = sum(cause.surface for cause in worst.causes)
    if best.surface_fraction <= SURFACE_TIE_FRACTION or most is None or 2 * most.surface <= wrong:
        return share
    return f"{share}, most of them by {cause_words(worst, most.name)}"


def near_range(window: Window, unit: float = 1.0) -> str:
    """Write a window, in multiples of a length."""
    if window.nears == 1:
        return digits(window.low / unit)
    return f"{digits(window.low / unit)} to {digits(window.high / unit)}"


def where_it_lies(displacement_p99_px: float) -> str:
    """Return the displacement of 99 % of the picture as a clause."""
    if math.isinf(displacement_p99_px):
        return (
            "where the picture belongs is undefined, "
            "for much of it shows a surface in the plate itself"
        )
    return f"99 % of the picture lies within {pixels(displacement_p99_px)} of where it belongs"


def pixels(value: float) -> str:
    """Write a displacement with two digits; below `DISPLACEMENT_TIE_PX` they mean nothing."""
    # Rounding first: 99.6 is printed as 100, by the rule of large values.
    rounded = float(f"{max(value, DISPLACEMENT_TIE_PX):.2g}")
    return f"{rounded:,.0f} px" if rounded >= 100 else plain(f"{rounded:.2g} px")


def equally_good_sentence(rows: Sequence[Measurement]) -> str:
    """Return the number of equally good settings by depth buffer; empty for a single best."""
    good = equally_good(rows)
    if len(good) < 2 or not can_be_judged(rows):
        return ""
    counts = Counter(row.settings.depth_label for row in rows if row.settings in good)
    apertures = len({row.aperture for row in rows})
    # Each setting has a row per aperture.
    named = ", ".join(f"{count // apertures} of {label}" for label, count in counts.items())
    return (
        f"{len(good)} settings are equally good by error: {named}. "
        "xfrustum cost compares their times."
    )


def cause_sentences(rows: Sequence[Measurement], units: str) -> list[str]:
    """Return the dominant causes over near for each depth buffer of one aperture."""

    def dominant(row: Measurement) -> str:
        if row.surface_fraction <= SURFACE_TIE_FRACTION:
            return "hardly a surface is wrong"
        return (
            f"{cause_words(row, max(row.causes, key=lambda cause: cause.surface).name)} dominates"
        )

    def clauses(rows: Sequence[Measurement]) -> Iterator[str]:
        for what, run in groupby(sorted(rows, key=lambda row: row.settings.near), key=dominant):
            nears = [row.settings.near for row in run]
            where = f"from n = {digits(nears[0])} to" if len(nears) > 1 else "at n ="
            yield f"{where} {digits(nears[-1])} {units} {what}"

    groups = grouped(rows, lambda row: row.settings.depth_label)
    return [f"{group[0].settings.depth_label}: {'; '.join(clauses(group))}." for group in groups]


def coverage(sweep: Sweep) -> str:
    """Return the number of measured hogels and the command for all; empty where all are."""
    measured, hogels = len(sweep.apertures), math.prod(sweep.scene.plate.hogels)
    if measured >= hogels:
        return ""
    return (
        f"Measured at {measured:,} of {hogels:,} hogels, and others may need other settings: "
        f"{scene_command('plan', sweep.scene)} says what holds for the whole plate."
    )


def left_out(sweep: Sweep) -> str:
    """Name the parts that the options left out; empty where there are none."""
    if sweep.options.causes:
        return ""
    return (
        f"Left out, as asked for: {', '.join(LEFT_OUT[:-1])} and {LEFT_OUT[-1]}. Wrong pixels are "
        "counted and shown, and not explained."
    )


def cost(sweep: Sweep) -> str:
    """State the times that measuring took."""
    truths = counted(len(sweep.truths), "certified truth")
    if sweep.decided_by != CERTIFIED:
        truths = f"{counted(len(sweep.truths), 'picture')} by {sweep.decided_by} alone"
    frames, seconds = counted(len(sweep.rows), "raster frame"), sweep.times_s
    return (
        f"Measured in {sweep.wall_s:.2f} s of wall time, in which stages ran side by side: "
        f"{frames} with read-back {seconds['raster']:.2f} s, {truths} {seconds['trace']:.2f} s, "
        f"the page's pictures {seconds['pictures']:.2f} s."
    )


def missed_light(light: LightReport) -> Iterator[str]:
    """Yield the light that a rasterizer misses at each aperture."""
    width, height = light.scene.frustum.resolution
    for part in light.missed:
        numbers = part.numbers
        yield (
            f"Aperture {part.aperture.column},{part.aperture.row}: light transport changes "
            f"{numbers.pixels:,} pixels ({percent(numbers.pixels / (width * height))}), "
            f"{numbers.darker:,} of them to darker; rms {digits(numbers.rms)} in radiance, "
            f"after noise of {digits(numbers.rms_noise)} is taken off."
        )
