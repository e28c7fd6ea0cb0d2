"""Conventions and geometry of a renderer, from what its images claim: enumerated, fitted, bounded.

A claim: this pixel, of this file, shows this triangle. Whatever lies in front, a renderer
shows a triangle only where the triangle projects to. Therefore conventions and geometry can be
found without the visible surface: under the right candidate every claim holds, under a
wrong one many fail, each by a distance in pixels. First come the discrete conventions: those under
which claims fail least on average. Then the numbers of `drawn_model.GROUPS` are fitted by robust
least squares, with as few groups of them off their nominal values as suffice; other sets of groups
that suffice as well are alternatives. Last comes an interval for each number: all values under
which no claim fails by more than the rounding of drawing.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares, linprog

from xfrustum.compare.renderer_model.conventions import UPRIGHT, orientations
from xfrustum.compare.renderer_model.drawn_model import (
    CAMERA_GROUPS,
    EVEN,
    FLIPPED,
    GROUPS,
    NUMBERS,
    PREFERENCE,
    RADIUS,
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
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Fit, Pivot
from xfrustum.scenes.plate.plate import Aperture

# Size of the triangle that stands for a claimed point, relative to the point's largest coordinate:
# the rounding to float32, in which images store points.
POINT_SIZE = 2.0**-24

# Largest number of claims taken from one hogel, so that no hogel outvotes the others. Three hogels
# give more than `MAX_BOUNDING_CLAIMS`.
MAX_HOGEL_CLAIMS = 6000

# Smallest depth at which a camera counts as seeing a surface, as a part of near: halfway between
# the near plane, where drawing ends, and the camera, where projection ends.
MIN_DEPTH_PER_NEAR = 0.5

# Largest distance by which rasterizers move edges, in pixels: half the diagonal of a step of the 8
# subpixel bits that graphics hardware has.
SNAP_PX = math.sqrt(2) / 2 * 2.0**-8

# Largest numbers of claims used by the search, by the screening of candidates, by the fit and by
# the
# intervals. The search tries hundreds of candidates and only ranks them; the fit needs more for its
# precision; the intervals are bounded by the few claims nearest to an edge, and are computed once.
MAX_SEARCHED_CLAIMS, MAX_SCREENED_CLAIMS, MAX_FITTED_CLAIMS, MAX_BOUNDING_CLAIMS = (
    1200,
    600,
    2500,
    16000,
)

# Largest share of claims that may fail under the right candidate: damaged pixels, and edges that
# anti-aliasing or rounding has moved. The noise of a candidate is the distance that this share of
# claims exceeds; a convention that is off by more than a pixel explains no image.
MAX_MISPLACED_FRACTION, MAX_NOISE_PX = 0.01, 1.0

# Largest ratio of a simpler candidate's noise to the best candidate's at which the simpler one is
# as good,
# and of the noise on few claims to that on all: the comparison has two noises of the same size.
NOISE_FACTOR = 2.0

# Smallest share of a hogel's claims that fail by more than `MAX_NOISE_PX` at which the hogel is
# left out: ten times the share that may fail under the right candidate. And the largest share of
# the
# hogels that may be left out: a rule that holds in fewer than half of them is no convention.
MIN_SPOILED_FRACTION, MAX_SPOILED_HOGEL_FRACTION = 0.1, 0.5

# Groups that are fitted first, fewer and better-conditioned numbers; and the largest number of
# groups that may be off nominal together: with more of them free, the fit follows noise.
USUAL_GROUPS, MAX_GROUPS = ("shift", "fov", "pitch", "near", *SCREEN_GROUPS), 4

# Largest failure of a claim that the first, rough fit counts by its square, in pixels: neighboring
# outlines are about that far apart. Larger failures count linearly.
ATTRACTION_PX = 1.0

# Largest shift, in pixels, that is taken for a sampling point where a moved projection screen shows
# the same images: a pixel is sampled within itself, and the rest is the smallest named shift.
MAX_SAMPLING_PX = 0.5 + SMALLEST_SHIFT_PX

# Largest distance from the corner of a hogel at which an aperture counts as being there, in
# pitches.
CORNER_PITCHES = 0.01

# Largest distance of an edge from a pixel's center at which it can bound an interval, in pixels.
# The fit is right to a fraction of a pixel, so that edges farther away bound nothing.
NEIGHBORHOOD_PX = 0.5

# Movement of outlines, in pixels, from which on a number is not bounded, and the one at which
# numbers are held: so far beyond the neighborhood that none which is bounded comes near.
UNBOUNDED_PX, FARTHEST_PX = 1e3, 1e6

# Movement of outlines by a step, in pixels, below which it is noise of the differences. HiGHS takes
# so small numbers for zero.
SMALLEST_SLOPE_PX = 1e-9

# Largest near offset, as a part of the reach, that a renderer may have unseen: at the depth at
# which offsets differ visibly it widens the film by the smallest factor that has a name.
UNSEEN_NEAR_PER_REACH = SMALLEST_FACTOR * TOLD_APART_PER_REACH

# Starting points, of which `MAX_STARTS` are fitted: near, as parts of the reach, and the one with
# which wrong shears are tried, as smaller ones move pictures less; sizes of the scene, larger ones
# of which look like the last; extents of the film, a field of view taken for half of it or half for
# all; heights of the screen.
START_NEARS, SHEARED_NEAR, MAX_STARTS = (0.0, *np.geomspace(1e-6, 0.3, 12).tolist()), 0.03, 4
START_SCALES, START_FILMS, START_HEIGHTS = (1e-3, 0.03, 0.3, 3.0, 30.0), (0.5, 2.0, 3.0), (0.5, 2.0)

# Spacings of pixels by equal angles that are tried.
ANGLES = ("xy", "x", "y", RADIUS)
MAX_LENS_RATIO = (
    0.5  # Largest mean failure of claims with a lens, over that without, at which it is fitted
)
Found = list[tuple[RendererModel, tuple[str, ...]]]
"""Candidates, the preferred one first, each with the names of its groups that were fitted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PixelClaims:
    """Pixels and the triangles that they claim to show.

    Claimed points, for which small triangles stand, lie in the scene as the renderer has it, moved
    or scaled; triangles lie in the nominal scene.
    """

    scene: Scene
    hogel: Indices  # (N, 2) column and row of the aperture that the file is named after
    pixel: Indices  # (N, 2) column and row of the pixel in the file
    corners: Floats  # (N, 3, 3) corners of the triangles, scene units
    of_points: bool

    def __len__(self) -> int:
        """Return the number of claims."""
        return len(self.hogel)

    def chosen(self, index: Indices | Mask) -> PixelClaims:
        """Return some of the claims."""
        names = ("hogel", "pixel", "corners")
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    def thinned(self, count: int) -> PixelClaims:
        """Return at most `count` claims, drawn at random with a fixed seed."""
        if len(self) <= count:
            return self
        return self.chosen(
            np.sort(np.random.default_rng(0).choice(len(self), count, replace=False))
        )


