"""Two parallel sheets at the far end of a camera, drawn and counted: does a depth buffer tell them apart?

A camera's film is tiled with cells, and each cell belongs to one pair of sheets. Each pair has cells all
over the film, and no cell hides another, so that all pairs of a camera are seen in one picture.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.planning.views import View
from xfrustum.raster import Rasterizer
from xfrustum.reference.lines.lines import ModelCamera, model_cameras
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

PLAN_CELLS, PLAN_CELL_PIXELS = 32, 8
"""Cells along each side of the film in a plan's experiment, and pixels along each side of a cell."""

SPREAD, SPREAD_SEPARATIONS = 0.02, 4.0
"""Share of their height |z|, and least number of separations, over which the cells of a sheet are spread
toward the plate, so that not all their depths round alike."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SheetPair:
    """Two sheets, parallel to the plate, of one camera.

    Attributes
    ----------
    camera
        The camera that draws them.
    heights
        (N,) |z| of the farther sheet, for each of the pair's cells row by row.
    separation
        Distance of the two sheets along z, scene units.
    loser_first
        Whether the sheet that must not show is drawn first.
    """

    camera: ModelCamera
    heights: Floats
    separation: float
    loser_first: bool

    def objects(self, rows: Indices, columns: Indices, cells: int) -> list[SceneObject]:
        """Return both sheets in drawing order, over the cells in some rows and columns of the film."""
        farther, nearer = (
            _sheet(self.camera, rows, columns, height, cells)
            for height in (self.heights, self.heights - self.separation)
        )
        # C keeps the nearer, C* the farther.
        loser, winner = (farther, nearer) if self.camera.orthoscopic else (nearer, farther)
        return [loser, winner] if self.loser_first else [winner, loser]


@dataclass(frozen=True, kw_only=True, eq=False)
class SheetFilm:
    """A camera's film tiled with cells of pairs of sheets.

    Attributes
    ----------
    scene
        The sheets alone.
    aperture
        The aperture that they are seen from.
    pair
        (H, W) number of the pair that each pixel belongs to.
    shown
        (H, W) number of the object that each pixel must show.
    """

    scene: Scene
    aperture: Aperture
    pair: Indices
    shown: Indices

    @classmethod
    def of(
        cls, scene: Scene, aperture: Aperture, pairs: Sequence[SheetPair], owner: Indices, cell_pixels: int
    ) -> SheetFilm:
        """Tile the film of an aperture.

        Parameters
        ----------
        scene
            Scene that gives the plate and the frustum.
        aperture
            The aperture that the pairs' cameras belong to.
        pairs
            All pairs, each with a height for each of its cells.
        owner
            (cells, cells) number of the pair that each cell belongs to.
        cell_pixels
            Pixels along each side of a cell.
        """
        cells, objects = len(owner), []
        for number, pair in enumerate(pairs):
            rows, columns = np.nonzero(owner == number)
            objects += pair.objects(rows, columns, cells)
        frustum = replace(scene.frustum, resolution=(cells * cell_pixels, cells * cell_pixels))
        of_pixel = np.kron(owner, np.ones((cell_pixels, cell_pixels), dtype=np.int64))
        winners = np.array([2 * number + pair.loser_first for number, pair in enumerate(pairs)])
        return cls(
            scene=Scene(name="sheets", plate=scene.plate, frustum=frustum, objects=tuple(objects)),
            aperture=aperture,
            pair=of_pixel,
            shown=winners[of_pixel],
        )

    def wrong_shares(self, rasterizer: Rasterizer, settings: DoubleFrustum) -> list[float]:
        """Draw the sheets and return, for each pair, the share of its pixels that is wrong.

        Parameters
        ----------
        rasterizer
            Rasterizer of `scene`.
        settings
            Settings in which only the pairs' camera draws.
        """
        drawn = rasterizer.render(self.aperture, settings, normals=False, color=False)
        wrong = drawn.object != self.shown
        return [float(wrong[self.pair == number].mean()) for number in range(len(self.scene.objects) // 2)]


def misordered(scene: Scene, view: View, settings: DoubleFrustum, separation: float) -> float:
    """Draw sheets at the farthest visible surface of every camera and slab, and return the worst share.

    Each pair comes twice, the sheet that must not show drawn first and drawn last.

    Parameters
    ----------
    scene
        Scene that gives the plate and the frustum.
    view
        Truth of the aperture, which says where its farthest surfaces are.
    settings
        Settings of the cameras.
    separation
        Distance of the sheets along z, scene units.

    Returns
    -------
    Share of pixels in which the wrong sheet shows, or none; 0 where no slab has room for two sheets.
    """
    worst = 0.0
    for orthoscopic in (True, False):
        places = list(_places(scene, view, settings, separation, orthoscopic=orthoscopic))
        if places:
            only = replace(settings, camera=Camera.C if orthoscopic else Camera.C_STAR)
            film = _planned_film(scene, view.aperture, places, separation)
            with Rasterizer(film.scene) as rasterizer:
                worst = max(worst, *film.wrong_shares(rasterizer, only))
    return worst


@dataclass(frozen=True, kw_only=True)
class _Place:
    """Where a pair goes: its camera, and the heights |z| between which its farther sheet lies."""

    camera: ModelCamera
    low: float
    high: float
    loser_first: bool


def _places(
    scene: Scene, view: View, settings: DoubleFrustum, separation: float, *, orthoscopic: bool
) -> Iterator[_Place]:
    """Yield the places of C or of C*: in every slab that shows a surface and has room for two sheets."""
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
            yield _Place(camera=camera, low=far - min(spread, room), high=far, loser_first=loser_first)


def _planned_film(scene: Scene, aperture: Aperture, places: list[_Place], separation: float) -> SheetFilm:
    """Deal the cells of a film out to places, and give each cell a height between the place's ends."""
    random = np.random.default_rng(1997)
    owner = random.permutation(np.arange(PLAN_CELLS**2) % len(places)).reshape(PLAN_CELLS, PLAN_CELLS)
    pairs = [
        SheetPair(
            camera=place.camera,
            heights=random.uniform(place.low, place.high, int((owner == number).sum())),
            separation=separation,
            loser_first=place.loser_first,
        )
        for number, place in enumerate(places)
    ]
    return SheetFilm.of(scene, aperture, pairs, owner, PLAN_CELL_PIXELS)


def _sheet(camera: ModelCamera, rows: Indices, columns: Indices, heights: Floats, cells: int) -> SceneObject:
    """Return cells of a camera's film as squares parallel to the plate, each at a height |z| of its own."""
    pencil = camera.pencil
    at = np.array([(0, 0), (0, 1), (1, 1), (1, 0)])
    u = 2 * (columns[:, None] + at[:, 1]) / cells - 1
    v = 1 - 2 * (rows[:, None] + at[:, 0]) / cells
    z = np.broadcast_to((-heights if camera.orthoscopic else heights)[:, None], u.shape)
    s = pencil.center[2] - z
    slopes = [pencil.shear[0] + u * pencil.half_extent[0], pencil.shear[1] + v * pencil.half_extent[1]]
    corners = np.stack((pencil.center[0] + s * slopes[0], pencil.center[1] + s * slopes[1], z), axis=-1)
    vertices = np.arange(4 * len(rows)).reshape(-1, 4)
    faces = np.concatenate((vertices[:, [0, 1, 2]], vertices[:, [0, 2, 3]]))
    return SceneObject(name="sheet", vertices=corners.reshape(-1, 3), faces=faces)
