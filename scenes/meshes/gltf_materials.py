"""Base colors and textures of glTF materials (glTF 2.0, sections 3.8 and 3.9)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.meshes.gltf_data import Gltf, Sampler, TextureTransform
from xfrustum.scenes.meshes.textures import open_picture, opened
from xfrustum.scenes.model.scene import UnreadFeature

_REPEAT = 10497  # wrap mode of samplers


@dataclass(frozen=True, kw_only=True, eq=False)
class MaterialLook:
    """Color of the surfaces of one material."""

    base_color: Floats | None = None  #: (3,) linear RGB, None where white
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
        """Return texture coordinates with v up, the transform of the texture applied."""
        if self.transform is not None:
            sine, cosine = np.sin(self.transform.rotation), np.cos(self.transform.rotation)
            turn = np.array([[cosine, sine], [-sine, cosine]])
            uv = (uv * self.transform.scale) @ turn.T + self.transform.offset
        return np.column_stack([uv[:, 0], 1.0 - uv[:, 1]])


def unread_extension(name: str) -> UnreadFeature:
    """Return the entry of an extension that is not honoured."""
    consequence = "is not read"
    if name == "KHR_materials_pbrSpecularGlossiness":
        consequence = "is not shown: colors are those of the core material"
    elif "_materials_" in name:
        consequence = "is not shown: materials are those of the scene file"
    return UnreadFeature(feature=name, consequence=consequence)


def look_of(gltf: Gltf, picture_of: Callable[[int], tuple[str, Any]], index: int) -> MaterialLook:
    """Return the look of a material of a file, its textures as of `picture_of`."""
    material = gltf.entry(gltf.tree.materials, index, "material")
    rough = material.pbr_metallic_roughness
    factor, info = rough.base_color_factor[:3], rough.base_color_texture
    base = None if factor == (1.0, 1.0, 1.0) else np.array(factor)
    unread = [unread_extension(name) for name in material.extensions]
    if material.alpha_mode != "OPAQUE":
        feature = f"alphaMode {material.alpha_mode}"
        unread.append(
            UnreadFeature(feature=feature, consequence="is not applied: surfaces are opaque")
        )
    unread += [
        UnreadFeature(feature=f"{name}Texture", consequence="is not shown")
        for name in ("normal", "occlusion", "emissive")
        if getattr(material, f"{name}_texture") is not None
    ]
    if info is None:
        return MaterialLook(base_color=base, unread=tuple(unread))
    transform = info.transform
    chosen = None if transform is None else transform.tex_coord
    texture = gltf.entry(gltf.tree.textures, info.index, "texture")
    sampler = Sampler()
    if texture.sampler is not None:
        sampler = gltf.entry(gltf.tree.samplers, texture.sampler, "sampler")
    if (sampler.wrap_s, sampler.wrap_t) != (_REPEAT, _REPEAT):
        repeated = "is not applied: textures repeat"
        unread.append(UnreadFeature(feature="wrap mode of a sampler", consequence=repeated))
    name, picture = picture_of(info.index)
    return MaterialLook(
        base_color=base,
        texture=name,
        picture=picture,
        coordinates=f"TEXCOORD_{info.tex_coord if chosen is None else chosen}",
        transform=transform,
        unread=tuple(unread),
    )


def picture_of(gltf: Gltf, index: int) -> tuple[str, Any]:
    """Return name and image of a texture; no image where it is missing or cannot be opened."""
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
