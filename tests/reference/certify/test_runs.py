"""Runs of triangles that a ray bundle surely misses: nothing that its film may show is left out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.long_tail import examples
from tests.support.strategies import apertures, frusta
from tests.support.views import at, view
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.lines import RayBundle, crossed_frustum, model_cameras, places_off_center
from xfrustum.scenes import Aperture, DoubleFrustum, Frustum
from xfrustum.scenes.arrays import Floats, Mask


def shown(points: Floats, bundle: RayBundle) -> Mask:
    """Return the mask of points (N, 3) that lie on the film and in the range of a bundle."""
    x, y, z = points.T
    s = bundle.center[2] - z
    width, height = bundle.resolution
    with np.errstate(divide="ignore", invalid="ignore"):
        column, row = places_off_center(x, y, z, bundle)
    film = (np.abs(column - (width - 1) / 2) <= width / 2) & (
        np.abs(row - (height - 1) / 2) <= height / 2
    )
    return np.asarray(film & (s >= bundle.s_range[0]) & (s <= bundle.s_range[1]))


def check(corners: Floats, bundle: RayBundle, random: np.random.Generator) -> float:
    """Test that points of omitted triangles are not shown; return the share of kept triangles."""
    before = Triangles(corners).before(bundle)
    assert (np.diff(before) > 0).all()
    shares = random.dirichlet((0.5, 0.5, 0.5), (len(corners), 20))
    points = np.einsum("fnk,fkc->fnc", shares, corners)
    seen = shown(points.reshape(-1, 3), bundle).reshape(len(corners), -1).any(axis=1)
    assert np.isin(np.flatnonzero(seen), before).all()
    return len(before) / len(corners)


@examples(30)
@given(frustum=frusta(), aperture=apertures(), seed=st.integers(0, 1 << 30))
def test_no_point_of_a_left_out_run_is_on_the_film(
    frustum: Frustum, aperture: Aperture, seed: int
) -> None:
    bundle = crossed_frustum(frustum, aperture)
    random = np.random.default_rng(seed)
    # Clusters of small triangles on both sides, some of them at the film's border.
    middles = random.uniform(-9, 9, (12, 3))
    corners = np.repeat(middles, 25, axis=0)[:, None] + random.normal(0, 0.5, (300, 3, 3))
    check(corners, bundle, random)


@pytest.mark.parametrize("name", ["car", "asymmetric-recentered", "crossing"])
def test_cameras_of_one_side_skip_most_runs_of_the_other(name: str) -> None:
    scene, random = view(name, (16, 16)), np.random.default_rng(5)
    settings = DoubleFrustum(near=1e-3 * scene.frustum.longest_reach)
    shares = [
        check(scene.triangles, camera.bundle, random)
        for camera in model_cameras(scene.frustum, at(0.3, 0.2), settings)
    ]
    assert sum(shares) < 1.2
