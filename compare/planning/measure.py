"""Errors of drawn hogels, and of sheets at the farthest visible surfaces.

Sheets: the film of a camera is tiled with cells, and each cell belongs to one pair of sheets. Each
pair has cells all over the film, and no cell occludes another, so that one picture shows all pairs
of a camera.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from xfrustum.compare.beyond import displacement_p99
from xfrustum.compare.planning.requirement import Errors, Quality, Requirement, worst_errors
from xfrustum.compare.planning.views import Done, View, Views
from xfrustum.compare.prediction.chain import with_exact_depth
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.compare.run import NO_TRUTHS, Evaluator, FrameRequest
from xfrustum.raster import Rasterizer
from xfrustum.reference.lines.lines import ExactCamera, model_cameras
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

#: Ratio to the predicted separation of the ends between which the smallest one is bisected on a
#: logarithmic scale, and number of halvings: they leave 2 log2(8) / 2^7 octaves, 3 %.
SEARCH_RATIO, SEARCH_HALVINGS = 8.0, 7

#: Cells along each side of the film of sheets, and pixels along each side of a cell.
CELLS, CELL_PIXELS = 32, 8

#: Share of their height |z|, and least number of separations, over which the cells of a sheet are
#: spread toward the plate, so that not all their depths round alike.
SPREAD, SPREAD_SEPARATIONS = 0.02, 4.0


@dataclass(frozen=True, kw_only=True)
class HogelResult(Errors):
    """Measured errors of a plan at one hogel."""

    aperture: Aperture
    #: pixels where the truth shows a surface
    covered: int


def hogel_results(
    judge: Evaluator,
    apertures: Iterable[Aperture],
    settings: DoubleFrustum,
    truths: Mapping[Aperture, HogelImage] = NO_TRUTHS,
) -> Iterator[HogelResult]:
    """Draw hogels, and yield the errors of settings at each, in order; `truths` are known truths.

    Wrong surfaces that are right with exact depth are wrong by depth: each hogel is drawn with
    exact depth too.
    """
    exact = with_exact_depth(settings)
    drawn = tuple(dict.fromkeys((settings, exact)))
    with closing(judge.frames(apertures, drawn, FrameRequest(), truths)) as frames:
        while some := {frame.settings: frame for frame in islice(frames, len(drawn))}:
            comparison, with_exact = (
                some[settings].comparison,
                some[exact].comparison.errors.surface,
            )
            wrong, judged = comparison.errors.surface, max(comparison.judged, 1)
            assert wrong is not None and with_exact is not None, "the reference has the scene"
            yield HogelResult(
                aperture=some[settings].aperture,
                covered=comparison.covered,
                displacement_p99_px=displacement_p99(comparison),
                surface_fraction=float(wrong.sum() / judged),
                depth_wrong=float((wrong & ~with_exact).sum() / judged),
            )


def measured(
    views: Views,
    settings: DoubleFrustum,
    requirement: Requirement,
    done: Done = lambda hogels: None,
    *,
    smallest: bool = True,
) -> tuple[list[HogelResult], Quality, str]:
    """Draw apertures and sheets; return each result, the worst, and the name of the device's model.

    The smallest ordered separation is NaN unless `smallest`.
    """
    separation = requirement.separation_in(views.scene.frustum)
    truths = {view.aperture: view.truth for view in views.views}
    with Evaluator(views.scene, reference=views.reference, model=requirement.device) as judge:
        device = judge.model.name
        results = list(hogel_results(judge, truths, settings, truths))
    wrong = []
    for view in views.views:
        wrong.append(misordered(views.scene, view, settings, separation))
        done(1)
    smallest_found = _smallest_separation(views, settings) if smallest else math.nan
    worst = Quality(**worst_errors(results), misordered=max(wrong), separation=smallest_found)
    return results, worst, device


def _smallest_separation(views: Views, settings: DoubleFrustum) -> float:
    """Return the smallest separation of sheets that are ordered everywhere; infinite for none."""
    predicted = views.separation(settings)

    def ordered(separation: float) -> bool:
        shares = (misordered(views.scene, view, settings, separation) for view in views.views)
        return all(share <= MAX_MISORDERED_FRACTION for share in shares)

    low, high = predicted / SEARCH_RATIO, predicted * SEARCH_RATIO
    if not predicted or not ordered(high):
        return math.inf if predicted else 0.0
    for _ in range(SEARCH_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if ordered(middle) else (middle, high)
    return high


@dataclass(frozen=True, kw_only=True, eq=False)
class SheetPair:
    """Two sheets of one camera, parallel to the plate, a separation apart along z, scene units."""

    camera: ExactCamera
    #: (N,) |z| of the farther sheet, for each of the pair's cells row by row
    heights: Floats
    separation: float
    #: whether the sheet that must not show is drawn first
    loser_first: bool

    def objects(self, owned: Mask) -> list[SceneObject]:
        """Return both sheets in drawing order: squares over the cells (n, n) owned."""
        (rows, columns), bundle, cells = np.nonzero(owned), self.camera.bundle, len(owned)
        at = np.array([(0, 0), (0, 1), (1, 1), (1, 0)])
        u = 2 * (columns[:, None] + at[:, 1]) / cells - 1
        v = 1 - 2 * (rows[:, None] + at[:, 0]) / cells
        vertices = np.arange(4 * len(rows)).reshape(-1, 4)
        faces, sheets = np.concatenate((vertices[:, [0, 1, 2]], vertices[:, [0, 2, 3]])), []
        for heights in (self.heights, self.heights - self.separation):
            z = np.broadcast_to(
                (-heights if self.camera.orthoscopic else heights)[:, None], u.shape
            )
            s = bundle.center[2] - z
            x = bundle.center[0] + s * (bundle.shear[0] + u * bundle.half_extent[0])
            y = bundle.center[1] + s * (bundle.shear[1] + v * bundle.half_extent[1])
            corners = np.stack((x, y, z), axis=-1).reshape(-1, 3)
            sheets.append(SceneObject(name="sheet", vertices=corners, faces=faces))
        # The farther one comes first. C keeps the nearer, C* the farther.
        return sheets if self.camera.orthoscopic is self.loser_first else sheets[::-1]


@dataclass(frozen=True, kw_only=True, eq=False)
class SheetFilm:
    """The film of an aperture's camera, tiled with cells of pairs of sheets."""

    scene: Scene
    aperture: Aperture
    #: (H, W) number of the pair that each pixel belongs to
    pair: Indices
    #: (H, W) number of the object that it must show
    shown: Indices

    @classmethod
    def from_scene(
        cls,
        scene: Scene,
        aperture: Aperture,
        pairs: Sequence[SheetPair],
        owner: Indices,
        cell_pixels: int,
    ) -> SheetFilm:
        """Tile a film with square cells, in pixels; `owner` (cells, cells) has the pair of each."""
        objects = (
            sheet for number, pair in enumerate(pairs) for sheet in pair.objects(owner == number)
        )
        side = len(owner) * cell_pixels
        frustum = replace(scene.frustum, resolution=(side, side))
        of_pixel = np.kron(owner, np.ones((cell_pixels, cell_pixels), dtype=np.int64))
        winners = np.array([2 * number + pair.loser_first for number, pair in enumerate(pairs)])
        return cls(
            scene=Scene(name="sheets", plate=scene.plate, frustum=frustum, objects=tuple(objects)),
            aperture=aperture,
            pair=of_pixel,
            shown=winners[of_pixel],
        )

    def wrong_shares(self, rasterizer: Rasterizer, settings: DoubleFrustum) -> list[float]:
        """Draw the sheets with `scene`'s rasterizer; return the share of wrong pixels per pair."""
        drawn = rasterizer.render(self.aperture, settings, normals=False, color=False)
        wrong = drawn.object != self.shown
        return [
            float(wrong[self.pair == number].mean())
            for number in range(len(self.scene.objects) // 2)
        ]


def misordered(scene: Scene, view: View, settings: DoubleFrustum, separation: float) -> float:
    """Return the largest wrong share of sheets at the farthest surface of every camera and slab.

    It counts pixels in which the wrong sheet shows, or none; 0 where no slab has room for two
    sheets. Each pair comes twice, the sheet that must not show drawn first and drawn last.
    """
    worst = 0.0
    for orthoscopic, side in ((True, Camera.C), (False, Camera.C_STAR)):
        places = []
        for camera in model_cameras(scene.frustum, view.aperture, settings):
            low, high = sorted(abs(height) for height in camera.heights)
            far = view.farthest(side, low, high) if camera.orthoscopic is orthoscopic else None
            if far is not None and far - separation > low:
                spread = max(SPREAD * far, SPREAD_SEPARATIONS * separation)
                ends = far - min(spread, (far - separation - low) / 2), far
                places += [(camera, ends, loser_first) for loser_first in (True, False)]
        if not places:
            continue
        # Cells are dealt out to the places at random, and have random heights between a place's
        # ends.
        random = np.random.default_rng(1997)
        owner = random.permutation(np.arange(CELLS**2) % len(places)).reshape(CELLS, CELLS)
        pairs = []
        for number, (camera, ends, first) in enumerate(places):
            heights = random.uniform(ends[0], ends[1], int((owner == number).sum()))
            pairs.append(
                SheetPair(camera=camera, heights=heights, separation=separation, loser_first=first)
            )
        film = SheetFilm.from_scene(scene, view.aperture, pairs, owner, CELL_PIXELS)
        with Rasterizer(film.scene) as rasterizer:
            worst = max(worst, *film.wrong_shares(rasterizer, replace(settings, camera=side)))
    return worst
