"""The scene file (TOML; CONVENTIONS.md, "The scene file"): its tables, read and checked key by key.

All checks that need no other file run before NumPy and mesh readers are loaded.
"""

from __future__ import annotations

import difflib
import json
import math
import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Self, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from xfrustum.scenes import Frustum, InputError, Plate, Screen, appearance, disk
from xfrustum.scenes.appearance import MAX_SAMPLES, Sampling, Transport

if TYPE_CHECKING:
    from xfrustum.scenes import Scene, SceneObject

Location = tuple[int | str, ...]

#: Names of `shapes.SHAPES`, in the order of messages; they are checked before NumPy is loaded.
SHAPE_NAMES = ("box", "square", "sphere", "cylinder", "cone", "torus")

MAX_KEY_PARTS = 16
"""Largest number of parts of a dotted key; keys of scene files have at most three.

`tomllib` takes time in proportion to the square of the parts: 8 seconds for a key of 20,000.
"""

_PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
#: Comments without quotes before them on the line; dots in comments are not counted.
_COMMENT = re.compile(r"""^([^"'#\n]*+)#[^\n]*""", re.MULTILINE)
_LONG_KEY = re.compile(rf"""(?<![\w"'.\\-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{MAX_KEY_PARTS}}}""")


def _gray(value: Any) -> Any:
    """Return a number three times, as gray; other values unchanged."""
    return [value] * 3 if isinstance(value, int | float) else value


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
Count = Annotated[int, Field(strict=True, ge=1, lt=1 << 31)]
Samples = Annotated[int, Field(strict=True, ge=1, le=MAX_SAMPLES)]
Switch = Annotated[bool, Field(strict=True)]
Text = Annotated[str, Field(strict=True, min_length=1)]
Angle = Annotated[Number, Field(gt=0, lt=180)]
Pair = tuple[Number, Number]
Triple = tuple[Number, Number, Number]
Row = tuple[Number, Number, Number, Number]
Coefficient = Annotated[Number, Field(ge=0, le=appearance.LARGEST_COEFFICIENT)]
Share = Annotated[Number, Field(ge=0, le=1)]
Color = Annotated[tuple[Coefficient, Coefficient, Coefficient], BeforeValidator(_gray)]
ColorShare = Annotated[tuple[Share, Share, Share], BeforeValidator(_gray)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _PlateTable(_Table):
    size: tuple[Positive, Positive]
    hogels: tuple[Count, Count]


class _ScreenTable(_Table):
    height: Number
    center: Pair
    size: Pair


class _FrustumTable(_Table):
    resolution: tuple[Count, Count]
    fov_deg: tuple[Angle, Angle] | None = None
    screen: _ScreenTable | None = None
    reach: tuple[Positive, Positive]


class _ObjectTable(_Table):
    mesh: Text | None = None
    shape: Text | None = None
    transform: tuple[Row, Row, Row, Row] | None = None
    scale: Positive | None = None
    rotate_deg: Triple | None = None
    translate: Triple | None = None
    material: Text | None = None
    smooth: Switch = False
    flip_winding: Switch = False
    chord_tolerance: Positive | None = None

    @model_validator(mode="after")
    def _one_of_each(self) -> Self:
        parts = [k for k in ("scale", "rotate_deg", "translate") if getattr(self, k) is not None]
        wrong = None
        if (self.mesh is None) == (self.shape is None):
            shapes = ", ".join(SHAPE_NAMES)
            wrong = (
                f"needs either mesh or shape, and not both: a mesh file, or a shape out of {shapes}"
            )
        elif self.transform is not None and parts:
            wrong = f"has both transform and {parts[0]}; give transform, or any of "
            wrong += "scale, rotate_deg and translate"
        elif self.chord_tolerance is not None and not self.is_patches:
            wrong = "has a chord_tolerance, which only Bezier patches (.bpt) have; leave it out"
        if wrong is not None:
            raise PydanticCustomError("object", "{wrong}", {"wrong": wrong})
        return self

    @property
    def is_patches(self) -> bool:
        return self.mesh is not None and self.mesh.lower().endswith(".bpt")


class _MaterialTable(_Table):
    ambient: Color = appearance.Material.ambient
    diffuse: Color = appearance.Material.diffuse
    specular: Color = appearance.Material.specular
    exponent: Positive = appearance.Material.exponent
    reflectivity: ColorShare = appearance.Material.reflectivity


class _LightTable(_Table):
    direction: Triple
    color: Color = appearance.DirectionalLight.color


class _EnvironmentTable(_Table):
    map: Text
    strength: Annotated[Number, Field(ge=0)] = 1.0


class _SamplingTable(_Table):
    supersample: Samples = Sampling.supersample
    multisample: Samples = Sampling.multisample
    aperture: Samples = Sampling.aperture


class _TransportTable(_Table):
    shadows: Switch = Transport.shadows
    interreflection: Switch = Transport.interreflection
    samples: Annotated[int, Field(strict=True, ge=2, le=MAX_SAMPLES)] = Transport.samples


class _SceneTables(_Table):
    name: Text | None = None
    units: Text = "units"
    plate: _PlateTable
    frustum: _FrustumTable
    objects: list[_ObjectTable] = Field([], alias="object")
    material: dict[str, _MaterialTable] = {}
    lights: list[_LightTable] | None = Field(None, alias="light")
    environment: _EnvironmentTable | None = None
    sampling: _SamplingTable = _SamplingTable()
    transport: _TransportTable = _TransportTable()


def read_scene(path: Path) -> Scene:
    """Read a scene file, its meshes and its map; InputError names file, key and fault."""
    file, plate, frustum = checked(path)
    from xfrustum.scenes.model.scene import Scene  # noqa: PLC0415 - loads NumPy

    return Scene(
        name=file.name or path.stem,
        units=file.units,
        plate=plate,
        frustum=frustum,
        objects=tuple(_object(path, entry, index) for index, entry in enumerate(file.objects)),
        # Use an absolute path, so that an image can be compared from another folder.
        source=str(path.absolute()),
        appearance=_appearance(path, file),
        sampling=Sampling(**file.sampling.model_dump()),
        transport=Transport(**file.transport.model_dump()),
    )


def checked(path: Path) -> tuple[_SceneTables, Plate, Frustum]:
    """Return the tables of a scene file, its plate and its frustum, without reading meshes."""
    try:
        content = disk.read_small(path, "scene file", disk.SCENE_FILE_SIZE)
        text = content.decode("utf-8-sig")  # some editors begin a file with a byte-order mark
        if long := _LONG_KEY.search(_COMMENT.sub(r"\1", text)):
            line = 1 + long.string.count("\n", 0, long.start())
            raise InputError(
                f"{path}: line {line}: the key {long[0][:40]}.. has more than {MAX_KEY_PARTS} "
                "parts; "
                "keys of scene files have at most three"
            )
        tables = tomllib.loads(text)
    except ValueError as error:  # the file is not UTF-8 or not TOML
        hint = (
            ""
            if path.suffix == ".toml"
            else "; for a mesh, write a scene file first: xfrustum new MESH"
        )
        raise InputError(f"{path}: not valid TOML: {' '.join(str(error).split())}{hint}") from error
    except RecursionError as error:
        raise InputError(
            f"{path}: not valid TOML: arrays or tables are nested too deeply"
        ) from error
    try:
        file = _SceneTables.model_validate(tables)
        plate = Plate(size=file.plate.size, hogels=file.plate.hogels)
        disk.check_hogels(*plate.hogels)
        screen, fov_deg = file.frustum.screen, file.frustum.fov_deg
        frustum = Frustum(
            resolution=file.frustum.resolution,
            reach=file.frustum.reach,
            fov=None if fov_deg is None else (math.radians(fov_deg[0]), math.radians(fov_deg[1])),
            screen=None if screen is None else Screen(**screen.model_dump()),
        )
    except ValidationError as error:
        raise InputError(f"{path}: {described(error, _SceneTables)}") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    # Missing materials and files are refused before the first mesh is read.
    for index, entry in enumerate(file.objects):
        if entry.material is not None and entry.material not in file.material:
            known = ", ".join(file.material) or "none"
            raise InputError(
                f"{path}: object[{index}].material must name a [material.NAME] table, not "
                f"{entry.material!r}; the file has {known}"
            )
        if entry.mesh is not None:
            with named(path, f"object[{index}].mesh"):
                disk.check_mesh_file(path.parent / entry.mesh)
    if file.environment is not None:
        with named(path, "environment.map"):
            advice = "its path is relative to the scene file"
            disk.regular_size(path.parent / file.environment.map, "environment map", advice)
    return file, plate, frustum


@contextmanager
def named(path: Path, key: str) -> Iterator[None]:
    """Prefix the message of an error within a block with the scene file and the key."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {key}: {error}") from error


def described(error: ValidationError, tables: type[BaseModel]) -> str:
    """Return the wrong key and the reason in one line; unknown keys come first."""
    problems = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
    problem, location = problems[0], problems[0]["loc"]
    key = dotted(location)
    if problem["type"] == "extra_forbidden":
        *table, unknown = location
        for part in (*table, None):
            fields = {field.alias or name: field for name, field in tables.model_fields.items()}
            # Parts of a location that are not keys are list indices, or the name of one of several
            # table types.
            if part in fields:
                tables = next(_models_in(fields[str(part)].annotation), tables)
        nearest = difflib.get_close_matches(str(unknown), list(fields), n=1, cutoff=0.0)
        return f"unknown key {key}; the nearest valid key is {dotted((*table, *nearest))}"
    if problem["type"] == "missing":
        return f"{key} is missing"
    if problem["type"] == "object":
        return f"{key} {problem['msg']}"
    advice = f" ([[{key}]] in TOML)" if problem["type"] == "list_type" else ""
    try:
        shown = "a table" if isinstance(problem["input"], dict) else repr(problem["input"])[:80]
    except ValueError:  # Python refuses to print integers of more than 4,300 digits
        shown = "a number of thousands of digits"
    return f"{key}: {problem['msg'][0].lower()}{problem['msg'][1:]}{advice}, not {shown}"


def dotted(location: Location) -> str:
    """Return a location in the notation `object[0].rotate_deg`."""
    bare = re.compile(r"[A-Za-z0-9_-]+")
    keys = (
        f"[{k}]" if isinstance(k, int) else "." + (k if bare.fullmatch(k) else json.dumps(k))
        for k in location
    )
    return "".join(keys).removeprefix(".")


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models inside an annotation, such as `list[_ObjectTable]`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)


def _object(path: Path, entry: _ObjectTable, index: int) -> SceneObject:
    import numpy as np  # noqa: PLC0415 - scene files are checked without it

    from xfrustum.scenes import shapes  # noqa: PLC0415 - likewise

    if entry.transform is not None:
        matrix = np.array(entry.transform, dtype=np.float64)
        linear, fault = matrix[:3, :3], ""
        # Scale the matrix to size one first, so that the rank of a tiny or huge matrix neither
        # under- nor overflows.
        largest = np.abs(linear).max()
        if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
            fault = f"its last row is {matrix[3].tolist()}"
        elif largest == 0 or np.linalg.matrix_rank(linear / largest) < 3:
            fault = "its upper left 3 x 3 numbers are singular"
        if fault:
            raise InputError(
                f"{path}: object[{index}].transform must be four rows of four numbers, the "
                "last [0, 0, 0, 1],"
                f" and not singular: {fault}"
            )
    else:
        origin = (0.0, 0.0, 0.0)
        matrix = shapes.placement(
            entry.scale or 1.0, entry.rotate_deg or origin, entry.translate or origin
        )
    with named(path, f"object[{index}].{'shape' if entry.mesh is None else 'mesh'}"):
        if entry.mesh is None:
            part = shapes.build_shape(str(entry.shape), material=entry.material)
        elif entry.is_patches:
            # This import loads SciPy's graphs.
            from xfrustum.scenes.meshes.tessellation import load_patches  # noqa: PLC0415

            # The tolerance is a length in the scene. Divide it by the largest scale factor to get a
            # length in the mesh.
            tolerance = entry.chord_tolerance
            own = None if tolerance is None else tolerance / shapes.magnification(matrix)
            part = load_patches(
                path.parent / entry.mesh, chord_tolerance=own, material=entry.material
            )
        else:
            from xfrustum.scenes.meshes.mesh_file import load_mesh  # noqa: PLC0415 - loads trimesh

            part = load_mesh(path.parent / entry.mesh, material=entry.material)
        part = shapes.flipped(part) if entry.flip_winding else part
        part = shapes.place(shapes.smoothed(part) if entry.smooth else part, matrix)
    # If the matrix mirrors and the file also flips the winding, mirroring is intended.
    if np.linalg.slogdet(matrix[:3, :3])[0] > 0 or entry.flip_winding:
        return part
    mirrored = (
        f"object[{index}].transform mirrors {part.name} (its determinant is negative): left "
        "and right are "
        "exchanged, and the winding faces inward; negate a row, or set flip_winding = true "
        "if it is meant"
    )
    return replace(part, warnings=(*part.warnings, mirrored))


def _appearance(path: Path, file: _SceneTables) -> appearance.Appearance:
    """Return materials and lights; without light and environment, the default light."""
    materials = {
        name: appearance.Material(**table.model_dump()) for name, table in file.material.items()
    }
    lights, environment = [], None
    for index, table in enumerate(file.lights or ()):
        try:
            lights.append(appearance.DirectionalLight(**table.model_dump()))
        except InputError as error:
            raise InputError(f"{path}: light[{index}].{error}") from error
    if file.environment is not None:
        from xfrustum.scenes.files.pictures import read_environment  # noqa: PLC0415 - loads OpenEXR

        with named(path, "environment.map"):
            map_file, strength = path.parent / file.environment.map, file.environment.strength
            environment = read_environment(map_file, strength=strength)
    unlit = file.lights is None and file.environment is None
    return appearance.Appearance(
        materials=MappingProxyType(materials),
        lights=(appearance.DEFAULT_LIGHT,) if unlit else tuple(lights),
        environment=environment,
    )
