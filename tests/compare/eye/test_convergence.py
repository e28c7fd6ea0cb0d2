"""The replayed truth converges to the true view as pitch and pixel angle shrink."""

import math
from dataclasses import replace

import pytest

from tests.support.views import view
from xfrustum.compare.eye_loss import Views, display_loss
from xfrustum.reference.eye import EyeReference
from xfrustum.scenes.model.eye import Eye


@pytest.mark.parametrize(
    ("name", "resolution", "halvings", "moved_order", "wrong_order"),
    [
        # Displacements are bounded by cells and pixels, whose sides halve: convergence is of first
        # order, apart from the random places at which the 7,000 rays meet cells. Wrong surfaces
        # fill strips along silhouettes, no wider than the displacement.
        ("asymmetric", (97, 71), 2, (0.8, 1.2), (0.6, 1.4)),
        *(
            pytest.param(name, (331, 247), 4, (0.9, 1.1), (0.7, 1.3), marks=pytest.mark.slow)
            for name in ("car", "asymmetric")
        ),
    ],
)
def test_the_replayed_truth_tends_to_the_true_view_with_order_one(
    name: str,
    resolution: tuple[int, int],
    halvings: int,
    moved_order: tuple[float, float],
    wrong_order: tuple[float, float],
) -> None:
    eye, moved, wrong = Eye(position=(7.0, -4.0, 500.0), resolution=resolution), [], []
    for times in (2**step for step in range(halvings + 1)):
        scene = view(name)
        plate = replace(scene.plate, hogels=(10 * times, 8 * times))
        frustum = replace(scene.frustum, resolution=(24 * times, 24 * times))
        eyes = EyeReference(replace(scene, plate=plate, frustum=frustum))
        pictures = eyes.true_view(eye, shaded=False), eyes.replayed(eye, shaded=False)
        seen = Views(true=pictures[0], replayed=pictures[1], drawn=None, taken=eyes.replay(eye))
        loss = display_loss(eyes, seen).numbers()
        assert loss.displacement_arcmin is not None and loss.fraction is not None
        moved.append(loss.displacement_arcmin.p50)
        wrong.append(loss.fraction)
    for result, (low, high) in ((moved, moved_order), (wrong, wrong_order)):
        assert low < math.log2(result[0] / result[-1]) / halvings < high
