"""What the rows of the study of viewers say: thresholds, counts, and replays beside closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.eye.limits import STEREO_ACUITY_ARCSEC, Viewer
from xfrustum.reports.noticeable_study.grid import DepthBuffer
from xfrustum.reports.noticeable_study.rows import NoticedRow, decisive
from xfrustum.reports.noticeable_study.rule import Kept, kept, safe_near, sheared_limits
from xfrustum.scenes.plate.double_frustum import Pivot
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX

Rows = Sequence[NoticedRow]

SEEN_ARCSEC = 1.0
"""Change of disparity from which on replay and closed form are compared: a twentieth of stereo acuity."""


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """Largest nears of one scene and pivot that are not noticed, mm; None where the smallest near is.

    Attributes
    ----------
    scene, pivot
        What is looked at.
    stereo
        By distance.
    crack
        By pitch and distance; infinite where no near of the study is noticed, None without such a surface.
    pixels_worst, pixels_median
        Largest near at which the worst and the median hogel are displaced by half a pixel.
    """

    scene: str
    pivot: Pivot
    stereo: dict[float, float | None]
    crack: dict[tuple[float, float], float | None] | None
    pixels_worst: float | None
    pixels_median: float | None

    @property
    def least_crack(self) -> float | None:
        """Smallest of the nears at which cracks are noticed; None where that is below all of the study's."""
        nears = list((self.crack or {}).values())
        known = [near for near in nears if near is not None]
        return None if len(known) < len(nears) else min(known, default=math.inf)


def largest_near(
    rows: Rows, value: Callable[[NoticedRow], float | None], limit: Callable[[NoticedRow], float]
) -> float | None:
    """Return the near at which a value that grows with near reaches its limit, between rows on log scales.

    None where the smallest near is beyond it already, infinite where the largest is not.
    """
    line = sorted({row.near: row for row in rows}.values(), key=lambda row: row.near)
    ratios = [math.inf if (found := value(row)) is None else found / limit(row) for row in line]
    if ratios[0] > 1:
        return None
    for low, high, below, above in zip(line, line[1:], ratios, ratios[1:], strict=False):
        if above > 1:
            if math.isinf(above) or below == 0:
                return low.near
            share = -math.log(below) / math.log(above / below)
            return math.exp((1 - share) * math.log(low.near) + share * math.log(high.near))
    return math.inf


def thresholds(rows: Rows) -> list[Thresholds]:
    """Return the thresholds of every scene and pivot."""
    found = []
    for scene, pivot in dict.fromkeys((row.scene, row.pivot) for row in rows):
        own = [row for row in rows if (row.scene, row.pivot) == (scene, pivot)]
        distances = dict.fromkeys(row.distance for row in own)
        pitches = dict.fromkeys(row.pitch for row in own)
        crack = None
        if own[0].crack_arcmin is not None:
            crack = {
                (pitch, distance): largest_near(
                    [row for row in own if (row.pitch, row.distance) == (pitch, distance)],
                    lambda row: row.crack_arcmin,
                    lambda row: row.crack_hidden_arcmin,
                )
                for pitch in pitches
                for distance in distances
            }
        found.append(
            Thresholds(
                scene=scene,
                pivot=pivot,
                stereo={
                    distance: largest_near(
                        [row for row in own if row.distance == distance],
                        lambda row: row.stereo_arcsec,
                        lambda row: STEREO_ACUITY_ARCSEC,
                    )
                    for distance in distances
                },
                crack=crack,
                pixels_worst=largest_near(own, lambda row: row.pixels_worst, lambda row: TOLERANCE_PX),
                pixels_median=largest_near(own, lambda row: row.pixels_median, lambda row: TOLERANCE_PX),
            )
        )
    return found


def rule_near(distance: float) -> float:
    """Return the largest near whose gap at the plate changes disparity by no more than stereo acuity, mm."""
    viewer = Viewer(distance=distance)
    disparity = math.radians(viewer.stereo_acuity_arcsec / 3600)
    return (
        disparity
        * distance**2
        / (viewer.eyes_apart_mm + math.hypot(viewer.eyes_apart_mm, disparity * distance))
    )


