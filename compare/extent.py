"""Where a scene lies, before anything is drawn: what reach and frusta hold of each object, also in words.

Occlusion is not considered: an object behind another one is in view.
"""

import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from xfrustum.reference.lines.lines import film_window
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.geometry.shapes import has_area
from xfrustum.scenes.model.effects import FAR_MARGIN, ROUNDING_MARGIN, Region, loses_far_plane
from xfrustum.scenes.model.scene import TRIANGLES_AT_ONCE, Scene, SceneObject
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture, Frustum, Plate

Point = tuple[float, float, float]
Ends = tuple[float, float]

PLATE_ROUNDING = 2.0**-24
"""Distance from the plate, as a share of an object's largest coordinate, that rounding makes of 0: half a
unit in the last place of the single precision in which rasterizers and mesh files hold coordinates."""

FILM_MARGIN_PX = 1e-6
"""Margin around the area that a triangle covers on the film. Film coordinates have a dozen roundings of
doubles, an error below 1e-12 px on films of any size."""

VIEW_CHUNK_TRIANGLES = 1 << 12
"""Triangles examined together to find any one in view: most meshes have one among the first."""

MAX_SPLIT_TRIANGLES = 50_000
"""Largest number of triangles that a coarse mesh is split into before its apertures are counted, by the
rectangle around each triangle."""

HALVINGS = 6
"""Number of halvings of the reach at which bins of depth end. The innermost bin, from the plate to 1/64 of
the reach, has every error that grows as 1/|z|."""

MAX_NAMED_OBJECTS = 3
"""Largest number of objects that one message names, so that it stays one line; the others are counted."""

FACING_RESOLUTION = (64, 64)
"""Pixels of the images in which is counted how much of each object is seen from behind."""

MIN_SIZE_FRACTION = 0.01
"""Smallest size of an object, as a share of the plate's longer side, that raises no warning. A smaller object
is more likely in other units than made for the plate: a pixel of a hogel is a hundredth or more of
that
side."""


# Objects
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Visibility:
    """The apertures of a plate whose crossed frusta hold some part of an object, without occlusion."""

    apertures: int
    of: int
    columns: tuple[int, int] | None  #: first and last column of these apertures
    rows: tuple[int, int] | None
    middle: bool
    corners: tuple[bool, bool, bool, bool]  #: top left, top right, bottom left, bottom right


@dataclass(frozen=True, kw_only=True)
class ObjectExtent:
    """The place and the size of one object, scene units."""

    number: int
    name: str
    triangles: int
    low: Point  #: corners of the bounding box
    high: Point
    share_in_reach: float | None  #: of its surface; None where the surface has no area
    sight: Visibility  #: by the name that `check --json` has for it

    @property
    def size(self) -> Point:
        """Lengths of the bounding box along x, y and z, scene units."""
        x, y, z = (high - low for low, high in zip(self.low, self.high, strict=True))
        return x, y, z


def extents(scene: Scene) -> tuple[ObjectExtent, ...]:
    """Return the place and the size of each object of a scene."""
    found, (column, row) = [], scene.plate.middle.index
    for number, part in enumerate(scene.objects):
        flags = apertures_in_view(part, scene.frustum, scene.plate)
        rows, columns = (one.tolist() for one in np.nonzero(flags))
        visibility = Visibility(
            apertures=len(rows),
            of=flags.size,
            columns=(min(columns), max(columns)) if columns else None,
            rows=(min(rows), max(rows)) if rows else None,
            middle=bool(flags[row, column]),
            corners=(
                bool(flags[0, 0]),
                bool(flags[0, -1]),
                bool(flags[-1, 0]),
                bool(flags[-1, -1]),
            ),
        )
        (low, high), share = box(part), share_in_reach(part, scene.frustum)
        extent = ObjectExtent(
            number=number,
            name=part.name,
            triangles=len(part.faces),
            low=low,
            high=high,
            share_in_reach=share,
            sight=visibility,
        )
        found.append(extent)
    return tuple(found)


def triangles_in_chunks(
    part: SceneObject, at_once: int = TRIANGLES_AT_ONCE // 4
) -> Iterator[Floats]:
    """Yield (F, 3, 3) corners of the triangles that have an area, some at a time: cutting takes memory."""
    for start in range(0, len(part.faces), at_once):
        triangles = part.vertices[part.faces[start : start + at_once]]
        yield triangles[has_area(triangles)]


