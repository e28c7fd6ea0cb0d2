"""Globes show one picture in any number of triangles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from xfrustum.reference import Reference
from xfrustum.scenes import NOTHING, InputError
from xfrustum.scenes.arrays import Numbers
from xfrustum.scenes.library.targets import GLOBE_REACH, GLOBES, globes


@pytest.mark.parametrize("triangles", [1000, 10_000, 100_000])
def test_globes_have_exactly_as_many_triangles_as_they_say(triangles: int) -> None:
    scene = globes(triangles, (8, 8))
    assert len(scene.faces) == triangles
    # There are neither slivers without area nor triangles beyond the reach.
    assert (np.linalg.norm(scene.normals, axis=1) > 0.5).all()
    assert np.abs(scene.vertices[:, 2]).max() < GLOBE_REACH
    ends = [
        np.sign([part.vertices[:, 2].min(), part.vertices[:, 2].max()]).tolist() for part in scene.objects
    ]
    assert ends == [[1, 1], [1, 1], [-1, 1], [-1, -1], [-1, -1]], "before, across and behind the plate"


def test_every_vertex_lies_on_its_ellipsoid_whatever_the_number() -> None:
    for triangles in (1000, 32_000):
        for part, (center, semi_axes) in zip(globes(triangles, (8, 8)).objects, GLOBES, strict=True):
            radius = np.linalg.norm((part.vertices - np.array(center)) / np.array(semi_axes), axis=1)
            # The unit globe's coordinates are rounded to 1e-6 of its diameter.
            np.testing.assert_allclose(radius, 1, atol=2 * math.sqrt(3) * 0.5e-6)


def test_silhouettes_of_globes_do_not_depend_on_the_number() -> None:
    """Pixels change only within what the coarsest facets cut off."""
    size = (128, 128)

    def shown(triangles: int) -> Numbers:
        scene = globes(triangles, size)
        return Reference(scene).propose(scene.plate.middle).object

    fine = shown(320_000)
    assert set(np.unique(fine)) == {NOTHING, *range(len(GLOBES))}
    # The length of all outlines in pixels, in steps along rows and columns: never less than it is.
    outline = np.count_nonzero(fine[1:] != fine[:-1]) + np.count_nonzero(fine[:, 1:] != fine[:, :-1])
    # 40 sectors cut off 1 - cos(pi / 40) of a semi-axis, and none is longer than half of the film.
    cut_off_px = (1 - math.cos(math.pi / 40)) * size[0] / 2
    for triangles in (10_000, 32_000):
        assert np.count_nonzero(shown(triangles) != fine) <= cut_off_px * outline
    # Ten sectors cut off sixteen times as much: the bound tells.
    assert np.count_nonzero(shown(1000) != fine) > cut_off_px * outline


@pytest.mark.parametrize("triangles", [0, 10, 9999, 10_010, 10_000_001])
def test_a_number_that_globes_cannot_share_evenly_is_refused(triangles: int) -> None:
    with pytest.raises(InputError, match="cannot be shared"):
        globes(triangles, (8, 8))