def claims_of(scene: Scene, images: Sequence[HogelImage]) -> PixelClaims:
    """Collect the claims of images at the outlines of triangles, where small moves show.

    From an image that names no triangles the surface points are taken as claims.
    """
    parts, of_points = [], True
    for image in images:
        named = (image.triangle >= 0) & (image.triangle < len(scene.faces))
        points = not named.any()
        if points:
            stated = np.isfinite(image.position).all(axis=-1) & (image.height != 0)
        else:
            # Pixels that have a neighbor of another triangle or beyond the image's border.
            padded = np.pad(image.triangle, 1, constant_values=NOTHING - 1)
            pair = (padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1])
            stated = named & np.any([image.triangle != other for other in pair], axis=0)
        rows, columns = np.nonzero(stated)
        if len(rows) > MAX_HOGEL_CLAIMS:
            some = np.random.default_rng(len(rows)).choice(
                len(rows), MAX_HOGEL_CLAIMS, replace=False
            )
            rows, columns = rows[np.sort(some)], columns[np.sort(some)]
        if points:
            there = image.position[rows, columns].astype(np.float64)
            size = POINT_SIZE * np.abs(there).max(axis=1, initial=0.0)
            around = np.array([[1.0, 0.0, 0.0], [-0.5, 0.75, 0.0], [-0.5, -0.75, 0.0]])
            corners = there[:, None] + size[:, None, None] * around
        else:
            corners = scene.triangles[image.triangle[rows, columns]]
        of_points &= points
        hogel = np.tile(np.array(image.camera.aperture.index, dtype=np.int64), (len(rows), 1))
        parts.append((hogel, np.stack((columns, rows), axis=-1), corners))
    hogel, pixel, corners = (np.concatenate(some) for some in zip(*parts, strict=True))
    return PixelClaims(scene=scene, hogel=hogel, pixel=pixel, corners=corners, of_points=of_points)


