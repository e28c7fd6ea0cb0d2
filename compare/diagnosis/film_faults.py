"""How pixels may lie on their film: rolled, enlarged from fewer, or behind a lens."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray
from skimage.registration import phase_cross_correlation

from xfrustum.compare.diagnosis.geometry_fit import ANGLES
from xfrustum.compare.renderer_model.drawn_model import Film
from xfrustum.scenes.model.hogel_image import NOTHING

if TYPE_CHECKING:  # it tests what is found here
    from xfrustum.compare.diagnosis.diagnosis import TestSet

Picture = NDArray[Any]
"""Numbers (H, W) or colors (H, W, 3) of an upright image."""

# Resolutions, over those asked for, at which pictures may have been drawn before they were
# enlarged.
DRAWN_SIZES = (3 / 4, 2 / 3, 1 / 2, 1 / 3, 1 / 4)


def films_of(
    evidence: TestSet, pictures: Sequence[tuple[Picture, list[Picture]]]
) -> Iterator[Film]:
    """Yield films on which pixels may lie, by some images; `pictures` are these beside what was asked for."""
    images, reference = evidence.images, evidence.reference
    rolls = []
    for shown, (right,) in pictures:
        if not (shown.any() and right.any()):  # All black pictures lie nowhere.
            continue
        # Numbers that are neighbors mean nothing: each gets a gray of its own.
        grays = [one.mean(axis=-1) if one.ndim == 3 else one * 0.618 % 1 for one in (shown, right)]
        down, across = phase_cross_correlation(*grays)[0].astype(int).tolist()
        rolls.append((across, down))
    yield from (Film(rolled=rolled) for rolled in dict.fromkeys(rolls))
    if reference.scene.frustum.recentered:
        yield Film(unsheared=True)
    for size in DRAWN_SIZES:
        yield Film(size=size)
        if all(image.color is not None for image in images):
            yield Film(size=size, smooth=True)
    if any((image.triangle != NOTHING).any() for image in images):
        return  # The fit of geometry has tried lenses.
    yield from (Film(angles=angles) for angles in ANGLES)
