"""The scene file (TOML; CONVENTIONS.md, "The scene file"): read, checked key by key, turned into a scene.

Everything that can be checked without arrays is checked before what reads meshes is loaded.
"""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from xfrustum.scenes.disk.input_files import (
    SCENE_FILE_SIZE,
    check_environment_file,
    check_hogels,
    check_mesh_file,
    read_small,
)
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.scene_tables import SceneTables
from xfrustum.scenes.files.table_errors import described, named
from xfrustum.scenes.plate.frustum import Frustum, Screen
from xfrustum.scenes.plate.plate import Plate

if TYPE_CHECKING:
    from xfrustum.scenes.model.scene import Scene


def read_scene(path: Path) -> Scene:
    """Read a scene file, its meshes and its environment map.

    Raises
    ------
    InputError
        The file is no valid scene; the message names the file, the key, and the values allowed there.
    """
    file, plate, frustum = checked(path)
    from xfrustum.scenes.files.scene_content import scene_of  # noqa: PLC0415 - loads NumPy

    return scene_of(path, file, plate, frustum)


def checked(path: Path) -> tuple[SceneTables, Plate, Frustum]:
    """Return the tables of a scene file, its plate and its frustum, checked without reading a mesh.

    Raises
    ------
    InputError
        A table is not valid, or names a material or a file that there is not.
    """
    file = _parse(path)
    try:
        plate = Plate(size=file.plate.size, hogels=file.plate.hogels)
        check_hogels(*plate.hogels)
        frustum = _frustum(file)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    _check_references(path, file)
    return file, plate, frustum


def _frustum(file: SceneTables) -> Frustum:
    screen, fov_deg = file.frustum.screen, file.frustum.fov_deg
    return Frustum(
        resolution=file.frustum.resolution,
        reach=file.frustum.reach,
        fov=None if fov_deg is None else (math.radians(fov_deg[0]), math.radians(fov_deg[1])),
        screen=None if screen is None else Screen(**screen.model_dump()),
    )


def _check_references(path: Path, file: SceneTables) -> None:
    """Refuse names of materials and files that there are not, all of them before the first mesh is read."""
    for index, entry in enumerate(file.objects):
        if entry.material is not None and entry.material not in file.material:
            known = ", ".join(file.material) or "none"
            raise InputError(
                f"{path}: object[{index}].material must name a [material.NAME] table, not "
                f"{entry.material!r}; the file has {known}"
            )
        if entry.mesh is not None:
            with named(path, f"object[{index}].mesh"):
                check_mesh_file(path.parent / entry.mesh)
    if file.environment is not None:
        with named(path, "environment.map"):
            check_environment_file(path.parent / file.environment.map)


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
