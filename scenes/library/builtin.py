"""The built-in scenes, and scenes opened by name or by the path of a scene file.

Modules that make or read meshes are loaded when a scene is built.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import import_module
from math import radians
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from xfrustum.scenes import Frustum, Plate, Screen
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.arguments import InputError, one_of
from xfrustum.scenes.disk import regular_size

if TYPE_CHECKING:
    from xfrustum.scenes.appearance import Appearance
    from xfrustum.scenes.model.scene import Scene, SceneObject


_PLATE = Plate(size=(80.0, 60.0), hogels=(81, 61))
_REACH = (150.0, 150.0)
_CENTERED = Frustum(resolution=(512, 512), reach=_REACH, fov=(radians(60), radians(60)))
_SMALL = replace(_CENTERED, resolution=(256, 256))
# This screen is wider than high and off center on both axes: it reveals every swap of axes and
# every wrong sign.
_RECENTERED = Frustum(
    resolution=(512, 384),
    reach=_REACH,
    screen=Screen(height=120.0, center=(9.0, -6.0), size=(160.0, 120.0)),
)
# A screen behind the plate, around the car, and a plate so small that the car is visible from its
# corners.
_CAR_PLATE = Plate(size=(40.0, 30.0), hogels=(81, 61))
_CAR_RECENTERED = replace(
    _RECENTERED, screen=Screen(height=-60.0, center=(4.0, -8.0), size=(100.0, 80.0))
)

# A two-step hologram (paper, section 2): the plate is the master in the view zone, and its content
# is around the plane of the transfer. All apertures project the rectangle of the transfer.
_TRANSFER_HEIGHT, _CAR_MIDDLE = -150.0, -17.0
_TRANSFER = Frustum(
    resolution=(512, 384),
    reach=(50.0, 250.0),
    screen=Screen(height=_TRANSFER_HEIGHT, center=(-14.0, -11.0), size=(120.0, 90.0)),
)


def _made_by(module: str, function: str, *arguments: object, **named: object) -> Callable[[], Any]:
    """Return a callable that loads a module of `scenes` and calls one of its functions."""
    return lambda: getattr(import_module(f"xfrustum.scenes.{module}"), function)(
        *arguments, **named
    )


_GRAY = _made_by("appearance", "Appearance")


@dataclass(frozen=True)
class BuiltinScene:
    """Entry of the catalogue, with functions that make its objects and its appearance."""

    name: str
    triangles: int  #: number of triangles of all objects, to list scenes without building them
    purpose: str  #: description in one line; for a hard case, the reason why it is hard
    objects: Callable[[], tuple[SceneObject, ...]]
    plate: Plate = _PLATE
    frustum: Frustum = _CENTERED
    appearance: Callable[[], Appearance] = _GRAY
    sampling: Sampling = field(default_factory=Sampling)

    def build(self) -> Scene:
        """Return the scene; the same on every machine."""
        from xfrustum.scenes.model.scene import Scene  # noqa: PLC0415 - loads NumPy

        return Scene(
            name=self.name,
            units="mm",
            plate=self.plate,
            frustum=self.frustum,
            objects=self.objects(),
            source=self.name,
            appearance=self.appearance(),
            sampling=self.sampling,
        )


def _transferred_car() -> tuple[SceneObject, ...]:
    """Return the car around the transfer plane, completely behind the plate (the master)."""
    from xfrustum.scenes.library.objects import car  # noqa: PLC0415 - likewise
    from xfrustum.scenes.shapes import place, placement  # noqa: PLC0415 - loads NumPy

    behind = placement(1.0, (0.0, 0.0, 0.0), (0.0, 0.0, _TRANSFER_HEIGHT - _CAR_MIDDLE))
    return tuple(place(part, behind) for part in car())


_CAR, _ASYMMETRIC = _made_by("library.objects", "car"), _made_by("library.objects", "asymmetric")

_ENTRIES = (
    BuiltinScene("car", 41_896,
                 "a car body of about 42,000 triangles across the plate, as in the paper: "
                 "the main job",
                 _CAR),
    BuiltinScene("car-recentered", 41_896,
                 "the car on a fixed projection screen: every aperture shears its frustum",
                 _CAR, plate=_CAR_PLATE, frustum=_CAR_RECENTERED),
    BuiltinScene("car-transfer", 41_896,
                 "a master for transfer: the car behind the plate, the screen in the "
                 "transfer plane",
                 _transferred_car, frustum=_TRANSFER),
    BuiltinScene("asymmetric", 4_896,
                 "different parts on both sides of the plate: no flip or swap of axes goes unseen",
                 _ASYMMETRIC),
    BuiltinScene("asymmetric-recentered", 4_896,
                 "the same parts on an off-center screen: no sign of the shear goes unseen",
                 _ASYMMETRIC, frustum=_RECENTERED),
    BuiltinScene("sheets", 288,
                 "parallel sheets 1e-1 to 1e-6 of the reach apart, at graded heights: depth order",
                 _made_by("library.objects", "sheets", reach=_REACH[0])),
    BuiltinScene("crossing", 10_598,
                 "a wavy surface through the middle aperture itself: what happens where the "
                 "plate is cut",
                 _made_by("library.objects", "crossing")),
    BuiltinScene("large-triangles", 2_319,
                 "triangles far larger than the plate that cross it beside the aperture: clipping",
                 _made_by("library.objects", "large_triangles")),
    BuiltinScene("car-studio", 41_896,
                 "the car in paint, glass, rubber and metal, lit and reflecting: shading and "
                 "reflection",
                 _made_by("library.objects", "studio_car"),
                 appearance=_made_by("library.objects", "studio")),
    BuiltinScene("mirror-sphere", 72_960,
                 "pure mirrors on both sides of the plate, in asymmetric surroundings: reflection",
                 _made_by("library.objects", "mirror_spheres"),
                 appearance=_made_by("library.objects", "mirror")),
    BuiltinScene("grating", 464,
                 "bars finer and coarser than one aperture can show, over 16 sub-apertures: "
                 "band limiting",
                 _made_by("library.objects", "gratings", (80 / 81, 60 / 61)), frustum=_SMALL,
                 appearance=_made_by("library.objects", "plain"), sampling=Sampling(aperture=16)),
    BuiltinScene("empty", 0, "nothing at all: the true image of nothing is nothing", lambda: ()),
)  # fmt: skip

#: The built-in scenes by name, in the order of the catalogue.
SCENES = MappingProxyType({entry.name: entry for entry in _ENTRIES})


def names() -> list[str]:
    """Return the names of the built-in scenes."""
    return list(SCENES)


def listing() -> list[BuiltinScene]:
    """Return the entries of all built-in scenes."""
    return list(SCENES.values())


@cache
def build(name: str) -> Scene:
    """Return the built-in scene of a name in `SCENES`; each scene is made only once."""
    return SCENES[name].build()


# prefix of the names of hard cases: other names do not need the suite
HARD = "hard/"


def open_scene(text: str | os.PathLike[str]) -> Scene:
    """Open a scene file, or a built-in scene out of `names()` or `hard_cases.names()`.

    A text that ends in .toml, or a `Path`, is a path; a built-in name has precedence over a file of
    the same name. Raises InputError if the name is neither, or if the file is not a valid scene.
    """
    if not isinstance(text, os.PathLike):
        one_of(text, str, "a scene's name or path")
        if make := _builder(text):
            return make(text)
    regular_size(Path(text), "scene file")
    # Built-in scenes and unknown names do not need the readers of tables and meshes, which take a
    # second to load.
    from xfrustum.scenes.files.scene_file import read_scene  # noqa: PLC0415

    return read_scene(Path(text))


def check_scene(text: str) -> None:
    """Raise the InputErrors of `open_scene` that can be detected without reading a mesh."""
    if _builder(text) is None:
        regular_size(Path(text), "scene file")
        from xfrustum.scenes.files.scene_file import checked  # noqa: PLC0415 - loads pydantic

        checked(Path(text))


def _builder(text: str) -> Callable[[str], Scene] | None:
    """Return the function that builds a built-in scene; None for a path; else InputError."""
    if text in SCENES:
        return build
    is_path = text.endswith(".toml") or Path(text).exists()
    if is_path and not text.startswith(HARD):
        return None
    from xfrustum.scenes.library import hard_cases  # noqa: PLC0415 - loads NumPy

    if text in hard_cases.CASES:
        return hard_cases.build
    if is_path:
        return None
    nearest = difflib.get_close_matches(text, [*names(), *hard_cases.names()], n=1)
    meant = f" (did you mean {nearest[0]}?)" if nearest else ""
    raise InputError(
        f"no scene file and no built-in scene is called {text!r}{meant}; `xfrustum scenes` "
        "lists all"
    )
