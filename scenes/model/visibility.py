"""Surfaces that may be visible from apertures, computed from the scene's geometry.

Visibility is tested by height. A triangle is cut at the ends of the reach, at the plate and at the
projection screen. Between two of these heights, the apertures from which a point is visible form an
interval along each axis. As functions of the point, the ends of this interval are extreme at the
corners of the triangle's part. Occlusion is not considered: hidden surfaces count as visible.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate import Aperture, DepthMapping, DoubleFrustum, Frustum, Plate
from xfrustum.scenes.shapes import has_area

Point = tuple[float, float, float]
Interval = tuple[float, float]

#: smallest near, fraction of the longest reach, for which `FAR_MARGIN` bounds images
SMALLEST_NEAR_SHARE = 2.0**-16
#: number of roundings of 2^-24 w in w - z (clip depth z equals w at the far plane): two in z, one
#: in w and one in the difference, times four, because vertices and matrices are float32 too
FAR_ROUNDINGS = 16
#: Factor by which a drawn image may extend beyond the reach. With `standard` and `gl` depth, w - z
#: = n (f - w) / (f - n) is a small difference of large numbers: a rounding of 2^-24 w moves the far
#: plane by a fraction 2^-24 f/n of w. At `SMALLEST_NEAR_SHARE` all roundings together move it by a
#: sixteenth of w; the factor allows twice this.
FAR_MARGIN = 1 / (1 - 2 * FAR_ROUNDINGS * 2.0**-24 / SMALLEST_NEAR_SHARE)
#: Margin of lateral bounds, relative to the largest term. The error of a float32 transform is at
#: most eight roundings of 2^-24 of the sum of its terms (raster/plate/clusters), and 2^-16 is 32
#: times as large.
ROUNDING_MARGIN = 2.0**-16

#: Largest distance from the plate, relative to an object's largest coordinate, that counts as zero:
#: half a ULP of float32, the type of coordinates in rasterizers and mesh files.
PLATE_ROUNDING = 2.0**-24

#: margin of aperture indices: coordinates have a dozen roundings of doubles, below 1e-12 of a cell
INDEX_MARGIN = 1e-6

#: numbers of triangles tested at once, and tested first
CHUNK_TRIANGLES, FIRST_TRIANGLES = 1 << 12, 1 << 6

#: Largest number of triangles after splitting a coarse mesh. Each triangle marks a rectangle of
#: apertures, and smaller triangles give tighter rectangles.
MAX_SPLIT_TRIANGLES = 50_000

#: Number of halvings of the reach that separate depth bins. Errors that grow as 1/|z| are in the
#: innermost bin, from the plate to 1/64 of the reach.
HALVINGS = 6


def loses_far_plane(scene: Scene, settings: DoubleFrustum) -> bool:
    """Return whether a drawn image may show surfaces beyond `FAR_MARGIN` times the reach.

    This happens with a tiny near, unless clip depth is zero at the far plane
    (raster/cameras).
    """
    hyperbolic = settings.mapping in (DepthMapping.STANDARD, DepthMapping.GL)
    nearest = min((settings.near, *settings.slabs[:1]))
    return hyperbolic and nearest < SMALLEST_NEAR_SHARE * scene.frustum.longest_reach


# Lines of an aperture
# -------------------------------------------------------------------------------------------------


def half_extents(frustum: Frustum) -> Interval:
    """Return the half-extents of the film along x and y, slopes per unit of depth."""
    if frustum.screen is None:
        assert frustum.fov is not None
        return math.tan(frustum.fov[0] / 2), math.tan(frustum.fov[1] / 2)
    width, height = frustum.screen.size
    return width / 2 / abs(frustum.screen.height), height / 2 / abs(frustum.screen.height)


def aside_of_frusta(
    frustum: Frustum, apertures: Sequence[Aperture], axis: int, ends: Interval
) -> Interval:
    """Return the smallest and the largest x (axis 0) or y (1) of lines between two heights."""
    # Lines are straight, so that extremes are at the two heights, or at the apertures if these are
    # between.
    z = np.array([z for z in (*ends, 0.0) if min(ends) <= z <= max(ends)])
    a = np.array([(aperture.x, aperture.y)[axis] for aperture in apertures])[:, None]
    middle, half = a + 0 * z, half_extents(frustum)[axis] * np.abs(z)
    if frustum.screen is not None:
        middle = a + (frustum.screen.center[axis] - a) * z / frustum.screen.height
    return float((middle - half).min()), float((middle + half).max())


def _parts(triangles: Floats, low: float, high: float) -> tuple[Floats, Mask]:
    """Return the corners (F, 9, 3) of triangle parts between two heights, and a validity mask."""
    z, ends = triangles[..., 2], np.roll(triangles, -1, axis=1)
    corners, valid = [triangles], [(z >= low) & (z <= high)]
    for height in (low, high):
        above, below = ends[..., 2] - height, z - height
        crossing = (above > 0) != (below > 0)
        with np.errstate(invalid="ignore"):
            share = np.divide(below, below - above, out=np.zeros_like(z), where=crossing)
            points = triangles + share[..., None] * (ends - triangles)
        points[..., 2] = np.where(crossing, height, points[..., 2])  # heights may be infinite
        corners.append(points)
        valid.append(crossing)
    return np.concatenate(corners, axis=1), np.concatenate(valid, axis=1)


def _apertures_of(
    part: tuple[Floats, Mask], frustum: Frustum, axis: int, widened: float = 0.0
) -> tuple[Floats, Floats]:
    """Return the (F,) smallest and largest coordinate of apertures whose lines meet each part.

    A point is on a line of the aperture at a if abs(x - s m/S - a (1 - s/S)) <= t abs(s) + widened.
    The screen is at s = S with its middle at m; without a screen 1/S is zero. Between the heights
    of `_layers`, the sign of 1 - s/S is constant.
    """
    corners, valid = part
    s, x = -corners[..., 2], corners[..., axis]
    toward_a = np.ones_like(s)
    if frustum.screen is not None:
        depth = -frustum.screen.height
        x = x - s * (frustum.screen.center[axis] / depth)
        toward_a = 1.0 - s / depth
    sign = np.where(np.where(valid, toward_a, 0.0).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    x, toward_a = x * sign, np.abs(toward_a)
    aside = half_extents(frustum)[axis] * np.abs(s) + widened
    # A point at the screen is visible from all apertures or from none: its bound is infinite, or
    # the corner is left out.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        low, high = (x - aside) / toward_a, (x + aside) / toward_a
    low = np.where(valid, np.where(np.isnan(low), -np.inf, low), np.inf).min(axis=1)
    high = np.where(valid, np.where(np.isnan(high), np.inf, high), -np.inf).max(axis=1)
    return low, high


def _layers(frustum: Frustum, low: float, high: float) -> Iterator[Interval]:
    """Yield the layers between two heights, cut at the plate and at the screen."""
    cuts = [0.0] if frustum.screen is None else sorted([0.0, frustum.screen.height])
    yield from pairwise([low, *(cut for cut in cuts if low < cut < high), high])


def crosses_plate(scene: Scene, aperture: Aperture, window: Floats) -> bool:
    """Return whether a surface crosses or touches the plate in a window about an aperture.

    `window` (2,) has the half-lengths along x and y. Triangles in the plate do not count.
    """
    lowest, highest = scene.height_ranges
    some = scene.triangles[(lowest <= 0) & (highest >= 0) & (lowest < highest)]
    corners, valid = _parts(some, 0.0, 0.0)
    # A triangle meets the plate in a segment: from one intersection point to the farthest other
    # point.
    places = np.where(valid[..., None], corners[..., :2] - [aperture.x, aperture.y], np.nan)
    first = np.take_along_axis(places, valid.argmax(axis=1)[:, None, None], axis=1)
    apart = np.nan_to_num(np.abs(places - first).sum(axis=-1), nan=-1.0).argmax(axis=1)
    last = np.take_along_axis(places, apart[:, None, None], axis=1)
    middle, end = (first + last)[:, 0] / 2, (last - first)[:, 0] / 2
    # A segment meets a rectangle unless an axis, or the segment's normal, separates them.
    meets = (np.abs(middle) <= window + np.abs(end)).all(axis=1)
    across = np.abs(middle[:, 0] * end[:, 1] - middle[:, 1] * end[:, 0])
    return bool((meets & (across <= np.abs(end) @ window[::-1])).any())


# Regions of apertures
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Region:
    """Crossed frusta of a rectangle of apertures, widened for drawn images: an outer bound."""

    frustum: Frustum
    apertures: tuple[Interval, Interval]  #: ranges of x and y of the apertures, scene units
    widened: Interval = (0.0, 0.0)  #: along x and y, scene units
    reach: Interval  #: toward the viewer and behind the plate, scene units

    @classmethod
    def from_scene(
        cls,
        scene: Scene,
        apertures: Iterable[Aperture] | None = None,
        settings: Sequence[DoubleFrustum] = (),
    ) -> Region:
        """Return the region of images drawn from the cells of apertures, by default of the plate.

        It is valid for every near of at least `SMALLEST_NEAR_SHARE` of the reach; a smaller near
        needs the settings.
        """
        unbounded = any(loses_far_plane(scene, choice) for choice in settings)
        margin = math.inf if unbounded else FAR_MARGIN
        toward, back = scene.frustum.reach
        return replace(
            cls.from_cells(scene, apertures),
            widened=_widened(scene, scene.frustum.longest_reach),
            reach=(margin * toward, margin * back),
        )

    @classmethod
    def from_cells(cls, scene: Scene, apertures: Iterable[Aperture] | None = None) -> Region:
        """Return the region of true frusta of the cells of apertures, by default of the plate."""
        plate = scene.plate
        if apertures is None:
            (width, height) = plate.size
            x, y = (-width / 2, width / 2), (-height / 2, height / 2)
        else:
            half = [size / count / 2 for size, count in zip(plate.size, plate.hogels, strict=True)]
            places = np.array([(aperture.x, aperture.y) for aperture in apertures])
            (x0, y0), (x1, y1) = places.min(axis=0) - half, places.max(axis=0) + half
            x, y = (float(x0), float(x1)), (float(y0), float(y1))
        return cls(frustum=scene.frustum, apertures=(x, y), reach=scene.frustum.reach)

    def holds(self, triangles: Floats, heights: Interval | None = None) -> Mask:
        """Return the mask (F,) of triangles that may be partly in the region, between two heights.

        False entries are certain.
        """
        toward, back = self.reach
        held = np.zeros(len(triangles), dtype=np.bool_)
        for ends in _layers(self.frustum, *(heights or (-back, toward))):
            part = _parts(triangles, *ends)
            inside = np.asarray(part[1].any(axis=1))
            for axis, (first, last) in enumerate(self.apertures):
                low, high = _apertures_of(part, self.frustum, axis, self.widened[axis])
                inside &= (low <= last) & (high >= first)
            held |= inside
        return held

    def shows(self, part: SceneObject, faces: Indices | None = None) -> bool:
        """Return whether images may show any of an object's triangles; False is certain."""
        counted = part.faces if faces is None else faces
        # In most objects one of the first triangles is visible: test a short chunk first.
        starts = [0, *range(FIRST_TRIANGLES, len(counted), CHUNK_TRIANGLES), len(counted)]
        for start, stop in pairwise(starts):
            triangles = part.vertices[counted[start:stop]]
            if self.holds(triangles[has_area(triangles)]).any():
                return True
        return False


