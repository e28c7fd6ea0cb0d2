"""Diagnosis of a renderer: reading of its pixels, candidate models, and their test.

`diagnose` goes one way: decode the images, compare with the nominal model, and where pixels are
wrong enumerate, fit and test candidates. A candidate that does not explain the wrong pixels of the
test set is no diagnosis; `with_correction_tested` demands the same of all judged hogels.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
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
    with_joint_numbers,
)
from xfrustum.compare.diagnosis.encodings import FoundEncoding, find_encoding, find_transfer
from xfrustum.compare.diagnosis.enumeration import (
    Candidate,
    compositions,
    films,
    with_axes,
    with_other_hogels,
    without_objects,
)
from xfrustum.compare.diagnosis.geometry_fit import (
    GeometryFit,
    PixelClaims,
    claims_of,
    fit_geometry,
    outside_px,
)
from xfrustum.compare.diagnosis.registration import register, with_near
from xfrustum.compare.diagnosis.testset import MIN_EXPLAINED_FRACTION, TestSet, shows
from xfrustum.compare.judging.judged import Compared, Judging
from xfrustum.compare.judging.verdict import Hogel
from xfrustum.compare.renderer_model.conventions import CONVENTIONS
from xfrustum.compare.renderer_model.drawn_model import (
    OTHER_FIELDS,
    Film,
    Recentering,
    RendererModel,
    screen_lengths,
)
from xfrustum.reference.lines.lines import film_window
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage

# Smallest number of claims that geometry is fitted to: several for each of the numbers to be fitted
# and the two symmetries.
MIN_FITTED_CLAIMS = 100

# Shares of the scene's vertices below the heights at which twins of pictures are tried.
TRIED_VERTEX_FRACTIONS = (0.1, 0.3, 0.5, 0.7, 0.9)

# Largest relative difference between the pitches of columns and rows at which they count as equal:
# each may be off by `drawn_model.SMALLEST_FACTOR`, half of this, without having a name.
MAX_PITCH_DIFFERENCE = 1e-3

# Largest number of camera defects beside which other axes are not tried: pictures and hogels in
# another order, which two mistakes of a renderer make as well.
MAX_CAMERA_DEFECTS = 2

# Factors of the shear of views that are tried, and relative changes of the best one that are tried
# next. Neighbors differ by one percent, by which a picture moves less than by a pixel where views
# have a hundred pixels. And the largest failure of a claim that counts, in pixels: claims under
# wrong factors fail by any distance.
TRIED_VIEW_SHEARS, FINER_STEPS = np.geomspace(0.4, 2.5, 185), np.linspace(-0.015, 0.015, 61)
VIEW_SHEAR_CAP_PX = 4.0


class Basis(StrEnum):
    """Means by which a diagnosis was made."""

    NOTHING = "nothing"  # no hogel shows enough of the scene
    RIGHT = "right"  # no pixel of the tested hogels is wrong
    CLAIMS = "claims"  # a fit to the triangles or points that pixels claim
    COLORS = "colors"  # registration of pictures by their colors
    OBJECTS = "object numbers"  # registration of pictures that name objects


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Extent of the images that a diagnosis rests on."""

    basis: Basis = Basis.NOTHING
    hogels: int = 0  #: number of hogels that were used
    claims: int = 0  #: number of claims that were fitted
    spoiled: int = 0  #: number of hogels that were left out, unlike the others
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
    does_not_explain: tuple[
        Defect, ...
    ] = ()  #: defects of the best candidate that explains too little
    evidence: Evidence = Evidence()
    refutation: Refutation | None = None  #: why the defects are no diagnosis, of all judged hogels

    @property
    def guesses(self) -> tuple[Defect, ...]:
        """The defects of `does_not_explain` that explain more than 0 %, as printed."""
        return tuple(
            defect for defect in self.does_not_explain if round(100 * (defect.explains or 0.0)) > 0
        )


