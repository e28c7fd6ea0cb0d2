"""A diagnosis is put to the test: how much of what is wrong does it explain, and does each fault pay?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from xfrustum.compare.judging.judged import Judging, wrong_pixels
from xfrustum.compare.metrics.surface import covered_by
from xfrustum.compare.renderer_model import parameters
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.compare.renderer_model.pictures import shows_something
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage

LEAST_EXPLAINED = 0.9
"""Share of the wrong pixels that a diagnosis must explain to be a finding.

Under the renderer's true conventions all pixels are right but those that rounding moves across outlines, and
these are excused where triangles are known. A tenth leaves room for pictures without numbers, whose outlines
are not excused, and for a second fault that is small; a guess that is wrong leaves the larger part.
"""

MAX_TESTED_HOGELS = 9
"""Largest number of hogels that a diagnosis is tested on, spread over the sample: each has thousands of
pixels, and tells within a few percent what the others would."""

DOUBT = 2.0
"""A fault pays for itself when it makes more pixels right than wrong by this many standard deviations of the
difference, had each of these pixels been decided by a coin."""


MOSTLY_WRONG = 0.5
"""Wrong pixels, as a part of those that images show, from which on gross mistakes are tried: a scene of ten
times the size is wrong nearly everywhere."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ExplanationTest:
    """Images against which guesses are tested.

    Attributes
    ----------
    reference
        Of the scene.
    images
        As found; at most `MAX_TESTED_HOGELS` of them are looked at.
    nominal
        What was asked for: what is wrong under it is to be explained.
    judging
        What counts as wrong.
    """

    reference: Reference
    images: Sequence[HogelImage]
    nominal: DrawnModel
    judging: Judging = field(default_factory=Judging)
    known: dict[tuple[DrawnModel, bool], list[Mask]] = field(default_factory=dict, repr=False)

    @property
    def tested(self) -> list[HogelImage]:
        """The images that are looked at."""
        count = len(self.images)
        chosen = np.unique(np.linspace(0, count - 1, min(count, MAX_TESTED_HOGELS)).astype(int))
        return [self.images[index] for index in chosen] if count else []

    @property
    def hopeless(self) -> bool:
        """Whether images that name surfaces or colors show some, most of which are wrong."""
        telling = [image for image in self.tested if _tells(image)]
        shown = sum(int(_covered(image).sum()) for image in telling)
        return bool(shown) and self.wrong(self.nominal) > MOSTLY_WRONG * shown

    def wrong(self, model: DrawnModel) -> int:
        """Return how many pixels are wrong by a guess, whatever the cause."""
        return self._count(model, explained=False)

    def unexplained(self, model: DrawnModel) -> int:
        """Return how many pixels are wrong by a guess for no known cause."""
        return self._count(model, explained=True)

    def share(self, model: DrawnModel) -> float | None:
        """Return the share of the wrong pixels that a guess explains; None where none is wrong.

        Explained are pixels that are wrong by what was asked for, and right by the guess, or wrong for a
        reason that is nobody's fault: edge, order, lost. Pixels that only the guess makes wrong count
        against it. So much must hold of all pixels, and of those in which images show something: a guess
        under which nothing is seen explains black, but not what images show.
        """
        if not self.wrong(self.nominal):
            return None
        everywhere = [np.ones_like(image.triangle, dtype=np.bool_) for image in self.tested]
        shown = [_covered(image) for image in self.tested]
        return min(self._share_within(model, places) for places in (everywhere, shown))

    def _share_within(self, model: DrawnModel, places: Sequence[Mask]) -> float:
        before, after = (
            sum(int((mask & place).sum()) for mask, place in zip(masks, places, strict=True))
            for masks in (self._wrong(self.nominal), self._wrong(model, explained=True))
        )
        return max(0.0, 1.0 - after / before) if before else 1.0

    def reduced(self, model: DrawnModel) -> DrawnModel:
        """Return a guess without the faults that add nothing to what the others explain."""
        while True:
            rest = [simpler for simpler in _simpler(model, self.nominal) if not self._pays(model, simpler)]
            # The last fault is left to the test of the share.
            if not rest or len(list(_simpler(model, self.nominal))) == 1:
                return model
            model = min(rest, key=self.wrong)

    def pays(self, model: DrawnModel) -> bool:
        """Return whether a guess makes more pixels right than what was asked for does."""
        return self._pays(model, self.nominal)

    def _pays(self, model: DrawnModel, simpler: DrawnModel) -> bool:
        gained = lost = 0
        for mine, other in zip(self._wrong(model), self._wrong(simpler), strict=True):
            gained += int((other & ~mine).sum())
            lost += int((mine & ~other).sum())
        return bool(gained - lost > DOUBT * np.sqrt(gained + lost))

    def _count(self, model: DrawnModel, *, explained: bool) -> int:
        return sum(int(mask.sum()) for mask in self._wrong(model, explained=explained))

    def _wrong(self, model: DrawnModel, *, explained: bool = False) -> list[Mask]:
        """Return the pixels of each image that are wrong by a guess; if `explained`, for no known cause."""
        key = (model, explained)
        if key not in self.known:
            found = self.known[key] = []
            for image in self.tested:
                wrong = wrong_pixels(self.reference, model, image, self.judging, explained=explained)
                found.append(model.orientation.applied(wrong))
        return self.known[key]


def _tells(image: HogelImage) -> bool:
    return bool(
        (image.triangle != NOTHING).any() or (image.object != NOTHING).any() or image.color is not None
    )


def _covered(image: HogelImage) -> Mask:
    return covered_by(image) if image.color is None else covered_by(image) | shows_something(image)


def _simpler(model: DrawnModel, nominal: DrawnModel) -> Iterator[DrawnModel]:
    """Yield a guess with one fault less, for each of its faults."""
    groups: list[tuple[str, ...]] = [(group.field,) for group in parameters.GROUPS if group.name != "near"]
    groups += [
        ("orientation",),
        ("order",),
        ("pivot",),
        ("fit",),
        ("front", "overlaid", "culled"),
        ("conjugated",),
    ]
    groups += [("near", "pivot", "fit")] if model.near != nominal.near else []
    for fields in groups:
        simpler = replace(model, **{name: getattr(nominal, name) for name in fields})
        if simpler != model:
            yield simpler
