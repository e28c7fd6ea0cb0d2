"""Scenes without symmetry, on both sides of the plate, with one surface through the plate."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """An object: triangles and material (linear RGB, Phong).

    `hidden` objects are invisible: the ray caster skips them, but numbers their triangles.
    """

    name: str
    corners: Floats  # (V, 3), scene units
    faces: Ints  # (F, 3), vertex numbers
    diffuse: tuple[float, float, float]
    ambient: float = 0.12
    specular: float = 0.2
    exponent: float = 8.0
    hidden: bool = False
    smooth: bool = False  # whether normals belong to vertices; else to triangles

    @cached_property
    def normals(self) -> Floats:
        """(F, 3, 3) unit normals at corners: means of adjoining faces, weighted by angle."""
        corners = self.corners[self.faces]
        edges = np.roll(corners, -1, axis=1) - corners
        edges /= np.linalg.norm(edges, axis=2, keepdims=True)
        flat = np.cross(edges[:, 0], edges[:, 1])
        flat /= np.linalg.norm(flat, axis=1, keepdims=True)
        flat = np.repeat(flat[:, None], 3, axis=1)
        if not self.smooth:
            return flat
        angle = np.arccos(-np.einsum("fci,fci->fc", edges, np.roll(edges, 1, axis=1)))
        places, place = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        total = np.zeros_like(places)
        np.add.at(total, place.ravel(), (angle[..., None] * flat).reshape(-1, 3))
        total /= np.linalg.norm(total, axis=1, keepdims=True)
        return np.asarray(total[place.ravel()].reshape(-1, 3, 3))


@dataclass(frozen=True, kw_only=True, eq=False)
class World:
    """A scene as in CONVENTIONS.md: centered frusta have `fov_deg`, recentered frusta `screen`."""

    name: str
    size: tuple[float, float]
    hogels: tuple[int, int]
    resolution: tuple[int, int]
    reach: tuple[float, float]
    parts: tuple[Part, ...]
    light: tuple[float, float, float]
    fov_deg: tuple[float, float] = (0.0, 0.0)
    screen: tuple[float, float, float, float, float] | None = None
    """Screen: height, center x and y, full width and height."""
    drawn: dict[object, Any] = field(default_factory=dict)  # results of `once`

    @cached_property
    def triangles(self) -> Floats:
        """(T, 3, 3) triangles in the order of their numbers."""
        return np.concatenate([part.corners[part.faces] for part in self.parts])

    @cached_property
    def normals(self) -> Floats:
        """(T, 3, 3), unit normals at the corners of all triangles."""
        return np.concatenate([part.normals for part in self.parts])

    @cached_property
    def object_of(self) -> Ints:
        """(T,) number of the object of each triangle."""
        return np.repeat(np.arange(len(self.parts)), [len(part.faces) for part in self.parts])

    @cached_property
    def seen(self) -> Ints:
        """Numbers of the triangles of visible objects."""
        return np.flatnonzero(~np.array([part.hidden for part in self.parts])[self.object_of])

    def once(self, key: object, make: Callable[[], T]) -> T:
        """Return a picture, or another result, that is made once and then kept."""
        if key not in self.drawn:
            self.drawn[key] = make()
        made: T = self.drawn[key]
        return made

    @property
    def apertures(self) -> list[tuple[int, int]]:
        """Column and row of all apertures of the plate."""
        columns, rows = self.hogels
        return [(i, j) for j in range(rows) for i in range(columns)]

    def write(self, folder: Path) -> Path:
        """Write the scene file, and a mesh file for each object; return the scene file's path."""
        folder.mkdir(parents=True, exist_ok=True)
        for part in self.parts:
            lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in part.corners.tolist()]
            lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in part.faces.tolist()]
            (folder / f"{part.name}.obj").write_text("\n".join(lines) + "\n")
        path = folder / "scene.toml"
        path.write_text(self._toml())
        return path

    def _toml(self) -> str:
        frustum = f"fov_deg = {list(self.fov_deg)}"
        if self.screen:
            z, x, y, width, height = self.screen
            frustum = (
                f"screen = {{ height = {z}, center = [{x}, {y}], size = [{width}, {height}] }}"
            )
        text = (
            f'name = "{self.name}"\nunits = "mm"\n'
            f"[plate]\nsize = {list(self.size)}\nhogels = {list(self.hogels)}\n"
            f"[frustum]\nresolution = {list(self.resolution)}\n{frustum}\n"
            f"reach = {list(self.reach)}\n"
            f"[[light]]\ndirection = {list(self.light)}\n"
        )
        for part in self.parts:
            text += (
                f'[[object]]\nmesh = "{part.name}.obj"\nmaterial = "{part.name}"\n'
                f"smooth = {str(part.smooth).lower()}\n[material.{part.name}]\n"
                f"ambient = {part.ambient}\ndiffuse = {list(part.diffuse)}\n"
                f"specular = {part.specular}\nexponent = {part.exponent}\n"
            )
        return text


