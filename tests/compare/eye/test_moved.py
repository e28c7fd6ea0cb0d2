"""Theorem of docs/method.md: the near offset shows the viewer a scene with a gap at the plate."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.long_tail import examples
from tests.support.moved_scene import moved_scene, replayed_points
from tests.support.views import at, reversed_d32f, view
from xfrustum.compare.noticeable import moves_rigidly, replayed_distance
from xfrustum.raster.cameras import MAPPINGS, clip_from_scene, slab_cameras
from xfrustum.reference import Reference
from xfrustum.reference.lines import crossed_frustum, model_cameras, pixel_places
from xfrustum.scenes import Aperture, DoubleFrustum, Frustum, Pivot, Screen
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate import Fit

REACH = 12.0
WIDTH = 64

#: Largest rounding difference of two film positions, relative to them: about twenty roundings of
#: 1e-16, enlarged at most 1e4 times by differences of nearly equal lengths
ROUNDING_PX = 1e-9

CENTERED = Frustum(
    resolution=(WIDTH, WIDTH), reach=(REACH, REACH), fov=(math.radians(50), math.radians(40))
)
RECENTERED = Frustum(
    resolution=(WIDTH, WIDTH),
    reach=(REACH, REACH),
    screen=Screen(height=-9.0, center=(0.5, -0.25), size=(8.0, 6.0)),
)
IN_FRONT = replace(RECENTERED, screen=Screen(height=7.0, center=(0.0, 0.5), size=(8.0, 6.0)))

LATERAL = st.floats(-6, 6)
APERTURES = st.builds(at, LATERAL, LATERAL)
DISTANCES = st.floats(0.01, REACH)
#: 1 for points behind the plate, drawn by C; -1 for points before it, drawn by C*
SIDES = st.sampled_from([1, -1])

SETTINGS = st.builds(
    DoubleFrustum,
    near=st.floats(0.01, 3),
    pivot=st.sampled_from(["aperture", "camera"]),
    fit=st.sampled_from([None, "angle", 2.5, 8.0]),
    slabs=st.sampled_from([(), (4.0,), (1.5, 6.0)]),
)


def drawn_places(
    point: Floats, frustum: Frustum, aperture: Aperture, how: DoubleFrustum
) -> tuple[Floats, Floats]:
    """Return a point's film position from the reference's lines and the raster's matrices."""
    height = float(point[0, 2])
    lines = [
        camera.bundle
        for camera in model_cameras(frustum, aperture, how)
        if camera.heights[0] <= height <= camera.heights[1]
    ]
    # Two slabs contain a point at a cut; take the inner slab.
    bundle = max(lines, key=lambda item: abs(item.center[2]))
    inner = next(
        camera
        for camera in sorted(
            slab_cameras(frustum, how, orthoscopic=height < 0), key=lambda item: item.heights[0]
        )
        if camera.heights[0] <= abs(height) <= camera.heights[1]
    )
    matrix = clip_from_scene(frustum, aperture, inner, how.pivot, MAPPINGS[how.mapping].ends)
    clip = matrix @ np.append(point[0], 1.0)
    u, v = clip[:2] / clip[3]
    return pixel_places(point, bundle), np.array([[u + 1, 1 - v]]) * WIDTH / 2 - 0.5


@examples(150)
@given(
    frustum=st.sampled_from([CENTERED, RECENTERED, IN_FRONT]),
    aperture=APERTURES,
    how=SETTINGS,
    where=st.tuples(LATERAL, LATERAL, DISTANCES, SIDES),
)
def test_a_point_is_drawn_where_its_moved_point_truly_belongs(
    frustum: Frustum, aperture: Aperture, how: DoubleFrustum, where: tuple[float, float, float, int]
) -> None:
    x, y, distance, side = where
    point = np.array([[x, y, -side * distance]])
    moved = replayed_points(point, frustum, aperture, how, side)
    true = pixel_places(moved, crossed_frustum(frustum, aperture))
    for drawn in drawn_places(point, frustum, aperture, how):
        assert np.abs(drawn - true).max() <= ROUNDING_PX * (1 + np.abs(true).max())


@given(near=st.floats(0.01, 3), first=st.floats(1, 6), beyond=st.floats(0.001, 6))
def test_halves_move_by_n_and_with_cuts_the_first_slab_alone(
    near: float, first: float, beyond: float
) -> None:
    """A fit to the first cut leaves no seam there."""
    whole = DoubleFrustum(near=near)
    fitted = replace(whole, slabs=(first,))
    assert replayed_distance(np.array(first), RECENTERED, whole) == first + near
    inside, outside = replayed_distance(np.array([first, first + beyond]), CENTERED, fitted)
    assert math.isclose(inside, first, rel_tol=1e-14)
    assert outside == first + beyond
    # If the angle is kept instead, the first slab ends n beyond the cut, with a seam.
    seam = replayed_distance(np.array(first), CENTERED, replace(fitted, fit=Fit.ANGLE))
    assert seam == first + near


def test_halves_move_rigidly_unless_the_shear_differs_between_apertures() -> None:
    """With pivot `aperture`, points move along the shear; a centered frustum has none."""
    paper, straight = (DoubleFrustum(near=1.0, pivot=pivot) for pivot in Pivot)
    assert moves_rigidly(CENTERED, paper) and not moves_rigidly(RECENTERED, paper)
    assert moves_rigidly(CENTERED, straight) and moves_rigidly(RECENTERED, straight)


#: Near offset, a twenty-fifth of the scenes' reach of 150, with clearly visible errors
NEAR = 6.0


@pytest.mark.parametrize(
    ("name", "how"),
    [("asymmetric", {}), ("asymmetric", {"fit": 20.0}), ("car", {"slabs": (20.0,)})],
    ids=str,
)
def test_the_cameras_draw_the_true_picture_of_the_moved_scene(
    name: str, how: dict[str, object]
) -> None:
    scene = view(name, (96, 96))
    drawn_by = replace(reversed_d32f(NEAR), **how)  # type: ignore[arg-type]  # fields by name
    moved = moved_scene(scene, drawn_by)
    aperture = scene.plate.aperture(scene.plate.hogels[0] // 3, scene.plate.hogels[1] // 3)
    drawn = Reference(scene).trace_model(aperture, drawn_by, shaded=False).triangle
    seen = Reference(moved.scene).trace(aperture).triangle
    truth = Reference(scene).trace(aperture).triangle
    # The last entry stands for no surface, -1.
    seen = np.append(moved.number, -1)[seen]
    assert (drawn != truth).mean() > 0.2
    # Cuts and moves are rounded by about 1e-16 of the reach: no line of these films comes so near
    # to an edge.
    assert (drawn != seen).sum() == 0
