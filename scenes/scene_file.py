"""The scene file (TOML; design, section 7): read, checked key by key, turned into a scene."""

from __future__ import annotations

import difflib
import json
import math
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Self, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.frustum import Frustum, Screen
from xfrustum.scenes.meshes import load_mesh
from xfrustum.scenes.placement import place, placement
from xfrustum.scenes.plate import Plate
from xfrustum.scenes.scene import Scene, SceneObject
from xfrustum.scenes.shapes import build_shape

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True)]
Text = Annotated[str, Field(strict=True, min_length=1)]
Pair = tuple[Number, Number]
Triple = tuple[Number, Number, Number]
Row = tuple[Number, Number, Number, Number]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Plate(_Table):
    size: Pair = Field(description="two positive lengths [width, height]")
    hogels: tuple[Count, Count] = Field(description="two counts [columns, rows], integers of at least 1")


class _Screen(_Table):
    height: Number = Field(description="a height above the plate, finite and not zero")
    center: Pair = Field(description="a point [x, y]")
    size: Pair = Field(description="two positive lengths [width, height]")


class _Frustum(_Table):
    resolution: tuple[Count, Count] = Field(
        description="two pixel counts [width, height], integers of at least 1"
    )
    fov_deg: tuple[Annotated[Number, Field(gt=0, lt=180)], Annotated[Number, Field(gt=0, lt=180)]] | None = (
        Field(None, description="two angles [x, y] between 0 and 180 degrees")
    )
    screen: _Screen | None = Field(None, description="a table with height, center and size")
    reach: Pair = Field(description="two positive lengths [toward the viewer, behind the plate]")


class _Object(_Table):
    mesh: Text | None = Field(None, description="the path of a mesh file, relative to the scene file")
    shape: Text | None = Field(None, description="the name of a built-in shape")
    transform: tuple[Row, Row, Row, Row] | None = Field(
        None, description="four rows of four finite numbers, the last row [0, 0, 0, 1], not singular"
    )
    scale: Annotated[Number, Field(gt=0)] | None = Field(None, description="a positive number")
    rotate_deg: Triple | None = Field(None, description="three angles in degrees [x, y, z]")
    translate: Triple | None = Field(None, description="three lengths [x, y, z]")
    material: Text | None = Field(None, description="the name of a [material.NAME] table")

    @model_validator(mode="after")
    def _one_of_each(self) -> Self:
        if (self.mesh is None) == (self.shape is None):
            raise PydanticCustomError("one_of", "needs either mesh or shape, and not both")
        parts = [k for k in ("scale", "rotate_deg", "translate") if getattr(self, k) is not None]
        if self.transform is not None and parts:
            raise PydanticCustomError(
                "one_of", "has both transform and {part}; give one or the other", {"part": parts[0]}
            )
        return self

    def scene_from_mesh(self) -> NDArray[np.float64]:
        if self.transform is not None:
            return np.array(self.transform, dtype=np.float64)
        zero = (0.0, 0.0, 0.0)
        return placement(self.scale or 1.0, self.rotate_deg or zero, self.translate or zero)


class _SceneFile(_Table):
    name: Text | None = Field(None, description="a text that is not empty")
    units: Text = Field("units", description="the name of the length unit, a text that is not empty")
    plate: _Plate = Field(description="a table with size and hogels")
    frustum: _Frustum = Field(description="a table with resolution, reach, and fov_deg or screen")
    objects: list[_Object] = Field([], alias="object", description="a list of [[object]] tables")
    material: dict[str, dict[str, Any]] = Field({}, description="[material.NAME] tables")


