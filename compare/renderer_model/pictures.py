"""Images of a renderer model: traced and certified like the truth, then colored."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from xfrustum.compare.renderer_model.conventions import UPRIGHT, Orientation
from xfrustum.compare.renderer_model.drawn_model import (
    EVEN,
    RIGHT_AXES,
    Back,
    Culled,
    Film,
    Front,
    Normals,
    RendererModel,
    unflipped,
)
from xfrustum.reference import Reference
from xfrustum.reference.certify.certify import first_surfaces
from xfrustum.reference.lines import (
    RayBundle,
    distance_to_triangles,
    facing,
    pixel_places,
    plane_places,
    triangle_normals,
)
from xfrustum.reference.pictures import Layer, averages, overlaid
from xfrustum.reference.shading import Shader
from xfrustum.scenes.arrays import Floats, Mask, Singles
from xfrustum.scenes.files.pictures import is_picture
from xfrustum.scenes.model.effects import ALL_EFFECTS
from xfrustum.scenes.model.images import NOTHING, Certainty, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, Frustum, Screen

COLOR_TOLERANCE = 2.3 / 255
"""Largest difference in linear radiance of two 8-bit pictures of one surface.

Half an 8-bit step is 0.5/255 in linear values. In sRGB it is at most 1.14/255, at white, where the
decoding curve is steepest (2.4/1.055). Half a step counts twice: for the renderer's own rounding
and for storing."""

# Smallest distance of triangle points from a camera's own plane, as a fraction of the reach: points
# in this plane have no position on the film.
CAMERA_DISTANCE_PER_REACH = 1e-6

# Largest distance from a triangle at which a point counts as on the triangle, as a fraction of the
# reach: a million roundings of doubles. Seen at a thousandth of the reach, it is a thousandth of a
# pixel on a film of 1000 pixels.
TRIANGLE_TOLERANCE_PER_REACH = 1e-9

# Number of changed scenes in the cache; few suffice, because candidates are drawn one by one.
KEPT_REFERENCES = 4

Layers = dict[tuple[RayBundle, bool, Culled, Film], Layer]
"""Layers of cameras, by lines, whether the last surface wins, culled faces, and film."""


@lru_cache(maxsize=KEPT_REFERENCES)
def _changed(reference: Reference, axes: str, missing: tuple[int, ...]) -> Reference:
    scene, matrix = reference.scene, np.zeros((3, 3))
    for row, axis in enumerate(axes.split(", ")):
        matrix["xyz".index(axis[-1]), row] = -1.0 if axis.startswith("-") else 1.0
    parts = []
    for number, part in enumerate(scene.objects):
        vertices = part.vertices @ matrix
        if number in missing:
            # Move the object beyond the reach: it is not drawn, and triangles keep their numbers.
            vertices -= (0.0, 0.0, vertices[:, 2].max() + 4 * scene.frustum.longest_reach)
        normals = None if part.vertex_normals is None else part.vertex_normals @ matrix
        parts.append(replace(part, vertices=vertices, vertex_normals=normals))
    # Selecting the effects of each changed scene takes longer than evaluating all effects.
    return Reference(replace(scene, objects=tuple(parts)), reference.tracer_name, ALL_EFFECTS)


def drawn_scene(reference: Reference, model: RendererModel) -> Reference:
    """Return the reference of a model's scene, with its axes and without its missing objects."""
    if model.axes == RIGHT_AXES and not model.missing:
        return reference
    return _changed(reference, model.axes, model.missing)


def trace_drawn(reference: Reference, model: RendererModel, aperture: Aperture) -> HogelImage:
    """Return the upright image of an aperture that a model draws, without color."""
    return as_image(reference, aperture, drawn(reference, model, aperture))


def drawn(
    reference: Reference, model: RendererModel, aperture: Aperture, known: Layers | None = None
) -> Layer:
    """Return the layer that a model's cameras draw; `known` caches layers of this aperture."""
    known, scene = {} if known is None else known, reference.scene

    def shown(side: int, *, last: bool = False) -> Layer:
        bundle = model.bundle(scene, aperture, side)
        key = (bundle, last, model.culled, model.film)
        if key not in known and model.film is EVEN:
            known[key] = layer(reference, bundle, last=last, culled=model.culled)
        elif key not in known:
            known[key] = uneven_layer(reference, bundle, model.film, last=last)
        return known[key]

    if model.plain and model.one_pencil:
        return shown(0)
    layers = [] if model.back is Back.MISSING else [shown(1, last=model.back is Back.FARTHEST)]
    if model.front is not Front.MISSING:
        layers.append(shown(-1, last=model.front is Front.NEAREST))
    return overlaid(layers if model.overlaid else layers[::-1])