def _widened(scene: Scene, step: float) -> Interval:
    """Return the lateral widening of lines of an offset camera, along x and y.

    The offset `step` widens the lines by the half-extent times the step on each side, and with
    pivot `camera` also by the shear times the step. Float32 rounding of all terms is added.
    """
    frustum, widths = scene.frustum, []
    for axis, half in enumerate(half_extents(frustum)):
        size, slope = scene.plate.size[axis], 0.0
        if frustum.screen is not None:
            slope = (abs(frustum.screen.center[axis]) + size / 2) / abs(frustum.screen.height)
        farthest = FAR_MARGIN * frustum.longest_reach + step
        rounding = ROUNDING_MARGIN * (size + (half + slope) * farthest)
        widths.append((half + slope) * step + rounding)
    return widths[0], widths[1]


def apertures_in_view(
    part: SceneObject, frustum: Frustum, plate: Plate, widened: Interval = (0.0, 0.0)
) -> Mask:
    """Return a map (rows, columns) of hogels that may show an object; False is certain."""
    columns, rows = plate.hogels
    # Each rectangle adds +1 at its beginning and -1 after its end, in rows and columns. Cumulative
    # sums along both axes count the rectangles that cover each aperture.
    steps = np.zeros((rows + 1, columns + 1), dtype=np.int64)
    for triangles in triangles_in_chunks(part):
        for ends in _layers(frustum, -frustum.reach[1], frustum.reach[0]):
            cut = _parts(_split(triangles, len(part.faces)), *ends)
            (left, right), (low, high) = (
                _indices_between(*_apertures_of(cut, frustum, axis, widened[axis]), plate, axis)
                for axis in (0, 1)
            )
            # Rows are numbered downward, heights upward.
            top, end = rows - 1 - high, rows - low
            some = cut[1].any(axis=1) & (left <= right) & (top < end)
            for r, c, sign in (
                (top, left, 1),
                (top, right + 1, -1),
                (end, left, -1),
                (end, right + 1, 1),
            ):
                np.add.at(steps, (r[some], c[some]), sign)
    return np.asarray(steps.cumsum(axis=0).cumsum(axis=1)[:rows, :columns] > 0)


