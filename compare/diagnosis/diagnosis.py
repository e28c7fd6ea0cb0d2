"""Diagnosis of a renderer: reading of its pixels, candidate models, and their test.

`diagnose` decodes the images, compares them with the nominal model and, if pixels are wrong,
enumerates, fits and tests candidate models. A candidate becomes the diagnosis only if it explains
the wrong pixels of the test set. `with_correction_tested` requires the same of all judged hogels.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import chain

import numpy as np

from xfrustum.compare.diagnosis.defects import (
    MISTAKEN_UNITS,
    SHADINGS,
    VIEW_SHEAR,
    Defect,
    defects_of,
    hypotheses_in,
)
from xfrustum.compare.diagnosis.encodings import FoundEncoding, find_encoding, find_transfer
from xfrustum.compare.diagnosis.enumeration import (
    compositions,
    equivalents,
    with_axes,
    with_other_hogels,
    without_objects,
)
from xfrustum.compare.diagnosis.geometry_fit import LENSES, GeometryFit, fit_geometry
from xfrustum.compare.diagnosis.registration import register, with_near
from xfrustum.compare.diagnosis.testset import (
    MIN_EXPLAINED_FRACTION,
    PixelClaims,
    TestSet,
    claims_of,
    outside_px,
)
from xfrustum.compare.judging.judged import Compared, Judging
from xfrustum.compare.judging.verdict import Hogel
from xfrustum.compare.renderer_model.conventions import CONVENTIONS
from xfrustum.compare.renderer_model.drawn_model import OTHER_FIELDS, Recentering, RendererModel
from xfrustum.scenes.model.images import NOTHING, HogelImage

# Smallest number of claims for a fit of geometry: several for each parameter, and for the
# orientation and the order.
MIN_FITTED_CLAIMS = 100

# Largest number of camera defects that is accepted without trying other axes: a renderer may have
# both a wrong orientation and a wrong order of hogels.
MAX_CAMERA_DEFECTS = 2

# Factors of the shear of views for a coarse search, then relative changes of the best factor for a
# fine search. Neighboring factors differ by one percent, which moves a picture of a hundred pixels
# by less than a pixel. The last constant caps the failure of a claim, in pixels, because claims
# under wrong factors fail by any distance.
TRIED_VIEW_SHEARS, FINER_STEPS = np.geomspace(0.4, 2.5, 185), np.linspace(-0.015, 0.015, 61)
VIEW_SHEAR_CAP_PX = 4.0

# Parameters that look like a wrong shear in a single aperture if they deviate along both axes.
MOVED_BY_SHEARS = ("screen-center", "back-shift", "front-shift")


class Basis(StrEnum):
    """Method of a diagnosis."""

    NOTHING = "nothing"  # no hogel shows enough of the scene for a diagnosis
    RIGHT = "right"  # no pixel of the tested hogels is wrong
    CLAIMS = "claims"  # a fit to the triangles or points that pixels claim
    COLORS = "colors"  # registration of pictures by their colors
    OBJECTS = "object numbers"  # registration of pictures that name objects


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Basis of a diagnosis: method, numbers of hogels and claims, and whether the claims hold."""

    basis: Basis = Basis.NOTHING
    hogels: int = 0  #: number of hogels that were used
    claims: int = 0  #: number of claims that were fitted
    spoiled: int = 0  #: number of hogels that were left out because they differ from the rest
    holds: bool = True  #: whether the claims hold under the fit


@dataclass(frozen=True, kw_only=True)
class Refutation:
    """Judged hogels that fail after correction for a diagnosis."""

    before: int  #: wrong pixels of all judged hogels
    after: int  #: wrong pixels after correction
    judged: int  #: number of judged hogels
    failed: tuple[tuple[int, int], ...]  #: column and row of the hogels that fail


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """Model of a renderer, and its defects."""

    model: RendererModel  #: candidate that explains the images, else the nominal model
    faults: tuple[Defect, ...] = ()  #: differences from the nominal model
    #: defects of the best candidate, if it explains too little
    does_not_explain: tuple[Defect, ...] = ()
    evidence: Evidence = Evidence()
    #: judged hogels that contradict the defects; the defects are then in `does_not_explain`
    refutation: Refutation | None = None

    @property
    def guesses(self) -> tuple[Defect, ...]:
        """Defects of `does_not_explain` whose share, rounded to whole percent, exceeds 0 %."""
        return tuple(
            defect for defect in self.does_not_explain if round(100 * (defect.explains or 0.0)) > 0
        )


