"""Which of the two halves wins where: found by comparing with every way to put them together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.renderer_model.drawn_color import colored
from xfrustum.compare.renderer_model.drawn_model import Culled, DrawnModel, Front
from xfrustum.compare.renderer_model.drawn_trace import as_image, drawn_layers, trace_drawn
from xfrustum.compare.renderer_model.pictures import COLOR_TOLERANCE
from xfrustum.reference import Reference
from xfrustum.reference.layers import overlaid
from xfrustum.scenes.arrays import Mask, Numbers
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage

TELLING = 20
"""Pixels in which two ways of putting the halves together must differ, before images can tell them
apart: fewer may be outlines that rounding has moved."""


@dataclass(frozen=True, kw_only=True)
class Way:
    """How the halves are put together; by default as they must."""

    front: Front = Front.FARTHEST
    overlaid: bool = True
    culled: Culled = Culled.NONE

    def of(self, model: DrawnModel) -> DrawnModel:
        """Return a guess with the halves put together in this way."""
        return replace(model, front=self.front, overlaid=self.overlaid, culled=self.culled)


WAYS = (
    Way(),
    Way(front=Front.MISSING),
    Way(front=Front.NEAREST),
    Way(overlaid=False),
    Way(front=Front.NEAREST, overlaid=False),
    Way(culled=Culled.COUNTERCLOCKWISE),
    Way(culled=Culled.CLOCKWISE),
)
"""The right one first; of those that images cannot tell apart, the first is named first."""

ALIKE_PART = 0.98
"""Part of the pixels that the best way makes right which another must make right too, to be called alike: of
closed bodies, the surface nearest to the plate remains when faces toward the viewer are left out."""


def find_composition(
    reference: Reference, model: DrawnModel, images: Sequence[HogelImage]
) -> tuple[DrawnModel, ...]:
    """Return a guess with the way of putting the halves together that images agree with best.

    It differs from the right one only where, of the pixels that tell the two apart, the images show
    the other more often. Other ways that images agree with as well follow it.

    Parameters
    ----------
    reference
        Of the scene.
    model
        Whose conventions and geometry are right.
    images
        As found, naming triangles or objects, or with colors.
    """
    right = sum(int(_differ(*_shown(reference, model, WAYS[0], image)).sum()) for image in images)
    if right < TELLING:
        return (WAYS[0].of(model),)
    wrong, differing = np.zeros(len(WAYS)), np.zeros(len(WAYS))
    for image in images:
        shown, ways = _compared(reference, model, image)
        wrong += [np.count_nonzero(_differ(picture, shown)) for picture in ways]
        differing += [np.count_nonzero(_differ(picture, ways[0])) for picture in ways]
    gained = wrong[0] - wrong
    # Where the other way holds, each pixel that differs is wrong by the right one; half of them suffice.
    telling = (differing >= TELLING) & (gained > differing / 2)
    if not telling.any():
        return (WAYS[0].of(model),)
    alike = np.flatnonzero(telling & (gained >= ALIKE_PART * gained[telling].max()))
    return tuple(WAYS[index].of(model) for index in alike.tolist())


def _shown(
    reference: Reference, model: DrawnModel, way: Way, image: HogelImage
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return what an image shows, upright, and what one way would show."""
    shown, (expected,) = _compared(reference, model, image, (way,))
    return shown, expected


def _compared(
    reference: Reference, model: DrawnModel, image: HogelImage, ways: Sequence[Way] = WAYS
) -> tuple[NDArray[Any], list[NDArray[Any]]]:
    """Return what an image shows, upright, and what each of some ways would: numbers (H, W), or colors."""
    scene, upright = reference.scene, model.orientation.upright
    aperture = model.answers(scene, image.camera.aperture)
    models = [way.of(model) for way in ways]
    layers = [overlaid(drawn_layers(scene, one, aperture)) for one in models]
    if (image.triangle != NOTHING).any():
        return upright(image.triangle), [shown.triangle for shown in layers]
    if (image.object != NOTHING).any() or image.color is None:
        named = np.append(scene.object_of_triangle, np.int32(NOTHING))
        return upright(image.object), [named[shown.triangle] for shown in layers]
    pictures = [
        colored(scene, one, as_image(reference, aperture, shown)).color
        for one, shown in zip(models, layers, strict=True)
    ]
    return upright(image.color), [np.asarray(picture) for picture in pictures]


def _differ(one: NDArray[Any], other: NDArray[Any]) -> Mask:
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
        ways = (replace(model, conjugated=conjugated) for conjugated in (True, False))
        colors = [np.asarray(colored(scene, way, answer).color) for way in ways]
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


def _eroded(labels: Numbers) -> Numbers:
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
