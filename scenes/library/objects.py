"""Objects of the built-in scenes: a car, and targets that reveal errors.

**Car**, of about 42,000 triangles: plain, and in a studio. In its coordinates x is to the side, y
up and z forward, in millimeters. The wheels stand on y = 0, and the car is 100 long, 42 wide and 32
high. It was modeled for this project: `car.npz` beside this module has vertices in nanometers,
faces, and the faces of wheels that belong to rims.

**Targets** for orientation, depth order, the cut at the plate, reflection, and averaging. Lengths
are millimeters; the plate is 80 x 60 with 81 x 61 apertures, and the reach is 150 on both sides.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes import SceneObject, shapes
from xfrustum.scenes.appearance import Appearance, DirectionalLight, Environment, Material
from xfrustum.scenes.arrays import Floats

_PER_MILLIMETER = 1e6  # units of stored coordinates


@cache
def _stored() -> dict[str, NDArray[Any]]:
    with np.load(Path(__file__).with_name("car.npz")) as file:
        return dict(file)


def car() -> tuple[SceneObject, ...]:
    """Return the car across the plate, turned by 35 degrees, its hood below the middle aperture.

    Its parts are body, glass, wheels and trim.
    """
    scene_from_car, stored = (
        shapes.placement(1.0, (0.0, 35.0, 0.0), (-14.0, -27.0, -17.0)),
        _stored(),
    )
    parts = []
    for name in ("body", "glass", "wheels", "trim"):
        mesh = stored[f"{name}_vertices"] / _PER_MILLIMETER, stored[f"{name}_faces"]
        parts.append(shapes.place(shapes.as_object(f"car {name}", mesh), scene_from_car))
    return tuple(parts)


_MATERIALS = MappingProxyType({
    "paint": Material(ambient=(0.03, 0.006, 0.008), diffuse=(0.42, 0.045, 0.05),
                      specular=(0.35,) * 3,
                      exponent=50.0, reflectivity=(0.16,) * 3),
    "glass": Material(ambient=(0.004, 0.006, 0.007), diffuse=(0.015, 0.022, 0.025),
                      specular=(0.6,) * 3,
                      exponent=200.0, reflectivity=(0.3, 0.32, 0.34)),
    "tire": Material(ambient=(0.008,) * 3, diffuse=(0.035,) * 3, specular=(0.04,) * 3,
                     exponent=8.0),
    "metal": Material(ambient=(0.02,) * 3, diffuse=(0.12, 0.12, 0.13), specular=(0.5,) * 3,
                      exponent=80.0, reflectivity=(0.55, 0.55, 0.58)),
})  # fmt: skip

_LIGHTS = (
    DirectionalLight(direction=(-2.0, 3.0, 2.0), color=(0.9, 0.87, 0.8)),
    DirectionalLight(direction=(3.0, 1.0, 1.5), color=(0.2, 0.24, 0.32)),
    DirectionalLight(direction=(0.5, 1.5, -3.0), color=(0.3, 0.3, 0.28)),
)


def studio_car() -> tuple[SceneObject, ...]:
    """Return the car with smooth normals, a material on every part, and separate rims and tires."""
    body, glass, wheels, trim = map(shapes.smoothed, car())
    rims = _stored()["rims"]
    return (
        replace(body, material="paint"),
        replace(glass, material="glass"),
        replace(wheels, name="car tires", faces=wheels.faces[~rims], material="tire"),
        replace(wheels, name="car rims", faces=wheels.faces[rims], material="metal"),
        replace(trim, material="metal"),
    )


def studio() -> Appearance:
    """Return the studio's materials, lights and surroundings."""
    return Appearance(materials=_MATERIALS, lights=_LIGHTS, environment=surroundings())


