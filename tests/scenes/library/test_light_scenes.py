"""The shaded built-in scenes: closed forms that hold, and nothing symmetric that could hide a flip."""

import itertools
import math

import numpy as np
import pytest

from xfrustum.scenes import open_scene
from xfrustum.scenes.appearance.appearance import DEFAULT_LIGHT, DEFAULT_MATERIAL
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.arrays import Floats, Singles
from xfrustum.scenes.library import builtin
from xfrustum.scenes.library.car import surroundings
from xfrustum.scenes.library.targets import (
    BACKDROP_HEIGHT,
    COARSE,
    FINE,
    GRATING_HEIGHT,
    GRATING_LEAN,
    MIRROR_SPHERES,
)
from xfrustum.scenes.model.effects import Effect, needed

SHADED = ("car-studio", "mirror-sphere", "grating")

ONE_MICROMETER = 1e-3
"""Vertices of lathes are rounded to a micrometer in scenes of millimeters: half of it along each axis."""


def directions(radiance: Singles) -> Floats:
    """Return (H, W, 3) where each pixel of a map lies, by CONVENTIONS.md: the middle -z, up +y, right +x."""
    height, width = radiance.shape[:2]
    up = np.pi / 2 - np.pi * (np.arange(height) + 0.5) / height
    right = 2 * np.pi * (np.arange(width) + 0.5) / width - np.pi
    y, along = np.broadcast_arrays(np.sin(up)[:, None], right[None, :])
    level = np.cos(up)[:, None]
    return np.stack([level * np.sin(along), y, -level * np.cos(along)], axis=-1)


@pytest.mark.parametrize("name", [name for name in builtin.names() if name not in SHADED])
def test_the_other_scenes_have_the_default_look_and_ask_for_nothing(name: str) -> None:
    scene = open_scene(name)
    assert scene.appearance.lights == (DEFAULT_LIGHT,)
    assert scene.appearance.environment is None
    assert (scene.sampling, scene.transport) == (Sampling(), Transport())
    assert set(scene.materials) <= {DEFAULT_MATERIAL}
    assert scene.surface.vertex_normals is None


def test_no_flip_or_swap_of_axes_leaves_the_surroundings_as_they_are() -> None:
    """Each of the 47 other signed permutations of the axes changes the radiance of some directions."""
    radiance = surroundings(64).radiance
    towards = directions(radiance)
    height, width = radiance.shape[:2]
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            if order == (0, 1, 2) and signs == (1, 1, 1):
                continue
            x, y, z = np.moveaxis(towards[..., order] * signs, -1, 0)
            row = np.clip((0.5 - np.arcsin(y) / np.pi) * height, 0, height - 1).astype(int)
            column = ((np.arctan2(x, -z) / (2 * np.pi) + 0.5) * width).astype(int) % width
            changed = np.abs(radiance[row, column] - radiance).max(axis=2) > 0.1
            assert changed.mean() > 0.01, (order, signs)


def test_the_mirror_spheres_are_spheres_with_normals_along_their_radii() -> None:
    scene = open_scene("mirror-sphere")
    assert needed(scene) >= {Effect.C, Effect.C_STAR, Effect.REFLECTION, Effect.SMOOTH_NORMALS}
    assert not needed(scene) & {Effect.AMBIENT, Effect.DIFFUSE, Effect.SPECULAR}
    for part, (center, radius) in zip(scene.objects, MIRROR_SPHERES, strict=True):
        assert part.vertex_normals is not None
        outward = part.vertices - np.array(center)
        assert np.abs(np.linalg.norm(outward, axis=1) - radius).max() < ONE_MICROMETER
        # Sums of coordinates of up to 84: half a unit in the last place of those.
        np.testing.assert_allclose(part.vertex_normals, outward, atol=np.spacing(128.0))
        a, b, c = np.moveaxis(part.vertices[part.faces], 1, 0)
        agree = np.einsum("fx,fcx->fc", np.cross(b - a, c - a), part.vertex_normals[part.faces])
        assert (agree > 0).all(), "the winding faces outward"


def test_no_mirror_sphere_hides_the_other_from_the_middle_aperture() -> None:
    (back, back_radius), (front, front_radius) = ((np.array(c), r) for c, r in MIRROR_SPHERES)
    assert back[2] + back_radius < 0 < front[2] - front_radius
    # Lines through the origin: the angle between the axes of the two cones, one of them turned around.
    cosine = -(back @ front) / np.linalg.norm(back) / np.linalg.norm(front)
    cones = sum(math.asin(r / np.linalg.norm(c)) for c, r in ((back, back_radius), (front, front_radius)))
    assert math.acos(cosine) > cones


def test_the_grating_is_finer_than_the_pitch_in_one_half_and_coarser_in_the_other() -> None:
    scene = open_scene("grating")
    assert scene.appearance.lights == ()
    assert needed(scene) == {Effect.C, Effect.C_STAR, Effect.VERTEX_COLORS, Effect.AMBIENT}
    pitches = [extent / count for extent, count in zip(scene.plate.size, scene.plate.hogels, strict=True)]
    for part, axis, height in zip(scene.objects, (0, 1), (GRATING_HEIGHT, BACKDROP_HEIGHT), strict=True):
        assert part.vertex_colors is not None
        assert (part.vertices[:, 2] == height).all()
        # Two ends of a bar follow each other; coordinates of sheets are rounded to 1e-6.
        leaning = part.vertices[:, axis] - GRATING_LEAN * part.vertices[:, 1 - axis]
        ends, shades = leaning.reshape(-1, 2), part.vertex_colors.reshape(-1, 2, 3)
        np.testing.assert_allclose(ends[:, 0], ends[:, 1], atol=3e-6)
        order = np.argsort(ends[:, 0])
        along, turns = ends[order].mean(axis=1), shades[order, 0, 0]
        assert (shades == shades[:, :1, :1]).all(), "gray, and one shade along a bar"
        assert (np.abs(np.diff(turns)) == 1).all(), "black and white in turn"
        middle = int(np.argmin(np.abs(along)))
        assert abs(along[middle]) < 3e-6
        assert turns[middle] == 0
        halves = along[: middle + 1], along[middle:]
        for half, period in zip(halves, (FINE, COARSE) if axis == 0 else (COARSE, FINE), strict=True):
            np.testing.assert_allclose(np.diff(half), period * pitches[axis] / 2, atol=6e-6)
