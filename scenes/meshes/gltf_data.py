"""Document, buffers and accessors of a glTF file (glTF 2.0, sections 3.4 to 3.6, 3.7.2 and 4.4).

The models contain the part of the schema that is read. pydantic refuses wrong types, negative
numbers, NaN and deep nesting. References between tables, views and buffers are checked when data
are read.
"""

from __future__ import annotations

import base64
import binascii
import codecs
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray
from pydantic import AliasPath, BaseModel, ConfigDict, Field, ValidationError
from pydantic.alias_generators import to_camel

from xfrustum.scenes import InputError, disk
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.meshes.content import file_beside

#: First word of a binary file, and types of its chunks.
_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
#: Bytes of memory of one parsed object; an object takes at least two bytes of text.
_MEMORY_PER_OBJECT = 1500
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

Natural = Annotated[int, Field(ge=0)]
_Two = tuple[float, float]
_Three = tuple[float, float, float]
_Four = tuple[float, float, float, float]
_Sixteen = Annotated[list[float], Field(min_length=16, max_length=16)]


def _extension(name: str) -> Any:
    return Field(validation_alias=AliasPath("extensions", name))


class _Model(BaseModel):
    model_config = ConfigDict(
        strict=True, frozen=True, alias_generator=to_camel, allow_inf_nan=False, extra="ignore"
    )
    extensions: dict[str, Any] = Field(default_factory=dict)  #: data of extensions, by name


class Visibility(_Model):
    """KHR_node_visibility."""

    visible: bool = True


class Attributes(_Model):
    """EXT_mesh_gpu_instancing, whose attributes are accessors, and KHR_draco_mesh_compression."""

    buffer_view: Natural = 0
    attributes: dict[str, Natural]


class Node(_Model):
    """Node of the scene graph."""

    children: tuple[Natural, ...] = ()
    mesh: Natural | None = None
    skin: Natural | None = None
    weights: tuple[float, ...] | None = None
    matrix: _Sixteen | None = None  #: column by column
    translation: _Three | None = None
    rotation: _Four | None = None  #: quaternion x, y, z, w
    scale: _Three | None = None
    visibility: Annotated[Visibility | None, _extension("KHR_node_visibility")] = None
    instancing: Annotated[Attributes | None, _extension("EXT_mesh_gpu_instancing")] = None


class Primitive(_Model):
    """Part of a mesh with one material and one topology."""

    attributes: dict[str, Natural]
    indices: Natural | None = None
    material: Natural | None = None
    mode: Literal[0, 1, 2, 3, 4, 5, 6] = 4
    targets: tuple[dict[str, Natural], ...] = ()
    draco: Annotated[Attributes | None, _extension("KHR_draco_mesh_compression")] = None


class Mesh(_Model):
    """Primitives, and default weights of their morph targets."""

    primitives: list[Primitive]
    weights: tuple[float, ...] = ()


class Skin(_Model):
    """Joints of a skinned mesh."""

    joints: list[Natural]
    inverse_bind_matrices: Natural | None = None


class Scene(_Model):
    """Root nodes of one scene."""

    nodes: tuple[Natural, ...] = ()


class TextureTransform(_Model):
    """KHR_texture_transform."""

    offset: _Two = (0.0, 0.0)
    rotation: float = 0.0  #: radians
    scale: _Two = (1.0, 1.0)
    tex_coord: Natural | None = None


class TextureInfo(_Model):
    """Reference of a material to a texture."""

    index: Natural
    tex_coord: Natural = 0
    transform: Annotated[TextureTransform | None, _extension("KHR_texture_transform")] = None


class Roughness(_Model):
    """Base color of a material."""

    base_color_factor: _Four = (1.0, 1.0, 1.0, 1.0)
    base_color_texture: TextureInfo | None = None


class Material(_Model):
    """Material; only the base color is read."""

    pbr_metallic_roughness: Roughness = Roughness()
    alpha_mode: str = "OPAQUE"
    normal_texture: Any = None
    occlusion_texture: Any = None
    emissive_texture: Any = None