def outside_px(claims: PixelClaims, model: RendererModel, cap: float) -> Floats:
    """Return the distance of pixel centers outside their triangles, at most `cap` px, (N,)."""
    _, outside = inside_px(claims, model)
    return np.asarray(np.minimum(outside.min(axis=0), cap))


def inside_px(claims: PixelClaims, model: RendererModel) -> tuple[Floats, Floats]:
    """Return signed distances of pixel centers from their triangles' edges, and outside.

    The first, (2, N, 3) px, are positive inside, in C's projection and in C*'s; the second, (2, N),
    infinite behind the camera.
    """
    scene, (width, height), (sx, sy) = (
        claims.scene,
        claims.scene.frustum.resolution,
        claims.scene.plate.size,
    )
    columns, rows = scene.plate.hogels
    column, row = model.order.cells(claims.hogel[:, 0], claims.hogel[:, 1], (columns, rows))
    apertures = (column + 0.5) * sx / columns - sx / 2, sy / 2 - (row + 0.5) * sy / rows
    column, row = model.orientation.cells(claims.pixel[:, 0], claims.pixel[:, 1], (width, height))
    u, v = (2 * column + 1) / width - 1, 1 - (2 * row + 1) / height
    # Coordinate and corner come first, the claim last: all below is whole arrays.
    (px, py, z), following = claims.corners.transpose(2, 1, 0), [1, 2, 0]
    two = [Aperture(column=0, row=0, x=place, y=place) for place in (0.0, 1.0)]
    distances, outsides = [], []
    distance = depth = np.empty(0)
    for side in (1, -1):
        if side < 0 and model.one_pencil:
            # The same lines, run through the other way: all homogeneous coordinates change their
            # sign.
            distance, depth = -distance, -depth
        else:
            # Step 1: homogeneous film coordinates of the corners, (3, N). Center and shear of a
            # pencil are affine in the aperture's place along the same axis: two pencils determine
            # all.
            entry, other = (model.bundle(scene, aperture, side) for aperture in two)
            w = side * (entry.center[2] - z)
            lines = zip(
                entry.center,
                other.center,
                entry.shear,
                other.shear,
                entry.half_extent,
                strict=False,
            )
            x, y = (
                (side * (p - c - (c1 - c) * a) - (k + (k1 - k) * a) * w) / t
                for p, a, (c, c1, k, k1, t) in zip((px, py), apertures, lines, strict=True)
            )
            # Step 2: the three edges as lines on the film, by cross products of corners; `values`
            # is each line's equation at the pixel's center, and `volume` the determinant of the
            # corners.
            line_x = y * w[following] - w * y[following]
            line_y = w * x[following] - x * w[following]
            line_1 = x * y[following] - y * x[following]
            if model.film == EVEN:
                values = line_x * u + line_y * v + line_1
            else:
                across, up = model.film.bent(u, v, entry.half_extent)
                values = line_x * across + line_y * up + line_1
            volume = line_x[0] * x[2] + line_y[0] * y[2] + line_1[0] * w[2]
            # Step 3: divide by the gradient, for a distance in pixels. The depth of the triangle's
            # plane at the point follows from the same quantities. The determinant's sign marks the
            # inside.
            with np.errstate(divide="ignore", invalid="ignore"):
                distance = values / np.hypot(line_x * 2 / width, line_y * 2 / height)
                depth = volume / values.sum(axis=0) * model.scene_scale
                distance *= np.sign(volume)
        outside = np.maximum(0.0, -distance.min(axis=0))
        seen = np.isfinite(outside) & (depth > MIN_DEPTH_PER_NEAR * model.camera(side).near)
        distances.append(distance.T)
        outsides.append(np.where(seen, outside, np.inf))
    return np.stack(distances), np.stack(outsides)


