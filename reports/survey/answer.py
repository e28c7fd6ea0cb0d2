"""The answer of a survey: counts and bounds for each setting, the sentence, the JSON object, and the page."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.compare.sampling import CONFIDENCE, risk_of_claim, share_beyond, share_beyond_at_least
from xfrustum.reports import inspection
from xfrustum.reports.common.figure_style import Figure as Plot
from xfrustum.reports.common.figure_style import log_axis, look, styled
from xfrustum.reports.common.outputs import Staging, json_object
from xfrustum.reports.common.provenance import raster_command, versions
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.inspection import PlateMap
from xfrustum.reports.notebook import Figure, NotebookRepr, map_of, png
from xfrustum.reports.scout import MARK, mark, plate_map
from xfrustum.reports.survey import rows
from xfrustum.scenes import DoubleFrustum, Scene
from xfrustum.scenes.representation import digits, percent


@dataclass(frozen=True, kw_only=True)
class Share:
    """Hogels beyond the tolerance with one setting, and the bound on their share of the plate, as written."""

    judged: int
    beyond: int
    empty: int  #: judged, not beyond, and show nothing
    share_beyond_at_most: float | None
    worst: rows.WorstHogel | None

    @property
    def record(self) -> dict[str, Any]:
        """The counts and the bound with the worst hogel, as they are written."""
        written = ("aperture", "displacement_p99_px", "surface_fraction")
        return {
            **vars(self),
            "worst": self.worst and {name: getattr(self.worst, name) for name in written},
        }

    @property
    def bound_words(self) -> str:
        """The bound in percent, rounded up; "-" where there is none."""
        return "-" if self.share_beyond_at_most is None else percent_up(self.share_beyond_at_most)

    @property
    def worst_words(self) -> str:
        """Column and row of the worst hogel; "-" where there is none."""
        return "-" if self.worst is None else "{},{}".format(*self.worst.aperture)


@dataclass(frozen=True, kw_only=True)
class Extent:
    """How many hogels were judged, and how they were chosen."""

    hogels: int  #: of the plate
    seeing: int  #: of these, those that were judged or sampled; all others surely show nothing
    judged: int
    look: int | None  #: number of the last look, from 0; None for the whole plate, or one sample
    seed: int | None  #: start of the random numbers; None where nothing was drawn at random
    complete: (
        bool  #: whether all hogels that were asked for are judged; with `--part`, they need not be
    )

    @property
    def everything(self) -> bool:
        """Whether every hogel of the plate was judged, or surely shows nothing."""
        return self.judged == self.seeing

    def bound(self, beyond: int, settings: int) -> float | None:
        """Return the bound on the share beyond, for all settings and looks together; None if incomplete."""
        if self.everything:
            return beyond / self.hogels
        if not self.complete:
            return None
        bound = share_beyond(beyond, self.judged, self.seeing, risk_of_claim(settings, self.look))
        return bound * self.seeing / self.hogels

    def decides(self, beyond: int, settings: int, limit: float) -> bool:
        """Return whether the share of one setting surely keeps a limit, or surely exceeds it.

        That a survey stops where a share surely exceeds the limit costs no risk: what is claimed
        are the upper bounds, and these hold at all looks together.
        """
        bound = self.bound(beyond, settings)
        if bound is None or self.everything or bound <= limit:
            return bound is not None
        risk = risk_of_claim(settings, self.look)
        least = share_beyond_at_least(beyond, self.judged, self.seeing, risk)
        return least * self.seeing / self.hogels > limit


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Survey(NotebookRepr):
    """What a survey has found."""

    scene: Scene
    settings: tuple[DoubleFrustum | None, ...]  #: a single None for a plate of another renderer
    tallies: tuple[rows.SettingStats, ...]  #: all rows of each setting
    extent: Extent
    tolerance_px: float  #: displacement beyond which a hogel is counted
    limit: float | None  #: largest share of such hogels, if one was asked for
    judged_by: str  #: limits that counted hogels exceed, in words
    workers: int
    wall_s: float

    @cached_property
    def shares(self) -> list[tuple[DoubleFrustum | None, Share]]:
        """Each setting with its counts and its bound."""
        shares = [
            Share(
                judged=tally.judged,
                beyond=tally.beyond,
                empty=tally.empty,
                share_beyond_at_most=self.extent.bound(tally.beyond, len(self.tallies)),
                worst=tally.worst[0] if tally.worst else None,
            )
            for tally in self.tallies
        ]
        return list(zip(self.settings, shares, strict=True))

    @cached_property
    def best(self) -> int:
        """Number of the setting with the fewest hogels beyond; of equals, with the least bad worst one."""
        bad = [(one.beyond, one.worst.badness if one.worst else 0.0) for _, one in self.shares]
        return bad.index(min(bad))

    @property
    def confidence(self) -> float:
        """Probability that all bounds hold; 1 where every hogel was judged."""
        return 1.0 if self.extent.everything else CONFIDENCE

    @property
    def decided(self) -> bool:
        """Whether every setting keeps the share that was asked for, if any, or surely exceeds it."""
        limit, several = self.limit, len(self.tallies)
        return limit is None or all(
            self.extent.decides(one.beyond, several, limit) for one in self.tallies
        )

    @property
    def exceeded(self) -> bool:
        """Whether the share that was asked for is exceeded, or, with none, any judged hogel is beyond."""
        share = self.shares[self.best][1]
        if self.limit is None:
            return share.beyond > 0
        return share.share_beyond_at_most is None or share.share_beyond_at_most > self.limit

    @property
    def sentence(self) -> str:
        """The answer in one sentence, for the best setting."""
        (chosen, share), extent, with_what = self.shares[self.best], self.extent, ""
        if chosen is not None and len(self.settings) > 1:
            with_what = f" with near {digits(chosen.near)}, the best of {len(self.settings)}"
        if extent.everything:
            part = f"{share.beyond:,} of the {extent.hogels:,} hogels ({percent(share.beyond / extent.hogels)})"
            said = f"{part} {'is' if share.beyond == 1 else 'are'} {self.judged_by}{with_what}"
        elif share.share_beyond_at_most is None:
            said = (
                f"{share.beyond:,} of the {extent.judged:,} hogels judged so far, of {extent.hogels:,}, "
                f"are {self.judged_by}{with_what}; the other parts are not finished"
            )
        else:
            said = (
                f"at most {share.bound_words} of the {extent.hogels:,} hogels are {self.judged_by} "
                f"({percent(self.confidence)}; {share.beyond:,} of {extent.judged:,} sampled){with_what}"
            )
        if extent.seeing < extent.hogels:
            said += f"; {extent.hogels - extent.seeing:,} hogels see nothing of the scene and are not judged"
        if share.empty:
            said += f"; {share.empty:,} of the {share.judged:,} judged show nothing, and of the "
            said += f"{share.judged - share.empty:,} others {share.beyond:,} are beyond"
        return f"{said}; worst by displacement: {share.worst_words}." if share.worst else f"{said}."

    def summary(self) -> dict[str, Any]:
        """Return what `survey --json` prints: counts of the best setting, then those of each in its order."""
        found = {
            "scene": self.scene.name,
            "hash": self.scene.content_hash,
            "hogels": self.extent.hogels,
            "seeing": self.extent.seeing,
            "resolution": self.scene.frustum.resolution,
            **self.shares[self.best][1].record,
            "confidence": self.confidence,
            "tolerance_px": self.tolerance_px,
            "limit": self.limit,
            "complete": self.extent.complete,
            "seed": self.extent.seed,
            "workers": self.workers,
            "wall_s": self.wall_s,
            "sentence": self.sentence,
            "settings": [{"settings": one, **share.record} for one, share in self.shares],
        }
        return json_object(found)

    def table(self) -> str:
        """Return the sentence, and each setting where there are several."""
        lines = [self.sentence]
        for one, share in self.shares if len(self.settings) > 1 else []:
            assert one is not None
            more = f" ({share.empty:,} show nothing)" if share.empty else ""
            more += "" if share.share_beyond_at_most is None else f", at most {share.bound_words}"
            lines.append(
                f"near {digits(one.near)}: {share.beyond:,} of {share.judged:,} beyond{more}"
            )
        return "\n".join(lines)

    def _said(self) -> str:
        return f"{self.scene.name!r}, {self.sentence}"

    def _figures(self) -> Sequence[Figure]:
        found = self.tallies[self.best].maps.get(rows.P99)
        if found is None or not np.isfinite(found).any():
            return ()
        largest = digits(float(np.nanmax(found)))
        caption = f"99th percentile of displacement over the plate, up to {largest} px; black: not judged, "
        caption += "or shows nothing"
        return (Figure(caption=caption, content=png(map_of(found))),)


def percent_up(share: float) -> str:
    """Return an upper bound in percent, rounded up to two digits."""
    if share <= 0 or share >= 1:
        return f"{100 * share:.0f} %"
    step = 10.0 ** (math.floor(math.log10(100 * share)) - 1)
    # A share that is a number of two digits but for rounding stays that number.
    return f"{min(math.ceil(100 * share / step - 1e-9) * step, 100.0):.3g} %"


FILES = PAGE, DATA, INSPECTION = "index.html", "survey.json", inspection.PAGE

MARKED_HOGELS = 3  # of the worst, on the map of displacement: more would cover it
DISTRIBUTION_MARGIN = (
    3.0  # by which the axis of displacement reaches beyond the smallest and largest value
)

Pictured = Sequence[tuple[rows.WorstHogel, rows.ShownHogel]]  # the worst hogels with their pictures


def write_survey(found: Survey, pictured: Pictured, out: Path) -> tuple[Path, ...]:
    """Write the page, the JSON object and the inspection page, all or nothing."""
    with Staging(out, FILES) as staging:
        staging.write(PAGE, render_page(found, pictured))
        staging.write(DATA, found.summary())
        settings, maps = found.settings[found.best], found.tallies[found.best].maps
        name = next((one for one in (rows.P99, rows.SURFACE, rows.FRACTION) if one in maps), None)
        drawn = (
            "images"
            if settings is None
            else f"near {digits(settings.near)}, {settings.depth_label}"
        )
        inspected = inspection.Inspection(
            command="survey",
            scene=found.scene,
            told=f"The worst of the {found.extent.judged:,} hogels that were judged: {drawn}.",
            hogels=[one.inspected for _, one in pictured if one.inspected is not None],
            plate_map=PlateMap(words=words_of(name).capitalize(), cells=maps[name])
            if name
            else PlateMap.from_values(found.scene.plate, "", ()),
        )
        inspection.write_inspection(staging.folder, inspected)
        with inspection.replacing_inspection(out):
            return staging.commit()


def render_page(found: Survey, pictured: Pictured) -> str:
    """Return one HTML document that needs nothing else; of the same rows, always the same."""
    scene, settings, command = found.scene, found.settings[found.best], None
    maps = {f"map-{number}": figure for number, figure in enumerate(map_figures(found))}
    drawn = {**maps, "distribution": distribution_figure(found), "depth": depth_figure(found)}
    if settings is not None and pictured:
        command = raster_command(scene, scene.plate.aperture(*pictured[0][0].aperture), settings)
    values = {
        "found": found,
        "pictured": pictured,
        "maps": list(maps),
        "figures": {name: figure for name, figure in drawn.items() if figure is not None},
        "command": command,
        "versions": versions(),
    }
    return html_page("survey.html.j2", values)


def map_figures(found: Survey) -> list[Plot]:
    """Draw each measure of the best setting that is not zero everywhere over the plate."""
    tally = found.tallies[found.best]
    figures = []
    for name, values in tally.maps.items():
        if np.nanmax(values, initial=0.0) > 0:
            words = words_of(name) + (f", {found.scene.units}" if name == "height_rms" else "")
            moved = name == rows.P99
            figure = plate_map(
                found.scene.plate, values, words, known=tally.looked, logarithmic=moved
            )
            if moved:
                worst = [(one.aperture, "one of the worst") for one in tally.worst[:MARKED_HOGELS]]
                mark(figure, found.scene.plate, worst, labels=1)
            figures.append(figure)
    return figures


def words_of(column: str) -> str:
    """Return a column in words: those of causes by their names."""
    if column in rows.MAP_COLUMNS:
        return rows.MAP_COLUMNS[column]
    cause = column.removeprefix("cause_").removesuffix("_surface").replace("_", " ")
    return f"wrong surfaces by {cause}, pixels"


def distribution_figure(found: Survey) -> Plot:
    """Draw the share of hogels that are displaced by more than each tolerance, a curve for each setting."""
    shown, lines = [found.tolerance_px], []
    for number, (settings, tally) in enumerate(zip(found.settings, found.tallies, strict=True)):
        tolerances, shares = tally.share_beyond()
        shown += [*tolerances[:1], *tolerances[-1:]]
        line = {"color": look(number)[0], "shape": "hv"}
        name = "image" if settings is None else f"near {digits(settings.near)}"
        lines.append({"x": tolerances, "y": shares, "mode": "lines", "line": line, "name": name})
    low, high = min(shown) / DISTRIBUTION_MARGIN, max(shown) * DISTRIBUTION_MARGIN
    tolerance = {
        "type": "line",
        "x0": found.tolerance_px,
        "x1": found.tolerance_px,
        "yref": "y domain",
    }
    layout = {
        "height": 380,
        "xaxis": {
            "title": "displacement (p99), px",
            "range": [np.log10(low), np.log10(high)],
            **log_axis([low, high]),
        },
        "yaxis": {
            "title": "share of judged hogels beyond",
            "tickformat": ".0%",
            "rangemode": "tozero",
        },
        "shapes": [{**tolerance, "y0": 0, "y1": 1, "line": {"color": MARK, "dash": "dot"}}],
    }
    return styled(lines, layout)


def depth_figure(found: Survey) -> Plot | None:
    """Draw displacement by depth of content, rms and largest; None where nothing was measured by depth."""
    if not any(tally.depth_pixels.any() for tally in found.tallies):
        return None
    reach, lines, drawn = found.scene.frustum.longest_reach, [], list[float]()
    names = [
        f"{digits(low * reach)}-{digits(high * reach)}" for low, high in pairwise(rows.DEPTH_ENDS)
    ]
    for number, (settings, tally) in enumerate(zip(found.settings, found.tallies, strict=True)):
        color, marker = look(number)
        label = (
            ""
            if settings is None or len(found.settings) == 1
            else f"near {digits(settings.near)}: "
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            rms = np.sqrt(tally.depth_squares_px2 / tally.depth_pixels)
        curves = ("rms", rms, "solid"), ("largest", tally.depth_max_px, "dot")
        for word, values, dash in curves:
            shown = zip(values.tolist(), tally.depth_pixels > 0, strict=True)
            heights = [value if is_shown and value > 0 else None for value, is_shown in shown]
            drawn += filter(None, heights)
            lines.append(
                {
                    "x": names,
                    "y": heights,
                    "mode": "lines+markers",
                    "marker": {"symbol": marker},
                    "line": {"color": color, "dash": dash},
                    "name": f"{label}{word}",
                }
            )
    layout = {
        "height": 380,
        "xaxis": {"title": f"|z| of the content, {found.scene.units}", "type": "category"},
        "yaxis": {"title": "displacement, px", **log_axis(drawn)},
    }
    return styled(lines, layout)
