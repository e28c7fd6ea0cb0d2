"""Fit of a renderer's conventions and geometry to the claims of its images, with intervals.

A claim (`testset.PixelClaims`) states that a pixel of a file shows a triangle. Whatever hides it, a
triangle is shown only where it projects. Conventions and geometry can therefore be determined
without visibility: under the correct candidate model every claim holds; under a wrong candidate
many claims fail, each by a distance in pixels. First, the discrete conventions with the smallest
mean failure are selected. Then the parameters of `drawn_model.GROUPS` are fitted by robust least
squares. As few groups as possible deviate from their nominal values; other sets with the same
number of groups are alternatives if they fit equally well. Last, each parameter gets an interval:
all values under which no claim fails by more than the rounding of drawing.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares, linprog

from xfrustum.compare.diagnosis.testset import PixelClaims, inside_px, outside_px
from xfrustum.compare.renderer_model.conventions import UPRIGHT, orientations
from xfrustum.compare.renderer_model.drawn_model import (
    CAMERA_GROUPS,
    FLIPPED,
    GROUPS,
    NUMBERS,
    PREFERENCE,
    SCREEN_GROUPS,
    SMALLEST_FACTOR,
    SMALLEST_SHIFT_PX,
    TOLD_APART_PER_REACH,
    Film,
    OneCamera,
    Recentering,
    RendererModel,
    places,
    screen_lengths,
    smallest_named,
    table,
)
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Fit, Pivot

# Largest distance by which rasterizers move edges, in pixels: half the diagonal of a subpixel cell.
# Graphics hardware has 8 subpixel bits.
SNAP_PX = math.sqrt(2) / 2 * 2.0**-8

# Largest numbers of claims used by the search, the screening of candidates, the fit and the
# intervals. The search only ranks hundreds of candidates. The fit needs more claims for its
# precision. The intervals, computed once, are bounded by the few claims closest to an edge.
MAX_SEARCHED_CLAIMS, MAX_SCREENED_CLAIMS = 1200, 600
MAX_FITTED_CLAIMS, MAX_BOUNDING_CLAIMS = 2500, 16000

# Largest share of claims that may fail under the correct candidate, because of damaged pixels,
# anti-aliasing or rounding of edges. The noise of a candidate is the distance that this share of
# claims exceeds. A candidate with more than a pixel of noise does not explain the images.
MAX_MISPLACED_FRACTION, MAX_NOISE_PX = 0.01, 1.0

# Largest ratio of the noise of a simpler candidate to the noise of the best candidate at which the
# simpler candidate counts as equally good. It also limits the ratio of noise on few claims to noise
# on all claims.
NOISE_FACTOR = 2.0

# A hogel is spoiled, and left out, if at least a tenth of its claims fails by more than
# `MAX_NOISE_PX`: ten times the share that may fail under the correct candidate. At most half of the
# hogels are left out: a rule that fewer than half of the hogels follow is not a convention.
MIN_SPOILED_FRACTION, MAX_SPOILED_HOGEL_FRACTION = 0.1, 0.5

# Groups that are fitted first, because their parameters are fewer and better conditioned. Largest
# number of groups that may deviate from nominal together: with more groups the fit follows noise.
USUAL_GROUPS, MAX_GROUPS = ("shift", "fov", "pitch", "near", *SCREEN_GROUPS), 4

# Largest failure of a claim, in pixels, that the first, rough fit counts by its square: about the
# distance of neighboring outlines. Larger failures count linearly.
ATTRACTION_PX = 1.0

# Largest shift, in pixels, that is explained by the sampling point if a moved projection screen
# gives the same images: half a pixel, because sampling points are inside their pixels, plus the
# smallest reported shift.
MAX_SAMPLING_PX = 0.5 + SMALLEST_SHIFT_PX

# Largest distance from the corner of a hogel, in pitches, at which an aperture counts as at the
# corner.
CORNER_PITCHES = 0.01

# Largest distance, in pixels, of an edge from a pixel's center at which it can bound an interval.
# The fit is accurate to a fraction of a pixel, so that edges farther away are not limiting.
NEIGHBORHOOD_PX = 0.5

# Displacement of outlines, in pixels, above which a parameter counts as unbounded. Displacement to
# which the solver limits parameters, far above the displacement by any bounded parameter.
UNBOUNDED_PX, FARTHEST_PX = 1e3, 1e6

# Displacement of outlines by a step, in pixels, below which it is noise of finite differences. The
# solver, HiGHS, also treats such small coefficients as zero.
SMALLEST_SLOPE_PX = 1e-9

# Largest near offset, as a fraction of the reach, that a renderer may have without visible effect:
# at a depth of `TOLD_APART_PER_REACH` times the reach it widens the film by the smallest reported
# factor.
UNSEEN_NEAR_PER_REACH = SMALLEST_FACTOR * TOLD_APART_PER_REACH

# Starting points, of which `MAX_STARTS` are fitted. Near offsets, as fractions of the reach, and
# the fraction with which wrong shears are tried; smaller offsets move pictures less. Scales of the
# scene; larger scales look like the last. Ratios of the film's extent, for angles mistaken for half
# angles. Ratios of the screen's height.
START_NEARS, SHEARED_NEAR, MAX_STARTS = (0.0, *np.geomspace(1e-6, 0.3, 12).tolist()), 0.03, 4
START_SCALES, START_FILMS, START_HEIGHTS = (1e-3, 0.03, 0.3, 3.0, 30.0), (0.5, 2.0, 3.0), (0.5, 2.0)

# Films with pixels at equal angles.
LENSES = (Film.XY, Film.X, Film.Y, Film.RADIUS)
# Largest ratio of the mean failures of claims with and without a lens at which the lens is fitted.
MAX_LENS_RATIO = 0.5
Found = list[tuple[RendererModel, tuple[str, ...]]]
"""Candidates, the preferred one first, each with the names of its fitted groups."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GeometryFit:
    """Candidate model fitted to claims, with intervals and alternatives."""

    model: RendererModel  #: simplest candidate under which the claims hold
    #: (P,) ends of the intervals of the parameters; the nominal value if a parameter was not fitted
    low: Floats
    high: Floats
    #: largest failure of a claim, without the worst share `MAX_MISPLACED_FRACTION` of the claims
    noise_px: float = 0.0
    alternatives: tuple[RendererModel, ...] = ()  #: equally simple candidates with other groups
    spoiled: frozenset[tuple[int, int]] = frozenset()  #: hogels left out, by their file names
    by_color: bool = False  #: whether the candidate comes from registration of pictures

    @classmethod
    def exact(cls, model: RendererModel) -> GeometryFit:
        """Return a candidate with exact parameters."""
        return cls(model=model, low=model.parameters, high=model.parameters)

    @property
    def holds(self) -> bool:
        """True if the claims hold."""
        return self.noise_px <= MAX_NOISE_PX

    def unbounded(self, nominal: RendererModel) -> GeometryFit:
        """Return the candidate without the intervals of parameters that deviate from nominal."""
        values, stated = self.model.parameters, nominal.parameters
        unknown = np.where(values == stated, stated, np.nan)
        return replace(self, low=unknown, high=unknown)


