"""How a renderer puts its two halves together: one missing, mirrored or on top, surfaces, culling."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.diagnosis.faults import FLAT, HYPOTHESES, NEAREST, NOT_OVERLAID, Hypothesis
from xfrustum.compare.renderer_model.drawn_model import EVEN, Back, Front, RendererModel
from xfrustum.compare.renderer_model.pictures import (
    COLOR_TOLERANCE,
    Layers,
    as_image,
    as_stored,
    colored,
    drawn,
)
from xfrustum.reference import Reference
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage

# Smallest number of pixels in which two ways of putting the halves together must differ for images
# to tell them apart: fewer may be outlines that rounding has moved.
MIN_DIFFERING_PIXELS = 20

# Smallest gain of a way, as a share of the best way's gain in right pixels, with which images
# cannot tell it from the best. Two ways can be alike: on closed bodies, leaving out the faces
# toward the viewer leaves the surface nearest to the plate. Two percent leave room for outlines,
# which rounding moves.
MIN_ALIKE_FRACTION = 0.98

# The ways to put the halves together, the right one first. One test of the depth, taken for the
# other, makes two mistakes.
WAYS: tuple[tuple[Hypothesis, ...], ...] = (
    (),
    *((one,) for one in HYPOTHESES),
    (NEAREST, NOT_OVERLAID),
)


def find_composition(
    reference: Reference, model: RendererModel, images: Sequence[HogelImage]
) -> tuple[RendererModel, ...]:
    """Return a guess with the way of putting halves together that images agree with best, then its equals."""
    # Step 1: nothing is to be found where the right way explains nearly every pixel.
    right = [compared(reference, [model], image) for image in images]
    if sum(_differing(made[0], shown) for shown, made in right) < MIN_DIFFERING_PIXELS:
        return (model,)
    # A camera that is off by itself is not mirrored too.
    ways = [
        reduce(lambda made, one: one.of(made), way, model)
        for way in WAYS
        if (model.one_camera is None or not any("one_camera" in one.fields for one in way))
        # Nor is anything culled where a ray tracer draws.
        and (model.film == EVEN or not any("culled" in one.fields for one in way))
        and (FLAT not in way or reference.scene.surface.vertex_normals is not None)
    ]
    # One half at least is there.
    ways = [way for way in ways if not (way.back is Back.MISSING and way.front is Front.MISSING)]
    wrong, differing = np.zeros(len(ways)), np.zeros(len(ways))
    for shown, made in (compared(reference, ways, image) for image in images):
        wrong += [_differing(picture, shown) for picture in made]
        differing += [_differing(picture, made[0]) for picture in made]
    # Step 2: a way is better where it makes more than half of the pixels right in which it differs
    # from the right way. If it is the renderer's own, it makes all of them right.
    gained = wrong[0] - wrong
    telling = (differing >= MIN_DIFFERING_PIXELS) & (gained > differing / 2)
    if not telling.any():
        return (model,)
    # Step 3: the best way, and those that gain nearly as much.
    alike = np.flatnonzero(telling & (gained >= MIN_ALIKE_FRACTION * gained[telling].max()))
    return tuple(ways[index] for index in alike.tolist())


def compared(
    reference: Reference, ways: Sequence[RendererModel], image: HogelImage
) -> tuple[NDArray[Any], list[NDArray[Any]]]:
    """Return an image, upright, and what each of some guesses would draw: numbers (H, W), or colors."""
    scene, upright = reference.scene, ways[0].upright
    aperture, known = ways[0].answers(scene, image.camera.aperture), Layers()
    layers = [drawn(reference, way, aperture, known) for way in ways]
    if (image.triangle != NOTHING).any():
        return upright(image.triangle), [shown.triangle for shown in layers]
    answers = [as_image(reference, aperture, shown) for shown in layers]
    if (image.object != NOTHING).any() or image.color is None:
        return upright(image.object), [answer.object for answer in answers]
    colors = [colored(scene, way, answer) for way, answer in zip(ways, answers, strict=True)]
    return upright(image.color), [np.asarray(as_stored(one, image).color) for one in colors]


def _differing(one: NDArray[Any], other: NDArray[Any]) -> int:
    if one.ndim == 2:
        return int(np.count_nonzero(one != other))
    return int(np.count_nonzero((np.abs(one - other) > COLOR_TOLERANCE).any(axis=-1)))