def sheet(
    columns: int, rows: int, point: Callable[[Floats, Floats], tuple[Floats, ...]]
) -> tuple[Floats, Ints]:
    """Return corners of a grid over the unit square, placed by `point`, and its triangles."""
    p, q = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1), indexing="ij")
    corners = np.stack(np.broadcast_arrays(*point(p, q)), axis=-1).reshape(-1, 3)
    i, j = np.indices((columns, rows)).reshape(2, -1)
    first = (i * (rows + 1) + j)[:, None]
    faces = np.concatenate(
        [np.add(first, to) for to in ([0, rows + 1, rows + 2], [0, rows + 2, 1])]
    )
    return np.ascontiguousarray(corners), faces


def pebble(
    center: tuple[float, float, float], radii: tuple[float, float, float], bumps: int
) -> tuple[Floats, Ints]:
    """Return a closed, bumpy ellipsoid with poles along a slanted axis, without symmetry."""

    def point(p: Floats, q: Floats) -> tuple[Floats, ...]:
        around, along = 2 * np.pi * p, np.pi * (0.02 + 0.96 * q)
        swell = 1 + 0.18 * np.sin(bumps * around + 1.1) * np.sin(along) + 0.1 * np.cos(3 * along)
        x, y = (
            radius * swell * np.sin(along) * f(around)
            for radius, f in zip(radii, (np.cos, np.sin), strict=False)
        )
        z = radii[2] * swell * np.cos(along)
        return center[0] + x + 0.4 * z, center[1] + y - 0.3 * z, center[2] + z + 0.2 * x

    return sheet(18, 8, point)


def ribbon(
    start: tuple[float, float, float], end: tuple[float, float, float], width: float
) -> tuple[Floats, Ints]:
    """Return a twisted band from a point before the plate to a point behind it."""

    def point(p: Floats, q: Floats) -> tuple[Floats, ...]:
        angle, across = 0.5 + 1.3 * p, width * (q - 0.45)
        x, y, z = (a + (b - a) * p for a, b in zip(start, end, strict=True))
        return x + across * np.cos(angle), y + across * np.sin(angle), z + 2.0 * np.sin(7 * p)

    return sheet(22, 4, point)


def hills(corner: tuple[float, float, float], width: float, height: float) -> tuple[Floats, Ints]:
    """Return an uneven backdrop."""

    def point(p: Floats, q: Floats) -> tuple[Floats, ...]:
        rise = 2.5 * np.sin(5 * p + 3 * q) + 1.5 * np.cos(9 * q * p)
        return corner[0] + width * p, corner[1] + height * q * (1 - 0.3 * p), corner[2] + rise

    return sheet(12, 9, point)


def _part(
    name: str, mesh: tuple[Floats, Ints], diffuse: tuple[float, float, float], hidden: bool = False
) -> Part:
    return Part(name=name, corners=mesh[0], faces=mesh[1], diffuse=diffuse, hidden=hidden)


def harbor() -> World:
    """Return a scene with a centered frustum, wide films, and 968 triangles in four objects."""
    return World(
        name="harbor",
        size=(21.0, 13.0),
        hogels=(3, 2),
        resolution=(96, 72),
        fov_deg=(56.0, 42.0),
        reach=(60.0, 70.0),
        light=(-0.4, 0.7, 0.6),
        parts=(
            _part("backdrop", hills((-26.0, -21.0, -55.0), 62.0, 44.0), (0.2, 0.35, 0.6)),
            _part("pebble", pebble((9.0, -4.0, -30.0), (7.0, 5.0, 4.0), 4), (0.6, 0.4, 0.1)),
            _part("band", ribbon((-14.0, 10.0, 34.0), (-3.0, -1.0, -38.0), 5.0), (0.15, 0.6, 0.25)),
            _part("buoy", pebble((4.0, 3.0, 38.0), (5.0, 6.5, 5.0), 5), (0.65, 0.15, 0.2)),
        ),
    )


def cove() -> World:
    """Return the harbor with smooth normals."""
    world = harbor()
    return replace(
        world, name="cove", parts=tuple(replace(part, smooth=True) for part in world.parts)
    )


def attic() -> World:
    """Return a scene with a recentered frustum, square films, 752 triangles in three objects."""
    return World(
        name="attic",
        size=(18.0, 21.0),
        hogels=(3, 3),
        resolution=(56, 56),
        screen=(40.0, 2.0, -1.5, 46.0, 40.0),
        reach=(65.0, 50.0),
        light=(0.5, 0.3, 0.8),
        parts=(
            _part("crate", pebble((-7.0, 5.0, -24.0), (9.0, 7.0, 5.0), 3), (0.6, 0.5, 0.2)),
            _part("scarf", ribbon((14.0, 11.0, 40.0), (1.0, -13.0, -33.0), 7.0), (0.2, 0.3, 0.65)),
            _part("lamp", pebble((-5.0, -7.0, 30.0), (6.0, 4.0, 7.0), 5), (0.55, 0.2, 0.4)),
        ),
    )


def crowd() -> World:
    """Return the attic, numbered after 65,884 hidden triangles: numbers need 17 bits."""
    wall = sheet(181, 182, lambda p, q: (400.0 + 20 * p, -10.0 + 20 * q, np.full_like(p, -20.0)))
    hidden = _part("wall", wall, (0.3, 0.3, 0.3), hidden=True)
    world = attic()
    return replace(world, name="crowd", hogels=(2, 2), parts=(hidden, *world.parts))
