"""A car of about 42,000 triangles: plain, and in a studio.

In its own frame x is to the side, y up and z forward, in millimeters; the wheels stand on y = 0,
and it is 100 long, 42 wide and 32 high. Drawn for this project.
"""

from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from xfrustum.scenes import SceneObject
from xfrustum.scenes.appearance.appearance import (
    Appearance,
    DirectionalLight,
    Environment,
    Material,
)
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.geometry import shapes

Knots = Sequence[tuple[float, float]]
_WHEEL_RADIUS = 7.2
_ARCH_RADIUS = 8.6
_AXLES = (-29.5, 31.0)
_TRACK = 17.6
_WHEEL_SECTORS = 60
#: |z| at which the body turns into a rounded cap at either end, and the length of each cap.
_END, _CAP = 45.0, 5.0
_SECTION = 3.4  #: exponent of the lower body's cross section

# Lines of the lower body along z.
_SHOULDER: Knots = (
    (-50, 17.5), (-44, 20), (-33, 21), (-12, 20.5), (8, 20.3), (20, 20.2), (32, 19), (42, 17),
    (50, 14),
)  # fmt: skip
_SILL: Knots = ((-50, 8.5), (-44, 6), (-36, 4.6), (38, 4.4), (46, 5), (50, 6.2))
_HALF_WIDTH: Knots = (
    (-50, 17.5),
    (-42, 19.8),
    (-20, 20.8),
    (10, 20.9),
    (34, 20.4),
    (44, 18.9),
    (50, 16.4),
)

# Lines of the cabin over its height.
_GLASS_BASE, _GLASS_TOP = 20.8, 29.4
_WINDSHIELD: Knots = ((17, 24), (20.5, 19.5), (30, 3.5))
_REAR_WINDOW: Knots = ((17, -41), (20.5, -37), (30, -22))
_CABIN_HALF_WIDTH: Knots = ((17, 19.2), (20.5, 18.6), (30, 14.6))
_ROOF_EDGE, _ROOF_RISE = 30.0, 2.2

# Half a wheel's section: radius, and position along the axle, outward. The rim begins inside the
# bead.
_WHEEL: Knots = (
    (0, -2), (4.5, -2.2), (5.6, -2.6), (6.5, -2.5), (7.0, -2.0), (7.2, -1.2), (7.2, 0), (7.2, 1.2),
    (7.0, 2.0), (6.5, 2.5), (5.6, 2.6), (5.2, 2.4), (5.0, 1.9), (4.5, 1.7), (3.6, 1.8), (2.6, 1.9),
    (1.7, 2.0), (1.5, 2.4), (0.8, 2.5), (0, 2.5),
)  # fmt: skip
_RIM = _WHEEL.index((5.2, 2.4))


def car() -> tuple[SceneObject, ...]:
    """Return the car across the plate, turned by 35 degrees, its hood below the middle aperture."""
    frame, glass = _cabin()
    parts = {
        "body": shapes.join(_lower_body(), frame),
        "glass": glass,
        "wheels": shapes.join(*(_wheel(side, axle) for axle in _AXLES for side in (-1, 1))),
        "trim": _trim(),
    }
    scene_from_car = shapes.placement(1.0, (0.0, 35.0, 0.0), (-14.0, -27.0, -17.0))
    return tuple(
        shapes.place(shapes.as_object(f"car {name}", mesh), scene_from_car)
        for name, mesh in parts.items()
    )


def rim_faces(wheels: SceneObject) -> Mask:
    """Return (F,) which faces of the car's wheels belong to the rims; the others are tires."""
    row = wheels.faces % (_WHEEL_SECTORS * len(_WHEEL)) // _WHEEL_SECTORS
    return np.asarray((row >= _RIM).all(axis=1))


def _curve(knots: Knots, at: Floats) -> Floats:
    """Interpolate without overshoot between knots."""
    where, value = np.array(knots, dtype=np.float64).T
    from scipy.interpolate import PchipInterpolator  # noqa: PLC0415 - loaded when a car is built

    return np.asarray(PchipInterpolator(where, value)(at), dtype=np.float64)


def _superellipse(exponent: float, points: int) -> Floats:
    """Return (points, 2) evenly along the unit superellipse, from (1, 0) to the left."""
    turn = np.linspace(0, 2 * np.pi, 4001)
    cosine, sine = np.cos(turn), np.sin(turn)
    dense = np.stack([np.sign(x) * np.abs(x) ** (2 / exponent) for x in (cosine, sine)], axis=1)
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))])
    even = np.linspace(0, length[-1], points, endpoint=False)
    return np.stack([np.interp(even, length, dense[:, axis]) for axis in (0, 1)], axis=1)


