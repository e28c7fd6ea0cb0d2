"""Everything that a renderer may do otherwise as a whole, with no number in it: one entry for each mistake.

A hypothesis says which fields of `DrawnModel` differ, and the fault in words. Every one is tried on the
images by itself (`find_composition`), and found again in a guess (`found_in`). Faults with numbers are the
groups of `xfrustum.compare.renderer_model.parameters`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.renderer_model.drawn_model import FLIPPED, Culled, DrawnModel, Front, OneCamera
from xfrustum.compare.renderer_model.pictures import COLOR_TOLERANCE, Layers, as_image, colored, drawn
from xfrustum.reference import Reference
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage

# Smallest number of pixels in which two ways of putting the halves together must differ for images to tell
# them apart: fewer may be outlines that rounding has moved.
MIN_DIFFERING_PIXELS = 20

# Smallest gain of a way, as a share of the best way's gain in right pixels, with which images cannot tell it
# from the best. Two ways can be alike: on closed bodies, leaving out the faces toward the viewer leaves the
# surface nearest to the plate. Two percent leave room for outlines, which rounding moves.
MIN_ALIKE_FRACTION = 0.98


@dataclass(frozen=True)
class Hypothesis:
    """One mistake: the fault's name, value and words, and the fields of `DrawnModel` by which it draws."""

    fault: str
    value: str
    words: str
    fields: Mapping[str, Any] = field(hash=False)

    def of(self, model: DrawnModel) -> DrawnModel:
        """Return a guess with this mistake."""
        fields = dict(self.fields)
        if "one_camera" in fields:
            fields["one_camera"] = replace(fields["one_camera"], other_near=model.near)
        return replace(model, **fields)


def _flipped(one: OneCamera) -> Hypothesis:
    half, where = ("back", "behind") if one.side > 0 else ("front", "before")
    kind, value = "mirrored", f"mirrored {'left to right' if one.flip_x else 'upside down'}"
    if one.flip_x and one.flip_y:
        kind, value = "unturned", "turned by 180 degrees"
    words = f"the half {where} the plate is {value}"
    if (half, kind) == ("front", "unturned"):
        words += ": C* looks back, so that its picture is to be turned by 180 degrees, and is not"
    return Hypothesis(f"{half}-{kind}", value, words, {"one_camera": one})


NEAREST = Hypothesis(
    "front-nearest",
    "nearest wins",
    "on the viewer's side the surface nearest to the plate wins; C* must keep the farthest",
    {"front": Front.NEAREST},
)
NOT_OVERLAID = Hypothesis(
    "not-overlaid",
    "back over front",
    "C is drawn over C*; the viewer's half must cover the other",
    {"overlaid": False},
)
LIGHTS = Hypothesis(
    "lights",
    "not conjugated",
    "lights are not conjugated: on the viewer's side bright and dark are exchanged; C* needs L* = -L",
    {"conjugated": False},
)

HYPOTHESES = (
    Hypothesis(
        "front-missing",
        "missing",
        "the half on the viewer's side is missing: only C is drawn",
        {"front": Front.MISSING},
    ),
    Hypothesis(
        "back-missing",
        "missing",
        "the half behind the plate is missing: only C* is drawn",
        {"back_missing": True},
    ),
    NEAREST,
    NOT_OVERLAID,
    *(
        Hypothesis(
            "culling",
            str(culled),
            f"faces whose corners run {culled} as the viewer sees them are left out",
            {"culled": culled},
        )
        for culled in (Culled.COUNTERCLOCKWISE, Culled.CLOCKWISE)
    ),
    *map(_flipped, FLIPPED),
    LIGHTS,
)
"""All of them; of those that images cannot tell apart, the one that comes first here is named first."""

# The ways to put the halves together, the right one first. One test of the depth, taken for the other, makes
# two mistakes.
WAYS: tuple[tuple[Hypothesis, ...], ...] = ((), *((one,) for one in HYPOTHESES), (NEAREST, NOT_OVERLAID))

FIELDS = tuple(dict.fromkeys(name for one in HYPOTHESES for name in one.fields if name != "one_camera"))
"""Fields of `DrawnModel` that say how the halves are put together and lit."""


def found_in(model: DrawnModel) -> list[Hypothesis]:
    """Return the mistakes that a guess has."""
    one = model.one_camera
    # The near offset of the camera that is right is no mistake.
    plain = replace(model, one_camera=one and replace(one, other_near=0.0))
    return [
        one for one in HYPOTHESES if all(getattr(plain, name) == value for name, value in one.fields.items())
    ]


def find_composition(
    reference: Reference, model: DrawnModel, images: Sequence[HogelImage]
) -> tuple[DrawnModel, ...]:
    """Return a guess with the way of putting the halves together that images agree with best.

    The result differs from the right way only where most pixels that tell the two apart speak against the
    right one. Other ways that agree with the images as well follow it.
    """
    # Step 1: nothing is to be found where the right way explains nearly every pixel.
    right = [_compared(reference, [model], image) for image in images]
    if sum(_differing(made[0], shown) for shown, made in right) < MIN_DIFFERING_PIXELS:
        return (model,)
    ways = []
    for way in WAYS:
        # A camera that is off by itself is not mirrored too.
        if model.one_camera is None or not any("one_camera" in one.fields for one in way):
            ways.append(model)
            for one in way:
                ways[-1] = one.of(ways[-1])
    wrong, differing = np.zeros(len(ways)), np.zeros(len(ways))
    for image in images:
        shown, made = _compared(reference, ways, image)
        wrong += [_differing(picture, shown) for picture in made]
        differing += [_differing(picture, made[0]) for picture in made]
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
    layers = [drawn(scene, way, aperture, known) for way in ways]
    if (image.triangle != NOTHING).any():
        return upright(image.triangle), [shown.triangle for shown in layers]
    answers = [as_image(reference, aperture, shown) for shown in layers]
    if (image.object != NOTHING).any() or image.color is None:
        return upright(image.object), [answer.object for answer in answers]
    pictures = [colored(scene, way, answer).color for way, answer in zip(ways, answers, strict=True)]
    return upright(image.color), [np.asarray(picture) for picture in pictures]


def _differing(one: NDArray[Any], other: NDArray[Any]) -> int:
    if one.ndim == 2:
        return int(np.count_nonzero(one != other))
    return int(np.count_nonzero((np.abs(one - other) > COLOR_TOLERANCE).any(axis=-1)))
