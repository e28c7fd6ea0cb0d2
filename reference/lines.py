"""Lines of pixels, which define the truth, and triangles on these lines, in NumPy.

Source: CONVENTIONS.md, "Frames"; the paper, sections 3 and 5. Planes of triangles and distances
from them have no rounding bounds. Facing, which determines the culled triangles (paper, section 3),
is exact.
"""

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Floats, Indices, Numbers
from xfrustum.scenes.model.scene import read_only
from xfrustum.scenes.plate import (
    Aperture,
    Camera,
    Cull,
    DoubleFrustum,
    Frustum,
    Offset,
    Pivot,
    PlateTile,
)

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class RayBundle:
    """All lines of one image: the lines of all pixels pass through a common point.

    The line of column c, row r is P(s) = center + s d with d = (dx[c], dy[r], -1). These doubles
    define the image, regardless of the rounding in their computation.
    """

    center: Vector  #: The common point in scene units: the aperture, or an offset camera
    #: shear, half_extent: k and t, slopes per unit of depth
    shear: tuple[float, float]
    half_extent: tuple[float, float]
    resolution: tuple[int, int]  #: W, H in pixels
    #: Only surfaces with s in this closed interval are imaged; the smallest s is visible
    s_range: tuple[float, float]

    @cached_property
    def dx(self) -> Floats:
        """(W,) x slopes of the columns, ascending."""
        u = (2.0 * np.arange(self.resolution[0]) + 1.0) / self.resolution[0] - 1.0
        return read_only(self.shear[0] + u * self.half_extent[0])

    @cached_property
    def dy(self) -> Floats:
        """(H,) y slopes of the rows, descending: row 0 is at the top."""
        v = 1.0 - (2.0 * np.arange(self.resolution[1]) + 1.0) / self.resolution[1]
        return read_only(self.shear[1] + v * self.half_extent[1])

    def directions(self, rows: slice = slice(None)) -> Floats:
        """Return d of every pixel in some rows, (rows, W, 3)."""
        dy = self.dy[rows]
        d = np.empty((len(dy), len(self.dx), 3))
        d[..., 0] = self.dx
        d[..., 1] = dy[:, None]
        d[..., 2] = -1.0
        return d


@dataclass(frozen=True, kw_only=True, eq=False)
class LineGrid:
    """Lines in columns and rows, each through its own point of the plate.

    The line of column i, row j is P(s) = (x[i], y[j], 0) + s (dx[i], dy[j], -1), so that z = -s.
    """

    #: x, dx: (W,) positions at which the columns' lines meet the plate, and slopes
    x: Floats
    dx: Floats
    #: y, dy: (H,) positions and slopes of the rows' lines
    y: Floats
    dy: Floats
    #: Only surfaces with s in this closed interval are imaged; the smallest s is visible
    s_range: tuple[float, float]

    @property
    def resolution(self) -> tuple[int, int]:
        """W, H: number of columns and rows."""
        return len(self.x), len(self.y)

    def points(self) -> Floats:
        """Return the points (H, W, 3) at which the lines meet the plate."""
        return _spread(self.x, self.y, 0.0)

    def directions(self) -> Floats:
        """Return d of every line, (H, W, 3)."""
        return _spread(self.dx, self.dy, -1.0)

    def line(self, column: int, row: int) -> RayBundle:
        """Return one line as the bundle of a film with one pixel."""
        return RayBundle(
            center=(float(self.x[column]), float(self.y[row]), 0.0),
            shear=(float(self.dx[column]), float(self.dy[row])),
            half_extent=(1.0, 1.0),
            resolution=(1, 1),
            s_range=self.s_range,
        )


def _spread(across: Floats, down: Floats, height: float) -> Floats:
    values = np.empty((len(down), len(across), 3))
    values[..., 0], values[..., 1], values[..., 2] = across, down[:, None], height
    return values


@dataclass(frozen=True, kw_only=True, eq=False)
class PixelLines(LineGrid):
    """Lines of one pixel of all hogels of a tile: parallel, or through one point of the screen.

    Slopes dx ascend with the columns and slopes dy descend with the rows of the grid; parallel
    lines have ascending x and descending y. The grid has the order of the tile if `step` is 1, and
    the reverse order if `step` is -1, because slopes of lines through a point of a screen behind
    the plate descend with x.
    """

    pitch: tuple[float, float]  #: distance of neighboring apertures in x and y
    #: point of the screen through which the lines pass, except for rounding; None if parallel
    center: Vector | None
    step: int

    def apart(self) -> tuple[float, float]:
        """Return bounds, in x and y, of the distance of lines from `center` at its height."""
        assert self.center is not None
        depth, bounds = -self.center[2], []
        for at, place, slope in zip(
            self.center[:2], (self.x, self.y), (self.dx, self.dy), strict=True
        ):
            # The three operations round the distance by less than 4 u of their terms.
            size = np.abs(place).max() + abs(depth) * np.abs(slope).max() + abs(at)
            bounds.append(float(np.abs(place + depth * slope - at).max() + 2.0**-51 * size))
        return bounds[0], bounds[1]


