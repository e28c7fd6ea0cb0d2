"""The scene file (TOML; CONVENTIONS.md, "The scene file"): read, checked key by key, turned into a scene."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from types import MappingProxyType

import numpy as np
from pydantic import ValidationError

from xfrustum.scenes.appearance.appearance import Appearance
from xfrustum.scenes.appearance.light import DEFAULT_LIGHT, DirectionalLight, Environment
from xfrustum.scenes.appearance.material import Material
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.disk.input_files import SCENE_FILE_SIZE, check_hogels, read_small
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.scene_tables import ObjectTable, SceneTables
from xfrustum.scenes.files.table_errors import described
from xfrustum.scenes.geometry.placement import magnification, place
from xfrustum.scenes.geometry.shapes import build_shape
from xfrustum.scenes.geometry.smoothing import smoothed
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.frustum import Frustum, Screen
from xfrustum.scenes.plate.plate import Plate


def read_scene(path: Path) -> Scene:
    """Read a scene file, its meshes and its environment map.

    Raises
    ------
    InputError
        The file is no valid scene; the message names the file, the key, and the values allowed there.
    """
    file = _parse(path)
    try:
        plate = Plate(size=file.plate.size, hogels=file.plate.hogels)
        check_hogels(*plate.hogels)
        frustum = _frustum(file)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
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


def _frustum(file: SceneTables) -> Frustum:
    screen, fov_deg = file.frustum.screen, file.frustum.fov_deg
    return Frustum(
        resolution=file.frustum.resolution,
        reach=file.frustum.reach,
        fov=None if fov_deg is None else (math.radians(fov_deg[0]), math.radians(fov_deg[1])),
        screen=None if screen is None else Screen(**screen.model_dump()),
    )


def _build_object(path: Path, file: SceneTables, index: int) -> SceneObject:
    """Load one object's mesh, patches or shape and place it."""
    entry, key = file.objects[index], f"object[{index}]"
    matrix = entry.scene_from_mesh()
    fault = None if entry.transform is None else _no_placement(matrix)
    if fault is not None:
        allowed = ObjectTable.model_fields["transform"].description
        raise InputError(f"{path}: {key}.transform must be {allowed}: {fault}")
    if entry.material is not None and entry.material not in file.material:
        known = ", ".join(file.material) or "none"
        raise InputError(
            f"{path}: {key}.material must name a [material.NAME] table, not {entry.material!r}; "
            f"the file has {known}"
        )
    try:
        part = _unplaced(path, entry, matrix)
        return place(smoothed(part) if entry.smooth else part, matrix)
    except InputError as error:
        source = "mesh" if entry.mesh is not None else "shape"
        raise InputError(f"{path}: {key}.{source}: {error}") from error


def _unplaced(path: Path, entry: ObjectTable, scene_from_mesh: Floats) -> SceneObject:
    """Return an object in its mesh's own coordinates."""
    if entry.mesh is None:
        return build_shape(str(entry.shape), material=entry.material)
    file = path.parent / entry.mesh
    if not entry.is_patches:
        from xfrustum.scenes.files.meshes.meshes import load_mesh  # noqa: PLC0415 - loads trimesh

        return load_mesh(file, material=entry.material)
    # The tolerance is a length of the scene: the mesh's own is smaller by the largest stretching.
    tolerance = entry.chord_tolerance
    own = None if tolerance is None else tolerance / magnification(scene_from_mesh)
    from xfrustum.scenes.files.meshes.patches import load_patches  # noqa: PLC0415 - loads SciPy's graphs

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
    from xfrustum.scenes.files.environment_file import read_environment  # noqa: PLC0415 - loads OpenImageIO

    try:
        return read_environment(path.parent / file.environment.map, strength=file.environment.strength)
    except InputError as error:
        raise InputError(f"{path}: environment.map: {error}") from error


def _parse(path: Path) -> SceneTables:
    """Return the file's checked tables."""
    try:
        tables = tomllib.loads(read_small(path, "scene file", SCENE_FILE_SIZE).decode("utf-8"))
    except ValueError as error:  # the file is no UTF-8 or no TOML
        raise InputError(f"{path}: not valid TOML: {' '.join(str(error).split())}") from error
    except RecursionError as error:
        raise InputError(f"{path}: not valid TOML: arrays or tables are nested too deeply") from error
    try:
        return SceneTables.model_validate(tables)
    except ValidationError as error:
        raise InputError(f"{path}: {described(error)}") from error