@dataclass(frozen=True, kw_only=True)
class Findings:
    """Detected encoding of a renderer's images, diagnosis with this encoding, rules of judgment.

    The defects of the diagnosis include the defects of the encoding.
    """

    encoding: FoundEncoding
    diagnosis: Diagnosis
    judging: Judging


def diagnose(test: TestSet, *, of_views: bool = False) -> Findings:
    """Determine the reading of a renderer's images and the model of the renderer.

    The reading is the interpretation of stored pixels: encoding, channels, transfer. A reading and
    the diagnosis of the images decoded with it are tested together: they must explain
    `MIN_EXPLAINED_FRACTION` of the pixels that are wrong under the author's statements. Hogels
    assembled from views (`of_views`) may have another shear.
    """
    reference, nominal, judging = test.reference, test.nominal, test.judging
    if of_views and (sheared := _with_view_shear(test)) is not None:
        return Findings(encoding=FoundEncoding(), diagnosis=sheared, judging=judging)
    # Step 1: use the stated reading if no other reading fits better.
    stated: Diagnosis | None = None
    encoding = find_encoding(reference, test.images, nominal)
    if not encoding.faults:
        stated = diagnosis_of(test)
        # Another transfer curve is tried only if nothing else explains the colors.
        by_color = judging.compared is Compared.COLOR
        if not stated.faults and by_color and test.wrong(nominal):
            encoding = find_transfer(reference, test.images)
        if not encoding.faults:
            return Findings(encoding=encoding, diagnosis=stated, judging=judging)
    # Step 2: use the other reading, and diagnose the images decoded with it. If the author stated
    # numbers and the files hold colors, shading was not specified, so that only geometry counts.
    if encoding.as_colors:
        judging = replace(judging, compared=Compared.GEOMETRY)
    if encoding.reading is not None:
        judging = replace(judging, transfer=encoding.reading.transfer)
    decoded = test.of([encoding.read(reference, image) for image in test.images], judging)
    diagnosis = diagnosis_of(decoded)
    wrong, left = test.wrong(nominal), decoded.wrong(diagnosis.model, explained=True)
    share = max(0.0, 1.0 - left / wrong) if wrong else 0.0
    faults = _explaining((*encoding.faults, *diagnosis.faults), share)
    if share >= MIN_EXPLAINED_FRACTION:
        diagnosis = replace(diagnosis, faults=faults)
        return Findings(encoding=encoding, diagnosis=diagnosis, judging=judging)
    # Step 3: if the other reading explains too little, it becomes a guess.
    diagnosis = stated or diagnosis_of(test)
    diagnosis = replace(diagnosis, does_not_explain=(*faults, *diagnosis.does_not_explain))
    return Findings(encoding=FoundEncoding(), diagnosis=diagnosis, judging=test.judging)


def diagnosis_of(test: TestSet) -> Diagnosis:
    """Diagnose a renderer whose pixels have the stated encoding."""
    nominal = test.nominal
    if test.images and not any(test.of([image]).wrong(nominal) for image in test.images):
        # No pixel is wrong: a slightly better candidate would fit noise.
        evidence = Evidence(basis=Basis.RIGHT, hogels=len(test.tested))
        return _with_shading(test, Diagnosis(model=nominal, evidence=evidence))
    return _with_shading(test, _with_lens(test, _of_wrong(test)))


def declared(
    nominal: RendererModel, diagnosis: RendererModel, accepted: Sequence[str]
) -> RendererModel:
    """Return the nominal model with the accepted conventions of the diagnosed model."""
    assert set(accepted) <= set(CONVENTIONS)
    also = ("pivot", "fit") if "near" in accepted else ()
    return replace(nominal, **{name: getattr(diagnosis, name) for name in (*accepted, *also)})


def with_correction_tested(diagnosis: Diagnosis, hogels: Iterable[Hogel]) -> Diagnosis:
    """Return a diagnosis that keeps its defects only if all hogels pass after correction for them.

    A diagnosis is based on the wrong pixels of some hogels. The verdict applies the limits to all
    hogels, before and after correction. If a hogel still fails, the defects become guesses. The
    share of a guess is the explained part of the wrong pixels in all judged hogels.
    """
    judged = [hogel for hogel in hogels if hogel.as_found and hogel.corrected]
    failed = tuple(hogel.aperture.index for hogel in judged if not hogel.mended)
    if not diagnosis.faults or not failed:
        return diagnosis
    before = after = left = 0
    for hogel in judged:
        assert hogel.as_found is not None and hogel.corrected is not None
        before += hogel.as_found.all_wrong
        after += hogel.corrected.all_wrong
        # If no pixel can be judged after correction, the correction explains no pixel.
        left += hogel.as_found.all_wrong if hogel.corrected.blind else hogel.left
    share = max(0.0, 1.0 - left / before) if before else 0.0
    refuted = (replace(defect, explains=share, refuted=True) for defect in diagnosis.faults)
    return replace(
        diagnosis,
        faults=(),
        does_not_explain=(*refuted, *diagnosis.does_not_explain),
        refutation=Refutation(before=before, after=after, judged=len(judged), failed=failed),
    )