def read_scene(path: Path) -> Scene:
    """Read a scene file and its meshes.

    Raises
    ------
    InputError
        One line that names the file, the key, and what is allowed there.
    """
    file = _parse(path)
    try:
        screen = file.frustum.screen
        fov_deg = file.frustum.fov_deg
        plate = Plate(size=file.plate.size, hogels=file.plate.hogels)
        frustum = Frustum(
            resolution=file.frustum.resolution,
            reach=file.frustum.reach,
            fov=None if fov_deg is None else (math.radians(fov_deg[0]), math.radians(fov_deg[1])),
            screen=None if screen is None else Screen(**screen.model_dump()),
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return Scene(
        name=file.name or path.stem,
        units=file.units,
        plate=plate,
        frustum=frustum,
        objects=tuple(_build_object(path, file, index) for index in range(len(file.objects))),
        # Absolute, so that an image can be compared from another folder than it was made in.
        source=str(path.absolute()),
    )


def _build_object(path: Path, file: _SceneFile, index: int) -> SceneObject:
    """Load one object's mesh or shape and place it."""
    entry, key = file.objects[index], f"object[{index}]"
    matrix = entry.scene_from_mesh()
    if entry.transform is not None and not _is_placement(matrix):
        raise InputError(f"{path}: {key}.transform must be {_Object.model_fields['transform'].description}")
    if entry.material is not None and entry.material not in file.material:
        known = ", ".join(file.material) or "none"
        raise InputError(
            f"{path}: {key}.material must name a [material.NAME] table, not {entry.material!r}; "
            f"the file has {known}"
        )
    try:
        if entry.mesh is not None:
            part = load_mesh(path.parent / entry.mesh, material=entry.material)
        else:
            part = build_shape(str(entry.shape), material=entry.material)
        return place(part, matrix)
    except InputError as error:
        source = "mesh" if entry.mesh is not None else "shape"
        raise InputError(f"{path}: {key}.{source}: {error}") from error


def _is_placement(matrix: NDArray[np.float64]) -> bool:
    linear = matrix[:3, :3]
    largest = np.abs(linear).max()
    # Scaled to size one first, so that the rank of a tiny or huge matrix neither under- nor overflows.
    regular = largest > 0 and np.linalg.matrix_rank(linear / largest) == 3
    return bool(regular) and matrix[3].tolist() == [0.0, 0.0, 0.0, 1.0]


def _parse(path: Path) -> _SceneFile:
    """Return the file's checked tables."""
    try:
        tables = tomllib.loads(path.read_bytes().decode("utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such scene file") from error
    except OSError as error:
        raise InputError(f"{path}: cannot read the scene file ({error.strerror})") from error
    except ValueError as error:  # neither UTF-8 nor TOML
        raise InputError(f"{path}: not valid TOML: {' '.join(str(error).split())}") from error
    try:
        return _SceneFile.model_validate(tables)
    except ValidationError as error:
        # An unknown key first: it is often the misspelling of one that is reported missing.
        problems = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
        raise InputError(f"{path}: {_explain(problems[0])}") from error


def _explain(problem: ErrorDetails) -> str:
    """Say in one line which key is wrong and what is allowed there."""
    location = problem["loc"]
    key = _dotted(location)
    if problem["type"] == "extra_forbidden":
        *table, unknown = location
        valid = [field.alias or name for name, field in _table_at(tuple(table)).model_fields.items()]
        nearest = difflib.get_close_matches(str(unknown), valid, n=1, cutoff=0.0)
        return f"unknown key {key}; the nearest valid key is {_dotted((*table, *nearest))}"
    if problem["type"] == "one_of":
        return f"{key} {problem['msg']}"
    allowed = _field_at(location).description
    if problem["type"] == "missing" and isinstance(location[-1], str):
        return f"{key} is missing; it must be {allowed}"
    shown = "a table" if isinstance(problem["input"], dict) else repr(problem["input"])[:80]
    return f"{key} must be {allowed}, not {shown}"


def _dotted(location: tuple[int | str, ...]) -> str:
    """Write a location as people write it, such as `object[0].rotate_deg`."""
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            bare = part if re.fullmatch(r"[A-Za-z0-9_-]+", part) else json.dumps(part)
            text += f".{bare}" if text else bare
    return text


def _field_at(location: tuple[int | str, ...]) -> FieldInfo:
    """Return the innermost field that a location lies in."""
    *_, field = _fields_along(location)
    return field


def _table_at(location: tuple[int | str, ...]) -> type[BaseModel]:
    """Return the model of the table at a location."""
    if not location:
        return _SceneFile
    return next(_models_in(_field_at(location).annotation))


def _fields_along(location: tuple[int | str, ...]) -> Iterator[FieldInfo]:
    """Yield the fields that a location passes through, from the outermost."""
    table: type[BaseModel] | None = _SceneFile
    for part in location:
        if isinstance(part, int) or table is None:
            continue
        field = next(f for name, f in table.model_fields.items() if (f.alias or name) == part)
        yield field
        table = next(_models_in(field.annotation), None)


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models inside an annotation such as `list[_Object]` or `_Screen | None`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)
