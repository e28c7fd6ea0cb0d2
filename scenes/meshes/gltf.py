"""glTF files: nodes, instances, morph targets and skins at rest, in double precision.

Parts are placed node by node, in trimesh's order (CONVENTIONS.md): a node before its children,
siblings from last to first. The number of triangles is computed from the document before any
triangle is placed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from trimesh.transformations import quaternion_matrix

from xfrustum.scenes import InputError, disk
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.meshes.content import (
    MeshContent,
    MeshPart,
    carried,
    open_picture,
    opened,
    unit_normals,
)
from xfrustum.scenes.meshes.gltf_data import (
    Attributes,
    Gltf,
    Node,
    Primitive,
    Sampler,
    TextureTransform,
    open_gltf,
)
from xfrustum.scenes.model.scene import UnreadFeature
from xfrustum.scenes.shapes import cofactors

_TRIANGLES, _STRIP = 4, 5
_REPEAT = 10497  # wrap mode of samplers
_DRACO = "KHR_draco_mesh_compression"
_HONOURED = {
    _DRACO, "EXT_mesh_gpu_instancing", "EXT_texture_webp", "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_transform",
}  # fmt: skip
#: Extensions that change positions or faces and are not read.
_CHANGING_GEOMETRY = {
    "AGI_articulations", "CESIUM_RTC", "EXT_implicit_geometry", "EXT_meshopt_compression",
    "EXT_primitive_voxels", "KHR_implicit_shapes", "KHR_meshopt_compression", "MPEG_accessor_timed",
    "MPEG_buffer_circular", "MPEG_mesh_linking",
}  # fmt: skip
#: Names of extensions that change only the appearance.
_LOOKS = re.compile(r"(KHR|EXT|MSFT|ADOBE|NV)_(materials|texture|lights|packing|xmp)\w*")
#: Number of double arrays in memory at the same time for each array of the result.
_COPIES = 3
#: Bytes of memory of one primitive of a node, without its arrays, and of one instance.
_MEMORY_PER_PART, _MEMORY_PER_INSTANCE = 4000, 512
#: Largest difference of a sum of joint weights from one. For larger differences, vertices differ by
#: more than a thousandth of their position between viewers that normalize weights and viewers that
#: do not.
_WEIGHT_TOLERANCE = 1e-3
_NO_TRIANGLES = UnreadFeature("points and lines", "are not shown")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Local:
    """Triangles of a primitive in the mesh's own coordinates, morph targets applied."""

    points: Floats
    faces: Indices
    normals: Floats | None
    uv: Floats | None
    color: Floats | None
    look: _Look
    joints: tuple[tuple[Indices, Floats], ...]  #: numbers of joints and their weights, (V, 4) each


def read_gltf(path: Path) -> MeshContent:
    """Read a .gltf or .glb file; InputError if it is invalid or needs an unsupported feature."""
    gltf = open_gltf(path)
    unread = _unread_extensions(gltf)
    look = cache(partial(_look_of, gltf, cache(partial(_picture_of, gltf))))
    tree, parts = gltf.tree, []

    @cache
    def primitives(mesh: int, weights: tuple[float, ...], skinned: bool) -> list[_Local | None]:
        return [_local(gltf, each, weights, look, skinned) for each in tree.meshes[mesh].primitives]

    with np.errstate(all="ignore"):  # overflow is refused in the check of all vertices
        worlds = _world_matrices(gltf)
        placed = list(_visible_meshes(gltf))
        _check_memory(gltf, placed)
        for number, mesh in placed:
            node = tree.nodes[number]
            place = _placing(gltf, node, worlds, number)
            weights = tree.meshes[mesh].weights if node.weights is None else node.weights
            for index, local in enumerate(primitives(mesh, weights, node.skin is not None)):
                if local is None:
                    unread.append(_NO_TRIANGLES)
                elif len((part := place(local)).faces):
                    unread += local.look.unread
                    parts.append(replace(part, name=f"mesh {mesh}, primitive {index}"))
    return MeshContent(parts=tuple(parts), unread=tuple(dict.fromkeys(unread)))