def _explaining(defects: Iterable[Defect], share: float | None) -> tuple[Defect, ...]:
    return tuple(replace(defect, explains=share) for defect in defects)


def _of_wrong(test: TestSet) -> Diagnosis:
    """Diagnose a renderer with wrong pixels."""
    # Step 1: fit conventions and geometry, and leave out hogels that contradict the fit (spoiled).
    nominal, whole = test.nominal, test
    fit, evidence = _fitted(test)
    kept = [image for image in test.images if image.camera.aperture.index not in fit.spoiled]
    test = test.of(kept)
    # Step 2: select the candidate that explains most, and test that it explains enough wrong pixels
    # and makes few right pixels wrong.
    best = _best(test, fit)
    faults, share = _named(test, best), test.share(best.model)
    explains = share is None or (share >= MIN_EXPLAINED_FRACTION and test.spares(best.model))
    diagnosis = Diagnosis(model=nominal, evidence=evidence)
    if not (explains and (faults or share is None)):
        # No candidate explains enough: report the best fit as a guess, even if fewer defects
        # suffice.
        diagnosis = replace(diagnosis, does_not_explain=faults or _named(test, fit))
    elif share is not None and test.pays(best.model):
        diagnosis = replace(diagnosis, model=best.model, faults=faults)
    # Otherwise the wrong pixels have causes that are not defects (rounding), and need no other
    # model.
    # Step 3: try other axes, single hogels and missing objects if wrong pixels remain. Try other
    # axes also if there are several camera defects, because both may produce the same pictures.
    starts = [best] if diagnosis.faults else [GeometryFit.exact(nominal), best]
    if whole.leaves_outliers(diagnosis.model):
        hogels, objects = with_other_hogels(whole, starts), without_objects(whole, starts)
        # Exchanged axes, one mistake that explains everything, are tried before missing objects.
        candidates = chain(hogels, with_axes(whole, starts[0]), objects)
        return _with_other_defects(whole, candidates, diagnosis)
    if len(diagnosis.faults) > MAX_CAMERA_DEFECTS:
        return _with_other_defects(whole, with_axes(whole, starts[0]), diagnosis)
    return diagnosis


def _fitted(test: TestSet) -> tuple[GeometryFit, Evidence]:
    """Return a fit and its evidence: a fit to claims, or the registration of pictures."""
    claims, claiming = _claims(test)
    if claims is not None:
        fit = fit_geometry(claims, test.nominal)
        spoiled, basis = len(fit.spoiled), Basis.CLAIMS
        return fit, Evidence(
            basis=basis, hogels=claiming, claims=len(claims), spoiled=spoiled, holds=fit.holds
        )
    pictures = [
        image for image in test.images if image.color is not None or (image.object != NOTHING).any()
    ]
    if not pictures:
        return GeometryFit.exact(test.nominal), Evidence()
    colored = any(image.color is not None for image in pictures)
    basis = Basis.COLORS if colored else Basis.OBJECTS
    fit = register(test.reference, pictures, test.nominal)
    return fit, Evidence(basis=basis, hogels=len(pictures))


def _with_other_defects(
    test: TestSet, candidates: Iterable[GeometryFit], diagnosis: Diagnosis
) -> Diagnosis:
    """Return a diagnosis with defects of scene or hogels, if these explain more or are fewer."""
    for fit in candidates:
        others = {name: getattr(fit.model, name) for name in OTHER_FIELDS}
        model, named = replace(test.reduced(fit.model), **others), dict(fit.model.shows)
        # A defect that names hogels must also explain these hogels by themselves.
        odd = [image for image in test.images if image.camera.aperture.index in named]
        of_named = test.of(odd) if odd else test
        if not (test.explains(model) and test.spares(model) and of_named.explains(model)):
            continue
        # The intervals of a failed fit are too wide, and would hide deviations that improve the
        # explanation.
        known = fit if fit.holds else fit.unbounded(test.nominal)
        faults = _named(of_named, replace(known, model=model, alternatives=()))
        fewer = len(faults) < len(diagnosis.faults) and not of_named.pays(diagnosis.model, model)
        if fewer or of_named.pays(model, diagnosis.model):
            diagnosis = replace(diagnosis, model=model, faults=faults, does_not_explain=())
            if not test.leaves_outliers(model):
                break
    return diagnosis


