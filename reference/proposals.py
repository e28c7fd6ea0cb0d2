"""Image of an uncertified ray tracer: the second opinion on every pixel."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from xfrustum.reference.backend import constants, dr, interleaved, product, recording
from xfrustum.reference.certify.certify import FirstSurfaces
from xfrustum.reference.lines import RayBundle, plane_places, triangle_normals
from xfrustum.reference.pictures import pixel_directions
from xfrustum.reference.tracers import Tracer
from xfrustum.scenes.arrays import Bytes, Floats, Mask, Numbers
from xfrustum.scenes.model.images import NOTHING, Certainty
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.representation import ShortRepr

#: Pixels of a second opinion traced at once, which bounds memory: some 200 bytes each
OPINION_PIXELS = 1 << 18

#: Distance of rays' origins from the scene's box, relative to its diagonal; far above rounding
CLEARANCE = 2.0**-6


def pixel_rays(scene: Scene, bundle: RayBundle, rows: range) -> tuple[Floats, Floats]:
    """Return origins and directions d of the lines of some rows' pixels, (N, 3) each.

    An origin lies at the first s, or a little before the line enters the scene's bounding box if
    that is later: the lines of a steep frustum come from far outside, and a distant origin loses
    digits in float32.
    """
    size = len(rows) * bundle.resolution[0]
    low, high = scene.bounds
    clearance = CLEARANCE * float(np.linalg.norm(high - low))
    with recording():
        directions = pixel_directions(bundle, rows)
        center, (first,) = constants(bundle.center), constants(bundle.s_range[:1])
        lows, highs = constants((low - clearance).tolist()), constants((high + clearance).tolist())
        front: Any = center[2] - highs[2]
        s = front
        for axis in range(2):
            along = directions[axis]
            side = dr.select(along > 0.0, lows[axis], highs[axis]) - center[axis]
            # A line parallel to these two sides of the box lies between them everywhere or nowhere:
            # they do not bound s.
            bounded = along != 0.0
            s = dr.maximum(s, dr.select(bounded, side / dr.select(bounded, along, 1.0), -np.inf))
        # A line that misses the box meets nothing from any origin.
        s = dr.maximum(dr.select(dr.isfinite(s), s, front), first)
        origins = [
            at + product(s, direction) for at, direction in zip(center, directions, strict=True)
        ]
        dr.eval(origins)
        return interleaved(origins, (size, 3)), interleaved(directions, (size, 3))


def proposed(tracer: Tracer, scene: Scene, bundle: RayBundle, rows: range) -> Numbers:
    """Trace each pixel's line of some rows once, from the viewer's end to the back.

    Triangle numbers (rows, W) are `NOTHING` if there is no hit or the first hit is beyond the
    reach.
    """
    shape = len(rows), bundle.resolution[0]
    if not len(scene.faces):
        return np.full(shape, NOTHING, dtype=np.int32)
    origins, directions = pixel_rays(scene, bundle, rows)
    hits = tracer.first_hits(origins, directions)
    # The tracer has no far limit: places on the triangles' planes detect hits beyond the reach.
    met = hits != NOTHING
    beyond = _first_places(scene, bundle, hits[met], directions[met]) > bundle.s_range[1]
    hits[met] = np.where(beyond, NOTHING, hits[met])
    return hits.reshape(shape)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SecondOpinion(ShortRepr):
    """Pixels at which a tracer contradicts decisions of some rows, traced when called.

    Triangle numbers and `Certainty` (rows, W) are the decisions.
    """

    tracer: Callable[[], Tracer]
    scene: Scene
    bundle: RayBundle
    rows: range
    triangle: Numbers
    certainty: Bytes

    def __call__(self) -> Mask:
        """Return the pixels (rows, W) without a tie at which the tracer shows another triangle."""
        overruled = np.empty(self.triangle.shape, dtype=np.bool_)
        size = max(1, OPINION_PIXELS // self.bundle.resolution[0])
        for start in range(0, len(self.rows), size):
            part = slice(start, start + size)
            number = proposed(self.tracer(), self.scene, self.bundle, self.rows[part])
            overruled[part] = (number != self.triangle[part]) & (
                self.certainty[part] != Certainty.TIE
            )
        return overruled


def uncertified(tracer: Tracer, scene: Scene, bundle: RayBundle, rows: range) -> FirstSurfaces:
    """Return a tracer's proposal as a decision, with places on the planes of the triangles."""
    triangle = proposed(tracer, scene, bundle, rows)
    directions = bundle.directions(slice(rows.start, rows.stop))
    s = np.full(triangle.shape, np.nan)
    met = triangle != NOTHING
    s[met] = _first_places(scene, bundle, triangle[met], directions[met])
    return FirstSurfaces(
        triangle=triangle,
        s=s,
        certainty=np.full(triangle.shape, Certainty.UNEXAMINED, dtype=np.uint8),
        tied_triangles=np.zeros((0, 3), dtype=np.int64),
    )


def _first_places(scene: Scene, bundle: RayBundle, triangle: Numbers, directions: Floats) -> Floats:
    """Return s at which lines (N, 3) of a ray bundle meet the planes of triangles (N,)."""
    corners = scene.triangles[triangle]
    return plane_places(corners, triangle_normals(corners), np.asarray(bundle.center), directions)