def box(part: SceneObject) -> tuple[Point, Point]:
    """Return the lowest and the highest coordinates of an object's triangles."""
    corners = part.vertices[part.faces.ravel()]
    x0, y0, z0 = corners.min(axis=0, initial=np.inf).tolist()
    x1, y1, z1 = corners.max(axis=0, initial=-np.inf).tolist()
    return (x0, y0, z0), (x1, y1, z1)


def in_plate(part: SceneObject) -> int:
    """Return how many triangles of an object lie in the plate and have an area, within `PLATE_ROUNDING`."""
    allowed = PLATE_ROUNDING * float(np.abs(part.vertices).max(initial=0.0))
    flat = part.faces[(np.abs(part.vertices[:, 2]) <= allowed)[part.faces].all(axis=1)]
    # Coordinates are scaled to at most one, so that areas neither underflow nor overflow.
    corners = part.vertices[flat] * (PLATE_ROUNDING / allowed if allowed else 1.0)
    return int(
        np.count_nonzero(_areas(corners) > PLATE_ROUNDING * np.ptp(corners, axis=1).max(axis=1))
    )


def share_in_reach(part: SceneObject, frustum: Frustum) -> float | None:
    """Return the share of an object's surface between the ends of the reach; None where it has no area."""
    toward, back = frustum.reach
    whole = within = 0.0
    # Coordinates are scaled to at most one, so that areas neither underflow nor overflow.
    size = max(float(np.abs(part.vertices).max()), np.finfo(np.float64).tiny)
    for triangles in triangles_in_chunks(part):
        area = _areas(triangles / size)
        whole += float(area.sum())
        within += float((area * share_between(triangles, -back, toward)).sum())
    return within / whole if whole > 0 else None


def _areas(triangles: Floats) -> Floats:
    """Return the (F,) areas of triangles (F, 3, 3), square scene units."""
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2)


def share_between(triangles: Floats, low: float, high: float) -> Floats:
    """Return the (F,) share of each triangle's area that lies between two heights, both ends included."""
    lowest, middle, highest = z = np.sort(triangles[..., 2], axis=1).T

    def quotient(part: Floats, whole: Floats) -> Floats:
        # Quotients outside 0 to 1 are not used, and might overflow.
        usable = (whole > 0) & (part >= 0) & (part <= whole)
        return np.divide(part, whole, out=np.ones(z.shape[1]), where=usable)

    def below(height: float) -> Floats:
        # The length of a triangle's section grows linearly from its lowest corner to its middle
        # one, and shrinks linearly from there: the area below is quadratic in the height on either
        # side.
        rise, fall = height - lowest, highest - height
        rising = quotient(rise, highest - lowest) * quotient(rise, middle - lowest)
        falling = quotient(fall, highest - lowest) * quotient(fall, highest - middle)
        within = np.where(height < middle, rising, 1.0 - falling)
        return np.where(height <= lowest, 0.0, np.where(height >= highest, 1.0, within))

    inside = (lowest >= low) & (lowest <= high)
    return np.where(lowest == highest, inside, np.clip(below(high) - below(low), 0.0, 1.0))


# In view
# -------------------------------------------------------------------------------------------------


Layer = tuple[Floats, Mask, bool]
"""The parts of F triangles between two heights on one side of the plate: (F, 9, 3) corners of each part in no
order, (F, 9) whether each exists, and whether the layer lies behind the plate, z <= 0. Within it
the film coordinate of a point, and the range of apertures that see it, are functions of the point's
height without a
pole: over a convex part they are extreme at its corners."""


def _layers(triangles: Floats, frustum: Frustum) -> Iterator[Layer]:
    """Cut triangles (F, 3, 3) by the reach, the plate, and the height of the projection screen."""
    toward, back = frustum.reach
    heights = [-back, 0.0, toward]
    if frustum.screen is not None and -back < frustum.screen.height < toward:
        heights.append(frustum.screen.height)
    z, ends = triangles[..., 2], np.roll(triangles, -1, axis=1)
    for low, high in pairwise(sorted(heights)):
        corners, valid = [triangles], [(z >= low) & (z <= high)]
        for height in (low, high):
            above, below = ends[..., 2] - height, z - height
            crossing = (above > 0) != (below > 0)
            share = np.divide(below, below - above, out=np.zeros_like(z), where=crossing)
            points = triangles + share[..., None] * (ends - triangles)
            points[..., 2] = height
            corners.append(points)
            valid.append(crossing)
        yield np.concatenate(corners, axis=1), np.concatenate(valid, axis=1), high <= 0