@dataclass(frozen=True, kw_only=True, eq=False)
class GeometryFit:
    """A candidate about a renderer that was fitted to claims, with intervals and alternatives."""

    model: RendererModel  # the simplest candidate under which the claims hold
    # (P,) ends of the intervals of its numbers; the nominal value where a number was not free
    low: Floats
    high: Floats
    noise_px: float = 0.0  # largest failure of a claim, the worst `MAX_MISPLACED_FRACTION` left out
    alternatives: tuple[RendererModel, ...] = ()  # as simple, with other groups off nominal
    spoiled: frozenset[tuple[int, int]] = (
        frozenset()
    )  # hogels that were left out, as their files are named
    by_color: bool = False  # whether the candidate rests on pictures that were registered,
    by_objects: bool = False  # and whether these name objects, all of them

    @property
    def holds(self) -> bool:
        """True if the claims hold at all."""
        return self.noise_px <= MAX_NOISE_PX

    def unbounded(self, nominal: RendererModel) -> GeometryFit:
        """Return the candidate without intervals of numbers off nominal, which were not fitted."""
        values, stated = self.model.parameters, nominal.parameters
        unknown = np.where(values == stated, stated, np.nan)
        return replace(self, low=unknown, high=unknown)


def fit_geometry(
    claims: PixelClaims, nominal: RendererModel, *, simple: bool = False
) -> GeometryFit:
    """Find the simplest conventions and geometry under which claims of several hogels hold.

    A single hogel leaves order and pitch open. `nominal` is the renderer by its author's
    statements. A `simple` fit has a lens and one group of numbers off nominal at most, and is
    nominal where no such candidate holds.
    """
    fitting = _Fitting(scene=claims.scene, nominal=nominal)
    few, some = claims.thinned(MAX_SEARCHED_CLAIMS), claims.thinned(MAX_FITTED_CLAIMS)
    result: Found = [(nominal, ())]
    spoiled: frozenset[tuple[int, int]] = frozenset()
    # Step 1: the nominal candidate is often right or nearly right. The search is skipped where it
    # is.
    if _noise(some, nominal) > SNAP_PX:
        # Step 2: search the conventions, and try candidates with at most one group off nominal.
        starts = fitting.starts(few)
        result = fitting.simplest(some, starts, range(2), NOISE_FACTOR * SNAP_PX)
        result = result or fitting.bent(some, starts)
        if not result and simple:
            result = [(nominal, ())]
        if not result:
            # Step 3: free everything, leave out spoiled hogels, and take the noise that remains as
            # the limit for the simplest candidate.
            freest = fitting.freest(few, [start for start in starts if not _alone(start)])
            claims, spoiled = _without_spoiled(claims, freest)
            some = claims.thinned(MAX_FITTED_CLAIMS)
            freest = fitting.fitted(some, freest, fitting.groups(claims, together=True))
            noise = _noise(some, freest)
            if noise <= MAX_NOISE_PX:
                limit, counts = NOISE_FACTOR * max(noise, SNAP_PX), range(MAX_GROUPS + 1)
                alone = [start for start in starts if start.one_camera is not None]
                result = fitting.simplest(some, [freest, *alone], counts, limit)
            if not result:
                # The best candidate with at most one group off nominal, reported where none is
                # good.
                sets = ((), *((name,) for name in fitting.groups(some)))
                ways = [
                    (candidate, free)
                    for free in sets
                    for candidate in fitting.variants([freest], free)
                ]
                fits = [(fitting.fitted(some, candidate, free), free) for candidate, free in ways]
                result = [min(fits, key=lambda fit: _misfit(some, fit[0]))]
    # Step 4: an interval for each number that is off nominal.
    (best, free), *others = result
    noise = _noise(some, best)
    determined = _determined(claims.scene, free)
    values, low, high = _interval(claims.thinned(MAX_BOUNDING_CLAIMS), best, determined, noise)
    return GeometryFit(
        model=best.with_parameters(values),
        low=low,
        high=high,
        noise_px=noise,
        alternatives=tuple(other for other, _ in others),
        spoiled=spoiled,
    )


