"""Plates that are drawn, in layouts of files: beside their Zarr groups, or instead of them."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from xfrustum.reports.common.outputs import check_writable_folder
from xfrustum.reports.exchange.convert import (
    ONE_PICTURE,
    ZARR,
    ZARR_SUFFIX,
    Conversion,
    ConversionOptions,
    convert,
)
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.layouts import PICTURE_SUFFIXES, Naming, PlateShape, layouts_named
from xfrustum.scenes.model.plate_content import Channel, PlateContent
from xfrustum.scenes.model.scene import Scene

DRAWING_SUFFIX = ".drawing.zarr"
"""Ending of the name of a group that is kept only until the files are written. A run that was stopped goes on
with it."""


@dataclass(frozen=True, kw_only=True)
class LaidOutPlate:
    """The places of a plate that is drawn into a Zarr group and written in a layout.

    Attributes
    ----------
    out
        Place that was asked for: NAME.zarr for a group, with the files beside it in NAME-LAYOUT; any other
        name for the files alone.
    layout
        Name of the layout.
    """

    out: Path
    layout: str

    @property
    def keeps_group(self) -> bool:
        """Whether the group stays when the files are written."""
        return self.out.suffix.lower() == ZARR_SUFFIX

    @property
    def group(self) -> Path:
        """The group that the plate is drawn into."""
        return self.out if self.keeps_group else self.out.with_name(self.out.name + DRAWING_SUFFIX)

    @property
    def files(self) -> Path:
        """The folder of the files, or the one picture."""
        return self.out.with_name(f"{self.out.stem}-{self.layout}") if self.keeps_group else self.out

    def check(self, scene: Scene, content: PlateContent, *, judged: bool) -> None:
        """Raise InputError where the files could not be written, or would lose what was asked for.

        Parameters
        ----------
        scene
            Scene of the plate.
        content
            Images that are stored.
        judged
            Whether measures are stored beside them.
        """
        if not {Channel.COLOR, Channel.TRIANGLE} & {*content.channels}:
            raise InputError(
                "--layout writes colors or triangle numbers: ask for color or triangle among --channels"
            )
        if not self.keeps_group and (judged or len(content.channels) > 1):
            raise InputError(
                f"--out {self.out}: files in a layout hold one image of each hogel, and no measures; "
                f"let the name end in {ZARR_SUFFIX}, and the Zarr group with all of them stays"
            )
        shape = PlateShape(hogels=scene.plate.hogels, resolution=scene.frustum.resolution)
        for layout in layouts_named(self.layout):
            # A layout that has no place for such a plate says so here.
            layout.stem(next(layout.indices(shape)), shape, Naming())
        single = self.layout in ONE_PICTURE and self.files.suffix.lower() in PICTURE_SUFFIXES
        check_writable_folder(self.files.absolute().parent if single else self.files)

    def write(self, scene: Scene) -> Conversion:
        """Write the files of a plate that is drawn, and remove the group unless it is to be kept.

        Raises
        ------
        InputError
            The files cannot be written.
        """
        width, height = scene.plate.size
        options = ConversionOptions(aspect=width / height)
        done = convert(self.group, self.files, ZARR, self.layout, options)
        if not self.keeps_group:
            shutil.rmtree(self.group)
        return done
