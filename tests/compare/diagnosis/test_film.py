"""Classic mistakes of film and color are named from the images; other mistakes do not get their names."""

import numpy as np
import pytest

from tests.support.foreign_renderers import oblong
from xfrustum.compare.diagnosis.diagnosis import Evidence, diagnose
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.reference import Reference
from xfrustum.scenes.appearance.display import encoding_curve
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.files.foreign_images import Encoding, StoredPixels, of_stored

FEW = [(0, 0), (4, 1), (2, 3)]


def by_name(evidence: Evidence) -> dict[str, Fault]:
    return {fault.fault: fault for fault in diagnose(evidence).diagnosis.faults}


def linear(radiance: Floats) -> Floats:
    return radiance


def gamma(radiance: Floats) -> Floats:
    return radiance ** (1 / 2.2)


def twice(radiance: Floats) -> Floats:
    return np.asarray(encoding_curve(encoding_curve(radiance)))


@pytest.mark.parametrize(
    ("written", "stated", "expected"),
    [
        (encoding_curve, Encoding.RGB, ("wrong-encoding", "srgb")),
        pytest.param(linear, Encoding.SRGB, ("wrong-encoding", "rgb"), marks=pytest.mark.slow),
        pytest.param(gamma, Encoding.RGB, ("wrong-transfer", "gamma 2.2"), marks=pytest.mark.slow),
        pytest.param(twice, Encoding.SRGB, ("wrong-transfer", "sRGB, encoded twice"), marks=pytest.mark.slow),
        # Half as bright is no transfer function.
        pytest.param(lambda radiance: radiance / 2, Encoding.RGB, None, marks=pytest.mark.slow),
    ],
)
def test_colors_through_another_curve_are_read_through_it(
    written: object, stated: Encoding, expected: tuple[str, str] | None
) -> None:
    assert callable(written)
    scene = oblong()
    reference, images = Reference(scene), []
    for index in FEW:
        truth = reference.trace(scene.plate.aperture(*index))
        assert truth.color is not None
        stored = np.rint(255 * written(np.clip(truth.color, 0.0, 1.0))).astype(np.uint8)
        images.append(of_stored(StoredPixels(rgb=stored), truth.camera, stated))
    found = by_name(Evidence(reference=reference, images=images, nominal=DrawnModel()))
    assert [(name, fault.value) for name, fault in found.items()] == ([expected] if expected else [])
