"""Scan of apertures all over a plate by coarse certified films, and the `auto` choice.

The displacement by the near offset is (W/2) |u| n / (|z| + n). It depends on the |z| of the
*nearest visible* surface. This depth differs between apertures by orders of magnitude even if their
pictures hardly differ. Apertures are therefore chosen by their visible content near the plate, not
only by position (docs/method.md, "The plate").
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from xfrustum.compare.prediction.displacement import TruePoints, displacement_lengths
from xfrustum.compare.sampling import PERCENTILE
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.images import HogelCamera, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, Camera, DoubleFrustum

#: Lines along each side of the coarse film: 576 lines per aperture, of which 1 % are six lines.
FILM_PIXELS = 24

#: Approximate number of apertures of the first lattice; an aperture takes some 10 ms on a mesh of
#: 40,000 triangles.
LATTICE_APERTURES = 400

#: Largest number of scanned apertures, including neighbors of the worst apertures.
MAX_APERTURES = 1000

#: Number of apertures that are scanned because their cells contain the vertices nearest to the
#: plate: surfaces there may be smaller than the lattice spacing.
NEAREST_APERTURES = 200

#: Smallest difference of heights of neighboring lines, relative to the larger height, that counts
#: as an outline.
OUTLINE_JUMP = 0.1

REFINED_APERTURES = 16  #: number of worst apertures whose neighbors are scanned in each round


@dataclass(frozen=True, kw_only=True, eq=False)
class CoarseView:
    """Surfaces that the coarse film of one aperture shows."""

    aperture: Aperture
    #: (h, w) heights of the first surfaces; NaN without a surface, 0 for a surface in the aperture
    height: Floats
    camera: HogelCamera  #: the true frustum, with the resolution of the scene
    outline_widths: (
        float  #: length of outlines between objects or background, in widths of the film
    )

    @classmethod
    def from_image(cls, image: HogelImage, frustum_resolution: tuple[int, int]) -> CoarseView:
        """Return the view of a coarse image, with the camera at the scene's resolution."""
        shown = image.object
        across = (shown[:, 1:] != shown[:, :-1]).sum() / shown.shape[0]
        down = (shown[1:] != shown[:-1]).sum() / shown.shape[1]
        return cls(
            aperture=image.camera.aperture,
            height=np.where(image.covered, image.height, np.nan).astype(np.float64),
            camera=replace(image.camera, resolution=frustum_resolution),
            outline_widths=float(across + down),
        )

    @cached_property
    def points(self) -> TruePoints:
        """Visible surface points outside the plate, with their film positions in scene pixels."""
        sides = [
            ((2 * np.arange(count) + 1) / count - 1) * pixels / 2
            for count, pixels in zip(self.height.shape[::-1], self.camera.resolution, strict=True)
        ]
        return TruePoints(
            height=np.where(self.height == 0, np.nan, self.height),
            from_middle=np.stack(np.meshgrid(*sides), axis=-1),
            camera=self.camera,
        )

    @property
    def nearest(self) -> float:
        """Smallest visible |z|, scene units; infinite without a visible surface."""
        return float(np.nanmin(np.abs(self.height), initial=np.inf))

    def farthest(self, camera: Camera) -> float:
        """Return the largest visible |z| on the side of one camera; 0 without a surface."""
        return float(np.nanmax(-self.height if camera is Camera.C else self.height, initial=0.0))

    @cached_property
    def pixels_per_near(self) -> float:
        """The 99th percentile of displacement per n, as n tends to 0, pixels per scene unit."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self._p99(self.points.radius / np.abs(self.height))

    def displacement_p99_px(self, settings: DoubleFrustum, scene: Scene) -> float:
        """Return the 99th percentile of displacement, pixels, in closed form (see the module)."""
        return self._p99(
            np.nan_to_num(displacement_lengths(self.points, scene.frustum, settings), nan=0.0)
        )

    def wrong_share(self, settings: DoubleFrustum, scene: Scene) -> float:
        """Return the estimated share of pixels at outlines with a wrong surface by displacement.

        Displacements are radial. At an outline, the surfaces on both sides separate or overlap by
        the difference of their displacements across the outline. Structures finer than the coarse
        film are missed.
        """
        moved = np.nan_to_num(displacement_lengths(self.points, scene.frustum, settings), nan=0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            radial = np.nan_to_num(moved / self.points.radius, nan=0.0)
        share, seen = 0.0, np.isfinite(self.height)
        for axis, across in ((1, 0), (0, 1)):
            part = np.diff(radial * self.points.from_middle[..., across], axis=axis)
            low, high = np.delete(self.height, -1, axis), np.delete(self.height, 0, axis)
            jump = np.abs(high - low) > OUTLINE_JUMP * np.maximum(np.abs(low), np.abs(high))
            jump |= np.delete(seen, -1, axis) != np.delete(seen, 0, axis)
            lines = self.height.shape[1 - axis]
            share += float(np.abs(part[jump]).sum()) / (lines * self.camera.resolution[across])
        return share

    def _p99(self, moved: Floats) -> float:
        """Return the percentile of displacements (h, w), infinite for surfaces in the aperture."""
        seen = np.isfinite(self.height)
        if not seen.any():
            return 0.0
        some = np.where(self.height == 0, np.inf, moved)[seen]
        return float(np.percentile(some, PERCENTILE, method="higher"))


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateScan:
    """Coarse views of apertures all over a plate, row by row."""

    scene: Scene
    looks: tuple[CoarseView, ...]

    @property
    def apertures(self) -> tuple[Aperture, ...]:
        """Scanned apertures."""
        return tuple(look.aperture for look in self.looks)

    def displacements(self, settings: DoubleFrustum) -> Floats:
        """Return the 99th percentile of displacement of each view (A,), pixels, in closed form."""
        return np.array([look.displacement_p99_px(settings, self.scene) for look in self.looks])

    def wrong_shares(self, settings: DoubleFrustum) -> Floats:
        """Return the estimated share of pixels with a wrong surface in each view (A,)."""
        return np.array([look.wrong_share(settings, self.scene) for look in self.looks])

    def worst(self, count: int, settings: DoubleFrustum | None = None) -> list[CoarseView]:
        """Return the views with the largest displacement, worst first; None: for small near."""
        of_small_near = [look.pixels_per_near for look in self.looks]
        errors = np.array(of_small_near) if settings is None else self.displacements(settings)
        return [self.looks[number] for number in np.argsort(-errors, kind="stable")[:count]]

    def farthest(self, camera: Camera) -> CoarseView:
        """Return the view with the farthest surface on the side of one camera."""
        return max(self.looks, key=lambda look: look.farthest(camera))


def nearest_cells(scene: Scene, count: int) -> list[tuple[int, int]]:
    """Return the hogels whose cells have vertices nearest to the plate, nearest first.

    A triangle that does not cross the plate is nearest to the plate at a vertex. Hogels with
    vertices in the plate itself come last, because no near draws them correctly.
    """
    places = scene.triangles.reshape(-1, 3)
    columns, rows = scene.plate.hogels
    (width, height), (toward, back) = scene.plate.size, scene.frustum.reach
    column = np.floor((places[:, 0] / width + 0.5) * columns)
    row = np.floor((0.5 - places[:, 1] / height) * rows)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    inside &= (places[:, 2] <= toward) & (places[:, 2] >= -back)
    z = np.abs(places[inside, 2])
    cells = (row * columns + column)[inside][np.argsort(np.where(z > 0, z, np.inf), kind="stable")]
    _, first = np.unique(cells, return_index=True)
    chosen = cells[np.sort(first)[:count]].astype(int).tolist()
    return [(cell % columns, cell // columns) for cell in chosen]


def scout(scene: Scene, done: Callable[[int], object] = lambda looks: None) -> PlateScan:
    """Scan apertures all over the plate, more densely where the error is largest.

    The first lattice has about `LATTICE_APERTURES` apertures, always with the corners and the
    middle. The apertures of `nearest_cells` follow. Then the neighbors of the worst apertures are
    scanned, at half the distance each time, until no unscanned neighbor remains or `MAX_APERTURES`
    are reached. `done` is called with 1 after each aperture.
    """
    # The cost is independent of the scene's resolution.
    frustum = replace(scene.frustum, resolution=(FILM_PIXELS, FILM_PIXELS))
    reference = Reference(replace(scene, frustum=frustum), effects=frozenset())
    views: dict[tuple[int, int], CoarseView] = {}

    def look_through(indices: Iterable[tuple[int, int]]) -> None:
        missing = [index for index in dict.fromkeys(indices) if index not in views]
        missing = missing[: MAX_APERTURES - len(views)]
        for image in reference.stream(scene.plate.aperture(*index) for index in missing):
            views[image.camera.aperture.index] = CoarseView.from_image(
                image, scene.frustum.resolution
            )
            done(1)

    columns, rows = hogels = scene.plate.hogels
    if columns * rows <= LATTICE_APERTURES:
        counts = hogels
    else:
        # Choose cells of the lattice as square as possible.
        across = min(columns, max(2, round((LATTICE_APERTURES * columns / rows) ** 0.5)))
        counts = across, min(rows, max(2, LATTICE_APERTURES // across))
    ends = zip(hogels, counts, strict=True)
    places = [
        sorted({round(place) for place in np.linspace(0, size - 1, count)}) for size, count in ends
    ]
    look_through(
        [scene.plate.middle.index, *((column, row) for row in places[1] for column in places[0])]
    )
    look_through(nearest_cells(scene, min(NEAREST_APERTURES, MAX_APERTURES // 5)))
    step = [max((b - a for a, b in itertools.pairwise(ticks)), default=1) for ticks in places]
    while len(views) < MAX_APERTURES:
        before, step = len(views), [max(1, count // 2) for count in step]
        worst = sorted(views.values(), key=lambda look: -look.pixels_per_near)[:REFINED_APERTURES]
        neighbors = (
            (look.aperture.column + i * step[0], look.aperture.row + j * step[1])
            for look in worst
            for i, j in itertools.product((-1, 0, 1), repeat=2)
        )
        look_through((i, j) for i, j in neighbors if 0 <= i < columns and 0 <= j < rows)
        if step == [1, 1] and len(views) == before:
            break
    looks = sorted(views.values(), key=lambda look: look.aperture.index[::-1])
    return PlateScan(scene=scene, looks=tuple(looks))


class Criterion(StrEnum):
    """Criterion by which an aperture is chosen."""

    MIDDLE = "middle"  #: the middle of the plate
    DISPLACEMENT = "displacement"  #: largest 99th percentile of displacement
    NEAREST = "nearest"  #: surface nearest to the plate
    OUTLINES = "outlines"  #: longest outlines


@dataclass(frozen=True, kw_only=True, eq=False)
class ChosenAperture:
    """An aperture, and the criteria by which it was chosen."""

    aperture: Aperture
    criteria: tuple[Criterion, ...]
    view: CoarseView | None  #: None if the aperture shows nothing


@dataclass(frozen=True, kw_only=True, eq=False)
class AutoApertures:
    """Apertures that `auto` chooses: the middle, then the worst by each criterion.

    Further apertures would show the same kinds of error.
    """

    scout: PlateScan
    chosen: tuple[ChosenAperture, ...]
    #: Number of scanned apertures with a surface in the aperture itself. No settings draw their
    #: images correctly. They are chosen only if there are no other apertures.
    blocked: int

    @property
    def apertures(self) -> tuple[Aperture, ...]:
        """Only the apertures, in the order of `chosen`."""
        return tuple(choice.aperture for choice in self.chosen)

    @classmethod
    def from_scan(cls, scout: PlateScan) -> AutoApertures:
        """Choose apertures of a scan."""
        middle = scout.scene.plate.middle
        seeing = {look.aperture: look for look in scout.looks if math.isfinite(look.nearest)}
        free = [look for look in seeing.values() if math.isfinite(look.pixels_per_near)]
        criteria: dict[Aperture, list[Criterion]] = {}
        if not seeing or middle in seeing:
            criteria[middle] = [Criterion.MIDDLE]
        # Among equally bad views, prefer the middle, which is chosen anyway.
        ordered = sorted(free or seeing.values(), key=lambda look: look.aperture != middle)
        if ordered:
            for look, criterion in (
                (max(ordered, key=lambda look: look.pixels_per_near), Criterion.DISPLACEMENT),
                (min(ordered, key=lambda look: look.nearest), Criterion.NEAREST),
                (max(ordered, key=lambda look: look.outline_widths), Criterion.OUTLINES),
            ):
                criteria.setdefault(look.aperture, []).append(criterion)
        chosen = (
            ChosenAperture(aperture=aperture, criteria=tuple(some), view=seeing.get(aperture))
            for aperture, some in criteria.items()
        )
        return cls(scout=scout, chosen=tuple(chosen), blocked=len(seeing) - len(free))
