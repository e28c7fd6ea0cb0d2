"""Diagnosis before verdict: what a renderer does otherwise than asked, from some of its hogels.

`diagnose` finds the reading of the pixels and the way they were drawn, and tests both together: a
guess that does not explain what is wrong is no finding. `TestSet` says how much a guess explains,
and what it spoils.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

import numpy as np

from xfrustum.compare.diagnosis.composition import compared, find_composition
from xfrustum.compare.diagnosis.encodings import FoundEncoding, find_encoding, find_transfer
from xfrustum.compare.diagnosis.faults import (
    FIELDS,
    MISTAKEN_UNITS,
    SHADINGS,
    VIEW_SHEAR,
    Defect,
    faults_of,
    found_in,
    with_joint_numbers,
)
from xfrustum.compare.diagnosis.film_faults import films_of
from xfrustum.compare.diagnosis.geometry_fit import (
    GeometryFit,
    PixelClaims,
    claims_of,
    fit_geometry,
    outside_px,
)
from xfrustum.compare.diagnosis.hogel_faults import hogel_guesses, outlying
from xfrustum.compare.diagnosis.registration import register, with_near
from xfrustum.compare.diagnosis.scene_faults import Guess, scene_guesses, with_axes
from xfrustum.compare.judging.judged import Compared, Judging, wrong_pixels
from xfrustum.compare.metrics.error_maps import covered_by
from xfrustum.compare.renderer_model.conventions import CONVENTIONS
from xfrustum.compare.renderer_model.drawn_model import (
    CAMERA_GROUPS,
    GROUPS,
    OTHER_FIELDS,
    Film,
    Recentering,
    RendererModel,
    field_of,
    screen_lengths,
)
from xfrustum.compare.renderer_model.pictures import (
    shows_something,
)
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import film_window
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage

MIN_EXPLAINED_FRACTION = 0.9
"""Smallest share of the wrong pixels that a diagnosis must explain to be a finding.