def _unread_extensions(gltf: Gltf) -> list[UnreadFeature]:
    """Return unread extensions; refuse extensions that may change the geometry."""
    tree = gltf.tree
    primitives = [primitive for mesh in tree.meshes for primitive in mesh.primitives]
    extended: list[Any] = [tree, *tree.nodes, *tree.meshes, *primitives, *tree.skins, *tree.scenes]
    extended += [*tree.accessors, *tree.buffer_views, *tree.buffers]
    inside = [name for entry in extended for name in entry.extensions]
    names = dict.fromkeys([*tree.extensions_required, *tree.extensions_used, *inside])
    for name in names:
        unknown = (
            name in tree.extensions_required
            and name not in _HONOURED
            and not _LOOKS.fullmatch(name)
        )
        if unknown or name in _CHANGING_GEOMETRY:
            raise InputError(
                f"{gltf.path}: the extension {name} is not read, and may change the geometry; "
                "export the mesh without it"
            )
    unread = [_unread_extension(name) for name in names if name not in _HONOURED]
    if tree.animations:
        unread.append(UnreadFeature("animations", "are not played: all is at rest"))
    return unread


def _local_matrix(gltf: Gltf, node: Node) -> Floats:
    # Section 3.5.3: a node has a matrix or translation, rotation and scale, never both.
    if node.matrix is not None:
        matrix: Floats = np.array(node.matrix).reshape(4, 4).T
        if node.translation or node.rotation or node.scale:
            raise gltf.error("a node has a matrix beside translation, rotation or scale")
        if matrix[3].tolist() != [0, 0, 0, 1]:
            raise gltf.error("the last row of a node's matrix is not 0 0 0 1")
        return matrix
    steps = [[part] if part else None for part in (node.translation, node.rotation, node.scale)]
    placed: Floats = _matrices(*steps, count=1)[0]
    return placed


def _matrices(translation: Any, rotation: Any, scale: Any, *, count: int) -> Floats:
    """Return (count, 4, 4) matrices that scale, rotate, then translate; None skips a step."""
    matrices = np.tile(np.eye(4), (count, 1, 1))
    if rotation is not None:
        # trimesh expects w first, glTF stores it last; the quaternion is made a unit quaternion.
        turned = quaternion_matrix(np.asarray(rotation, np.float64)[:, [3, 0, 1, 2]])
        matrices = np.array(turned).reshape(count, 4, 4)
    if scale is not None:
        matrices[:, :3, :3] *= np.asarray(scale, np.float64)[:, None, :]
    if translation is not None:
        matrices[:, :3, 3] = translation
    return matrices


def _world_matrices(gltf: Gltf) -> list[Floats]:
    """Return the (4, 4) matrix of every node; refuse cycles and nodes with two parents."""
    nodes = gltf.tree.nodes
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.children:
            gltf.entry(nodes, child, "node")
            if child in parents:
                raise gltf.error(f"node {child} is a child twice")
            parents[child] = number
    worlds: dict[int, Floats] = {}
    waiting = [number for number in range(len(nodes)) if number not in parents]
    # A stack instead of recursion: chains of nodes may be deeper than Python's call stack.
    while waiting:
        number = waiting.pop()
        own = _local_matrix(gltf, nodes[number])
        worlds[number] = own if number not in parents else worlds[parents[number]] @ own
        waiting += nodes[number].children
    # Every node of a cycle has a parent, so that no root leads to it.
    if len(worlds) < len(nodes):
        raise gltf.error("nodes are their own children")
    return [worlds[number] for number in range(len(nodes))]