def surroundings(height: int = 256) -> Environment:
    """Return sky, ground and softboxes as a map of 2 height x height pixels."""
    rows = (np.arange(height) + 0.5) / height
    columns = (np.arange(2 * height) + 0.5) / (2 * height)
    latitude, longitude = 90 - 180 * rows[:, None], 360 * columns[None, :] - 180
    rise = np.clip(latitude / 90, 0, 1)[..., None]
    sky = (1 - rise) * [0.62, 0.66, 0.7] + rise * [0.12, 0.2, 0.42]
    # The ground is brighter toward the right, but uniform at the pole, where all longitudes meet.
    aside = np.sin(np.radians(longitude)) * np.cos(np.radians(latitude))
    ground = (0.16 + 0.05 * aside)[..., None] * [1.0, 0.85, 0.7]
    horizon = _smooth_step(latitude, 0.0, width=6.0)[..., None]
    radiance = horizon * sky + (1 - horizon) * ground
    for (left, right), (low, high), color in (
        ((-170.0, -95.0), (28.0, 46.0), (5.0, 5.0, 4.6)),
        ((105.0, 165.0), (12.0, 18.0), (2.4, 2.0, 1.5)),
        ((-60.0, 20.0), (60.0, 72.0), (2.0, 2.3, 2.8)),
    ):
        across = _smooth_step(longitude, left, width=4.0) * (
            1 - _smooth_step(longitude, right, width=4.0)
        )
        up = _smooth_step(latitude, low, width=4.0) * (1 - _smooth_step(latitude, high, width=4.0))
        radiance = radiance + (across * up)[..., None] * color
    return Environment(radiance=radiance.astype(np.float32), name="studio")


def _smooth_step(angle: Floats, edge: float, *, width: float) -> Floats:
    """Return a smooth cubic step from 0 to 1 about an edge; all angles in degrees."""
    share = np.clip((angle - edge) / width + 0.5, 0, 1)
    return np.asarray(share**2 * (3 - 2 * share))


Vector = tuple[float, float, float]


def asymmetric() -> tuple[SceneObject, ...]:
    """Return different parts on the two sides of the plate, without any symmetry.

    Seen from the middle aperture, the torus in front hides the box behind. The bar crosses the
    plate next to this aperture.
    """
    corners, faces = shapes.box()
    along = corners[:, 2:] + 0.5
    middle = np.array((17.0, 7.0, -75.0)) * (1 - along) + np.array((9.0, -18.0, 75.0)) * along
    bar = middle + corners * (3.0, 3.0, 0.0)  # with square ends parallel to the plate
    return (
        _shape("torus", 19.0, (70.0, 15.0, 0.0), (14.0, 10.0, 60.0)),
        _shape("cone", 13.0, (0.0, 0.0, -65.0), (-15.0, 9.0, 48.0)),
        _shape("sphere", 7.0, (0.0, 0.0, 0.0), (6.0, -9.0, 34.0)),
        _shape("box", 15.0, (25.0, 40.0, 10.0), (-12.5, -8.0, -52.0)),
        _letter(2.6, (8.0, -20.0, 5.0), (-3.0, 15.0, -62.0)),
        _letter(3.2, (-12.0, 30.0, -20.0), (-14.0, -17.0, 70.0)),
        _shape("cylinder", 22.0, (20.0, 0.0, 70.0), (34.0, -9.0, -85.0)),
        shapes.as_object("bar", (bar, faces)),
    )


def _shape(name: str, size: float, rotate_deg: Vector, center: Vector) -> SceneObject:
    return shapes.place(shapes.build_shape(name), shapes.placement(size, rotate_deg, center))


def _letter(size: float, rotate_deg: Vector, center: Vector) -> SceneObject:
    """Return a letter F with strokes of different depths: it has no mirror symmetry."""
    strokes = [
        ((-1.5, 0.0, 0.0), (1.0, 6.0, 1.0)),
        ((0.5, 2.5, 0.5), (3.0, 1.0, 2.0)),
        ((0.0, 0.3, -0.5), (2.0, 1.0, 2.0)),
    ]  # middle and extent of each stroke
    corners, faces = shapes.box()
    letter = shapes.join(*((corners * extent + middle, faces) for middle, extent in strokes))
    return shapes.place(
        shapes.as_object("letter", letter), shapes.placement(size, rotate_deg, center)
    )


#: Height of each row of pairs above or below the plate, as a fraction of the reach.
SHEET_HEIGHTS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
#: Separation of each column of pairs, as a fraction of the reach.
SHEET_SEPARATIONS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


def sheets(*, reach: float) -> tuple[SceneObject, ...]:
    """Return pairs of parallel sheets: object 0 has the upper sheets, toward the viewer.

    Seen from the middle aperture, the pairs behind the plate fill the left half of the film and the
    pairs in front of it the right half. Rows have `SHEET_HEIGHTS`, from the bottom; columns have
    `SHEET_SEPARATIONS`, from the left. In every cell the upper sheet covers the left 7/10 and the
    lower sheet the right 7/10. Both sheets are visible, and a wrong order is visible in the
    overlap.
    """
    upper, lower = [], []
    for side, first_column in ((-1, 0), (1, len(SHEET_SEPARATIONS))):
        for row, height in enumerate(SHEET_HEIGHTS):
            for column, separation in enumerate(SHEET_SEPARATIONS):
                near = side * height * reach
                far = near + side * separation * reach
                cell = (first_column + column, row)
                upper.append(_sheet(max(near, far), cell, (0.0, 0.7)))
                lower.append(_sheet(min(near, far), cell, (0.3, 1.0)))
    return shapes.as_object("upper sheets", shapes.join(*upper)), shapes.as_object(
        "lower sheets", shapes.join(*lower)
    )


