"""The light model by its definition (CONVENTIONS.md, "Light"), in numpy and double precision.

The model uses the true eye vector and no flips, at surface points that the cameras of the double
frustum draw.
"""

import functools
import itertools
from dataclasses import replace

import numpy as np

from tests.support.views import lines_by_definition, view
from xfrustum.raster.device.context import describe, open_context
from xfrustum.scenes import HogelImage, Scene, SceneObject
from xfrustum.scenes.appearance import Appearance, DirectionalLight, Environment, Material
from xfrustum.scenes.arrays import Bytes, Floats, Numbers
from xfrustum.scenes.model.device_model import DeviceModel, model_of

SHINY = Material(
    ambient=(0.05, 0.1, 0.15),
    diffuse=(0.5, 0.4, 0.3),
    specular=(0.3, 0.5, 0.9),
    exponent=12.0,
    reflectivity=(0.3, 0.6, 0.2),
)
PLAIN = Material(
    ambient=(0.2, 0.1, 0.0), diffuse=(0.3, 0.6, 0.5), specular=(0.4, 0.2, 0.1), exponent=75.0
)
LIGHTS = (
    DirectionalLight(direction=(-2.0, 3.0, 1.0), color=(1.0, 0.9, 0.7)),
    DirectionalLight(direction=(1.0, 0.3, 2.0), color=(0.3, 0.5, 0.9)),
    DirectionalLight(direction=(0.5, -1.0, -0.2), color=(0.4, 0.1, 0.2)),
)


def unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def decoded(codes: Bytes) -> Floats:
    """Return linear RGB for sRGB codes, by IEC 61966-2-1."""
    c = codes / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def bilinear(picture: Floats, x: Floats, y: Floats, *, wrap_rows: bool) -> Floats:
    """Interpolate between texel centers, x and y in texels; columns wrap, and optionally rows."""
    rows, columns = picture.shape[:2]
    x, y = x - 0.5, y - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    share_x, share_y = (x - left)[..., None], (y - top)[..., None]
    row = [r % rows if wrap_rows else np.clip(r, 0, rows - 1) for r in (top, top + 1)]
    column = [c % columns for c in (left, left + 1)]
    upper, lower = (
        picture[r, column[0]] * (1 - share_x) + picture[r, column[1]] * share_x for r in row
    )
    return np.asarray(upper * (1 - share_y) + lower * share_y)


def environment_along(environment: Environment, direction: Floats) -> Floats:
    rows, columns = environment.radiance.shape[:2]
    x, y, z = np.moveaxis(unit(direction), -1, 0)
    right = 0.5 + np.arctan2(x, -z) / (2 * np.pi)
    down = 0.5 - np.arcsin(np.clip(y, -1, 1)) / np.pi
    picture = environment.radiance.astype(np.float64)
    return environment.strength * bilinear(picture, right * columns, down * rows, wrap_rows=False)


def interpolated(weight: Floats, values: Floats) -> Floats:
    """Return values at corners (N, 3, K), interpolated with weights (N, 3)."""
    return np.asarray(np.einsum("nk,nki->ni", weight, values))


def weights_on_triangles(
    scene: Scene, image: HogelImage, shift_px: tuple[float, float] = (0.0, 0.0)
) -> tuple[Floats, Floats]:
    """Return corner weights (N, 3) and unit eye vectors (N, 3) of pixels with a surface.

    Every pixel's line is the line of its camera, parallel to the true line and offset by near.
    Weights are for points `shift_px` (columns, rows) away from the pixel centers. Eye vectors are
    for the centers.
    """
    settings, camera = image.camera.settings, image.camera
    assert settings is None or settings.slabs == ()
    lines = lines_by_definition(scene, camera.aperture)
    offset = shift_px[0] * (lines[0, 1] - lines[0, 0]) + shift_px[1] * (lines[1, 0] - lines[0, 0])
    d = lines[image.covered] + offset
    corners = scene.triangles[image.triangle[image.covered]]
    # C is at z = +n on the sheared axis through the aperture, C* at z = -n.
    near = 0.0 if settings is None else settings.near
    side = np.where(image.height[image.covered] > 0, -near, near)
    aperture = np.array([camera.aperture.x, camera.aperture.y, 0.0])
    from_corner = aperture - side[:, None] * [*camera.shear, -1.0] - corners[:, 0]
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(d, e2)
    first, two = (
        (a * b).sum(axis=1) / (e1 * across).sum(axis=1)
        for a, b in ((from_corner, across), (d, np.cross(from_corner, e1)))
    )
    return np.stack((1 - first - two, first, two), axis=1), -unit(lines[image.covered])


def texture_colors(scene: Scene, triangle: Numbers, weight: Floats) -> Floats:
    surface = scene.surface
    colors = np.ones((len(triangle), 3))
    if surface.texture_of_triangle is None or surface.uv is None:
        return colors
    uv = interpolated(weight, surface.uv[scene.faces[triangle]])
    number = surface.texture_of_triangle[triangle]
    for index, texture in enumerate(surface.textures):
        here = number == index
        rows, columns = texture.shape[:2]
        x, y = uv[here, 0] * columns, (1 - uv[here, 1]) * rows
        colors[here] = bilinear(decoded(texture[..., :3]), x, y, wrap_rows=True)
    return colors


