"""Hard cases of size, place and view: far, tiny, huge, steep, sheared, one pixel, giants."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np

from xfrustum.scenes.geometry.placement import place, placement
from xfrustum.scenes.geometry.shapes import build_shape, triangulate
from xfrustum.scenes.library.car import car
from xfrustum.scenes.library.hard.case import FRUSTUM, PLATE, REACH, HardCase, wall
from xfrustum.scenes.library.targets import asymmetric
from xfrustum.scenes.model.scene import SceneObject
from xfrustum.scenes.plate.frustum import Frustum, Screen
from xfrustum.scenes.plate.plate import Plate

FAR_AWAY = 1e6
"""Distance of the far scene's meshes from the origin of their files, along each axis."""
SCALES = {"tiny": 2.0**-27, "huge": 2.0**13}
"""Factors of the tiny and the huge scene: powers of two that make a reach of 150 about 1e-6 and 1e6."""
_GRAIN = 2.0**-20
"""Grid to which coordinates are rounded."""


def asymmetric_on_a_grid() -> tuple[SceneObject, ...]:
    """Return the asymmetric objects rounded to multiples of 2^-20, which survive a detour exactly."""
    return tuple(replace(part, vertices=np.rint(part.vertices / _GRAIN) * _GRAIN) for part in asymmetric())


def _far_from_origin() -> tuple[SceneObject, ...]:
    # Far-away vertices, as a mesh file would have them, and the `translate` of the scene file.
    back = placement(translate=(-FAR_AWAY, FAR_AWAY, -FAR_AWAY))
    away = np.array([FAR_AWAY, -FAR_AWAY, FAR_AWAY])
    return tuple(place(replace(part, vertices=part.vertices + away), back) for part in asymmetric_on_a_grid())


ASYMMETRIC_PLATE = Plate(size=(80.0, 60.0), hogels=(81, 61))
ASYMMETRIC_FRUSTUM = Frustum(resolution=(64, 64), reach=(150.0, 150.0), fov=(radians(60), radians(60)))


def _scaled(kind: str) -> HardCase:
    scale = SCALES[kind]
    return HardCase(
        name=f"hard/{kind}",
        why=f"all lengths about {150 * scale:.0e}: absolute tolerances and products out of range show",
        expected="the asymmetric scene, to the last bit",
        triangles=4_896,
        objects=lambda: tuple(place(part, placement(scale)) for part in asymmetric_on_a_grid()),
        plate=Plate(size=(80 * scale, 60 * scale), hogels=(81, 61)),
        frustum=replace(ASYMMETRIC_FRUSTUM, reach=(150 * scale, 150 * scale)),
        apertures=((40, 30), (12, 50)),
    )


ROOM = (24.0, 24.0, 20.0)
"""Half sizes of the box about the middle aperture along x, y and z."""


def _room() -> tuple[SceneObject, ...]:
    box = build_shape("box")
    return (replace(box, name="room", vertices=box.vertices * (2 * np.array(ROOM))),)


SHEARED_SCREEN = Screen(height=-40.0, center=(0.0, 0.0), size=(20.0, 20.0))


def _picture_on_the_screen() -> tuple[SceneObject, ...]:
    """Return a sheet that fills the projection screen, with a hole through which a wall shows."""
    x, y = np.meshgrid(np.linspace(-10, 10, 9), np.linspace(-10, 10, 9))
    index = np.arange(81).reshape(9, 9)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    # The hole lies beside the middle, so that mirror images differ.
    quads = np.delete(quads, [18, 19, 26, 27], axis=0)
    screen = np.stack([x, y, np.full_like(x, SHEARED_SCREEN.height)], axis=-1).reshape(-1, 3)
    return SceneObject(name="picture", vertices=screen, faces=triangulate(quads)), wall(-90.0)


def _box_on_axis() -> tuple[SceneObject, ...]:
    return (place(build_shape("box"), placement(16.0, translate=(0.0, 0.0, -40.0))),)


WAVE_QUADS = (2500, 2000)
"""Rows and columns of the grid of ten million triangles."""


