"""All layouts, and the ones that bear a name."""

from __future__ import annotations

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.layouts.cameras import PLENO, STANFORD, VIEWS, NumberedCameras
from xfrustum.scenes.files.layouts.hogel_files import (
    BURNETT,
    BURNETT_VIEWS,
    HOCKING,
    HOGELS,
    HogelColumns,
    RowVideos,
)
from xfrustum.scenes.files.layouts.layout import Layout
from xfrustum.scenes.files.layouts.tiles import CubeVi, Mosaic, Quilt

LAYOUTS: tuple[Layout, ...] = (
    HOCKING,
    BURNETT,
    RowVideos(),
    HogelColumns(),
    STANFORD,
    NumberedCameras(),
    PLENO,
    VIEWS,
    Quilt(),
    CubeVi(),
    BURNETT_VIEWS,
    HOGELS,
    Mosaic(),
)
"""All layouts. Of two that names of files fit equally well, the one that is listed first is more likely."""

NAMES = (
    "hogels",
    "burnett",
    "hocking",
    "hocking-columns",
    "mosaic",
    "views",
    "stanford",
    "pleno",
    "hci",
    "quilt",
    "cubevi",
)
"""Names of layouts, as the command line takes them."""


def layouts_named(name: str) -> tuple[Layout, ...]:
    """Return the layouts of a name: files of T. Burnett's program are pictures or videos.

    Raises
    ------
    InputError
        No layout has this name.
    """
    if name not in NAMES:
        raise InputError(f"layout {name!r} is not one of {', '.join(NAMES)}")
    return tuple(layout for layout in LAYOUTS if layout.name == name)


def layout_for(name: str, suffix: str | None) -> Layout:
    """Return the layout of a name in which files with some suffix are written."""
    named = layouts_named(name)
    return next((layout for layout in named if layout.suffix == suffix), named[0])