Under the renderer's true conventions only pixels that rounding moves across outlines are wrong, and
these are excused where triangles are known. The tenth that is left unexplained makes room for
pictures without numbers, in which outlines are not excused, and for a small second fault. A wrong
guess leaves the larger part unexplained.
"""

# Largest number of right pixels that a diagnosis may make wrong without a known cause, as a share
# of those that it makes right. Under the renderer's true conventions there are none: what remains
# is a small second fault. A fault of one camera or of one object that is blamed on all of them
# spoils what was right.
MAX_SPOILED_FRACTION = 0.02

# Largest number of hogels that a diagnosis is tested on, spread over the sample. Each has thousands
# of pixels: the share of one hogel is that of all within a few percent.
MAX_TESTED_HOGELS = 9

# Smallest surplus of pixels that a fault makes right over those that it makes wrong, in standard
# deviations of this difference if a coin decided each pixel. A fault that gains less does not pay.
MIN_GAIN_DEVIATIONS = 2.0

# Share of wrong pixels, among those that show something, above which gross mistakes are tried: with
# a scene of ten times the size nearly all are wrong.
GROSS_WRONG_FRACTION = 0.5

# Smallest number of claims that geometry is fitted to: several for each of the numbers to be fitted
# and the two symmetries.
MIN_FITTED_CLAIMS = 100

# Shares of the scene's vertices that lie below the heights at which other explanations of pictures
# are tried.
TRIED_VERTEX_FRACTIONS = (0.1, 0.3, 0.5, 0.7, 0.9)

# Largest relative difference between the pitches of columns and rows at which they count as equal:
# each may be off by `drawn_model.SMALLEST_FACTOR`, half of this, without having a name.
MAX_PITCH_DIFFERENCE = 1e-3

# Largest number of faults of cameras beside which other axes are not tried: pictures and hogels in
# another order, which two mistakes of a renderer make as well.
MAX_FAULTS_OF_CAMERAS = 2

# Factors of the shear of views that are tried, and relative changes of the best one that are tried
# next. Neighbors differ by one percent, by which a picture moves less than by a pixel where views
# have a hundred pixels. And the largest failure of a claim that counts, in pixels: claims under
# wrong factors fail by any distance.
TRIED_VIEW_SHEARS, FINER_STEPS = np.geomspace(0.4, 2.5, 185), np.linspace(-0.015, 0.015, 61)
VIEW_SHEAR_CAP_PX = 4.0


@dataclass(frozen=True, kw_only=True, eq=False)
class TestSet:
    """Images against which guesses are tested.

    `images` are some of the renderer's hogels as read from its files, before any correction, each
    with the camera of the aperture that its file is named after. `nominal` is the renderer by its
    author's statements: the pixels that are wrong under it need an explanation.
    """

    reference: Reference
    images: Sequence[HogelImage]
    nominal: RendererModel
    judging: Judging = field(default_factory=Judging)
    # Wrong pixels (N, H, W) of the tested images, for each guess and whether causes excuse them: a
    # cache.
    known: dict[tuple[RendererModel, bool], Mask] = field(default_factory=dict, repr=False)

    def of(self, images: Sequence[HogelImage], judging: Judging | None = None) -> TestSet:
        """Return other images of the same renderer, perhaps judged by other rules."""
        return replace(self, images=images, judging=judging or self.judging, known={})

    @property
    def tested(self) -> list[HogelImage]:
        """The images that are tested, spread evenly over all, `MAX_TESTED_HOGELS` at most."""
        count = len(self.images)
        chosen = np.unique(np.linspace(0, count - 1, min(count, MAX_TESTED_HOGELS)).astype(int))
        return [self.images[index] for index in chosen] if count else []

    @property
    def _covered(self) -> Mask:
        """Pixels (N, H, W) in which the tested images show something."""
        lit = [shows_something(one) if one.color is not None else False for one in self.tested]
        return np.stack(
            [covered_by(one) | also for one, also in zip(self.tested, lit, strict=True)]
        )

    @property
    def infeasible(self) -> bool:
        """Whether most of what the images show is wrong; false where they show nothing."""
        telling = np.array([shows(image) for image in self.tested])
        shown = int(self._covered[telling].sum()) if telling.any() else 0
        return bool(shown) and self.wrong(self.nominal) > GROSS_WRONG_FRACTION * shown

    def wrong(self, model: RendererModel, *, explained: bool = False) -> int:
        """Return the number of pixels that are wrong by a guess; if `explained`, without a known cause."""
        return int(self.mask(model, explained=explained).sum())

    def share(self, model: RendererModel) -> float | None:
        """Return the share of the wrong pixels that a guess explains; None where none is wrong.

        A pixel is explained if it is wrong by what was asked for, and right by the guess or wrong
        by a cause that is nobody's fault: edge, order, lost. Pixels that only the guess makes wrong
        count against it. Of the shares among all pixels and among those in which images show
        something the smaller counts: a guess under which nothing is seen explains black pixels, but
        not what images show.
        """
        asked = self.mask(self.nominal)
        if not asked.any():
            return None
        left, covered = self.mask(model, explained=True), self._covered
        counts = [
            (np.sum(asked & here), np.sum(left & here)) for here in (np.ones_like(covered), covered)
        ]
        return float(
            min(max(0.0, 1.0 - after / before) if before else 1.0 for before, after in counts)
        )

    def explains(self, model: RendererModel) -> bool:
        """Return whether a guess explains enough to be a finding, or nothing needs an explanation."""
        share = self.share(model)
        return share is None or share >= MIN_EXPLAINED_FRACTION

    def spares(self, model: RendererModel) -> bool:
        """Return whether pixels that are right as asked for stay right by a guess, rounding excused."""
        # Only numbers of triangles tell rounding from errors; in other images the share alone
        # decides.
        named = [bool((image.triangle != NOTHING).any()) for image in self.tested]
        before, after = self.mask(self.nominal)[named], self.mask(model)[named]
        spoiled = self.mask(model, explained=True)[named] & ~before
        return bool(spoiled.sum() <= MAX_SPOILED_FRACTION * (before & ~after).sum())

    def pays(self, model: RendererModel, simpler: RendererModel | None = None) -> bool:
        """Return whether a guess makes more pixels right than a simpler one, or than what was asked for."""
        mine, other = self.mask(model), self.mask(simpler or self.nominal)
        gained, lost = int((other & ~mine).sum()), int((mine & ~other).sum())
        return bool(gained - lost > MIN_GAIN_DEVIATIONS * np.sqrt(gained + lost))

    def reduced(self, model: RendererModel) -> RendererModel:
        """Return a guess without the faults that add nothing to what the others explain."""
        while True:
            simpler = list(_simpler(model, self.nominal))
            rest = [one for one in simpler if not self.pays(model, one)]
            # The last remaining fault is not removed here: its share decides whether it is a
            # finding.
            if not rest or len(simpler) == 1:
                return model
            model = min(rest, key=self.wrong)

    def joint_groups(self, model: RendererModel) -> tuple[str, ...]:
        """Return the groups of a guess's numbers of which none makes pixels right without the others."""
        # Groups are added to the guess's conventions one after another, each the one that mends
        # most; those that are left when none of them pays explain only together.
        known = model.with_parameters(self.nominal.parameters)
        left = {name: {field_of(name): getattr(model, field_of(name))} for name in GROUPS}
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

    def mask(self, model: RendererModel, *, explained: bool = False) -> Mask:
        """Return the wrong pixels (N, H, W) by a guess; if `explained`, those without a known cause."""
        if (model, explained) not in self.known:
            reference, judging, turned = self.reference, self.judging, model.applied
            pairs = [
                wrong_pixels(reference, model, one, judging, explained=explained)
                for one in self.tested
            ]
            for place, one in enumerate((False, explained)):
                self.known[model, one] = np.array(
                    [turned(pair[place]) for pair in pairs], dtype=np.bool_
                )
        return self.known[model, explained]


