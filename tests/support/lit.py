"""Small lit scenes for tests of shading and of light transport."""

import math

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from tests.support.views import lines_by_definition
from xfrustum.scenes import Aperture, Frustum, Plate, Scene, SceneObject
from xfrustum.scenes.appearance import Appearance, DirectionalLight, Environment, Material, Sampling
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate import Screen

FLOAT32 = 2.0**-24
"""Largest relative rounding of a color to float32."""

ROUNDING = 4 * FLOAT32
"""Rounding of the color; the formulas in doubles round far less."""

PLATE = Plate(size=(20.0, 16.0), hogels=(21, 17))
REACH = (100.0, 120.0)
CENTERED = Frustum(resolution=(48, 36), reach=REACH, fov=(math.radians(60), math.radians(50)))
RECENTERED = Frustum(
    resolution=(48, 36),
    reach=REACH,
    screen=Screen(height=70.0, center=(4.0, -6.0), size=(80.0, 60.0)),
)
"""Recentered frustum, wider than high, off center on both axes."""

SUN = DirectionalLight(direction=(-2.0, 1.0, 2.0), color=(1.0, 0.8, 0.5))
LAMP = DirectionalLight(direction=(1.0, -0.5, 0.4), color=(0.1, 0.3, 0.6))
"""Two lights that no exchange of axes or channels maps to each other."""

GLOW = Material(ambient=(1.0, 1.0, 1.0), diffuse=(0.0, 0.0, 0.0))
"""Material that shows its albedo under any light."""


def quad(
    corners: ArrayLike,
    material: str | None = None,
    uv: ArrayLike | None = None,
    **attributes: ArrayLike,
) -> SceneObject:
    """Return two triangles that fill four corners (4, 3), counterclockwise seen from the front."""
    return SceneObject(
        name="quad",
        vertices=np.asarray(corners, dtype=np.float64),
        faces=np.array([(0, 1, 2), (0, 2, 3)]),
        material=material,
        uv=None if uv is None else np.asarray(uv, dtype=np.float64),
        **{  # type: ignore[arg-type]
            name: np.asarray(values) for name, values in attributes.items()
        },
    )


def card(
    center: tuple[float, float, float], size: tuple[float, float], material: str | None = None
) -> SceneObject:
    """Return a rectangle parallel to the plate that faces the viewer."""
    x, y, z = center
    w, h = size[0] / 2, size[1] / 2
    return quad(
        [(x - w, y - h, z), (x + w, y - h, z), (x + w, y + h, z), (x - w, y + h, z)], material
    )


def ball(
    center: tuple[float, float, float],
    radius: float,
    material: str,
    subdivisions: int = 4,
    smooth: bool = True,
) -> SceneObject:
    """Return a sphere of triangles, with true vertex normals or flat."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    vertices = np.array(mesh.vertices)
    return SceneObject(
        name="ball",
        vertices=vertices + center,
        faces=np.array(mesh.faces),
        material=material,
        vertex_normals=vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
        if smooth
        else None,
    )


def lit(
    *objects: SceneObject,
    frustum: Frustum = CENTERED,
    lights: tuple[DirectionalLight, ...] = (SUN, LAMP),
    environment: Environment | None = None,
    sampling: Sampling | None = None,
    **materials: Material,
) -> Scene:
    """Return a scene of objects and lights; further arguments are materials by name."""
    return Scene(
        name="lit",
        plate=PLATE,
        frustum=frustum,
        objects=objects,
        appearance=Appearance(materials=materials, lights=lights, environment=environment),
        sampling=sampling or Sampling(),
    )


def sky(width: int = 64, height: int = 32) -> Environment:
    """Return a smooth environment map of `sky_radiance`, without symmetry."""
    longitude = (np.arange(width) + 0.5) / width * 2 * math.pi - math.pi
    from_top = (np.arange(height) + 0.5) / height * math.pi
    down, around = np.meshgrid(from_top, longitude, indexing="ij")
    directions = np.stack(
        (np.sin(down) * np.sin(around), np.cos(down), -np.sin(down) * np.cos(around)), axis=-1
    )
    return Environment(radiance=sky_radiance(directions).astype(np.float32), strength=0.75)


def sky_radiance(directions: Floats) -> Floats:
    """Return linear RGB of unit directions (..., 3): linear in x, y, z for each channel."""
    return np.asarray(
        1.0 + directions @ np.array([(0.5, 0.1, 0.0), (0.2, 0.5, -0.2), (-0.1, 0.2, 0.6)])
    )


def eyes(scene: Scene, aperture: Aperture) -> Floats:
    """Return unit vectors (H, W, 3) toward the viewer along each line, on both plate sides."""
    d = lines_by_definition(scene, aperture)
    return np.asarray(-d / np.linalg.norm(d, axis=-1, keepdims=True))
