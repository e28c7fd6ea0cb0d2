"""Images that a guess about a renderer makes of a scene: traced and decided like the truth, and colored."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from xfrustum.compare.renderer_model.drawn_model import Culled, DrawnModel, Front, unflipped
from xfrustum.compare.renderer_model.orientations import UPRIGHT
from xfrustum.reference import Reference
from xfrustum.reference.averages import averages
from xfrustum.reference.certify.certify import first_surfaces
from xfrustum.reference.layers import Layer, overlaid
from xfrustum.reference.lines.facing import facing
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.shading.shading import Shader
from xfrustum.scenes.arrays import Floats, Mask, Singles
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.frustum import Frustum, Screen
from xfrustum.scenes.plate.plate import Aperture

COLOR_TOLERANCE = 2.3 / 255
"""Differences of linear radiance that two 8-bit pictures of one surface may have.

Half a step of 8 bits is 0.5/255 in linear values and, where sRGB is steepest (2.4/1.055 at white), 1.14/255;
once for the renderer's own rounding, once for storing.
"""

SCREEN_HEIGHT = -1.0
"""Height of the screen that stands for a film: one unit behind the plate, where slopes are lengths."""


def trace_drawn(reference: Reference, model: DrawnModel, aperture: Aperture) -> HogelImage:
    """Return the upright image that a guess predicts for an aperture of the scene, with no color."""
    layers = drawn_layers(reference.scene, model, aperture)
    return as_image(reference, aperture, overlaid(layers))


Layers = dict[tuple[Pencil, bool, Culled], Layer]
"""Layers that cameras showed, by their lines, whether the nearest surface won, and the faces left out."""


def drawn_layers(
    scene: Scene, model: DrawnModel, aperture: Aperture, known: Layers | None = None
) -> list[Layer]:
    """Return what the cameras of a guess show, in drawing order: what comes later covers.

    `known` keeps the layers of one aperture for other guesses about it.
    """
    known = {} if known is None else known

    def shown(side: int, *, nearest: bool = False) -> Layer:
        pencil = model.pencil(scene, aperture, side)
        key = (pencil, nearest, model.culled)
        if key not in known:
            known[key] = layer(scene, pencil, nearest=nearest, culled=model.culled)
        return known[key]

    if model.plain and model.one_pencil:
        return [shown(0)]
    layers = [] if model.back_missing else [shown(1)]
    if model.front is not Front.MISSING:
        layers.append(shown(-1, nearest=model.front is Front.NEAREST))
    return layers if model.overlaid else layers[::-1]


def layer(scene: Scene, pencil: Pencil, *, nearest: bool = False, culled: Culled = Culled.NONE) -> Layer:
    """Return what is first along a camera's lines; with `nearest`, what is last along those of a C*."""
    triangles, film = scene.triangles, unflipped(pencil)
    drawn = np.arange(len(triangles))
    if culled is not Culled.NONE:
        drawn = np.flatnonzero(facing(triangles, film) != _CULLED_SIGN[culled])
        triangles = triangles[drawn]
    if nearest:
        # Seen through a point mirror in its center, what was last along a line is first.
        low, high = film.s_range
        mirrored = 2 * np.asarray(film.center) - triangles
        decided = first_surfaces(mirrored, replace(film, s_range=(-high, -low)))
        decided = replace(decided, s=-decided.s)
    else:
        decided = first_surfaces(triangles, film)
    shown = Layer.of(film, decided.renumbered(drawn))
    return _mirrored(shown, pencil)


def _mirrored(shown: Layer, pencil: Pencil) -> Layer:
    """Return a layer with its pixels in the order of a film whose negative half-extents mirror it."""
    ways = tuple(slice(None, None, 1 if t > 0 else -1) for t in reversed(pencil.half_extent))
    if all(way.step == 1 for way in ways):
        return shown
    width, height = pencil.resolution
    row, column, number = shown.companions.T
    row, column = (
        (height - 1 - row if ways[0].step < 0 else row),
        (width - 1 - column if ways[1].step < 0 else column),
    )
    return replace(
        shown,
        triangle=shown.triangle[ways],
        certainty=shown.certainty[ways],
        companions=np.stack((row, column, number), axis=1),
        position=shown.position[ways],
    )


_CULLED_SIGN = {Culled.COUNTERCLOCKWISE: 1, Culled.CLOCKWISE: -1}
"""Value of `facing` of the triangles that are left out."""


def as_image(reference: Reference, aperture: Aperture, shown: Layer) -> HogelImage:
    """Return a layer as the image of an aperture."""
    objects = np.append(reference.scene.object_of_triangle, np.int32(NOTHING))
    return HogelImage(
        camera=reference.camera(aperture),
        triangle=shown.triangle,
        object=objects[shown.triangle],
        position=shown.position,
        certainty=shown.certainty,
    )


