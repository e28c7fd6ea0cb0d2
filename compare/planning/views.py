"""Errors of settings at some apertures: predicted by closed forms, and measured.

A plan is measured over the pixels of the drawn picture. At contours, the picture shows other
surfaces than the truth. The closed form of displacement therefore assigns to each pixel of the
truth the largest displacement of the pixel and its neighbors: a picture displaced by less than a
pixel shows no other surface there. Surfaces that no pixel of the truth shows are covered by tracing
the offset cameras, because the films of offset cameras are wider for |z| <= n.

Pairs of sheets at the farthest visible surfaces measure depth resolution. The film of a camera is
tiled with cells, and each cell belongs to one pair of sheets. Each pair has cells all over the
film, and no cell occludes another, so that one picture shows all pairs of a camera.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from statistics import NormalDist

import numpy as np
from scipy.ndimage import maximum_filter

from xfrustum.compare.comparison import compare_images
from xfrustum.compare.planning.requirement import Errors, Quality, Requirement, worst_errors
from xfrustum.compare.prediction import depth
from xfrustum.compare.prediction.displacement import TruePoints, displacement_lengths, in_first_slab
from xfrustum.compare.prediction.predict import with_exact_depth
from xfrustum.compare.run import NO_TRUTHS, Evaluator, FrameRequest
from xfrustum.compare.sampling import PERCENTILE, displacement_p99
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.lines import ExactCamera, model_cameras
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.effects import CAMERAS
from xfrustum.scenes.model.images import HogelImage
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate import Aperture, Camera, DoubleFrustum, Frustum, Offset

#: Relative distance from a cut within which a surface counts on both sides of the cut: rounding
#: moves the surfaces of a refined mesh by 1e-16 of their coordinates, and cuts have three digits.
HEIGHT_TOLERANCE_RATIO = 1e-9

#: width of a neighborhood in pixels: one pixel to each side
NEIGHBORHOOD_PX = 3
#: function that reports progress, called with a number of hogels
Done = Callable[[int], object]

#: The smallest ordered separation is bisected on a logarithmic scale, from the predicted separation
#: divided by this ratio to the predicted separation times this ratio. Number of halvings: they
#: leave 2 log2(8) / 2^7 octaves, 3 %.
SEARCH_RATIO, SEARCH_HALVINGS = 8.0, 7

#: Cells along each side of the film of sheets, and pixels along each side of a cell.
CELLS, CELL_PIXELS = 32, 8

#: Range of depths over which the cells of a sheet are spread toward the plate, so that depths round
#: differently: a share of the height |z|, and at least a number of separations.
SPREAD, SPREAD_SEPARATIONS = 0.02, 4.0


def displacement_bound(truth: HogelImage, frustum: Frustum, settings: DoubleFrustum) -> float:
    """Return an upper bound of the 99th percentile of displacement in a drawn picture, in pixels.

    It is 0 if the truth shows no surface. It is infinite if more than one pixel in a hundred shows
    a surface in the aperture itself, because such a surface is displaced far for every n.

    Let zf be the height that is drawn exactly. At the place where a surface at |z| belongs, its
    displacement is u n / (|z| + n) (1 - |z| / zf), see `displacements`. At the place where it is
    drawn, it is (1 + n / |z|) / (1 + n / zf) times as much.
    """
    if not truth.covered.any():
        return 0.0
    points = TruePoints.from_image(truth)
    moved = displacement_lengths(points, frustum, settings)
    if settings.offset is Offset.PLATE:
        bent, fitted = (
            in_first_slab(points.height, frustum, settings),
            settings.fitted_height(frustum),
        )
        drawn = 1 + settings.near / np.abs(points.height[bent])
        moved[bent] *= drawn / (1 + settings.near * (0.0 if fitted is None else 1 / fitted))
    moved = np.where(truth.covered & (truth.height == 0), np.inf, np.nan_to_num(moved, nan=0.0))
    largest = maximum_filter(moved, size=NEIGHBORHOOD_PX)[truth.covered]
    return float(np.percentile(largest, PERCENTILE, method="higher"))


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """True image of one aperture, and its gaps; see `Reference.trace` and `Reference.gaps`."""

    aperture: Aperture
    truth: HogelImage
    gaps: Floats

    @cached_property
    def seen(self) -> dict[Camera, Floats]:
        """Heights |z| of all visible surfaces, ascending, by the camera that draws them."""
        height = np.sort(self.truth.height[self.truth.covered].astype(np.float64))
        return {Camera.C: -height[height <= 0][::-1], Camera.C_STAR: height[height > 0]}

    @cached_property
    def layers(self) -> depth.DepthLayers:
        """Surfaces that depth buffers must order."""
        return depth.DepthLayers.from_truth(self.truth, self.gaps)

    def farthest(self, camera: Camera, low: float = 0.0, high: float = math.inf) -> float | None:
        """Return the largest |z| that a camera sees between two heights; None without a surface."""
        seen = self.seen[camera]
        count = int(np.searchsorted(seen, high * (1 + HEIGHT_TOLERANCE_RATIO), side="right"))
        if not count or seen[count - 1] < low * (1 - HEIGHT_TOLERANCE_RATIO):
            return None
        return min(float(seen[count - 1]), high)


@dataclass(frozen=True, kw_only=True, eq=False)
class Views:
    """True images of some apertures of a scene; the images predict the errors of settings."""

    reference: Reference
    views: tuple[View, ...]
    #: device that draws; None selects a device that stores the nearest step
    device: DeviceModel | None = None

    @classmethod
    def traced(
        cls,
        reference: Reference,
        apertures: Sequence[Aperture],
        done: Done = lambda hogels: None,
        device: DeviceModel | None = None,
    ) -> Views:
        """Trace apertures; `done` is called with 1 after each."""
        views = []
        for aperture in apertures:
            truth, gaps = reference.trace(aperture), reference.gaps(aperture)
            views.append(View(aperture=aperture, truth=truth, gaps=gaps))
            done(1)
        return cls(reference=reference, views=tuple(views), device=device)

    def joined(self, views: Iterable[View]) -> Views:
        """Return these views and additional views."""
        return replace(self, views=(*self.views, *views))

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.reference.scene

    def farthest(self, camera: Camera) -> float:
        """Return the largest |z| visible to a camera from any aperture; 0 without a surface."""
        return max((view.farthest(camera) or 0.0 for view in self.views), default=0.0)

    def displaced(self, settings: DoubleFrustum, limit: float = math.inf) -> float:
        """Return the largest `displacement_bound` of the views; stop at a bound beyond `limit`."""
        worst = 0.0
        for view in self.views:
            worst = max(worst, displacement_bound(view.truth, self.scene.frustum, settings))
            if worst > limit:
                break
        return worst

    def traced_errors(self, settings: DoubleFrustum) -> tuple[float, float]:
        """Return the worst displacement (px) and wrong share of cameras without rounding."""
        moved, wrong = [0.0], [0.0]
        for view in self.views:
            model = self.reference.trace_model(view.aperture, settings)
            comparison = compare_images(view.truth, model, self.reference, radiance=False)
            assert comparison.surface is not None, "the reference has the scene at hand"
            moved.append(displacement_p99(comparison))
            wrong.append(comparison.surface.fraction)
        return max(moved), max(wrong)

    def depth_wrong(self, settings: DoubleFrustum) -> float:
        """Return the predicted share of pixels wrong by depth, for the worst draw order."""
        arguments = self.scene.frustum, [settings], self.device or depth.ANY
        shares = (
            depth.depth_wrong_shares(view.layers, *arguments, unlucky=True)[0]
            for view in self.views
        )
        return max(shares, default=0.0)

    def separation(self, settings: DoubleFrustum) -> float:
        """Return the predicted smallest separation at the farthest surface of all slabs."""
        every = depth.slabs(self.scene.frustum, settings)
        return max((self.separation_in(slab, settings) for slab in every), default=0.0)

    def separation_in(self, slab: depth.DepthRange, settings: DoubleFrustum) -> float:
        """Return the predicted smallest separation at a slab's farthest surface; 0 if empty."""
        ends = [view.farthest(slab.camera, slab.low, slab.high) for view in self.views]
        seen = np.array([end for end in ends if end is not None])
        if not len(seen):
            return 0.0
        w = np.clip(seen + slab.step, slab.near, slab.far)
        arguments = slab.near, slab.far, settings.depth, settings.mapping, self.device
        return float(depth.smallest_separation(w, *arguments).max())

    def predicted(self, settings: DoubleFrustum, separation: float) -> Quality:
        """Return the predicted errors of settings, with sheets a given separation apart."""
        smallest, depth_wrong = self.separation(settings), self.depth_wrong(settings)
        certain = NormalDist().inv_cdf(1 - depth.MAX_MISORDERED_FRACTION)
        return Quality(
            displacement_p99_px=self.displaced(settings),
            surface_fraction=depth_wrong,
            depth_wrong=depth_wrong,
            misordered=NormalDist().cdf(-certain * separation / smallest) if smallest else 0.0,
            separation=smallest,
        )