@dataclass(frozen=True, kw_only=True)
class Replays:
    """Replays beside closed forms.

    Attributes
    ----------
    count
        Number of cells that were replayed.
    lowest, highest
        Smallest and largest ratio of the replayed change of disparity to the closed form, where this is at
        least `SEEN_ARCSEC`.
    compared
        Number of cells in that comparison.
    unseen, most_unseen
        Number of replays whose near is below the limit of stereo, and the largest change among them, arc
        seconds.
    seen, least_seen
        Number of the others, and the smallest change among them.
    depth_wrong
        Largest share of pixels wrong by depth, for each depth buffer.
    fewest_pixels, most_pixels
        Smallest and largest number of judged pixels of both eyes in a replay.
    """

    count: int
    lowest: float
    highest: float
    compared: int
    unseen: int
    most_unseen: float
    seen: int
    least_seen: float
    depth_wrong: dict[DepthBuffer, float]
    fewest_pixels: int
    most_pixels: int


def replays(rows: Rows) -> Replays:
    """Return how replays and closed forms agree."""
    own = [row for row in rows if row.replayed_stereo_arcsec is not None]
    change = {row: row.replayed_stereo_arcsec or 0.0 for row in own}
    ratios = [change[row] / row.stereo_arcsec for row in own if row.stereo_arcsec >= SEEN_ARCSEC]
    below = [change[row] for row in own if not row.stereo_seen]
    above = [change[row] for row in own if row.stereo_seen]
    wrong: dict[DepthBuffer, float] = {}
    for row in own:
        share = row.replayed_depth_wrong or 0.0
        wrong[row.buffer] = max(wrong.get(row.buffer, 0.0), share)
    return Replays(
        count=len(own),
        lowest=min(ratios, default=math.nan),
        highest=max(ratios, default=math.nan),
        compared=len(ratios),
        unseen=len(below),
        most_unseen=max(below, default=0.0),
        seen=len(above),
        least_seen=min(above, default=math.nan),
        depth_wrong=wrong,
        fewest_pixels=min((row.replayed_pixels or 0 for row in own), default=0),
        most_pixels=max((row.replayed_pixels or 0 for row in own), default=0),
    )


@dataclass(frozen=True, kw_only=True)
class Windows:
    """Cases of one depth buffer in which one pair of frusta is enough: for an eye, and for pixels.

    Attributes
    ----------
    buffer
        Format and mapping.
    eye, eye_cases
        Cases in which a replay at some near of the study shows nothing to be noticed, of all scenes, pivots,
        pitches and distances.
    replayed
        Cases that were replayed at the largest near whose offset is not noticed.
    certain
        Those counted by `eye` in which also the exact bound of the share that is wrong by depth is allowed.
    pixels, pixel_cases
        Cases in which `plan` would be content with some near, of all scenes and pivots.
    starved_below
        Largest near of the study at which depth is noticed, over all cases; None where it never is.
    """

    buffer: DepthBuffer
    eye: int
    eye_cases: int
    replayed: int
    certain: int
    pixels: int
    pixel_cases: int
    starved_below: float | None

    @property
    def never_split(self) -> bool:
        """Whether one pair of frusta is enough for an eye in all cases."""
        return self.eye == self.eye_cases

    @property
    def always_split(self) -> bool:
        """Whether no replay of this depth buffer left nothing to notice."""
        return self.eye == 0


def windows(rows: Rows) -> list[Windows]:
    """Return where one pair of frusta is enough, by depth buffer."""
    found = []
    for buffer in dict.fromkeys(row.buffer for row in rows):
        own = [row for row in rows if row.buffer == buffer]
        pixels = dict.fromkeys(((row.scene, row.pivot) for row in own), False)
        for row in own:
            pixels[row.scene, row.pivot] |= row.right_in_pixels
        unnoticed = [
            row
            for row in own
            if row.is_replayed
            and not row.noticed
            and (row.replayed_stereo_arcsec or 0.0) <= STEREO_ACUITY_ARCSEC
        ]
        found.append(
            Windows(
                buffer=buffer,
                eye=len({row.case for row in unnoticed}),
                eye_cases=len({row.case for row in own}),
                replayed=len({own[index].case for index in decisive(own) if own[index].is_replayed}),
                certain=len({r.case for r in unnoticed if r.depth_wrong_at_most <= MAX_DEPTH_WRONG}),
                pixels=sum(pixels.values()),
                pixel_cases=len(pixels),
                starved_below=max((row.near for row in own if row.depth_seen), default=None),
            )
        )
    return found