def _determined(scene: Scene, groups: Sequence[str]) -> list[int]:
    """Return the places of the numbers of some groups that images determine.

    Along an axis with a single pixel nothing shows where on the film an outline lies: numbers of it
    are held.
    """
    held = {axis for axis, count in zip("xy", scene.frustum.resolution, strict=True) if count == 1}
    return [place for place in places(*groups) if NUMBERS[place][1] not in held]


def _misfit(claims: PixelClaims, model: RendererModel, cap: float = 1.0) -> float:
    """Return the mean distance by which claims fail, px; each counts `cap` at most."""
    return float(outside_px(claims, model, cap).mean())


def _noise(claims: PixelClaims, model: RendererModel) -> float:
    """Return the distance, px, that no more than `MAX_MISPLACED_FRACTION` of the claims exceed."""
    outside = outside_px(claims, model, max(claims.scene.frustum.resolution))
    return float(np.quantile(outside, 1 - MAX_MISPLACED_FRACTION)) if len(outside) else 0.0


def _without_spoiled(
    claims: PixelClaims, model: RendererModel
) -> tuple[PixelClaims, frozenset[tuple[int, int]]]:
    """Return the claims of the hogels in which nearly all hold, and the indices of the others.

    Where most hogels would be left out, the candidate is wrong and not the hogels: then all are
    kept.
    """
    off = outside_px(claims, model, np.inf) > MAX_NOISE_PX
    hogels, which = np.unique(claims.hogel, axis=0, return_inverse=True)
    which = which.reshape(-1)
    spoiled = np.bincount(which, off) / np.bincount(which) >= MIN_SPOILED_FRACTION
    if not spoiled.any() or spoiled.mean() > MAX_SPOILED_HOGEL_FRACTION:
        return claims, frozenset()
    return claims.chosen(~spoiled[which]), frozenset((int(i), int(j)) for i, j in hogels[spoiled])


def _alone(model: RendererModel) -> bool:
    """Return whether one camera alone has other numbers, its film being mirrored nowhere."""
    entry = model.one_camera
    return entry is not None and not (entry.flip_x or entry.flip_y)


def _changes(model: RendererModel) -> tuple[int, int]:
    """Return the sort key of candidates that fit equally well: the plainest has the smallest."""
    entry = model.one_camera
    flips = 0 if entry is None else 1 + entry.flip_x + entry.flip_y
    changes = model.orientation.changes + model.order.changes + flips
    return changes, tuple(Recentering).index(model.recentering)


def _with_pivots(model: RendererModel) -> list[RendererModel]:
    """Return a candidate with every pivot and fit of its offset cameras."""
    return [
        replace(model, pivot=pivot, fit=fit) for pivot in Pivot for fit in (Fit.ANGLE, Fit.SCREEN)
    ]