def _split(triangles: Floats, total: int) -> Floats:
    """Return triangles split into four repeatedly, up to `MAX_SPLIT_TRIANGLES` of an object."""
    while 4 * total <= MAX_SPLIT_TRIANGLES:
        a, b, c = triangles.transpose(1, 0, 2)
        ab, bc, ca = a / 2 + b / 2, b / 2 + c / 2, c / 2 + a / 2
        quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(corners, axis=1) for corners in quarters])
        total *= 4
    return triangles


def _indices_between(low: Floats, high: Floats, plate: Plate, axis: int) -> tuple[Indices, Indices]:
    """Return the (F,) first and last aperture index between coordinates, toward +x or +y."""
    size, count = plate.size[axis], plate.hogels[axis]
    first = np.ceil(np.clip((low / size + 0.5) * count - 0.5 - INDEX_MARGIN, 0, count))
    last = np.floor(np.clip((high / size + 0.5) * count - 0.5 + INDEX_MARGIN, -1, count - 1))
    return first.astype(np.int64), last.astype(np.int64)


def apertures_drawn(scene: Scene, settings: Sequence[DoubleFrustum]) -> Mask:
    """Return a map (rows, columns) of hogels that may show a surface, true or drawn."""
    plate, frustum = scene.plate, scene.frustum
    flags = np.full(plate.hogels[::-1], any(loses_far_plane(scene, choice) for choice in settings))
    widened = _widened(scene, max(choice.near for choice in settings))
    toward, back = frustum.reach
    farther = replace(frustum, reach=(FAR_MARGIN * toward, FAR_MARGIN * back))
    for part in scene.objects:
        flags |= apertures_in_view(part, farther, plate, widened)
        if flags.all():
            break
    return flags