def _centers_between(low: Floats, high: Floats, valid: Mask, count: int) -> tuple[Indices, Indices]:
    """Return the (F,) first and last of `count` cells of [-1, 1] whose centers lie between extremes.

    Cell k has its center at (2 k + 1)/n - 1. The extremes are those of values (F, 9) at the valid
    corners of a layer; NaN stands for any number.
    """
    least = np.where(valid, np.where(np.isnan(low), -np.inf, low), np.inf).min(axis=1)
    most = np.where(valid, np.where(np.isnan(high), np.inf, high), -np.inf).max(axis=1)
    first = np.ceil(np.clip((least + 1) * count / 2 - 0.5 - FILM_MARGIN_PX, 0, count))
    last = np.floor(np.clip((most + 1) * count / 2 - 0.5 + FILM_MARGIN_PX, -1, count - 1))
    return first.astype(np.int64), last.astype(np.int64)


def in_view(part: SceneObject, frustum: Frustum, aperture: Aperture) -> bool:
    """Return whether an aperture's image can show any of an object; False is certain."""
    return any(
        bool(_can_be_shown(triangles, layer, frustum, aperture).any())
        for triangles in triangles_in_chunks(part, VIEW_CHUNK_TRIANGLES)
        for layer in _layers(triangles, frustum)
    )


def _can_be_shown(triangles: Floats, layer: Layer, frustum: Frustum, aperture: Aperture) -> Mask:
    """Return (F,) whether a pixel's center may lie in the image of each triangle's part in a layer."""
    corners, valid, behind = layer
    shown: Mask = np.asarray(valid.any(axis=1))
    s, (shear, half) = -corners[..., 2], film_window(frustum, aperture)
    for axis, pixels in enumerate(frustum.resolution):
        across = corners[..., axis] - (aperture.x, aperture.y)[axis] - shear[axis] * s
        # The sign is that of the layer: in the plate s is zero, or minus zero, on either side of
        # it. A point in the aperture itself lies on every line, and has no film coordinate.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            u = (across if behind else -across) / (half[axis] * np.abs(s))
        first, last = _centers_between(u, u, valid, pixels)
        shown &= first <= last
    if shown.any():
        shown[shown] = ~_film_beyond_an_edge(triangles[shown], behind, frustum, aperture)
    return shown


def _film_beyond_an_edge(
    triangles: Floats, behind: bool, frustum: Frustum, aperture: Aperture
) -> Mask:
    """Return (F,) whether all corners of the film lie beyond one and the same edge of a triangle.

    A line of direction d through the aperture meets a triangle P0 P1 P2 in P = a + s d only if the
    three determinants det(d, Pi - a, Pj - a), i and j the ends of an edge, have the sign of s times
    that of det(P0 - a, P1 - a, P2 - a). They are linear in d, so four corners speak for the film.
    """
    (kx, ky), (tx, ty) = film_window(frustum, aperture)
    corner = np.array([(kx + u * tx, ky + v * ty, -1.0) for u in (-1, 1) for v in (-1, 1)])
    from_aperture = triangles - (aperture.x, aperture.y, 0.0)
    # Coordinates are scaled to at most one, so that products of three neither underflow nor
    # overflow.
    size = np.abs(from_aperture).max(axis=(1, 2), keepdims=True)
    from_aperture = from_aperture / np.where(size > 0, size, 1.0)
    edge_normals = np.cross(from_aperture, np.roll(from_aperture, -1, axis=1))
    whole = (edge_normals[:, 0] * from_aperture[:, 2]).sum(axis=1)
    side = np.sign(whole) * (1.0 if behind else -1.0)
    # A determinant is a sum of products of numbers of at most one and the slope, a dozen roundings
    # each.
    doubt = 64 * np.finfo(np.float64).eps * np.abs(corner).max()
    beyond = side[:, None, None] * (edge_normals @ corner.T) < -doubt
    return np.asarray((np.abs(whole) > doubt) & beyond.all(axis=2).any(axis=1))


