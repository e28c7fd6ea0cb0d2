"""Where the hogels that an eye is shown come from: drawn now, a stored plate, or anybody's files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from xfrustum.compare.eye.collected import DEFAULT_COLOR, DrawnHogel, drawn_hogels
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference import Reference
from xfrustum.reports.plate import store
from xfrustum.reports.plate.store import COLOR, DAMAGE, TRIANGLE
from xfrustum.reports.verification.sources import Files, Problem
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.foreign_images import Encoding
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.look import look_hash
from xfrustum.scenes.model.plate_content import FilmPart, PlateContent
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

Index = tuple[int, int]
"""Column and row of a hogel."""


class Source(Protocol):
    """Hogels of a scene, by any renderer.

    Attributes
    ----------
    name
        The renderer, or where its hogels lie, for people.
    settings
        Settings of the cameras that drew them; None where they are not known.
    """

    name: str
    settings: DoubleFrustum | None

    def hogels(self, parts: Mapping[Index, FilmPart]) -> Iterator[DrawnHogel]:
        """Yield hogels in order; only pixels in the part of each film that is asked for mean anything."""
        ...


class Drawing:
    """Hogels that are drawn when they are asked for, with one sample a pixel.

    Parameters
    ----------
    scene, settings
        Scene that is drawn, and settings of its cameras.
    effects
        Effects that are simulated; None for those that the scene calls for.

    Raises
    ------
    InputError
        The settings do not fit the scene.
    """

    def __init__(
        self, scene: Scene, settings: DoubleFrustum, effects: frozenset[Effect] | None = None
    ) -> None:
        settings.check_against(scene.frustum)
        self.settings: DoubleFrustum | None = settings
        self.name = f"near {settings.near:g} {scene.units}, {settings.depth_label}"
        self._scene, self._how = scene, settings
        self._content = PlateContent(color=DEFAULT_COLOR, ids=True, effects=effects)

    def hogels(self, parts: Mapping[Index, FilmPart]) -> Iterator[DrawnHogel]:
        """Draw the hogels."""
        scene = replace(self._scene, sampling=Sampling())
        with PlateRenderer(scene, self._how, self._content) as renderer:
            yield from drawn_hogels(renderer, parts)


class StoredPlate:
    """A plate that `xfrustum plate` has drawn.

    Parameters
    ----------
    path
        Folder of the Zarr group.
    scene
        Scene that it must have been drawn from.

    Raises
    ------
    InputError
        There is no such plate, or it was drawn from another scene.
    """

    def __init__(self, path: Path, scene: Scene) -> None:
        self.name = path.name
        try:
            plate = store.StoredPlate(path)
        except InputError as error:
            raise InputError(f"--plate {error}") from error
        of_scene, given = plate.description.get("scene"), plate.description.get("settings")
        if not isinstance(of_scene, dict):
            raise InputError(f"--plate {path}: its description is damaged; draw the plate again")
        if (of_scene.get("hash"), of_scene.get("look")) != (scene.content_hash, look_hash(scene)):
            raise InputError(
                f"--plate {path}: was drawn from another scene; draw it again with xfrustum plate"
            )
        names = {field.name for field in fields(DoubleFrustum)}
        self.settings: DoubleFrustum | None = None
        if isinstance(given, dict):
            settings = {name: value for name, value in given.items() if name in names}
            self.settings = DoubleFrustum(**settings)
        self._path, self._scene, self._plate = path, scene, plate
        self._arrays = {name: plate.arrays[name] for name in (TRIANGLE, COLOR) if name in plate.arrays}
        width, height = scene.frustum.resolution
        expected = (*scene.plate.hogels[::-1], height, width)
        if COLOR not in self._arrays or any(a.shape[:4] != expected for a in self._arrays.values()):
            raise InputError(f"--plate {path}: its arrays are damaged; draw the plate again")

    def hogels(self, parts: Mapping[Index, FilmPart]) -> Iterator[DrawnHogel]:
        """Read the hogels.

        Raises
        ------
        InputError
            Some have not been drawn, or cannot be read.
        """
        missing = [i for i in parts if not self._plate.finished(self._scene.plate.aperture(*i))]
        if missing:
            first = missing[0]
            raise InputError(
                f"--plate {self._path}: {len(missing)} of {len(parts)} hogels that the eyes are shown are "
                f"not there, such as {first[0]},{first[1]}; draw them with xfrustum plate"
            )
        for column, row in parts:
            try:
                arrays = {name: np.asarray(array[row, column]) for name, array in self._arrays.items()}
            except DAMAGE as error:
                raise InputError(
                    f"--plate {self._path}: hogel {column},{row} is damaged; xfrustum plate --check mends it"
                ) from error
            yield DrawnHogel(index=(column, row), color=arrays[COLOR], triangle=arrays.get(TRIANGLE))


@dataclass(kw_only=True)
class Images:
    """Image files by any renderer, as `verify` reads them.

    Attributes
    ----------
    pattern
        Pattern of the files' names: {i} is the column, {j} the row.
    scene
        Scene that they show.
    encoding
        Meaning of pictures' pixels; OpenEXR files say it themselves.
    """

    pattern: str
    scene: Scene
    encoding: Encoding = Encoding.RGB

    def __post_init__(self) -> None:
        self.name = self.pattern
        self.settings: DoubleFrustum | None = None
        self._files = Files(
            pattern=self.pattern, reference=Reference(self.scene), encoding=Encoding(self.encoding)
        )

    def hogels(self, parts: Mapping[Index, FilmPart]) -> Iterator[DrawnHogel]:
        """Read the files.

        Raises
        ------
        InputError
            One is missing or cannot be read.
        """
        apertures = [self.scene.plate.aperture(*index) for index in parts]
        self._files.check(apertures)
        for aperture in apertures:
            try:
                image = self._files.image(aperture)
            except Problem as error:
                raise InputError(str(error)) from error
            beyond = image.triangle.max(initial=-1) >= len(self.scene.faces)
            if beyond:
                raise InputError(
                    f"{self._files.path(aperture)}: names a triangle that the scene does not have; "
                    "`xfrustum verify` says how its numbers were stored"
                )
            named = _names_surfaces(image)
            yield DrawnHogel(
                index=aperture.index,
                color=image.color,
                triangle=image.triangle if named else None,
                object=image.object if named else None,
                position=image.position,
            )


def _names_surfaces(image: HogelImage) -> bool:
    """Return whether an image says which surfaces it shows, as `verify` tells it: colors alone do not."""
    return image.color is None or bool(((image.triangle != NOTHING) | (image.object != NOTHING)).any())