def _lower_body() -> shapes.Mesh:
    """Loft the body along z, below the shoulder; wheel arches are cut across its whole width."""
    z, arch = _stations()
    inside = np.clip(z, -_END, _END)
    cap = np.clip(np.abs(z - inside) / _CAP, 0, 1)
    shrink = (1 - cap**2.4) ** (1 / 2.4)
    top, bottom = _curve(_SHOULDER, z), _curve(_SILL, z)
    section = _superellipse(_SECTION, 108)
    half_width, half_height = _curve(_HALF_WIDTH, z) * shrink, (top - bottom) / 2 * shrink
    x = half_width[:, None] * section[:, 0]
    y = ((top + bottom) / 2)[:, None] + half_height[:, None] * section[:, 1]
    # Where an arch cuts above the widest line, the cut must not fold over its roof.
    above = np.clip((arch - (top + bottom) / 2) / half_height, 0, 1)
    roof = (half_width * (1 - above**_SECTION) ** (1 / _SECTION))[:, None]
    cut = y < arch[:, None]
    x, y = np.where(cut, np.clip(x, -roof, roof), x), np.where(cut, arch[:, None], y)
    # Turned so that the facets face outward for z running forward.
    return shapes.wrapped_grid(np.stack([x, y, np.broadcast_to(z[:, None], x.shape)], axis=-1))


def _stations() -> tuple[Floats, Floats]:
    """Return z of the sections, back to front, and the height up to which an arch cuts each."""
    around = np.linspace(0, np.pi, 23)
    bend = np.sin(np.linspace(0, np.pi / 2, 11))
    z: list[Floats] = [-_END - _CAP * bend[:0:-1]]
    arch: list[Floats] = [np.full(10, -np.inf)]
    start = -_END
    for axle in _AXLES:
        # The section at either end of an arch comes twice, uncut and cut: an upright wall.
        plain = np.linspace(start, axle - _ARCH_RADIUS, 12 if axle < 0 else 30)
        z += [plain, axle - _ARCH_RADIUS * np.cos(around)]
        arch += [np.full(len(plain), -np.inf), _WHEEL_RADIUS + _ARCH_RADIUS * np.sin(around)]
        start = axle + _ARCH_RADIUS
    plain = np.linspace(start, _END, 10)
    z += [plain, _END + _CAP * bend[1:]]
    arch += [np.full(len(plain) + 10, -np.inf)]
    return np.concatenate(z), np.concatenate(arch)


def _cabin() -> tuple[shapes.Mesh, shapes.Mesh]:
    """Loft the cabin upward and return its frame and its glass, set in by a bevel."""
    outline = _superellipse(4.2, 104)
    heights = np.concatenate([[17], np.linspace(_GLASS_BASE, _GLASS_TOP, 14), [_ROOF_EDGE]])
    dome = np.linspace(0, np.pi / 2, 12)[1:]
    y = np.concatenate([[17], heights, _ROOF_EDGE + _ROOF_RISE * np.sin(dome) ** 0.8])
    scale = np.concatenate([[0], np.ones(len(heights)), np.cos(dome) ** 0.8])
    scale[-1] = 0
    level = np.minimum(y, _ROOF_EDGE)
    front, rear = _curve(_WINDSHIELD, level), _curve(_REAR_WINDOW, level)
    middle, half_length = (front + rear) / 2, (front - rear) / 2
    half_width = _curve(_CABIN_HALF_WIDTH, level)
    # Facets face outward for rings running upward if the outline runs from +z to +x.
    across, along = outline[:, 1], outline[:, 0]
    # Windows: front, rear, two on each side.
    screens = (np.abs(along) > 0.9) & (np.abs(across) < 0.84)
    panes = (np.abs(across) > 0.9) & (np.abs(along) < 0.82) & (np.abs(along + 0.08) > 0.035)
    pane = (screens | panes) & ((level > _GLASS_BASE) & (level < _GLASS_TOP) & (scale == 1))[
        :, None
    ]
    set_in = np.where(pane, 0.35, 0.0)
    x = (half_width * scale)[:, None] * across - set_in * np.sign(across) * (np.abs(across) > 0.9)
    z = middle[:, None] + (half_length * scale)[:, None] * along
    z = z - set_in * np.sign(along) * (np.abs(along) > 0.9)
    points = np.stack([x, np.broadcast_to(y[:, None], x.shape), z], axis=-1)
    vertices, faces = shapes.wrapped_grid(points)
    is_glass = pane.reshape(-1)[faces].all(axis=1)

    def used(some: Indices) -> shapes.Mesh:
        """Leave out vertices that no face uses."""
        numbers, compact = np.unique(some, return_inverse=True)
        return vertices[numbers], compact.reshape(some.shape).astype(np.int64)

    return used(faces[~is_glass]), used(faces[is_glass])


