"""Images that a model of a renderer makes of a scene, traced and decided like the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from xfrustum.compare.renderer_model.drawn_model import Culled, DrawnModel, Front
from xfrustum.reference import Reference
from xfrustum.reference.certify.certify import Certifier
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


def drawn_layers(scene: Scene, model: DrawnModel, aperture: Aperture) -> list[Layer]:
    """Return what the cameras of a guess show, in drawing order: what comes later covers."""
    if model.plain and model.one_pencil:
        return [layer(scene, model.pencil(scene, aperture, 0))]
    back = layer(scene, model.pencil(scene, aperture, 1), culled=model.culled)
    if model.front is Front.MISSING:
        return [back]
    nearest = model.front is Front.NEAREST
    front = layer(scene, model.pencil(scene, aperture, -1), nearest=nearest, culled=model.culled)
    return [back, front] if model.overlaid else [front, back]


def layer(scene: Scene, pencil: Pencil, *, nearest: bool = False, culled: Culled = Culled.NONE) -> Layer:
    """Return what is first along a camera's lines; with `nearest`, what is last along those of a C*."""
    rows, triangles = range(pencil.resolution[1]), scene.triangles
    drawn = np.arange(len(triangles))
    if culled is not Culled.NONE:
        drawn = np.flatnonzero(facing(triangles, pencil) != _CULLED_SIGN[culled])
        triangles = triangles[drawn]
    if nearest:
        # Seen through a point mirror in its center, what was last along a line is first.
        low, high = pencil.s_range
        mirrored = 2 * np.asarray(pencil.center) - triangles
        decided = Certifier(mirrored, replace(pencil, s_range=(-high, -low))).decide(rows)
        decided = replace(decided, s=-decided.s)
    else:
        decided = Certifier(triangles, pencil).decide(rows)
    return Layer.of(pencil, decided.renumbered(drawn), rows)


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