class TileLines:
    """Lines of all pixels of the hogels of a tile, bit for bit the lines of the hogels' frusta."""

    def __init__(self, frustum: Frustum, tile: PlateTile) -> None:
        self._frustum, self.tile = frustum, tile
        plate, columns, rows = tile.plate, tile.columns, tile.rows
        step = -1 if frustum.screen is not None and frustum.screen.height < 0 else 1
        self._step = step
        across = [crossed_frustum(frustum, plate.aperture(n, rows[0])) for n in columns[::step]]
        down = [crossed_frustum(frustum, plate.aperture(columns[0], n)) for n in rows[::step]]
        self._x = np.array([bundle.center[0] for bundle in across])
        self._y = np.array([bundle.center[1] for bundle in down])
        # Slopes by column (or row) of pixels, then by column (or row) of hogels.
        self._dx = np.stack([bundle.dx for bundle in across], axis=1)
        self._dy = np.stack([bundle.dy for bundle in down], axis=1)

    def of_pixel(self, pixel: tuple[int, int]) -> PixelLines:
        """Return the lines of one pixel (column, row) of all hogels of the tile."""
        (column, row), plate, frustum = pixel, self.tile.plate, self._frustum
        return PixelLines(
            x=self._x,
            dx=self._dx[column],
            y=self._y,
            dy=self._dy[row],
            pitch=(plate.size[0] / plate.hogels[0], plate.size[1] / plate.hogels[1]),
            s_range=(-frustum.reach[0], frustum.reach[1]),
            center=_screen_point(frustum, pixel),
            step=self._step,
        )


def _screen_point(frustum: Frustum, pixel: tuple[int, int]) -> Vector | None:
    """Return the point of the screen on a pixel's lines in all hogels; None without a screen."""
    if (screen := frustum.screen) is None:
        return None
    u = (2.0 * pixel[0] + 1.0) / frustum.resolution[0] - 1.0
    v = 1.0 - (2.0 * pixel[1] + 1.0) / frustum.resolution[1]
    # For a screen in front of the plate the image is mirrored in both axes.
    side = 1 if screen.height < 0 else -1
    (x, y), (width, height) = screen.center, screen.size
    return x + side * u * width / 2, y + side * v * height / 2, screen.height


def pixel_places(points: NDArray[np.floating], bundle: RayBundle) -> Floats:
    """Return the film positions of surface points (..., 3), also of points beyond the range.

    Column and row (..., 2) are integers at pixel centers, and rows count down. They are NaN for
    points at the height of the center, which have no position on the film.
    """
    x, y, z = np.asarray(points, dtype=np.float64).reshape(-1, 3).T
    # Points at the height of the center get the height NaN.
    places = places_off_center(x, y, np.where(z == bundle.center[2], np.nan, z), bundle)
    return np.stack(places, axis=-1).reshape(*points.shape[:-1], 2)


def places_off_center(x: Floats, y: Floats, z: Floats, bundle: RayBundle) -> tuple[Floats, Floats]:
    """Return the `pixel_places` of points (N,) that are not at the height of the center."""
    # Each step overwrites its input: for whole images, memory traffic dominates the time.
    depth = z - bundle.center[2]
    np.negative(depth, out=depth)
    places = []
    for axis, values in enumerate((x, y)):
        place = values - bundle.center[axis]
        place /= depth
        place -= bundle.shear[axis]
        place /= bundle.half_extent[axis]
        places.append(place)
    columns, rows = places
    width, height = bundle.resolution
    columns += 1
    np.subtract(1, rows, out=rows)
    for place, side in ((columns, width), (rows, height)):
        np.multiply(place, side, out=place)
        np.divide(place, 2, out=place)
        np.subtract(place, 0.5, out=place)
    return columns, rows