@dataclass(frozen=True, kw_only=True)
class Findings:
    """Reading of a renderer's images, their diagnosis in it, and the rules by which to judge.

    The defects of the diagnosis include the reading's.
    """

    encoding: FoundEncoding
    diagnosis: Diagnosis
    judging: Judging


def diagnose(test: TestSet, *, of_views: bool = False) -> Findings:
    """Find the reading of a renderer's images and the model by which it draws.

    A reading is tested together with the diagnosis of the images in it: together they must explain
    `MIN_EXPLAINED_FRACTION` of the pixels that are wrong as stated. Hogels that were put together
    from views (`of_views`) may have another shear.
    """
    reference, nominal, judging = test.reference, test.nominal, test.judging
    if of_views and (sheared := _with_view_shear(test)) is not None:
        return Findings(encoding=FoundEncoding(), diagnosis=sheared, judging=judging)
    # Step 1: the stated reading, where no other one is found.
    stated: Diagnosis | None = None
    encoding = find_encoding(reference, test.images, nominal)
    if not encoding.faults:
        stated = diagnosis_of(test)
        # Only where nothing else explains colors are they read through another curve.
        by_color = judging.compared is Compared.COLOR
        if not stated.faults and by_color and test.wrong(nominal):
            encoding = find_transfer(reference, test.images)
        if not encoding.faults:
            return Findings(encoding=encoding, diagnosis=stated, judging=judging)
    # Step 2: the other reading with the diagnosis of the images in it. Where numbers were stated
    # and
    # colors are stored, shading was not stated: only geometry counts.
    if encoding.as_colors:
        judging = replace(judging, compared=Compared.GEOMETRY)
    if encoding.reading is not None:
        judging = replace(judging, transfer=encoding.reading.transfer)
    decoded = test.of([encoding.read(reference, image) for image in test.images], judging)
    diagnosis = diagnosis_of(decoded)
    wrong, left = test.wrong(nominal), decoded.wrong(diagnosis.model, explained=True)
    share = max(0.0, 1.0 - left / wrong) if wrong else 0.0
    faults = tuple(
        replace(defect, explains=share) for defect in (*encoding.faults, *diagnosis.faults)
    )
    if share >= MIN_EXPLAINED_FRACTION:
        diagnosis = replace(diagnosis, faults=faults)
        return Findings(encoding=encoding, diagnosis=diagnosis, judging=judging)
    # Step 3: it explains too little, and becomes a guess.
    diagnosis = stated or diagnosis_of(test)
    diagnosis = replace(diagnosis, does_not_explain=(*faults, *diagnosis.does_not_explain))
    return Findings(encoding=FoundEncoding(), diagnosis=diagnosis, judging=test.judging)


def diagnosis_of(test: TestSet) -> Diagnosis:
    """Find the model of a renderer whose pixels are read as stated."""
    nominal = test.nominal
    if not test.images or any(test.of([image]).wrong(nominal) for image in test.images):
        diagnosis = _of_wrong(test)
    else:
        # Nothing needs an explanation: a candidate that fits a little better fits noise.
        evidence = Evidence(basis=Basis.RIGHT, hogels=len(test.tested))
        diagnosis = Diagnosis(model=nominal, evidence=evidence)
    return _with_shading(test, _with_film(test, diagnosis))


def declared(
    nominal: RendererModel, diagnosis: RendererModel, accepted: Sequence[str]
) -> RendererModel:
    """Return the nominal model with the accepted conventions of the diagnosed one."""
    assert set(accepted) <= set(CONVENTIONS)
    also = ("pivot", "fit") if "near" in accepted else ()
    return replace(nominal, **{name: getattr(diagnosis, name) for name in (*accepted, *also)})