# Measures
# -------------------------------------------------------------------------------------------------


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

    Each hogel is also drawn with exact depth. Pixels that are wrong with the settings and right
    with exact depth are wrong by depth.
    """
    exact = with_exact_depth(settings)
    drawn = tuple(dict.fromkeys((settings, exact)))
    with closing(judge.frames(apertures, drawn, FrameRequest(), truths)) as frames:
        while some := {frame.settings: frame for frame in islice(frames, len(drawn))}:
            comparison = some[settings].comparison
            wrong, control = comparison.errors.surface, some[exact].comparison.errors.surface
            assert wrong is not None and control is not None, "the reference has the scene"
            judged = max(comparison.judged, 1)
            yield HogelResult(
                aperture=some[settings].aperture,
                covered=comparison.covered,
                displacement_p99_px=displacement_p99(comparison),
                surface_fraction=float(wrong.sum() / judged),
                depth_wrong=float((wrong & ~control).sum() / judged),
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

    The smallest ordered separation is measured only if `smallest`, else it is NaN.
    """
    truths = {view.aperture: view.truth for view in views.views}
    with Evaluator(views.scene, reference=views.reference, model=requirement.device) as judge:
        device = judge.model.name
        results = list(hogel_results(judge, truths, settings, truths))
    separation, wrong = requirement.separation_in(views.scene.frustum), []
    for view in views.views:
        wrong.append(misordered(views.scene, view, settings, separation))
        done(1)
    ordered = _smallest_separation(views, settings) if smallest else math.nan
    worst = Quality(**worst_errors(results), misordered=max(wrong), separation=ordered)
    return results, worst, device