def film_window(
    frustum: Frustum, aperture: Aperture
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return shear k and half-extent t of an aperture's film, slopes per unit of depth.

    Centered: k = 0, t = tan(fov / 2). Recentered (paper, section 5): the lines of the film's
    corners pass through the screen's corners. The screen may be on either side of the plate.
    """
    if frustum.screen is None:
        assert frustum.fov is not None
        return (0.0, 0.0), (math.tan(frustum.fov[0] / 2), math.tan(frustum.fov[1] / 2))
    screen = frustum.screen
    s_screen = -screen.height
    shear = ((screen.center[0] - aperture.x) / s_screen, (screen.center[1] - aperture.y) / s_screen)
    half_extent = (screen.size[0] / 2 / abs(s_screen), screen.size[1] / 2 / abs(s_screen))
    return shear, half_extent


def crossed_frustum(frustum: Frustum, aperture: Aperture) -> RayBundle:
    """Return the true frustum of an aperture: lines from the viewer's side through the aperture."""
    shear, half_extent = film_window(frustum, aperture)
    return RayBundle(
        center=(aperture.x, aperture.y, 0.0),
        shear=shear,
        half_extent=half_extent,
        resolution=frustum.resolution,
        s_range=(-frustum.reach[0], frustum.reach[1]),
    )


@dataclass(frozen=True, kw_only=True)
class ExactCamera:
    """One camera of the double frustum, as exact lines."""

    orthoscopic: bool  #: True for C, False for C*
    #: The camera's lines; s is the distance from its center along the axis, negative for C*
    bundle: RayBundle

    @property
    def heights(self) -> tuple[float, float]:
        """Lowest and highest z that the camera images."""
        first, last = self.bundle.s_range
        return self.bundle.center[2] - last, self.bundle.center[2] - first


def model_cameras(
    frustum: Frustum, aperture: Aperture, settings: DoubleFrustum
) -> tuple[ExactCamera, ...]:
    """Return the cameras of some settings as exact lines in drawing order (paper, section 4).

    The order is from back to front: the slabs of C from the outermost inward, then the slabs of C*
    from the innermost outward. Each slab is closer to the viewer than the slabs before it, and is
    drawn over them. Together the cameras show the picture of a rasterizer without rounding.
    """
    viewer, back = frustum.reach
    c = [
        _slab_camera(frustum, aperture, settings, section, 1) for section in settings.sections(back)
    ]
    c_star = [
        _slab_camera(frustum, aperture, settings, section, -1)
        for section in settings.sections(viewer)
    ]
    return {
        Camera.BOTH: (*reversed(c), *c_star),
        Camera.C: tuple(reversed(c)),
        Camera.C_STAR: tuple(c_star),
    }[settings.camera]


def _slab_camera(
    frustum: Frustum,
    aperture: Aperture,
    settings: DoubleFrustum,
    section: tuple[float, float],
    side: int,
) -> ExactCamera:
    """Return C (side 1) or C* (side -1) for the surfaces between two heights |z|.

    The camera of the first slab is offset from the plate by near; all other cameras are in the
    aperture itself.
    """
    low, high = section
    first = low == 0
    step = settings.near if first and settings.offset is Offset.PLATE else 0.0
    bundle = offset_camera(
        crossed_frustum(frustum, aperture),
        side * step,
        pivot=settings.pivot,
        fitted=settings.fitted_height(frustum) if first else None,
    )
    begin, end = (settings.near if first else low), step + high
    s_range = (begin, end) if side == 1 else (-end, -begin)
    return ExactCamera(orthoscopic=side == 1, bundle=replace(bundle, s_range=s_range))


def offset_camera(
    crossed: RayBundle, height: float, *, pivot: Pivot, fitted: float | None
) -> RayBundle:
    """Return the lines of an offset camera.

    The camera is moved from the aperture of `crossed` to a signed height, +n for C and -n for C*.
    `pivot` selects the direction: along the axis of the sheared frustum, to (ax -+ n kx, ay -+ n
    ky, +-n), or perpendicular to the plate. `fitted` is the height |z| of the plane that is drawn
    without displacement; None keeps the angle. The caller sets the range of s.
    """
    (x, y, _), (kx, ky), (tx, ty) = crossed.center, crossed.shear, crossed.half_extent
    aside = height if pivot is Pivot.APERTURE else 0.0
    if fitted is not None and height:
        shrink = fitted / (fitted + abs(height))
        tx, ty = tx * shrink, ty * shrink
    return replace(crossed, center=(x - aside * kx, y - aside * ky, height), half_extent=(tx, ty))


def cross_products(a: Floats, b: Floats) -> Floats:
    """Return the cross products of vectors (N, 3), three times as fast as `np.cross`."""
    (ax, ay, az), (bx, by, bz) = np.ascontiguousarray(a.T), np.ascontiguousarray(b.T)
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), axis=1)


