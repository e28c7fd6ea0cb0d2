"""How a renderer's pixels are to be read, and how it draws: both are put to the test together."""

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
    """What was found out.

    Attributes
    ----------
    encoding
        How images are to be read; as stated, where no other reading explains what is wrong.
    diagnosis
        Of images read so; the faults of the encoding are among its faults.
    judging
        How images are judged when they are read so.
    """

    encoding: FoundEncoding
    diagnosis: Diagnosis
    judging: Judging


def find_out(
    reference: Reference, images: Sequence[HogelImage], nominal: DrawnModel, judging: Judging
) -> Findings:
    """Find out how a renderer's images are to be read, and how it draws.

    A reading is put to the test together with the diagnosis of what is read by it: of the pixels that are
    wrong as stated, both must explain `MIN_EXPLAINED_FRACTION`. Else neither is a finding.

    Parameters
    ----------
    reference
        Of the scene.
    images
        Some of its hogels as found.
    nominal
        What its author says of it.
    judging
        How images are judged.
    """
    encoding = find_encoding(reference, images, nominal)
    if not encoding.faults:
        return Findings(
            encoding=encoding, diagnosis=diagnose(reference, images, nominal, judging), judging=judging
        )
    read = [encoding.read(image) for image in images]
    # Where numbers were asked for and colors given, nobody has asked for a shading.
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
