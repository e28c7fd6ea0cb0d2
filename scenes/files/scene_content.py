"""The content of a scene file: its checked tables turned into objects, materials and lights."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType

import numpy as np

from xfrustum.scenes.appearance.appearance import (
    DEFAULT_LIGHT,
    Appearance,
    DirectionalLight,
    Environment,
    Material,
)
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.scene_file import ObjectTable, SceneTables, named
from xfrustum.scenes.geometry.operations import magnification, place, smoothed
from xfrustum.scenes.geometry.shapes import build_shape
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Plate


def scene_of(path: Path, file: SceneTables, plate: Plate, frustum: Frustum) -> Scene:
    """Return the scene of a file, with its meshes and its environment map.

    Parameters
    ----------
    path, file
        Path of the scene file, and its checked tables.
    plate, frustum
        Plate and frustum of the tables.

    Raises
    ------
    InputError
        A mesh, a transform, a light or a map is not valid; the message names the file and the key.
    """
    return Scene(
        name=file.name or path.stem,
        units=file.units,
        plate=plate,
        frustum=frustum,
        objects=tuple(_build_object(path, file, index) for index in range(len(file.objects))),
        # An absolute path, so that an image can be compared from another folder.
        source=str(path.absolute()),
        appearance=_appearance(path, file),
        sampling=Sampling(**file.sampling.model_dump()),
        transport=Transport(**file.transport.model_dump()),
    )


def _build_object(path: Path, file: SceneTables, index: int) -> SceneObject:
    """Load one object's mesh, patches or shape and place it."""
    entry = file.objects[index]
    matrix = entry.scene_from_mesh()
    fault = None if entry.transform is None else _no_placement(matrix)
    if fault is not None:
        raise InputError(
            f"{path}: object[{index}].transform must be four rows of four numbers, the last [0, 0, 0, 1], "
            f"and not singular: {fault}"
        )
    source = "mesh" if entry.mesh is not None else "shape"
    with named(path, f"object[{index}].{source}"):
        part = _unplaced(path, entry, matrix)
        return place(smoothed(part) if entry.smooth else part, matrix)


def _unplaced(path: Path, entry: ObjectTable, scene_from_mesh: Floats) -> SceneObject:
    """Return an object in its mesh's own coordinates."""
    if entry.mesh is None:
        return build_shape(str(entry.shape), material=entry.material)
    file = path.parent / entry.mesh
    if not entry.is_patches:
        from xfrustum.scenes.files.meshes import load_mesh  # noqa: PLC0415 - loads trimesh

        return load_mesh(file, material=entry.material)
    # The tolerance is a length of the scene: the mesh's own is smaller by the largest stretching.
    tolerance = entry.chord_tolerance
    own = None if tolerance is None else tolerance / magnification(scene_from_mesh)
    from xfrustum.scenes.files.patches import load_patches  # noqa: PLC0415 - loads SciPy's graphs

    return load_patches(file, chord_tolerance=own, material=entry.material)


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
    lights = []
    for index, table in enumerate(file.lights or ()):
        try:
            lights.append(DirectionalLight(**table.model_dump()))
        except InputError as error:
            raise InputError(f"{path}: light[{index}].{error}") from error
    unlit = file.lights is None and file.environment is None
    return Appearance(
        materials=MappingProxyType(materials),
        lights=(DEFAULT_LIGHT,) if unlit else tuple(lights),
        environment=_environment(path, file),
    )


def _environment(path: Path, file: SceneTables) -> Environment | None:
    if file.environment is None:
        return None
    from xfrustum.scenes.files.environment import read_environment  # noqa: PLC0415 - loads OpenEXR

    with named(path, "environment.map"):
        return read_environment(path.parent / file.environment.map, strength=file.environment.strength)
