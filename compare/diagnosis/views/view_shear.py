"""The shear of views: views that were registered at another plane than the plate.

An eye at height d sees the plate through a sheared frustum. A renderer that shears its views by a factor f of
what the plate needs registers them at height d (1 - 1/f): there, and not in the plate, the lines of one hogel
meet. Seen from that plane the picture is that of a plate 1/f times as wide, under a screen 1/f times as high.
So one number explains what the fit of geometry would need three groups for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from xfrustum.compare.diagnosis.claims import claims_of
from xfrustum.compare.diagnosis.containment import outside_px
from xfrustum.compare.diagnosis.diagnosis import MIN_FITTED_CLAIMS
from xfrustum.compare.diagnosis.explained import MIN_EXPLAINED_FRACTION, ExplanationTest
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.diagnosis.findings import Findings
from xfrustum.compare.judging.judged import Judging
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.reference import Reference
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene

VIEW_SHEAR = "view-shear"
"""Name of the fault."""

TRIED_FACTORS = np.geomspace(0.4, 2.5, 185)
"""Factors of the shear that are tried: neighbors differ by one percent, by which a picture moves less than by
a pixel where views have a hundred pixels."""

FINER_STEPS = np.linspace(-0.015, 0.015, 61)
"""Relative changes of the best factor that are tried next."""

CAP_PX = 4.0
"""Largest failure of a claim that counts, in pixels: claims under wrong factors fail by any distance."""


def sheared_by(scene: Scene, nominal: DrawnModel, factor: float) -> DrawnModel:
    """Return the model of views that have a factor of the shear that the plate needs; 1 is right."""
    screen = scene.frustum.screen
    assert screen is not None
    return replace(
        nominal,
        pitch=(nominal.pitch[0] / factor, nominal.pitch[1] / factor),
        scene_offset=(0.0, 0.0, screen.height * (1 / factor - 1)),
        screen_height=1 / factor,
    )


def with_view_shear(
    found: Findings, reference: Reference, images: Sequence[HogelImage], nominal: DrawnModel, judging: Judging
) -> Findings:
    """Return findings that name the shear of views where it explains what nothing else does.

    Parameters
    ----------
    found
        Findings about the images without this fault.
    reference
        Reference of the scene.
    images
        Hogels that were put together from views.
    nominal
        Model of the renderer by its author's statements.
    judging
        Rules for what counts as wrong.
    """
    scene, diagnosis = reference.scene, found.diagnosis
    read = [found.encoding.read(reference, image) for image in images]
    claiming = [image for image in read if (image.triangle != NOTHING).any()]
    if diagnosis.faults or not claiming or scene.frustum.screen is None:
        return found
    test = ExplanationTest(reference=reference, images=read, nominal=nominal, judging=judging)
    claims = claims_of(scene, claiming)
    if not test.wrong(nominal) or len(claims) < MIN_FITTED_CLAIMS:
        return found

    def misfit(factor: float) -> float:
        return float(outside_px(claims, scene, sheared_by(scene, nominal, factor), CAP_PX).mean())

    coarse = min(TRIED_FACTORS.tolist(), key=misfit)
    factor = min((coarse * (1 + FINER_STEPS)).tolist(), key=misfit)
    model = sheared_by(scene, nominal, factor)
    share = test.share(model)
    if share is None or share < MIN_EXPLAINED_FRACTION:
        return found
    height = scene.frustum.screen.height * (1 - 1 / factor)
    words = (
        f"views have {factor:.3g} of the shear that the plate needs: they are registered at height "
        f"{height:.4g} {scene.units}"
    )
    fault = Fault(fault=VIEW_SHEAR, value=factor, unit="ratio", words=words, explains=share)
    return replace(found, diagnosis=replace(diagnosis, model=model, faults=(fault,), does_not_explain=()))
