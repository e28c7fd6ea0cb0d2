"""Diagnosis before verdict: what a renderer does otherwise than asked, from some of its hogels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.diagnosis.claims import claims_of
from xfrustum.compare.diagnosis.composition import exchanged_light, find_composition, unconjugated_share
from xfrustum.compare.diagnosis.explained import MIN_EXPLAINED_FRACTION, ExplanationTest
from xfrustum.compare.diagnosis.faults import (
    MISTAKEN_UNITS,
    Fault,
    faults_of,
    lights_fault,
    with_joint_numbers,
)
from xfrustum.compare.diagnosis.geometry_fit import GeometryFit, fit_geometry
from xfrustum.compare.diagnosis.registration import register
from xfrustum.compare.judging.judged import Judging
from xfrustum.compare.renderer_model import parameters
from xfrustum.compare.renderer_model.conventions import CONVENTIONS
from xfrustum.compare.renderer_model.drawn_model import DrawnModel, Recentering
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import film_window
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage

MIN_FITTED_CLAIMS = 100
"""Smallest number of claims that geometry is fitted to: several for each of the numbers to be fitted and the
two symmetries."""

TRIED_VERTEX_FRACTIONS = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Shares of the scene's vertices that lie below the tried heights. At each of these heights another
explanation of the pictures is tried."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis:
    """A renderer's way to draw, and its faults.

    Attributes
    ----------
    model
        Guess that explains the images; the nominal one where no guess does.
    faults
        Faults of the renderer: the differences between this guess and what was asked.
    does_not_explain
        Faults of the best guess where it explains too little to be a finding.
    means
        Words for the data and the method that led to the guess.
    refuted
        Whether the guess explains the hogels that were tested, and makes all judged hogels together worse.
    """

    model: DrawnModel
    faults: tuple[Fault, ...]
    does_not_explain: tuple[Fault, ...]
    means: str
    refuted: bool = False

    @property
    def guesses(self) -> tuple[Fault, ...]:
        """Those of `does_not_explain` that people are told: they explain more than 0 %, as it is printed."""
        return tuple(one for one in self.does_not_explain if round(100 * (one.explains or 0.0)) > 0)


def diagnose(
    reference: Reference,
    images: Sequence[HogelImage],
    nominal: DrawnModel,
    judging: Judging | None = None,
) -> Diagnosis:
    """Find out how a renderer draws.

    Parameters
    ----------
    reference
        Reference of the scene.
    images
        Some of the renderer's hogels as read from its files, before any correction, each with the camera of
        the aperture that its file is named after.
    nominal
        Model of the renderer by its author's statements.
    judging
        Rules for what counts as wrong.
    """
    test = ExplanationTest(reference=reference, images=images, nominal=nominal, judging=judging or Judging())
    if not images or test.wrong(nominal):
        found = _of_wrong(test)
    else:
        # Nothing needs an explanation: a guess that fits a little better fits noise.
        means = f"{_counted(len(test.tested), 'hogel')}, in which nothing is wrong"
        found = Diagnosis(model=nominal, faults=(), does_not_explain=(), means=means)
    # Numbers of surfaces say nothing of light: where images have colors too, light is tested by itself.
    lights = _lights(reference, found.model, images) if not _by_color(images) else None
    if lights is None:
        return found
    if _enough(lights.explains):
        model = replace(found.model, conjugated=False)
        return replace(found, model=model, faults=(*found.faults, lights))
    return replace(found, does_not_explain=(*found.does_not_explain, doubtful(lights)))


def _of_wrong(test: ExplanationTest) -> Diagnosis:
    """Find out how a renderer draws if some of its images are wrong."""
    # Step 1: fit conventions and geometry, and leave out the hogels that the fit calls spoiled.
    reference, nominal = test.reference, test.nominal
    fit, means = _fitted(reference, test.images, nominal)
    images = [image for image in test.images if image.camera.aperture.index not in fit.spoiled]
    test = replace(test, images=images, known={})
    # Step 2: plain pictures may be wrong because of their lights.
    lights = _lights(reference, fit.model, images) if _by_color(images) else None
    if lights is not None and _enough(lights.explains):
        fit = replace(fit, model=replace(fit.model, conjugated=False))
    # Step 3: the guess that explains most, and the test whether it explains enough.
    guess = fit
    model, fit = _best(test, fit)
    faults, share = _named(test, model, fit), test.share(model)
    if share is None or (faults and share >= MIN_EXPLAINED_FRACTION and test.spares(model)):
        if share is None or not test.pays(model):
            # The wrong pixels have causes that are nobody's fault, and need no other guess.
            model, faults = nominal, ()
        return Diagnosis(model=model, faults=faults, does_not_explain=(), means=means)
    # Step 4: no guess explains enough. The best fit is reported as doubtful, although fewer faults may do as
    # well.
    doubted = faults or _named(test, guess.model, guess)
    doubted = tuple(map(doubtful, doubted))
    return Diagnosis(model=nominal, faults=(), does_not_explain=doubted, means=means)


def _named(test: ExplanationTest, model: DrawnModel, fit: GeometryFit) -> tuple[Fault, ...]:
    """Return the faults of a guess, each with the share of the wrong pixels that all of them explain."""
    faults = faults_of(test.reference.scene, test.nominal, model, fit)
    if not model.conjugated:
        faults = (*faults, lights_fault(*exchanged_light(test.reference, model, test.images)))
    share = test.share(model) if faults else None
    faults = with_joint_numbers(faults, test.joint_groups(model) if len(faults) > 1 else (), model)
    return tuple(replace(fault, explains=share) for fault in faults)


def _by_color(images: Sequence[HogelImage]) -> bool:
    return all((image.triangle == NOTHING).all() and not _names_objects(image) for image in images)


def _fitted(
    reference: Reference, images: Sequence[HogelImage], nominal: DrawnModel
) -> tuple[GeometryFit, str]:
    """Return conventions and geometry by the best means that the images allow, and the means in words."""
    claiming = [image for image in images if _claims(image)]
    claims = claims_of(reference.scene, claiming) if claiming else None
    pictures = [image for image in images if image.color is not None or _names_objects(image)]
    if claims is not None and len(claims) >= MIN_FITTED_CLAIMS:
        fit = fit_geometry(claims, reference.scene, nominal)
        means = f"{len(claims):,} claims of {_counted(len(claiming), 'hogel')}"
        means += f", {len(fit.spoiled)} left out as unlike the others" if fit.spoiled else ""
        return fit, means if fit.holds else f"{means}, which no convention explains"
    if pictures:
        by_objects = all(picture.color is None for picture in pictures)
        fit = replace(register(reference, pictures, nominal), by_color=True, by_objects=by_objects)
        return fit, f"registration of {_counted(len(pictures), 'picture')}"
    none = nominal.parameters
    fit = GeometryFit(model=nominal, low=none, high=none, free=(), noise_px=0.0)
    return fit, "nothing, as no hogel shows enough to tell"


def _best(test: ExplanationTest, fit: GeometryFit) -> tuple[DrawnModel, GeometryFit]:
    """Return the guess that explains most of what is wrong, without faults that add nothing.

    The fitted guess comes first. Where it explains too little, the nominal numbers are tried, because other
    faults may have misled the fit; and then scenes in wrong units, which may show too little to be fitted.
    """
    # Step 1: the fitted guess, with the halves put together as the images have them.
    nominal = test.nominal
    model, *others = _composed(test, fit.model)
    if _enough(test.share(model)):
        also = (*fit.alternatives, *others, *_by_depth(test, model, fit), *_twins(test, model))
        return model, replace(fit, alternatives=also)
    # Step 2: the alternatives of the fit. Claims cannot tell them apart, but the reach may cut them
    # differently.
    for other in fit.alternatives:
        if _enough(test.share(other)):
            rest = (fit.model, *(one for one in fit.alternatives if one != other))
            return other, _unbounded(fit, nominal, other, rest)
    # Step 3: the nominal numbers under the conventions that were found, and gross mistakes.
    plain = fit.model.with_parameters(nominal.parameters)
    tried = [[model, *others]]
    if plain != fit.model:
        tried.append(_composed(test, plain))
        plain = tried[-1][0]
    if test.hopeless and not _enough(test.share(plain)):
        whole = replace(plain, front=nominal.front, overlaid=nominal.overlaid, culled=nominal.culled)
        # Where too little is seen to be fitted, orientation and order may be wrong as well.
        for size in (replace(way, scene_scale=f) for way in (nominal, whole) for f in MISTAKEN_UNITS):
            tried += [[one] for one in (size, *_twins(test, size))]
    if fit.by_color and nominal not in (model, plain) and not _enough(test.share(plain)):
        # Where one half alone is mirrored, registration may have turned the picture to suit that half.
        tried.append(_composed(test, nominal))
    if fit.by_color and test.reference.scene.frustum.recentered and not _enough(test.share(plain)):
        # Registration moves pictures and makes them larger; it does not shear one aperture unlike another.
        for way in dict.fromkeys((plain, nominal)):
            shears = [shear for shear in Recentering if shear is not nominal.recentering]
            tried += [[replace(way, recentering=shear)] for shear in shears]
    # Step 4: the best of all that were tried, without idle faults.
    found, *others = min(tried, key=lambda models: test.wrong(models[0]))
    best = test.reduced(found)
    others = [*(others if best == found else []), *_twins(test, best)]
    if _not_fitted(best) == _not_fitted(model):
        return best, replace(fit, alternatives=(*fit.alternatives, *others))
    # The best guess is a common mistake of units, or another shear: its interval is not known from a fit.
    return best, _unbounded(fit, nominal, best, others)


def _not_fitted(model: DrawnModel) -> tuple[object, ...]:
    """Return what of a guess may have been tried instead of fitted."""
    return model.scene_scale, model.pitch, model.recentering, model.one_camera


MAX_PITCH_DIFFERENCE = 1e-3
"""Largest relative difference between the pitches of columns and rows at which they count as equal: each may
be off by `parameters.SMALLEST_FACTOR`, half of this, without having a name."""


def _twins(test: ExplanationTest, model: DrawnModel) -> tuple[DrawnModel, ...]:
    """Return guesses with other faults that show the same images, except for what the reach cuts off.

    Through a centered frustum an image depends on (P - a) / s alone. Moving the apertures to one side equals
    moving the scene to the other side, and enlarging the scene equals shrinking the plate by the same factor.
    Through a recentered one, another shear may show the same images.
    """
    scene, nominal = test.reference.scene, test.nominal
    if scene.frustum.recentered:
        return _sheared_twins(test, model)
    found = []
    x, y, z = model.scene_offset
    if (x, y) != nominal.scene_offset[:2] and model.aperture_offset == nominal.aperture_offset:
        found.append(replace(model, aperture_offset=(-x, -y), scene_offset=(0.0, 0.0, z)))
    factor, other = model.scene_scale, model.pitch[0]
    if factor != nominal.scene_scale and model.pitch == nominal.pitch:
        found.append(replace(model, scene_scale=1.0, pitch=(other / factor, other / factor)))
    elif other != nominal.pitch[0] and abs(other / model.pitch[1] - 1) <= MAX_PITCH_DIFFERENCE:
        found.append(replace(model, scene_scale=factor / other, pitch=nominal.pitch))
    return tuple(found)


def _sheared_twins(test: ExplanationTest, model: DrawnModel) -> tuple[DrawnModel, ...]:
    """Return guesses with other shears that explain the images as well as one with a wrong shear.

    Where everything visible lies on one side of the plate, images do not say what became of the other camera.
    In one aperture alone, a missing or reversed shear equals a projection screen at another place.
    """
    scene, nominal = test.reference.scene, test.nominal
    screen = scene.frustum.screen
    if screen is None or model.recentering is nominal.recentering:
        return ()
    tried = []
    if model.recentering is not Recentering.NONE:
        kept = (nominal.recentering, model.recentering, Recentering.NONE)
        tried += [replace(model, recentering=other) for other in Recentering if other not in kept]
    apertures = {model.placed(model.answers(scene, image.camera.aperture)) for image in test.images}
    factor = model.recentering.factor(1)
    if len(apertures) == 1 and factor == model.recentering.factor(-1):
        (there,) = apertures
        x, y = ((factor - 1) * (m - a) for m, a in zip(screen.center, (there.x, there.y), strict=True))
        tried.append(replace(model, recentering=nominal.recentering, screen_center=(x, y)))
    return tuple(one for one in tried if test.unexplained(one) <= test.unexplained(model))


def _unbounded(
    fit: GeometryFit, nominal: DrawnModel, model: DrawnModel, others: Sequence[DrawnModel]
) -> GeometryFit:
    """Return a fit with another guess in place of its own; the bounds of its changed numbers are unknown."""
    unknown = np.where(model.parameters == nominal.parameters, nominal.parameters, np.nan)
    return replace(fit, low=unknown, high=unknown, alternatives=tuple(others))


def _composed(test: ExplanationTest, model: DrawnModel) -> list[DrawnModel]:
    """Return a guess with the halves put together as the images have them, without idle faults.

    Guesses with other ways to put the halves together that images cannot tell apart follow.
    """
    telling = [image for image in test.images if _shows(image)]
    models = list(find_composition(test.reference, model, telling)) if telling else [model]
    best = test.reduced(models[0]) if models[0] != test.nominal else models[0]
    if best != models[0]:
        return [best]
    return [best, *(other for other in models[1:] if _enough(test.share(other)))]


def _enough(share: float | None) -> bool:
    return share is None or share >= MIN_EXPLAINED_FRACTION


def _by_depth(test: ExplanationTest, model: DrawnModel, fit: GeometryFit) -> tuple[DrawnModel, ...]:
    """Return guesses of a near offset or a moved scene that explain pictures as well as the fitted numbers.

    At one depth, a near offset n looks like a field of view 1 + n / |z| times as large, and a moved scene or
    plate looks like a shift of the sampling points. Pictures with colors alone cannot tell them apart:
    therefore both are tried at some depths of the scene.
    """
    nominal, scene = test.nominal, test.reference.scene
    if not fit.by_color or model.parameters.tolist() == nominal.parameters.tolist():
        return ()
    heights = np.quantile(scene.vertices[:, 2], TRIED_VERTEX_FRACTIONS)
    plain = model.with_parameters(nominal.parameters)
    factor = float(np.mean(model.fov))
    _, half = film_window(scene.frustum, scene.plate.middle)
    shift = np.asarray(model.shift)
    if scene.frustum.screen is not None:
        shift = shift + np.asarray(model.screen_center) / parameters.screen_lengths(scene)
    tilt = 2 * shift / scene.frustum.resolution * half * (1, -1)
    tried = []
    for z in heights:
        if factor != 1.0:
            near = float(np.clip((factor - 1) * abs(z), 0.0, 0.5 * scene.frustum.longest_reach))
            tried.append([replace(model, fov=nominal.fov, near=near)])
        if tilt.any():
            x, y = (float(part) for part in tilt * z)
            moved = replace(plain, fov=model.fov, scene_offset=(x, y, 0.0))
            tried.append([moved, replace(plain, fov=model.fov, aperture_offset=(-x, -y))])
    return tuple(one for group in tried for one in group if _enough(test.share(one)))


def _lights(reference: Reference, model: DrawnModel, images: Sequence[HogelImage]) -> Fault | None:
    """Return the fault of unconjugated lights with the share that it explains; None where there is none."""
    if not model.plain:
        # The wrong surface wins on the viewer's side, in a color of its own.
        return None
    back, front = exchanged_light(reference, model, images)
    share = unconjugated_share(reference, model, images) if back > 0 > front else None
    return None if share is None else replace(lights_fault(back, front), explains=share)


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


def _counted(count: int, name: str) -> str:
    return f"{count} {name}{'' if count == 1 else 's'}"


def _claims(image: HogelImage) -> bool:
    return bool((image.triangle != NOTHING).any() or np.isfinite(image.position[..., :2]).any())


def _shows(image: HogelImage) -> bool:
    return bool((image.triangle != NOTHING).any() or _names_objects(image) or image.color is not None)


def _names_objects(image: HogelImage) -> bool:
    return bool((image.object != NOTHING).any())