def fit_geometry(
    claims: PixelClaims, nominal: RendererModel, *, simple: bool = False
) -> GeometryFit:
    """Find the simplest conventions and geometry under which claims of several hogels hold.

    A single hogel does not determine order and pitch. `nominal` is the model of the renderer
    according to its author. In a `simple` fit, at most a lens and one group of parameters deviate
    from nominal. If no such candidate holds, the simple fit is nominal.
    """
    search = _Search(scene=claims.scene, nominal=nominal)
    some, spoiled = claims.thinned(MAX_FITTED_CLAIMS), frozenset[tuple[int, int]]()
    result: Found = [(nominal, ())]
    # Step 1: the nominal candidate is often right or nearly right.
    if _noise(some, nominal) > SNAP_PX:
        # Step 2: search the conventions, and try candidates with at most one group off nominal.
        few = claims.thinned(MAX_SEARCHED_CLAIMS)
        starts = search.starts(few)
        fits = search.simplest(some, starts, range(2), NOISE_FACTOR * SNAP_PX)
        fits = fits or search.bent(some, starts)
        if not fits and not simple:
            # Step 3: fit all groups, leave out spoiled hogels, and use the remaining noise as the
            # limit for the simplest candidate.
            freest = search.freest(few, [start for start in starts if not _alone(start)])
            claims, spoiled = _without_spoiled(claims, freest)
            some = claims.thinned(MAX_FITTED_CLAIMS)
            alone = [start for start in starts if start.one_camera is not None]
            fits = search.joint(some, freest, alone)
        result = fits or result
    # Step 4: an interval for each parameter that is off nominal.
    (best, free), *others = result
    noise, bounding = _noise(some, best), claims.thinned(MAX_BOUNDING_CLAIMS)
    values, low, high = _interval(bounding, best, _determined(claims.scene, free), noise)
    return GeometryFit(
        model=best.with_parameters(values),
        low=low,
        high=high,
        noise_px=noise,
        alternatives=tuple(other for other, _ in others),
        spoiled=spoiled,
    )


