"""The content of a scene file: its checked tables turned into objects, materials and lights."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType

import numpy as np

from xfrustum.scenes.appearance.appearance import (
    DEFAULT_LIGHT,
    Appearance,
    DirectionalLight,
    Material,
)
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.scene_file import ObjectTable, SceneTables, named
from xfrustum.scenes.geometry.operations import magnification, place, placement, smoothed
from xfrustum.scenes.geometry.shapes import build_shape
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Plate


def scene_of(path: Path, file: SceneTables, plate: Plate, frustum: Frustum) -> Scene:
    """Return the scene of a file's checked tables, with its meshes and its environment map.

    Raises InputError where one of them is not valid; the message names the file and the key.
    """
    return Scene(
        name=file.name or path.stem,
        units=file.units,
        plate=plate,
        frustum=frustum,
        objects=tuple(_object(path, entry, index) for index, entry in enumerate(file.objects)),
        # An absolute path, so that an image can be compared from another folder.
        source=str(path.absolute()),
        appearance=_appearance(path, file),
        sampling=Sampling(**file.sampling.model_dump()),
        transport=Transport(**file.transport.model_dump()),
    )


def _object(path: Path, entry: ObjectTable, index: int) -> SceneObject:
    """Load one object's mesh, patches or shape and place it."""
    if entry.transform is not None:
        matrix = np.array(entry.transform, dtype=np.float64)
        if fault := _no_placement(matrix):
            raise InputError(
                f"{path}: object[{index}].transform must be four rows of four numbers, the last [0, 0, 0, 1],"
                f" and not singular: {fault}"
            )
    else:
        origin = (0.0, 0.0, 0.0)
        matrix = placement(entry.scale or 1.0, entry.rotate_deg or origin, entry.translate or origin)
    with named(path, f"object[{index}].{'shape' if entry.mesh is None else 'mesh'}"):
        if entry.mesh is None:
            part = build_shape(str(entry.shape), material=entry.material)
        elif entry.is_patches:
            from xfrustum.scenes.files.patches import load_patches  # noqa: PLC0415 - loads SciPy's graphs

            # The tolerance is a length of the scene: the mesh's own is smaller by the largest stretching.
            tolerance = entry.chord_tolerance
            own = None if tolerance is None else tolerance / magnification(matrix)
            part = load_patches(path.parent / entry.mesh, chord_tolerance=own, material=entry.material)
        else:
            from xfrustum.scenes.files.meshes import load_mesh  # noqa: PLC0415 - loads trimesh

            part = load_mesh(path.parent / entry.mesh, material=entry.material)
        return place(smoothed(part) if entry.smooth else part, matrix)


def _no_placement(matrix: Floats) -> str | None:
    """Return the reason why a matrix cannot place a mesh; None where it can."""
    if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        return f"its last row is {matrix[3].tolist()}"
    linear = matrix[:3, :3]
    largest = np.abs(linear).max()
    # Scale the matrix to size one first, so that the rank of a tiny or huge one neither under- nor overflows.
    regular = largest > 0 and np.linalg.matrix_rank(linear / largest) == 3
    return None if regular else "its upper left 3 x 3 numbers are singular"


def _appearance(path: Path, file: SceneTables) -> Appearance:
    """Return materials and lights; a file that names neither a light nor an environment gets one light."""
    materials = {name: Material(**table.model_dump()) for name, table in file.material.items()}
    lights, environment = [], None
    for index, table in enumerate(file.lights or ()):
        try:
            lights.append(DirectionalLight(**table.model_dump()))
        except InputError as error:
            raise InputError(f"{path}: light[{index}].{error}") from error
    if file.environment is not None:
        from xfrustum.scenes.files.pictures import read_environment  # noqa: PLC0415 - loads OpenEXR

        with named(path, "environment.map"):
            map_file, strength = path.parent / file.environment.map, file.environment.strength
            environment = read_environment(map_file, strength=strength)
    unlit = file.lights is None and file.environment is None
    return Appearance(
        materials=MappingProxyType(materials),
        lights=(DEFAULT_LIGHT,) if unlit else tuple(lights),
        environment=environment,
    )
