"""`xfrustum new`: a scene file whose plate, reach and field of view fit a mesh."""

import json
import math
import os
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from xfrustum.compare.extent import PLATE_ROUNDING, box, heights, in_plate, length
from xfrustum.reports.common.outputs import Staging
from xfrustum.scenes.arguments import choice
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.meshes import load_mesh
from xfrustum.scenes.geometry.tessellation import load_patches

FOV_DEG, RESOLUTION = 60.0, 512
"""Full angle of both axes, and pixels along each side of a hogel image, as in the built-in scenes."""

HOGELS, ROOM = 61, 1.1
"""Apertures along the longer side of the plate: odd, so that the middle one is in the middle; and how much
larger plate and reach are at least than what they must hold."""

ROUND_STEPS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Lengths in a new scene file are one of these times a power of ten: never over 4/3 of what is needed."""


class Place(StrEnum):
    """Where the object is put: its middle in the plate, or all of it behind or before the plate."""

    THROUGH = "through"
    BEHIND = "behind"
    BEFORE = "before"


@dataclass(frozen=True, kw_only=True)
class NewScene:
    """A scene file that was written."""

    path: Path
    mesh: tuple[float, ...]  #: lengths of the mesh's box along x, y and z, as its file has it
    scale: float
    translate: tuple[float, ...]
    size: tuple[float, ...]  #: lengths of the box in scene units
    plate: tuple[float, float]
    hogels: tuple[int, int]
    reach: float
    units: str
    heights: tuple[float, float]
    #: What was placed otherwise, or cannot be drawn where it was asked for; None where nothing was.
    warning: str | None = None

    @property
    def sentence(self) -> str:
        """What was written, in words."""
        shown = " x ".join(length(side) for side in self.size)
        return (
            f"{self.path}: the mesh is {shown} {self.units}, {heights(*self.heights, self.units)}; plate of "
            f"{length(self.plate[0])} x {length(self.plate[1])} {self.units} with {self.hogels[0]} x "
            f"{self.hogels[1]} apertures, reach {length(self.reach)} {self.units} on both sides"
        )


def new_scene(
    mesh: Path | str,
    out: Path | str | None = None,
    *,
    units: str | None = None,
    size: float | None = None,
    place: Place | str | None = None,
    force: bool = False,
) -> NewScene:
    """Write a scene file whose plate, reach and field of view fit a mesh.

    `units` names the length unit: by default `m` for glTF, whose unit is the meter, and else `units`, for
    no other mesh file says which one it has. The longest side is scaled to `size`, scene units, and keeps
    its own where None. Where no place is given, a mesh is put through the plate, or behind it where it is
    flat and would lie in the plate, where displacement is undefined. `force` replaces an existing file.

    Raises
    ------
    InputError
        The mesh cannot be read or has no size, the size is not positive, the file exists already or cannot
        be written.
    """
    mesh = Path(mesh)
    asked = None if place is None else choice(Place, place, "place")
    out = Path(f"{mesh.stem}.toml") if out is None else Path(out)
    if out.exists() and not force:
        raise InputError(f"{out}: exists already; give --out another name, or --force to replace it")
    if size is not None and not (math.isfinite(size) and size > 0):
        raise InputError(f"size {size} must be a positive length")
    if units == "":
        raise InputError("units must be a text that is not empty")
    named = units or ("m" if mesh.suffix.lower() in (".gltf", ".glb") else "units")
    written = _fitted(mesh, out, named, size, asked)
    with Staging(out.parent, (out.name,)) as staging:
        (staging.folder / out.name).write_text(_text(written, mesh), encoding="utf-8")
        staging.commit()
    return written


def _fitted(mesh: Path, out: Path, units: str, size: float | None, asked: Place | None) -> NewScene:
    """Choose everything from the box about a mesh."""
    part = load_patches(mesh) if mesh.suffix.lower() == ".bpt" else load_mesh(mesh)
    low, high = box(part)
    own = tuple(b - a for a, b in zip(low, high, strict=True))
    if not max(own) > 0:
        raise InputError(f"{mesh}: all vertices lie in one point; a scene cannot be fitted to it")
    scale = 1.0 if size is None else float(f"{size / max(own):.6g}")
    width, height, depth = (side * scale for side in own)
    flat = depth <= PLATE_ROUNDING * max(width, height)
    place = asked or (Place.BEHIND if flat else Place.THROUGH)
    # A flat object behind or before the plate keeps the distance of its longest side.
    longest = max(width, height, depth)
    # From there on the middle aperture, of a plate no larger than the object, sees all of its nearest side.
    gap = _round_up(ROOM * max(width, height) / 2 / math.tan(math.radians(FOV_DEG) / 2))
    middle = {Place.THROUGH: 0.0, Place.BEHIND: -(gap + depth / 2), Place.BEFORE: gap + depth / 2}[place]
    # Six digits of the longest side, and no negative zero.
    decimals = 5 - math.floor(math.log10(longest))
    x, y, z = (
        round(to - scale * (a + b) / 2, decimals) + 0.0
        for to, a, b in zip((0.0, 0.0, middle), low, high, strict=True)
    )
    bottom, top = scale * low[2] + z, scale * high[2] + z
    plate = _round_up(ROOM * max(width, longest / 4)), _round_up(ROOM * max(height, longest / 4))
    columns, rows = (max(1, 2 * round((side * HOGELS / max(plate) - 1) / 2) + 1) for side in plate)
    warning = None
    if flat and asked is None:
        warning = (
            "the mesh is flat, and is placed behind the plate: in the plate, displacement is undefined and "
            "no plan holds (--before places it on the viewer's side)"
        )
    elif count := in_plate(replace(part, vertices=scale * part.vertices + [x, y, z])):
        warning = (
            f"{count:,} triangles lie in the plate, within rounding: displacement is undefined there, and "
            "no plan holds for apertures that show them; give --behind or --before, or another translate"
        )
    return NewScene(
        path=out,
        mesh=own,
        scale=scale,
        translate=(x, y, z),
        size=(width, height, depth),
        plate=plate,
        hogels=(columns, rows),
        reach=_round_up(ROOM * max(-bottom, top, longest / 2)),
        units=units,
        heights=(bottom, top),
        warning=warning,
    )


def _round_up(value: float) -> float:
    """Return the next round length."""
    power = math.floor(math.log10(value))
    # Through text, which is what the file holds: 1.2 times 10 to the -3 is not the double 0.0012.
    steps = (float(f"{step:g}e{power}") for step in ROUND_STEPS)
    return next((step for step in steps if step >= value), float(f"1e{power + 1}"))


def _text(new: NewScene, mesh: Path) -> str:
    """Return the scene file."""

    def quoted(text: str) -> str:  # a string of TOML
        return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")

    relative = Path(os.path.relpath(mesh.absolute(), new.path.absolute().parent)).as_posix()
    shown = " x ".join(length(side) for side in new.mesh)
    vector = ", ".join(repr(value) for value in new.translate)
    return f"""\
# Written by `xfrustum new`; `xfrustum check` draws where everything lies. All keys: CONVENTIONS.md.
name = {quoted(mesh.stem)}
units = {quoted(new.units)}  # a name; all lengths here are in this unit

[plate]  # in z = 0, about the origin; +z points to the viewer
size = [{new.plate[0]!r}, {new.plate[1]!r}]  # width, height
hogels = [{new.hogels[0]}, {new.hogels[1]}]  # columns, rows of apertures

[frustum]
resolution = [{RESOLUTION}, {RESOLUTION}]  # pixels of the image of one aperture
fov_deg = [{FOV_DEG!r}, {FOV_DEG!r}]  # full angles
reach = [{new.reach!r}, {new.reach!r}]  # how far surfaces are shown: toward the viewer, behind the plate

[[object]]
mesh = {quoted(relative)}  # relative to this file
scale = {new.scale!r}  # the mesh itself is {shown}
translate = [{vector}]  # then it lies {heights(*new.heights, new.units)}
# rotate_deg = [0.0, 0.0, 0.0]  # about x, then y, then z; after scale and before translate
# smooth = true  # normals for a mesh that has none
"""
