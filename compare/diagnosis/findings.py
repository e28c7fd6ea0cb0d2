"""The reading of a renderer's pixels and the way it draws, tested together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from xfrustum.compare.diagnosis.diagnosis import Diagnosis, diagnose, doubtful
from xfrustum.compare.diagnosis.encodings import FoundEncoding, find_encoding
from xfrustum.compare.diagnosis.explained import MIN_EXPLAINED_FRACTION, ExplanationTest
from xfrustum.compare.judging.judged import Compared, Judging
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.reference import Reference
from xfrustum.scenes.model.hogel_image import HogelImage


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """The reading of a renderer's images, and their diagnosis under this reading.

    Attributes
    ----------
    encoding
        The way to read the images; the stated one where no other reading explains the wrong pixels.
    diagnosis
        Diagnosis of the images in this reading; its faults include those of the encoding.
    judging
        Rules by which the images are judged in this reading.
    """

    encoding: FoundEncoding
    diagnosis: Diagnosis
    judging: Judging


def find_out(
    reference: Reference, images: Sequence[HogelImage], nominal: DrawnModel, judging: Judging
) -> Findings:
    """Find the reading of a renderer's images and the way it draws.

    A reading is tested together with the diagnosis of the images in this reading: together they must explain
    `MIN_EXPLAINED_FRACTION` of the pixels that are wrong as stated. Otherwise neither is a finding.

    Parameters
    ----------
    reference
        Reference of the scene.
    images
        Some of the renderer's hogels as found.
    nominal
        Model of the renderer by its author's statements.
    judging
        Rules by which images are judged.
    """
    encoding = find_encoding(reference, images, nominal)
    if not encoding.faults:
        return Findings(
            encoding=encoding, diagnosis=diagnose(reference, images, nominal, judging), judging=judging
        )
    read = [encoding.read(reference, image) for image in images]
    # Where numbers were asked for and colors are found, shading was not asked for: only geometry counts.
    judged = replace(judging, compared=Compared.GEOMETRY) if encoding.as_colors else judging
    diagnosis = diagnose(reference, read, nominal, judged)
    before = ExplanationTest(reference=reference, images=images, nominal=nominal, judging=judging)
    after = replace(before, images=read, judging=judged, known={})
    wrong = before.wrong(nominal)
    share = max(0.0, 1.0 - after.unexplained(diagnosis.model) / wrong) if wrong else 0.0
    faults = tuple(replace(fault, explains=share) for fault in (*encoding.faults, *diagnosis.faults))
    if share >= MIN_EXPLAINED_FRACTION:
        return Findings(encoding=encoding, diagnosis=replace(diagnosis, faults=faults), judging=judged)
    stated = diagnose(reference, images, nominal, judging)
    doubted = (*map(doubtful, faults), *stated.does_not_explain)
    return Findings(
        encoding=FoundEncoding(), diagnosis=replace(stated, does_not_explain=doubted), judging=judging
    )