class TextureSource(_Model):
    """EXT_texture_webp."""

    source: Natural | None = None


class Texture(TextureSource):
    """Texture: number of an image; an extension may refer to another image."""

    sampler: Natural | None = None
    webp: Annotated[TextureSource | None, _extension("EXT_texture_webp")] = None


class Sampler(_Model):
    """Wrapping of a texture outside [0, 1]."""

    wrap_s: int = 10497
    wrap_t: int = 10497


class Picture(_Model):
    """Image file, within a buffer or by name."""

    uri: str | None = None
    buffer_view: Natural | None = None


class Buffer(_Model):
    """Binary data."""

    byte_length: Natural
    uri: str | None = None


class BufferView(_Model):
    """Slice of a buffer."""

    buffer: Natural
    byte_length: Natural
    byte_offset: Natural = 0
    byte_stride: Annotated[int, Field(gt=0)] | None = None


class SparseValues(_Model):
    """Location of the values, or of the indices, of a sparse accessor."""

    buffer_view: Natural
    byte_offset: Natural = 0
    component_type: Literal[5121, 5123, 5125] = 5125


class Sparse(_Model):
    """Elements that replace elements of an accessor."""

    count: Natural
    indices: SparseValues
    values: SparseValues


class Accessor(_Model):
    """Typed array within a buffer view."""

    component_type: Literal[5120, 5121, 5122, 5123, 5125, 5126]
    type: Literal["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"]
    count: Natural
    buffer_view: Natural | None = None
    byte_offset: Natural = 0
    normalized: bool = False
    min: list[float] | None = None
    max: list[float] | None = None
    sparse: Sparse | None = None


class Asset(_Model):
    """Version of the format, and the oldest version that a reader must support."""

    version: str
    min_version: str = "2.0"


class Tree(_Model):
    """Document: tables of objects that refer to each other by number."""

    asset: Asset
    scene: Natural | None = None
    scenes: tuple[Scene, ...] = ()
    nodes: tuple[Node, ...] = ()
    meshes: tuple[Mesh, ...] = ()
    skins: tuple[Skin, ...] = ()
    materials: tuple[Material, ...] = ()
    textures: tuple[Texture, ...] = ()
    samplers: tuple[Sampler, ...] = ()
    images: tuple[Picture, ...] = ()
    accessors: tuple[Accessor, ...] = ()
    buffer_views: tuple[BufferView, ...] = ()
    buffers: tuple[Buffer, ...] = ()
    animations: tuple[Any, ...] = ()
    extensions_used: tuple[str, ...] = ()
    extensions_required: tuple[str, ...] = ()


#: Relative rounding error of six significant digits, the fewest that exporters write.
_PRINTED = 5e-6

_Item = TypeVar("_Item")


