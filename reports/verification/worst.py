"""The worst hogels of a verification in pictures: truth, image, and where they differ."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from xfrustum.compare.judging.judged import Figures
from xfrustum.reports.common.templates_environment import address, png
from xfrustum.reports.inspection import InspectedHogel, inspected_figures
from xfrustum.scenes import NOTHING, Aperture, HogelImage, Scene
from xfrustum.scenes.appearance.display import LEVELS, encoding_curve
from xfrustum.scenes.arrays import Bytes

MAX_SHOWN_HOGELS, MAX_PICTURE_PX = 6, 512
"""Number of hogels with pictures, and longest side of a picture, px."""

WRONG_RGB, BACKGROUND_GRAY, TRUTH_STRENGTH = (224, 49, 49), 250, 0.35
"""Color of wrong pixels, level of empty ones, and strength of the truth beneath errors."""


@dataclass(frozen=True, kw_only=True)
class Pictured:
    """One hogel in pictures, each a data URL, with how bad it is, and in words what that counts."""

    aperture: Aperture
    words: str
    #: as found, then corrected
    badness: tuple[float, float]
    pictures: dict[str, str]
    #: all channels, where selected
    inspected: InspectedHogel | None = None


@dataclass(kw_only=True)
class WorstHogels:
    """The worst so far, worst first; with all their channels where the scene of these is given."""

    scene: Scene | None = None
    kept: list[Pictured] = field(default_factory=list)

    def add(self, aperture: Aperture, as_found: Figures, corrected: Figures) -> None:
        """Keep a hogel if it is among the worst; of equals those that came first stay."""
        badness = (as_found.numbers.judged_fraction, corrected.numbers.judged_fraction)
        if len(self.kept) == MAX_SHOWN_HOGELS and badness <= self.kept[-1].badness:
            return
        scene, pictures = self.scene, {}
        shown = {"truth": _shown(as_found.answer, as_found.image), "image": _shown(as_found.image)}
        for name, pixels in (
            shown | {"error": _errors(as_found), "rest": _errors(corrected)}
        ).items():
            step = -(-max(pixels.shape[:2]) // MAX_PICTURE_PX)
            pictures[name] = address(png(pixels[::step, ::step], optimize=False))
        pictured = Pictured(
            aperture=aperture,
            words=as_found.numbers.limited_figure,
            badness=badness,
            pictures=pictures,
            inspected=None
            if scene is None
            else inspected_figures(scene, aperture, as_found, corrected),
        )
        worst_first = sorted((*self.kept, pictured), key=lambda entry: entry.badness, reverse=True)
        self.kept = worst_first[:MAX_SHOWN_HOGELS]


def _shown(image: HogelImage, like: HogelImage | None = None) -> Bytes:
    """Return what people can see of an image: its colors, else a color for each surface.

    Surfaces are triangles or objects, whichever `like` names, by default the image itself: truth
    names both.
    """
    if image.color is not None:
        linear = np.clip(np.nan_to_num(image.color), 0, 1)
        return np.asarray(np.rint(LEVELS * encoding_curve(linear)), dtype=np.uint8)
    named = image.triangle if ((like or image).triangle != NOTHING).any() else image.object
    if not (named != NOTHING).any():
        named = np.where(image.covered, 0, NOTHING)
    # Neighboring numbers get colors far apart: multiples of odd constants.
    spread = named[..., None].astype(np.int64) * np.array([37, 101, 173]) + np.array([90, 60, 140])
    return np.where((named == NOTHING)[..., None], BACKGROUND_GRAY, spread % 200 + 30).astype(
        np.uint8
    )


def _errors(figures: Figures) -> Bytes:
    shown = _shown(figures.answer, figures.image).astype(np.float64)
    beneath = BACKGROUND_GRAY - TRUTH_STRENGTH * (BACKGROUND_GRAY - shown)
    beneath[~figures.answer.covered] = BACKGROUND_GRAY
    beneath[figures.error] = WRONG_RGB
    return np.asarray(beneath, dtype=np.uint8)
