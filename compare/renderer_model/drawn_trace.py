"""Images that a model of a renderer makes of a scene, traced and decided like the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from xfrustum.compare.renderer_model.drawn_model import Culled, DrawnModel, Front, unflipped
from xfrustum.reference import Reference
from xfrustum.reference.certify.certify import first_surfaces
from xfrustum.reference.layers import Layer, overlaid
from xfrustum.reference.lines.facing import facing
from xfrustum.reference.lines.lines import Pencil
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture


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
    shown = Layer.of(film, decided.renumbered(drawn), range(pencil.resolution[1]))
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