def with_correction_tested(diagnosis: Diagnosis, hogels: Iterable[Hogel]) -> Diagnosis:
    """Return a diagnosis whose defects are named only if all hogels pass when corrected for them.

    A diagnosis is made of some hogels by pixels that differ; the verdict judges all of them by
    their limits, before and after correction. Defects that leave any hogel wrong become guesses,
    which state the share of the wrong pixels of all judged hogels that they explain.
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
        # A correction after which nothing could be wrong explains nothing.
        left += hogel.as_found.all_wrong if hogel.corrected.blind else hogel.left
    share = max(0.0, 1.0 - left / before) if before else 0.0
    refuted = (replace(defect, explains=share, refuted=True) for defect in diagnosis.faults)
    return replace(
        diagnosis,
        faults=(),
        does_not_explain=(*refuted, *diagnosis.does_not_explain),
        refutation=Refutation(before=before, after=after, judged=len(judged), failed=failed),
    )


def _of_wrong(test: TestSet) -> Diagnosis:
    """Find the model of a renderer some of whose images are wrong."""
    # Step 1: fit conventions and geometry, and leave out the hogels that the fit calls spoiled.
    nominal = test.nominal
    fit = GeometryFit(model=nominal, low=nominal.parameters, high=nominal.parameters)
    claims, claiming = _claims(test)
    pictures = [
        image for image in test.images if image.color is not None or (image.object != NOTHING).any()
    ]
    evidence = Evidence()
    if claims is not None:
        fit = fit_geometry(claims, nominal)
        counts = {"hogels": claiming, "claims": len(claims), "spoiled": len(fit.spoiled)}
        evidence = Evidence(basis=Basis.CLAIMS, holds=fit.holds, **counts)
    elif pictures:
        fit = register(test.reference, pictures, nominal)
        basis = Basis.OBJECTS if fit.by_objects else Basis.COLORS
        evidence = Evidence(basis=basis, hogels=len(pictures))
    kept = [image for image in test.images if image.camera.aperture.index not in fit.spoiled]
    whole, test = test, test.of(kept)
    # Step 2: the candidate that explains most, and the test whether it explains enough and spoils
    # nothing.
    best = _best(test, fit)
    faults, share = _named(test, best), test.share(best.model)
    explains = share is None or (share >= MIN_EXPLAINED_FRACTION and test.spares(best.model))
    diagnosis = Diagnosis(model=nominal, evidence=evidence)
    if not (explains and (faults or share is None)):
        # No candidate explains enough: the best fit is reported as doubtful, though fewer defects
        # may do.
        diagnosis = replace(diagnosis, does_not_explain=faults or _named(test, fit))
    elif share is not None and test.pays(best.model):
        diagnosis = replace(diagnosis, model=best.model, faults=faults)
    # else the wrong pixels have causes that are no defect, and need no other model
    # Step 3: scene and single hogels, where something is left to explain, or where other axes alone
    # may make the pictures that several mistakes of cameras make together.
    left = whole.leaves_outliers(diagnosis.model)
    if not left and len(diagnosis.faults) <= MAX_CAMERA_DEFECTS:
        return diagnosis
    plain, values = fit.model.with_parameters(nominal.parameters), nominal.parameters
    bare = [
        replace(fit, model=model, low=values, high=values, alternatives=())
        for model in (plain, nominal)
    ]
    fits = [best] if diagnosis.faults else [best, fit, *bare]
    distinct = list({fit.model: fit for fit in reversed(fits)}.values())[::-1]
    if not left:
        return _with_other_defects(whole, with_axes(whole, distinct[-1]), diagnosis)
    candidates = chain(
        with_other_hogels(whole, claims, distinct),
        # One mistake that turns everything comes before objects that are left out.
        with_axes(whole, distinct[-1]),
        without_objects(whole, distinct),
    )
    return _with_other_defects(whole, candidates, diagnosis)


def _with_other_defects(
    test: TestSet, candidates: Iterator[Candidate], diagnosis: Diagnosis
) -> Diagnosis:
    """Return a diagnosis with scene or hogel defects that explain more, or need fewer."""
    for fit, more in candidates:
        named = {index for index, _ in fit.model.shows}
        odd = [image for image in test.images if image.camera.aperture.index in named]
        # Hogels that are named by themselves must be explained by themselves too.
        of_named, model = test.of(odd) if odd else test, test.reduced(fit.model)
        model = replace(model, **{name: getattr(fit.model, name) for name in OTHER_FIELDS})
        if not (test.explains(model) and of_named.explains(model)):
            continue
        known, share = replace(fit, model=model, alternatives=()), of_named.share(model)
        if not known.holds:
            # Intervals of a fit that something misled are too wide, and would leave out numbers
            # that pay.
            known = known.unbounded(test.nominal)
        faults = (*_named(test, known), *(replace(defect, explains=share) for defect in more))
        better = of_named.pays(model, diagnosis.model)
        simpler = len(faults) < len(diagnosis.faults) and not of_named.pays(diagnosis.model, model)
        if test.spares(model) and (better or simpler):
            diagnosis = replace(diagnosis, model=model, faults=faults, does_not_explain=())
            # Several missing objects may be one mistake of the cameras, which is tried later.
            if len(more) <= 1 and not test.leaves_outliers(diagnosis.model):
                break
    return diagnosis


def _with_film(test: TestSet, diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis that names the film, where that explains what nothing else does.

    Pictures that are moved by whole pixels may be rolled, which their borders show.
    """
    nominal, shift = test.nominal, np.rint(diagnosis.model.shift).astype(int)
    if diagnosis.faults:
        more = any(
            getattr(diagnosis.model, name) != getattr(nominal, name) for name in OTHER_FIELDS
        )
        rolled = Film(rolled=(int(-shift[0]), int(-shift[1])))
        model = replace(diagnosis.model, shift=nominal.shift, film=rolled)
        if not shift.any() or more or not test.pays(model, diagnosis.model):
            return diagnosis
    elif not test.images or not test.wrong(nominal):
        return diagnosis
    else:
        # A few hogels choose the film, which all of them test.
        few = test.few()
        model = min((replace(nominal, film=film) for film in films(few)), key=few.wrong)
    if not (test.explains(model) and test.spares(model) and test.pays(model)):
        return diagnosis
    fit = GeometryFit(model=model, low=model.parameters, high=model.parameters)
    return Diagnosis(model=model, faults=_named(test, fit), evidence=diagnosis.evidence)