def layer(
    reference: Reference, bundle: RayBundle, *, last: bool = False, culled: Culled = Culled.NONE
) -> Layer:
    """Return the first or the last surfaces along a camera's lines."""
    triangles, film = reference.scene.triangles, unflipped(bundle)
    kept = np.arange(len(triangles))
    if culled is not Culled.NONE:
        # `facing` returns 1 for counterclockwise and -1 for clockwise triangles.
        left_out = 1 if culled is Culled.COUNTERCLOCKWISE else -1
        kept = np.flatnonzero(facing(triangles, film) != left_out)
        triangles = triangles[kept]
    if last:
        # Reflecting the scene at the center makes the last surface along a line the first.
        (low, high), mirrored = film.s_range, 2 * np.asarray(film.center) - triangles
        decided = first_surfaces(mirrored, replace(film, s_range=(-high, -low)))
        decided = replace(decided, s=-decided.s)
    elif culled is Culled.NONE:
        decided = reference.first_surfaces(film)
    else:
        decided = first_surfaces(triangles, film)
    result = Layer.from_surfaces(film, decided.renumbered(kept))
    # A film with negative half-extents has its pixels in another order.
    flipped = Orientation(False, *(extent < 0 for extent in bundle.half_extent))
    if flipped == UPRIGHT:
        return result
    row, column, number = result.tied_triangles.T
    column, row = flipped.cells(column, row, bundle.resolution)
    return Layer(
        triangle=flipped.applied(result.triangle),
        certainty=flipped.applied(result.certainty),
        tied_triangles=np.stack((row, column, number), axis=1),
        position=flipped.applied(result.position),
    )


def uneven_layer(
    reference: Reference, bundle: RayBundle, film: Film, *, last: bool = False
) -> Layer:
    """Trace the first or last surfaces along the lines of an uneven film, without culling."""
    directions, center = film.directions(bundle), np.asarray(bundle.center)
    (low, high), (height, width, _) = bundle.s_range, directions.shape
    rays, corners = directions.reshape(-1, 3), reference.scene.triangles
    start, sign = (high, -1.0) if last else (low, 1.0)
    number, s = np.full(len(rays), NOTHING, dtype=np.int32), np.full(len(rays), np.nan)
    hit = reference.tracer.first_hits(center + start * rays, sign * rays)
    there = np.flatnonzero(hit != NOTHING)
    met = corners[hit[there]]
    place = plane_places(met, triangle_normals(met), center, rays[there])
    inside = (low <= place) & (place <= high)
    there = there[inside]
    number[there], s[there] = hit[there], place[inside]
    return Layer(
        triangle=number.reshape(height, width),
        certainty=np.full((height, width), Certainty.UNEXAMINED, dtype=np.uint8),
        tied_triangles=np.zeros((0, 3), dtype=np.int64),
        position=center + s.reshape(height, width, 1) * directions,
    )


def as_image(reference: Reference, aperture: Aperture, shown: Layer) -> HogelImage:
    """Return a layer as the image of an aperture."""
    return HogelImage(
        camera=reference.camera(aperture),
        triangle=shown.triangle,
        object=reference.scene.object_of_number[shown.triangle],
        position=shown.position,
        certainty=shown.certainty,
    )


def colored(scene: Scene, model: RendererModel, answer: HogelImage) -> HogelImage:
    """Return an image with the color of each pixel's surface point, without averaging.

    Each half is shaded along the lines of its own camera. Correct lights are conjugated: C* needs
    light directions L* = -L. Without conjugation C* uses the lights of C.
    """
    front = answer.height > model.plate_height
    directions, of_c_star = (
        model.film.directions(model.bundle(scene, answer.camera.aperture, side)) for side in (1, -1)
    )
    directions[front] = of_c_star[front]
    scene = _with_normals(scene, model.normals)

    def radiance(lit: Scene) -> Singles:
        # Selecting the effects that the scene needs takes as long as drawing, and changes no color.
        shader, position = Shader(lit, ALL_EFFECTS), answer.position.astype(np.float64)
        return shader.picture(answer.triangle, position, directions).astype(np.float32)

    color = radiance(scene)
    if not model.conjugated:
        # C* turns normals toward itself, away from the viewer. Reversing all normals is equivalent
        # to reversing the lights.
        lights = []
        for light in scene.appearance.lights:
            x, y, z = light.direction
            lights.append(replace(light, direction=(-x, -y, -z)))
        appearance = replace(scene.appearance, lights=tuple(lights))
        color = np.where(front[..., None], radiance(replace(scene, appearance=appearance)), color)
    return replace(answer, color=color)