#: Slopes of the outermost lines to the sheets: just inside a full angle of 60 degrees.
_SHEET_SLOPES = (-0.55, 0.55)
_LEAN = (0.2, 0.1)
_CELL_FILLED = 0.9


def _sheet(z: float, cell: tuple[int, int], part: tuple[float, float]) -> shapes.Mesh:
    """Return the sheet at height z that fills a part of a film cell's width.

    It is inclined about the cell's middle, because all pixels of a sheet of constant depth would be
    right, or all wrong. The sheets of a pair are parallel.
    """
    grid = (2 * len(SHEET_SEPARATIONS), len(SHEET_HEIGHTS))
    low, high = _SHEET_SLOPES
    per_cell = [(high - low) / count for count in grid]
    x = [-z * (low + per_cell[0] * (cell[0] + _CELL_FILLED * edge)) for edge in part]
    y = [-z * (low + per_cell[1] * (cell[1] + _CELL_FILLED * edge)) for edge in (0.0, 1.0)]
    middle = [-z * (low + step * (c + 0.5)) for step, c in zip(per_cell, cell, strict=True)]
    corners = np.array([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])])
    lean = (corners[:, 0] - middle[0]) * _LEAN[0] + (corners[:, 1] - middle[1]) * _LEAN[1]
    # In front of the plate both axes change sign. This is a rotation by 180 degrees, which keeps
    # the winding.
    return np.column_stack([corners, z + lean]), shapes.triangulate(np.array([(0, 1, 2, 3)]))


def crossing() -> tuple[SceneObject, ...]:
    """Return a steep wave exactly through the origin, with a ball in front and a box behind.

    Around the origin the wave is the plane z = 2 x, and the origin is not on an edge: all lines of
    the middle aperture meet the wave at the aperture itself. Cells shrink toward the origin by
    powers of two, because near planes meet the plate in a window as small as n, and the float32
    error of a corner is relative to its distance from the origin.
    """
    shrinking = 2.0 ** -np.arange(1, 6)
    x = np.concatenate(
        [np.linspace(-31, -1, 31), -shrinking, 2 * shrinking[::-1], np.linspace(2, 32, 31)]
    )
    y = np.concatenate(
        [np.linspace(-31.5, -1.5, 25), -1.5 * shrinking, shrinking[::-1], np.linspace(1, 31, 25)]
    )
    columns, rows = np.meshgrid(x, y)
    # The amplitude is zero at the four corners around the origin, and full a few millimeters away.
    distance = np.maximum(np.maximum(columns - 2, -1 - columns), np.maximum(rows - 1, -1.5 - rows))
    fade = np.clip(distance / 6, 0, 1)
    wave = fade * (9 * np.sin(0.31 * rows + 0.4) + 6 * np.sin(0.23 * columns - 0.37 * rows))
    points = np.stack([columns, rows, 2 * columns + wave], axis=-1, dtype=np.float64)
    return (
        shapes.as_object("wave", shapes.open_grid(points)),
        _shape("sphere", 12.0, (0.0, 0.0, 0.0), (-12.0, 8.0, 55.0)),
        _shape("box", 16.0, (20.0, 30.0, 0.0), (-18.0, 6.0, -70.0)),
    )


def large_triangles() -> tuple[SceneObject, ...]:
    """Return a wall, a floor and a slope, each one triangle meters wide, and small parts.

    Each triangle crosses the plate next to the middle aperture. At most a hundredth of a triangle
    is visible from there: the rest must be clipped.
    """
    large = {
        "wall": ((26.0, -4000.0, -3000.0), (31.0, 5000.0, -2500.0), (43.0, 300.0, 6000.0)),
        "floor": ((-6000.0, -13.0, -4000.0), (6000.0, -22.0, -4500.0), (100.0, -29.0, 7000.0)),
        "slope": (
            (-7000.0, -9000.0, 3253.0),
            (6000.0, -7000.0, -25231.0),
            (500.0, 9000.0, 12344.0),
        ),
    }
    faces = np.array([[0, 1, 2]])
    return (
        *(shapes.as_object(name, (np.array(corners), faces)) for name, corners in large.items()),
        _shape("sphere", 14.0, (0.0, 0.0, 0.0), (7.0, 6.0, 42.0)),
        _shape("box", 18.0, (30.0, 20.0, 10.0), (24.0, -12.0, -66.0)),
        _shape("cone", 20.0, (15.0, 0.0, 40.0), (-20.0, 14.0, 80.0)),
    )


