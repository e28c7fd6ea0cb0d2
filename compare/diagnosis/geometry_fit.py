"""Conventions and geometry of a renderer, from what its images claim: searched, fitted, bounded.

First come the discrete conventions: those under which claims fail least on average. Then the numbers of
`xfrustum.compare.renderer_model.parameters` are fitted by robust least squares, with as few groups of them
off their nominal values as suffice; other sets of groups that suffice as well are alternatives. Last comes
an interval for each number: all values under which no claim fails by more than the rounding of drawing.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from xfrustum.compare.diagnosis.claims import Claims
from xfrustum.compare.diagnosis.containment import outside_px
from xfrustum.compare.diagnosis.feasible import SNAP_PX, feasible_interval
from xfrustum.compare.diagnosis.starts import starting_points
from xfrustum.compare.renderer_model import parameters
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Fit, Pivot

MAX_SEARCHED_CLAIMS, MAX_FITTED_CLAIMS, MAX_BOUNDING_CLAIMS = 1200, 2500, 16000
"""Largest numbers of claims used by the search, by the fit and by the intervals. The search tries hundreds of
guesses and only ranks them; the fit needs more for its precision; the intervals are bounded by the few
claims nearest to an edge, and are computed once."""

MAX_MISPLACED_FRACTION = 0.01
"""Largest share of claims that may fail under the right guess: damaged pixels, and edges that a renderer's
anti-aliasing or rounding has moved. The noise of a guess is the distance that this share of claims
exceeds."""

NOISE_FACTOR = 2.0
"""Largest ratio of a simpler guess's noise to the best guess's noise at which the simpler one is as good: the
comparison has two noises of the same size, one from each guess."""

MAX_NOISE_PX = 1.0
"""Largest noise of a guess under which the claims hold, in pixels. A convention that is off by more than a
pixel explains no image."""

MIN_SPOILED_FRACTION = 0.1
"""Smallest share of a hogel's claims that fail by more than `MAX_NOISE_PX` at which the hogel is left out:
ten times the share that may fail under the right guess."""

MAX_SPOILED_HOGEL_FRACTION = 0.5
"""Largest share of the hogels that may be left out: a rule that holds in fewer than half of them is no
convention."""

USUAL_GROUPS = ("shift", "fov", "pitch", "near", *parameters.SCREEN_GROUPS)
"""Groups of parameters that are fitted first: where they suffice, fewer and better-conditioned numbers are
fitted."""

CAMERA_GROUPS = ("shift", "fov", "near")
"""Groups that one camera may have off nominal alone."""

MAX_GROUPS = 4
"""Largest number of groups that may be off nominal together; with more of them free, the fit follows
noise."""

MAX_SCREENED_CLAIMS = 600
"""Largest number of claims on which a guess is screened before it is fitted to all."""

SCREENING_FACTOR = 2.0
"""Largest ratio of a guess's noise on the screened claims to the limit for all claims: the noise of fewer
claims differs from that of all by about its own size."""

ATTRACTION_PX = 1.0
"""Largest failure of a claim that the first, rough fit counts by its square, in pixels: neighboring outlines
are about that far apart. Larger failures count linearly."""

MAX_SAMPLING_PX = 0.5 + parameters.SMALLEST_SHIFT_PX
"""Largest shift, in pixels, that is taken for a sampling point where a moved projection screen shows the same
images: a pixel is sampled within itself, and the rest is the size that a shift must have to be noticed."""

CORNER_PITCHES = 0.01
"""Largest distance from the corner of a hogel at which an aperture counts as being there, in pitches."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GeometryFit:
    """A guess about a renderer that was fitted to claims, with intervals and alternatives.

    Attributes
    ----------
    model
        The simplest guess under which the claims hold.
    low, high
        (P,) ends of the intervals of the guess's parameters; the nominal value where a parameter was not
        free.
    free
        Names of the groups that had to be off their nominal values.
    noise_px
        Largest distance by which a claim fails under the guess, the worst `MAX_MISPLACED_FRACTION` left out.
    alternatives
        Other guesses, as simple, with other groups off nominal, under which the claims hold as well.
    spoiled
        Column and row of the hogels that were left out, as their files are named.
    by_color
        Whether the guess rests on pictures, of colors or of objects, that were registered.
    by_objects
        Whether these pictures name objects, all of them, and have no colors.
    """

    model: DrawnModel
    low: Floats
    high: Floats
    free: tuple[str, ...]
    noise_px: float
    alternatives: tuple[DrawnModel, ...] = ()
    spoiled: frozenset[tuple[int, int]] = frozenset()
    by_color: bool = False
    by_objects: bool = False

    @property
    def holds(self) -> bool:
        """Whether the claims hold at all."""
        return self.noise_px <= MAX_NOISE_PX


