"""The scene that a viewer sees where cameras step back by a near offset: a theorem and its closed form.

docs/method.md, "What the near offset looks like to a viewer", has the proof. All lines on which hogels replay
one drawn surface point P cross in one point P', which lies at the distance D from the plate:

    D = (|z| + n) zf / (zf + n),   without a fit D = |z| + n,   beyond the first slab D = |z|.

Behind the plate P' = P + m (kx, ky, -1), before it P' = P - m (kx, ky, -1), with D - |z| along z. Where P' is
the same for all apertures, what is replayed is the true picture of a moved scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from xfrustum.reference.lines.lines import film_window
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.double_frustum import DoubleFrustum, Offset, Pivot
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture


def replayed_distance(distance: Floats, frustum: Frustum, settings: DoubleFrustum) -> Floats:
    """Return D, the distance from the plate at which a viewer sees surface points.

    Parameters
    ----------
    distance
        |z| of the points, scene units, of any shape. A point at the first cut counts to the first slab.
    frustum, settings
        Crossed frustum, and settings of the cameras that draw it.
    """
    distance = np.asarray(distance, dtype=np.float64)
    if settings.offset is Offset.NONE:
        return distance
    moved = distance + settings.near
    fitted = settings.fitted_height(frustum)
    if fitted is not None:
        moved = moved * (fitted / (fitted + settings.near))
    first = settings.slabs[0] if settings.slabs else np.inf
    return np.where(distance <= first, moved, distance)


def replayed_points(
    points: Floats, frustum: Frustum, aperture: Aperture, settings: DoubleFrustum, side: int
) -> Floats:
    """Return P', on the lines on which an aperture replays drawn points, at the distance at which they cross.

    Parameters
    ----------
    points
        (N, 3) surface points, scene units, all on one side of the plate or in it.
    frustum, aperture, settings
        Crossed frustum, aperture, and settings of the cameras that draw it.
    side
        1 for points that C draws, behind the plate; -1 for those that C* draws.

    Returns
    -------
    (N, 3) points, scene units. Where they do not depend on the aperture, a viewer sees them there.
    """
    shear, _ = film_window(frustum, aperture)
    distance = -side * points[:, 2]
    seen = replayed_distance(distance, frustum, settings)
    along = seen - distance
    if settings.pivot is Pivot.CAMERA and settings.offset is Offset.PLATE:
        # The shear about the camera's own center draws points of the first slab a further k n aside.
        first = settings.slabs[0] if settings.slabs else np.inf
        along = np.where(distance <= first, along - settings.near, along)
    moved = points.copy()
    for axis in range(2):
        moved[:, axis] += side * shear[axis] * along
    moved[:, 2] = -side * seen
    return moved


@dataclass(frozen=True, kw_only=True, eq=False)
class MovedScene:
    """The scene that a viewer sees.

    Attributes
    ----------
    scene
        The moved halves, with the moved reach. Its surfaces have their objects' materials, and neither
        textures nor normals of vertices: it is meant for comparing surfaces.
    number
        (F,) number that each of its triangles has in the scene as it is.
    """

    scene: Scene
    number: Indices


def moves_rigidly(frustum: Frustum, settings: DoubleFrustum) -> bool:
    """Return whether the point at which a surface point is replayed is the same for all apertures."""
    straight = settings.pivot is Pivot.CAMERA and settings.fitted_height(frustum) is None
    return not frustum.recentered or straight or settings.offset is Offset.NONE


def moved_scene(scene: Scene, settings: DoubleFrustum) -> MovedScene:
    """Return the scene whose true pictures are those that the cameras of some settings draw.

    Triangles are cut at the plate and at the first cut, and their parts are moved along z.

    Raises
    ------
    InputError
        Every aperture replays another scene: the frustum is recentered, and its shear displaces points.
    """
    settings.check_against(scene.frustum)
    if not moves_rigidly(scene.frustum, settings):
        raise InputError(
            f"{scene.name}: with a recentered frustum every aperture replays another scene; "
            "pivot camera without a fit replays one"
        )
    if settings.offset is Offset.NONE:
        raise InputError("without an offset nothing is moved; the scene is replayed as it is but for a gap")
    cuts = (0.0, *(sign * height for height in settings.slabs[:1] for sign in (1, -1)))
    objects, numbers = [], []
    for number, part in enumerate(scene.objects):
        own = np.flatnonzero(scene.object_of_triangle == number)
        triangles, origin = scene.triangles[own], own
        for height in cuts:
            triangles, origin = _cut(triangles, origin, height)
        moved, origin = _moved(triangles, origin, scene.frustum, settings)
        numbers.append(origin)
        objects.append(
            SceneObject(
                name=part.name,
                vertices=moved.reshape(-1, 3),
                faces=np.arange(3 * len(moved)).reshape(-1, 3),
                material=part.material,
            )
        )
    reach = replayed_distance(np.array(scene.frustum.reach), scene.frustum, settings).tolist()
    frustum = replace(scene.frustum, reach=(reach[0], reach[1]))
    changed = replace(scene, frustum=frustum, objects=tuple(objects))
    return MovedScene(scene=changed, number=np.concatenate([np.zeros(0, dtype=np.int64), *numbers]))


def _moved(
    triangles: Floats, origin: Indices, frustum: Frustum, settings: DoubleFrustum
) -> tuple[Floats, Indices]:
    """Return triangles that no cut crosses moved along z; those in the plate are moved both ways."""
    first = settings.slabs[0] if settings.slabs else np.inf
    behind, before = (np.asarray((sign * triangles[..., 2] >= 0).all(axis=1)) for sign in (-1, 1))
    halves = []
    for side, here in ((-1.0, behind), (1.0, before)):
        half = triangles[here].copy()
        distance = np.abs(half[..., 2])
        # A triangle that ends at the first cut from beyond is not of the first slab.
        inner: Mask = distance.max(axis=1, initial=0.0) <= first
        seen = replayed_distance(distance, frustum, settings)
        half[..., 2] = side * np.where(inner[:, None], seen, distance)
        halves.append(half)
    return np.concatenate(halves), np.concatenate((origin[behind], origin[before]))


def _cut(triangles: Floats, origin: Indices, height: float) -> tuple[Floats, Indices]:
    """Return triangles cut in three by a height, so that none crosses it, with the numbers they came from."""
    above = triangles[..., 2] - height
    crossing: Mask = (above.max(axis=1, initial=0.0) > 0) & (above.min(axis=1, initial=0.0) < 0)
    if not crossing.any():
        return triangles, origin
    cut, upper = triangles[crossing], above[crossing] > 0
    # Turn each triangle until its first corner is alone on its side of the cut.
    alone = np.where(upper.sum(axis=1) == 1, upper.argmax(axis=1), (~upper).argmax(axis=1))
    order = (alone[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(cut, order[:, :, None], axis=1), 1, 0)
    ends = []
    for end in (b, c):
        share = (height - a[:, 2]) / (end[:, 2] - a[:, 2])
        point = a + share[:, None] * (end - a)
        point[:, 2] = height
        ends.append(point)
    ab, ac = ends
    parts = [np.stack(corners, axis=1) for corners in ((a, ab, ac), (ab, b, c), (ab, c, ac))]
    own = origin[crossing]
    return np.concatenate((triangles[~crossing], *parts)), np.concatenate((origin[~crossing], own, own, own))