def _smallest_separation(views: Views, settings: DoubleFrustum) -> float:
    """Return the smallest separation at which sheets are ordered in all views, else infinity."""

    def ordered(separation: float) -> bool:
        shares = (misordered(views.scene, view, settings, separation) for view in views.views)
        return all(share <= depth.MAX_MISORDERED_FRACTION for share in shares)

    predicted = views.separation(settings)
    low, high = predicted / SEARCH_RATIO, predicted * SEARCH_RATIO
    if not predicted or not ordered(high):
        return math.inf if predicted else 0.0
    for _ in range(SEARCH_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if ordered(middle) else (middle, high)
    return high


# Sheets
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class SheetPair:
    """Two sheets of one camera, parallel to the plate, a separation apart along z, scene units."""

    camera: ExactCamera
    #: (N,) |z| of the farther sheet, for each of the pair's cells row by row
    heights: Floats
    separation: float
    #: whether the sheet that must be hidden is drawn first
    loser_first: bool

    def objects(self, owned: Mask) -> list[SceneObject]:
        """Return both sheets in drawing order: squares over the cells that `owned` (n, n) marks."""
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
        # The farther sheet comes first. C keeps the nearer sheet, and C* keeps the farther sheet.
        return sheets if self.camera.orthoscopic is self.loser_first else sheets[::-1]


@dataclass(frozen=True, kw_only=True, eq=False)
class SheetFilm:
    """The film of an aperture's camera, tiled with cells of pairs of sheets."""

    scene: Scene
    aperture: Aperture
    #: (H, W) number of the pair of sheets in each pixel
    pair: Indices
    #: (H, W) number of the object that each pixel must show
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
        """Tile a film with square cells; `owner` (cells, cells) is the pair of each cell."""
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

    Pixels are wrong if they show the wrong sheet or no sheet. The share is 0 if no slab has room
    for two sheets. Each pair is drawn twice: the sheet that must be hidden is first, then last.
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
        # Assign cells to pairs at random; heights of cells are random in the pair's range.
        random = np.random.default_rng(1997)
        owner = random.permutation(np.arange(CELLS**2) % len(places)).reshape(CELLS, CELLS)
        pairs = []
        for number, (camera, ends, first) in enumerate(places):
            heights = random.uniform(ends[0], ends[1], int((owner == number).sum()))
            pairs.append(
                SheetPair(camera=camera, heights=heights, separation=separation, loser_first=first)
            )
        film = SheetFilm.from_scene(scene, view.aperture, pairs, owner, CELL_PIXELS)
        with Rasterizer(film.scene, CAMERAS) as rasterizer:
            worst = max(worst, *film.wrong_shares(rasterizer, replace(settings, camera=side)))
    return worst
