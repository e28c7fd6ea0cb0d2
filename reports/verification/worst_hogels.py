"""Pictures of the worst hogels, kept small while all hogels pass by."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass, field

import numpy as np
from PIL import Image

from xfrustum.compare.judging.judged import Figures
from xfrustum.reports.inspection.channels import InspectedHogel, inspected_figures
from xfrustum.scenes.appearance.display import LEVELS, encoding_curve
from xfrustum.scenes.arrays import Bytes
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

MAX_SHOWN_HOGELS = 6
"""Hogels whose pictures are on the page."""

MAX_PICTURE_PX = 512
"""Longest side of a picture on the page; larger ones are reduced by leaving pixels out."""

WRONG_RGB, BACKGROUND_GRAY, TRUTH_STRENGTH = (224, 49, 49), 250, 0.35
"""Color of wrong pixels, gray level where nothing is shown, and share by which the truth shows beneath
errors."""


@dataclass(frozen=True, kw_only=True)
class Pictured:
    """One hogel in pictures, each a data URL, with how bad it is, and in words what that counts."""

    aperture: Aperture
    words: str
    badness: tuple[float, float]  #: as found, then corrected
    pictures: dict[str, str]
    inspected: InspectedHogel | None = None  #: all channels, where they were asked for


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
        shown = {
            "truth": _shown(as_found.answer),
            "image": _shown(as_found.image),
            "error": _errors(as_found),
            "rest": _errors(corrected),
        }
        pictured = Pictured(
            aperture=aperture,
            words=as_found.numbers.limited_words,
            badness=badness,
            pictures={name: _encoded(pixels) for name, pixels in shown.items()},
            inspected=None
            if self.scene is None
            else inspected_figures(self.scene, aperture, as_found, corrected),
        )
        worst_first = sorted((*self.kept, pictured), key=lambda one: one.badness, reverse=True)
        self.kept = worst_first[:MAX_SHOWN_HOGELS]


def _shown(image: HogelImage) -> Bytes:
    """Return what people can see of an image: its colors, else a color for each surface."""
    if image.color is not None:
        linear = np.clip(np.nan_to_num(image.color), 0, 1)
        return np.asarray(np.rint(LEVELS * encoding_curve(linear)), dtype=np.uint8)
    named = image.triangle if (image.triangle != NOTHING).any() else image.object
    if not (named != NOTHING).any():
        named = np.where(image.covered, 0, NOTHING)
    # Neighboring numbers get colors far apart: multiples of odd constants, modulo 256.
    pixels = (
        named[..., None].astype(np.int64) * np.array([37, 101, 173]) + np.array([90, 60, 140])
    ) % 200 + 30
    pixels[named == NOTHING] = BACKGROUND_GRAY
    return np.asarray(pixels, dtype=np.uint8)


def _errors(figures: Figures) -> Bytes:
    beneath = BACKGROUND_GRAY - TRUTH_STRENGTH * (BACKGROUND_GRAY - _shown(figures.answer).astype(np.float64))
    beneath[~figures.answer.covered] = BACKGROUND_GRAY
    beneath[figures.error] = WRONG_RGB
    return np.asarray(beneath, dtype=np.uint8)


def _encoded(pixels: Bytes) -> str:
    step = -(-max(pixels.shape[:2]) // MAX_PICTURE_PX)
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels[::step, ::step])).save(buffer, "PNG")
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
