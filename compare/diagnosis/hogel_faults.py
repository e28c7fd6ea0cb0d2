"""Mistakes of single hogels: stale or exchanged images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from xfrustum.compare.diagnosis.faults import Defect
from xfrustum.compare.diagnosis.geometry_fit import (
    MAX_FITTED_CLAIMS,
    GeometryFit,
    PixelClaims,
    outside_px,
)
from xfrustum.compare.diagnosis.scene_faults import MIN_PART_CLAIMS, Guess
from xfrustum.compare.renderer_model.conventions import UPRIGHT
from xfrustum.compare.renderer_model.drawn_model import Index, RendererModel
from xfrustum.scenes.model.scene import Scene

if TYPE_CHECKING:  # it tests what is found here
    from xfrustum.compare.diagnosis.diagnosis import TestSet

STALE, EXCHANGED = "stale-hogel", "hogels-exchanged"

# Smallest share of a hogel's pixels, wrong without a cause, with which it is an outlier, and
# largest share of them that may stay wrong when it is taken for another's image: what a guess must
# explain.
MIN_OUTLYING_FRACTION, MAX_LEFT_FRACTION = 0.02, 0.1

# Apertures that an outlier's image is compared with, nearest first: all neighbors, and those after
# them. And the number of outliers after which, if none shows another's image, the others are not
# compared.
MAX_TRIED_APERTURES, MAX_FAILED_HOGELS = 12, 3

MAX_TOLD = 10
"""Largest number of hogels that are named in words."""


def hogel_guesses(
    evidence: TestSet, claims: PixelClaims | None, fits: Sequence[GeometryFit]
) -> Iterator[Guess]:
    """Yield guesses about single hogels, from fits of the cameras that all of them share."""
    # Without claims every guess is drawn: the best one and the nominal one are all that is tried.
    few = fits if claims is not None else list(dict.fromkeys((fits[0], fits[-1])))
    for fit in few:
        found = _with_other_images(evidence, claims, fit)
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