def triangle_normals(corners: Floats) -> Floats:
    """Return the cross products of the first two edges of triangles (N, 3, 3)."""
    return cross_products(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def plane_places(corners: Floats, normals: Floats, center: Floats, directions: Floats) -> Floats:
    """Return s (N,) at which lines center + s d meet the planes of triangles (N, 3, 3).

    There is one triangle for each line. `normals` are the `triangle_normals`. s is not finite if a
    line is parallel to the plane, or if the triangle has no area.
    """
    offset = np.einsum("ij,ij->i", normals, corners[:, 0] - center)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(offset / np.einsum("ij,ij->i", normals, directions))


def distance_to_triangles(points: Floats, corners: Floats) -> Floats:
    """Return the distance of each point (N, 3) from its own triangle, (N, 3, 3)."""
    normals = triangle_normals(corners)
    length = np.linalg.norm(normals, axis=1)
    unit = normals / np.where(length > 0, length, 1.0)[:, None]
    inside = length > 0
    nearest_edge = np.full(len(points), np.inf)
    for k in range(3):
        # The point projects into the triangle if it is on the inner side of all three edges.
        start, edge = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        along = points - start
        inside &= np.einsum("ij,ij->i", cross_products(edge, along), normals) >= 0
        squared = np.einsum("ij,ij->i", edge, edge)
        share = np.einsum("ij,ij->i", along, edge) / np.where(squared > 0, squared, 1.0)
        foot = along - np.clip(share, 0.0, 1.0)[:, None] * edge
        nearest_edge = np.minimum(nearest_edge, np.linalg.norm(foot, axis=1))
    from_plane = np.abs(np.einsum("ij,ij->i", points - corners[:, 0], unit))
    return np.where(inside, from_plane, nearest_edge)


#: Rounding bound of a determinant of differences, in 2^-53 of the sum of absolute products: one for
#: each of three differences of coordinates, two products and three sums. Shewchuk (1997), section
#: 4.3, proves 7 and a term of second order.
DETERMINANT_ROUNDINGS = 8

#: Magnitude above which underflow cannot change the sign of a determinant of three factors:
#: underflow errors are about 2^-1074 times coordinates, and float32 coordinates are below 2^128
SMALLEST_SURE = 2.0**-900


def facing(triangles: Floats, bundle: RayBundle) -> Numbers:
    """Return the facing of triangles (F, 3, 3): 1 to the viewer, -1 away, 0 exactly edge-on.

    A triangle faces the viewer if its corners are counterclockwise as seen by the viewer along the
    pencil's lines. All surfaces on these lines are on one side of the center, so that lines meet
    the triangle on the side on which the center lies.
    """
    center = np.asarray(bundle.center)
    a, b, c = (triangles[:, corner] - center for corner in range(3))
    products = cross_products(b, c)
    determinant = np.einsum("ij,ij->i", a, products)
    magnitude = np.einsum("ij,ij->i", np.abs(a), _sums_of_magnitudes(b, c))
    sign = np.sign(determinant).astype(np.int32)
    bound = DETERMINANT_ROUNDINGS * 2.0**-53 * magnitude + SMALLEST_SURE
    doubtful = np.flatnonzero(np.abs(determinant) <= bound)
    sign[doubtful] = _exact_signs(triangles, center, doubtful)
    # If the determinant is negative, the normal (by winding order) points toward the center. Lines
    # to surfaces in front of the plate leave the center backward, so that the center is on the side
    # opposite to the viewer.
    return np.asarray(sign if bundle.s_range[0] < 0 else -sign)


def drawn_triangles(triangles: Floats, bundle: RayBundle, cull: Cull) -> Indices:
    """Return the numbers of the triangles that a camera draws, ascending; see `facing`."""
    if cull is Cull.NONE:
        return np.arange(len(triangles))
    # A triangle seen edge-on covers nothing.
    return np.flatnonzero(facing(triangles, bundle) > 0)


def _sums_of_magnitudes(b: Floats, c: Floats) -> Floats:
    """Return the sums of absolute products in cross products, (N, 3)."""
    (bx, by, bz), (cx, cy, cz) = np.abs(b).T, np.abs(c).T
    return np.stack((by * cz + bz * cy, bz * cx + bx * cz, bx * cy + by * cx), axis=1)


def _exact_signs(triangles: Floats, center: Floats, numbers: Indices) -> Numbers:
    """Return the signs of determinants of corners relative to the center, exactly."""
    origin = [Fraction(coordinate) for coordinate in center.tolist()]
    signs = []
    for corners in triangles[numbers].tolist():
        a, b, c = (
            [Fraction(value) - start for value, start in zip(corner, origin, strict=True)]
            for corner in corners
        )
        determinant = (
            a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
        )
        signs.append((determinant > 0) - (determinant < 0))
    return np.array(signs, dtype=np.int32)