@dataclass(frozen=True, kw_only=True)
class Disagreement:
    """Where hogels' pixels and eyes disagree.

    Attributes
    ----------
    pixels_only, eyes_only, both, neither
        Number of cells by where the near offset shows: more than half a pixel at the worst hogel, or depth
        or crack at an eye.
    example
        The cell that no eye notices in which most hogels are displaced too much; None where there is none.
    hogel_cases
        Number of scenes, pivots and nears: displacement of hogels depends on nothing else.
    places
        Number of pitches and distances, in each of which these are set before eyes.
    displaced, unseen_somewhere, unseen_everywhere
        Number of hogel cases whose worst hogel is displaced too much; of those that no eye notices at some
        place; and of those that no eye notices at any.
    """

    pixels_only: int
    eyes_only: int
    both: int
    neither: int
    example: NoticedRow | None
    hogel_cases: int
    places: int
    displaced: int
    unseen_somewhere: int
    unseen_everywhere: int


def disagreement(rows: Rows) -> Disagreement:
    """Return where hogels' pixels and eyes disagree about near; depth buffers play no part."""
    own = list({(r.scene, r.pivot, r.pitch, r.distance, r.near): r for r in rows}.values())
    eyes = {row: row.stereo_seen or row.crack_seen for row in own}
    moved = {row: row.pixels_worst is None or row.pixels_worst > TOLERANCE_PX for row in own}
    unseen = [row for row in own if moved[row] and not eyes[row]]

    def hogels(some: Iterable[NoticedRow]) -> set[tuple[str, Pivot, float]]:
        return {(row.scene, row.pivot, row.near) for row in some}

    displaced = hogels(row for row in own if moved[row])
    return Disagreement(
        pixels_only=len(unseen),
        eyes_only=sum(eyes[row] and not moved[row] for row in own),
        both=sum(eyes[row] and moved[row] for row in own),
        neither=sum(not eyes[row] and not moved[row] for row in own),
        example=max(unseen, key=lambda row: (row.pixels_beyond, row.pixels_median or math.inf), default=None),
        hogel_cases=len(hogels(own)),
        places=len({(row.pitch, row.distance) for row in own}),
        displaced=len(displaced),
        unseen_somewhere=len(hogels(unseen)),
        unseen_everywhere=len(displaced - hogels(row for row in own if eyes[row])),
    )


@dataclass(frozen=True, kw_only=True)
class Quarter:
    """The rule that near be at most a quarter of the pitch, at one distance.

    Attributes
    ----------
    distance
        Distance of the viewer, mm.
    near
        Largest near that is not noticed at the plate, mm.
    pitch
        Largest pitch at which a quarter of it is not noticed, mm.
    kept, failed
        Number of cells that keep the rule, and number of those in which the viewer notices the offset.
    """

    distance: float
    near: float
    pitch: float
    kept: int
    failed: int


def quarters(rows: Rows) -> list[Quarter]:
    """Return how the rule does at every distance."""
    found = []
    for distance in sorted({row.distance for row in rows}):
        own = {
            (row.scene, row.pivot, row.pitch, row.near): row
            for row in rows
            if row.distance == distance and row.near <= row.pitch / 4
        }
        near = rule_near(distance)
        found.append(
            Quarter(
                distance=distance,
                near=near,
                pitch=4 * near,
                kept=len(own),
                failed=sum(row.stereo_seen or row.crack_seen for row in own.values()),
            )
        )
    return found


def shear_factor(rows: Rows) -> dict[str, tuple[float, float]]:
    """Return, by scene, the range of changes with pivot `aperture` over those with pivot `camera`."""
    found: dict[str, tuple[float, float]] = {}
    pairs = {(r.scene, r.pitch, r.distance, r.near, r.buffer, r.pivot): r.stereo_arcsec for r in rows}
    for scene in dict.fromkeys(row.scene for row in rows if row.pivot is Pivot.CAMERA):
        ratios = [
            change / pairs[(*key[:5], Pivot.CAMERA)]
            for key, change in pairs.items()
            if key[0] == scene and key[5] is Pivot.APERTURE and math.isfinite(change)
        ]
        finite = [ratio for ratio in ratios if np.isfinite(ratio)]
        found[scene] = min(finite), max(finite)
    return found


def kept_rule(rows: Rows) -> tuple[Kept, Kept, tuple[float, float] | None]:
    """Return how the rule does without shear and with it, and the limits with shear over the rule's."""
    sheared = {(row.scene, row.pivot) for row in rows if row.sheared}
    limits = [
        (one.scene, distance, near)
        for one in thresholds(rows)
        if (one.scene, one.pivot) in sheared
        for distance, near in one.stereo.items()
        if near is not None
    ]
    return kept(rows, sheared=False), kept(rows, sheared=True), sheared_limits(rows, limits)


