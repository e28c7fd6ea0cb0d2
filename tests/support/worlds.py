"""Small scenes with truths and rasters that are made once per session and shared by tests.

Images are read-only: a test that changes an image copies its arrays (`dataclasses.replace`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from tests.support.scene_file import film, named, part
from tests.support.views import reversed_d32f, view
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import Aperture, DoubleFrustum, HogelImage, Plate, Scene, open_scene
from xfrustum.scenes.files.exr import write_image

HOGELS = (5, 4)
"""Columns and rows of the plates: every symmetry that exchanges hogels becomes visible."""

TINY = (
    named("tiny", "mm")
    + film((40.0, 30.0), HOGELS, (32, 24), (60.0, 50.0), (100.0, 100.0))
    + part("torus", 30.0, (12.0, 2.0, -4.0), rotate_deg=[10.0, 55.0, 0.0])
    + part("box", 20.0, (-6.0, 8.0, -40.0), rotate_deg=[25.0, 40.0, 10.0])
    + part("sphere", 14.0, (3.0, 6.0, 30.0))
)
"""A scene file without symmetry: a torus across the plate, a box behind it, a sphere before it."""


class World:
    """A scene with its truths and rasters, which are made when first needed and then kept."""

    def __init__(self, scene: Scene, folder: Path | None = None) -> None:
        self.scene = scene
        self.near = 0.01 * scene.frustum.longest_reach  #: scene units: displaces by some pixels
        self._folder = folder
        self._truths: dict[Aperture, HogelImage] = {}
        self._rasters: dict[tuple[Aperture, DoubleFrustum], HogelImage] = {}

    @cached_property
    def reference(self) -> Reference:
        """The ground truth of the scene."""
        return Reference(self.scene)

    @cached_property
    def rasterizer(self) -> Rasterizer:
        """The rasterizer of the scene; its context exists until the process ends."""
        return Rasterizer(self.scene)

    @property
    def settings(self) -> DoubleFrustum:
        """The usual settings: `near`, and a depth buffer with negligible errors."""
        return reversed_d32f(self.near)

    def aperture(self, index: tuple[int, int] | None = None) -> Aperture:
        """Return an aperture by column and row, by default the middle one."""
        return self.scene.plate.middle if index is None else self.scene.plate.aperture(*index)

    def truth(self, index: tuple[int, int] | None = None) -> HogelImage:
        """Return the true image of an aperture, with color."""
        aperture = self.aperture(index)
        if aperture not in self._truths:
            self._truths[aperture] = _read_only(self.reference.trace(aperture))
        return self._truths[aperture]

    def raster(
        self, settings: DoubleFrustum | None = None, index: tuple[int, int] | None = None
    ) -> HogelImage:
        """Return the raster image of an aperture, with normals and color."""
        key = (self.aperture(index), self.settings if settings is None else settings)
        if key not in self._rasters:
            self._rasters[key] = _read_only(self.rasterizer.render(*key))
        return self._rasters[key]

    @property
    def scene_file(self) -> Path:
        """The scene file for commands; only `tiny` has one."""
        return Path(self.scene.source)

    @cached_property
    def truth_file(self) -> Path:
        """The true image of the middle aperture as OpenEXR."""
        return self._written(self.truth(), "truth.exr")

    @cached_property
    def raster_file(self) -> Path:
        """The raster image of the middle aperture with `settings` as OpenEXR."""
        return self._written(self.raster(), "raster.exr")

    def _written(self, image: HogelImage, name: str) -> Path:
        assert self._folder is not None, "images of this world have no files"
        path = self._folder / name
        write_image(path, image)
        return path


@cache
def world(
    name: str, resolution: tuple[int, int] = (64, 48), hogels: tuple[int, int] = HOGELS
) -> World:
    """Return a built-in scene at a resolution, with its plate divided into hogels; made once."""
    scene = view(name, resolution)
    return World(replace(scene, plate=Plate(size=scene.plate.size, hogels=hogels)))


def tiny_world(folder: Path) -> World:
    """Return the scene of `TINY` with its file, and its images in a folder."""
    path = folder / "tiny.toml"
    path.write_text(TINY)
    return World(open_scene(path), folder)


def _read_only(image: HogelImage) -> HogelImage:
    for values in vars(image).values():
        if isinstance(values, np.ndarray):
            values.flags.writeable = False
    return image