def _determined(scene: Scene, groups: Sequence[str]) -> list[int]:
    """Return the indices of the parameters of `groups` that can be determined from images.

    Along an axis with a single pixel, images do not show the position of an outline on the film, so
    that the parameters of this axis are held fixed.
    """
    held = {axis for axis, count in zip("xy", scene.frustum.resolution, strict=True) if count == 1}
    return [place for place in places(*groups) if NUMBERS[place][1] not in held]


def _misfit(claims: PixelClaims, model: RendererModel, cap: float = 1.0) -> float:
    """Return the mean distance (px) by which claims fail; each counts at most `cap`."""
    return float(outside_px(claims, model, cap).mean())


def _noise(claims: PixelClaims, model: RendererModel) -> float:
    """Return the distance, px, that no more than `MAX_MISPLACED_FRACTION` of the claims exceed."""
    outside = outside_px(claims, model, max(claims.scene.frustum.resolution))
    return float(np.quantile(outside, 1 - MAX_MISPLACED_FRACTION)) if len(outside) else 0.0


def _without_spoiled(
    claims: PixelClaims, model: RendererModel
) -> tuple[PixelClaims, frozenset[tuple[int, int]]]:
    """Return the claims without spoiled hogels, and the indices of these hogels.

    If most hogels would be left out, the candidate is wrong and not the hogels: keep all hogels.
    """
    off = outside_px(claims, model, np.inf) > MAX_NOISE_PX
    hogels, which = np.unique(claims.hogel, axis=0, return_inverse=True)
    which = which.reshape(-1)
    spoiled = np.bincount(which, off) / np.bincount(which) >= MIN_SPOILED_FRACTION
    if not spoiled.any() or spoiled.mean() > MAX_SPOILED_HOGEL_FRACTION:
        return claims, frozenset()
    return claims.chosen(~spoiled[which]), frozenset((int(i), int(j)) for i, j in hogels[spoiled])


def _alone(model: RendererModel) -> bool:
    """Return whether only one camera deviates from nominal, without a mirrored film."""
    entry = model.one_camera
    return entry is not None and not (entry.flip_x or entry.flip_y)


def _changes(model: RendererModel) -> tuple[int, int]:
    """Return the sort key of candidates that fit equally well: the smallest has fewest changes."""
    entry = model.one_camera
    flips = 0 if entry is None else 1 + entry.flip_x + entry.flip_y
    changes = model.orientation.changes + model.order.changes + flips
    return changes, tuple(Recentering).index(model.recentering)


def _with_pivots(model: RendererModel) -> list[RendererModel]:
    """Return copies of a candidate, one for each pivot and fit of the offset cameras."""
    return [
        replace(model, pivot=pivot, fit=fit) for pivot in Pivot for fit in (Fit.ANGLE, Fit.SCREEN)
    ]


