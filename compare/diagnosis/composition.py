"""How the two halves are put together and lit: every hypothesis is drawn, and compared with the images."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.diagnosis.hypotheses import HYPOTHESES, TOGETHER, Hypothesis
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.compare.renderer_model.pictures import (
    COLOR_TOLERANCE,
    Layers,
    as_image,
    colored,
    drawn_layers,
    trace_drawn,
)
from xfrustum.reference import Reference
from xfrustum.reference.layers import overlaid
from xfrustum.scenes.arrays import Mask, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage

MIN_DIFFERING_PIXELS = 20
"""Smallest number of pixels in which two ways of putting the halves together must differ for images to tell
them apart: fewer may be outlines that rounding has moved."""

MIN_ALIKE_FRACTION = 0.98
"""Smallest gain of a way, as a share of the best way's gain in right pixels, with which images cannot tell it
from the best. Two ways can be alike: on closed bodies, leaving out the faces toward the viewer leaves the
surface nearest to the plate. Two percent leave room for outlines, which rounding moves."""

WAYS: tuple[tuple[Hypothesis, ...], ...] = ((), *((one,) for one in HYPOTHESES), *TOGETHER)
"""All ways to put the halves together, the right one first."""


def find_composition(
    reference: Reference, model: DrawnModel, images: Sequence[HogelImage]
) -> tuple[DrawnModel, ...]:
    """Return a guess with the way of putting the halves together that images agree with best.

    The result differs from the right way only where most pixels that tell the two apart speak against the
    right one. Other ways that agree with the images as well follow it.
    """
    ways = [model]
    # Step 1: nothing is to be found where the right way explains nearly every pixel.
    right = [_compared(reference, ways, image) for image in images]
    if sum(_differing(drawn[0], shown) for shown, drawn in right) < MIN_DIFFERING_PIXELS:
        return (model,)
    for way in WAYS[1:]:
        if all(one.fits(model) for one in way):
            ways.append(model)
            for one in way:
                ways[-1] = one.of(ways[-1])
    wrong, differing = np.zeros(len(ways)), np.zeros(len(ways))
    for image in images:
        shown, drawn = _compared(reference, ways, image)
        wrong += [_differing(picture, shown) for picture in drawn]
        differing += [_differing(picture, drawn[0]) for picture in drawn]
    # Step 2: a way is better where it makes more than half of the pixels right in which it differs from the
    # right way. If it is the renderer's own, it makes all of them right.
    gained = wrong[0] - wrong
    telling = (differing >= MIN_DIFFERING_PIXELS) & (gained > differing / 2)
    if not telling.any():
        return (model,)
    # Step 3: the best way, and those that gain nearly as much.
    alike = np.flatnonzero(telling & (gained >= MIN_ALIKE_FRACTION * gained[telling].max()))
    return tuple(ways[index] for index in alike.tolist())


def _compared(
    reference: Reference, ways: Sequence[DrawnModel], image: HogelImage
) -> tuple[NDArray[Any], list[NDArray[Any]]]:
    """Return an image, upright, and what each of some guesses would draw: numbers (H, W), or colors."""
    scene, upright = reference.scene, ways[0].orientation.upright
    aperture, known = ways[0].answers(scene, image.camera.aperture), Layers()
    layers = [overlaid(drawn_layers(scene, way, aperture, known)) for way in ways]
    if (image.triangle != NOTHING).any():
        return upright(image.triangle), [shown.triangle for shown in layers]
    if (image.object != NOTHING).any() or image.color is None:
        named = np.append(scene.object_of_triangle, np.int32(NOTHING))
        return upright(image.object), [named[shown.triangle] for shown in layers]
    answers = (as_image(reference, aperture, shown) for shown in layers)
    pictures = [colored(scene, way, answer).color for way, answer in zip(ways, answers, strict=True)]
    return upright(image.color), [np.asarray(picture) for picture in pictures]


def _differ(one: NDArray[Any], other: NDArray[Any]) -> Mask:
    if one.ndim == 2:
        return np.asarray(one != other)
    return np.asarray((np.abs(one - other) > COLOR_TOLERANCE).any(axis=-1))


def _differing(one: NDArray[Any], other: NDArray[Any]) -> int:
    return int(np.count_nonzero(_differ(one, other)))


def unconjugated_share(reference: Reference, model: DrawnModel, images: Sequence[HogelImage]) -> float | None:
    """Return how much of the wrong color in the viewer's half unconjugated lights explain.

    The result is a share of the viewer's half's wrong pixels; None where none is wrong.
    """
    scene, wrong, explained = reference.scene, 0, 0
    for image in images:
        if image.color is None:
            continue
        answer = trace_drawn(reference, model, model.answers(scene, image.camera.aperture))
        mine, number = model.orientation.upright(image.color), model.orientation.upright(image.triangle)
        # Where another surface shows, its color says nothing of lights.
        asked = (answer.height > model.plate_height) & ((number == answer.triangle) | (number == NOTHING))
        ways = (replace(model, conjugated=conjugated) for conjugated in (True, False))
        differs, differs_still = (
            _differ(np.asarray(colored(scene, way, answer).color), mine) & asked for way in ways
        )
        wrong += int(differs.sum())
        explained += int((differs & ~differs_still).sum())
    return explained / wrong if wrong else None


def exchanged_light(reference: Reference, model: DrawnModel, images: Sequence[HogelImage]) -> list[float]:
    """Return the correlation of brightness with the truth's behind the plate, then on the viewer's side.

    Where the light of C* is not conjugated, bright and dark are exchanged on the viewer's side: the
    correlation is not positive there, while it is 1 behind the plate. NaN where a half shows too little.
    """
    samples: tuple[list[NDArray[np.floating]], ...] = ([], [])
    for image in images:
        if image.color is None:
            continue
        truth = reference.trace(model.answers(reference.scene, image.camera.aperture))
        assert truth.color is not None
        mine = model.orientation.upright(image.color).mean(axis=-1)
        # Only pixels away from outlines count: there truth and image certainly show the same half.
        labels = np.sign(np.nan_to_num(truth.height)).astype(np.int32)
        inner = labels == _eroded(labels)
        for side, half in enumerate((-1, 1)):
            chosen = inner & (labels == half) & np.isfinite(mine)
            samples[side].append(np.stack((truth.color.mean(axis=-1)[chosen], mine[chosen])))
    return [_correlation(np.concatenate(parts, axis=1)) if parts else float("nan") for parts in samples]


def _eroded(labels: Numbers) -> Numbers:
    """Return the labels, with 0 wherever one of the eight neighbors has another label."""
    padded = np.pad(labels, 1)
    height, width = labels.shape
    same = np.ones_like(labels, dtype=np.bool_)
    for row, column in itertools.product(range(3), range(3)):
        same &= padded[row : row + height, column : column + width] == labels
    return np.where(same, labels, 0)


def _correlation(pairs: NDArray[np.floating]) -> float:
    if pairs.shape[1] < MIN_DIFFERING_PIXELS or min(np.ptp(pairs, axis=1)) == 0:
        return float("nan")
    return float(np.corrcoef(pairs)[0, 1])