def fit_geometry(claims: Claims, scene: Scene, nominal: DrawnModel) -> GeometryFit:
    """Find the simplest guess about conventions and geometry under which claims hold.

    Parameters
    ----------
    claims
        Claims of several hogels; a single hogel leaves order and pitch open.
    scene
        Scene that was to be drawn.
    nominal
        Model of the renderer by its author's statements; `DrawnModel()` where there are none.
    """
    few, some = claims.thinned(MAX_SEARCHED_CLAIMS), claims.thinned(MAX_FITTED_CLAIMS)
    found = _Found(model=nominal, free=(), alternatives=())
    spoiled: frozenset[tuple[int, int]] = frozenset()
    # Step 1: the nominal guess is often right or nearly right. The search is skipped where it is.
    if _noise(some, scene, nominal) > SNAP_PX:
        # Step 2: search the conventions, and try guesses with at most one group off nominal.
        starts = starting_points(few, scene, nominal)
        limit = NOISE_FACTOR * SNAP_PX
        one = _simplest(some, scene, nominal, starts, range(2), limit)
        if one is None:
            # Step 3: free everything, leave out spoiled hogels, and take the noise that remains as the limit
            # for the simplest guess.
            alone = [one for one in starts if one.one_camera is not None]
            plain = [one for one in starts if one.one_camera is None or one.one_camera.flipped]
            freest = _freest(few, scene, nominal, plain)
            claims, spoiled = _without_spoiled(claims, scene, freest)
            some = claims.thinned(MAX_FITTED_CLAIMS)
            freest = _fitted(some, scene, nominal, freest, _freest_groups(claims, scene))
            noise = _noise(some, scene, freest)
            if noise <= MAX_NOISE_PX:
                limit, counts = NOISE_FACTOR * max(noise, SNAP_PX), range(MAX_GROUPS + 1)
                one = _simplest(some, scene, nominal, [freest, *alone], counts, limit)
            starts = [freest, *starts]
        found = one or _least_wrong(some, scene, nominal, starts)
    # Step 4: an interval for each number that is off nominal.
    best = found.model
    noise = _noise(some, scene, best)
    index = [place for name in found.free for place in parameters.places(name)]
    values, low, high = feasible_interval(claims.thinned(MAX_BOUNDING_CLAIMS), scene, best, index, noise)
    return GeometryFit(
        model=best.with_parameters(values),
        low=low,
        high=high,
        free=found.free,
        noise_px=noise,
        alternatives=found.alternatives,
        spoiled=spoiled,
    )


@dataclass(frozen=True, kw_only=True)
class _Found:
    """A guess, its groups off nominal, and other guesses that are as simple and as good."""

    model: DrawnModel
    free: tuple[str, ...]
    alternatives: tuple[DrawnModel, ...]


def _without_spoiled(
    claims: Claims, scene: Scene, model: DrawnModel
) -> tuple[Claims, frozenset[tuple[int, int]]]:
    """Return the claims of the hogels in which nearly all claims hold, and the indices of the other hogels.

    One file of noise must not decide about the others. But where most hogels would be left out, the guess is
    wrong and not the hogels: then all are kept.
    """
    off = outside_px(claims, scene, model, np.inf) > MAX_NOISE_PX
    hogels, which = np.unique(claims.hogel, axis=0, return_inverse=True)
    which = which.reshape(-1)
    spoiled = np.bincount(which, off) / np.bincount(which) >= MIN_SPOILED_FRACTION
    if not spoiled.any() or spoiled.mean() > MAX_SPOILED_HOGEL_FRACTION:
        return claims, frozenset()
    return claims.chosen(~spoiled[which]), frozenset((int(i), int(j)) for i, j in hogels[spoiled])


def _noise(claims: Claims, scene: Scene, model: DrawnModel) -> float:
    """Return the distance, px, by which claims fail at most, `MAX_MISPLACED_FRACTION` of them left out."""
    outside = outside_px(claims, scene, model, max(claims.size))
    return float(np.quantile(outside, 1 - MAX_MISPLACED_FRACTION)) if len(outside) else 0.0


def _groups(claims: Claims, scene: Scene) -> tuple[str, ...]:
    """Return the groups that claims can determine.

    Claimed points move with the scene, and do not show it; a centered frustum has no projection screen.
    """
    unseen = {"scene-offset", "scene-scale"} if claims.of_points else set()
    if not scene.frustum.recentered:
        unseen |= set(parameters.SCREEN_GROUPS)
    return tuple(name for name in parameters.GROUP_NAMES if name not in unseen)


def _freest_groups(claims: Claims, scene: Scene) -> tuple[str, ...]:
    """Return the groups that are free together at first.

    Moving the apertures looks like moving the scene with the film: only one of the two is free.
    """
    groups = _groups(claims, scene)
    same = "aperture-offset" if "scene-offset" in groups else ""
    return tuple(name for name in groups if name != same)


