"""Test set: images of a renderer by which candidate models are tested."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from xfrustum.compare.judging.judged import Judging, wrong_pixels
from xfrustum.compare.metrics.error_maps import covered_by
from xfrustum.compare.renderer_model.drawn_model import (
    CAMERA_GROUPS,
    COMPOSITION_FIELDS,
    GROUPS,
    OTHER_FIELDS,
    RendererModel,
    field_of,
)
from xfrustum.compare.renderer_model.pictures import shows_something
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.images import NOTHING, HogelImage

MIN_EXPLAINED_FRACTION = 0.9
"""Smallest share of the wrong pixels that a diagnosis must explain.

Under the renderer's true conventions only pixels at outlines are wrong, by rounding, and these are
excused if images have triangle numbers. The remaining tenth allows for pictures without numbers,
whose outlines are not excused, and for a small second defect. A wrong candidate leaves most of the
wrong pixels unexplained."""

# Largest number of right pixels that a diagnosis may make wrong without a known cause, relative to
# the wrong pixels that it makes right. The renderer's true conventions make none wrong. If a defect
# of one camera or object is attributed to all of them, right pixels become wrong.
MAX_SPOILED_FRACTION = 0.02

# Largest number of tested hogels, spread over the sample. Each has thousands of pixels, so that a
# share measured in one hogel is within a few percent of the share in all hogels.
MAX_TESTED_HOGELS = 9

# Smallest net gain of a defect: the pixels that it makes right minus the pixels that it makes
# wrong, in standard deviations of this difference for random changes.
MIN_GAIN_DEVIATIONS = 2.0

# Share of wrong pixels among the covered pixels above which gross mistakes are tried: if a scene is
# scaled by ten, nearly all covered pixels are wrong.
GROSS_WRONG_FRACTION = 0.5

# Share of pixels that are wrong without a known cause, above which a hogel is an outlier.
MIN_OUTLYING_FRACTION = 0.02


@dataclass(frozen=True, kw_only=True, eq=False)
class TestSet:
    """Images by which candidate models are tested.

    `images` are decoded hogels of the renderer, before any correction, each with the camera of the
    aperture in its file's name. `nominal` is the model of the renderer according to its author:
    pixels that are wrong under this model need an explanation.
    """

    __test__: ClassVar[bool] = False  # keeps pytest from collecting this class

    reference: Reference
    images: Sequence[HogelImage]
    nominal: RendererModel
    judging: Judging = field(default_factory=Judging)
    #: cache of wrong pixels (N, H, W), by candidate and by whether causes excuse pixels
    masks: dict[tuple[RendererModel, bool], Mask] = field(default_factory=dict, repr=False)

    def of(self, images: Sequence[HogelImage], judging: Judging | None = None) -> TestSet:
        """Return a test set of other images of the renderer, with other rules if given."""
        return replace(self, images=images, judging=judging or self.judging, masks={})

    def few(self) -> TestSet:
        """Return a test set of only the first and the last tested image, to select candidates."""
        return self.of(self.tested[:: max(1, len(self.tested) - 1)])

    @property
    def tested(self) -> list[HogelImage]:
        """At most `MAX_TESTED_HOGELS` images, spread evenly over all images."""
        return spread(self.images, MAX_TESTED_HOGELS)

    @property
    def _covered(self) -> Mask:
        """Mask (N, H, W) of pixels at which the tested images show a surface."""
        colored = [image.color is not None and shows_something(image) for image in self.tested]
        pairs = zip(map(covered_by, self.tested), colored, strict=True)
        return np.stack([covered | color for covered, color in pairs])

    @property
    def infeasible(self) -> bool:
        """True if most of the covered pixels are wrong; False if no pixel is covered."""
        speaking = np.array([shows(image) for image in self.tested])
        shown = int(self._covered[speaking].sum()) if speaking.any() else 0
        return bool(shown) and self.wrong(self.nominal) > GROSS_WRONG_FRACTION * shown

    def mask(self, model: RendererModel, *, explained: bool = False) -> Mask:
        """Return a candidate's wrong pixels (N, H, W); if `explained`, only without a cause."""
        if (model, explained) not in self.masks:
            pairs = [
                wrong_pixels(self.reference, model, image, self.judging, explained=explained)
                for image in self.tested
            ]
            for place, excused in enumerate((False, explained)):
                masks = [model.orientation.applied(pair[place]) for pair in pairs]
                self.masks[model, excused] = np.array(masks, dtype=np.bool_)
        return self.masks[model, explained]

    def wrong(self, model: RendererModel, *, explained: bool = False) -> int:
        """Count a candidate's wrong pixels; if `explained`, only pixels without a known cause."""
        return int(self.mask(model, explained=explained).sum())

    def outliers(self, model: RendererModel) -> Iterator[TestSet]:
        """Yield each hogel in which a candidate leaves many wrong pixels without a cause."""
        many = MIN_OUTLYING_FRACTION * np.prod(self.reference.scene.frustum.resolution)
        alone = (self.of([image]) for image in self.images)
        return (test for test in alone if test.wrong(model, explained=True) > many)

    def leaves_outliers(self, model: RendererModel) -> bool:
        """Return whether a candidate leaves any hogel with many wrong pixels without a cause."""
        return any(True for _ in self.outliers(model))

    def share(self, model: RendererModel) -> float | None:
        """Return the share of wrong pixels that a candidate explains; None if no pixel is wrong.

        A pixel is explained if it is wrong under the nominal model, and under the candidate either
        right or wrong by a cause that is not a defect: edge, order, lost. Pixels that only the
        candidate makes wrong count against it. The share is computed over all pixels and over
        covered pixels, and the smaller share is returned: a candidate without visible surfaces
        explains black pixels, but no covered pixels.
        """
        before, after = self.mask(self.nominal), self.mask(model, explained=True)
        if not before.any():
            return None
        covered = self._covered
        counts = [(before.sum(), after.sum()), ((before & covered).sum(), (after & covered).sum())]
        return float(max(0.0, min(1 - left / wrong for wrong, left in counts if wrong)))

    def explains(self, model: RendererModel) -> bool:
        """Return whether a candidate explains enough for a diagnosis, or no pixel is wrong."""
        share = self.share(model)
        return share is None or share >= MIN_EXPLAINED_FRACTION

    def spares(self, model: RendererModel) -> bool:
        """Return whether right pixels of the nominal model stay right, except by rounding."""
        # Only triangle numbers separate rounding from errors. Other images are judged only by
        # `share`.
        named = [bool((image.triangle != NOTHING).any()) for image in self.tested]
        before, after = self.mask(self.nominal)[named], self.mask(model)[named]
        spoiled = self.mask(model, explained=True)[named] & ~before
        return bool(spoiled.sum() <= MAX_SPOILED_FRACTION * (before & ~after).sum())

    def pays(self, model: RendererModel, simpler: RendererModel | None = None) -> bool:
        """Return whether a candidate has fewer wrong pixels than a simpler one, or than nominal."""
        mine, other = self.mask(model), self.mask(simpler or self.nominal)
        gained, lost = int((other & ~mine).sum()), int((mine & ~other).sum())
        return bool(gained - lost > MIN_GAIN_DEVIATIONS * np.sqrt(gained + lost))

    def reduced(self, model: RendererModel) -> RendererModel:
        """Return a candidate without the defects that do not improve its explanation."""
        while True:
            simpler = list(self._simpler(model))
            rest = [candidate for candidate in simpler if not self.pays(model, candidate)]
            # The last defect remains: `share` determines whether it is a diagnosis.
            if not rest or len(simpler) == 1:
                return model
            model = min(rest, key=self.wrong)

    def _simpler(self, model: RendererModel) -> Iterator[RendererModel]:
        """Yield, for each defect of a candidate, the candidate without it."""
        groups: list[tuple[str, ...]] = [(field_of(group),) for group in GROUPS if group != "near"]
        groups += [(name,) for name in ("orientation", "order", "recentering", "pivot", "fit")]
        groups += [("film",), COMPOSITION_FIELDS]
        groups += [("near", "pivot", "fit")] if model.near != self.nominal.near else []
        groups += [("one_camera", *CAMERA_GROUPS)] if model.one_camera is not None else []
        groups += [(name,) for name in OTHER_FIELDS]
        for fields in groups:
            simpler = replace(model, **{name: getattr(self.nominal, name) for name in fields})
            if simpler != model:
                yield simpler


def spread(images: Sequence[HogelImage], most: int) -> list[HogelImage]:
    """Return at most `most` images, spread evenly over all."""
    chosen = np.linspace(0, len(images) - 1, min(len(images), most)).astype(int)
    return [images[index] for index in dict.fromkeys(chosen.tolist())]


def shows(image: HogelImage) -> bool:
    """Return whether an image names a triangle or an object, or has colors."""
    named = (image.triangle != NOTHING).any() or (image.object != NOTHING).any()
    return bool(named or image.color is not None)