def sees_any(scene: Scene, apertures: Sequence[Aperture]) -> bool:
    """Return whether any of the apertures may see an object; False is certain."""
    first = next(iter(apertures), None)
    if first is None:
        return True
    # Test the first aperture first: it is usually enough, and a plate may have millions of
    # apertures.
    here = ((first.x, first.x), (first.y, first.y))
    region = Region(frustum=scene.frustum, apertures=here, reach=scene.frustum.reach)
    if any(region.shows(part) for part in scene.objects):
        return True
    for part in scene.objects:
        flags = apertures_in_view(part, scene.frustum, scene.plate)
        if flags.any() and any(flags[aperture.row, aperture.column] for aperture in apertures):
            return True
    return False


# Objects
# -------------------------------------------------------------------------------------------------


def triangles_in_chunks(part: SceneObject) -> Iterator[Floats]:
    """Yield (F, 3, 3) corners of triangles with an area, in chunks that bound memory."""
    for start in range(0, len(part.faces), 4 * CHUNK_TRIANGLES):
        triangles = part.vertices[part.faces[start : start + 4 * CHUNK_TRIANGLES]]
        yield triangles[has_area(triangles)]


def box(part: SceneObject) -> tuple[Point, Point]:
    """Return the lowest and the highest coordinates of an object's triangles."""
    corners = part.vertices[part.faces.ravel()]
    x0, y0, z0 = corners.min(axis=0, initial=np.inf).tolist()
    x1, y1, z1 = corners.max(axis=0, initial=-np.inf).tolist()
    return (x0, y0, z0), (x1, y1, z1)