@dataclass(frozen=True, eq=False)
class Gltf:
    """A glTF file: its document, and access to its data."""

    path: Path
    tree: Tree
    binary: memoryview | None  #: binary chunk
    decoded: dict[int, NDArray[Any]] = field(default_factory=dict)  #: data of compressed accessors
    _buffers: dict[int, memoryview] = field(default_factory=dict)

    def error(self, reason: str) -> InputError:
        """Return the error of a file that breaks the format."""
        return InputError(f"{self.path}: cannot be read as glTF ({reason}); export the mesh again")

    def entry(self, table: Sequence[_Item], index: int, what: str) -> _Item:
        """Return one entry of a table of the document; InputError if it is missing."""
        if index >= len(table):
            raise self.error(f"{what} {index} of {len(table)} does not exist")
        return table[index]

    def accessor(self, index: int) -> Accessor:
        """Return the description of an accessor."""
        return self.entry(self.tree.accessors, index, "accessor")

    def values(self, index: int, *widths: int, shares: bool = False) -> Floats:
        """Return the numbers of `stored` as doubles; normalized integers become 0..1 or -1..1.

        `shares` also normalizes integers that are not declared normalized.
        """
        stored = self.stored(index, *widths)
        values = stored.astype(np.float64)
        if stored.dtype.kind != "f" and (shares or self.accessor(index).normalized):
            values = np.maximum(values / np.iinfo(stored.dtype).max, -1.0)
        return values

    def stored(self, index: int, *widths: int) -> NDArray[Any]:
        """Return the (count, widths[0]) numbers of an accessor as stored, with sparse values.

        The accessor must have one of `widths`; the first is the smallest.
        """
        accessor = self.accessor(index)
        width = _WIDTHS[accessor.type]
        if width not in widths:
            raise self.error(f"accessor {index} has {width} components, not {widths[0]}")
        if index in self.decoded:
            values = self.decoded[index]
            if values.shape != (accessor.count, width):
                raise self.error(
                    f"accessor {index} has {accessor.count} elements, its data {len(values)}"
                )
            return values[:, : widths[0]]
        kind = np.dtype(_TYPES[accessor.component_type])
        shape, sparse = (accessor.count, width), accessor.sparse
        if accessor.buffer_view is not None:
            values = self._elements(accessor.buffer_view, accessor.byte_offset, kind, shape)
        elif sparse is not None:  # most elements of a sparse accessor have no bytes in the file
            disk.check_declared(self.path, 24 * accessor.count * width, f"accessor {index}")
            values = np.zeros(shape, kind)
        else:
            raise self.error(f"accessor {index} has no data")
        if sparse is not None:
            values = self._replaced(index, values, sparse)
        return values[:, : widths[0]]

    def _replaced(self, index: int, values: NDArray[Any], sparse: Sparse) -> NDArray[Any]:
        at, new, count = sparse.indices, sparse.values, sparse.count
        whole = np.dtype(_TYPES[at.component_type])
        rows = self._elements(at.buffer_view, at.byte_offset, whole, (count, 1))[:, 0].astype(
            np.int64
        )
        if (np.diff(rows) <= 0).any() or (rows >= len(values)).any():
            raise self.error(
                f"sparse indices of accessor {index} do not increase, or are out of range"
            )
        # The view of the base may be shared with other accessors.
        replaced = values.copy()
        shape = (count, values.shape[1])
        replaced[rows] = self._elements(new.buffer_view, new.byte_offset, values.dtype, shape)
        return replaced

    def indices(self, index: int) -> Indices:
        """Return the whole numbers of an accessor of vertex indices."""
        if self.accessor(index).component_type not in (5121, 5123, 5125):
            raise self.error(f"accessor {index} of indices does not hold unsigned integers")
        return self.stored(index, 1)[:, 0].astype(np.int64)

    def check_bounds(self, index: int) -> None:
        """Raise InputError if `min` and `max` of vectors do not match the data."""
        accessor = self.accessor(index)
        stored = self.stored(index, 3)
        # Draco quantizes positions, so that their bounds differ slightly.
        if index in self.decoded:  # bounds are usually from before the compression
            return
        for name, declared in (("min", accessor.min), ("max", accessor.max)):
            if declared is None or not len(stored):
                continue
            measured = (stored.min if name == "min" else stored.max)(axis=0).astype(np.float64)
            rounding = _PRINTED * float(np.abs(measured).max())
            if np.shape(declared) != (3,) or not np.allclose(
                declared, measured, rtol=0, atol=rounding
            ):
                stated, real = (
                    [float(f"{value:.6g}") for value in row] for row in (declared, measured)
                )
                raise self.error(
                    f"{name} of accessor {index} is declared {stated}, its data have {real}"
                )

    def view(self, index: int) -> memoryview:
        """Return the bytes of a buffer view."""
        view = self.entry(self.tree.buffer_views, index, "buffer view")
        data = self._buffer(view.buffer)
        if view.byte_offset + view.byte_length > len(data):
            raise self.error(f"buffer view {index} ends after its buffer of {len(data)} bytes")
        return data[view.byte_offset : view.byte_offset + view.byte_length]

    def _elements(
        self, view: int, offset: int, kind: np.dtype[Any], shape: tuple[int, int]
    ) -> NDArray[Any]:
        count, width = shape
        data = self.view(view)
        stride = self.tree.buffer_views[view].byte_stride or kind.itemsize * width
        end = offset + stride * (count - 1) + kind.itemsize * width if count else 0
        if end > len(data) or stride < kind.itemsize * width:
            raise self.error(
                f"{count} elements take {end} bytes, buffer view {view} has {len(data)}"
            )
        return np.ndarray(shape, kind, data, offset if count else 0, (stride, kind.itemsize))

    def _buffer(self, index: int) -> memoryview:
        if index not in self._buffers:
            buffer = self.entry(self.tree.buffers, index, "buffer")
            data = self.binary if buffer.uri is None and index == 0 else None
            if buffer.uri is not None:
                data = memoryview(self.resource(buffer.uri, buffer.byte_length))
            if data is None or len(data) < buffer.byte_length:
                there = 0 if data is None else len(data)
                raise self.error(
                    f"buffer {index} declares {buffer.byte_length} bytes, there are {there}"
                )
            self._buffers[index] = data[: buffer.byte_length]
        return self._buffers[index]

    def resource(self, uri: str, largest: int) -> bytes:
        """Return the bytes of a data URI, or the first `largest` bytes of a file."""
        if not uri.startswith("data:"):
            file = file_beside(self.path, unquote(uri))
            if file is None:
                raise self.error(f"there is no file {uri[:100]} in its folder")
            size = disk.regular_size(file, "buffer of a mesh")
            return disk.head_of(file, "buffer of a mesh", min(largest, size))
        head, _, text = uri.partition(",")
        data = unquote_to_bytes(text) if "%" in text else text.encode()
        try:
            return base64.b64decode(data, validate=True) if head.endswith(";base64") else data
        except binascii.Error as error:
            raise self.error(f"a data URI is no base64: {error}") from error


