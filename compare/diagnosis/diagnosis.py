"""Diagnosis before verdict: what a renderer does otherwise than asked, from some of its hogels.

`diagnose` finds the reading of the pixels and the way they were drawn, and tests both together: a guess that
does not explain what is wrong is no finding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.diagnosis.claims import claims_of, outside_px
from xfrustum.compare.diagnosis.composition import exchanged_light, find_composition, unconjugated_share
from xfrustum.compare.diagnosis.encodings import FoundEncoding, find_encoding
from xfrustum.compare.diagnosis.evidence import MIN_EXPLAINED_FRACTION, Evidence, shows
from xfrustum.compare.diagnosis.faults import (
    MISTAKEN_UNITS,
    VIEW_SHEAR,
    Fault,
    faults_of,
    lights_fault,
    with_joint_numbers,
)
from xfrustum.compare.diagnosis.geometry_fit import GeometryFit, fit_geometry
from xfrustum.compare.diagnosis.registration import register
from xfrustum.compare.judging.judged import Compared, Judging
from xfrustum.compare.renderer_model import parameters
from xfrustum.compare.renderer_model.conventions import CONVENTIONS
from xfrustum.compare.renderer_model.drawn_model import DrawnModel, Recentering
from xfrustum.reference.lines.lines import film_window
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage

MIN_FITTED_CLAIMS = 100
"""Smallest number of claims that geometry is fitted to: several for each of the numbers to be fitted and the
two symmetries."""

TRIED_VERTEX_FRACTIONS = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Shares of the scene's vertices that lie below the tried heights. At each of these heights another
explanation of the pictures is tried."""

MAX_PITCH_DIFFERENCE = 1e-3
"""Largest relative difference between the pitches of columns and rows at which they count as equal: each may
be off by `parameters.SMALLEST_FACTOR`, half of this, without having a name."""

TRIED_VIEW_SHEARS = np.geomspace(0.4, 2.5, 185)
"""Factors of the shear of views that are tried: neighbors differ by one percent, by which a picture moves
less than by a pixel where views have a hundred pixels."""

FINER_STEPS = np.linspace(-0.015, 0.015, 61)
"""Relative changes of the best factor that are tried next."""

