"""Mistakes of single hogels, apertures and rows: stale or exchanged images, jitter, shifted odd rows.

Each is looked for under a guess about the cameras; what is off is compared or fitted by itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from xfrustum.compare.diagnosis.faults import Defect, moved_words
from xfrustum.compare.diagnosis.geometry_fit import (
    MAX_FITTED_CLAIMS,
    GeometryFit,
    PixelClaims,
    fit_alone,
    fit_geometry,
    interval_alone,
    outside_px,
)
from xfrustum.compare.diagnosis.registration import DERIVATIVE_STEP_PX, fit_drawn, px_per_unit
from xfrustum.compare.diagnosis.scene_faults import MAX_PART_NOISE_PX, MIN_PART_CLAIMS, Guess
from xfrustum.compare.renderer_model.conventions import UPRIGHT
from xfrustum.compare.renderer_model.drawn_model import Index, RendererModel, places, smallest_named
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

if TYPE_CHECKING:  # it tests what is found here
    from xfrustum.compare.diagnosis.diagnosis import TestSet

STALE, EXCHANGED, JITTER, SHIFTED_ROWS, SHIFTED_COLUMNS = (
    *("stale-hogel", "hogels-exchanged", "jitter"),
    *("rows-shifted", "columns-shifted"),
)

# Smallest share of a hogel's pixels, wrong without a cause, with which it is an outlier, and
# largest share of them that may stay wrong when it is taken for another's image: what a guess must
# explain.
MIN_OUTLYING_FRACTION, MAX_LEFT_FRACTION = 0.02, 0.1

# Apertures that an outlier's image is compared with, nearest first: all neighbors, and those after
# them. And the number of outliers after which, if none shows another's image, the others are not
# compared.
MAX_TRIED_APERTURES, MAX_FAILED_HOGELS = 12, 3

# Shifts of odd rows and columns that are tried, in pixels, and share of their claims that must
# hold.
TRIED_SHIFTS_PX, MIN_HELD_FRACTION = (1, -1, 2, -2), 0.95

# Groups of numbers that all apertures share, beside offsets of their own.
SHARED_GROUPS = ("near", "fov", "shift")

MAX_TOLD = 10
"""Largest number of hogels that are named in words."""


def hogel_guesses(
    evidence: TestSet, claims: PixelClaims | None, fits: Sequence[GeometryFit]
) -> Iterator[Guess]:
    """Yield guesses about single hogels and rows, from fits of the cameras that all of them share."""
    # Without claims every guess is drawn: the best one and the nominal one are all that is tried.
    few = fits if claims is not None else list(dict.fromkeys((fits[0], fits[-1])))
    for search in (_with_other_images, _with_odd_lines, _with_offsets):
        # Pitch and offsets that a fit found may stand for the mean of the apertures' own: nominal
        # ones first.
        for fit in few[::-1] if search is _with_offsets else few:
            found = search(evidence, claims, fit)
            if found is not None:
                yield found
    # Odd lines that mislead every fit of all claims leave those of the even lines as they are.
    for axis in (0, 1) if claims is not None else ():
        assert claims is not None
        fit = fit_geometry(
            claims.chosen(claims.pixel[:, axis] % 2 == 0), evidence.nominal, simple=True
        )
        if fit.noise_px <= MAX_PART_NOISE_PX and fit.model != evidence.nominal:
            found = _with_odd_lines(evidence, claims, fit)
            if found is not None:
                yield found


def outlying(evidence: TestSet, model: RendererModel) -> bool:
    """Return whether many pixels of the evidence are wrong by a guess, without a known cause."""
    pixels = len(evidence.tested) * np.prod(evidence.reference.scene.frustum.resolution)
    return bool(evidence.wrong(model, explained=True) > MIN_OUTLYING_FRACTION * pixels)


def _with_other_images(
    evidence: TestSet, claims: PixelClaims | None, fit: GeometryFit
) -> Guess | None:
    """Return a guess in which hogels show the images of other apertures."""
    scene, model = evidence.reference.scene, fit.model
    shows: dict[Index, list[Index]] = {}
    failed = 0
    for image in evidence.images:
        alone, index = evidence.of([image]), image.camera.aperture.index
        if not outlying(alone, model):
            continue
        ways = [
            replace(model, shows=((index, one),)) for one in _likely(scene, claims, model, index)
        ]
        left = [alone.wrong(way, explained=True) for way in ways]
        if min(left, default=np.inf) <= MAX_LEFT_FRACTION * alone.wrong(model, explained=True):
            # Images that do not differ where the scene is far away cannot be told apart.
            limit = min(left) + MAX_LEFT_FRACTION * MIN_OUTLYING_FRACTION * image.triangle.size
            ranked = sorted(zip(left, (way.shows[0][1] for way in ways), strict=True))
            shows[index] = [other for count, other in ranked if count <= limit]
        else:
            failed += 1
        if failed > MAX_FAILED_HOGELS and not shows:
            return None
    if not shows:
        return None
    first = {index: others[0] for index, others in shows.items()}
    pairs = {index for index, other in first.items() if first.get(other) == index}
    faults = []
    for name, chosen in ((STALE, first.keys() - pairs), (EXCHANGED, pairs)):
        told = [
            f"hogel {i},{j} shows {' or '.join(f'{k},{m}' for k, m in shows[i, j])}'s image"
            for i, j in sorted(chosen, key=lambda one: one[::-1])
        ]
        words = "; ".join(told[:MAX_TOLD]) + (
            f"; and {len(told) - MAX_TOLD} more" * (len(told) > MAX_TOLD)
        )
        faults += [Defect(fault=name, value=f"{len(told)} hogels", words=words)] if told else []
    return replace(fit, model=replace(model, shows=tuple(first.items()))), tuple(faults)


def _likely(
    scene: Scene, claims: PixelClaims | None, model: RendererModel, index: Index
) -> list[Index]:
    """Return other apertures whose image a hogel may show: by claims, or neighbors."""
    columns, rows = scene.plate.hogels
    own = model.order.index(index, (columns, rows))

    def apart(one: Index) -> tuple[int, int]:
        return max(abs(one[0] - own[0]), abs(one[1] - own[1])), -(one[1] * columns + one[0])

    each = [
        (i, j) for j in range(max(0, own[1] - 9), min(rows, own[1] + 10)) for i in range(columns)
    ]
    near = sorted((one for one in each if one != own), key=apart)[: 32 * MAX_TRIED_APERTURES]
    mine = None if claims is None else claims.chosen((claims.hogel == index).all(axis=1))
    if mine is not None and len(mine) >= MIN_PART_CLAIMS:
        few = mine.thinned(MAX_FITTED_CLAIMS // 8)

        def failing(one: Index) -> float:
            there = replace(few, hogel=np.tile(one, (len(few), 1)))
            return float(outside_px(there, replace(model, order=UPRIGHT), 5.0).mean())

        return sorted(near, key=failing)[:2]
    return near[:MAX_TRIED_APERTURES]


def _with_odd_lines(
    evidence: TestSet, claims: PixelClaims | None, fit: GeometryFit
) -> Guess | None:
    """Return a guess in which odd rows or columns of pixels are shifted along themselves."""
    tried = [replace(fit.model, odd_lines=(axis, px)) for axis in (0, 1) for px in TRIED_SHIFTS_PX]
    if claims is not None:
        some = claims.thinned(MAX_FITTED_CLAIMS)

        def held(model: RendererModel) -> float:
            axis, px = model.odd_lines or (0, 0)
            pixel = some.pixel.copy()
            pixel[pixel[:, 1 - axis] % 2 == 1, axis] -= px
            off = outside_px(replace(some, pixel=pixel), model, np.inf) > MAX_PART_NOISE_PX
            return 1.0 - float(off.mean())

        tried = [one for one in tried if held(one) >= MIN_HELD_FRACTION]
    if not tried:
        return None
    best = min(tried, key=lambda one: evidence.wrong(one, explained=True))
    assert best.odd_lines is not None
    axis, px = best.odd_lines
    lines, side = (("rows", "right"), ("columns", "bottom"))[axis]
    side = side if px > 0 else {"right": "left", "bottom": "top"}[side]
    words = f"odd {lines} of pixels are shifted by {abs(px)} px to the {side}"
    fault = Defect(fault=f"{lines}-shifted", value=float(px), unit="px", words=words)
    return replace(fit, model=best), (fault,)


def _with_offsets(evidence: TestSet, claims: PixelClaims | None, fit: GeometryFit) -> Guess | None:
    """Return a guess in which each aperture has its own offset, fitted to its hogel's claims or picture."""
    scene, nominal, offsets = (
        evidence.reference.scene,
        evidence.nominal,
        dict[Index, tuple[float, float]](),
    )
    unmoved = {"pitch": nominal.pitch, "aperture_offset": nominal.aperture_offset}
    model = replace(fit.model, **unmoved, scene_offset=nominal.scene_offset)  # type: ignore[arg-type]
    # What all apertures share has one value under which all hogels' claims hold, each with its own
    # offset.
    shared = [name for name in SHARED_GROUPS if getattr(model, name) != getattr(nominal, name)]
    if shared and claims is not None:
        free = (*shared, "aperture-offset")
        each = [
            claims.chosen((claims.hogel == one).all(axis=1))
            for one in np.unique(claims.hogel, axis=0)
        ]
        fits = [fit_alone(of.thinned(MAX_FITTED_CLAIMS // 2), model, free) for of in each]
        ends = np.array([interval_alone(of, one, free) for of, one in zip(each, fits, strict=True)])
        fit = replace(fit, low=ends[:, 0].max(axis=0), high=ends[:, 1].min(axis=0))
        middle = np.median([one.parameters for one in fits], axis=0).clip(fit.low, fit.high)
        middle[places("aperture-offset")] = 0.0
        model = model.with_parameters(middle)
    smallest = float(smallest_named(scene)[places("aperture-offset")].max())
    for image in evidence.images:
        index = image.camera.aperture.index
        if claims is None:
            alone = evidence.of([image])
            if not outlying(alone, model):
                continue
            moved = partial(_moved, model)
            values = fit_drawn(alone, moved, np.zeros(2))
            if not alone.explains(moved(values)):
                return None
            # Pictures place outlines less finely than claims do.
            told = float((DERIVATIVE_STEP_PX / px_per_unit(alone, moved, values)).max())
            smallest, (x, y) = max(smallest, told), values.tolist()
        else:
            mine = claims.chosen((claims.hogel == index).all(axis=1)).thinned(
                MAX_FITTED_CLAIMS // 2
            )
            if len(mine) < MIN_PART_CLAIMS:
                continue
            found = fit_alone(mine, model, ("aperture-offset",))
            if (
                float((outside_px(mine, found, np.inf) > MAX_PART_NOISE_PX).mean())
                > 1 - MIN_HELD_FRACTION
            ):
                return None
            x, y = np.subtract(found.aperture_offset, model.aperture_offset).tolist()
        if np.hypot(x, y) > smallest:
            offsets[model.order.index(index, scene.plate.hogels)] = (x, y)
    return (
        _moved_apart(evidence, claims, replace(fit, model=model), offsets, smallest)
        if offsets
        else None
    )


def _moved_apart(
    evidence: TestSet,
    claims: PixelClaims | None,
    fit: GeometryFit,
    offsets: dict[Index, tuple[float, float]],
    smallest: float,
) -> Guess | None:
    """Return a guess in which apertures have offsets; None where pictures' offsets follow a rule of all."""
    scene, model = evidence.reference.scene, fit.model
    apertures = [model.answers(scene, image.camera.aperture) for image in evidence.images]
    if claims is None:
        # Farther than registration follows pictures, all apertures may be moved alike, or the
        # scene.
        alike = _moved(model, np.median([*offsets.values()], axis=0))
        (x, y), z = alike.aperture_offset, model.scene_offset[2]
        ways = tuple(filter(evidence.explains, (alike, replace(model, scene_offset=(-x, -y, z)))))
        if ways:
            return replace(fit, model=ways[0], alternatives=ways[1:]).unbounded(
                evidence.nominal
            ), ()
        if _of_one_rule(apertures, offsets, smallest):
            return None
    fault = _jitter(scene, offsets, {one.index for one in apertures}, smallest)
    return replace(fit, model=replace(model, offsets=tuple(offsets.items()))), (fault,)


def _moved(model: RendererModel, offset: Floats) -> RendererModel:
    return replace(model, aperture_offset=(float(offset[0]), float(offset[1])))


def _of_one_rule(
    apertures: Sequence[Aperture], offsets: dict[Index, tuple[float, float]], smallest: float
) -> bool:
    """Return whether offsets of apertures are those of all apertures moved, or farther apart."""
    moves = np.array([offsets.get(one.index, (0.0, 0.0)) for one in apertures])
    for along, place in zip(
        moves.T, np.array([(one.x, one.y) for one in apertures]).T, strict=True
    ):
        terms = np.stack((np.ones_like(place), place), axis=1)
        left = along - terms @ np.linalg.lstsq(terms, along)[0]
        if np.abs(left).max() > smallest:
            return False
    return True


def _jitter(
    scene: Scene, offsets: dict[Index, tuple[float, float]], there: set[Index], smallest: float
) -> Defect:
    moves = np.array(list(offsets.values()))
    mean, rms = moves.mean(axis=0), np.sqrt(np.square(moves).mean(axis=0))
    if len(moves) > 1 and np.ptp(moves, axis=0).max() <= 2 * smallest:
        for axis, name in ((1, SHIFTED_ROWS), (0, SHIFTED_COLUMNS)):
            for parity, which in ((1, "odd"), (0, "even")):
                if offsets.keys() == {one for one in there if one[axis] % 2 == parity} != there:
                    words = f"apertures of {which} {('columns', 'rows')[axis]} of hogels, counted from 0, "
                    words += "are moved by " + moved_words(scene, (*mean.tolist(), 0.0), smallest)
                    return Defect(
                        fault=name, value=float(np.hypot(*mean)), unit=scene.units, words=words
                    )
    words = (
        f"apertures are moved, each by its own offset: {len(moves)} of {len(there)} by "
        f"{rms[0]:.3g} {scene.units} in x and {rms[1]:.3g} in y (root mean square), "
        f"{np.hypot(*moves.T).max():.3g} at most"
    )
    return Defect(fault=JITTER, value=float(np.hypot(*rms)), unit=scene.units, words=words)