def normals_to_the_viewer(scene: Scene, triangle: Numbers, weight: Floats, eye: Floats) -> Floats:
    flat = normal = scene.normals[triangle]
    if scene.surface.vertex_normals is not None:
        smooth = interpolated(weight, scene.surface.vertex_normals[scene.faces[triangle]])
        normal = np.where(np.isfinite(smooth).all(axis=1, keepdims=True), unit(smooth), flat)
    back = np.einsum("ni,ni->n", flat, eye) < 0
    return np.where(back[:, None], -normal, normal)


def radiance_by_definition(
    scene: Scene, image: HogelImage, shift_px: tuple[float, float] = (0.0, 0.0)
) -> Floats:
    """Return linear RGB (H, W, 3) of an image's surfaces, black where there is none.

    Attributes may be evaluated at points offset from the pixels' centers.
    """
    covered = image.covered
    triangle = image.triangle[covered]
    weight, eye = weights_on_triangles(scene, image, shift_px)
    normal = normals_to_the_viewer(scene, triangle, weight, eye)
    mirrored = 2 * np.einsum("ni,ni->n", normal, eye)[:, None] * normal - eye
    albedo = texture_colors(scene, triangle, weight)
    if scene.surface.vertex_colors is not None:
        albedo *= interpolated(weight, scene.surface.vertex_colors[scene.faces[triangle]])

    def coefficient(name: str) -> Floats:
        return np.array([getattr(m, name) for m in scene.materials])[
            scene.object_of_triangle[triangle]
        ]

    radiance = coefficient("ambient") * albedo
    for light in scene.appearance.lights:
        facing, along = normal @ light.direction, np.maximum(mirrored @ light.direction, 0)
        highlight = np.where(facing > 0, along ** coefficient("exponent"), 0)
        diffuse = coefficient("diffuse") * albedo * np.maximum(facing, 0)[:, None]
        radiance += np.array(light.color) * (diffuse + coefficient("specular") * highlight[:, None])
    environment = scene.appearance.environment
    if environment is not None:
        radiance += coefficient("reflectivity") * environment_along(environment, mirrored)
    picture = np.zeros((*image.triangle.shape, 3))
    picture[covered] = radiance
    return picture


def moved_by_snapping(scene: Scene, image: HogelImage, model: DeviceModel) -> Floats:
    """Return bounds (H, W, 3) of radiance errors from attributes at snapped vertices.

    Attributes are exact at some point within half a subpixel step of the pixel's center along each
    axis (`Planes.varying`). A nearly linear function on this square changes most toward a corner.
    """
    exact = radiance_by_definition(scene, image)
    if not model.snaps_depth:
        return np.zeros_like(exact)
    shifts = (-model.half_step, model.half_step)
    corners = itertools.product(shifts, shifts)
    moved = [radiance_by_definition(scene, image, at) for at in corners]
    return np.asarray(np.abs(np.array(moved) - exact).max(axis=0))


@functools.cache
def device_at_hand() -> DeviceModel:
    """Return the model of the device in use."""
    with open_context() as context:
        model = model_of(describe(context))
    context.release()
    return model


def patterned_environment(seed: int = 5, size: tuple[int, int] = (12, 7)) -> Environment:
    """Return an environment without symmetry, with some radiances above 1."""
    generator = np.random.default_rng(seed)
    return Environment(
        radiance=generator.uniform(0, 2, (size[1], size[0], 3)).astype(np.float32), strength=0.8
    )


def with_smooth_normals(part: SceneObject) -> SceneObject:
    """Return an object with vertex normals: area-weighted means of adjoining faces."""
    corners = part.vertices[part.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros_like(part.vertices)
    np.add.at(total, part.faces, area[:, None])
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return replace(part, vertex_normals=total / np.where(length > 0, length, np.nan))


def dressed(part: SceneObject, seed: int) -> SceneObject:
    """Return an object with all attributes: mostly smooth, colored, with two textures."""
    generator = np.random.default_rng(seed)
    smooth = with_smooth_normals(part)
    normals = smooth.vertex_normals.copy()
    normals[generator.random(len(normals)) < 0.05] = np.nan
    colors = generator.uniform(0.2, 1.0, part.vertices.shape)
    # The texture is projected from the side: a texel covers the pixels of a few triangles.
    uv = part.vertices[:, :2] * 0.11 + part.vertices[:, 2:] * [0.05, -0.03]
    textures = tuple(
        generator.integers(0, 256, (*size, 4)).astype(np.uint8) for size in ((5, 9), (16, 4))
    )
    number = generator.integers(-1, 2, len(part.faces)).astype(np.int32)
    return replace(
        part,
        vertex_normals=normals,
        vertex_colors=colors,
        uv=uv,
        textures=textures,
        texture_of_triangle=number,
        material="shiny" if seed % 2 else "plain",
    )


def dressed_scene(name: str, resolution: tuple[int, int]) -> Scene:
    """Return a built-in scene with lights, environment, and all attributes on half the objects."""
    scene = view(name, resolution)
    objects = tuple(
        replace(part, material="shiny") if index % 3 == 2 else dressed(part, index)
        for index, part in enumerate(scene.objects)
    )
    look = Appearance(
        materials={"shiny": SHINY, "plain": PLAIN},
        lights=LIGHTS,
        environment=patterned_environment(),
    )
    return replace(scene, objects=objects, appearance=look)