def _visible_meshes(gltf: Gltf) -> Iterator[tuple[int, int]]:
    """Yield visible nodes with their meshes, by number, in the order of their triangles."""
    tree = gltf.tree
    # If scenes are absent or their list is empty, all roots are drawn.
    children = {child for node in tree.nodes for child in node.children}
    waiting = [number for number in range(len(tree.nodes)) if number not in children]
    if tree.scenes or tree.scene is not None:
        waiting = list(gltf.entry(tree.scenes, tree.scene or 0, "scene").nodes)
        if len(set(waiting)) < len(waiting) or not children.isdisjoint(waiting):
            raise gltf.error("a node is a root of the scene twice, or also a child")
    while waiting:
        number = waiting.pop()
        node = gltf.entry(tree.nodes, number, "node")
        if node.visibility is not None and not node.visibility.visible:
            continue
        waiting += node.children
        if node.mesh is not None:
            gltf.entry(tree.meshes, node.mesh, "mesh")
            yield number, node.mesh


def _instances(gltf: Gltf, node: Node) -> int:
    """Return the number of instances of a node's mesh."""
    instancing = node.instancing
    if instancing is None:
        return 1
    counts = {gltf.accessor(index).count for index in instancing.attributes.values()}
    if len(counts) > 1:
        raise gltf.error("attributes of instances have different numbers")
    return counts.pop() if counts else 1


def _check_memory(gltf: Gltf, placed: Sequence[tuple[int, int]]) -> None:
    """Raise InputError if the triangles of all nodes and instances take too much memory."""

    def size(primitive: Primitive) -> int:
        # Counts are read from the document, before any data is decoded.
        names = primitive.attributes
        if "POSITION" not in names:
            return 0
        vertices = gltf.accessor(names["POSITION"]).count
        indices = primitive.indices
        corners = vertices if indices is None else gltf.accessor(indices).count
        faces = corners // 3 if primitive.mode == _TRIANGLES else corners
        arrays = len(names) + len(primitive.targets) + (8 if "JOINTS_0" in names else 0)
        return 24 * (min(vertices, corners) * arrays + faces) * _COPIES

    sizes = [sum(map(size, mesh.primitives)) for mesh in gltf.tree.meshes]
    counts = [_instances(gltf, gltf.tree.nodes[number]) for number, _ in placed]
    total = sum(
        _MEMORY_PER_PART * len(gltf.tree.meshes[mesh].primitives)
        + (_MEMORY_PER_INSTANCE + sizes[mesh]) * count
        for (_, mesh), count in zip(placed, counts, strict=True)
    )
    what = f"{len(placed):,} nodes with {sum(counts):,} instances of meshes"
    disk.check_declared(gltf.path, total, what)


def _faces(gltf: Gltf, primitive: Primitive, count: int) -> Indices:
    """Return (F, 3) faces of a triangle topology, with the winding of section 3.7.2.1."""
    order = np.arange(count) if primitive.indices is None else gltf.indices(primitive.indices)
    if len(order) and order.max() >= count:
        raise gltf.error(f"faces point past the vertices: index {order.max()}, {count} vertices")
    if primitive.mode == _TRIANGLES:
        if len(order) % 3:
            raise gltf.error(f"{len(order)} indices do not form triangles")
        return order.reshape(-1, 3)
    if len(order) < 3:
        return np.empty((0, 3), np.int64)
    if primitive.mode == _STRIP:
        faces = np.stack([order[:-2], order[1:-1], order[2:]], axis=1)
        # Every second triangle of a strip is wound the other way.
        faces[1::2] = faces[1::2, [0, 2, 1]]
        return faces
    # The specification names the center of a fan last in each triangle.
    return np.stack([order[1:-1], order[2:], np.full(len(order) - 2, order[0])], axis=1)


