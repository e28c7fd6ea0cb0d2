"""Surface: which pixels show the wrong one? (design, section 4)

Independent of how finely a mesh is tessellated, hence the headline. A picture merely displaced
is not a wrong surface.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.film import shows_point_on_film
from xfrustum.compare.rounding import position_tolerance
from xfrustum.reference import Reference, SurfacePoints
from xfrustum.scenes.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.scene import Scene


def shown_objects(truth: HogelImage, raster: HogelImage, scene: Scene) -> NDArray[np.int32]:
    """Return the object that each raster pixel shows; where that is not said, the truth's."""
    by_triangle = np.append(scene.object_of_triangle, np.int32(NOTHING))[raster.triangle]
    named = np.where(raster.object != NOTHING, raster.object, by_triangle)
    return np.where(named != NOTHING, named, truth.object)


def wrong_surface(truth: HogelImage, raster: HogelImage, reference: Reference) -> NDArray[np.bool_]:
    """Return the pixels that show the wrong surface, (H, W).

    Wrong is hit against miss, another object, or a surface point that the true frustum does not
    see: something else is in front of it on its own true line. A point in the plate is seen by
    the true frustum only through the aperture, where every line meets it.
    """
    objects = shown_objects(truth, raster, reference.scene)
    wrong: NDArray[np.bool_] = truth.covered != raster.covered
    wrong |= (truth.object != objects) & truth.covered
    at_plate = raster.covered & (raster.height == 0)
    wrong |= at_plate & ~(truth.covered & (truth.height == 0))

    asked = shows_point_on_film(raster) & ~wrong
    position, number = raster.position[asked].astype(np.float64), raster.triangle[asked]
    tolerance = position_tolerance(reference.scene, number, position)
    points = SurfacePoints(position=position, triangle=number, tolerance=tolerance)
    wrong[asked] = reference.hidden(truth.camera.aperture, points)
    return wrong
