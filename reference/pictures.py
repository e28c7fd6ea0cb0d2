"""The image of an aperture, made of decisions along its lines: points, normals, objects, light."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from xfrustum.reference.certify.certify import FirstSurfaces
from xfrustum.reference.certify.processors import compiled
from xfrustum.reference.layers import Layer, overlaid, overlaid_certainty
from xfrustum.reference.lines.lines import Pencil, crossed_frustum
from xfrustum.reference.shading.shading import Hits, Shader
from xfrustum.scenes.arrays import Floats, Singles
from xfrustum.scenes.model.hogel_image import NOTHING, HogelCamera, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

if TYPE_CHECKING:
    from xfrustum.reference.pictures_jit import JitPictures


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

    @cached_property
    def _compiled(self) -> JitPictures | None:
        """The compiled maker of images; None where nothing can be compiled or seen."""
        if not compiled() or not len(self._scene.faces):
            return None
        # Imported only here, because Dr.Jit's arrays need the LLVM that `compiled` has chosen.
        made: JitPictures = import_module("xfrustum.reference.pictures_jit").JitPictures(
            self._scene, self._shader
        )
        return made

    def true_image(
        self, aperture: Aperture, rows: range, pencil: Pencil, found: FirstSurfaces, *, colored: bool = True
    ) -> HogelImage:
        """Return what is first along the lines of the true frustum in some rows, with color or without."""
        if self._compiled is None:
            image = self.image(aperture, rows, [(pencil, found)])
            return image if colored else replace(image, color=None)
        shown = self._compiled.shown(pencil, rows, found, colored=colored)
        return HogelImage(
            camera=self.camera(aperture),
            triangle=found.triangle,
            object=shown.object,
            position=shown.position,
            normal=shown.normal,
            color=shown.color,
            certainty=found.certainty,
            companions=found.companions,
        )

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
        decided: list[tuple[Pencil, FirstSurfaces]],
        settings: DoubleFrustum | None = None,
        *,
        shaded: bool = True,
    ) -> HogelImage:
        """Return what decided layers of some rows show, the last on top, with normals, objects and light.

        Parameters
        ----------
        aperture
            Aperture whose image it is.
        rows
            Rows of the image.
        decided
            Lines of each camera, and what is first along them.
        settings
            Settings of the offset cameras; None for the true frustum.
        shaded
            Whether the image has normals and color.
        """
        if not shaded and self._compiled is not None:
            return self._unshaded(self._compiled, self.camera(aperture, settings), rows, decided)
        pencil = crossed_frustum(self._scene.frustum, aperture)
        directions = pencil.directions(slice(rows.start, rows.stop))
        layers = []
        for lines, found in decided:
            # What a camera fitted to some height shows, it sees along lines of its own.
            own = None if lines.half_extent != pencil.half_extent else directions
            layers.append(Layer.of(lines, found, rows, own))
        shown = overlaid(layers)
        normal, color = self._shaded(shown) if shaded else (None, None)
        return HogelImage(
            camera=self.camera(aperture, settings),
            triangle=shown.triangle,
            object=self._object_of_number[shown.triangle],
            position=shown.position,
            normal=normal,
            color=color,
            certainty=shown.certainty,
            companions=shown.companions,
        )

    def _unshaded(
        self,
        made_by: JitPictures,
        camera: HogelCamera,
        rows: range,
        decided: list[tuple[Pencil, FirstSurfaces]],
    ) -> HogelImage:
        """Return what `image` returns without normals and color, with points made by a kernel."""
        found = [surfaces for _, surfaces in decided]
        triangle, objects, position = made_by.points(decided, rows)
        certainty, companions = overlaid_certainty(found, rows)
        return HogelImage(
            camera=camera,
            triangle=triangle,
            object=objects,
            position=position,
            certainty=certainty,
            companions=companions,
        )

    def _shaded(self, shown: Layer) -> tuple[Floats, Singles]:
        """Return the normals and the color (H, W, 3) of what a layer shows."""
        normals = np.full(shown.position.shape, np.nan)
        color = np.zeros(shown.position.shape, dtype=np.float32)
        covered = np.flatnonzero(shown.triangle != NOTHING)
        number = shown.triangle.ravel()[covered]
        normal = self._scene.normals[number]
        normals.reshape(-1, 3)[covered] = normal
        position, direction = (v.reshape(-1, 3)[covered] for v in (shown.position, shown.directions))
        hits = Hits(triangle=number, normal=normal, position=position, direction=direction)
        color.reshape(-1, 3)[covered] = self._shader.radiance(hits)
        return normals, color