def _freest(claims: Claims, scene: Scene, nominal: DrawnModel, starts: Sequence[DrawnModel]) -> DrawnModel:
    """Return the best guess with everything free."""
    groups = _freest_groups(claims, scene)
    usual = tuple(name for name in groups if name in USUAL_GROUPS)
    fits = []
    # Step 1: the usual groups alone, which are fewer and better conditioned; then all, from the best fit.
    for free in (usual, groups):
        for start in starts:
            fits.append(_fitted(claims, scene, nominal, start, free))
            kept, _ = _without_spoiled(claims, scene, fits[-1])
            if _noise(kept, scene, fits[-1]) <= NOISE_FACTOR * SNAP_PX:
                return fits[-1]
        fits.sort(key=lambda model: _misfit(claims, scene, model))
        starts = [*fits[:1], *starts[:1]]
    # Step 2: recentered frusta, every pivot and fit.
    freest = min(fits, key=lambda model: _misfit(claims, scene, model))
    best = freest
    if scene.frustum.recentered:
        best = min(
            (
                _fitted(claims, scene, nominal, replace(freest, pivot=pivot, fit=fit), groups)
                for pivot in Pivot
                for fit in (Fit.ANGLE, Fit.SCREEN)
            ),
            key=lambda model: _misfit(claims, scene, model),
        )
    return best


def _simplest(
    claims: Claims,
    scene: Scene,
    nominal: DrawnModel,
    starts: Sequence[DrawnModel],
    counts: Iterable[int],
    limit_px: float,
) -> _Found | None:
    """Return the guess with the fewest groups off nominal whose noise stays below a limit; None without one.

    Where several sets with the same number of groups suffice, images cannot tell them apart: the preferred
    one is returned, with the others as alternatives.
    """
    few = claims.thinned(MAX_SCREENED_CLAIMS)
    for count in counts:
        passing: dict[tuple[object, ...], tuple[tuple[float, ...], DrawnModel, tuple[str, ...]]] = {}
        for free in itertools.combinations(_groups(claims, scene), count):
            for start in _variants(scene, nominal, starts, free):
                if (free, start.one_camera) in passing and not scene.frustum.recentered:
                    continue
                # Three fits, each more expensive: a rough one on few claims already rejects most sets.
                model = _fitted(few, scene, nominal, start, free, roughly=True)
                if _noise(few, scene, model) > max(MAX_NOISE_PX, limit_px):
                    continue
                model = _fitted(few, scene, nominal, model, free)
                if _noise(few, scene, model) > SCREENING_FACTOR * limit_px:
                    continue
                model = _fitted(claims, scene, nominal, model, free)
                if _noise(claims, scene, model) > limit_px:
                    continue
                rank = _rank(claims, scene, model, nominal, free)
                key = (free, model.one_camera)
                if key not in passing or rank < passing[key][0]:
                    passing[key] = rank, model, free
        if passing:
            (_, model, free), *others = sorted(passing.values(), key=lambda found: found[0])
            return _Found(model=model, free=free, alternatives=tuple(other for _, other, _ in others))
    return None


def _least_wrong(claims: Claims, scene: Scene, nominal: DrawnModel, starts: Sequence[DrawnModel]) -> _Found:
    """Return the best guess with at most one group off nominal, for use where no guess is good."""
    fits = [
        (free, _fitted(claims, scene, nominal, start, free))
        for free in ((), *((name,) for name in _groups(claims, scene)))
        for start in _variants(scene, nominal, starts[:1], free)
    ]
    free, model = min(fits, key=lambda found: _misfit(claims, scene, found[1]))
    return _Found(model=model, free=free, alternatives=())


def _rank(
    claims: Claims, scene: Scene, model: DrawnModel, nominal: DrawnModel, free: tuple[str, ...]
) -> tuple[float, ...]:
    """Return the sort key of a guess: the preferred one of several has the smallest."""
    odd = _oddity(scene, model, nominal)
    preference = sum(parameters.PREFERENCE.index(name) for name in free)
    if "aperture-offset" in free and at_corner(scene, model):
        preference = -1
    if "shift" in free and scene.frustum.recentered and np.abs(model.shift).max() > MAX_SAMPLING_PX:
        preference += len(parameters.PREFERENCE)
    return (*odd, preference, _misfit(claims, scene, model))


def at_corner(scene: Scene, model: DrawnModel) -> bool:
    """Return whether a guess has the apertures at corners or edges of hogels, half a pitch off center."""
    offset = np.abs(model.aperture_offset)
    pitch = np.asarray(scene.plate.size) / scene.plate.hogels
    off = np.minimum(offset, np.abs(offset - pitch / 2)) <= CORNER_PITCHES * pitch
    return bool(off.all() and (offset > CORNER_PITCHES * pitch).any())