def apertures_drawn(scene: Scene, settings: Sequence[DoubleFrustum]) -> Mask:
    """Return (rows, columns) whether a hogel can show anything, in truth or drawn; False is certain."""
    plate, frustum = scene.plate, scene.frustum
    flags = np.full(plate.hogels[::-1], any(loses_far_plane(scene, one) for one in settings))
    # As `Region` has it: lines of a camera that steps back are farther aside by its half film and
    # its shear.
    step, widened = max(one.near for one in settings), []
    for half, size, axis in zip(
        film_window(frustum, plate.middle)[1], plate.size, (0, 1), strict=True
    ):
        slope = 0.0
        if frustum.screen is not None:
            slope = (abs(frustum.screen.center[axis]) + size / 2) / abs(frustum.screen.height)
        farthest = FAR_MARGIN * frustum.longest_reach + step
        widened.append((half + slope) * step + ROUNDING_MARGIN * (size + (half + slope) * farthest))
    toward, back = frustum.reach
    farther = replace(frustum, reach=(FAR_MARGIN * toward, FAR_MARGIN * back))
    for part in scene.objects:
        flags |= apertures_in_view(part, farther, plate, (widened[0], widened[1]))
        if flags.all():
            break
    return flags


def apertures_in_view(
    part: SceneObject, frustum: Frustum, plate: Plate, widened: tuple[float, float] = (0.0, 0.0)
) -> Mask:
    """Return (rows, columns) whether crossed frusta hold any part of an object; none that does is missed.

    The frusta are wider by a length on all sides, scene units.
    """
    columns, rows = plate.hogels
    # Each rectangle adds +1 where it begins and -1 past its end, in rows and columns: cumulative
    # sums along both are the numbers of rectangles over each aperture.
    steps = np.zeros((rows + 1, columns + 1), dtype=np.int64)
    for triangles in triangles_in_chunks(part):
        split, total = triangles, len(part.faces)
        while 4 * total <= MAX_SPLIT_TRIANGLES:
            a, b, c = split.transpose(1, 0, 2)
            ab, bc, ca = a / 2 + b / 2, b / 2 + c / 2, c / 2 + a / 2
            quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
            split, total = np.concatenate([np.stack(one, axis=1) for one in quarters]), 4 * total
        for layer in _layers(split, frustum):
            (left, right), (low, high) = (
                _aperture_range(layer, frustum, plate, axis, widened[axis]) for axis in (0, 1)
            )
            # Rows are numbered downward, heights upward.
            top, end = rows - 1 - high, rows - low
            some = layer[1].any(axis=1) & (left <= right) & (top < end)
            for r, c, sign in (
                (top, left, 1),
                (top, right + 1, -1),
                (end, left, -1),
                (end, right + 1, 1),
            ):
                np.add.at(steps, (r[some], c[some]), sign)
    return np.asarray(steps.cumsum(axis=0).cumsum(axis=1)[:rows, :columns] > 0)