@dataclass(frozen=True, kw_only=True)
class _Search:
    """Search for the candidate under which claims about a scene hold."""

    scene: Scene
    nominal: RendererModel

    def groups(self, claims: PixelClaims, *, together: bool = False) -> tuple[str, ...]:
        """Return the groups that claims determine, when fitted one by one or all `together`."""
        # Claimed points move with the scene, and do not reveal its offset or scale. A centered
        # frustum has no projection screen. Moving the apertures is equivalent to moving scene and
        # film.
        unseen = {"scene-offset", "scene-scale"} if claims.of_points else set()
        unseen |= set() if self.scene.frustum.recentered else set(SCREEN_GROUPS)
        unseen |= {"aperture-offset"} if together and not claims.of_points else set()
        return tuple(group for group in GROUPS if group not in unseen)

    def starts(self, claims: PixelClaims) -> list[RendererModel]:
        """Return starting points of fits: conventions and parameters with the smallest failures."""
        frustum, nominal = self.scene.frustum, self.nominal
        cap, several = frustum.resolution[0] / 2, len(np.unique(claims.hogel, axis=0)) > 1
        nears = list(
            dict.fromkeys((nominal.near, *(frustum.longest_reach * part for part in START_NEARS)))
        )

        def ranked(models: Iterable[RendererModel]) -> list[RendererModel]:
            result = [(_misfit(claims, model, cap), _changes(model), model) for model in models]
            return [model for *_, model in sorted(result, key=lambda entry: entry[:2])]

        # Step 1: every orientation and order, each with every other single hypothesis.
        orders = list(orientations(self.scene.plate.hogels)) if several else [UPRIGHT]
        ways = itertools.product(orientations(frustum.resolution), orders)
        upright = (replace(nominal, orientation=turned, order=order) for turned, order in ways)
        tried = ranked(model for way in upright for model in self._hypotheses(way, several=several))
        # Step 2: the conventions of the best candidates, each with all near offsets.
        conventions = {
            (entry.orientation, entry.order, entry.recentering, entry.one_camera): entry
            for entry in reversed(tried[:6])
        }
        best = ranked(replace(way, near=near) for way in conventions.values() for near in nears)

        # Step 3: the best starting points, and the best one of each searched group.
        def first(name: str) -> RendererModel:
            off = (way for way in tried if getattr(way, name) != getattr(nominal, name))
            return next(off, tried[0])

        plain = next(
            way
            for way in tried
            if way.recentering is nominal.recentering and way.one_camera is None
        )
        alone = [
            ranked(replace(plain, near=near, one_camera=camera) for near in nears)[0]
            for camera in self._sides()
        ]
        of_groups = map(first, ("scene_scale", "fov", "screen_height"))
        return list(dict.fromkeys([*best[:MAX_STARTS], tried[0], *of_groups, plain, *alone]))

    def _sides(self) -> list[OneCamera]:
        return [OneCamera(side, other_near=self.nominal.near) for side in (-1, 1)]

    def _hypotheses(self, upright: RendererModel, *, several: bool) -> Iterator[RendererModel]:
        """Yield candidates with every start value of one group, of the shear, or of one camera."""
        frustum, nominal = self.scene.frustum, self.nominal
        reach, recentered = frustum.longest_reach, frustum.recentered
        for part in sorted({nominal.near / reach, *START_NEARS[::4]}):
            yield replace(upright, near=reach * part)
        for entry, part in itertools.product(self._sides(), START_NEARS[4::4]):
            yield replace(upright, near=reach * part, one_camera=entry)
        for entry in FLIPPED:
            yield replace(upright, one_camera=replace(entry, other_near=nominal.near))
        yield from (replace(upright, scene_scale=scale) for scale in START_SCALES)
        yield from (replace(upright, fov=(film, film)) for film in START_FILMS)
        for height in START_HEIGHTS if recentered else ():
            yield replace(upright, screen_height=height)
        # In one aperture a wrong shear is equivalent to a moved screen: only the screen is fitted.
        shears = sorted(set(Recentering) - {nominal.recentering}) if recentered and several else []
        for near, shear in itertools.product({nominal.near, reach * SHEARED_NEAR}, shears):
            yield replace(upright, near=near, recentering=shear)

    def fitted(
        self,
        claims: PixelClaims,
        start: RendererModel,
        free: Sequence[str],
        *,
        roughly: bool = False,
    ) -> RendererModel:
        """Fit the groups `free`, with the others nominal; to about a pixel if `roughly`."""
        values, index = self.nominal.parameters, _determined(self.scene, free)
        if not index:
            return start.with_parameters(values)
        values[index] = start.parameters[index]
        numbers = table(self.scene, values)
        scales, low, high = (column[index] for column in (numbers.scale, numbers.low, numbers.high))
        cap = self.scene.frustum.resolution[0] / 2

        def failures(scaled: Floats) -> Floats:
            values[index] = scaled * scales
            return outside_px(claims, start.with_parameters(values), cap)

        # The first fit counts failures of up to a pixel by their squares, so that outlines attract
        # each other over several pixels. The second fit, at the scale of snapping, is precise.
        scaled = np.clip(values[index], low, high) / scales
        for attraction_px, trials in ((ATTRACTION_PX, 12), (SNAP_PX, 25))[: 1 if roughly else 2]:
            scaled = least_squares(
                failures,
                scaled,
                bounds=(low / scales, high / scales),
                x_scale="jac",
                loss="soft_l1",
                f_scale=attraction_px,
                ftol=1e-6,
                xtol=1e-7,
                max_nfev=trials,
            ).x
        values[index] = scaled * scales
        return start.with_parameters(values)

    def bent(self, claims: PixelClaims, starts: Sequence[RendererModel]) -> Found:
        """Return candidates with equal angles and at most one group off nominal, if claims hold."""
        few = claims.thinned(MAX_SCREENED_CLAIMS)
        plain = dict.fromkeys(start.with_parameters(self.nominal.parameters) for start in starts)
        tried = [replace(start, film=film) for start, film in itertools.product(plain, LENSES)]
        misfits = [_misfit(few, candidate) for candidate in tried]
        if min(misfits) > MAX_LENS_RATIO * min(_misfit(few, start) for start in starts):
            return []
        best = tried[misfits.index(min(misfits))]
        return self.simplest(claims, [best], range(2), NOISE_FACTOR * SNAP_PX)

    def freest(self, claims: PixelClaims, starts: Sequence[RendererModel]) -> RendererModel:
        """Return the best fit of all groups, started from fits of the well-conditioned groups."""
        groups = self.groups(claims, together=True)
        fits: list[RendererModel] = []
        for free in (tuple(name for name in groups if name in USUAL_GROUPS), groups):
            for start in starts:
                fits.append(self.fitted(claims, start, free))
                kept, _ = _without_spoiled(claims, fits[-1])
                if _noise(kept, fits[-1]) <= NOISE_FACTOR * SNAP_PX:
                    return fits[-1]
            fits.sort(key=lambda model: _misfit(claims, model))
            starts = [*fits[:1], *starts[:1]]
        if not self.scene.frustum.recentered:
            return fits[0]
        tried = [self.fitted(claims, start, groups) for start in _with_pivots(fits[0])]
        return min(tried, key=lambda model: _misfit(claims, model))

    def joint(
        self, claims: PixelClaims, freest: RendererModel, alone: Sequence[RendererModel]
    ) -> Found:
        """Fit `freest` again, and return the simplest candidates that fit as well."""
        freest = self.fitted(claims, freest, self.groups(claims, together=True))
        noise = _noise(claims, freest)
        if noise <= MAX_NOISE_PX:
            limit, counts = NOISE_FACTOR * max(noise, SNAP_PX), range(MAX_GROUPS + 1)
            if fits := self.simplest(claims, [freest, *alone], counts, limit):
                return fits
        # If no candidate is good, return the best with at most one group off nominal.
        fits = [
            (self.fitted(claims, start, free), free)
            for free in ((), *((name,) for name in self.groups(claims)))
            for start in self.variants([freest], free)
        ]
        return [min(fits, key=lambda fit: _misfit(claims, fit[0]))]

    def simplest(
        self,
        claims: PixelClaims,
        starts: Sequence[RendererModel],
        counts: Iterable[int],
        limit_px: float,
    ) -> Found:
        """Return the candidates with fewest groups off nominal whose noise is within a limit."""
        few = claims.thinned(MAX_SCREENED_CLAIMS)
        # Three fits, each more expensive: a rough one on few claims already rejects most sets.
        stages = (
            (few, True, max(MAX_NOISE_PX, limit_px)),
            (few, False, NOISE_FACTOR * limit_px),
            (claims, False, limit_px),
        )
        passing: dict[object, tuple[tuple[float, ...], RendererModel, tuple[str, ...]]] = {}
        for count in counts:
            for free in itertools.combinations(self.groups(claims), count):
                for start in self.variants(starts, free):
                    key = (free, start.one_camera)
                    if key in passing and not self.scene.frustum.recentered:
                        continue
                    model = start
                    for some, roughly, most in stages:
                        model = self.fitted(some, model, free, roughly=roughly)
                        if _noise(some, model) > most:
                            break
                    else:
                        rank = self._rank(claims, model, free)
                        if key not in passing or rank < passing[key][0]:
                            passing[key] = rank, model, free
            if passing:
                break
        ranked = sorted(passing.values(), key=lambda entry: entry[0])
        turned = [(model.orientation, model.order) for _, model, _ in ranked]
        # Mirroring one half is equivalent to mirroring the picture and the other half.
        return [
            (model, free)
            for (_, model, free), way in zip(ranked, turned, strict=True)
            if way == turned[0]
        ]

    def _rank(
        self, claims: PixelClaims, model: RendererModel, free: tuple[str, ...]
    ) -> tuple[float, ...]:
        """Return the sort key of a candidate: fewest parameters first, then by preference."""
        off = np.abs(model.parameters - self.nominal.parameters) > smallest_named(self.scene)
        names = ("pivot", "fit", "recentering", "one_camera")
        choices = sum(getattr(model, name) != getattr(self.nominal, name) for name in names)
        preference = sum(PREFERENCE.index(name) for name in free)
        # Apertures at corners or edges of hogels, half a pitch off center, are a likely mistake.
        pitch = np.divide(self.scene.plate.size, self.scene.plate.hogels)
        offset = np.abs(model.aperture_offset)
        at_corner = (np.minimum(offset, np.abs(offset - pitch / 2)) <= CORNER_PITCHES * pitch).all()
        if "aperture-offset" in free and at_corner and (offset > CORNER_PITCHES * pitch).any():
            preference = -1
        large = np.abs(model.shift).max() > MAX_SAMPLING_PX
        if "shift" in free and self.scene.frustum.recentered and large:
            preference += len(PREFERENCE)
        return int(off.sum()), choices, *_changes(model), preference, _misfit(claims, model)

    def variants(
        self, starts: Sequence[RendererModel], free: tuple[str, ...]
    ) -> list[RendererModel]:
        """Return the candidates from which fits of some groups start, made from starting points.

        Defects are translated between equivalent groups. The freest candidate always has a moved
        scene in place of moved apertures. It may have a changed aperture pitch in place of a
        changed scene scale. It may divide the offset of the screen between the screen and the
        sampling point.
        """
        nominal, index = self.nominal, _determined(self.scene, free)
        variants: dict[RendererModel, None] = {}
        for start in starts:
            if _alone(start) and not (set(free) & set(CAMERA_GROUPS) and len(free) <= 2):
                continue
            spoken, (x, y, _) = start, start.scene_offset
            if "scene-offset" not in free and start.aperture_offset == nominal.aperture_offset:
                spoken = replace(spoken, aperture_offset=(-x, -y))
            if "pitch" not in free:
                size = start.scene_scale / float(np.clip(start.pitch[0], 0.01, 1e3))
                spoken = replace(spoken, scene_scale=size)
            if self.scene.frustum.screen is not None:
                per_px = screen_lengths(self.scene)
                x, y = moved = np.asarray(start.screen_center) + np.asarray(start.shift) * per_px
                if "shift" not in free:
                    spoken = replace(spoken, screen_center=(float(x), float(y)))
                elif "screen-center" not in free:
                    x, y = moved / per_px
                    spoken = replace(spoken, shift=(float(x), float(y)))
            values = nominal.parameters
            values[index] = spoken.parameters[index]
            model = replace(start, pivot=nominal.pivot, fit=nominal.fit).with_parameters(values)
            both = self.scene.frustum.recentered and model.near
            variants |= dict.fromkeys(_with_pivots(model) if both else [model])
        return list(variants)


