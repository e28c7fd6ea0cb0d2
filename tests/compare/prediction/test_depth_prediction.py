"""The smallest separation of two sheets that a depth buffer orders: predicted and measured."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm

from tests.support.long_tail import thinned
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION, smallest_separation
from xfrustum.raster import Rasterizer
from xfrustum.scenes import (
    Camera,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Frustum,
    Plate,
    Scene,
    SceneObject,
)
from xfrustum.scenes.arrays import Floats

PIXELS, REACH, FOV = 64, 1000.0, math.radians(60)
SLOPE = math.tan(FOV / 2)
CELLS = 16
"""Cells along each side of the film: a sheet has 512 triangles."""

SETTINGS = [(depth, mapping) for depth in DepthFormat for mapping in DepthMapping]
PLACES = [(1.0, 3.0), (1.0, 400.0), (0.01, 3.0), (0.01, 50.0)]
"""Near, and height |z| of the sheets: far from the near plane and close to it, down to 1e-5 of the reach."""

WINNER = {Camera.C: 1, Camera.C_STAR: 3}
FACTOR = 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Sheet:
    """A sheet that covers the film of both cameras.

    `tilt` is the change of |z| along x and y; None for a sheet parallel to the plate, whose cells
    then lie a few percent apart, so that all their depths do not round alike.
    """

    near: float
    height: float
    tilt: tuple[float, float] | None

    def distance(self, u: Floats, v: Floats) -> Floats:
        """Return w, where the lines of a camera's film meet a tilted plane."""
        assert self.tilt is not None
        return (self.height + self.near) / (1 - SLOPE * (u * self.tilt[0] + v * self.tilt[1]))

    def corners(self) -> Floats:
        """Return the cells (N, 4, 3): film coordinates u, v and distance w, as a camera sees them."""
        edges = np.linspace(-1, 1, CELLS + 1)
        at = np.array([(0, 0), (0, 1), (1, 1), (1, 0)])
        row, column = np.divmod(np.arange(CELLS**2), CELLS)
        u, v = edges[column[:, None] + at[:, 0]], edges[row[:, None] + at[:, 1]]
        if self.tilt is None:
            phases = np.random.default_rng(4).uniform(-0.05, 0.05, (CELLS**2, 1))
            w = np.broadcast_to(self.height * (1 + phases) + self.near, u.shape)
        else:
            w = self.distance(u, v)
        return np.stack((u, v, w), axis=-1)

    def moved(self, separation: float) -> Floats:
        """Return the cells of a parallel sheet farther away, seen at the same places of the film."""
        corners = self.corners()
        grows = 1.0 if self.tilt is None else corners[..., 2] / (self.height + self.near)
        corners[..., 2] += separation * grows
        return corners

    def seen(self) -> Floats:
        """Return distances w from the camera at some places of the film."""
        if self.tilt is None:
            return np.asarray(self.corners()[..., 2].ravel())
        centers = (2 * np.arange(PIXELS) + 1) / PIXELS - 1
        return self.distance(centers[None, :], centers[:, None])


def scene_of(sheet: Sheet, distance: float) -> Scene:
    """Return two sheets on either side of the plate, each time first the one that must not show."""
    nearer, farther = sheet.corners(), sheet.moved(distance)
    return Scene(
        name="sheets",
        plate=Plate(size=(1, 1), hogels=(1, 1)),
        frustum=Frustum(resolution=(PIXELS, PIXELS), reach=(REACH, REACH), fov=(FOV, FOV)),
        objects=tuple(
            as_object(corners, sheet.near, side)
            for corners, side in ((farther, -1), (nearer, -1), (nearer, 1), (farther, 1))
        ),
    )


def as_object(corners: Floats, near: float, side: int) -> SceneObject:
    u, v, w = np.moveaxis(corners, -1, 0)
    # The film shows surfaces before the plate upside down and mirrored.
    points = np.stack((-side * u * SLOPE * w, -side * v * SLOPE * w, side * (w - near)), axis=-1)
    points = points.reshape(-1, 3)
    cells = np.arange(len(points)).reshape(-1, 4)
    return SceneObject(
        name="sheet", vertices=points, faces=np.concatenate((cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]))
    )


def predicted(sheet: Sheet, depth: DepthFormat, mapping: DepthMapping) -> float:
    """Return the separation along z at which the allowed fraction of pixels is predicted to be wrong.

    Where tilted sheets lie at w, they are w / (h + n) times as far apart. Errors are close to normal,
    so that a pixel's own chance follows from the separation that would leave it `MAX_MISORDERED_FRACTION`.
    """
    w = sheet.seen()
    there = smallest_separation(w, sheet.near, sheet.near + REACH, depth, mapping)
    if sheet.tilt is not None:
        there *= (sheet.height + sheet.near) / w
    certain = norm.isf(MAX_MISORDERED_FRACTION)

    def excess(distance: float) -> float:
        return float(norm.sf(certain * distance / there).mean()) - MAX_MISORDERED_FRACTION

    return float(brentq(excess, 0.5 * there.min(), 2 * there.max()))


def misordered(
    sheet: Sheet, distance: float, depth: DepthFormat, mapping: DepthMapping
) -> dict[Camera, float]:
    """Draw two sheets with C and with C*, and return the share of pixels that show the wrong one."""
    scene = scene_of(sheet, distance)
    shares = {}
    with Rasterizer(scene) as raster:
        for camera, winner in WINNER.items():
            settings = DoubleFrustum(near=sheet.near, depth=depth, mapping=mapping, camera=camera)
            drawn = raster.render(scene.plate.middle, settings, normals=False, color=False)
            shares[camera] = float((drawn.object != winner).mean())
    return shares


def random_tilts(count: int) -> list[tuple[float, float]]:
    """Return tilts of up to 30 degrees in any direction."""
    random = np.random.default_rng(1997)
    slope = np.tan(np.radians(random.uniform(5, 30, count)))
    turn = random.uniform(0, 2 * np.pi, count)
    return [(float(s * np.cos(a)), float(s * np.sin(a))) for s, a in zip(slope, turn, strict=True)]


TILTS = [None, *random_tilts(2)]


@pytest.mark.parametrize(
    ("depth", "mapping", "near", "height", "tilt"),
    thinned(
        ((*one, *two, tilt) for one in SETTINGS for two in PLACES for tilt in [None, *random_tilts(2)]), 5
    ),
)
def test_smallest_ordered_separation_is_as_predicted(
    near: float, height: float, tilt: tuple[float, float] | None, depth: DepthFormat, mapping: DepthMapping
) -> None:
    """Twice the predicted separation orders all but a percent, half of it less: for C and for C*."""
    sheet = Sheet(near=near, height=height, tilt=tilt)
    distance = predicted(sheet, depth, mapping)
    assert max(misordered(sheet, FACTOR * distance, depth, mapping).values()) <= MAX_MISORDERED_FRACTION
    assert min(misordered(sheet, distance / FACTOR, depth, mapping).values()) > MAX_MISORDERED_FRACTION