def shows(image: HogelImage) -> bool:
    """Return whether an image names a triangle or an object, or has colors."""
    named = (image.triangle != NOTHING).any() or (image.object != NOTHING).any()
    return bool(named or image.color is not None)


def _simpler(model: RendererModel, nominal: RendererModel) -> Iterator[RendererModel]:
    """Yield, for each fault of a guess, the guess without this fault."""
    groups: list[tuple[str, ...]] = [(field_of(group),) for group in GROUPS if group != "near"]
    groups += [
        ("orientation",),
        ("order",),
        ("recentering",),
        ("pivot",),
        ("fit",),
        ("film",),
        FIELDS,
    ]
    groups += [("near", "pivot", "fit")] if model.near != nominal.near else []
    groups += [("one_camera", *CAMERA_GROUPS)] if model.one_camera is not None else []
    groups += [(name,) for name in OTHER_FIELDS]
    for fields in groups:
        simpler = replace(model, **{name: getattr(nominal, name) for name in fields})
        if simpler != model:
            yield simpler


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis:
    """A renderer's way to draw, and its faults."""

    model: RendererModel  # the guess that explains the images, the nominal one where no guess does
    faults: tuple[Defect, ...] = ()  # its differences from what was asked
    does_not_explain: tuple[Defect, ...] = ()  # those of the best guess, if it explains too little
    means: str
    nothing_wrong: bool = False  # whether the images needed no explanation
    refuted: bool = False  # whether the guess makes the judged hogels no better, all taken together

    @property
    def guesses(self) -> tuple[Defect, ...]:
        """Those of `does_not_explain` that people are told: they explain more than 0 %, as printed."""
        return tuple(one for one in self.does_not_explain if round(100 * (one.explains or 0.0)) > 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """The way to read a renderer's images, their diagnosis in this reading, and the rules by which to judge.

    The faults of the diagnosis include those of the reading.
    """

    encoding: FoundEncoding
    diagnosis: Diagnosis
    judging: Judging


def diagnose(evidence: TestSet, *, of_views: bool = False) -> Findings:
    """Find the reading of a renderer's images and the way it draws.

    A reading is tested together with the diagnosis of the images in this reading: together they
    must explain `MIN_EXPLAINED_FRACTION` of the pixels that are wrong as stated. Otherwise neither
    is a finding. Hogels that were put together from views (`of_views`) may have another shear.
    """
    reference, images, nominal = evidence.reference, evidence.images, evidence.nominal
    if of_views and (sheared := _with_view_shear(evidence)) is not None:
        return Findings(encoding=FoundEncoding(), diagnosis=sheared, judging=evidence.judging)
    encoding, judging, read = find_encoding(reference, images, nominal), evidence.judging, evidence
    diagnosis = None if encoding.faults else diagnosis_of(evidence)
    if (
        diagnosis is not None
        and not diagnosis.faults
        and evidence.judging.compared is Compared.COLOR
    ):
        # Only where nothing else explains colors are they read through another curve.
        encoding = find_transfer(reference, images) if evidence.wrong(nominal) else encoding
    if encoding.faults:
        plain = diagnosis
        # Where numbers were asked for and colors are found, shading was not asked for: only
        # geometry counts.
        if encoding.as_colors:
            judging = replace(judging, compared=Compared.GEOMETRY)
        if encoding.reading is not None:
            judging = replace(judging, transfer=encoding.reading.transfer)
        read = evidence.of([encoding.read(reference, image) for image in images], judging)
        diagnosis = diagnosis_of(read)
        wrong, left = evidence.wrong(nominal), read.wrong(diagnosis.model, explained=True)
        share = max(0.0, 1.0 - left / wrong) if wrong else 0.0
        faults = tuple(
            replace(fault, explains=share) for fault in (*encoding.faults, *diagnosis.faults)
        )
        diagnosis = replace(diagnosis, faults=faults)
        if share < MIN_EXPLAINED_FRACTION:
            encoding, judging, read = FoundEncoding(), evidence.judging, evidence
            diagnosis = plain or diagnosis_of(evidence)
            doubted = (*map(doubtful, faults), *diagnosis.does_not_explain)
            diagnosis = replace(diagnosis, does_not_explain=doubted)
    assert diagnosis is not None
    return Findings(encoding=encoding, diagnosis=diagnosis, judging=judging)


def diagnosis_of(evidence: TestSet) -> Diagnosis:
    """Find out how a renderer draws whose pixels are read as stated."""
    nominal = evidence.nominal
    if not evidence.images or any(evidence.of([one]).wrong(nominal) for one in evidence.images):
        found = _of_wrong(evidence)
    else:
        # Nothing needs an explanation: a guess that fits a little better fits noise.
        means = f"{_counted(len(evidence.tested), 'hogel')}, in which nothing is wrong"
        found = Diagnosis(model=evidence.nominal, means=means, nothing_wrong=True)
    found = _with_film(evidence, found)
    pictures = [one for one in evidence.images if one.color is not None]
    if not pictures or not found.model.plain or {*SHADINGS} & {*found_in(found.model)}:
        return found
    # Numbers of surfaces say nothing of light: where images have colors too, these are tested by
    # themselves.
    nothing, nowhere = (
        np.full_like(pictures[0].triangle, NOTHING),
        np.full_like(pictures[0].position, np.nan),
    )
    silent: dict[str, Any] = {"triangle": nothing, "object": nothing, "position": nowhere}
    colors = evidence.of([replace(image, **silent) for image in pictures])
    for one in SHADINGS:
        lit = one.of(found.model)
        share = colors.share(lit) or 0.0
        if share >= MIN_EXPLAINED_FRACTION and colors.pays(lit, found.model):
            fault = Defect(fault=one.fault, value=one.value, words=one.words, explains=share)
            return replace(found, model=lit, faults=(*found.faults, fault))
    return found


def doubtful(fault: Defect) -> Defect:
    """Return a fault whose words say that it explains too little, or makes wrong what was right."""
    assert fault.explains is not None
    would = f"would explain only {100 * fault.explains:.0f} % of what is wrong"
    if fault.explains >= MIN_EXPLAINED_FRACTION:
        would = "would make pixels wrong that are right"
    return replace(fault, words=f"{fault.words}: {would}")


def declared(
    nominal: RendererModel, found: RendererModel, accepted: Sequence[str]
) -> RendererModel:
    """Return the model that images are judged by: the nominal one with the accepted conventions as found."""
    assert set(accepted) <= set(CONVENTIONS)
    also = ("pivot", "fit") if "near" in accepted else ()
    return replace(nominal, **{name: getattr(found, name) for name in (*accepted, *also)})


def _of_wrong(evidence: TestSet) -> Diagnosis:
    """Find out how a renderer draws if some of its images are wrong."""
    # Step 1: fit conventions and geometry, and leave out the hogels that the fit calls spoiled.
    whole, reference, nominal, images = (
        evidence,
        evidence.reference,
        evidence.nominal,
        evidence.images,
    )
    fit = GeometryFit(model=nominal, low=nominal.parameters, high=nominal.parameters)
    means = "nothing, as no hogel shows enough of the scene to tell"
    claims, claiming = _claims(evidence)
    pictures = [one for one in images if one.color is not None or (one.object != NOTHING).any()]
    if claims is not None:
        fit = fit_geometry(claims, nominal)
        means = f"{len(claims):,} claims of {_counted(claiming, 'hogel')}"
        means += f"; {_counted(len(fit.spoiled), 'hogel')} unlike the others" if fit.spoiled else ""
        means += "" if fit.holds else "; no convention explains them alone"
    elif pictures:
        fit = register(reference, pictures, nominal)
        means = f"registration of {_counted(len(pictures), 'picture')}"
    evidence = evidence.of([one for one in images if one.camera.aperture.index not in fit.spoiled])
    # Step 2: the guess that explains most, and the test whether it explains enough and spoils
    # nothing.
    best = _best(evidence, fit)
    faults, share = _named(evidence, best), evidence.share(best.model)
    explains = share is None or (share >= MIN_EXPLAINED_FRACTION and evidence.spares(best.model))
    if explains and (faults or share is None):
        if share is not None and evidence.pays(best.model):
            found = Diagnosis(model=best.model, faults=faults, means=means)
        else:
            # The wrong pixels have causes that are nobody's fault, and need no other guess.
            found = Diagnosis(model=nominal, means=means)
    else:
        # No guess explains enough: the best fit is reported as doubtful, though fewer faults may
        # do.
        doubted = tuple(map(doubtful, faults or _named(evidence, fit)))
        found = Diagnosis(model=nominal, does_not_explain=doubted, means=means)
    # Step 3: what is no convention, such as another scene, where something is left to explain, or
    # where other axes alone may make the pictures that several mistakes of cameras make together.
    left = _left(whole, found)
    if not left and len(found.faults) <= MAX_FAULTS_OF_CAMERAS:
        return found
    plain = fit.model.with_parameters(nominal.parameters)
    values = nominal.parameters
    bare = [
        replace(fit, model=one, low=values, high=values, alternatives=())
        for one in (plain, nominal)
    ]
    fits = [best] if found.faults else [best, fit, *bare]
    distinct = list({one.model: one for one in reversed(fits)}.values())[::-1]
    if not left:
        return _with_other_faults(whole, with_axes(whole, distinct[-1]), found)
    guesses = (
        hogel_guesses(whole, claims, distinct),
        scene_guesses(whole, distinct),
    )
    return _with_other_faults(whole, chain.from_iterable(guesses), found)


def _with_other_faults(evidence: TestSet, guesses: Iterable[Guess], found: Diagnosis) -> Diagnosis:
    """Return a diagnosis with faults that are no conventions, that explain more, or as much with fewer."""
    for guess, more in guesses:
        named = {one for one, _ in guess.model.shows}
        odd = [image for image in evidence.images if image.camera.aperture.index in named]
        # Hogels that are named by themselves must be explained by themselves too.
        of_named, model = evidence.of(odd) if odd else evidence, evidence.reduced(guess.model)
        model = replace(model, **{name: getattr(guess.model, name) for name in OTHER_FIELDS})
        if not (evidence.explains(model) and of_named.explains(model)):
            continue
        known = replace(guess, model=model, alternatives=() if more else guess.alternatives)
        share = of_named.share(model)
        if not known.holds:
            # Intervals of a fit that something misled are too wide, and would leave out numbers
            # that pay.
            known = known.unbounded(evidence.nominal)
        faults = (*_named(evidence, known), *(replace(fault, explains=share) for fault in more))
        better = of_named.pays(model, found.model)
        simpler = len(faults) < len(found.faults) and not of_named.pays(found.model, model)
        if evidence.spares(model) and (better or simpler):
            found = Diagnosis(model=model, faults=faults, means=found.means)
            # Several objects that are missing may be one mistake of the cameras, which is tried
            # later.
            if len(more) <= 1 and not _left(evidence, found):
                break
    return found


def _left(evidence: TestSet, found: Diagnosis) -> bool:
    """Return whether a diagnosis leaves something to explain in any hogel."""
    return any(outlying(evidence.of([one]), found.model) for one in evidence.images)


def _with_film(evidence: TestSet, found: Diagnosis) -> Diagnosis:
    """Return a diagnosis that names how pixels lie on their film, where that explains what nothing else does.

    Pictures that are moved by whole pixels may be rolled: then what they show beside their borders
    says so.
    """
    asked, right = evidence.nominal, np.rint(found.model.shift).astype(int)
    if found.faults:
        more = any(getattr(found.model, name) != getattr(asked, name) for name in OTHER_FIELDS)
        rolled = Film(rolled=(int(-right[0]), int(-right[1])))
        film = replace(found.model, shift=asked.shift, film=rolled)
        if not right.any() or more or not evidence.pays(film, found.model):
            return found
    elif not evidence.images or not evidence.wrong(asked):
        return found
    else:
        # A few hogels choose the film, which all of them test.
        few = evidence.of(evidence.tested[:: max(1, len(evidence.tested) - 1)])
        shown = [compared(few.reference, [asked], image) for image in few.images]
        films = [replace(asked, film=film) for film in films_of(few, shown)]
        film = min(films, key=few.wrong)
    if not (evidence.explains(film) and evidence.spares(film) and evidence.pays(film)):
        return found
    fit = GeometryFit(model=film, low=film.parameters, high=film.parameters)
    return Diagnosis(model=film, faults=_named(evidence, fit), means=found.means)


def _claims(evidence: TestSet) -> tuple[PixelClaims | None, int]:
    """Return the claims of images where they are enough to be fitted, and how many images have some."""

    def claiming(one: HogelImage) -> bool:
        return bool((one.triangle != NOTHING).any() or np.isfinite(one.position[..., :2]).any())

    images = [*filter(claiming, evidence.images)]
    claims = claims_of(evidence.reference.scene, images) if images else None
    return claims if claims is not None and len(claims) >= MIN_FITTED_CLAIMS else None, len(images)


def _named(evidence: TestSet, fit: GeometryFit) -> tuple[Defect, ...]:
    """Return the faults of a guess, each with the share of the wrong pixels that all of them explain."""
    faults = faults_of(evidence.reference.scene, evidence.nominal, fit)
    share = evidence.share(fit.model) if faults else None
    if len(faults) > 1:
        faults = with_joint_numbers(faults, evidence.joint_groups(fit.model), fit.model)
    return tuple(replace(fault, explains=share) for fault in faults)


def _best(evidence: TestSet, fit: GeometryFit) -> GeometryFit:
    """Return the guess that explains most of what is wrong, without faults that add nothing."""
    # Step 1: the fitted guess, with the halves put together as the images have them.
    nominal, recentered = evidence.nominal, evidence.reference.scene.frustum.recentered
    model, *others = _composed(evidence, fit.model)
    if model.one_camera is not None and model.orientation != nominal.orientation:
        # To turn the picture and one half of it back is to turn the other half alone.
        turned, *rest = _composed(evidence, replace(fit.model, orientation=nominal.orientation))
        if evidence.explains(turned):
            model, others = turned, rest
    if recentered and model != fit.model:
        # A half that a wrong shear moves off the film is not missing.
        sheared = (
            replace(fit.model, recentering=one) for one in Recentering if one != nominal.recentering
        )
        model = next(filter(evidence.explains, sheared), model)
    if evidence.explains(model):
        also = (*fit.alternatives, *others, *_alike(evidence, model, by_depth=fit.by_color))
        return replace(fit, model=model, alternatives=also)
    # Step 2: its alternatives. Claims cannot tell them apart, but the reach may cut them
    # differently.
    best = next(filter(evidence.explains, fit.alternatives), None)
    others = [fit.model, *(one for one in fit.alternatives if one != best)]
    if best is None:
        # Step 3: the nominal numbers under the conventions that were found, because other faults
        # may have misled the fit; and gross mistakes, such as wrong units, which may show too
        # little to be fitted.
        tried, plain = [model], fit.model.with_parameters(nominal.parameters)
        if plain != fit.model:
            plain = _composed(evidence, plain)[0]
            tried.append(plain)
        if not evidence.explains(plain):
            if evidence.infeasible:
                # Where too little is seen to be fitted, orientation and order may be wrong as well.
                whole = replace(
                    plain, front=nominal.front, overlaid=nominal.overlaid, culled=nominal.culled
                )
                for size in (
                    replace(way, scene_scale=f) for way in (nominal, whole) for f in MISTAKEN_UNITS
                ):
                    tried += [size, *_alike(evidence, size)]
            if fit.by_color:
                # Registration makes pictures larger, as a near offset does at one depth only.
                tried.append(_composed(evidence, with_near(evidence, model))[0])
            if fit.by_color and nominal not in (model, plain):
                # Where one half alone is mirrored, registration may have turned the picture to suit
                # it.
                tried.append(_composed(evidence, nominal)[0])
            if fit.by_color and recentered:
                # Registration moves pictures and makes them larger; it shears none unlike another.
                ways, shears = (
                    dict.fromkeys((plain, nominal)),
                    set(Recentering) - {nominal.recentering},
                )
                tried += [replace(way, recentering=one) for way in ways for one in sorted(shears)]
        best = evidence.reduced(min(tried, key=evidence.wrong))
        others = list(_alike(evidence, best))
    # Bounds are known of numbers that were fitted with the same shear and cameras, and of nominal
    # ones.
    same = (best.recentering, best.one_camera) == (fit.model.recentering, fit.model.one_camera)
    values = best.parameters
    known = np.where(same & (values == fit.model.parameters), (fit.low, fit.high), np.nan)
    low, high = np.where(values == nominal.parameters, values, known)
    return replace(fit, model=best, low=low, high=high, alternatives=tuple(others))


def _composed(evidence: TestSet, model: RendererModel) -> list[RendererModel]:
    """Return a guess with the halves put together as images have them, and its equals by the images."""
    telling = [image for image in evidence.images if shows(image)]
    models = list(find_composition(evidence.reference, model, telling)) if telling else [model]
    best = evidence.reduced(models[0]) if models[0] != evidence.nominal else models[0]
    if best != models[0]:
        return [best]
    return [best, *filter(evidence.explains, models[1:])]


def _alike(
    evidence: TestSet, model: RendererModel, *, by_depth: bool = False
) -> tuple[RendererModel, ...]:
    """Return guesses with other faults that show the same images, or nearly the same (`by_depth`)."""
    nominal, scene = evidence.nominal, evidence.reference.scene
    screen, same, tried = scene.frustum.screen, [], []
    if screen is None:
        # An image depends on (P - a) / s alone. Moving the apertures to one side equals moving the
        # scene to the other side, and enlarging the scene equals shrinking the plate by the same
        # factor, except for what the reach cuts off.
        (x, y, z), factor, other = model.scene_offset, model.scene_scale, model.pitch[0]
        if (x, y) != nominal.scene_offset[:2] and model.aperture_offset == nominal.aperture_offset:
            same.append(replace(model, aperture_offset=(-x, -y), scene_offset=(0.0, 0.0, z)))
        if factor != nominal.scene_scale and model.pitch == nominal.pitch:
            same.append(replace(model, scene_scale=1.0, pitch=(other / factor, other / factor)))
        elif other != nominal.pitch[0] and abs(other / model.pitch[1] - 1) <= MAX_PITCH_DIFFERENCE:
            same.append(replace(model, scene_scale=factor / other, pitch=nominal.pitch))
    elif model.recentering is not nominal.recentering:
        # Where everything visible lies on one side of the plate, images do not say what became of
        # the other camera; in one aperture alone, a missing or reversed shear equals a screen at
        # another place.
        sheared = []
        if model.recentering is not Recentering.NONE:
            kept = (nominal.recentering, model.recentering, Recentering.NONE)
            sheared += [replace(model, recentering=one) for one in Recentering if one not in kept]
        apertures = {
            model.placed(model.answers(scene, image.camera.aperture)) for image in evidence.images
        }
        factor = model.recentering.factor(1)
        if len(apertures) == 1 and factor == model.recentering.factor(-1):
            (there,) = apertures
            x, y = (
                (factor - 1) * (m - a)
                for m, a in zip(screen.center, (there.x, there.y), strict=True)
            )
            sheared.append(replace(model, recentering=nominal.recentering, screen_center=(x, y)))
        most = evidence.wrong(model, explained=True)
        same += [one for one in sheared if evidence.wrong(one, explained=True) <= most]
    plain = model.with_parameters(nominal.parameters)
    # At one depth, a near offset n looks like a field of view 1 + n / |z| times as large, and a
    # moved scene or plate like a shift of the sampling points: both are tried at some depths of the
    # scene.
    if by_depth and plain != model:
        _, half = film_window(scene.frustum, scene.plate.middle)
        shift, factor = np.asarray(model.shift), float(np.mean(model.fov))
        if screen is not None:
            shift = shift + np.asarray(model.screen_center) / screen_lengths(scene)
        tilt = 2 * shift / scene.frustum.resolution * half * (1, -1)
        for z in np.quantile(scene.vertices[:, 2], TRIED_VERTEX_FRACTIONS):
            if factor != 1.0:
                near = float(np.clip((factor - 1) * abs(z), 0.0, 0.5 * scene.frustum.longest_reach))
                tried.append(replace(model, fov=nominal.fov, near=near))
            if tilt.any():
                x, y = (tilt * z).tolist()
                tried.append(replace(plain, fov=model.fov, scene_offset=(x, y, 0.0)))
                tried.append(replace(plain, fov=model.fov, aperture_offset=(-x, -y)))
    return (*same, *_sheared_instead(evidence, model), *filter(evidence.explains, tried))


def _sheared_instead(evidence: TestSet, model: RendererModel) -> list[RendererModel]:
    """Return guesses with a wrong shear that show the images as well as a moved screen: of one aperture."""
    nominal, scene = evidence.nominal, evidence.reference.scene
    if model.screen_center == nominal.screen_center:
        return []
    plain = replace(model, screen_center=nominal.screen_center)
    tried = (
        replace(plain, recentering=one) for one in (Recentering.NONE, Recentering.BOTH_REVERSED)
    )
    apertures = {model.answers(scene, image.camera.aperture) for image in evidence.images}
    most = evidence.wrong(model, explained=True)
    return [
        one for one in tried if len(apertures) == 1 and evidence.wrong(one, explained=True) <= most
    ]


def _with_view_shear(evidence: TestSet) -> Diagnosis | None:
    """Return a diagnosis that names the shear of views where it explains what is wrong.

    An eye at height d sees the plate through a sheared frustum. A renderer that shears its views by
    a factor f of what the plate needs registers them at height d (1 - 1/f): there, and not in the
    plate, the lines of one hogel meet. Seen from that plane the picture is that of a plate 1/f
    times as wide, under a screen 1/f times as high. So one number explains what the fit of geometry
    would need three groups for.
    """
    scene, nominal = evidence.reference.scene, evidence.nominal
    screen, (claims, claiming) = scene.frustum.screen, _claims(evidence)
    if screen is None or claims is None or claims.of_points or not evidence.wrong(nominal):
        return None
    height, (viewer, back) = screen.height, scene.frustum.reach

    def sheared(factor: float) -> RendererModel:
        pitch, offset = (
            (nominal.pitch[0] / factor, nominal.pitch[1] / factor),
            height * (1 / factor - 1),
        )
        # The renderer's views end where those of the scene do, not about the plane of registration.
        reach = max(viewer + offset, 0.0), max(back - offset, 0.0)
        moved = replace(nominal, scene_offset=(0.0, 0.0, offset), reach=reach)
        return replace(moved, pitch=pitch, screen_height=1 / factor)

    def misfit(factor: float) -> float:
        return float(outside_px(claims, sheared(factor), VIEW_SHEAR_CAP_PX).mean())

    coarse = min(TRIED_VIEW_SHEARS.tolist(), key=misfit)
    factor = min((coarse * (1 + FINER_STEPS)).tolist(), key=misfit)
    share = evidence.share(sheared(factor))
    if share is None or share < MIN_EXPLAINED_FRACTION:
        return None
    words = (
        f"views have {factor:.3g} of the shear that the plate needs: they are registered at height "
        f"{height * (1 - 1 / factor):.4g} {scene.units}"
    )
    fault = Defect(fault=VIEW_SHEAR, value=factor, unit="ratio", words=words, explains=share)
    means = f"{len(claims):,} claims of {_counted(claiming, 'hogel')}"
    return Diagnosis(model=sheared(factor), faults=(fault,), means=means)


def _counted(count: int, name: str) -> str:
    return f"{count} {name}{'' if count == 1 else 's'}"