def colored(scene: Scene, model: DrawnModel, answer: HogelImage) -> HogelImage:
    """Return a prediction with the color of each pixel's own surface point; nothing is averaged.

    Each half is seen along the lines of its own camera. Where lights are not conjugated, C* shares them with
    C, and needs L* = -L.
    """
    right = _radiance(Shader(scene), scene, model, answer)
    if model.conjugated:
        return replace(answer, color=right)
    # C* turns normals to itself, away from the viewer. To reverse them all is to reverse the lights.
    lights = [
        replace(light, direction=(-light.direction[0], -light.direction[1], -light.direction[2]))
        for light in scene.appearance.lights
    ]
    other = replace(scene, appearance=replace(scene.appearance, lights=tuple(lights)))
    front = answer.height > model.plate_height
    wrong = _radiance(Shader(other), scene, model, answer)
    return replace(answer, color=np.where(front[..., None], wrong, right))


def _radiance(shader: Shader, scene: Scene, model: DrawnModel, answer: HogelImage) -> Singles:
    directions, of_c_star = (
        model.pencil(scene, answer.camera.aperture, side).directions() for side in (1, -1)
    )
    front = answer.height > model.plate_height
    directions[front] = of_c_star[front]
    position = answer.position.astype(np.float64)
    return shader.picture(answer.triangle, position, directions).astype(np.float32)


def reference_colors(reference: Reference, question: DrawnModel, answer: HogelImage) -> HogelImage:
    """Return the answer to a question with the reference's color.

    Where color is an average, near offsets bend nothing, and the viewer's half wins as it must.
    """
    aperture = answer.camera.aperture
    # Orientation and order turn pictures as wholes: nothing else may differ from the truth.
    if replace(question, orientation=UPRIGHT, order=UPRIGHT) == DrawnModel():
        return replace(answer, color=reference.trace(aperture).color)
    shared = replace(question, near=0.0).one_pencil
    if not (averages(reference.scene.sampling) and question.conjugated and shared):
        return colored(reference.scene, question, answer)
    return replace(answer, color=picture_of(reference, question, aperture).color)


def picture_of(
    reference: Reference, model: DrawnModel, aperture: Aperture, finer: int = 1, wider: float = 1.0
) -> HogelImage:
    """Return the reference's picture of an aperture under a model, without its near offset.

    Parameters
    ----------
    finer
        Number of pixels for each pixel, along each side.
    """
    scene = reference.scene
    pencil = replace(model, near=0.0).pencil(scene, aperture, 0)
    width, height = scene.frustum.resolution
    frustum = Frustum(
        resolution=(round(width * finer * wider), round(height * finer * wider)),
        reach=(-pencil.s_range[0], pencil.s_range[1]),
        screen=Screen(
            height=SCREEN_HEIGHT,
            center=(pencil.center[0] + pencil.shear[0], pencil.center[1] + pencil.shear[1]),
            size=(2 * wider * pencil.half_extent[0], 2 * wider * pencil.half_extent[1]),
        ),
    )
    there = replace(aperture, x=pencil.center[0], y=pencil.center[1])
    # The plate of the picture is z = 0: where the scene lies higher or lower, it is its objects that move.
    below = np.array([0.0, 0.0, pencil.center[2]])
    moved = tuple(replace(part, vertices=part.vertices - below) for part in scene.objects)
    objects = moved if below.any() else scene.objects
    return Reference(replace(scene, frustum=frustum, objects=objects)).trace(there)


def shows_something(image: HogelImage) -> Mask:
    """Return the pixels of a picture that are not black, where backgrounds are."""
    assert image.color is not None
    return np.asarray((image.color > 0).any(axis=-1))


def colors_differ(answer: HogelImage, image: HogelImage, tolerance: float = COLOR_TOLERANCE) -> Mask:
    """Return the pixels whose colors differ by more than a tolerance, or are not numbers."""
    assert answer.color is not None
    assert image.color is not None
    # What is not a number is within no tolerance.
    return np.asarray(~(np.abs(answer.color - image.color) <= tolerance).all(axis=-1))


def as_gray(image: HogelImage) -> Floats:
    """Return what registration looks at: brightness, or one gray for each object, 0 for nothing."""
    if image.color is not None:
        return np.asarray(np.nan_to_num(image.color).mean(axis=-1), dtype=np.float64)
    count = int(image.object.max(initial=0)) + 1
    return np.asarray((image.object + 1) / count, dtype=np.float64)