def rule_of_scenes(rows: Rows) -> list[tuple[str, dict[float, float]]]:
    """Return the near of the rule at each distance, for every scene with surfaces before the plate, mm."""
    found: dict[str, dict[float, float]] = {}
    for row in rows:
        if row.nearest_distance < row.distance:
            near = safe_near(row.distance, row.nearest_distance)
            found.setdefault(row.scene, {})[row.distance] = near
    return list(found.items())


def crack_alone(rows: Rows) -> list[str]:
    """Return where a viewer notices the crack, and not the change of depth: scene, pivot, near, distance."""
    found = {
        (row.scene, row.pivot, row.near, row.distance)
        for row in rows
        if row.crack_seen and not row.stereo_seen
    }
    return [
        f"`{scene}`, pivot `{pivot}`, n = {near:g} mm from {distance:g} mm"
        for scene, pivot, near, distance in sorted(found)
    ]


def replay_ratios(rows: Rows) -> dict[str, tuple[float, float, int]]:
    """Return, by scene and pivot, the range of replayed changes over closed forms, and how many there are."""
    found: dict[str, list[float]] = {}
    for row in rows:
        if row.replayed_stereo_arcsec is not None and row.stereo_arcsec >= SEEN_ARCSEC:
            ratio = row.replayed_stereo_arcsec / row.stereo_arcsec
            found.setdefault(f"{row.scene}, {row.pivot}", []).append(ratio)
    return {case: (min(ratios), max(ratios), len(ratios)) for case, ratios in found.items()}


def hopeful(rows: Rows) -> dict[DepthBuffer, int]:
    """Return in how many replays more is wrong by depth than is allowed, though sheets are ordered."""
    found: dict[DepthBuffer, int] = {}
    for row in rows:
        ordered = row.ordered_separation <= row.resolved_separation
        if ordered and (row.replayed_depth_wrong or 0.0) > MAX_DEPTH_WRONG:
            found[row.buffer] = found.get(row.buffer, 0) + 1
    return found


def usual_distance(rows: Rows, wanted: float) -> float:
    """Return the distance of the study that is nearest to a wanted one, mm."""
    return min({row.distance for row in rows}, key=lambda distance: abs(distance - wanted))


def rule_metres() -> float:
    """Return L^2/n of the rule, meters: the rule without its small second-order term."""
    viewer = Viewer(distance=1.0)
    return 2 * viewer.eyes_apart_mm / math.radians(viewer.stereo_acuity_arcsec / 3600) / 1000


@dataclass(frozen=True, kw_only=True)
class DepthLimit:
    """What a depth buffer and a viewer tell apart at the farthest surfaces of one scene, at one distance.

    Attributes
    ----------
    scene, distance
        What is looked at, and from where, mm.
    resolved, resolved_by
        Smallest separation that is told apart at the middle pitch, mm, and what limits it.
    asked
        Separation that `plan` asks for without a viewer, mm.
    nears
        By depth buffer: smallest near of the study at which what the viewer tells apart is ordered, mm; None
        where none is.
    """

    scene: str
    distance: float
    resolved: float
    resolved_by: str
    asked: float
    nears: dict[DepthBuffer, float | None]


def depth_limits(rows: Rows) -> list[DepthLimit]:
    """Return the limits of depth of every scene at every distance, at the middle pitch."""
    pitches = sorted({row.pitch for row in rows})
    found = []
    middle = [row for row in rows if row.pitch == pitches[len(pitches) // 2]]
    for scene, distance in dict.fromkeys((row.scene, row.distance) for row in middle):
        own = [row for row in middle if (row.scene, row.distance) == (scene, distance)]
        nears: dict[DepthBuffer, float | None] = {}
        for buffer in dict.fromkeys(row.buffer for row in own):
            ordered = [
                row.near
                for row in own
                if row.buffer == buffer and row.ordered_separation <= row.resolved_separation
            ]
            nears[buffer] = min(ordered, default=None)
        found.append(
            DepthLimit(
                scene=scene,
                distance=distance,
                resolved=own[0].resolved_separation,
                resolved_by=own[0].resolved_by,
                asked=own[0].asked_separation,
                nears=nears,
            )
        )
    return found