def in_plate(part: SceneObject) -> int:
    """Return the number of triangles with an area in the plate, within `PLATE_ROUNDING`."""
    allowed = PLATE_ROUNDING * float(np.abs(part.vertices).max(initial=0.0))
    flat = part.faces[(np.abs(part.vertices[:, 2]) <= allowed)[part.faces].all(axis=1)]
    # Coordinates are scaled to at most one, so that areas neither underflow nor overflow.
    corners = part.vertices[flat] * (PLATE_ROUNDING / allowed if allowed else 1.0)
    thin = PLATE_ROUNDING * np.ptp(corners, axis=1).max(axis=1)
    return int(np.count_nonzero(areas(corners) > thin))


def areas(triangles: Floats) -> Floats:
    """Return the (F,) areas of triangles (F, 3, 3), square scene units."""
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2)


def share_in_reach(part: SceneObject, frustum: Frustum) -> float | None:
    """Return the share of an object's surface within the reach; None if it has no area."""
    toward, back = frustum.reach
    whole = within = 0.0
    # Coordinates are scaled to at most one, so that areas neither underflow nor overflow.
    size = max(float(np.abs(part.vertices).max()), np.finfo(np.float64).tiny)
    for triangles in triangles_in_chunks(part):
        area = areas(triangles / size)
        whole += float(area.sum())
        within += float((area * share_between(triangles, -back, toward)).sum())
    return within / whole if whole > 0 else None


