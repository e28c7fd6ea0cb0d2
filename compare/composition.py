"""Which of the two halves wins where: found by comparing with every way to put them together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.drawn_color import colored, unconjugated
from xfrustum.compare.drawn_model import DrawnModel, Front
from xfrustum.compare.drawn_trace import Layer, as_image, layer, overlaid, trace_drawn
from xfrustum.compare.pictures import COLOR_TOLERANCE
from xfrustum.reference import Reference
from xfrustum.scenes.hogel_image import NOTHING, HogelImage

TELLING = 20
"""Pixels in which two ways of putting the halves together must differ, before images can tell them
apart: fewer may be outlines that rounding has moved."""

WAYS = (
    (Front.FARTHEST, True),
    (Front.MISSING, True),
    (Front.NEAREST, True),
    (Front.FARTHEST, False),
    (Front.NEAREST, False),
)
"""The right one first."""


def find_composition(reference: Reference, model: DrawnModel, images: Sequence[HogelImage]) -> DrawnModel:
    """Return a guess with the way of putting the halves together that images agree with best.

    It differs from the right one only where, of the pixels that tell the two apart, the images show
    the other more often.

    Parameters
    ----------
    reference
        Of the scene.
    model
        Whose conventions and geometry are right.
    images
        As found, naming triangles or objects, or with colors.
    """
    wrong, differing = np.zeros(len(WAYS)), np.zeros(len(WAYS))
    for image in images:
        shown, ways = _compared(reference, model, image)
        wrong += [np.count_nonzero(_differ(picture, shown)) for picture in ways]
        differing += [np.count_nonzero(_differ(picture, ways[0])) for picture in ways]
    best = int(np.argmin(wrong))
    # Where the other way holds, each pixel that differs is wrong by the right one; half of them suffice.
    if differing[best] < TELLING or wrong[0] - wrong[best] <= differing[best] / 2:
        best = 0
    front, over = WAYS[best]
    return replace(model, front=front, overlaid=over)


def _ways(reference: Reference, model: DrawnModel, image: HogelImage) -> list[Layer]:
    scene = reference.scene
    aperture = model.answers(scene, image.camera.aperture)
    c_star = model.pencil(scene, aperture, -1)
    back = layer(scene, model.pencil(scene, aperture, 1))
    fronts = {
        Front.FARTHEST: layer(scene, c_star),
        Front.NEAREST: layer(scene, c_star, nearest=True),
    }
    pictures = []
    for front, over in WAYS:
        if front is Front.MISSING:
            pictures.append(back)
        else:
            pictures.append(overlaid([back, fronts[front]] if over else [fronts[front], back]))
    return pictures


def _compared(
    reference: Reference, model: DrawnModel, image: HogelImage
) -> tuple[NDArray[Any], list[NDArray[Any]]]:
    """Return what an image shows, upright, and what each of the ways would: numbers (H, W), or colors."""
    scene, upright = reference.scene, model.orientation.upright
    ways = _ways(reference, model, image)
    if (image.triangle != NOTHING).any():
        return upright(image.triangle), [way.triangle for way in ways]
    if (image.object != NOTHING).any() or image.color is None:
        named = np.append(scene.object_of_triangle, np.int32(NOTHING))
        return upright(image.object), [named[way.triangle] for way in ways]
    aperture = model.answers(scene, image.camera.aperture)
    pictures = [colored(scene, model, as_image(reference, aperture, way)).color for way in ways]
    return upright(image.color), [np.asarray(picture) for picture in pictures]


def _differ(one: NDArray[Any], other: NDArray[Any]) -> NDArray[np.bool_]:
    if one.ndim == 2:
        return np.asarray(one != other)
    return np.asarray((np.abs(one - other) > COLOR_TOLERANCE).any(axis=-1))


def unconjugated_share(reference: Reference, model: DrawnModel, images: Sequence[HogelImage]) -> float | None:
    """Return the share of the viewer's half in another color that lights which are not conjugated explain.

    None where no color is wrong there.
    """
    scene, wrong, explained = reference.scene, 0, 0
    for image in images:
        if image.color is None:
            continue
        aperture = model.answers(scene, image.camera.aperture)
        answer = trace_drawn(reference, model, aperture)
        mine, number = model.orientation.upright(image.color), model.orientation.upright(image.triangle)
        asked = answer.height > model.plate_height
        # Another surface has another color for other reasons.
        asked &= (number == answer.triangle) | (number == NOTHING)
        colors = [np.asarray(f(scene, model, answer).color) for f in (colored, unconjugated)]
        differs, differs_still = (_differ(color, mine) & asked for color in colors)
        wrong += int(differs.sum())
        explained += int((differs & ~differs_still).sum())
    return explained / wrong if wrong else None


def exchanged_light(reference: Reference, model: DrawnModel, images: Sequence[HogelImage]) -> list[float]:
    """Return, for each half, how brightness goes with the truth's: correlations, back then front.

    Where the light of C* is not its conjugate, what should be bright on the viewer's side is dark and
    the reverse: the correlation is not positive there, and one behind the plate. NaN where a half
    shows too little to tell.
    """
    samples: tuple[list[NDArray[np.floating]], ...] = ([], [])
    for image in images:
        if image.color is None:
            continue
        truth = reference.trace(model.answers(reference.scene, image.camera.aperture))
        assert truth.color is not None
        mine = model.orientation.upright(image.color).mean(axis=-1)
        # Away from outlines, where both certainly show the same half.
        labels = np.sign(np.nan_to_num(truth.height)).astype(np.int32)
        inner = labels == _eroded(labels)
        for side, half in enumerate((-1, 1)):
            chosen = inner & (labels == half) & np.isfinite(mine)
            samples[side].append(np.stack((truth.color.mean(axis=-1)[chosen], mine[chosen])))
    return [_correlation(np.concatenate(parts, axis=1)) if parts else float("nan") for parts in samples]


def _eroded(labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return labels, 0 where one of the eight neighbors has another."""
    padded = np.pad(labels, 1)
    height, width = labels.shape
    same = np.ones_like(labels, dtype=np.bool_)
    for row, column in itertools.product(range(3), range(3)):
        same &= padded[row : row + height, column : column + width] == labels
    return np.where(same, labels, 0)


def _correlation(pairs: NDArray[np.floating]) -> float:
    if pairs.shape[1] < TELLING or min(np.ptp(pairs, axis=1)) == 0:
        return float("nan")
    return float(np.corrcoef(pairs)[0, 1])