def _with_shading(test: TestSet, diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis that names the shading of images that have both numbers and colors.

    Numbers of surfaces do not depend on light, so that colors are tested by themselves.
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
    """Return the claims of images where they suffice for a fit, and how many images have some."""

    def claiming(image: HogelImage) -> bool:
        named = (image.triangle != NOTHING).any()
        return bool(named or np.isfinite(image.position[..., :2]).any())

    images = [*filter(claiming, test.images)]
    claims = claims_of(test.reference.scene, images) if images else None
    return claims if claims is not None and len(claims) >= MIN_FITTED_CLAIMS else None, len(images)


def _named(test: TestSet, fit: GeometryFit) -> tuple[Defect, ...]:
    """Return the defects of a candidate, with the share of wrong pixels that they explain."""
    defects = defects_of(test.reference.scene, test.nominal, fit)
    share = test.share(fit.model) if defects else None
    if len(defects) > 1:
        defects = with_joint_numbers(defects, test.joint_groups(fit.model), fit.model)
    return tuple(replace(defect, explains=share) for defect in defects)


def _best(test: TestSet, fit: GeometryFit) -> GeometryFit:
    """Return the candidate that explains most wrong pixels, without needless defects."""
    # Step 1: the fitted candidate, with the halves put together as the images have them.
    nominal, recentered = test.nominal, test.reference.scene.frustum.recentered
    model, *others = _composed(test, fit.model)
    if model.one_camera is not None and model.orientation != nominal.orientation:
        # To turn the picture and one half of it back is to turn the other half alone.
        turned, *rest = _composed(test, replace(fit.model, orientation=nominal.orientation))
        if test.explains(turned):
            model, others = turned, rest
    shears = [shear for shear in Recentering if recentered and shear != nominal.recentering]
    if model != fit.model:
        # A half that a wrong shear moves off the film is not missing.
        sheared = (replace(fit.model, recentering=shear) for shear in shears)
        model = next(filter(test.explains, sheared), model)
    if test.explains(model):
        also = (*fit.alternatives, *others, *_alike(test, model, by_depth=fit.by_color))
        return replace(fit, model=model, alternatives=also)
    # Step 2: its alternatives. Claims hold equally under them, but the reach may cut them
    # differently.
    best = next(filter(test.explains, fit.alternatives), None)
    others = [fit.model, *(other for other in fit.alternatives if other != best)]
    if best is None:
        # Step 3: nominal numbers and gross mistakes, because other defects may have misled the fit.
        best = test.reduced(min(_unfitted(test, fit, model, shears), key=test.wrong))
        others = list(_alike(test, best))
    # Bounds are known of numbers that were fitted with the same shear and cameras, and of nominal
    # ones.
    same = (best.recentering, best.one_camera) == (fit.model.recentering, fit.model.one_camera)
    values = best.parameters
    known = np.where(same & (values == fit.model.parameters), (fit.low, fit.high), np.nan)
    low, high = np.where(values == nominal.parameters, values, known)
    return replace(fit, model=best, low=low, high=high, alternatives=tuple(others))


def _unfitted(
    test: TestSet, fit: GeometryFit, model: RendererModel, shears: Sequence[Recentering]
) -> list[RendererModel]:
    """Return candidates with nominal numbers or gross mistakes beside fitted conventions."""
    nominal, tried = test.nominal, [model]
    plain = fit.model.with_parameters(nominal.parameters)
    if plain != fit.model:
        plain = _composed(test, plain)[0]
        tried.append(plain)
    if test.explains(plain):
        return tried
    if test.infeasible:
        # Where too little is seen for a fit, orientation and order may be wrong as well.
        halves = {name: getattr(nominal, name) for name in ("front", "overlaid", "culled")}
        for way in (nominal, replace(plain, **halves)):
            for size in (replace(way, scene_scale=factor) for factor in MISTAKEN_UNITS):
                tried += [size, *_alike(test, size)]
    if fit.by_color:
        # Registration makes pictures larger, as a near offset does at one depth only.
        tried.append(_composed(test, with_near(test, model))[0])
        if nominal not in (model, plain):
            # Where one half alone is mirrored, registration may have turned the picture to suit it.
            tried.append(_composed(test, nominal)[0])
        # Registration moves pictures and makes them larger; it shears none unlike another.
        tried += [
            replace(way, recentering=shear)
            for way in dict.fromkeys((plain, nominal))
            for shear in sorted(shears)
        ]
    return tried


def _composed(test: TestSet, model: RendererModel) -> list[RendererModel]:
    """Return a candidate with the composition that images have, and its equals by the images."""
    speaking = [image for image in test.images if shows(image)]
    models = list(compositions(test.reference, model, speaking)) if speaking else [model]
    best = test.reduced(models[0]) if models[0] != test.nominal else models[0]
    if best != models[0]:
        return [best]
    return [best, *filter(test.explains, models[1:])]


def _alike(
    test: TestSet, model: RendererModel, *, by_depth: bool = False
) -> tuple[RendererModel, ...]:
    """Return candidates with other defects that show the same images, or nearly so (`by_depth`)."""
    same = (
        _moved_alike(test, model)
        if test.reference.scene.frustum.screen is None
        else _sheared_alike(test, model)
    )
    tried = _alike_at_depths(test, model) if by_depth else []
    return (*same, *_sheared_instead(test, model), *filter(test.explains, tried))


def _moved_alike(test: TestSet, model: RendererModel) -> list[RendererModel]:
    """Return the twins of moved or scaled scenes of centered frusta.

    An image depends on (P - a) / s alone. Moving the apertures to one side equals moving the scene
    to the other side, and enlarging the scene equals shrinking the plate by the same factor, except
    for surfaces beyond the reach.
    """
    nominal, same = test.nominal, []
    (x, y, z), factor, pitch = model.scene_offset, model.scene_scale, model.pitch[0]
    if (x, y) != nominal.scene_offset[:2] and model.aperture_offset == nominal.aperture_offset:
        same.append(replace(model, aperture_offset=(-x, -y), scene_offset=(0.0, 0.0, z)))
    if factor != nominal.scene_scale and model.pitch == nominal.pitch:
        same.append(replace(model, scene_scale=1.0, pitch=(pitch / factor, pitch / factor)))
    elif pitch != nominal.pitch[0] and abs(pitch / model.pitch[1] - 1) <= MAX_PITCH_DIFFERENCE:
        same.append(replace(model, scene_scale=factor / pitch, pitch=nominal.pitch))
    return same


def _sheared_alike(test: TestSet, model: RendererModel) -> list[RendererModel]:
    """Return the twins of a wrong shear.

    Where everything visible lies on one side of the plate, images do not show the other camera; in
    one aperture alone, a missing or reversed shear equals a screen at another place.
    """
    nominal, scene, tried = test.nominal, test.reference.scene, []
    if model.recentering is nominal.recentering:
        return []
    if model.recentering is not Recentering.NONE:
        kept = (nominal.recentering, model.recentering, Recentering.NONE)
        tried += [replace(model, recentering=shear) for shear in Recentering if shear not in kept]
    apertures = {model.placed(model.answers(scene, image.camera.aperture)) for image in test.images}
    factor, screen = model.recentering.factor(1), scene.frustum.screen
    if len(apertures) == 1 and factor == model.recentering.factor(-1) and screen is not None:
        (there,) = apertures
        x, y = (
            (factor - 1) * (middle - place)
            for middle, place in zip(screen.center, (there.x, there.y), strict=True)
        )
        tried.append(replace(model, recentering=nominal.recentering, screen_center=(x, y)))
    most = test.wrong(model, explained=True)
    return [other for other in tried if test.wrong(other, explained=True) <= most]


def _alike_at_depths(test: TestSet, model: RendererModel) -> list[RendererModel]:
    """Return candidates that look like another field of view or shift at some depths of the scene.

    At one depth, a near offset n looks like a field of view 1 + n / |z| times as large, and a moved
    scene or plate like a shift of the sampling points.
    """
    nominal, scene, tried = test.nominal, test.reference.scene, []
    plain = model.with_parameters(nominal.parameters)
    if plain == model:
        return []
    _, half = film_window(scene.frustum, scene.plate.middle)
    shift, factor = np.asarray(model.shift), float(np.mean(model.fov))
    if scene.frustum.screen is not None:
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
    return tried


def _sheared_instead(test: TestSet, model: RendererModel) -> list[RendererModel]:
    """Return wrong shears that show images of one aperture as a moved screen does."""
    nominal, scene = test.nominal, test.reference.scene
    apertures = {model.answers(scene, image.camera.aperture) for image in test.images}
    if model.screen_center == nominal.screen_center or len(apertures) != 1:
        return []
    plain, most = (
        replace(model, screen_center=nominal.screen_center),
        test.wrong(model, explained=True),
    )
    tried = (
        replace(plain, recentering=shear) for shear in (Recentering.NONE, Recentering.BOTH_REVERSED)
    )
    return [other for other in tried if test.wrong(other, explained=True) <= most]


def _with_view_shear(test: TestSet) -> Diagnosis | None:
    """Return a diagnosis that names the shear of views where it explains the wrong pixels.

    An eye at height d sees the plate through a sheared frustum. A renderer that shears its views by
    a factor f of the plate's need registers them at height d (1 - 1/f): there, and not in the
    plate, the lines of one hogel meet. Seen from that plane it shows a plate 1/f times as wide,
    under a screen 1/f times as high. So one number does for which the fit
    would need three groups for.
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
            # The renderer's views end where the scene's do, not about the plane of
            # registration.
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