def _oddity(scene: Scene, model: DrawnModel, nominal: DrawnModel) -> tuple[int, int]:
    """Return how many numbers are off nominal by enough to have a name, and how many choices are.

    A fit to the screen can also be written as a field of view: the way with fewer numbers is preferred.
    """
    off = np.abs(model.parameters - nominal.parameters) > parameters.smallest_named(scene)
    chosen = (
        (model.pivot, nominal.pivot),
        (model.fit, nominal.fit),
        (model.recentering, nominal.recentering),
        (model.one_camera, nominal.one_camera),
    )
    return int(off.sum()), sum(one is not other for one, other in chosen)


def _variants(
    scene: Scene, nominal: DrawnModel, starts: Sequence[DrawnModel], free: tuple[str, ...]
) -> list[DrawnModel]:
    """Return the start values of fits of some groups, taken from the starting points.

    A fault that a starting point states in another group is translated: the freest guess has a moved scene
    in place of moved apertures, may have another pitch in place of another size, and may have a part of a
    moved screen as a shift of the sampling points, or the reverse.
    """
    variants: dict[tuple[object, ...], DrawnModel] = {}
    for start in starts:
        one = start.one_camera
        if one is not None and not one.flipped and not (set(free) & set(CAMERA_GROUPS) and len(free) <= 2):
            continue
        x, y, _ = start.scene_offset
        spoken = start
        if "scene-offset" not in free and start.aperture_offset == nominal.aperture_offset:
            spoken = replace(spoken, aperture_offset=(-x, -y))
        if "pitch" not in free:
            spoken = replace(
                spoken, scene_scale=start.scene_scale / float(np.clip(start.pitch[0], 0.01, 1e3))
            )
        if scene.frustum.screen is not None:
            per_px = parameters.screen_lengths(scene)
            if "shift" not in free:
                moved = np.asarray(start.screen_center) + np.asarray(start.shift) * per_px
                spoken = replace(spoken, screen_center=(float(moved[0]), float(moved[1])))
            elif "screen-center" not in free:
                shift = np.asarray(start.shift) + np.asarray(start.screen_center) / per_px
                spoken = replace(spoken, shift=(float(shift[0]), float(shift[1])))
        values = nominal.parameters
        for name in free:
            index = list(parameters.places(name))
            values[index] = spoken.parameters[index]
        model = replace(start, pivot=nominal.pivot, fit=nominal.fit).with_parameters(values)
        choices = [model]
        if scene.frustum.recentered and model.near:
            choices = [
                replace(model, pivot=pivot, fit=fit) for pivot in Pivot for fit in (Fit.ANGLE, Fit.SCREEN)
            ]
        for choice in choices:
            key = (choice.orientation, choice.order, choice.pivot, choice.fit, choice.one_camera, *values)
            variants.setdefault(key, choice)
    return list(variants.values())


def _misfit(claims: Claims, scene: Scene, model: DrawnModel) -> float:
    """Return the mean distance by which claims fail, px; each counts a pixel at most."""
    return float(outside_px(claims, scene, model, 1.0).mean())


def _fitted(
    claims: Claims,
    scene: Scene,
    nominal: DrawnModel,
    start: DrawnModel,
    free: tuple[str, ...],
    *,
    roughly: bool = False,
) -> DrawnModel:
    """Return a guess with some groups of parameters fitted and the others nominal.

    With `roughly`, the fit ends at about a pixel.
    """
    values = nominal.parameters
    index = np.array([place for name in free for place in parameters.places(name)], dtype=np.int64)
    if not len(index):
        return start.with_parameters(values)
    values[index] = start.parameters[index]
    scales = parameters.fit_scales(scene, values)[index]
    low, high = (limit[index] for limit in parameters.bounds(scene))
    cap = scene.frustum.resolution[0] / 2

    def failures(scaled: Floats) -> Floats:
        values[index] = scaled * scales
        return outside_px(claims, scene, start.with_parameters(values), cap)

    # The first fit counts failures of up to a pixel by their squares, so that outlines that are pixels apart
    # attract each other. The second one, with the scale of snapping, is precise.
    scaled = np.clip(values[index], low, high) / scales
    for attraction_px, trials in ((ATTRACTION_PX, 12), (SNAP_PX, 25))[: 1 if roughly else 2]:
        found = least_squares(
            failures,
            scaled,
            bounds=(low / scales, high / scales),
            x_scale="jac",
            loss="soft_l1",
            f_scale=attraction_px,
            ftol=1e-6,
            xtol=1e-7,
            max_nfev=trials,
        )
        scaled = found.x
    values[index] = scaled * scales
    return start.with_parameters(values)
