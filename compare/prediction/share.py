"""Closed form of the share of pixels that a depth buffer shows wrongly, from the truth's geometry alone.

A pixel's surface is at stake in two ways (docs/method.md, "The error budget"):

* order: the next surface that the same camera sees in the same slab is stored in front of it, or as equal
  and was drawn first. Surfaces in different slabs have depth buffers of their own;
* lost: its stored depth is the clear value's own, which a strict test does not let in.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from xfrustum.compare.prediction.depth import depth_variance, float32_spacing, stored_depth
from xfrustum.compare.prediction.stacks import Stacks
from xfrustum.compare.rounding.depth import STEP
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.plate.double_frustum import Camera, DepthFormat, DepthMapping, DoubleFrustum, Offset
from xfrustum.scenes.plate.frustum import Frustum

DRAW_ORDER = 2.0
"""How much larger the share may be than is expected of an unknown draw order, by which surfaces that are
stored as equal are wrong half the time: at most all of them are."""

BINS_PER_OCTAVE = 256
"""Of w: roundings change by less than half a percent within a bin, and jump between octaves."""

_SHIFT = 23 - (BINS_PER_OCTAVE.bit_length() - 1)
"""Bits of a float32's mantissa that tell apart what is in one bin."""

CERTAIN = 6.0
"""Standard deviations beyond which an order is not in doubt: a share of 1e-9."""


SMALLEST_STEP = 1e-3
"""Of the error: a smaller step is lost in it, and its formula in float64's rounding."""


@dataclass(frozen=True, kw_only=True)
class Slab:
    """One camera's slab and its depth buffer (docs/method.md, "Splitting").

    Attributes
    ----------
    camera
        C or C*.
    low, high
        Heights |z| between which it draws.
    step
        How far its camera stands back from the aperture.
    near, far
        Distances of its planes from the camera.
    """

    camera: Camera
    low: float
    high: float
    step: float
    near: float
    far: float