#: Center and radius of each sphere, one behind the plate and one in front; they do not overlap on
#: the film.
MIRROR_SPHERES: tuple[tuple[Vector, float], ...] = (
    ((-11.0, 7.0, -72.0), 24.0),
    ((-20.0, 17.0, 60.0), 10.0),
)
_BLACK = (0.0, 0.0, 0.0)


def mirror_spheres() -> tuple[SceneObject, ...]:
    """Return the mirror spheres, in facets of about two degrees.

    Normals have the length of the radius, so that an interpolated normal points exactly from the
    center to the point on the facet.
    """
    spheres = []
    for number, (center, radius) in enumerate(MIRROR_SPHERES):
        outward, faces = shapes.ball(radius, 96, 192)
        sphere = shapes.as_object(
            f"mirror sphere {number}", (outward + center, faces), material="mirror"
        )
        spheres.append(replace(sphere, vertex_normals=outward))
    return tuple(spheres)


def mirror() -> Appearance:
    """Return a mirror and nothing else, in the surroundings of the studio."""
    pure = Material(ambient=_BLACK, diffuse=_BLACK, reflectivity=(1.0, 1.0, 1.0))
    return Appearance(
        materials=MappingProxyType({"mirror": pure}), lights=(), environment=surroundings()
    )


#: Slope of the bars relative to rows and columns of pixels, so that no column follows an edge.
GRATING_LEAN = 0.07
GRATING_HEIGHT = 30.0
BACKDROP_HEIGHT = -60.0
#: Periods of the two gratings in hogel pitches. A centered frustum averages over one pitch at every
#: height. The mean of a grating whose period divides the pitch is constant; a grating with a period
#: of four pitches keeps 0.9 of its contrast (the sinc function of 1/4).
FINE, COARSE = 0.5, 4.0


def gratings(pitch: tuple[float, float]) -> tuple[SceneObject, ...]:
    """Return almost upright bars in front of the plate, and almost level bars behind it.

    Brightness is a triangle wave from 0 to 1, black at the middle. The period is `FINE` to the left
    of the middle (behind the plate: above it), and `COARSE` to the right (below). `pitch` is the
    hogel pitch along x and y.
    """
    return (
        _bars(
            "upright bars",
            -_periods(pitch[0], 21.0)[::-1],
            GRATING_HEIGHT,
            (-12.0, 7.0),
            upright=True,
        ),
        _bars(
            "level bars", _periods(pitch[1], 30.0), BACKDROP_HEIGHT, (-38.0, 31.0), upright=False
        ),
    )


def _periods(pitch: float, extent: float) -> Floats:
    """Return the extrema of brightness, including 0: coarse below 0, fine above."""
    coarse = np.arange(-int(extent / (COARSE * pitch / 2)), 0) * COARSE / 2
    fine = np.arange(int(extent / (FINE * pitch / 2)) + 1) * FINE / 2
    return np.concatenate([coarse, fine]) * pitch


def _bars(
    name: str, turns: Floats, z: float, span: tuple[float, float], *, upright: bool
) -> SceneObject:
    """Return a sheet parallel to the plate, black where `turns` is 0 and white at the next turn."""
    straight, across = np.meshgrid(turns, np.array(span), indexing="ij")
    along = straight + GRATING_LEAN * across
    # The grid's normal, axis 0 x axis 1, points to the viewer.
    x, y = (along, across) if upright else (across[:, ::-1], along[:, ::-1])
    sheet = shapes.open_grid(np.stack([x, y, np.full(along.shape, z)], axis=-1))
    brightness = np.abs(np.arange(len(turns)) - int(np.argmin(np.abs(turns)))) % 2
    colors = np.repeat(np.repeat(brightness.astype(np.float64), len(span))[:, None], 3, axis=1)
    return shapes.as_object(name, sheet, material="plain", vertex_colors=colors)


def plain() -> Appearance:
    """Return a material that shows the unlit vertex colors."""
    own_color = Material(ambient=(1.0, 1.0, 1.0), diffuse=_BLACK)
    return Appearance(materials=MappingProxyType({"plain": own_color}), lights=())