def _aperture_range(
    layer: Layer, frustum: Frustum, plate: Plate, axis: int, widened: float
) -> tuple[Indices, Indices]:
    """Return the (F,) first and last column, or row counted upward, whose lines may meet each part.

    A point is on a line of the aperture at a where abs(x - s m/S - a (1 - s/S)) <= t abs(s) +
    widened. The screen is at s = S and has its middle at m; without a screen 1/S is zero. In a
    layer 1 - s/S keeps its sign.
    """
    corners, valid, _ = layer
    s = -corners[..., 2]
    half = film_window(frustum, plate.middle)[1][axis]
    x, toward_a = corners[..., axis], np.ones_like(s)
    if frustum.screen is not None:
        depth = -frustum.screen.height
        x = x - s * (frustum.screen.center[axis] / depth)
        toward_a = 1.0 - s / depth
    sign = np.where(np.where(valid, toward_a, 0.0).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    x, toward_a = x * sign, np.abs(toward_a) * (plate.size[axis] / 2)
    aside = half * np.abs(s) + widened
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        low, high = (x - aside) / toward_a, (x + aside) / toward_a
    return _centers_between(low, high, valid, plate.hogels[axis])


def aside_of_frusta(frustum: Frustum, apertures: Sequence[Aperture], axis: int, ends: Ends) -> Ends:
    """Return the least and the largest x (axis 0) or y (1) of the lines of apertures between two heights."""
    # Lines are straight: the extremes lie at the two heights, or in the apertures between these.
    between = [z for z in (*ends, 0.0) if min(ends) <= z <= max(ends)]
    places = []
    for aperture in apertures:
        shear, half = film_window(frustum, aperture)
        middle = (aperture.x, aperture.y)[axis] - np.multiply(between, shear[axis])
        aside = half[axis] * np.abs(between)
        places += [*(middle - aside), *(middle + aside)]
    return float(min(places)), float(max(places))


# By depth
# ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class DepthBin:
    """The content of the frusta between two distances |z| from the plate, on one side of it; scene units."""

    behind: bool
    heights: tuple[float, float]
    nearest: float  #: range of |z| of the content, from the bounding boxes of its triangles
    farthest: float
    triangles: int  #: that reach into the bin, inside the frusta
    share: float  #: of the surface of all bins, by area; 0 where all of it has no area


def depth_bins(scene: Scene, apertures: Iterable[Aperture] | None = None) -> tuple[DepthBin, ...]:
    """Return the bins with content, from behind the plate to before it; apertures count with their cells."""
    region = Region.true(scene, apertures)
    toward, back = scene.frustum.reach
    found = []
    for behind, reach in ((True, back), (False, toward)):
        for heights in pairwise([0.0, *(reach / 2**k for k in range(HALVINGS, -1, -1))]):
            low, high, count, area = np.inf, 0.0, 0, 0.0
            for part in scene.objects:
                for triangles in triangles_in_chunks(part):
                    ends, one = _held(triangles, region, behind, heights)
                    low, high = min(low, ends.min(initial=np.inf)), max(high, ends.max(initial=0.0))
                    count, area = count + len(ends), area + one
            content = DepthBin(
                behind=behind,
                heights=heights,
                nearest=float(low),
                farthest=float(high),
                triangles=count,
                share=area,
            )
            found += [content] if count else []
    whole = sum(one.share for one in found) or 1.0
    found.sort(key=lambda one: one.heights[1] * (-1 if one.behind else 1))
    return tuple(replace(one, share=one.share / whole) for one in found)


def _held(triangles: Floats, region: Region, behind: bool, heights: Ends) -> tuple[Floats, float]:
    """Return (N, 2) distances of triangles (F, 3, 3) that reach into a bin and a region, and their area."""
    near, far = heights
    low_z, high_z = (-far, -near) if behind else (near, far)
    distances = triangles[..., 2] * (-1 if behind else 1)
    least, most = distances.min(axis=1), distances.max(axis=1)
    # One that lies between two bins belongs to the inner one; one in the plate, to both sides.
    outer_end = np.where(least == most, least <= far, least < far)
    inner_end = (most > near) | ((least == most) & (most == 0) & (near == 0))
    inside = triangles[outer_end & inner_end]
    low, high = inside.min(axis=1), inside.max(axis=1)
    low[:, 2], high[:, 2] = np.maximum(low[:, 2], low_z), np.minimum(high[:, 2], high_z)
    held = region.holds(low, high) if len(inside) else np.zeros(0, dtype=np.bool_)
    kept = inside[held]
    area = float((_areas(kept) * share_between(kept, low_z, high_z)).sum())
    return np.abs(np.stack((low[held, 2], high[held, 2]), axis=1)), area


# In words
# ------------------------------------------------------------------------------------------------


def require_seen(scene: Scene, apertures: Sequence[Aperture]) -> None:
    """Raise InputError, with sizes, if a scene has objects and none of the apertures can show any of them."""
    if sentence := unseen_sentence(scene, apertures):
        raise InputError(sentence)


def unseen_sentence(scene: Scene, apertures: Sequence[Aperture]) -> str | None:
    """Say why apertures see nothing, as `unseen_facts` does, and what to do about it; None where they see."""
    facts = unseen_facts(scene, apertures)
    command = shlex.join(("xfrustum", "check", scene.source or scene.name))
    advice = "Change the object's scale or translate, or the frustum's reach"
    return facts and f"{facts}. {advice}; `{command}` shows where everything lies"


def unseen_facts(scene: Scene, apertures: Sequence[Aperture]) -> str | None:
    """Say with sizes why apertures see nothing; None where one sees an object, or where there are none."""
    # Most often the first aperture answers. Millions may be asked for, which are never listed.
    first = next(iter(apertures), None)
    if first is not None and any(in_view(part, scene.frustum, first) for part in scene.objects):
        return None
    for part in scene.objects:
        # The count over the whole plate first leaves out apertures that see nothing.
        flags = apertures_in_view(part, scene.frustum, scene.plate)
        if any(
            flags[one.row, one.column] and in_view(part, scene.frustum, one) for one in apertures
        ):
            return None
    if not scene.objects:
        return None
    few = enumerate(scene.objects[:MAX_NAMED_OBJECTS])
    named = [
        f"{_called(number, part)} {_why_unseen(scene, part, apertures)}" for number, part in few
    ]
    if more := len(scene.objects) - len(named):
        named.append(f"and {more} more objects are not in view")
    who = f"none of the {len(apertures)} apertures asked for sees anything"
    if len(apertures) >= np.prod(scene.plate.hogels):
        who = "no aperture of the plate sees anything"
    elif len(apertures) == 1:
        who = f"aperture {apertures[0].column},{apertures[0].row} sees nothing"
    return f"{scene.name}: {who} of the scene: {'; '.join(named)}"


def warnings(scene: Scene) -> tuple[str, ...]:
    """Return a sentence for each object that the reach cuts, and for each object that is tiny."""
    (toward, back), units, side = scene.frustum.reach, scene.units, max(scene.plate.size)
    reach = (
        f"and the reach is {length(back)} {units} behind the plate and {length(toward)} before it"
    )
    cut, tiny = [], []
    for number, part in enumerate(scene.objects):
        name, (low, high) = _called(number, part), box(part)
        if low[2] < -back or high[2] > toward:
            share = share_in_reach(part, scene.frustum)
            told = f"{name} {_spans(low[2], high[2], units)}, {reach}"
            beyond = "of its surface is beyond and is not imaged"
            cut.append(told if share is None else f"{told}: {_percent(1 - share)} {beyond}")
        if max(np.subtract(high, low)) < MIN_SIZE_FRACTION * side:
            told = f"{name} is {_size(low, high)} {units}, and the plate is {length(side)} {units} wide"
            tiny.append(f"{told}: give it a scale if it is in other units")
    return (*_first(cut), *_first(tiny))


def plate_warnings(scene: Scene) -> tuple[str, ...]:
    """Return a sentence for each object with triangles in the plate, where displacement is undefined."""
    told = (
        "lie in the plate, within rounding: displacement is undefined there, and no plan holds for apertures "
        "that show it; move it before or behind the plate"
    )
    found = []
    for number, part in enumerate(scene.objects):
        if count := in_plate(part):
            found.append(
                f"{_called(number, part)}: {count:,} of its {len(part.faces):,} triangles {told}"
            )
    return _first(found)


def facing_warnings(scene: Scene) -> tuple[str, ...]:
    """Return a sentence for each object most of which is seen from behind, where `--cull back` leaves it out.

    The middle aperture and the plate's corners are looked through, by a tracer alone: nothing is
    certified.
    """
    from xfrustum.compare.metrics.error_maps import turned_away  # noqa: PLC0415 - loads SciPy
    from xfrustum.reference import Reference  # noqa: PLC0415 - loads ray tracers

    coarse = replace(scene, frustum=replace(scene.frustum, resolution=FACING_RESOLUTION))
    reference, found = Reference(coarse), []
    seen = np.zeros((2, len(scene.objects)), dtype=np.int64)
    for aperture in dict.fromkeys((scene.plate.middle, *scene.plate.corners)):
        image = reference.propose(aperture, colored=False)
        chosen = (image.covered, image.covered & turned_away(image))
        seen += [
            np.bincount(image.object[pixels], minlength=len(scene.objects)) for pixels in chosen
        ]
    for number, (part, whole, away) in enumerate(zip(scene.objects, *seen.tolist(), strict=True)):
        if 2 * away > whole:
            told = f"{_percent(away / whole)} of what is seen of {_called(number, part)} faces away from the "
            told += "viewer, and `--cull back` leaves it out; flip_winding = true in its table turns the winding "
            found.append(f"{told}of its faces")
    return _first(found)


def _called(number: int, part: SceneObject) -> str:
    return f"object {number} ({Path(part.name).name})"


def _first(found: list[str]) -> tuple[str, ...]:
    """Return the first few sentences; the last one ends with the number of sentences that are left out."""
    named, more = found[:MAX_NAMED_OBJECTS], len(found) - MAX_NAMED_OBJECTS
    return (
        tuple(named) if more <= 0 else (*named[:-1], f"{named[-1]}; and so for {more} more objects")
    )


def _why_unseen(scene: Scene, part: SceneObject, apertures: Sequence[Aperture]) -> str:
    """Say with sizes why apertures see nothing of an object: beyond the reach, aside, or too small."""
    (toward, back), units, (low, high) = scene.frustum.reach, scene.units, box(part)
    if share_in_reach(part, scene.frustum) is None:
        return "has triangles without area alone"
    for beyond, reach in ((high[2] < -back, back), (low[2] > toward, toward)):
        if beyond:
            return f"{_spans(low[2], high[2], units)}; the reach is {length(reach)} {units} there"
    if share_in_reach(part, scene.frustum) == 0.0:
        reaches = f"{length(back)} {units} behind the plate and {length(toward)} before it"
        return f"lies beyond the reach of {reaches}"
    # How far aside of the lines the box lies: the gap between them, and their ends from the plate's
    # middle.
    ends, gaps = (max(low[2], -back), min(high[2], toward)), list[tuple[float, str]]()
    for axis, words in enumerate((("to the left of", "to the right of"), ("below", "above"))):
        left, right = aside_of_frusta(scene.frustum, apertures, axis, ends)
        for gap, first, last, limit, word in (
            (left - high[axis], -high[axis], -low[axis], -left, words[0]),
            (low[axis] - right, low[axis], high[axis], right, words[1]),
        ):
            told = f"lies {_range(first, last)} {units} {word} the plate's middle"
            gaps.append(
                (gap, f"{told}; at its height the lines end {length(limit)} {units} from there")
            )
    widest, aside = max(gaps, key=lambda one: one[0])
    if widest > 0:
        return aside
    where = f"is {_size(low, high)} {units}, {heights(low[2], high[2], units)}"
    flags = apertures_in_view(part, scene.frustum, scene.plate)
    if any(flags[one.row, one.column] for one in apertures):
        return f"{where}, and falls between the centers of pixels: it needs a larger scale, or other units"
    return f"{where}, and lies beside the lines of the image"


def length(value: float) -> str:
    """Write a length in four digits, thousands between commas."""
    if value == 0 or 1e-3 <= abs(value) < 1e6:
        digits = 3 - int(np.floor(np.log10(abs(value)))) if value else 0
        text = f"{value:,.{max(digits, 0)}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.4g}"


def heights(low: float, high: float, units: str) -> str:
    """Say between which heights something lies, as distances from the plate."""
    if low == high == 0:
        return "in the plate"
    if low < 0 < high:
        return f"from {length(-low)} {units} behind the plate to {length(high)} {units} before it"
    if high <= 0:
        return f"{_range(-high, -low)} {units} behind the plate"
    return f"{_range(low, high)} {units} before the plate"


def _spans(low: float, high: float, units: str) -> str:
    """Say between which heights something lies, with the verb: a flat object lies at one height."""
    return f"{'lies' if length(low) == length(high) else 'spans'} {heights(low, high, units)}"


def _range(low: float, high: float) -> str:
    return length(low) if length(low) == length(high) else f"{length(low)} to {length(high)}"


def _size(low: Point, high: Point) -> str:
    return " x ".join(length(b - a) for a, b in zip(low, high, strict=True))


def _percent(share: float) -> str:
    """Write a share as percent without calling some of it none or all of it."""
    if 0 < share < 0.001:
        return "less than 0.1 %"
    return "more than 99.9 %" if 0.999 < share < 1 else f"{100 * share:.3g} %"