def slabs(frustum: Frustum, settings: DoubleFrustum) -> Iterator[Slab]:
    """Yield every slab of the cameras that draw, from the plate outward.

    The slab that touches the plate has its near plane at n, and cameras that have stepped back by n where
    the offset says so; each other one stands in the aperture, with its near plane at its lower cut.
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
                yield Slab(camera=camera, low=nearest, high=high, step=step, near=near, far=high + step)


def depth_wrong_share(
    stacks: Stacks, frustum: Frustum, settings: DoubleFrustum, *, unlucky: bool = False
) -> float:
    """Return the expected share of judged pixels that the depth buffer alone shows wrongly.

    That is wrongly with these settings, and rightly with linear D32F depth (docs/method.md).

    Parameters
    ----------
    stacks
        Of the true image of an aperture.
    frustum
        The scene's.
    settings
        How the two cameras draw.
    unlucky
        Whether all equal depths count, as if what must not show were always drawn first. Else they
        count half: the draw order is not known.

    Returns
    -------
    Between 0 and 1; 0 where no pixel is judged.

    Notes
    -----
    Let the two surfaces' depths differ by D in stored units, before rounding, and be known within a normal
    error of standard deviation e, that of both together (`predict_depth`). A format of step q, whose phase
    is anywhere, orders a difference x wrongly with chance (1 - x / q) / 2 between -q and q: equal with
    chance 1 - |x| / q, and then wrong half the time. Over the normal error that is

        e / (2 q) (F((q - D) / e) - F((-q - D) / e)),    F(a) = a Phi(a) + phi(a).

    A surface is lost where its depth is rounded to the clear value, within half a step of it. Errors of
    that depth have variance e^2 / 2. A surface at a cut is in two slabs, and lost where both lose it.

    What linear depth gets wrong too is taken off as if it were the same pixels: those that come too close
    to the far plane, or to each other, for any format.
    """
    control = replace(settings, depth=DepthFormat.D32F, mapping=DepthMapping.LINEAR)
    order = DRAW_ORDER if unlucky else 1.0
    expected = 0.0
    for camera, distance in stacks.distance.items():
        own = [slab for slab in slabs(frustum, settings) if slab.camera is camera]
        gap = stacks.gap[camera]
        wrong = chances(own, distance, gap, settings, order)
        at = np.flatnonzero(wrong)
        anyway = chances(own, distance[at], gap[at], control, order)
        expected += float(np.maximum(wrong[at] - anyway, 0.0).sum())
    return expected / stacks.judged if stacks.judged else 0.0


def chances(
    own: Sequence[Slab], distance: Floats, gap: Floats, settings: DoubleFrustum, order: float
) -> Floats:
    """Return the chance of each surface to be shown wrongly by the slabs of its camera, (N,).

    Parameters
    ----------
    own
        Of one camera.
    distance, gap
        (N,) |z| of the surfaces, and how far behind them the camera sees the next.
    settings
        How it draws.
    order
        How many times as often as in unknown draw order equal depths are wrong, 1 to `DRAW_ORDER`.
    """
    least = np.full(len(distance), np.inf)
    for slab in own:
        found = (distance <= slab.high) & (distance >= slab.low)
        # Without other slabs that is nearly always all there is.
        inside: Indices | slice = slice(None) if found.all() else np.flatnonzero(found)
        chance = _chance(slab, distance[inside], gap[inside], settings, order)
        least[inside] = np.minimum(least[inside], chance)
    return np.where(np.isfinite(least), least, 0.0)


def _chance(slab: Slab, distance: Floats, gap: Floats, settings: DoubleFrustum, order: float) -> Floats:
    """Return the chance of each surface of one slab to be shown wrongly."""
    w = distance + slab.step
    known = _Table.of(slab, settings)
    row = known.rows(w)
    # C starts from its far value, C* from its near value.
    clear = slab.far if slab.camera is Camera.C else slab.near
    apart = _difference(w, np.abs(clear - w), clear, slab, settings.mapping)
    wrong = np.zeros_like(w)
    at = np.flatnonzero(apart < known.doubtful[row])
    wrong[at] = ndtr((known.step[row[at]] / 2 - apart[at]) / (known.error[row[at]] * np.sqrt(0.5)))
    # C keeps the nearest, and its runner-up lies beyond it; what C* keeps is farther than its own.
    other = w + (gap if slab.camera is Camera.C else -gap)
    paired = np.flatnonzero((other >= slab.low + slab.step) & (other <= slab.far))
    apart = _difference(w[paired], gap[paired], other[paired], slab, settings.mapping)
    close = apart < known.doubtful[row[paired]]
    at = paired[close]
    # Of what is not lost.
    misordered = order * _misordered(apart[close], known.step[row[at]], known.error[row[at]])
    wrong[at] += (1 - wrong[at]) * np.minimum(misordered, 1.0)
    return wrong


def _difference(w: Floats, gap: Floats, other: Floats | float, slab: Slab, mapping: DepthMapping) -> Floats:
    """Return how far apart in stored units depths are at w and at another, a gap away; no cancellation."""
    n, f = slab.near, slab.far
    if mapping is DepthMapping.LINEAR:
        return gap / (f - n)
    if mapping is DepthMapping.LOGARITHMIC:
        return np.asarray(np.log1p(gap / np.minimum(w, other)) / np.log(f / n))
    return np.asarray(f * n / (f - n) * gap / (w * other))


def _misordered(difference: Floats, step: Floats, error: Floats) -> Floats:
    """Return the chance that two surfaces are shown in the wrong order; see `depth_wrong_share`."""

    def integral(a: Floats) -> Floats:
        return np.asarray(a * ndtr(a) + np.exp(-(a**2) / 2) / np.sqrt(2 * np.pi))

    ahead, behind = (step - difference) / error, (-step - difference) / error
    return np.asarray(error / (2 * step) * (integral(ahead) - integral(behind)))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Table:
    """How exactly a slab's buffer knows depth, by w in bins; a bin is a float32's leading bits.

    Attributes
    ----------
    first
        Bin of the near plane.
    step, error
        Distance of neighboring stored values, and standard deviation of two surfaces' difference.
    doubtful
        Differences below this may be ordered wrongly.
    """

    first: int
    step: Floats
    error: Floats
    doubtful: Floats

    @classmethod
    def of(cls, slab: Slab, settings: DoubleFrustum) -> _Table:
        first, last = _bins(np.array([slab.near, slab.far])).tolist()
        edges = (np.arange(first, last + 2, dtype=np.uint32) << _SHIFT).view(np.float32)
        w = np.clip((edges[:-1].astype(np.float64) + edges[1:]) / 2, slab.near, slab.far)
        stored, _ = stored_depth(w, slab.near, slab.far, settings.mapping)
        error = np.sqrt(2 * depth_variance(w, stored, slab.near, slab.far, settings.mapping))
        step = np.maximum(STEP[settings.depth] or float32_spacing(stored), SMALLEST_STEP * error)
        return cls(first=first, step=step, error=error, doubtful=step + CERTAIN * error)

    def rows(self, w: Floats) -> Indices:
        """Return the bin of each w."""
        return np.clip(_bins(w) - self.first, 0, len(self.step) - 1)


def _bins(w: Floats) -> Indices:
    return (w.astype(np.float32).view(np.uint32) >> _SHIFT).astype(np.int64)
