"""Channels of hogels of other renderers: what they should show, what they show, and what is wrong."""

from __future__ import annotations

import numpy as np

from xfrustum.compare.judging.judged import Figures
from xfrustum.compare.metrics.displacement import displacement
from xfrustum.compare.metrics.error_maps import judged_pixels
from xfrustum.reports.common.formatting import percent
from xfrustum.reports.inspection.channels import (
    CORRECTED,
    ERROR,
    IMAGE,
    ROUNDING,
    STATE,
    TRUTH,
    Channel,
    Layer,
    classes,
    displacement_channels,
    image_layer,
    with_normals,
)
from xfrustum.reports.inspection.hogels import InspectedHogel
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture


def inspected_figures(
    scene: Scene, aperture: Aperture, as_found: Figures, corrected: Figures
) -> InspectedHogel:
    """Return a hogel of a scene, judged as it was found and after correction."""
    words = f"{as_found.limited_words} {percent(as_found.judged_fraction)}"
    if corrected is not as_found:
        words += f", corrected {percent(corrected.judged_fraction)}"
    return InspectedHogel.of(
        aperture,
        words,
        [
            image_layer(TRUTH, "what it should show", with_normals(as_found.answer, scene)),
            image_layer(IMAGE, "image, upright", as_found.image, said=True),
            Layer(name=ERROR, words="errors of the image", channels=_errors(as_found, corrected)),
        ],
    )


def _errors(as_found: Figures, corrected: Figures) -> tuple[Channel, ...]:
    found = [_state(STATE, as_found)]
    if corrected is not as_found:
        found.append(_state(CORRECTED, corrected))
    if corrected.cause_masks is not None:
        found.append(classes(ROUNDING, corrected.error.shape, corrected.cause_masks.masks, "none"))
    return (*found, *_moved(as_found.image, as_found.answer))


def _state(name: str, figures: Figures) -> Channel:
    masks = {"tie, not judged": ~judged_pixels(figures.answer), "wrong": figures.error}
    return classes(name, figures.error.shape, masks, "right")


def _moved(image: HogelImage, answer: HogelImage) -> tuple[Channel, ...]:
    """Return how far each point that the image shows is from where the true frustum shows it."""
    if not np.isfinite(image.position).any():
        return ()
    return displacement_channels(displacement(image, answer.camera))
