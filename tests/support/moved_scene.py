"""The scene as offset cameras show it (`compare.noticeable`): moved points, moved scenes."""

from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.noticeable import moves_rigidly, replayed_distance, replayed_shifts
from xfrustum.reference.lines import film_window
from xfrustum.scenes import Aperture, DoubleFrustum, Frustum, Offset, Scene, SceneObject
from xfrustum.scenes.arrays import Floats, Indices, Mask


def replayed_points(
    points: Floats, frustum: Frustum, aperture: Aperture, settings: DoubleFrustum, side: int
) -> Floats:
    """Return P', the places at which an aperture replays drawn points.

    The points (N, 3), scene units, are all on one side of the plate or in it: `side` is 1 behind
    the plate, where C draws, and -1 before it. Where P' does not depend on the aperture, a viewer
    sees the points there.
    """
    shear, _ = film_window(frustum, aperture)
    distance = -side * points[:, 2]
    _, aside = replayed_shifts(distance, frustum, settings)
    moved = points.copy()
    moved[:, :2] += side * aside[:, None] * shear
    moved[:, 2] = -side * replayed_distance(distance, frustum, settings)
    return moved


@dataclass(frozen=True, kw_only=True, eq=False)
class MovedScene:
    """The scene as a viewer sees it: the moved halves, with the moved reach.

    The scene serves to compare surfaces: it has the objects' materials, but neither textures nor
    vertex normals.
    """

    scene: Scene
    number: Indices  # (F,) original number of each triangle


def moved_scene(scene: Scene, settings: DoubleFrustum) -> MovedScene:
    """Return the scene whose true pictures equal the pictures drawn with some settings.

    Triangles are cut at the plate and at the first cut, and their parts are moved along z.

    Where a recentered frustum's shear displaces points, every aperture replays another scene.
    """
    assert moves_rigidly(scene.frustum, settings) and settings.offset is Offset.PLATE
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
    return MovedScene(scene=changed, number=np.concatenate(numbers))


def _moved(
    triangles: Floats, origin: Indices, frustum: Frustum, settings: DoubleFrustum
) -> tuple[Floats, Indices]:
    """Return triangles that no cut crosses, moved along z; in the plate, moved both ways."""
    first = settings.slabs[0] if settings.slabs else np.inf
    behind, before = (np.asarray((sign * triangles[..., 2] >= 0).all(axis=1)) for sign in (-1, 1))
    halves = []
    for side, here in ((-1.0, behind), (1.0, before)):
        half = triangles[here].copy()
        distance = np.abs(half[..., 2])
        # A triangle beyond the first cut that touches it is not in the first slab.
        inner: Mask = distance.max(axis=1, initial=0.0) <= first
        seen = replayed_distance(distance, frustum, settings)
        half[..., 2] = side * np.where(inner[:, None], seen, distance)
        halves.append(half)
    return np.concatenate(halves), np.concatenate((origin[behind], origin[before]))


def _cut(triangles: Floats, origin: Indices, height: float) -> tuple[Floats, Indices]:
    """Return triangles split in three at a height, and the original number of each part."""
    above = triangles[..., 2] - height
    crossing: Mask = (above.max(axis=1, initial=0.0) > 0) & (above.min(axis=1, initial=0.0) < 0)
    if not crossing.any():
        return triangles, origin
    cut, upper = triangles[crossing], above[crossing] > 0
    # Rotate each triangle's corners so that the first is alone on its side of the cut.
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
    return np.concatenate((triangles[~crossing], *parts)), np.concatenate(
        (origin[~crossing], own, own, own)
    )
