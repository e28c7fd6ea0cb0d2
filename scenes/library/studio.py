"""A car in a studio: paint, glass, tires and metal, lights, and surroundings without symmetry."""

from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from xfrustum.scenes import InputError, Scene, SceneObject
from xfrustum.scenes.appearance.appearance import Appearance, DirectionalLight, Environment, Material
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.geometry.operations import refine, smoothed
from xfrustum.scenes.library import builtin
from xfrustum.scenes.library.car import car, rim_faces
from xfrustum.scenes.model.scene import read_only

_MATERIALS = MappingProxyType({
    "paint": Material(ambient=(0.03, 0.006, 0.008), diffuse=(0.42, 0.045, 0.05), specular=(0.35,) * 3,
                      exponent=50.0, reflectivity=(0.16,) * 3),
    "glass": Material(ambient=(0.004, 0.006, 0.007), diffuse=(0.015, 0.022, 0.025), specular=(0.6,) * 3,
                      exponent=200.0, reflectivity=(0.3, 0.32, 0.34)),
    "tire": Material(ambient=(0.008,) * 3, diffuse=(0.035,) * 3, specular=(0.04,) * 3, exponent=8.0),
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
    for part in (smoothed(part) for part in car()):
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
    """Return sky, ground and three softboxes as a latitude-longitude map of 2 height x height pixels.

    Edges are soft, so that a misplaced reflection changes brightness and not only the place of a border.
    """
    rows = (np.arange(height) + 0.5) / height
    columns = (np.arange(2 * height) + 0.5) / (2 * height)
    latitude, longitude = 90 - 180 * rows[:, None], 360 * columns[None, :] - 180
    rise = np.clip(latitude / 90, 0, 1)[..., None]
    sky = (1 - rise) * [0.62, 0.66, 0.7] + rise * [0.12, 0.2, 0.42]
    # The ground is brighter toward the right, but has one brightness at the pole, where longitudes meet.
    aside = np.sin(np.radians(longitude)) * np.cos(np.radians(latitude))
    ground = (0.16 + 0.05 * aside)[..., None] * [1.0, 0.85, 0.7]
    horizon = _smooth_step(latitude, 0.0, width=6.0)[..., None]
    radiance = horizon * sky + (1 - horizon) * ground
    for (left, right), (low, high), color in (
        ((-170.0, -95.0), (28.0, 46.0), (5.0, 5.0, 4.6)),
        ((105.0, 165.0), (12.0, 18.0), (2.4, 2.0, 1.5)),
        ((-60.0, 20.0), (60.0, 72.0), (2.0, 2.3, 2.8)),
    ):
        across = _smooth_step(longitude, left, width=4.0) * (1 - _smooth_step(longitude, right, width=4.0))
        up = _smooth_step(latitude, low, width=4.0) * (1 - _smooth_step(latitude, high, width=4.0))
        radiance = radiance + (across * up)[..., None] * color
    return Environment(radiance=radiance.astype(np.float32), name="studio")


def _smooth_step(angle: Floats, edge: float, *, width: float) -> Floats:
    """Return 0 before an edge and 1 after it, a cubic between; degrees."""
    share = np.clip((angle - edge) / width + 0.5, 0, 1)
    return np.asarray(share**2 * (3 - 2 * share))


@dataclass(frozen=True, kw_only=True, eq=False)
class TessellatedCar:
    """The built-in car in other triangles, and which of them reflect: the first, from the body on."""

    scene: Scene
    reflective: Mask  #: (F,)


def tessellated_car(polygons: int, reflective_share: float) -> TessellatedCar:
    """Return the car in a number of triangles, or one fewer, a share of them reflective: the paper's table 1.

    Triangles are split in four while that leaves too few, then the largest in three at their centroids.
    Raises InputError below the built-in car's number, or at a share outside 0 to 1.
    """
    scene = builtin.build("car")
    if polygons < len(scene.faces) or not 0 <= reflective_share <= 1:
        raise InputError(
            f"the car has at least {len(scene.faces):,} triangles, of which a share from 0 to 1 may "
            f"reflect; not {polygons:,} and {reflective_share}"
        )
    while 4 * len(scene.faces) <= polygons:
        scene = refine(scene, 1)
    while (splits := (polygons - len(scene.faces)) // 2) > 0:
        a, b, c = np.moveaxis(scene.triangles, 1, 0)
        size = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        split = np.zeros(len(size), dtype=np.bool_)
        split[np.argsort(-size, kind="stable")[:splits]] = True
        ends = np.cumsum([len(part.faces) for part in scene.objects])[:-1]
        objects = []
        for part, chosen in zip(scene.objects, np.split(split, ends), strict=True):
            # The parts of a face stay neighbors in the order of drawing.
            (a, b, c), numbers = part.faces[chosen].T, np.flatnonzero(chosen)
            middle, faces = len(part.vertices) + np.arange(len(numbers)), part.faces.copy()
            faces[chosen, 2] = middle
            others = np.stack([b, c, middle, c, a, middle], axis=1).reshape(-1, 3)
            faces = np.insert(faces, np.repeat(numbers + 1, 2), others, axis=0)
            centroids = part.vertices[part.faces[chosen]].mean(axis=1)
            vertices = np.concatenate([part.vertices, centroids])
            objects.append(replace(part, vertices=vertices, faces=faces))
        scene = replace(scene, objects=tuple(objects))
    reflective = np.arange(len(scene.faces)) < round(reflective_share * len(scene.faces))
    return TessellatedCar(scene=scene, reflective=read_only(reflective))


def mirrored(car: TessellatedCar) -> Scene:
    """Return the car in the studio's paint, smooth, with mirrors where it is reflective and nowhere else."""
    studio_look = studio()
    paint = studio_look.materials["paint"]
    dull = replace(paint, reflectivity=(0.0, 0.0, 0.0))
    objects, first = [], 0
    for part in map(smoothed, car.scene.objects):
        reflective = car.reflective[first : first + len(part.faces)]
        first += len(part.faces)
        for material, chosen in (("paint", reflective), ("dull", ~reflective)):
            if chosen.any():
                objects.append(replace(part, faces=part.faces[chosen], material=material))
    materials = MappingProxyType({"paint": paint, "dull": dull})
    return replace(car.scene, objects=tuple(objects), appearance=replace(studio_look, materials=materials))
