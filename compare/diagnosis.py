"""Diagnosis before verdict: what a renderer does otherwise than asked, from some of its hogels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.claims import claims_of
from xfrustum.compare.composition import exchanged_light, find_composition
from xfrustum.compare.drawn_model import DrawnModel
from xfrustum.compare.explained import LEAST_EXPLAINED, ExplanationTest
from xfrustum.compare.faults import CONVENTIONS, Fault, faults_of, lights_fault
from xfrustum.compare.geometry_fit import GeometryFit, fit_geometry
from xfrustum.compare.registration import register
from xfrustum.reference import Reference
from xfrustum.scenes.hogel_image import NOTHING, HogelImage

ENOUGH = 100
"""Claims that it takes to fit seven numbers and two symmetries, with some to spare."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis:
    """What was found out about a renderer.

    Attributes
    ----------
    model
        How it draws; what was asked for, where no guess explains what it shows.
    faults
        What of that is otherwise than asked.
    does_not_explain
        What would be otherwise by the best guess, where that explains too little to be a finding.
    means
        What it was found by, in words.
    """

    model: DrawnModel
    faults: tuple[Fault, ...]
    does_not_explain: tuple[Fault, ...]
    means: str


def diagnose(reference: Reference, images: Sequence[HogelImage], nominal: DrawnModel) -> Diagnosis:
    """Find out how a renderer draws.

    Parameters
    ----------
    reference
        Of the scene.
    images
        Some of its hogels as found, each with the camera of the aperture that its file is named after.
    nominal
        What its author says of it.
    """
    scene = reference.scene
    claiming = [image for image in images if _claims(image)]
    claims = claims_of(scene, claiming) if claiming else None
    pictures = [image for image in images if image.color is not None or _names_objects(image)]
    if claims is not None and len(claims) >= ENOUGH:
        fit = fit_geometry(claims, scene, nominal)
        means = f"{len(claims):,} claims of {len(claiming)} hogels"
        means += f", {len(fit.spoiled)} left out as unlike the others" if fit.spoiled else ""
    elif pictures:
        fit = register(reference, pictures, nominal)
        means = f"registration of {len(pictures)} pictures"
    else:
        none = nominal.parameters
        fit = GeometryFit(model=nominal, low=none, high=none, free=(), noise_px=0.0)
        means = "nothing: no hogel shows enough to tell"
    images = [image for image in images if image.camera.aperture.index not in fit.spoiled]
    model = fit.model
    named = [image for image in images if (image.triangle != NOTHING).any() or _names_objects(image)]
    if named:
        model = find_composition(reference, model, named)
    test = ExplanationTest(reference=reference, images=images, nominal=nominal)
    model = test.reduced(model) if model != nominal else nominal
    faults = faults_of(scene, nominal, model, fit)
    share = test.share(model) if faults else None
    faults = tuple(replace(fault, explains=share) for fault in faults)
    doubted: tuple[Fault, ...] = ()
    if share is not None and share < LEAST_EXPLAINED:
        faults, doubted, model = (), tuple(map(_doubted, faults)), nominal
    lights = lights_fault(*exchanged_light(reference, model, images))
    faults = (*faults, lights) if lights else faults
    return Diagnosis(model=model, faults=faults, does_not_explain=doubted, means=means)


def _doubted(fault: Fault) -> Fault:
    """Return a fault as what it is when it explains too little."""
    assert fault.explains is not None
    return replace(fault, words=f"{fault.words}: would explain only {100 * fault.explains:.0f} % of what is wrong")


def declared(nominal: DrawnModel, found: DrawnModel, accepted: Sequence[str]) -> DrawnModel:
    """Return what images are judged by: the nominal guess, with what was found of accepted conventions."""
    assert set(accepted) <= set(CONVENTIONS)
    fields = {name: getattr(found, name) for name in accepted}
    if "near" in accepted:
        fields |= {"pivot": found.pivot, "fit": found.fit}
    return replace(nominal, **fields)


def _claims(image: HogelImage) -> bool:
    return bool((image.triangle != NOTHING).any() or np.isfinite(image.position[..., :2]).any())


def _names_objects(image: HogelImage) -> bool:
    return bool((image.object != NOTHING).any())
