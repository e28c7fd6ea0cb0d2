"""Images of a renderer as evidence: how much of what is wrong a guess explains, and what it spoils."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from xfrustum.compare.diagnosis.hypotheses import FIELDS
from xfrustum.compare.judging.judged import Judging, wrong_pixels
from xfrustum.compare.metrics.error_maps import covered_by
from xfrustum.compare.renderer_model import parameters
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.compare.renderer_model.pictures import shows_something
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage

MIN_EXPLAINED_FRACTION = 0.9
"""Smallest share of the wrong pixels that a diagnosis must explain to be a finding.

Under the renderer's true conventions only pixels that rounding moves across outlines are wrong, and these are
excused where triangles are known. The tenth that is left unexplained makes room for pictures without numbers,
in which outlines are not excused, and for a small second fault. A wrong guess leaves the larger part
unexplained.
"""

# Largest number of right pixels that a diagnosis may make wrong without a known cause, as a share of those
# that it makes right. Under the renderer's true conventions there are none: what remains is a small second
# fault. A fault of one camera or of one object that is blamed on all of them spoils what was right.
MAX_SPOILED_FRACTION = 0.02

# Largest number of hogels that a diagnosis is tested on, spread over the sample. Each has thousands of
# pixels: the share of one hogel is that of all within a few percent.
MAX_TESTED_HOGELS = 9

# Smallest surplus of pixels that a fault makes right over those that it makes wrong, in standard deviations
# of this difference if a coin decided each pixel. A fault that gains less does not pay.
MIN_GAIN_DEVIATIONS = 2.0

# Share of wrong pixels, among those that show something, above which gross mistakes are tried: with a scene
# of ten times the size nearly all are wrong.
GROSS_WRONG_FRACTION = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Images against which guesses are tested.

    `images` are some of the renderer's hogels as read from its files, before any correction, each with the
    camera of the aperture that its file is named after. `nominal` is the renderer by its author's statements:
    the pixels that are wrong under it need an explanation.
    """

    reference: Reference
    images: Sequence[HogelImage]
    nominal: DrawnModel
    judging: Judging = field(default_factory=Judging)
    # Wrong pixels (N, H, W) of the tested images, for each guess and whether causes excuse them: a cache.
    known: dict[tuple[DrawnModel, bool], Mask] = field(default_factory=dict, repr=False)

    def of(self, images: Sequence[HogelImage], judging: Judging | None = None) -> Evidence:
        """Return other images of the same renderer, perhaps judged by other rules."""
        return replace(self, images=images, judging=judging or self.judging, known={})

    @property
    def tested(self) -> list[HogelImage]:
        """The images that are tested, spread evenly over all, `MAX_TESTED_HOGELS` at most."""
        count = len(self.images)
        chosen = np.unique(np.linspace(0, count - 1, min(count, MAX_TESTED_HOGELS)).astype(int))
        return [self.images[index] for index in chosen] if count else []

    @property
    def hopeless(self) -> bool:
        """Whether most of what the images show is wrong; false where they show nothing."""
        shown = sum(int(_covered(image).sum()) for image in self.tested if shows(image))
        return bool(shown) and self.wrong(self.nominal) > GROSS_WRONG_FRACTION * shown

    def wrong(self, model: DrawnModel, *, explained: bool = False) -> int:
        """Return the number of pixels that are wrong by a guess; if `explained`, without a known cause."""
        return int(self._wrong(model, explained=explained).sum())

    def share(self, model: DrawnModel) -> float | None:
        """Return the share of the wrong pixels that a guess explains; None where none is wrong.

        A pixel is explained if it is wrong by what was asked for, and right by the guess or wrong by a cause
        that is nobody's fault: edge, order, lost. Pixels that only the guess makes wrong count against it.
        The result is the smaller of two shares: among all pixels, and among those in which images show
        something. A guess under which nothing is seen explains black pixels, but not what images show.
        """
        asked = self._wrong(self.nominal)
        if not asked.any():
            return None
        left, covered, shares = (
            self._wrong(model, explained=True),
            np.stack([*map(_covered, self.tested)]),
            [],
        )
        for place in (np.ones_like(covered), covered):
            before, after = (int((mask & place).sum()) for mask in (asked, left))
            shares.append(max(0.0, 1.0 - after / before) if before else 1.0)
        return min(shares)

    def explains(self, model: DrawnModel) -> bool:
        """Return whether a guess explains enough to be a finding, or nothing needs an explanation."""
        share = self.share(model)
        return share is None or share >= MIN_EXPLAINED_FRACTION

    def spares(self, model: DrawnModel) -> bool:
        """Return whether pixels that are right as asked for stay right by a guess, rounding excused.

        Only numbers of triangles tell rounding from errors; in other images the share alone decides.
        """
        named = [bool((image.triangle != NOTHING).any()) for image in self.tested]
        before, after = self._wrong(self.nominal)[named], self._wrong(model)[named]
        spoiled = self._wrong(model, explained=True)[named] & ~before
        return bool(spoiled.sum() <= MAX_SPOILED_FRACTION * (before & ~after).sum())

    def pays(self, model: DrawnModel, simpler: DrawnModel | None = None) -> bool:
        """Return whether a guess makes more pixels right than a simpler one, or than what was asked for."""
        mine, other = self._wrong(model), self._wrong(simpler or self.nominal)
        gained, lost = int((other & ~mine).sum()), int((mine & ~other).sum())
        return bool(gained - lost > MIN_GAIN_DEVIATIONS * np.sqrt(gained + lost))

    def reduced(self, model: DrawnModel) -> DrawnModel:
        """Return a guess without the faults that add nothing to what the others explain."""
        while True:
            simpler = list(_simpler(model, self.nominal))
            rest = [one for one in simpler if not self.pays(model, one)]
            # The last remaining fault is not removed here: its share decides whether it is a finding.
            if not rest or len(simpler) == 1:
                return model
            model = min(rest, key=self.wrong)

    def joint_groups(self, model: DrawnModel) -> tuple[str, ...]:
        """Return the groups of a guess's numbers of which none makes pixels right without the others.

        Groups are added to the guess's conventions one after another, each the one that mends most; those
        that are left when none of them pays explain only together.
        """
        known = model.with_parameters(self.nominal.parameters)
        left = {one.name: {one.field: getattr(model, one.field)} for one in parameters.GROUPS}
        left = {name: group for name, group in left.items() if replace(known, **group) != known}
        while len(left) > 1:
            tried = {name: replace(known, **group) for name, group in left.items()}
            paying = {name: one for name, one in tried.items() if self.pays(one, known)}
            if not paying:
                return tuple(left)
            best = min(paying, key=lambda name: self.wrong(paying[name]))
            known = paying[best]
            del left[best]
        return ()

    def _wrong(self, model: DrawnModel, *, explained: bool = False) -> Mask:
        """Return the wrong pixels (N, H, W) by a guess; if `explained`, those without a known cause."""
        key, reference, judging = (model, explained), self.reference, self.judging
        if key not in self.known:
            masks = [wrong_pixels(reference, model, one, judging, explained=explained) for one in self.tested]
            self.known[key] = np.array([model.orientation.applied(mask) for mask in masks], dtype=np.bool_)
        return self.known[key]


def shows(image: HogelImage) -> bool:
    """Return whether an image names a triangle or an object, or has colors."""
    named = (image.triangle != NOTHING).any() or (image.object != NOTHING).any()
    return bool(named or image.color is not None)


def _covered(image: HogelImage) -> Mask:
    return covered_by(image) if image.color is None else covered_by(image) | shows_something(image)


def _simpler(model: DrawnModel, nominal: DrawnModel) -> Iterator[DrawnModel]:
    """Yield, for each fault of a guess, the guess without this fault."""
    groups: list[tuple[str, ...]] = [(group.field,) for group in parameters.GROUPS if group.name != "near"]
    groups += [("orientation",), ("order",), ("recentering",), ("pivot",), ("fit",), FIELDS]
    groups += [("near", "pivot", "fit")] if model.near != nominal.near else []
    groups += [("one_camera", *parameters.CAMERA_GROUPS)] if model.one_camera is not None else []
    for fields in groups:
        simpler = replace(model, **{name: getattr(nominal, name) for name in fields})
        if simpler != model:
            yield simpler
