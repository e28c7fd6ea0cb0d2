"""The image of an aperture, made of decisions along its lines: points, normals, objects, light."""

from __future__ import annotations

import numpy as np

from xfrustum.reference.certify.certify import FirstSurfaces
from xfrustum.reference.lines.lines import Pencil, crossed_frustum
from xfrustum.reference.shading.shading import Hits, Shader
from xfrustum.scenes.model.hogel_image import NOTHING, HogelCamera, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


class Pictures:
    """Makes images of a scene out of decisions.

    Parameters
    ----------
    scene
        Scene that is seen.
    shader
        Shader of its surfaces.
    """

    def __init__(self, scene: Scene, shader: Shader) -> None:
        self._scene, self._shader = scene, shader
        # Indexed by triangle number: `NOTHING`, which is -1, finds the last entry, `NOTHING`.
        self._object_of_number = np.append(scene.object_of_triangle, np.int32(NOTHING))

    def camera(self, aperture: Aperture, settings: DoubleFrustum | None = None) -> HogelCamera:
        """Return the true frustum of an aperture; with settings, as the offset cameras' image has it."""
        pencil = crossed_frustum(self._scene.frustum, aperture)
        return HogelCamera(
            aperture=aperture,
            resolution=pencil.resolution,
            shear=pencil.shear,
            half_extent=pencil.half_extent,
            reach=self._scene.frustum.reach,
            scene=self._scene.source,
            scene_hash=self._scene.content_hash,
            renderer="reference" if settings is None else "reference, offset cameras",
            settings=settings,
        )

    def image(
        self,
        aperture: Aperture,
        rows: range,
        layers: list[tuple[Pencil, FirstSurfaces]],
        settings: DoubleFrustum | None = None,
    ) -> HogelImage:
        """Return the image of some rows: layers of decisions, the last on top, with all that it shows.

        Parameters
        ----------
        aperture
            Aperture of the image.
        rows
            Rows that were decided.
        layers
            The lines of each layer and the decisions along them, from the back.
        settings
            Settings of the offset cameras; None for a true image.
        """
        pencil = crossed_frustum(self._scene.frustum, aperture)
        some = slice(rows.start, rows.stop)
        directions = pencil.directions(some)
        triangle = np.full(directions.shape[:2], NOTHING, dtype=np.int32)
        certainty = np.zeros(directions.shape[:2], dtype=np.uint8)
        position, seen_along = np.full(directions.shape, np.nan), directions
        companions = np.zeros((0, 3), dtype=np.int64)
        for layer, decided in layers:
            on_top = decided.triangle != NOTHING
            # Where this layer shows nothing, the pixel depends on its decision and on those below.
            certainty = np.where(on_top, decided.certainty, np.maximum(certainty, decided.certainty))
            triangle = np.where(on_top, decided.triangle, triangle)
            along = layer.directions(some)
            points = np.asarray(layer.center) + decided.s[..., None] * along
            position = np.where(on_top[..., None], points, position)
            # A camera that is fitted to some height sees along lines of its own directions.
            if layer.half_extent != pencil.half_extent:
                seen_along = np.where(on_top[..., None], along, seen_along)
            # Ties on surfaces that this layer covers no longer show.
            covered_now = on_top[companions[:, 0] - rows.start, companions[:, 1]]
            companions = np.concatenate((companions[~covered_now], decided.companions))
        normals, color = np.full(directions.shape, np.nan), np.zeros(directions.shape, dtype=np.float32)
        covered = np.flatnonzero(triangle != NOTHING)
        shown = triangle.ravel()[covered]
        normal = self._scene.normals[shown]
        normals.reshape(-1, 3)[covered] = normal
        position_shown, direction_shown = (v.reshape(-1, 3)[covered] for v in (position, seen_along))
        hits = Hits(triangle=shown, normal=normal, position=position_shown, direction=direction_shown)
        color.reshape(-1, 3)[covered] = self._shader.radiance(hits)
        return HogelImage(
            camera=self.camera(aperture, settings),
            triangle=triangle,
            object=self._object_of_number[triangle],
            position=position,
            normal=normals,
            color=color,
            certainty=certainty,
            companions=companions,
        )