def _with_lens(test: TestSet, diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis with pixels at equal angles if only equal angles explain the pictures.

    Images that name triangles are left out: `fit_geometry` has tried equal angles on them.
    """
    nominal, named = test.nominal, any((i.triangle != NOTHING).any() for i in test.images)
    if diagnosis.faults or named or not test.images or not test.wrong(nominal):
        return diagnosis
    # A few hogels select the lens, and all hogels test it.
    few = test.few()
    model = min((replace(nominal, film=film) for film in LENSES), key=few.wrong)
    if not (test.explains(model) and test.spares(model) and test.pays(model)):
        return diagnosis
    faults = _named(test, GeometryFit.exact(model))
    return replace(diagnosis, model=model, faults=faults, does_not_explain=())


def _with_shading(test: TestSet, diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis that includes defects of shading, for images with colors.

    Surface numbers do not depend on light, so that colors are tested separately.
    """
    pictures = [image for image in test.images if image.color is not None]
    if not pictures or not diagnosis.model.plain or {*SHADINGS} & {*hypotheses_in(diagnosis.model)}:
        return diagnosis
    nothing = np.full_like(pictures[0].triangle, NOTHING)
    nowhere = np.full_like(pictures[0].position, np.nan)
    colors = test.of(
        [replace(image, triangle=nothing, object=nothing, position=nowhere) for image in pictures]
    )
    for hypothesis in SHADINGS:
        lit = hypothesis.of(diagnosis.model)
        share = colors.share(lit) or 0.0
        if share >= MIN_EXPLAINED_FRACTION and colors.pays(lit, diagnosis.model):
            defect = Defect(fault=hypothesis.fault, value=hypothesis.value, explains=share)
            return replace(diagnosis, model=lit, faults=(*diagnosis.faults, defect))
    return diagnosis


def _claims(test: TestSet) -> tuple[PixelClaims | None, int]:
    """Return claims of images (None if too few for a fit), and the number of claiming images."""

    def claiming(image: HogelImage) -> bool:
        named = (image.triangle != NOTHING).any()
        return bool(named or np.isfinite(image.position[..., :2]).any())

    images = [*filter(claiming, test.images)]
    claims = claims_of(test.reference.scene, images) if images else None
    return claims if claims is not None and len(claims) >= MIN_FITTED_CLAIMS else None, len(images)


def _named(test: TestSet, fit: GeometryFit) -> tuple[Defect, ...]:
    """Return the defects of a candidate, with the share of wrong pixels that they explain."""
    defects = defects_of(test.reference.scene, test.nominal, fit)
    return _explaining(defects, test.share(fit.model) if defects else None)


def _best(test: TestSet, fit: GeometryFit) -> GeometryFit:
    """Return the candidate that explains the most wrong pixels, without superfluous defects."""
    # Step 1: the fitted candidate, with the composition of halves that fits the images.
    nominal, recentered = test.nominal, test.reference.scene.frustum.recentered
    model, *others = compositions(test, fit.model)
    if model.one_camera is not None and model.orientation != nominal.orientation:
        # Turning the picture and turning one half back is equivalent to turning only the other
        # half.
        turned, *rest = compositions(test, replace(fit.model, orientation=nominal.orientation))
        if test.explains(turned):
            model, others = turned, rest
    shears = [shear for shear in Recentering if recentered and shear != nominal.recentering]
    if model != fit.model:
        # A half that seems to be missing may have been moved off the film by a wrong shear.
        sheared = (replace(fit.model, recentering=shear) for shear in shears)
        model = next(filter(test.explains, sheared), model)
    if test.explains(model):
        others = [*fit.alternatives, *others, *equivalents(test, model, by_depth=fit.by_color)]
        # Prefer a wrong shear, which is one mistake, to a screen or film moved along both axes.
        faults = {defect.fault for defect in _named(test, replace(fit, model=model))}
        moved = any({f"{name}-x", f"{name}-y"} <= faults for name in MOVED_BY_SHEARS)
        best = next((other for other in others if moved and other.recentering in shears), None)
        if best is None:
            return replace(fit, model=model, alternatives=tuple(others))
        others = [model, *(other for other in others if other != best)]
    else:
        # Step 2: alternatives of the fit. The same claims hold under them, but the reach may cut
        # surfaces differently.
        best = next(filter(test.explains, fit.alternatives), None)
        others = [fit.model, *(other for other in fit.alternatives if other != best)]
    if best is None:
        # Step 3: try nominal parameters and gross mistakes, because other defects may have
        # distorted the fit.
        best = test.reduced(min(_unfitted(test, fit, model, shears), key=test.wrong))
        others = equivalents(test, best)
    # Only parameters that are nominal, or fitted with the same shear and cameras, have intervals.
    same = (best.recentering, best.one_camera) == (fit.model.recentering, fit.model.one_camera)
    values = best.parameters
    known = np.where(same & (values == fit.model.parameters), (fit.low, fit.high), np.nan)
    low, high = np.where(values == nominal.parameters, values, known)
    return replace(fit, model=best, low=low, high=high, alternatives=tuple(others))


def _unfitted(
    test: TestSet, fit: GeometryFit, model: RendererModel, shears: Sequence[Recentering]
) -> list[RendererModel]:
    """Return candidates with fitted conventions and nominal parameters or gross mistakes."""
    nominal, tried = test.nominal, [model]
    plain = fit.model.with_parameters(nominal.parameters)
    if plain != fit.model:
        plain = compositions(test, plain)[0]
        tried.append(plain)
    if test.explains(plain):
        return tried
    if test.infeasible:
        # Most pixels are wrong, so that the fitted orientation and order may be wrong as well.
        halves = {name: getattr(nominal, name) for name in ("front", "overlaid", "culled")}
        for way in (nominal, replace(plain, **halves)):
            for size in (replace(way, scene_scale=factor) for factor in MISTAKEN_UNITS):
                tried += [size, *equivalents(test, size)]
    if fit.by_color:
        # Registration scales the whole picture by one factor. The factor of a near offset depends
        # on depth.
        tried.append(compositions(test, with_near(test, model))[0])
        if nominal not in (model, plain):
            # If only one half is mirrored, registration may have turned the picture to fit this
            # half.
            tried.append(compositions(test, nominal)[0])
        # Registration shifts and scales all pictures equally, so that it misses a wrong shear.
        ways = dict.fromkeys((plain, nominal))
        tried += [replace(way, recentering=shear) for way in ways for shear in sorted(shears)]
    return tried


def _with_view_shear(test: TestSet) -> Diagnosis | None:
    """Return a diagnosis with a wrong shear of views, if this explains the wrong pixels.

    An eye at height d sees the plate through a sheared frustum. If a renderer multiplies the
    correct shear of its views by f, the lines of one hogel meet at height d (1 - 1/f) and not in
    the plate. Relative to this height, the renderer has a plate 1/f times as wide and a screen 1/f
    times as high. The single number f replaces three groups of the fit.
    """
    scene, nominal = test.reference.scene, test.nominal
    screen, (claims, claiming) = scene.frustum.screen, _claims(test)
    if screen is None or claims is None or claims.of_points or not test.wrong(nominal):
        return None
    height, (viewer, back) = screen.height, scene.frustum.reach

    def sheared(factor: float) -> RendererModel:
        offset = height * (1 / factor - 1)
        return replace(
            nominal,
            scene_offset=(0.0, 0.0, offset),
            # The reach of the views is relative to the plate, not to the plane where lines meet.
            reach=(max(viewer + offset, 0.0), max(back - offset, 0.0)),
            pitch=(nominal.pitch[0] / factor, nominal.pitch[1] / factor),
            screen_height=1 / factor,
        )

    def misfit(factor: float) -> float:
        return float(outside_px(claims, sheared(factor), VIEW_SHEAR_CAP_PX).mean())

    coarse = min(TRIED_VIEW_SHEARS.tolist(), key=misfit)
    factor = min((coarse * (1 + FINER_STEPS)).tolist(), key=misfit)
    share = test.share(sheared(factor))
    if share is None or share < MIN_EXPLAINED_FRACTION:
        return None
    defect = Defect(fault=VIEW_SHEAR, value=factor, unit="ratio", explains=share)
    evidence = Evidence(basis=Basis.CLAIMS, hogels=claiming, claims=len(claims))
    return Diagnosis(model=sheared(factor), faults=(defect,), evidence=evidence)