def open_gltf(path: Path) -> Gltf:
    """Read the document of a .gltf or .glb file; InputError if it is not glTF 2."""
    data = memoryview(disk.read_input(path, "mesh file"))
    text, binary = data, None
    if len(data) >= 12 and struct.unpack_from("<I", data)[0] == _MAGIC:
        text, binary = _chunks(path, data)
    document = bytes(text).removeprefix(codecs.BOM_UTF8)
    # pydantic keeps all objects in memory at once. Braces estimate their number; braces in strings
    # only raise the estimate.
    objects = document.count(b"{")
    disk.check_declared(path, objects * _MEMORY_PER_OBJECT, f"{objects:,} objects of JSON")
    try:
        gltf = Gltf(path, Tree.model_validate_json(document), binary)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(map(str, first["loc"]))
        reason = f"{where}: {first['msg']}" if where else first["msg"]
        raise InputError(
            f"{path}: cannot be read as glTF ({reason}); export the mesh again"
        ) from error
    asset = gltf.tree.asset
    if not asset.version.startswith("2.") or asset.min_version != "2.0":
        needed = asset.min_version if asset.version.startswith("2.") else asset.version
        raise InputError(f"{path}: is glTF {needed}; export the mesh as glTF 2.0")
    return gltf


def _chunks(path: Path, data: memoryview) -> tuple[memoryview, memoryview | None]:
    """Return the JSON chunk and the binary chunk of a .glb file."""
    _, version, length = struct.unpack_from("<III", data)
    if version != 2:
        raise InputError(
            f"{path}: is binary glTF of version {version}; export the mesh as glTF 2.0"
        )
    if length > len(data):
        raise InputError(
            f"{path}: is cut off: declares {length} bytes, has {len(data)}; copy it again"
        )
    chunks: list[tuple[int, memoryview]] = []
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            raise InputError(
                f"{path}: a chunk of {size} bytes ends after the file; export the mesh again"
            )
        chunks.append((kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    if not chunks or chunks[0][0] != _JSON:
        raise InputError(
            f"{path}: cannot be read as glTF (no chunk of JSON); export the mesh again"
        )
    return chunks[0][1], next((chunk for kind, chunk in chunks[1:] if kind == _BINARY), None)