def _ten_million() -> tuple[SceneObject, ...]:
    rows, columns = WAVE_QUADS
    x, y = np.linspace(-60, 60, columns + 1), np.linspace(-60, 60, rows + 1)[:, None]
    # Heights are rounded, so that sine tables that differ in the last bit make the same mesh.
    z = np.round(-60 + 8 * np.sin(0.9 * x) * np.sin(0.7 * y) + 0.2 * np.sin(9.1 * x + 7.3 * y), 6)
    vertices = np.stack([np.broadcast_to(x, z.shape), np.broadcast_to(y, z.shape), z], axis=-1)
    index = np.arange(z.size).reshape(z.shape)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1)
    return (
        SceneObject(name="wave", vertices=vertices.reshape(-1, 3), faces=triangulate(quads.reshape(-1, 4))),
    )


def _screen_at(height: float) -> Frustum:
    return replace(FRUSTUM, screen=Screen(height=height, center=(0.0, 0.0), size=(64.0, 64.0)))


CASES = (
    HardCase(
        name="hard/far-from-origin",
        why="mesh coordinates of 1e6, brought to the plate by the transform: float32 would keep 1/16 mm",
        expected="the same image as of meshes that lie at the plate already, to the last bit",
        triangles=4_896,
        objects=_far_from_origin,
        plate=ASYMMETRIC_PLATE,
        frustum=ASYMMETRIC_FRUSTUM,
        apertures=((40, 30), (12, 50)),
    ),
    _scaled("tiny"),
    _scaled("huge"),
    HardCase(
        name="hard/steep",
        why="a full angle of 170 degrees: slopes up to 11.4, lines almost along the plate",
        expected="the box about the aperture, where each line enters it, in every pixel",
        triangles=12,
        objects=_room,
        frustum=Frustum(resolution=(64, 64), reach=(REACH, REACH), fov=(radians(170), radians(170))),
        apertures=((2, 2), (0, 3)),
    ),
    HardCase(
        name="hard/sheared-five-screens",
        why="apertures five screen widths beside the screen: the shear is ten times the half-extent",
        expected="the picture on the screen fills every aperture's film alike",
        triangles=121,
        objects=_picture_on_the_screen,
        plate=Plate(size=(250.0, 250.0), hogels=(5, 5)),
        frustum=replace(FRUSTUM, screen=SHEARED_SCREEN),
        apertures=((2, 2), (0, 0), (4, 4), (4, 0), (3, 2)),
    ),
    HardCase(
        name="hard/screen-near-plate",
        why="a screen 2^-30 behind the plate: slopes of 1e10, lines as good as in the plate",
        expected="the box about the aperture, where each line enters it, within 1e-6 of the plate",
        triangles=12,
        objects=_room,
        frustum=_screen_at(-(2.0**-30)),
        apertures=((2, 2), (0, 3)),
    ),
    HardCase(
        name="hard/screen-near-plate-in-front",
        why="the same screen 2^-30 before the plate: the shear changes its sign, and its image is mirrored",
        expected="the box where each line enters it; from the middle what the screen behind the plate shows",
        triangles=12,
        objects=_room,
        frustum=_screen_at(2.0**-30),
        apertures=((2, 2), (0, 3)),
    ),
    HardCase(
        name="hard/one-pixel",
        why="1 x 1 pixel: no neighbor, and its one line runs through a diagonal of the box",
        expected="a tie of the two triangles beside the diagonal at height -32",
        triangles=12,
        objects=_box_on_axis,
        frustum=replace(FRUSTUM, resolution=(1, 1)),
    ),
    HardCase(
        name="hard/giant-image",
        why="8192 x 8192 pixels of the car: memory must not grow with the image",
        expected="the car; in bands, a few hundred megabytes at a time",
        triangles=41_896,
        objects=car,
        plate=PLATE,
        frustum=replace(ASYMMETRIC_FRUSTUM, resolution=(8192, 8192)),
        giant=True,
    ),
    HardCase(
        name="hard/giant-mesh",
        why="ten million triangles, most of them smaller than a pixel",
        expected="the wave behind the plate in every pixel",
        triangles=10_000_000,
        objects=_ten_million,
        frustum=replace(FRUSTUM, resolution=(512, 512)),
        giant=True,
    ),
)