@dataclass(frozen=True, kw_only=True)
class _Fitting:
    """The search for the candidate under which claims about a scene hold."""

    scene: Scene
    nominal: RendererModel

    def groups(self, claims: PixelClaims, *, together: bool = False) -> tuple[str, ...]:
        """Return the groups that claims determine, singly or all free `together`."""
        # Claimed points move with the scene, and do not show it; a centered frustum has no
        # projection screen. To move the apertures is to move scene and film.
        unseen = {"scene-offset", "scene-scale"} if claims.of_points else set()
        unseen |= set() if self.scene.frustum.recentered else set(SCREEN_GROUPS)
        unseen |= {"aperture-offset"} if together and not claims.of_points else set()
        return tuple(group for group in GROUPS if group not in unseen)

    def starts(self, claims: PixelClaims) -> list[RendererModel]:
        """Return the conventions and numbers that fail least, from which fits start."""
        frustum, nominal = self.scene.frustum, self.nominal
        cap, reach = frustum.resolution[0] / 2, frustum.longest_reach
        several = len(np.unique(claims.hogel, axis=0)) > 1
        sides = [OneCamera(side, other_near=nominal.near) for side in (-1, 1)]

        def hypotheses(upright: RendererModel) -> Iterator[RendererModel]:
            yield from (
                replace(upright, near=reach * p) for p in {nominal.near / reach, *START_NEARS[::4]}
            )
            for entry, part in itertools.product(sides, START_NEARS[4::4]):
                yield replace(upright, near=reach * part, one_camera=entry)
            for entry in FLIPPED:
                yield replace(upright, one_camera=replace(entry, other_near=nominal.near))
            yield from (replace(upright, scene_scale=scale) for scale in START_SCALES)
            yield from (replace(upright, fov=(film, film)) for film in START_FILMS)
            if frustum.recentered:
                yield from (replace(upright, screen_height=height) for height in START_HEIGHTS)
            # In one aperture a wrong shear is a screen at another place, which is fitted.
            if frustum.recentered and several:
                shears = sorted(set(Recentering) - {nominal.recentering})
                for near, shear in itertools.product({nominal.near, reach * SHEARED_NEAR}, shears):
                    yield replace(upright, near=near, recentering=shear)

        def ranked(models: Iterable[RendererModel]) -> list[RendererModel]:
            result = [(_misfit(claims, model, cap), _changes(model), model) for model in models]
            return [model for *_, model in sorted(result, key=lambda entry: entry[:2])]

        # Step 1: every orientation and order, each with every single other hypothesis.
        orders = list(orientations(self.scene.plate.hogels)) if several else [UPRIGHT]
        ways = itertools.product(orientations(frustum.resolution), orders)
        upright = (replace(nominal, orientation=candidate, order=two) for candidate, two in ways)
        tried = ranked(itertools.chain.from_iterable(map(hypotheses, upright)))
        # Step 2: the best conventions, each with all values of near.
        conventions = {
            (
                candidate.orientation,
                candidate.order,
                candidate.recentering,
                candidate.one_camera,
            ): candidate
            for candidate in reversed(tried[:6])
        }
        nears = dict.fromkeys((nominal.near, *(reach * part for part in START_NEARS)))
        best = ranked(
            replace(convention, near=near) for convention in conventions.values() for near in nears
        )
        # Step 3: the best starts, and the best one of each group that was searched.
        plain = [
            candidate
            for candidate in tried
            if candidate.recentering is nominal.recentering and candidate.one_camera is None
        ]
        alone = [
            ranked(replace(plain[0], near=near, one_camera=camera) for near in nears)[0]
            for camera in sides
        ]
        of_groups = [
            next(
                (
                    candidate
                    for candidate in tried
                    if getattr(candidate, name) != getattr(nominal, name)
                ),
                tried[0],
            )
            for name in ("scene_scale", "fov", "screen_height")
        ]
        return list(dict.fromkeys([*best[:MAX_STARTS], tried[0], *of_groups, plain[0], *alone]))

    def fitted(
        self,
        claims: PixelClaims,
        start: RendererModel,
        free: Sequence[str],
        *,
        roughly: bool = False,
    ) -> RendererModel:
        """Fit some groups of a candidate, the others nominal; `roughly` ends near a pixel."""
        values, index = (
            self.nominal.parameters,
            np.array(_determined(self.scene, free), dtype=np.int64),
        )
        if not len(index):
            return start.with_parameters(values)
        values[index] = start.parameters[index]
        numbers = table(self.scene, values)
        scales, low, high = (column[index] for column in (numbers.scale, numbers.low, numbers.high))
        cap = self.scene.frustum.resolution[0] / 2

        def failures(scaled: Floats) -> Floats:
            values[index] = scaled * scales
            return outside_px(claims, start.with_parameters(values), cap)

        # The first fit counts failures of up to a pixel by their squares, so that outlines that are
        # pixels apart attract each other. The second one, with the scale of snapping, is precise.
        scaled, bounds = np.clip(values[index], low, high) / scales, (low / scales, high / scales)
        options = {
            "bounds": bounds,
            "x_scale": "jac",
            "loss": "soft_l1",
            "ftol": 1e-6,
            "xtol": 1e-7,
        }
        for attraction_px, trials in ((ATTRACTION_PX, 12), (SNAP_PX, 25))[: 1 if roughly else 2]:
            scaled = least_squares(
                failures, scaled, f_scale=attraction_px, max_nfev=trials, **options
            ).x
        values[index] = scaled * scales
        return start.with_parameters(values)

    def bent(self, claims: PixelClaims, starts: Sequence[RendererModel]) -> Found:
        """Return the candidate with equal angles and at most one group off nominal that holds."""
        few, films = claims.thinned(MAX_SCREENED_CLAIMS), [Film(angles=angles) for angles in ANGLES]
        plain = dict.fromkeys(start.with_parameters(self.nominal.parameters) for start in starts)
        tried = [replace(start, film=film) for start, film in itertools.product(plain, films)]
        least, best = min(
            ((_misfit(few, candidate), candidate) for candidate in tried), key=lambda pair: pair[0]
        )
        if least > MAX_LENS_RATIO * min(_misfit(few, start) for start in starts):
            return []
        return self.simplest(claims, [best], range(2), NOISE_FACTOR * SNAP_PX)

    def freest(self, claims: PixelClaims, starts: Sequence[RendererModel]) -> RendererModel:
        """Return the best candidate with all groups free, the better conditioned ones first."""
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

    def simplest(
        self,
        claims: PixelClaims,
        starts: Sequence[RendererModel],
        counts: Iterable[int],
        limit_px: float,
    ) -> Found:
        """Return candidates with fewest groups off nominal whose noise keeps a limit."""
        few = claims.thinned(MAX_SCREENED_CLAIMS)
        passing: dict[object, tuple[tuple[float, ...], RendererModel, tuple[str, ...]]] = {}
        # Three fits, each more expensive: a rough one on few claims already rejects most sets.
        stages = (
            (few, True, max(MAX_NOISE_PX, limit_px)),
            (few, False, NOISE_FACTOR * limit_px),
            (claims, False, limit_px),
        )
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
        result = [
            (item, free) for _, item, free in sorted(passing.values(), key=lambda entry: entry[0])
        ]
        # A picture that is mirrored with the other half is the same, and no explanation of its own.
        turned = {(entry.orientation, entry.order) for entry, _ in result[:1]}
        return [
            (entry, free) for entry, free in result if (entry.orientation, entry.order) in turned
        ]

    def _rank(
        self, claims: PixelClaims, model: RendererModel, free: tuple[str, ...]
    ) -> tuple[float, ...]:
        """Return the sort key of a candidate: fewest numbers first, then by preference."""
        off = np.abs(model.parameters - self.nominal.parameters) > smallest_named(self.scene)
        names = ("pivot", "fit", "recentering", "one_camera")
        choices = sum(getattr(model, name) != getattr(self.nominal, name) for name in names)
        preference = sum(PREFERENCE.index(name) for name in free)
        # Apertures at corners or edges of hogels, half a pitch off center, are the likelier
        # mistakes.
        pitch = np.divide(self.scene.plate.size, self.scene.plate.hogels)
        offset = np.abs(model.aperture_offset)
        at_corner = (np.minimum(offset, np.abs(offset - pitch / 2)) <= CORNER_PITCHES * pitch).all()
        if "aperture-offset" in free and at_corner and (offset > CORNER_PITCHES * pitch).any():
            preference = -1
        if (
            "shift" in free
            and self.scene.frustum.recentered
            and np.abs(model.shift).max() > MAX_SAMPLING_PX
        ):
            preference += len(PREFERENCE)
        return int(off.sum()), choices, *_changes(model), preference, _misfit(claims, model)

    def variants(
        self, starts: Sequence[RendererModel], free: tuple[str, ...]
    ) -> list[RendererModel]:
        """Return the start values of fits of some groups, taken from the starting points.

        A defect that a starting point states in another group is translated: the freest candidate
        has a
        moved scene in place of moved apertures, may have another pitch in place of another size,
        and may have a part of a moved screen as a shift of the sampling points, or the reverse.
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
                moved = np.asarray(start.screen_center) + np.asarray(start.shift) * per_px
                if "shift" not in free:
                    spoken = replace(spoken, screen_center=(float(moved[0]), float(moved[1])))
                elif "screen-center" not in free:
                    shift = (moved / per_px).tolist()
                    spoken = replace(spoken, shift=(shift[0], shift[1]))
            values = nominal.parameters
            values[index] = spoken.parameters[index]
            model = replace(start, pivot=nominal.pivot, fit=nominal.fit).with_parameters(values)
            both = self.scene.frustum.recentered and model.near
            variants |= dict.fromkeys(_with_pivots(model) if both else [model])
        return list(variants)


def _interval(
    claims: PixelClaims, model: RendererModel, free: Sequence[int], noise_px: float
) -> tuple[Floats, Floats, Floats]:
    """Return middle, lowest and highest values (P,) under which claims fail by noise alone.

    Each claim gives an inequality: the distance of the pixel's center from each edge of its
    triangle, counted inward, is at least zero, rounding and noise allowed. After linearizing, the
    candidates that satisfy all claims form a convex cell; linear programming finds its extent along
    each axis. A renderer without a near offset may have one that is too small to be seen, because
    no camera has its near plane in its center: all values are allowed that some such offset allows.
    """
    values = model.parameters
    middle, low, high = values.copy(), values.copy(), values.copy()
    if not free or not len(claims):
        return values, low, high
    # Step 1: the distances that can bound the fit, and how fast each changes with each number that
    # may move, by finite differences. An unseen near offset moves too; it has no interval of its
    # own.
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
    # Step 2: distance + slopes . x >= -allowed, with x in steps, and each number within its bounds.
    box = np.stack(
        [(end[moving] - values[moving]) / steps for end in (numbers.low, numbers.high)], axis=1
    )
    if unseen:
        box[-1, 1] = UNSEEN_NEAR_PER_REACH * claims.scene.frustum.longest_reach / steps[-1]
        # Surfaces in the plate itself move by any distance, and not in proportion.
        kept &= np.abs(slopes[:, -1]) * box[-1, 1] < NEIGHBORHOOD_PX
    # Step 3: the smallest and the largest value of each number in the cell. Numbers count here in
    # pixels by which they move outlines at most: with columns of 1e-8 and of 1e-5 px a step, and no
    # bounds, the solver failed, and wrote so into the JSON on standard output.
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
