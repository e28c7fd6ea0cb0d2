"""Conventions and geometry of a renderer, from what its images claim: searched, fitted, bounded.

First the discrete conventions, by how far claims fail on the average. Then shift, field of view, pitch
and near offset by robust least squares, with as few of them off their nominal values as will do. Last
an interval for each: all values under which no claim fails by more than drawing rounds.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from xfrustum.compare.claims import Claims
from xfrustum.compare.containment import outside_px
from xfrustum.compare.drawn_model import DrawnModel
from xfrustum.compare.feasible import SNAP_PX, feasible_interval
from xfrustum.compare.orientations import UPRIGHT, orientations
from xfrustum.scenes.double_frustum import Fit, Pivot
from xfrustum.scenes.scene import Scene

Floats = NDArray[np.float64]

GROUPS = {"shift": (0, 1), "fov": (2, 3), "pitch": (4, 5), "near": (6,)}
"""Places in `DrawnModel.parameters` of what goes wrong together."""

SEARCHED, FITTED, BOUNDED = 1200, 2500, 16000
"""Claims that the search, the fit and the intervals look at: enough for either, and quick."""

MISPLACED = 0.01
"""Share of claims that may fail under the right guess, for reasons of their own."""

ALIKE = 2.0
"""A simpler guess is as good when its claims fail by no more than this many times what the best
leaves: two noises of one size, the guess's and the measure's."""

FAR_OFF_PX, SPOILED = 1.0, 0.1
"""A hogel is left out when more than this share of its claims fail by more than a pixel; and where that
holds of all that is left, no convention explains the images."""

NEARS = (0.0, *np.geomspace(1e-6, 0.3, 12).tolist())
"""Starting points for near, parts of the reach."""

NAMED = np.array([0.05, 0.05, 5e-4, 5e-4, 5e-4, 5e-4, 0.0])
"""By how much shift, fov, pitch and near must be off to be named (`xfrustum.compare.faults`)."""

SCALES = np.array([0.1, 0.1, 1e-3, 1e-3, 1e-3, 1e-3])
"""Sizes of small steps of shift (px), fov and pitch (factors); near's is in proportion."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GeometryFit:
    """What was found.

    Attributes
    ----------
    model
        The simplest guess under which the claims hold.
    low, high
        (7,) ends of the intervals of its parameters; the nominal value where a parameter was not free.
    free
        Names of the groups that had to be off their nominal values.
    noise_px
        By how much all claims but `MISPLACED` fail under it, at most.
    """

    model: DrawnModel
    low: Floats
    high: Floats
    free: tuple[str, ...]
    noise_px: float

    @property
    def holds(self) -> bool:
        """Whether the claims hold at all."""
        return self.noise_px <= FAR_OFF_PX


def fit_geometry(claims: Claims, scene: Scene, nominal: DrawnModel) -> GeometryFit:
    """Find the simplest guess about conventions and geometry under which claims hold.

    Parameters
    ----------
    claims
        From several hogels: one leaves their order and pitch open.
    scene
        What was to be drawn.
    nominal
        What the renderer's author says of it, `DrawnModel()` if nothing.
    """
    few, some = claims.thinned(SEARCHED), claims.thinned(FITTED)
    free: tuple[str, ...] = ()
    # The plain guess is nearly always right or nearly right: it spares the search.
    if _noise(some, scene, nominal) <= SNAP_PX:
        best = nominal
    else:
        start = _search(few, scene, nominal)
        freest = _freest(few, scene, nominal, start)
        claims = _without_spoiled(claims, scene, freest)
        some = claims.thinned(FITTED)
        best, free = _simplest(some, scene, nominal, freest)
    noise = _noise(some, scene, best)
    index = [place for name in free for place in GROUPS[name]]
    values, low, high = feasible_interval(claims.thinned(BOUNDED), scene, best, index, noise)
    return GeometryFit(model=best.with_parameters(values), low=low, high=high, free=free, noise_px=noise)


def _without_spoiled(claims: Claims, scene: Scene, model: DrawnModel) -> Claims:
    """Return the claims of those hogels in which most of them hold, nearly; all if none is left.

    One file of noise must not decide about the others.
    """
    off = outside_px(claims, scene, model, np.inf) > FAR_OFF_PX
    _, which = np.unique(claims.hogel, axis=0, return_inverse=True)
    which = which.reshape(-1)
    share = np.bincount(which, off) / np.bincount(which)
    kept = share[which] < SPOILED
    return claims.chosen(kept) if kept.any() else claims


def _noise(claims: Claims, scene: Scene, model: DrawnModel) -> float:
    outside = outside_px(claims, scene, model, max(claims.size))
    return float(np.quantile(outside, 1 - MISPLACED)) if len(outside) else 0.0