@lru_cache(maxsize=2)
def _with_normals(scene: Scene, normals: Normals) -> Scene:
    """Return the scene with the normals that a model uses for shading."""
    if normals is Normals.RIGHT:
        return scene
    if normals is Normals.FLAT:
        flat = [replace(part, vertex_normals=None) for part in scene.objects]
        return replace(scene, objects=tuple(flat))
    # The winding determines the visible side and is kept; each corner gets its own normal.
    parts = []
    for number, part in enumerate(scene.objects):
        corners = part.faces.reshape(-1)
        own = np.repeat(scene.normals[scene.object_of_triangle == number], 3, axis=0)
        if part.vertex_normals is not None:
            smooth = part.vertex_normals[corners]
            own = np.where(np.isnan(smooth), own, smooth)
        unshared = replace(
            part,
            vertices=part.vertices[corners],
            faces=np.arange(len(corners)).reshape(-1, 3),
            uv=None if part.uv is None else part.uv[corners],
            vertex_colors=None if part.vertex_colors is None else part.vertex_colors[corners],
            vertex_normals=-own,
        )
        parts.append(unshared)
    return replace(scene, objects=tuple(parts))


def reference_colors(
    reference: Reference, question: RendererModel, answer: HogelImage
) -> HogelImage:
    """Return a model's image with the color of the reference.

    If color is an average over samples, the near offset is ignored, and the viewer's half is drawn
    over the other.
    """
    aperture = answer.camera.aperture
    # Orientation and order move pixels without changing their colors.
    if replace(question, orientation=UPRIGHT, order=UPRIGHT) == RendererModel():
        return replace(answer, color=reference.trace(aperture).color)
    shared = replace(question, near=0.0).one_pencil and question.film is EVEN
    plain = shared and question.conjugated and question.normals is Normals.RIGHT
    if not (averages(reference.scene.sampling) and plain):
        return colored(reference.scene, question, answer)
    return replace(answer, color=picture_of(reference, question, aperture).color)


def picture_of(
    reference: Reference,
    model: RendererModel,
    aperture: Aperture,
    finer: int = 1,
    wider: float = 1.0,
) -> HogelImage:
    """Return the reference's picture of an aperture under a model, without its near offset.

    Each pixel is divided into `finer` pixels along each side, and the film is `wider` times as wide
    and high.
    """
    scene = reference.scene
    bundle = replace(model, near=0.0).bundle(scene, aperture, 0)
    width, height = scene.frustum.resolution
    frustum = Frustum(
        resolution=(round(width * finer * wider), round(height * finer * wider)),
        reach=(-bundle.s_range[0], bundle.s_range[1]),
        screen=Screen(
            height=-1.0,  # one unit behind the plate, where slopes are lengths
            center=(bundle.center[0] + bundle.shear[0], bundle.center[1] + bundle.shear[1]),
            size=(2 * wider * bundle.half_extent[0], 2 * wider * bundle.half_extent[1]),
        ),
    )
    # The plate of the picture is at z = 0: move the objects if the lines meet at another height.
    below = np.array([0.0, 0.0, bundle.center[2]])
    moved = tuple(replace(part, vertices=part.vertices - below) for part in scene.objects)
    there = replace(scene, frustum=frustum, objects=moved if below.any() else scene.objects)
    return Reference(there).trace(replace(aperture, x=bundle.center[0], y=bundle.center[1]))


def shows_something(image: HogelImage) -> Mask:
    """Return the pixels of a picture that are not black, the color of the background."""
    assert image.color is not None
    return np.asarray((image.color > 0).any(axis=-1))


def colors_differ(
    answer: HogelImage, image: HogelImage, tolerance: Singles | float = COLOR_TOLERANCE
) -> Mask:
    """Return the pixels whose colors differ by more than a tolerance, or are not numbers."""
    assert answer.color is not None and image.color is not None
    # A comparison with NaN is False, so that NaN counts as a difference.
    return np.asarray(~(np.abs(answer.color - image.color) <= tolerance).all(axis=-1))


def as_stored(answer: HogelImage, image: HogelImage) -> HogelImage:
    """Return an image with colors clipped as in the file of another image."""
    if answer.color is None or not is_picture(image):
        return answer
    return replace(answer, color=np.minimum(answer.color, 1))


