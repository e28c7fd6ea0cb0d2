"""Two parallel sheets at the farthest visible surface of every camera and slab, to be drawn and counted.

Each camera's film is tiled with cells that the pairs of its slabs share: each pair has cells all over the
film, and no cell hides another, so that all slabs are seen in one picture of each camera. Each pair comes
twice, the sheet that must not show drawn first and drawn last.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.planning.views import View
from xfrustum.raster import Rasterizer
from xfrustum.reference.lines.lines import ModelCamera, model_cameras
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum

CELLS, CELL_PIXELS = 32, 8
"""Cells along each side of the film, and pixels along each side of a cell."""

SPREAD, SPREAD_SEPARATIONS = 0.02, 4.0
"""Over how much of their height |z|, and over at least how many separations, the cells of a sheet are
spread toward the plate, so that not all their depths round alike."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two sheets of one camera's slab.

    Attributes
    ----------
    camera
        The camera that draws them.
    low, high
        Heights |z| that the sheets lie between.
    loser_first
        Whether the sheet that must not show is drawn first.
    """

    camera: ModelCamera
    low: float
    high: float
    loser_first: bool


def misordered(scene: Scene, view: View, settings: DoubleFrustum, separation: float) -> float:
    """Draw sheets a separation apart, and return the largest share of a pair's pixels that is wrong.

    Parameters
    ----------
    scene
        Its frustum, and its plate.
    view
        What is seen from the aperture, and so where its farthest surfaces are.
    settings
        Of the cameras.
    separation
        Along z, scene units.

    Returns
    -------
    Share of pixels in which the wrong sheet shows, or none; 0 where no slab has room for two sheets.
    """
    worst = 0.0
    for orthoscopic in (True, False):
        pairs = list(_pairs(scene, view, settings, separation, orthoscopic=orthoscopic))
        if pairs:
            only = replace(settings, camera=Camera.C if orthoscopic else Camera.C_STAR)
            worst = max(worst, *_wrong_shares(scene, view, only, pairs, separation))
    return worst


def _pairs(
    scene: Scene, view: View, settings: DoubleFrustum, separation: float, *, orthoscopic: bool
) -> Iterator[Pair]:
    """Yield the pairs of C or of C*: of every slab that shows a surface and has room for two."""
    side = Camera.C if orthoscopic else Camera.C_STAR
    for camera in model_cameras(scene.frustum, view.aperture, settings):
        if camera.orthoscopic is not orthoscopic:
            continue
        low, high = sorted(abs(height) for height in camera.heights)
        far = view.farthest(side, low, high)
        if far is None or far - separation <= low:
            continue
        spread = max(SPREAD * far, SPREAD_SEPARATIONS * separation)
        room = (far - separation - low) / 2
        for loser_first in (True, False):
            yield Pair(camera=camera, low=far - min(spread, room), high=far, loser_first=loser_first)


def _wrong_shares(
    scene: Scene, view: View, settings: DoubleFrustum, pairs: list[Pair], separation: float
) -> list[float]:
    """Draw some pairs with one camera and return the share of each one's pixels that is wrong."""
    random = np.random.default_rng(1997)
    owner = random.permutation(np.arange(CELLS**2) % len(pairs)).reshape(CELLS, CELLS)
    objects, winners = [], []
    for number, pair in enumerate(pairs):
        rows, columns = np.nonzero(owner == number)
        height = random.uniform(pair.low, pair.high, len(rows))
        farther, nearer = (_sheet(pair.camera, rows, columns, h) for h in (height, height - separation))
        # C keeps the nearer, C* the farther.
        loser, winner = (farther, nearer) if pair.camera.orthoscopic else (nearer, farther)
        objects += [loser, winner] if pair.loser_first else [winner, loser]
        winners.append(2 * number + (1 if pair.loser_first else 0))
    frustum = replace(scene.frustum, resolution=(CELLS * CELL_PIXELS, CELLS * CELL_PIXELS))
    sheets = Scene(name="sheets", plate=scene.plate, frustum=frustum, objects=tuple(objects))
    with Rasterizer(sheets) as rasterizer:
        drawn = rasterizer.render(view.aperture, settings, normals=False, color=False)
    pixel_owner = np.kron(owner, np.ones((CELL_PIXELS, CELL_PIXELS), dtype=np.int64))
    wrong = drawn.object != np.asarray(winners)[pixel_owner]
    return [float(wrong[pixel_owner == number].mean()) for number in range(len(pairs))]


def _sheet(camera: ModelCamera, rows: Indices, columns: Indices, heights: Floats) -> SceneObject:
    """Return cells of a camera's film as squares parallel to the plate, each at a height |z| of its own."""
    pencil = camera.pencil
    at = np.array([(0, 0), (0, 1), (1, 1), (1, 0)])
    u = 2 * (columns[:, None] + at[:, 1]) / CELLS - 1
    v = 1 - 2 * (rows[:, None] + at[:, 0]) / CELLS
    z = np.broadcast_to((-heights if camera.orthoscopic else heights)[:, None], u.shape)
    s = pencil.center[2] - z
    slopes = [pencil.shear[0] + u * pencil.half_extent[0], pencil.shear[1] + v * pencil.half_extent[1]]
    corners = np.stack((pencil.center[0] + s * slopes[0], pencil.center[1] + s * slopes[1], z), axis=-1)
    cells = np.arange(4 * len(rows)).reshape(-1, 4)
    faces = np.concatenate((cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]))
    return SceneObject(name="sheet", vertices=corners.reshape(-1, 3), faces=faces)