def _search(claims: Claims, scene: Scene, nominal: DrawnModel) -> list[DrawnModel]:
    """Return the best few discrete conventions and starting points for near."""
    cap = scene.frustum.resolution[0] / 2
    reach = scene.frustum.longest_reach
    ranked = []
    # Coarsely in near, for every orientation and order; then finely for the best of these.
    several = len(np.unique(claims.hogel, axis=0)) > 1
    orders = list(orientations(claims.hogels)) if several else [UPRIGHT]
    for orientation, order in itertools.product(orientations(claims.size), orders):
        for near in {nominal.near, *(reach * part for part in NEARS[::4])}:
            model = replace(nominal, orientation=orientation, order=order, near=near)
            ranked.append((float(outside_px(claims, scene, model, cap).mean()), model))
    ranked.sort(key=lambda pair: (pair[0], pair[1].orientation.changes + pair[1].order.changes))
    conventions = {(model.orientation, model.order): model for _, model in reversed(ranked[:6])}
    finely = [
        (float(outside_px(claims, scene, fine, cap).mean()), fine)
        for model in conventions.values()
        for near in {nominal.near, *(reach * part for part in NEARS)}
        for fine in (replace(model, near=near),)
    ]
    finely.sort(key=lambda pair: pair[0])
    return [model for _, model in finely[:4]]


def _freest(claims: Claims, scene: Scene, nominal: DrawnModel, starts: Sequence[DrawnModel]) -> DrawnModel:
    """Return the best guess with everything free."""
    freest = min(
        (_fitted(claims, scene, nominal, start, tuple(GROUPS)) for start in starts),
        key=lambda model: _misfit(claims, scene, model),
    )
    best = freest
    if scene.frustum.recentered:
        best = min(
            (
                _fitted(claims, scene, nominal, replace(freest, pivot=pivot, fit=fit), tuple(GROUPS))
                for pivot in Pivot
                for fit in (Fit.ANGLE, Fit.SCREEN)
            ),
            key=lambda model: _misfit(claims, scene, model),
        )
    return best


def _simplest(
    claims: Claims, scene: Scene, nominal: DrawnModel, freest: DrawnModel
) -> tuple[DrawnModel, tuple[str, ...]]:
    """Return the guess with the fewest groups off nominal that fits as well as the freest, and these."""
    best = _fitted(claims, scene, nominal, freest, tuple(GROUPS))
    limit = ALIKE * max(_noise(claims, scene, best), SNAP_PX)
    simple = replace(nominal, orientation=best.orientation, order=best.order)
    for count in range(len(GROUPS)):
        passing = []
        for free in itertools.combinations(GROUPS, count):
            for variant in _variants(scene, simple, best, free):
                model = _fitted(claims, scene, nominal, variant, free)
                if _noise(claims, scene, model) <= limit:
                    passing.append((*_oddity(model, nominal), _misfit(claims, scene, model), model, free))
        if passing:
            *_, model, free = min(passing, key=lambda found: found[:3])
            return model, free
    return best, tuple(GROUPS)


def _oddity(model: DrawnModel, nominal: DrawnModel) -> tuple[int, int]:
    """Return how many numbers are off nominal by more than has a name, and how many choices are.

    A fit to the screen is a field of view: of two ways to say the same, the one with fewer numbers.
    """
    off = np.abs(model.parameters - nominal.parameters) > NAMED
    choices = int(model.pivot is not nominal.pivot) + int(model.fit is not nominal.fit)
    return int(off.sum()), choices


def _variants(scene: Scene, simple: DrawnModel, best: DrawnModel, free: tuple[str, ...]) -> list[DrawnModel]:
    """Return where fits of some groups begin: with the best guess's values for these, pivot and fit."""
    values, found = simple.parameters, best.parameters
    for name in free:
        values[list(GROUPS[name])] = found[list(GROUPS[name])]
    start = simple.with_parameters(values)
    if not scene.frustum.recentered or not start.near:
        return [start]
    return [replace(start, pivot=pivot, fit=fit) for pivot in Pivot for fit in (Fit.ANGLE, Fit.SCREEN)]


def _misfit(claims: Claims, scene: Scene, model: DrawnModel) -> float:
    """Return the mean distance by which claims fail, none counting more than a pixel."""
    return float(outside_px(claims, scene, model, 1.0).mean())


def _fitted(
    claims: Claims, scene: Scene, nominal: DrawnModel, start: DrawnModel, free: tuple[str, ...]
) -> DrawnModel:
    """Return a guess with some groups of parameters fitted, the others nominal."""
    values = nominal.parameters
    index = np.array([place for name in free for place in GROUPS[name]], dtype=np.int64)
    if not len(index):
        return start.with_parameters(values)
    values[index] = start.parameters[index]
    reach = scene.frustum.longest_reach
    scales = np.append(SCALES, max(0.03 * values[6], 1e-6 * reach))[index]
    low = np.array([-np.inf, -np.inf, 0.01, 0.01, -np.inf, -np.inf, 0.0])[index]
    high = np.array([np.inf] * 6 + [0.9 * reach])[index]
    cap = scene.frustum.resolution[0] / 2

    def failures(scaled: Floats) -> Floats:
        values[index] = scaled * scales
        return outside_px(claims, scene, start.with_parameters(values), cap)

    begin = np.clip(values[index], low, high) / scales
    found = least_squares(
        failures,
        begin,
        bounds=(low / scales, high / scales),
        loss="soft_l1",
        f_scale=SNAP_PX,
        ftol=1e-6,
        xtol=1e-7,
        max_nfev=25,
    )
    values[index] = found.x * scales
    return start.with_parameters(values)