def _interval(
    claims: PixelClaims, model: RendererModel, free: Sequence[int], noise_px: float
) -> tuple[Floats, Floats, Floats]:
    """Return middle, lowest and highest values (P,) under which claims fail only by noise.

    Each claim gives an inequality for each edge of its triangle: the inward distance of the pixel's
    center from the edge is at least zero, within rounding and noise. After linearization, the
    candidates that satisfy all claims form a convex cell, and linear programming computes its
    extent along each axis. A renderer fitted without a near offset may have an invisibly small one,
    because no camera has its near plane at its center. The cell therefore includes all such
    offsets.
    """
    values = model.parameters
    middle, low, high = values.copy(), values.copy(), values.copy()
    if not free or not len(claims):
        return values, low, high
    # Step 1: the distances that can bound the fit, and their derivatives with respect to all
    # variable parameters, by finite differences. An invisible near offset varies too, without an
    # interval of its own.
    allowed = SNAP_PX + noise_px
    distance, outside = inside_px(claims, model)
    camera, number = np.argmin(outside, axis=0), np.arange(len(claims))
    held = outside[camera, number] <= allowed
    claim, edge = np.nonzero(held[:, None] & (np.abs(distance[camera, number]) < NEIGHBORHOOD_PX))
    rows = (camera[claim], claim, edge)
    (near,) = places("near")
    unseen = [near] if near not in free and not model.near else []
    moving, numbers = [*free, *unseen], table(claims.scene, values)
    steps, slopes = numbers.step[moving], np.empty((len(claim), len(moving)))
    for column, (place, step) in enumerate(zip(moving, steps, strict=True)):
        moved = values.copy()
        moved[place] += step
        there, _ = inside_px(claims, model.with_parameters(moved))
        slopes[:, column] = there[rows] - distance[rows]
    kept = np.isfinite(slopes).all(axis=1)
    # Step 2: distance + slopes . x >= -allowed, with x in steps, and each parameter within bounds.
    box = np.stack(
        [(end[moving] - values[moving]) / steps for end in (numbers.low, numbers.high)], axis=1
    )
    if unseen:
        box[-1, 1] = UNSEEN_NEAR_PER_REACH * claims.scene.frustum.longest_reach / steps[-1]
        # Surfaces in the plate itself move by any distance, not in proportion to the offset.
        kept &= np.abs(slopes[:, -1]) * box[-1, 1] < NEIGHBORHOOD_PX
    # Step 3: the smallest and the largest value of each parameter in the cell. Parameters are
    # scaled to the largest displacement of an outline, in pixels. With unscaled columns of 1e-8 and
    # 1e-5 px per step, and no bounds, the solver failed, and printed a message into the JSON on
    # standard output.
    known = np.where(np.abs(slopes[kept]) < SMALLEST_SLOPE_PX, 0.0, slopes[kept])
    largest = np.abs(known).max(axis=0, initial=0.0)
    largest[largest == 0] = 1.0
    limits = np.clip(box * largest[:, None], -FARTHEST_PX, FARTHEST_PX)
    scaled, room = -known / largest, distance[rows][kept] + allowed
    for column, (place, step) in enumerate(zip(free, steps, strict=False)):
        ends = []
        for sign, end in zip((1.0, -1.0), box[column], strict=True):
            cost = sign * (np.arange(len(moving)) == column)
            result = linprog(cost, A_ub=scaled, b_ub=room, bounds=limits)
            bounded = result.status == 0 and abs(result.x[column]) < UNBOUNDED_PX
            ends.append((result.x[column] / largest[column] if bounded else end) * step)
        low[place], high[place] = values[place] + ends[0], values[place] + ends[1]
        if np.isfinite(ends).all():
            middle[place] = (low[place] + high[place]) / 2
    return middle, low, high
