"""Every prediction that is off by more than a factor of 3 comes with its reason."""

import numpy as np
import pytest

from tests.support.views import at, soup, view
from xfrustum.compare.prediction.predict import Predictor
from xfrustum.compare.prediction.reasons import Reason
from xfrustum.compare.run import Evaluator
from xfrustum.reference import Reference
from xfrustum.reports.error_report.sweep import DEFAULT_DEPTHS
from xfrustum.scenes import DoubleFrustum, Pivot
from xfrustum.scenes.model.device_model import LLVMPIPE
from xfrustum.scenes.model.visibility import crosses_plate

MAX_RATIO = 3.0
NEARS = (1e-1, 5e-2, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)  #: near offsets as fractions of the reach


@pytest.mark.parametrize(
    ("name", "reasons"),
    [
        ("car", {Reason.CROSSES, Reason.STARVED}),
        pytest.param("crossing", {Reason.CROSSES}, marks=pytest.mark.slow),
        pytest.param("large-triangles", {Reason.LARGE, Reason.STARVED}, marks=pytest.mark.slow),
        ("sheets", {Reason.STARVED}),
        ("grating", {Reason.PARALLEL}),
        pytest.param("car-recentered", {Reason.CROSSES, Reason.STARVED}, marks=pytest.mark.slow),
    ],
)
def test_no_ratio_is_off_by_more_than_three_without_a_reason(name: str, reasons: set[str]) -> None:
    scene = view(name, (64, 48))
    settings = [
        DoubleFrustum(
            near=near * scene.frustum.longest_reach, depth=depth, mapping=mapping, pivot=pivot
        )
        for pivot in (Pivot if scene.frustum.recentered else (Pivot.APERTURE,))
        for near in NEARS
        for depth, mapping in DEFAULT_DEPTHS
    ]
    named: set[str | None] = set()
    with Evaluator(scene) as judge:
        for hogel in judge.stream(scene.default_apertures(), settings, radiance=False, causes=True):
            for drawing in hogel.drawings:
                predicted, measured = drawing.predicted, drawing.comparison
                assert predicted is not None and measured.surface is not None
                moved, spread, why = (
                    predicted.displacement_px,
                    measured.displacement_px,
                    predicted.reasons,
                )
                named |= {why.displacement, why.surface}
                assert (why.displacement == Reason.CROSSES) <= (moved is None)
                pairs = [(measured.surface.fraction, predicted.surface_fraction, why.surface)]
                if moved and spread:
                    pairs += [
                        (spread.rms, moved.rms, why.displacement),
                        (spread.p99, moved.p99, why.displacement),
                    ]
                for value, other, reason in pairs:
                    near = other / MAX_RATIO <= value <= other * MAX_RATIO
                    assert near or reason, (drawing.settings, value, other)
    assert reasons <= named and (None in named) == (Reason.LARGE not in named)


def test_a_surface_crosses_where_it_meets_the_near_windows() -> None:
    """The triangle cuts the plate along x = 6, |y| <= 1: 6 from one aperture, 5 from another."""
    corners = np.array([[[6.0, -2.0, -1.0], [6.0, 2.0, -1.0], [6.0, 0.0, 1.0]]])
    scene = soup(corners, view("empty", (16, 16)).frustum)
    reference = Reference(scene)
    for aperture, distance in ((at(0, 0), 6.0), (at(1, 0), 5.0)):
        predictor = Predictor(reference.trace(aperture), reference, LLVMPIPE)
        half = reference.camera(aperture).half_extent[0]
        for near, crosses in ((0.99 * distance / half, False), (1.01 * distance / half, True)):
            prediction, links = predictor.predict_each([DoubleFrustum(near=near)])[0]
            assert (prediction.reasons.displacement == Reason.CROSSES) == crosses
            assert not crosses or links[0].displacement_rms_px is None
    flat = soup(corners * [1, 1, 0], scene.frustum)
    assert not crosses_plate(flat, at(0, 0), np.array([99.0, 99.0]))
