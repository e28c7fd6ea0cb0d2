"""The replayed truth tends to the true view as pitch and angle of pixels shrink.

`python -m pytest tests/compare/eye/test_convergence.py -m slow -s` prints the measured order.
"""

import math
from dataclasses import replace

import pytest

from tests.support.views import view
from xfrustum.compare.eye.loss import Loss, Views, display_loss
from xfrustum.reference.eye.view import EyeReference
from xfrustum.scenes import Scene
from xfrustum.scenes.model.eye import Eye


def refined(scene: Scene, times: int) -> Scene:
    """Return a scene with so many times 10 x 8 hogels of 24 x 24 pixels along each axis."""
    plate = replace(scene.plate, hogels=(10 * times, 8 * times))
    return replace(scene, plate=plate, frustum=replace(scene.frustum, resolution=(24 * times, 24 * times)))


def losses(name: str, eye: Eye, halvings: int) -> list[Loss]:
    """Return what the display loses at each refinement."""
    found = []
    for step in range(halvings + 1):
        scene = refined(view(name), 2**step)
        eyes = EyeReference(scene)
        seen = Views(
            true=eyes.true_view(eye, shaded=False),
            replayed=eyes.replayed(eye, shaded=False),
            drawn=None,
            taken=eyes.replay(eye),
        )
        found.append(display_loss(eyes, seen).numbers())
    return found


def order(first: float, last: float, halvings: int) -> float:
    """Return the power with which a quantity falls."""
    return math.log2(first / last) / halvings


def medians(found: list[Loss]) -> list[float]:
    return [loss.displacement_arcmin.p50 for loss in found if loss.displacement_arcmin is not None]


def test_a_display_of_twice_the_resolution_loses_about_half() -> None:
    found = losses("asymmetric", Eye(position=(7.0, -4.0, 500.0), resolution=(97, 71)), 2)
    moved, wrong = medians(found), [loss.fraction or 0.0 for loss in found]
    assert len(moved) == len(found)
    # The sides of cells and pixels halve, and displacements lie within them: order one, but for chance in
    # which of 7,000 rays meet which part of a cell.
    assert 0.8 < order(moved[0], moved[-1], 2) < 1.2
    # Wrong surfaces lie along silhouettes, within what things are displaced.
    assert 0.6 < order(wrong[0], wrong[-1], 2) < 1.4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["car", "asymmetric"])
def test_the_replayed_truth_tends_to_the_true_view_with_order_one(name: str) -> None:
    found = losses(name, Eye(position=(7.0, -4.0, 500.0), resolution=(331, 247)), 4)
    moved, wrong = medians(found), [loss.fraction or 0.0 for loss in found]
    print(f"\n{name}: hogels 10 x 8 of 24 x 24 pixels, halved four times")  # noqa: T201 - it is asked for
    for step, loss in enumerate(found):
        assert loss.displacement_arcmin is not None
        print(  # noqa: T201
            f"  1/{2**step}: displaced p50 {loss.displacement_arcmin.p50:.4g}', p99 "
            f"{loss.displacement_arcmin.p99:.4g}', wrong surfaces {100 * (loss.fraction or 0.0):.4g} %"
        )
    orders = order(moved[0], moved[-1], 4), order(wrong[0], wrong[-1], 4)
    print(f"  order of displacement {orders[0]:.3f}, of wrong surfaces {orders[1]:.3f}")  # noqa: T201
    assert 0.9 < orders[0] < 1.1
    assert 0.7 < orders[1] < 1.3