def share_between(triangles: Floats, low: float, high: float) -> Floats:
    """Return the (F,) share of each triangle's area between two heights, both ends included."""
    lowest, middle, highest = z = np.sort(triangles[..., 2], axis=1).T

    def quotient(part: Floats, whole: Floats) -> Floats:
        # Quotients outside 0 to 1 are not needed, and might overflow.
        usable = (whole > 0) & (part >= 0) & (part <= whole)
        return np.divide(part, whole, out=np.ones(z.shape[1]), where=usable)

    def below(height: float) -> Floats:
        # The length of a triangle's horizontal section grows linearly from the lowest corner to the
        # middle corner, and shrinks linearly above. The area below a height is therefore quadratic
        # on either side.
        rise, fall = height - lowest, highest - height
        rising = quotient(rise, highest - lowest) * quotient(rise, middle - lowest)
        falling = quotient(fall, highest - lowest) * quotient(fall, highest - middle)
        within = np.where(height < middle, rising, 1.0 - falling)
        return np.where(height <= lowest, 0.0, np.where(height >= highest, 1.0, within))

    inside = (lowest >= low) & (lowest <= high)
    return np.where(lowest == highest, inside, np.clip(below(high) - below(low), 0.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class Sight:
    """Apertures of a plate whose crossed frusta contain a part of an object, hidden or not."""

    apertures: int
    of: int
    columns: tuple[int, int] | None  #: first and last column of these apertures
    rows: tuple[int, int] | None
    middle: bool
    corners: tuple[bool, bool, bool, bool]  #: top left, top right, bottom left, bottom right


@dataclass(frozen=True, kw_only=True)
class ObjectExtent:
    """Position and size of one object, scene units."""

    number: int
    name: str
    triangles: int
    low: Point  #: corners of the bounding box
    high: Point
    share_in_reach: float | None  #: share of the object's surface; None if it has no area
    sight: Sight

    @property
    def size(self) -> Point:
        """Lengths of the bounding box along x, y and z, scene units."""
        x, y, z = (high - low for low, high in zip(self.low, self.high, strict=True))
        return x, y, z


def extents(scene: Scene) -> tuple[ObjectExtent, ...]:
    """Return position, size and visibility of each object of a scene."""
    places, (column, row) = [], scene.plate.middle.index
    for number, part in enumerate(scene.objects):
        flags = apertures_in_view(part, scene.frustum, scene.plate)
        rows, columns = np.nonzero(flags)
        top_left, top_right, left, right = flags[[0, 0, -1, -1], [0, -1, 0, -1]].tolist()
        sight = Sight(
            apertures=len(rows),
            of=flags.size,
            columns=_ends(columns),
            rows=_ends(rows),
            middle=bool(flags[row, column]),
            corners=(top_left, top_right, left, right),
        )
        (low, high), share = box(part), share_in_reach(part, scene.frustum)
        extent = ObjectExtent(
            number=number,
            name=part.name,
            triangles=len(part.faces),
            low=low,
            high=high,
            share_in_reach=share,
            sight=sight,
        )
        places.append(extent)
    return tuple(places)


def _ends(numbers: Indices) -> tuple[int, int] | None:
    return (int(numbers.min()), int(numbers.max())) if len(numbers) else None


# By depth
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class DepthBin:
    """Content of the frusta between two distances |z| on one side of the plate, scene units."""

    behind: bool
    heights: Interval
    nearest: float  #: range of |z| of the content
    farthest: float
    triangles: int  #: triangles with a part in the bin, inside the frusta
    share: float  #: share of the surface of all bins, by area; 0 if no surface has an area


def depth_bins(scene: Scene, apertures: Iterable[Aperture] | None = None) -> tuple[DepthBin, ...]:
    """Return the bins with content from back to front, for the cells of apertures."""
    region = Region.from_cells(scene, apertures)
    bins = []
    for behind, reach in ((True, scene.frustum.reach[1]), (False, scene.frustum.reach[0])):
        for heights in pairwise([0.0, *(reach / 2**k for k in range(HALVINGS, -1, -1))]):
            held = [
                _held(triangles, region, behind, heights)
                for part in scene.objects
                for triangles in triangles_in_chunks(part)
            ]
            ends = np.concatenate([interval for interval, _ in held]) if held else np.zeros((0, 2))
            if len(ends):
                content = DepthBin(
                    behind=behind,
                    heights=heights,
                    nearest=float(ends.min()),
                    farthest=float(ends.max()),
                    triangles=len(ends),
                    share=sum(area for _, area in held),
                )
                bins.append(content)
    whole = sum(content.share for content in bins) or 1.0
    bins.sort(key=lambda content: content.heights[1] * (-1 if content.behind else 1))
    return tuple(replace(content, share=content.share / whole) for content in bins)


def _held(
    triangles: Floats, region: Region, behind: bool, heights: Interval
) -> tuple[Floats, float]:
    """Return (N, 2) distances of triangles (F, 3, 3) in a bin of a region, and their area."""
    near, far = heights
    low_z, high_z = (-far, -near) if behind else (near, far)
    distances = triangles[..., 2] * (-1 if behind else 1)
    least, most = distances.min(axis=1), distances.max(axis=1)
    # A horizontal triangle between two bins belongs to the inner bin; in the plate, to both sides.
    outer_end = np.where(least == most, least <= far, least < far)
    inner_end = (most > near) | ((least == most) & (most == 0) & (near == 0))
    inside = triangles[outer_end & inner_end]
    kept = inside[region.holds(inside, (low_z, high_z))]
    area = float((areas(kept) * share_between(kept, low_z, high_z)).sum())
    z = np.clip(kept[..., 2], low_z, high_z)
    ends_of = np.abs(np.stack((z.min(axis=1), z.max(axis=1)), axis=1))
    return ends_of, area