def _local(
    gltf: Gltf,
    primitive: Primitive,
    weights: Sequence[float],
    look_of: Callable[[int], _Look],
    skinned: bool,
) -> _Local | None:
    """Return the triangles of a primitive and their vertices; None for points and lines."""
    names = primitive.attributes
    if primitive.mode < _TRIANGLES or "POSITION" not in names:
        return None
    if weights and len(weights) != len(primitive.targets):
        raise gltf.error(f"{len(weights)} weights for {len(primitive.targets)} morph targets")
    if primitive.draco is not None and gltf.accessor(names["POSITION"]).buffer_view is None:
        _decode_draco(gltf, primitive, primitive.draco)
    count = gltf.accessor(names["POSITION"]).count

    def read(index: int, *widths: int, shares: bool = False) -> Floats:
        if (there := gltf.accessor(index).count) != count:
            raise gltf.error(f"accessor {index} has {there} elements for {count} vertices")
        return gltf.values(index, *widths, shares=shares)[used]

    def attribute(name: str, *widths: int, shares: bool = False) -> Floats | None:
        if name not in names:
            return None
        values = read(names[name], *widths, shares=shares)
        for weight, target in zip(weights, primitive.targets, strict=False):
            if weight and name in target:
                values = values + weight * read(target[name], *widths)
        return values

    # The format requires min and max of positions. This redundancy detects misread data.
    gltf.check_bounds(names["POSITION"])
    faces, used = _faces(gltf, primitive, count), np.ones(count, np.bool_)
    if primitive.indices is not None:  # primitives may share one large array
        used[:] = False
        used[faces] = True
        faces = (np.cumsum(used) - 1)[faces]
    look = _Look() if primitive.material is None else look_of(primitive.material)
    uv = None if primitive.material is None else attribute(look.coordinates, 2)
    joints: list[tuple[Indices, Floats]] = []
    while skinned and (name := f"JOINTS_{len(joints)}") in names:
        shares = attribute(name.replace("JOINTS", "WEIGHTS"), 4, shares=True)
        if shares is None or gltf.accessor(names[name]).count != count:
            raise gltf.error("joints of a skin have no weights")
        # Joints are stored as integers. Integer weights are normalized even if not declared so.
        joints.append((gltf.stored(names[name], 4)[used].astype(np.int64), shares))
    points = attribute("POSITION", 3)
    assert points is not None  # tested above
    return _Local(
        points=points,
        faces=faces,
        normals=attribute("NORMAL", 3),
        uv=None if uv is None else look.placed(uv),
        color=look.colors(attribute("COLOR_0", 3, 4, shares=True)),
        look=look,
        joints=tuple(joints),
    )


def _decode_draco(gltf: Gltf, primitive: Primitive, draco: Attributes) -> None:
    """Decode the data of a primitive's accessors."""
    try:
        import DracoPy  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise InputError(
            f"{gltf.path}: {_DRACO} needs a package that is not installed: pip install "
            "'.[draco]' in the "
            "checkout of xfrustum"
        ) from error
    data = bytes(gltf.view(draco.buffer_view))
    try:
        mesh = DracoPy.decode(data)
        arrays = {
            primitive.attributes[name]: mesh.get_attribute_by_unique_id(number)["data"]
            for name, number in draco.attributes.items()
        }
        faces = np.asarray(mesh.faces, np.uint32).reshape(-1, 1)
    except Exception as error:  # DracoPy and its bindings raise exceptions of their own types
        raise gltf.error(f"{_DRACO}: {str(error) or type(error).__name__}") from error
    if primitive.indices is None or primitive.mode != _TRIANGLES:
        raise gltf.error(f"{_DRACO} of a primitive that is not an indexed list of triangles")
    gltf.decoded.update({**arrays, primitive.indices: faces})