VIEW_SHEAR_CAP_PX = 4.0
"""Largest failure of a claim that counts, in pixels: claims under wrong factors fail by any distance."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis:
    """A renderer's way to draw, and its faults.

    Attributes
    ----------
    model
        Guess that explains the images; the nominal one where no guess does.
    faults, does_not_explain
        Faults of the renderer: the differences between this guess and what was asked; and those of the best
        guess where it explains too little to be a finding.
    refuted
        Whether the guess explains the hogels that were tested, and makes all judged hogels no better.
    """

    model: DrawnModel
    faults: tuple[Fault, ...] = ()
    does_not_explain: tuple[Fault, ...] = ()
    means: str
    refuted: bool = False

    @property
    def guesses(self) -> tuple[Fault, ...]:
        """Those of `does_not_explain` that people are told: they explain more than 0 %, as it is printed."""
        return tuple(one for one in self.does_not_explain if round(100 * (one.explains or 0.0)) > 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """The way to read a renderer's images, their diagnosis in this reading, and the rules by which to judge.

    Where no other reading explains the wrong pixels, it is the stated one; the faults of the diagnosis
    include those of the reading.
    """

    encoding: FoundEncoding
    diagnosis: Diagnosis
    judging: Judging


def diagnose(evidence: Evidence, *, of_views: bool = False) -> Findings:
    """Find the reading of a renderer's images and the way it draws.

    A reading is tested together with the diagnosis of the images in this reading: together they must explain
    `MIN_EXPLAINED_FRACTION` of the pixels that are wrong as stated. Otherwise neither is a finding.

    Parameters
    ----------
    of_views
        Whether the hogels were put together from views, which may have another shear.
    """
    reference, images, nominal = evidence.reference, evidence.images, evidence.nominal
    encoding, judging = find_encoding(reference, images, nominal), evidence.judging
    if not encoding.faults:
        diagnosis = diagnosis_of(evidence)
    else:
        # Where numbers were asked for and colors are found, shading was not asked for: only geometry counts.
        if encoding.as_colors:
            judging = replace(judging, compared=Compared.GEOMETRY)
        read = evidence.of([encoding.read(reference, image) for image in images], judging)
        diagnosis = diagnosis_of(read)
        wrong = evidence.wrong(nominal)
        share = max(0.0, 1.0 - read.unexplained(diagnosis.model) / wrong) if wrong else 0.0
        faults = tuple(replace(fault, explains=share) for fault in (*encoding.faults, *diagnosis.faults))
        diagnosis = replace(diagnosis, faults=faults)
        if share < MIN_EXPLAINED_FRACTION:
            encoding, judging, diagnosis = FoundEncoding(), evidence.judging, diagnosis_of(evidence)
            doubted = (*map(doubtful, faults), *diagnosis.does_not_explain)
            diagnosis = replace(diagnosis, does_not_explain=doubted)
    if of_views and not diagnosis.faults:
        read = evidence.of([encoding.read(reference, image) for image in images])
        diagnosis = _with_view_shear(diagnosis, read)
    return Findings(encoding=encoding, diagnosis=diagnosis, judging=judging)


def diagnosis_of(evidence: Evidence) -> Diagnosis:
    """Find out how a renderer draws whose pixels are read as stated."""
    if not evidence.images or evidence.wrong(evidence.nominal):
        found = _of_wrong(evidence)
    else:
        # Nothing needs an explanation: a guess that fits a little better fits noise.
        means = f"{_counted(len(evidence.tested), 'hogel')}, in which nothing is wrong"
        found = Diagnosis(model=evidence.nominal, means=means)
    # Numbers of surfaces say nothing of light: where images have colors too, light is tested by itself.
    lights = None if _by_color(evidence.images) else _lights(evidence, found.model)
    if lights is None:
        return found
    if (lights.explains or 0.0) >= MIN_EXPLAINED_FRACTION:
        model = replace(found.model, conjugated=False)
        return replace(found, model=model, faults=(*found.faults, lights))
    return replace(found, does_not_explain=(*found.does_not_explain, doubtful(lights)))


def doubtful(fault: Fault) -> Fault:
    """Return a fault whose words say that it explains too little, or makes wrong what was right."""
    assert fault.explains is not None
    would = f"would explain only {100 * fault.explains:.0f} % of what is wrong"
    if fault.explains >= MIN_EXPLAINED_FRACTION:
        would = "would make pixels wrong that are right"
    return replace(fault, words=f"{fault.words}: {would}")


def declared(nominal: DrawnModel, found: DrawnModel, accepted: Sequence[str]) -> DrawnModel:
    """Return the model that images are judged by: the nominal one with the accepted conventions as found."""
    assert set(accepted) <= set(CONVENTIONS)
    fields = {name: getattr(found, name) for name in accepted}
    if "near" in accepted:
        fields |= {"pivot": found.pivot, "fit": found.fit}
    return replace(nominal, **fields)


def _of_wrong(evidence: Evidence) -> Diagnosis:
    """Find out how a renderer draws if some of its images are wrong."""
    # Step 1: fit conventions and geometry, and leave out the hogels that the fit calls spoiled.
    nominal = evidence.nominal
    fit, means = _fitted(evidence)
    evidence = evidence.of([one for one in evidence.images if one.camera.aperture.index not in fit.spoiled])
    # Step 2: plain pictures may be wrong because of their lights.
    lights = _lights(evidence, fit.model) if _by_color(evidence.images) else None
    if lights is not None and (lights.explains or 0.0) >= MIN_EXPLAINED_FRACTION:
        fit = replace(fit, model=replace(fit.model, conjugated=False))
    # Step 3: the guess that explains most, and the test whether it explains enough and spoils nothing.
    best = _best(evidence, fit)
    faults, share = _named(evidence, best), evidence.share(best.model)
    explains = share is None or (share >= MIN_EXPLAINED_FRACTION and evidence.spares(best.model))
    if explains and (faults or share is None):
        if share is not None and evidence.pays(best.model):
            return Diagnosis(model=best.model, faults=faults, means=means)
        # The wrong pixels have causes that are nobody's fault, and need no other guess.
        return Diagnosis(model=nominal, means=means)
    # Step 4: no guess explains enough. The best fit is reported as doubtful, although fewer faults may do as
    # well.
    doubted = tuple(map(doubtful, faults or _named(evidence, fit)))
    return Diagnosis(model=nominal, does_not_explain=doubted, means=means)


def _named(evidence: Evidence, fit: GeometryFit) -> tuple[Fault, ...]:
    """Return the faults of a guess, each with the share of the wrong pixels that all of them explain."""
    model = fit.model
    faults = faults_of(evidence.reference.scene, evidence.nominal, fit)
    if not model.conjugated:
        faults = (*faults, lights_fault(*exchanged_light(evidence.reference, model, evidence.images)))
    share = evidence.share(model) if faults else None
    if len(faults) > 1:
        faults = with_joint_numbers(faults, evidence.joint_groups(model), model)
    return tuple(replace(fault, explains=share) for fault in faults)


def _fitted(evidence: Evidence) -> tuple[GeometryFit, str]:
    """Return conventions and geometry by the best means that the images allow, and the means in words."""
    reference, nominal = evidence.reference, evidence.nominal
    claiming = [one for one in evidence.images if _claims(one)]
    claims = claims_of(reference.scene, claiming) if claiming else None
    pictures = [one for one in evidence.images if one.color is not None or (one.object != NOTHING).any()]
    if claims is not None and len(claims) >= MIN_FITTED_CLAIMS:
        fit = fit_geometry(claims, reference.scene, nominal)
        means = f"{len(claims):,} claims of {_counted(len(claiming), 'hogel')}"
        means += f", {len(fit.spoiled)} left out as unlike the others" if fit.spoiled else ""
        return fit, means if fit.holds else f"{means}, which no convention explains"
    if pictures:
        return register(reference, pictures, nominal), f"registration of {_counted(len(pictures), 'picture')}"
    none = nominal.parameters
    fit = GeometryFit(model=nominal, low=none, high=none)
    return fit, "nothing, as no hogel shows enough to tell"


def _best(evidence: Evidence, fit: GeometryFit) -> GeometryFit:
    """Return the guess that explains most of what is wrong, without faults that add nothing.

    The fitted guess comes first. Where it explains too little, the nominal numbers are tried, because other
    faults may have misled the fit; and then scenes in wrong units, which may show too little to be fitted.
    """
    # Step 1: the fitted guess, with the halves put together as the images have them.
    nominal, recentered = evidence.nominal, evidence.reference.scene.frustum.recentered
    model, *others = _composed(evidence, fit.model)
    if evidence.explains(model):
        also = (*fit.alternatives, *others, *_by_depth(evidence, model, fit), *_twins(evidence, model))
        return replace(fit, model=model, alternatives=also)
    # Step 2: the alternatives of the fit. Claims cannot tell them apart, but the reach may cut them
    # differently.
    for other in fit.alternatives:
        if evidence.explains(other):
            rest = (fit.model, *(one for one in fit.alternatives if one != other))
            return _unbounded(fit, nominal, other, rest)
    # Step 3: the nominal numbers under the conventions that were found, and gross mistakes.
    plain = fit.model.with_parameters(nominal.parameters)
    tried = [[model, *others]]
    if plain != fit.model:
        tried.append(_composed(evidence, plain))
        plain = tried[-1][0]
    if not evidence.explains(plain):
        if evidence.hopeless:
            # Where too little is seen to be fitted, orientation and order may be wrong as well.
            whole = replace(plain, front=nominal.front, overlaid=nominal.overlaid, culled=nominal.culled)
            sizes = [replace(way, scene_scale=f) for way in (nominal, whole) for f in MISTAKEN_UNITS]
            tried += [[one] for size in sizes for one in (size, *_twins(evidence, size))]
        if fit.by_color and nominal not in (model, plain):
            # Where one half alone is mirrored, registration may have turned the picture to suit that half.
            tried.append(_composed(evidence, nominal))
        if fit.by_color and recentered:
            # Registration moves pictures and makes them larger; it shears none unlike another.
            ways, shears = dict.fromkeys((plain, nominal)), set(Recentering) - {nominal.recentering}
            tried += [[replace(way, recentering=one)] for way in ways for one in sorted(shears)]
    # Step 4: the best of all that were tried, without idle faults.
    found, *others = min(tried, key=lambda models: evidence.wrong(models[0]))
    best = evidence.reduced(found)
    others = [*(others if best == found else []), *_twins(evidence, best)]
    if _not_fitted(best) == _not_fitted(model):
        return replace(fit, model=best, alternatives=(*fit.alternatives, *others))
    # The best guess is a common mistake of units, or another shear: its interval is not known from a fit.
    return _unbounded(fit, nominal, best, others)


def _not_fitted(model: DrawnModel) -> tuple[object, ...]:
    """Return what of a guess may have been tried instead of fitted."""
    return model.scene_scale, model.pitch, model.recentering, model.one_camera


def _unbounded(
    fit: GeometryFit, nominal: DrawnModel, model: DrawnModel, others: Sequence[DrawnModel]
) -> GeometryFit:
    """Return a fit with another guess in place of its own; the bounds of its changed numbers are unknown."""
    unknown = np.where(model.parameters == nominal.parameters, nominal.parameters, np.nan)
    return replace(fit, model=model, low=unknown, high=unknown, alternatives=tuple(others))


def _composed(evidence: Evidence, model: DrawnModel) -> list[DrawnModel]:
    """Return a guess with the halves put together as the images have them, without idle faults.

    Guesses with other ways to put the halves together that images cannot tell apart follow.
    """
    telling = [image for image in evidence.images if shows(image)]
    models = list(find_composition(evidence.reference, model, telling)) if telling else [model]
    best = evidence.reduced(models[0]) if models[0] != evidence.nominal else models[0]
    if best != models[0]:
        return [best]
    return [best, *(other for other in models[1:] if evidence.explains(other))]


def _twins(evidence: Evidence, model: DrawnModel) -> tuple[DrawnModel, ...]:
    """Return guesses with other faults that show the same images, except for what the reach cuts off.

    Through a centered frustum an image depends on (P - a) / s alone. Moving the apertures to one side equals
    moving the scene to the other side, and enlarging the scene equals shrinking the plate by the same factor.
    Through a recentered one, another shear may show the same images.
    """
    if evidence.reference.scene.frustum.recentered:
        return _sheared_twins(evidence, model)
    nominal, found = evidence.nominal, []
    x, y, z = model.scene_offset
    if (x, y) != nominal.scene_offset[:2] and model.aperture_offset == nominal.aperture_offset:
        found.append(replace(model, aperture_offset=(-x, -y), scene_offset=(0.0, 0.0, z)))
    factor, other = model.scene_scale, model.pitch[0]
    if factor != nominal.scene_scale and model.pitch == nominal.pitch:
        found.append(replace(model, scene_scale=1.0, pitch=(other / factor, other / factor)))
    elif other != nominal.pitch[0] and abs(other / model.pitch[1] - 1) <= MAX_PITCH_DIFFERENCE:
        found.append(replace(model, scene_scale=factor / other, pitch=nominal.pitch))
    return tuple(found)


def _sheared_twins(evidence: Evidence, model: DrawnModel) -> tuple[DrawnModel, ...]:
    """Return guesses with other shears that explain the images as well as one with a wrong shear.

    Where everything visible lies on one side of the plate, images do not say what became of the other camera.
    In one aperture alone, a missing or reversed shear equals a projection screen at another place.
    """
    scene, nominal = evidence.reference.scene, evidence.nominal
    screen = scene.frustum.screen
    if screen is None or model.recentering is nominal.recentering:
        return ()
    tried = []
    if model.recentering is not Recentering.NONE:
        kept = (nominal.recentering, model.recentering, Recentering.NONE)
        tried += [replace(model, recentering=other) for other in Recentering if other not in kept]
    apertures = {model.placed(model.answers(scene, image.camera.aperture)) for image in evidence.images}
    factor = model.recentering.factor(1)
    if len(apertures) == 1 and factor == model.recentering.factor(-1):
        (there,) = apertures
        x, y = ((factor - 1) * (m - a) for m, a in zip(screen.center, (there.x, there.y), strict=True))
        tried.append(replace(model, recentering=nominal.recentering, screen_center=(x, y)))
    return tuple(one for one in tried if evidence.unexplained(one) <= evidence.unexplained(model))


def _by_depth(evidence: Evidence, model: DrawnModel, fit: GeometryFit) -> tuple[DrawnModel, ...]:
    """Return guesses of a near offset or a moved scene that explain pictures as well as the fitted numbers.

    At one depth, a near offset n looks like a field of view 1 + n / |z| times as large, and a moved scene or
    plate looks like a shift of the sampling points. Pictures with colors alone cannot tell them apart:
    therefore both are tried at some depths of the scene.
    """
    nominal, scene = evidence.nominal, evidence.reference.scene
    if not fit.by_color or model.parameters.tolist() == nominal.parameters.tolist():
        return ()
    plain, factor = model.with_parameters(nominal.parameters), float(np.mean(model.fov))
    _, half = film_window(scene.frustum, scene.plate.middle)
    shift = np.asarray(model.shift)
    if scene.frustum.screen is not None:
        shift = shift + np.asarray(model.screen_center) / parameters.screen_lengths(scene)
    tilt = 2 * shift / scene.frustum.resolution * half * (1, -1)
    tried = []
    for z in np.quantile(scene.vertices[:, 2], TRIED_VERTEX_FRACTIONS):
        if factor != 1.0:
            near = float(np.clip((factor - 1) * abs(z), 0.0, 0.5 * scene.frustum.longest_reach))
            tried.append(replace(model, fov=nominal.fov, near=near))
        if tilt.any():
            x, y = (float(part) for part in tilt * z)
            tried.append(replace(plain, fov=model.fov, scene_offset=(x, y, 0.0)))
            tried.append(replace(plain, fov=model.fov, aperture_offset=(-x, -y)))
    return tuple(one for one in tried if evidence.explains(one))


def _lights(evidence: Evidence, model: DrawnModel) -> Fault | None:
    """Return the fault of unconjugated lights with the share that it explains; None where there is none."""
    if not model.plain:
        # The wrong surface wins on the viewer's side, in a color of its own.
        return None
    back, front = exchanged_light(evidence.reference, model, evidence.images)
    if not back > 0 > front:
        return None
    share = unconjugated_share(evidence.reference, model, evidence.images)
    return None if share is None else replace(lights_fault(back, front), explains=share)


def _with_view_shear(diagnosis: Diagnosis, evidence: Evidence) -> Diagnosis:
    """Return a diagnosis that names the shear of views where it explains what nothing else does.

    An eye at height d sees the plate through a sheared frustum. A renderer that shears its views by a factor
    f of what the plate needs registers them at height d (1 - 1/f): there, and not in the plate, the lines of
    one hogel meet. Seen from that plane the picture is that of a plate 1/f times as wide, under a screen 1/f
    times as high. So one number explains what the fit of geometry would need three groups for.
    """
    scene, nominal = evidence.reference.scene, evidence.nominal
    screen = scene.frustum.screen
    claiming = [image for image in evidence.images if (image.triangle != NOTHING).any()]
    if screen is None or not claiming or not evidence.wrong(nominal):
        return diagnosis
    claims = claims_of(scene, claiming)
    if len(claims) < MIN_FITTED_CLAIMS:
        return diagnosis

    def sheared(factor: float) -> DrawnModel:
        return replace(
            nominal,
            pitch=(nominal.pitch[0] / factor, nominal.pitch[1] / factor),
            scene_offset=(0.0, 0.0, screen.height * (1 / factor - 1)),
            screen_height=1 / factor,
        )

    def misfit(factor: float) -> float:
        return float(outside_px(claims, scene, sheared(factor), VIEW_SHEAR_CAP_PX).mean())

    coarse = min(TRIED_VIEW_SHEARS.tolist(), key=misfit)
    factor = min((coarse * (1 + FINER_STEPS)).tolist(), key=misfit)
    share = evidence.share(sheared(factor))
    if share is None or share < MIN_EXPLAINED_FRACTION:
        return diagnosis
    words = (
        f"views have {factor:.3g} of the shear that the plate needs: they are registered at height "
        f"{screen.height * (1 - 1 / factor):.4g} {scene.units}"
    )
    fault = Fault(fault=VIEW_SHEAR, value=factor, unit="ratio", words=words, explains=share)
    return replace(diagnosis, model=sheared(factor), faults=(fault,), does_not_explain=())


def _by_color(images: Sequence[HogelImage]) -> bool:
    return all((one.triangle == NOTHING).all() and (one.object == NOTHING).all() for one in images)


def _claims(image: HogelImage) -> bool:
    return bool((image.triangle != NOTHING).any() or np.isfinite(image.position[..., :2]).any())


def _counted(count: int, name: str) -> str:
    return f"{count} {name}{'' if count == 1 else 's'}"