def as_gray(image: HogelImage) -> Floats:
    """Return the input of registration: brightness, or a gray per object and 0 for background."""
    if image.color is not None:
        return np.asarray(np.nan_to_num(image.color).mean(axis=-1), dtype=np.float64)
    count = int(image.object.max(initial=0)) + 1
    return np.asarray((image.object + 1) / count, dtype=np.float64)


def shown_points(scene: Scene, model: RendererModel, image: HogelImage) -> Floats:
    """Return the surface points (H, W, 3) that a decoded image shows, NaN without a surface.

    Positions stored in the image are returned unchanged. Without them, a point is the intersection
    of the pixel's line in the model with the triangle that the pixel names. If the line misses the
    triangle, it is the point of the triangle that is drawn nearest to the pixel's center; the
    displacement is then a lower bound.
    """
    if np.isfinite(image.position[..., :2]).any():
        return np.asarray(image.position, dtype=np.float64)
    upright = model.upright(image.triangle)
    aperture = model.answers(scene, image.camera.aperture)
    points = np.full((*upright.shape, 3), np.nan)
    rows, columns = np.nonzero((upright >= 0) & (upright < len(scene.faces)))
    corners = scene.triangles[upright[rows, columns]]
    best, off = np.full((len(rows), 3), np.nan), np.full(len(rows), np.inf)
    bundles = {side: model.bundle(scene, aperture, side) for side in (1, -1)}
    for side, bundle in bundles.items():
        directions, center = model.film.directions(bundle)[rows, columns], np.asarray(bundle.center)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = plane_places(corners, triangle_normals(corners), center, directions)
            met: Floats = center + s[:, None] * directions
        ahead = np.isfinite(met).all(axis=1) & (side * (met[:, 2] - model.plate_height) <= 0)
        distance = np.full(len(rows), np.inf)
        distance[ahead] = distance_to_triangles(met[ahead], corners[ahead])
        nearer = distance < off
        best[nearer], off[nearer] = met[nearer], distance[nearer]
    # In scene coordinates the reach is shorter by the scale of the model.
    reach = scene.frustum.longest_reach / model.scene_scale
    missed = np.flatnonzero(off > TRIANGLE_TOLERANCE_PER_REACH * reach)
    cells = np.stack((columns[missed], rows[missed]), axis=1).astype(np.float64)
    nearest, least = np.full((len(missed), 3), np.nan), np.full(len(missed), np.inf)
    for side, bundle in bundles.items():
        if model.film is not EVEN:
            # Convert the pixels to positions with the same lines on an even film.
            lines = model.film.directions(bundle)[rows[missed], columns[missed]]
            cells = pixel_places(np.asarray(bundle.center) + lines, bundle)
        for first in range(3):
            ends = corners[missed][:, [first, (first + 1) % 3]]
            with np.errstate(divide="ignore", invalid="ignore"):
                point, apart = _nearest_of_edge(
                    ends, bundle, side, cells, CAMERA_DISTANCE_PER_REACH * reach
                )
            nearer = apart < least
            nearest[nearer], least[nearer] = point[nearer], apart[nearer]
    best[missed] = nearest
    points[rows, columns] = best
    return np.asarray(model.orientation.applied(points))


def _nearest_of_edge(
    ends: Floats, bundle: RayBundle, side: int, cells: Floats, closest: float
) -> tuple[Floats, Floats]:
    """Return points (N, 3) of edges (N, 2, 3), each drawn nearest to a pixel, and distances, px."""
    center = np.asarray(bundle.center)
    ahead = side * (center[2] - ends[..., 2])
    # The part of the edge behind the camera is cut off.
    t = np.clip((closest - ahead[:, 0]) / (ahead[:, 1] - ahead[:, 0]), 0.0, 1.0)
    cut = ends[:, 0] + t[:, None] * (ends[:, 1] - ends[:, 0])
    kept = np.where((ahead < closest)[..., None], cut[:, None], ends)
    s = center[2] - kept[..., 2]
    drawn = pixel_places(kept, bundle)
    along = drawn[:, 1] - drawn[:, 0]
    part = np.einsum("ij,ij->i", cells - drawn[:, 0], along) / np.einsum("ij,ij->i", along, along)
    part = np.clip(np.nan_to_num(part), 0.0, 1.0)[:, None]
    # On the film 1/s is linear, and so are coordinates divided by s.
    weights = (1 - part) / s[:, :1], part / s[:, 1:]
    point = (weights[0] * kept[:, 0] + weights[1] * kept[:, 1]) / (weights[0] + weights[1])
    apart = np.linalg.norm(drawn[:, 0] + part * along - cells, axis=1)
    seen = (ahead >= closest).any(axis=1) & np.isfinite(apart)
    return point, np.where(seen, apart, np.inf)