def _placing(
    gltf: Gltf, node: Node, worlds: Sequence[Floats], number: int
) -> Callable[[_Local], MeshPart]:
    """Return a function that places the primitives of a node's mesh."""
    instancing = node.instancing
    if node.skin is not None:
        if instancing is not None:
            raise gltf.error("instances of a mesh with a skin have no defined place")
        skin = gltf.entry(gltf.tree.skins, node.skin, "skin")
        joints = np.array([gltf.entry(worlds, joint, "node") for joint in skin.joints]).reshape(
            -1, 4, 4
        )
        if skin.inverse_bind_matrices is not None:
            there = gltf.accessor(skin.inverse_bind_matrices).count
            if there < len(joints):
                raise gltf.error(f"{there} inverse bind matrices for {len(joints)} joints")
            inverse = gltf.values(skin.inverse_bind_matrices, 16)
            joints = joints @ inverse[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
        return partial(_skinned, gltf, joints)
    matrices = worlds[number][None]
    if instancing is not None:
        indices = instancing.attributes
        steps = [
            gltf.values(indices[name], width) if name in indices else None
            for name, width in (("TRANSLATION", 3), ("ROTATION", 4), ("SCALE", 3))
        ]
        matrices = matrices @ _matrices(*steps, count=_instances(gltf, node))
    return partial(_placed, matrices)


def _placed(matrices: Floats, local: _Local) -> MeshPart:
    """Return the triangles of a primitive, placed by each of the matrices (N, 4, 4)."""
    places, count = len(matrices), len(local.points)
    homogeneous = np.column_stack([local.points, np.ones(count)])
    vertices = np.matmul(matrices, homogeneous.T)[:, :3].transpose(0, 2, 1).reshape(-1, 3)
    faces, normals = carried(matrices[:, :3, :3], local.faces, local.normals)
    faces += count * np.arange(places)[:, None, None]
    normals = None if normals is None else normals.reshape(-1, 3)
    return _part(local, vertices, faces.reshape(-1, 3), normals, places)


def _skinned(gltf: Gltf, joints: Floats, local: _Local) -> MeshPart:
    """Return the triangles of a primitive placed by its joints, (N, 4, 4) matrices."""
    if not local.joints:
        raise gltf.error("a mesh with a skin has no JOINTS_0")
    total = sum(shares.sum(axis=1) for _, shares in local.joints)
    if not (np.abs(total - 1.0) <= _WEIGHT_TOLERANCE).all():
        raise gltf.error("weights of joints do not add up to one")
    matrices = np.zeros((len(local.points), 4, 4))
    for numbers, shares in local.joints:
        if len(numbers) and numbers.max() >= len(joints):
            raise gltf.error(f"joint {numbers.max()} of {len(joints)} does not exist")
        for column in range(4):
            matrices += shares[:, column, None, None] * joints[numbers[:, column]]
    linear = matrices[:, :3, :3]
    vertices = np.einsum("vij,vj->vi", linear, local.points) + matrices[:, :3, 3]
    # The specification does not define the winding if joints mirror. A triangle is reversed if all
    # its corners are mirrored, so that the outside remains outside.
    mirrored = np.linalg.det(linear) < 0
    turned = mirrored[local.faces].all(axis=1)
    faces = np.where(turned[:, None], local.faces[:, ::-1], local.faces)
    normals = None
    if local.normals is not None:
        normals = np.einsum("vi,vij->vj", local.normals, cofactors(linear))
        normals[mirrored] *= -1.0
    return _part(local, vertices, faces, normals, 1)


def _part(
    local: _Local, vertices: Floats, faces: Indices, normals: Floats | None, places: int
) -> MeshPart:
    uv, color = local.uv, local.color
    return MeshPart(
        vertices=vertices,
        faces=faces,
        uv=None if uv is None else np.tile(uv, (places, 1)),
        color=color if color is None or color.ndim == 1 else np.tile(color, (places, 1)),
        normals=None if normals is None else unit_normals(normals),
        picture=local.look.picture,
        texture=local.look.texture,
    )


# Materials (glTF 2.0, sections 3.8 and 3.9)
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class _Look:
    """Color of the surfaces of one material."""

    base_color: Floats | None = None  #: (3,) linear RGB, None if white
    texture: str | None = None  #: name of the base color texture
    picture: Any = None  #: Pillow image, opened and not yet decoded
    coordinates: str = "TEXCOORD_0"  #: attribute that places the texture
    transform: TextureTransform | None = None
    unread: tuple[UnreadFeature, ...] = ()

    def colors(self, stored: Floats | None) -> Floats | None:
        """Return (V, 3) or (3,) linear RGB of vertex colors (V, 3 or 4) times the base color."""
        if stored is None:
            return self.base_color
        finite = np.where(np.isfinite(stored[:, :3]), stored[:, :3], 0.0)
        colors = np.clip(finite, 0.0, 1.0)
        return colors if self.base_color is None else colors * self.base_color

    def placed(self, uv: Floats) -> Floats:
        """Apply the texture's transform to texture coordinates, and turn v upward."""
        if self.transform is not None:
            sine, cosine = np.sin(self.transform.rotation), np.cos(self.transform.rotation)
            turn = np.array([[cosine, sine], [-sine, cosine]])
            uv = (uv * self.transform.scale) @ turn.T + self.transform.offset
        return np.column_stack([uv[:, 0], 1.0 - uv[:, 1]])


def _unread_extension(name: str) -> UnreadFeature:
    """Return the entry of an unsupported extension in the list of unread features."""
    if name == "KHR_materials_pbrSpecularGlossiness":
        return UnreadFeature(name, "is not shown: colors are those of the core material")
    if "_materials_" in name:
        return UnreadFeature(name, "is not shown: materials are those of the scene file")
    return UnreadFeature(name, "is not read")


def _look_of(gltf: Gltf, picture_of: Callable[[int], tuple[str, Any]], index: int) -> _Look:
    """Return the look of a material of a file, with textures from `picture_of`."""
    material = gltf.entry(gltf.tree.materials, index, "material")
    rough = material.pbr_metallic_roughness
    factor, info = rough.base_color_factor[:3], rough.base_color_texture
    look = _Look(base_color=None if factor == (1.0, 1.0, 1.0) else np.array(factor))
    unread = [_unread_extension(name) for name in material.extensions]
    if material.alpha_mode != "OPAQUE":
        opaque = "is not applied: surfaces are opaque"
        unread.append(UnreadFeature(f"alphaMode {material.alpha_mode}", opaque))
    unread += [
        UnreadFeature(f"{name}Texture", "is not shown")
        for name in ("normal", "occlusion", "emissive")
        if getattr(material, f"{name}_texture") is not None
    ]
    if info is not None:
        texture, sampler = gltf.entry(gltf.tree.textures, info.index, "texture"), Sampler()
        if texture.sampler is not None:
            sampler = gltf.entry(gltf.tree.samplers, texture.sampler, "sampler")
        if (sampler.wrap_s, sampler.wrap_t) != (_REPEAT, _REPEAT):
            repeated = "is not applied: textures repeat"
            unread.append(UnreadFeature("wrap mode of a sampler", repeated))
        chosen = None if info.transform is None else info.transform.tex_coord
        name, picture = picture_of(info.index)
        look = replace(
            look,
            texture=name,
            picture=picture,
            coordinates=f"TEXCOORD_{info.tex_coord if chosen is None else chosen}",
            transform=info.transform,
        )
    return replace(look, unread=tuple(unread))


def _picture_of(gltf: Gltf, index: int) -> tuple[str, Any]:
    """Return name and image of a texture; None for an image that cannot be opened or is missing."""
    texture = gltf.tree.textures[index]
    source = texture.source
    if texture.webp is not None and texture.webp.source is not None:
        source = texture.webp.source
    if source is None:
        return f"number {index} without an image", None
    image = gltf.entry(gltf.tree.images, source, "image")
    name = f"in image {source} of the file itself"
    if image.buffer_view is not None:
        data = bytes(gltf.view(image.buffer_view))
    elif image.uri is None:
        return name, None
    elif image.uri.startswith("data:"):
        data = gltf.resource(image.uri, 0)
    else:
        name = unquote(image.uri)
        return name, open_picture(gltf.path, name)
    return name, opened(data)
