"""Closed forms of depth buffers: the smallest resolved separation, and the share of wrong pixels.

Two independent errors limit the separation of two surfaces, and their squares add: the step of the
format, within which distinct depths are stored as equal; and the float32 rounding of depth before
it is stored. Each rounding error is uniform within half a unit in the last place of the rounded
number and has a variance of a twelfth of a unit squared. The error of the difference of two
surfaces has twice the variance, and is close to normal.

Depth errors make a pixel wrong in two ways, `order` and `lost` (docs/method.md, "The error
budget"). Surfaces in different slabs have separate depth buffers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from statistics import NormalDist
from typing import assert_never

import numpy as np
from scipy.special import ndtr

from xfrustum.compare.rounding.depth import LOG_ULPS, STEP
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.device_model import DeviceModel, safe_model
from xfrustum.scenes.model.images import HogelImage
from xfrustum.scenes.plate import Camera, DepthFormat, DepthMapping, DoubleFrustum, Frustum, Offset

#: Largest share of wrong pixels at a separation that counts as resolved; equal to
#: `tolerances.MAX_WRONG`.
MAX_MISORDERED_FRACTION = 0.01

#: Roundings of a vertex's depth, relative to w: clip depth is a product and a sum, and clip w is
#: rounded.
CLIP_DEPTH_ROUNDINGS = 3

PLANE_ROUNDINGS = 2  #: roundings of a triangle's plane equation: one step along x and one along y

#: Roundings of a fragment's w: the surface's position, clip w, its reciprocal, the two steps of the
#: plane equation of 1 / w, and the reciprocal of 1 / w.
W_ROUNDINGS = 6

#: Roundings of the depth that a fragment computes from w. Linear depth is rounded by a subtraction,
#: a division and the store; for logarithmic depth, the half units in the last place of the
#: logarithm's error are counted. The approximation error of the logarithm, apart from rounding, is
#: equal for two close depths and cancels.
EXPRESSION_ROUNDINGS = {DepthMapping.LINEAR: 3, DepthMapping.LOGARITHMIC: LOG_ULPS}


def smallest_separation(
    w: Floats,
    near_plane: float,
    far_plane: float,
    depth: DepthFormat,
    mapping: DepthMapping,
    device: DeviceModel | None = None,
) -> Floats:
    """Return the smallest separation along w, in scene units, that a depth buffer resolves.

    `w` (...) are distances of the surfaces from the camera along its axis, between the planes. At
    this separation, the share `MAX_MISORDERED_FRACTION` of the pixels shows the wrong surface;
    equal depths count as wrong. The separation is the same for C (nearest wins) and C* (farthest
    wins). With `device` None, depth is rounded to the nearest step. A device model allows an error
    of several steps, and the step of the format is multiplied by their number.

    For b bits, the step by itself corresponds to a separation (docs/method.md) of w^2 (f - n) / (f
    n 2^b) with the hyperbolic mappings, w ln(f / n) / 2^b with the logarithmic one, and
    (f - n) / 2^b with the linear one. The step of D32F is the spacing of float32 at the stored
    value: near one it equals the 24-bit step; for reversed depth it is 2^-24 to 2^-23 of w.
    """
    w = np.asarray(w, dtype=np.float64)
    stored, slope = stored_depth(w, near_plane, far_plane, mapping)
    steps = 1.0 if device is None else device.stored_steps(depth)
    step = steps * STEP[depth] or float32_spacing(stored)
    chance = NormalDist().inv_cdf(1 - MAX_MISORDERED_FRACTION)
    rounding = chance * np.sqrt(2 * depth_variance(w, near_plane, far_plane, mapping))
    return np.asarray(np.hypot(step, rounding) / slope)


def stored_depth(w: Floats, n: float, f: float, mapping: DepthMapping) -> tuple[Floats, Floats]:
    """Return the stored value before rounding, and the absolute derivative with respect to w."""
    match mapping:
        case DepthMapping.LOGARITHMIC:
            octaves = np.log(f / n)
            return np.log(w / n) / octaves, 1 / (w * octaves)
        case DepthMapping.LINEAR:
            return (w - n) / (f - n), np.full_like(w, 1 / (f - n))
        case DepthMapping.STANDARD | DepthMapping.GL:
            return f * (w - n) / (w * (f - n)), f * n / ((f - n) * w**2)
        case DepthMapping.REVERSED:
            return n * (f - w) / (w * (f - n)), f * n / ((f - n) * w**2)
        case _:
            assert_never(mapping)


def depth_variance(w: Floats, n: float, f: float, mapping: DepthMapping) -> Floats:
    """Return the variance of a stored depth due to float32 rounding."""
    stored, slope = stored_depth(w, n, f, mapping)
    spacing = float32_spacing(w)
    position = (slope * spacing) ** 2
    # Clip depth is a sum of two terms. Its rounding is relative to the larger one: 1, or n / w for
    # reversed depth.
    largest: Floats | float
    match mapping:
        case DepthMapping.LINEAR | DepthMapping.LOGARITHMIC:
            after = EXPRESSION_ROUNDINGS[mapping] * float32_spacing(stored) ** 2
            return np.asarray((W_ROUNDINGS * position + after) / 12)
        case DepthMapping.STANDARD | DepthMapping.GL:
            largest = f / (f - n)
        case DepthMapping.REVERSED:
            largest = f * n / ((f - n) * w)
        case _:
            assert_never(mapping)
    clip = CLIP_DEPTH_ROUNDINGS * (largest * spacing / w) ** 2
    if mapping is DepthMapping.GL:
        # Depth from -1 to 1 is rounded and halved; adding 1/2 rounds it once more.
        divided = float32_spacing(2 * stored - 1) ** 2
        moved = (1 + PLANE_ROUNDINGS) * float32_spacing(stored) ** 2
        return np.asarray((position + (clip + divided) / 4 + moved) / 12)
    return np.asarray((position + clip + (1 + PLANE_ROUNDINGS) * float32_spacing(stored) ** 2) / 12)


#: Mean of m_1^2 + m_2^2 + m_3^2 over a triangle, with m the weights of its corners: the ratio of
#: the variance of a pixel's depth to the variance of a corner's depth.
CORNERS_SQUARED = 0.5


def pair_variance(
    w: Floats, n: float, f: float, mapping: DepthMapping, device: DeviceModel
) -> Floats:
    """Return the depth variance of each of two surfaces with nearly equal depths.

    `depth_variance` is valid for any two surfaces. This variance is valid on average, over the
    surfaces of a scene:

    * Errors that both surfaces share cancel: with small n, the error of clip w = |z| + n is the
      same for all z of an octave.
    * Corners are rounded independently, and a pixel's depth is a weighted mean of three corners
      (`CORNERS_SQUARED`). The roundings of a corner are the product in clip depth, the sum if clip
      depth has a constant term, the reciprocal of w, and the product with this reciprocal.
    * Only some devices round the two steps of the plane equation.
    * The float32 rounding of the stored value equals the step of D32F, and the step of D24 for
      values of at least 1/2. For smaller values, and for D16, the rounding is finer than the step.
    """
    stored, slope = stored_depth(w, n, f, mapping)
    own, relative = float32_spacing(stored) ** 2, (float32_spacing(w) / w) ** 2
    reciprocal = (float32_spacing(1 / w) * w) ** 2
    match mapping:
        case DepthMapping.LINEAR | DepthMapping.LOGARITHMIC:
            return depth_variance(w, n, f, mapping)
        case DepthMapping.STANDARD:
            corner = (f / (f - n)) ** 2 * (relative + reciprocal) + own
        case DepthMapping.GL:
            divided = float32_spacing(2 * stored - 1) ** 2
            corner = ((f / (f - n)) ** 2 * (2 * relative + reciprocal) + divided) / 4 + own
        case DepthMapping.REVERSED:
            corner = (f * n / ((f - n) * w)) ** 2 * (2 * relative + reciprocal) + own
        case _:
            assert_never(mapping)
    steps = PLANE_ROUNDINGS * own if device.rounds_planes else 0.0
    return np.asarray(((slope * float32_spacing(w)) ** 2 + CORNERS_SQUARED * corner + steps) / 12)


def float32_spacing(values: Floats) -> Floats:
    """Return the distance of neighboring float32 numbers at some values."""
    return np.spacing(np.abs(values).astype(np.float32)).astype(np.float64)


#: device model by default
ANY = safe_model()

#: Largest ratio of the wrong share with the worst draw order to the share expected for an unknown
#: order. Surfaces stored at equal depth are wrong half the time in an unknown order, and always in
#: the worst order.
MAX_ORDER_FACTOR = 2.0

#: Bins of w in each octave. Within a bin, rounding errors change by less than half a percent
#: (1 / 256). They jump only at borders of octaves, which are borders of bins.
BINS_PER_OCTAVE = 256

#: Number of low mantissa bits of a float32 that vary within one bin.
_BIN_SHIFT_BITS = 23 - (BINS_PER_OCTAVE.bit_length() - 1)

#: Standard deviations of the depth error beyond which the order counts as certain: the tail of the
#: normal distribution there is 1e-9.
MAX_DOUBT_DEVIATIONS = 6.0

#: Lower limit of the step of a format, as a fraction of the depth error. The effect of a smaller
#: step is negligible, and the difference quotient of `_misordered` would lose it to float64
#: rounding.
MIN_STEP_PER_ERROR = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Surfaces:
    """N surfaces that one camera shows, with distances to the next surfaces, scene units."""

    distance: Floats  #: (N,) |z|
    gap: Floats  #: (N,) distance to the next surface on the same line, see `Reference.gaps`
    #: (N,) distance to the next surface drawn earlier; None if the order is unknown
    earlier: Floats | None = None

    def at(self, places: Indices | Mask) -> Surfaces:
        """Return the surfaces at these indices."""
        earlier = None if self.earlier is None else self.earlier[places]
        return Surfaces(distance=self.distance[places], gap=self.gap[places], earlier=earlier)


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthLayers:
    """Surfaces in judged pixels of a true image, by camera."""

    judged: int  #: pixels whose truth is not a tie
    surfaces: Mapping[Camera, Surfaces]

    @classmethod
    def from_truth(
        cls, truth: HogelImage, gaps: Floats, earlier: Floats | None = None
    ) -> DepthLayers:
        """Return the layers of a true image and its gaps, (H, W), from `Reference.gaps`."""
        # This import loads the reference and its tracers, which the command `check` must not need.
        from xfrustum.compare.error_maps import judged_pixels  # noqa: PLC0415

        judged, height = judged_pixels(truth).ravel(), truth.height.astype(np.float64).ravel()
        every = Surfaces(
            distance=np.abs(height),
            gap=gaps.ravel(),
            earlier=None if earlier is None else earlier.ravel(),
        )
        sides = {Camera.C: height <= 0, Camera.C_STAR: height > 0}
        return cls(
            judged=int(judged.sum()),
            surfaces={camera: every.at(judged & side) for camera, side in sides.items()},
        )


@dataclass(frozen=True, kw_only=True)
class DepthRange:
    """Depth range of one camera (docs/method.md, "Splitting"); lengths in scene units."""

    camera: Camera
    low: float  #: smallest and largest |z| that the camera draws
    high: float
    step: float  #: distance by which the camera has stepped back from the aperture
    near: float  #: distances of the planes from the camera
    far: float


def slabs(frustum: Frustum, settings: DoubleFrustum) -> Iterator[DepthRange]:
    """Yield every slab of the cameras that draw, from the plate outward.

    The near plane of the slab that touches the plate is at n, and its camera is offset by n if
    `Offset` requires it. The cameras of the other slabs are in the aperture, and their near planes
    are the lower cuts.
    """
    sides = {Camera.C: frustum.reach[1], Camera.C_STAR: frustum.reach[0]}
    for camera, reach in sides.items():
        if settings.camera not in (Camera.BOTH, camera):
            continue
        for low, high in settings.sections(reach):
            step = settings.near if low == 0 and settings.offset is Offset.PLATE else 0.0
            near = settings.near if low == 0 else low
            nearest = near - step
            if nearest < high:
                yield DepthRange(
                    camera=camera, low=nearest, high=high, step=step, near=near, far=high + step
                )


def depth_wrong_shares(
    layers: DepthLayers,
    frustum: Frustum,
    settings: Sequence[DoubleFrustum],
    device: DeviceModel = ANY,
    *,
    unlucky: bool = False,
) -> list[float]:
    """Return the expected shares, 0 to 1, of judged pixels that only the depth buffer makes wrong.

    The settings differ only in their depth buffers. The counted pixels are wrong with the buffer of
    a setting and right with linear D32F depth. Surfaces stored at equal depths are wrong if the
    other surface is drawn first (`Surfaces.earlier`). If the order is unknown, half of them count
    as wrong, and all of them with `unlucky`.

    Let the two surfaces' depths differ by D in stored units, before rounding, and let this
    difference have a normal error of standard deviation e. A format with step q and a uniformly
    distributed phase orders a difference x between -q and q wrongly with probability
    (1 - x / q) / 2: the two depths are stored as equal with probability 1 - |x| / q, and are then
    wrong half the time. The mean over the normal error is

        e / (2 q) (F((q - D) / e) - F((-q - D) / e)),    F(a) = a Phi(a) + phi(a).

    If the order is known, the interval from -q to q of F is replaced by 0 to q if the other surface
    is drawn first, and by -q to 0 if it is drawn later; the result is doubled. If other surfaces of
    both kinds exist, the larger probability counts. If e is small compared with q, the phase is
    computed from the depth and used as well (`_misordered_steps`).

    A surface is lost if its depth lies within half a step of the clear value; the error of this
    single depth has variance e^2 / 2. A surface at a cut is in two slabs, and is lost if both slabs
    lose it. The expected number of pixels that are wrong with linear depth is subtracted, on the
    assumption that the other buffers make the same pixels wrong.
    """
    # Linear D32F depth stands in for a depth buffer without errors.
    control = replace(settings[0], depth=DepthFormat.D32F, mapping=DepthMapping.LINEAR)
    order = MAX_ORDER_FACTOR if unlucky else 1.0
    expected = np.zeros(len(settings))
    for camera, shown in layers.surfaces.items():
        own = [slab for slab in slabs(frustum, settings[0]) if slab.camera is camera]
        surfaces = replace(shown, earlier=None) if unlucky else shown
        wrong = chances(own, surfaces, settings, order, device)
        # Subtract the probability under linear depth, computed only for the few pixels that may be
        # wrong.
        at = np.flatnonzero(wrong.any(axis=0))
        anyway = chances(own, surfaces.at(at), [control], order, device)
        expected += np.maximum(wrong.take(at, axis=1) - anyway, 0.0).sum(axis=1)
    return [float(count) / max(layers.judged, 1) for count in expected]


def chances(
    own: Sequence[DepthRange],
    surfaces: Surfaces,
    settings: Sequence[DoubleFrustum],
    order: float = 1.0,
    device: DeviceModel = ANY,
) -> Floats:
    """Return the probability that each surface is wrong in its camera's slabs, (settings, N).

    `order` is the ratio, from 1 to `MAX_ORDER_FACTOR`, of the misordered share to the share with an
    unknown draw order.
    """
    distance = surfaces.distance
    least = np.full((len(settings), len(distance)), np.inf)
    for slab in own:
        inside = np.flatnonzero((distance <= slab.high) & (distance >= slab.low))
        chance = _chance(slab, surfaces.at(inside), settings, order, device)
        for row, of_setting in zip(least, chance, strict=True):
            row[inside] = np.minimum(row[inside], of_setting)
    return np.where(np.isfinite(least), least, 0.0)


def _chance(
    slab: DepthRange,
    surfaces: Surfaces,
    settings: Sequence[DoubleFrustum],
    order: float,
    device: DeviceModel,
) -> Floats:
    """Return the probability that each surface of one slab is wrong, (settings, N)."""
    # Lost: the depth, with the error of one surface, is within half a step of the clear value. The
    # buffer of C is cleared to its far value, and the buffer of C* is cleared to its near value.
    nearest_wins = slab.camera is Camera.C
    w, clear = surfaces.distance + slab.step, slab.far if nearest_wins else slab.near
    kinds = [(surfaces.gap, _COIN)]
    if surfaces.earlier is not None:
        kinds = [(surfaces.gap, _LATER), (surfaces.earlier, _EARLIER)]
    # Order: C keeps the nearest surface, and the next surface lies beyond it. C* keeps the farthest
    # surface, and the next surface lies closer to the camera. Pairs in different slabs are not
    # compared.
    pairs = []
    for gap, ends in kinds:
        other = w + (gap if nearest_wins else -gap)
        places = np.flatnonzero((other >= slab.low + slab.step) & (other <= slab.far))
        pairs.append((places, w[places], gap[places], other[places], ends))

    # Arrays that do not depend on the buffer take most of the time, and are cached.
    @cache
    def apart(pair: int, mapping: DepthMapping) -> Floats:
        _, own, gap, other, _ = pairs[pair]
        return _difference(own, gap, other, slab, mapping)

    @cache
    def from_clear(mapping: DepthMapping) -> Floats:
        return _difference(w, np.abs(clear - w), clear, slab, mapping)

    chances = np.zeros((len(settings), w.size))
    for wrong, buffer in zip(chances, settings, strict=True):
        depth, mapping = buffer.depth, buffer.mapping
        known, alike = _table(slab, depth, mapping, device), _ALIKE.get(mapping, mapping)
        at, row = known.in_doubt(w, lost := from_clear(alike))
        wrong[at] = ndtr((known.step[row] / 2 - lost[at]) / (known.error[row] * np.sqrt(0.5)))
        misordered = np.zeros_like(w)
        for number, (places, own, _, _, ends) in enumerate(pairs):
            close, row = known.in_doubt(own, apart(number, alike))
            difference, step, error = apart(number, alike)[close], known.step[row], known.error[row]
            chance = order * _misordered(difference, step, error, ends)
            # If the error is small compared with a fixed step, the position of depths between steps
            # matters.
            sharp = (error < MAX_SHARP_ERROR * step) & (ends != _COIN) & (STEP[depth] > 0)
            if sharp.any():
                # C keeps the smaller depth, and C* keeps the larger depth; a falling mapping
                # exchanges the two.
                falls = (mapping is DepthMapping.REVERSED) == nearest_wins
                place = stored_depth(own[close[sharp]], slab.near, slab.far, mapping)[0]
                last = 1 / STEP[depth] - 1  # the largest stored number, which represents 1
                between = (-last if falls else last) * place, last * difference[sharp]
                spread = error[sharp] / step[sharp] * np.sqrt(0.5)
                chance[sharp] = _misordered_steps(between, spread, ends)
            at = places[close]
            misordered[at] = np.maximum(misordered[at], np.minimum(chance, 1.0))
        # Only a surface that is not lost can be misordered; the two events are taken as
        # independent.
        np.add(wrong, (1 - wrong) * misordered, out=wrong)
    return chances


#: Mappings whose depth differences equal the depth differences of another mapping.
_ALIKE = {DepthMapping.GL: DepthMapping.STANDARD, DepthMapping.REVERSED: DepthMapping.STANDARD}


def _difference(
    w: Floats, gap: Floats, other: Floats | float, slab: DepthRange, mapping: DepthMapping
) -> Floats:
    """Return the difference of depths at w and `other`, stored units, free of cancellation."""
    n, f = slab.near, slab.far
    match mapping:
        case DepthMapping.LINEAR:
            return gap / (f - n)
        case DepthMapping.LOGARITHMIC:
            return np.asarray(np.log1p(gap / np.minimum(w, other)) / np.log(f / n))
        case DepthMapping.STANDARD | DepthMapping.GL | DepthMapping.REVERSED:
            return np.asarray(f * n / (f - n) * gap / (w * other))
        case _:
            assert_never(mapping)


#: Range of depth differences, in steps, over which the probability of a wrong order falls from one
#: to zero: draw order unknown, other surface drawn later, other surface drawn earlier.
_COIN, _LATER, _EARLIER = (-1, 1), (-1, 0), (0, 1)


def _misordered(difference: Floats, step: Floats, error: Floats, ends: tuple[int, int]) -> Floats:
    """Return the probability of a wrong order of two surfaces; see `depth_wrong_shares`."""

    # F of `depth_wrong_shares`, the integral of the normal distribution function.
    def integral(a: Floats) -> Floats:
        return np.asarray(a * ndtr(a) + np.exp(-(a**2) / 2) / np.sqrt(2 * np.pi))

    behind, ahead = ((end * step - difference) / error for end in ends)
    return np.asarray(error / ((ends[1] - ends[0]) * step) * (integral(ahead) - integral(behind)))


#: Largest error of the difference of two depths, in steps, for which the position of the depths
#: between steps matters. Six standard deviations of each depth, 6 / sqrt(2) 0.25 = 1.06 steps,
#: reach no farther than the next step.
MAX_SHARP_ERROR = 0.25


def _misordered_steps(
    places: tuple[Floats, Floats], error: Floats, ends: tuple[int, int]
) -> Floats:
    """Return the probability of `_misordered` for depths whose steps and distance are known.

    The visible surface is stored at its nearest step or an adjacent step. The other surface hides
    it if the depth test prefers the other surface's step, or if both have the same step and the
    other surface is drawn earlier.
    """
    place, apart = places
    step = np.round(place)
    below, above = ndtr((step - 0.5 - place) / error), ndtr((place - step - 0.5) / error)
    border = step + sum(ends) / 2 - place - apart
    weights = (below, 1 - below - above, above)
    return np.asarray(
        sum(part * ndtr((border + k) / error) for k, part in zip((-1, 0, 1), weights, strict=True))
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Table:
    """Depth resolution of a slab, stored units, for bins of w with equal leading float32 bits."""

    first: int
    step: Floats  #: distance of neighboring stored values
    error: Floats  #: standard deviation of the difference of two surfaces' depths
    doubtful: Floats  #: difference of two depths below which their order may be wrong

    def in_doubt(self, w: Floats, apart: Floats) -> tuple[Indices, Indices]:
        """Return the indices of depth pairs that may be misordered, and their rows of the table."""
        # Most differences exceed the largest doubtful difference at any w.
        near = np.flatnonzero(apart < np.fmax.reduce(self.doubtful))
        row = np.clip(_bins(w[near]) - self.first, 0, len(self.step) - 1)
        doubted = apart[near] < self.doubtful[row]
        return near[doubted], row[doubted]


@lru_cache(maxsize=16)
def _table(
    slab: DepthRange, depth: DepthFormat, mapping: DepthMapping, device: DeviceModel
) -> _Table:
    used = np.clip(np.array([slab.low, slab.high]) + slab.step, slab.near, slab.far)
    first, last = _bins(used).tolist()
    edges = (np.arange(first, last + 2, dtype=np.uint32) << _BIN_SHIFT_BITS).view(np.float32)
    # A bin is represented by its middle, clipped to the range of the near and far plane.
    w = np.clip((edges[:-1].astype(np.float64) + edges[1:]) / 2, slab.near, slab.far)
    stored, _ = stored_depth(w, slab.near, slab.far, mapping)
    error = np.sqrt(2 * pair_variance(w, slab.near, slab.far, mapping, device))
    step = np.maximum(STEP[depth] or float32_spacing(stored), MIN_STEP_PER_ERROR * error)
    return _Table(first=first, step=step, error=error, doubtful=step + MAX_DOUBT_DEVIATIONS * error)


def _bins(w: Floats) -> Indices:
    return (w.astype(np.float32).view(np.uint32) >> _BIN_SHIFT_BITS).astype(np.int64)