def _wheel(side: int, axle: float) -> shapes.Mesh:
    """Return a tire with a rim of five spokes, facing -x or +x by its `side`, -1 or +1."""
    radii, heights = np.array(_WHEEL, dtype=np.float64).T
    sectors = _WHEEL_SECTORS
    vertices, faces = shapes.lathe(radii, heights, sectors=sectors)
    turn = 2 * np.pi * np.arange(sectors) / sectors
    gap = 1.4 * np.clip(1.5 * np.cos(5 * turn), 0, 1)
    spoked = [
        row for row, (radius, height) in enumerate(_WHEEL) if 1.6 < radius < 4.6 and height > 0
    ]
    for row in spoked:
        vertices[row * sectors : (row + 1) * sectors, 1] -= gap
    # The lathe's axis y becomes the axle, pointing outward; one side is a half turn of the other.
    outward = np.stack([side * vertices[:, 1], vertices[:, 0], -side * vertices[:, 2]], axis=1)
    center = np.array([side * _TRACK, _WHEEL_RADIUS, axle])
    return np.round(outward + center, 6), faces


def _trim() -> shapes.Mesh:
    """Return bumpers, and lamps, mirrors and door handles on both sides."""
    bumpers = (((0, 9.0, 48.0), (17.0, 1.6, 3.4), 4.0), ((0, 10.5, -48.0), (17.5, 1.6, 3.2), 4.0))
    both = (
        ((13.0, 13.6, 46.6), (3.0, 1.9, 3.0), 2.4),
        ((13.8, 16.0, -47.2), (2.8, 1.7, 2.4), 2.8),
        ((19.4, 21.5, 11.0), (2.4, 1.6, 1.3), 2.6),
        ((20.9, 17.0, -9.0), (0.5, 0.5, 2.2), 2.6),
    )
    paired = [
        ((side * x, y, z), half, exponent) for side in (-1, 1) for (x, y, z), half, exponent in both
    ]
    return shapes.join(*(_pebble(*pebble) for pebble in (*bumpers, *paired)))


def _pebble(
    center: tuple[float, float, float], half: tuple[float, float, float], exponent: float
) -> shapes.Mesh:
    """Return a superellipsoid: half sizes along x, y, z, boxier for larger exponents."""
    section = _superellipse(exponent, 24)
    rise = np.linspace(-np.pi / 2, np.pi / 2, 11)
    power = 2 / exponent
    height = np.sign(rise) * np.abs(np.sin(rise)) ** power
    spread = np.abs(np.cos(rise)) ** power
    spread[[0, -1]] = 0
    level = np.broadcast_to(height[:, None], (11, 24))
    unit = np.stack(
        [spread[:, None] * section[:, 1], level, spread[:, None] * section[:, 0]], axis=-1
    )
    return shapes.wrapped_grid(unit * half + center)


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
_MATERIAL_OF_PART = MappingProxyType({"body": "paint", "glass": "glass", "trim": "metal"})

_LIGHTS = (
    DirectionalLight(direction=(-2.0, 3.0, 2.0), color=(0.9, 0.87, 0.8)),
    DirectionalLight(direction=(3.0, 1.0, 1.5), color=(0.2, 0.24, 0.32)),
    DirectionalLight(direction=(0.5, 1.5, -3.0), color=(0.3, 0.3, 0.28)),
)


def studio_car() -> tuple[SceneObject, ...]:
    """Return the car with smooth normals, a material on every part, and rims apart from tires."""
    parts = []
    for part in (shapes.smoothed(part) for part in car()):
        kind = part.name.removeprefix("car ")
        if kind in _MATERIAL_OF_PART:
            parts.append(replace(part, material=_MATERIAL_OF_PART[kind]))
            continue
        rim = rim_faces(part)
        parts.append(replace(part, name="car tires", faces=part.faces[~rim], material="tire"))
        parts.append(replace(part, name="car rims", faces=part.faces[rim], material="metal"))
    return tuple(parts)


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
    # The ground is brighter toward the right, but has one brightness at the pole, where longitudes
    # meet.
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
    """Return 0 before an edge and 1 after it, a cubic between; degrees."""
    share = np.clip((angle - edge) / width + 0.5, 0, 1)
    return np.asarray(share**2 * (3 - 2 * share))
