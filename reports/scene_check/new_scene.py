"""`xfrustum new`: a scene file whose plate, reach and field of view fit a mesh."""

import json
import math
import os
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.compare.eye_loss import ARCMIN_PER_RADIAN
from xfrustum.compare.noticeable import ACUITY_ARCMIN, MILLIMETERS, length_in
from xfrustum.reports.common.outputs import write_files
from xfrustum.reports.common.templates_environment import plain_text
from xfrustum.reports.text import heights, length
from xfrustum.scenes import InputError
from xfrustum.scenes.arguments import choice
from xfrustum.scenes.disk import check_hogels
from xfrustum.scenes.meshes.mesh_file import load_mesh
from xfrustum.scenes.meshes.tessellation import load_patches
from xfrustum.scenes.model.scene import UnreadFeature
from xfrustum.scenes.model.visibility import PLATE_ROUNDING, box, in_plate
from xfrustum.scenes.shapes import place as placed
from xfrustum.scenes.shapes import placement

#: Full angle of both axes, and pixels along each side of a hogel image, as in the built-in scenes.
FOV_DEG, RESOLUTION = 60.0, 512

#: Number of apertures along the longer side of the plate, odd, so that one lies in the middle; and
#: smallest ratio of plate or reach to the size of the mesh.
HOGELS, ROOM = 61, 1.1

#: Relative tolerance of numbers of cells and of viewing distances, because quotients of lengths in
#: other units have a few roundings of doubles.
WHOLE = 1e-9

#: Mantissas of lengths in a new scene file, times a power of ten: rounded up by at most 4/3.
ROUND_STEPS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


class Place(StrEnum):
    """Placement of the object: its middle in the plate, or all of it behind or before the plate."""

    THROUGH = "through"
    BEHIND = "behind"
    BEFORE = "before"


class Up(StrEnum):
    """Axis of the mesh that points up: y as in glTF, or z as in Blender and most CAD programs."""

    Y = "y"
    Z = "z"

    @property
    def rotate_deg(self) -> tuple[float, float, float]:
        """Rotation of the axis to the scene's y, so that the mesh's -y side faces the viewer."""
        return (-90.0, 0.0, 0.0) if self is Up.Z else (0.0, 0.0, 0.0)


Length = (
    float | tuple[float, str | None]
)  #: a number of scene units, or a number and the name of its unit


@dataclass(frozen=True, kw_only=True)
class NewSceneOptions:
    """Options of a new scene; None selects a value that fits the mesh."""

    #: Name of the length unit. None selects `m` for glTF, whose unit is the meter, else `units`,
    #: because no other mesh file has a unit.
    units: str | None = None
    #: length of the mesh's longest side; by default the length in its file, or one that fits
    #: `plate`
    size: Length | None = None
    place: Place | str | None = None
    #: width and height of the plate
    plate: tuple[Length, Length] | None = None
    #: largest distance between apertures
    pitch: Length | None = None
    #: viewing distance at which hogels are not visible as cells; `pitch` overrides it
    viewer: Length | None = None
    up: Up | str = Up.Y
    #: whether to replace an existing file
    force: bool = False


@dataclass(frozen=True, kw_only=True)
class NewScene:
    """A scene file that was written."""

    path: Path
    #: lengths of the mesh's bounding box along x, y and z, in units of its file
    mesh: tuple[float, ...]
    scale: float
    translate: tuple[float, ...]
    #: lengths of the box in scene units
    size: tuple[float, ...]
    plate: tuple[float, float]
    hogels: tuple[int, int]
    reach: float
    units: str
    heights: tuple[float, float]
    rotate_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    #: warning of a changed placement, of triangles in the plate, or of visible cells, if any
    warning: str | None = None
    #: features of the mesh file that are not shown
    unread: tuple[UnreadFeature, ...] = ()

    @property
    def pitch(self) -> float:
        """Larger of the distances between apertures along x and along y, scene units."""
        return max(side / count for side, count in zip(self.plate, self.hogels, strict=True))

    @property
    def cells_within(self) -> float:
        """Distance from the plate at which a hogel spans one arc minute, scene units."""
        return self.pitch * ARCMIN_PER_RADIAN / ACUITY_ARCMIN

    @property
    def sentence(self) -> str:
        """Description of the written scene."""
        shown = " x ".join(length(side) for side in self.size)
        scaled = "" if self.scale == 1 else f", made {self.scale:.4g} times as large,"
        return (
            f"{self.path}: the mesh{scaled} is {shown} {self.units}, "
            f"{heights(*self.heights, self.units)}; plate of {length(self.plate[0])} x "
            f"{length(self.plate[1])} {self.units} with {self.hogels[0]} x {self.hogels[1]} "
            "apertures, reach "
            f"{length(self.reach)} {self.units} on both sides; from nearer than "
            f"{length(self.cells_within)} "
            f"{self.units} its hogels are seen as cells"
        )


def new_scene(
    mesh: Path | str,
    out: Path | str | None = None,
    options: NewSceneOptions | None = None,
    **fields: Any,
) -> NewScene:
    """Write a scene file whose plate, reach and field of view fit a mesh.

    Fields of `NewSceneOptions` may be given by name. By default a mesh is centered in the plate. A
    flat mesh would lie in the plate, where displacement is undefined, and is placed behind it.

    Raises InputError if the mesh cannot be read or has no size, a length is not positive or has an
    unknown unit, the pitch is larger than the plate, or the file exists or cannot be written.
    """
    mesh, request = Path(mesh), replace(options or NewSceneOptions(), **fields)
    place = None if request.place is None else choice(Place, request.place, "place")
    request = replace(request, place=place, up=choice(Up, request.up, "up"))
    out = Path(f"{mesh.stem}.toml") if out is None else Path(out)
    if out.exists() and not request.force:
        raise InputError(
            f"{out}: exists already; give --out another name, or --force to replace it"
        )
    if request.units is not None and not (request.units and request.units.isprintable()):
        # The name is also in a comment of the scene file, which a line feed would end.
        raise InputError(f"units must be printable text on one line, not {request.units!r}")
    named = request.units or ("m" if mesh.suffix.lower() in (".gltf", ".glb") else "units")

    def own(name: str, stated: Length | None) -> float | None:
        """Return a length in scene units."""
        if stated is None:
            return None
        stated = stated if isinstance(stated, tuple) else (stated, None)
        if stated[1] in MILLIMETERS and named not in MILLIMETERS:
            raise InputError(
                f"{name} {stated[0]:g}{stated[1]}: nothing says how long one of the mesh's "
                f"{named} is; "
                f"say it (--units mm), or give --{name} without a unit"
            )
        value = length_in(stated, named, str(mesh))
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"{name} {value} must be a positive length")
        return value

    sides = [own("plate", side) for side in request.plate or ()]
    display = _Display(
        plate=tuple(side for side in sides if side is not None),
        pitch=own("pitch", request.pitch),
        viewer=own("viewer", request.viewer),
    )
    written = _fitted(mesh, out, replace(request, units=named), display, own("size", request.size))
    relative = Path(os.path.relpath(mesh.absolute(), out.absolute().parent)).as_posix()
    values = {
        "new": written,
        "name": mesh.stem,
        "mesh": relative,
        "resolution": RESOLUTION,
        "fov_deg": FOV_DEG,
    }
    text = plain_text(
        "scene.toml.j2", values, {"quoted": _quoted, "length": length, "heights": heights}
    )
    write_files(out.parent, {out.name: text})
    return written


@dataclass(frozen=True, kw_only=True)
class _Display:
    """Requested plate, pitch and viewer distance, scene units; an empty plate fits the mesh."""

    plate: tuple[float, ...]
    pitch: float | None
    viewer: float | None

    def fit(self, width: float, height: float) -> tuple[tuple[float, float], tuple[int, int]]:
        """Return the plate's size for a mesh of this size, and its columns and rows of hogels."""
        size = self.plate or tuple(_round_up(ROOM * side) for side in (width, height))
        pitch = self.pitch
        if pitch is None and self.viewer is not None:
            pitch = self.viewer * ACUITY_ARCMIN / ARCMIN_PER_RADIAN
        if pitch is None:
            columns, rows = (
                max(1, 2 * round((side * HOGELS / max(size) - 1) / 2) + 1) for side in size
            )
        else:
            if self.pitch is not None and pitch > min(size):
                raise InputError(
                    f"a pitch of {length(pitch)} is larger than the plate, {length(min(size))}"
                )
            # Round a quotient down if it exceeds a whole number only by rounding.
            columns, rows = (math.ceil(side / pitch * (1 - WHOLE)) for side in size)
            if self.pitch is not None and not self.plate:
                size = tuple(float(f"{count * pitch:.12g}") for count in (columns, rows))
        check_hogels(columns, rows)
        return (size[0], size[1]), (columns, rows)

    def warning(self, written: NewScene) -> str | None:
        """Return a warning of visible cells or of surfaces behind the viewer, if any."""
        units, top = written.units, written.heights[1]
        if self.viewer is not None and top >= self.viewer:
            return (
                f"the mesh ends {length(top)} {units} before the plate, behind a viewer at "
                f"{length(self.viewer)} {units}; give a smaller --size, or --behind"
            )
        # A stated plate is a real display: its cells must be invisible from the viewing distance
        # or, without a viewing distance, from any distance.
        seen = bool(self.plate) and self.pitch is None
        if self.viewer is not None:
            seen = self.viewer < written.cells_within * (1 - WHOLE)
        within, pitch = length(written.cells_within), length(written.pitch)
        where = f"from nearer than {within} {units} hogels of {pitch} {units} are seen as cells"
        return f"{where}; give a smaller --pitch, or --viewer without --pitch" if seen else None


def _fitted(
    mesh: Path, out: Path, request: NewSceneOptions, display: _Display, size: float | None
) -> NewScene:
    """Return a scene that fits the bounding box of a mesh."""
    part = load_patches(mesh) if mesh.suffix.lower() == ".bpt" else load_mesh(mesh)
    turn, in_file = Up(request.up).rotate_deg, box(part)
    part = placed(part, placement(1.0, turn)) if any(turn) else part
    low, high = np.array(box(part))
    with np.errstate(over="ignore"):  # lengths that overflow are refused
        own, lengths = high - low, np.ptp(in_file, axis=0).tolist()
    if not max(own[:2]) > 0:
        line = "in one point, or on one line through the plate"
        raise InputError(f"{mesh}: all vertices lie {line}; a scene cannot be fitted to it")
    scale = 1.0
    if size is not None:
        scale = size / float(max(own))
    elif display.plate:
        pairs = zip(display.plate, own[:2], strict=True)
        scale = min(side / (ROOM * mine) for side, mine in pairs if mine > 0)
    scale = float(f"{scale:.6g}")
    if not (0 < scale < math.inf and max(own) < math.inf):
        reason = "so small or large that no scale fits it; scale the mesh itself"
        raise InputError(f"{mesh}: is {max(own):.3g} long, {reason}")
    width, height, depth = (own * scale).tolist()
    flat = depth <= PLATE_ROUNDING * max(width, height)
    place = Place(request.place or (Place.BEHIND if flat else Place.THROUGH))
    # From this distance on, the middle aperture shows the whole nearest side of the object.
    gap = _round_up(ROOM * max(width, height) / 2 / math.tan(math.radians(FOV_DEG) / 2))
    side = {Place.THROUGH: 0, Place.BEHIND: -1, Place.BEFORE: 1}[place]
    # Round to six digits of the longest side, without a negative zero.
    longest = max(width, height, depth)
    decimals = 5 - math.floor(math.log10(longest))
    exact = np.array([0.0, 0.0, side * (gap + depth / 2)]) - scale * (low + high) / 2
    x, y, z = (round(shift, decimals) + 0.0 for shift in exact.tolist())
    bottom, top = float(scale * low[2] + z), float(scale * high[2] + z)
    plate, hogels = display.fit(max(width, longest / 4), max(height, longest / 4))
    written = NewScene(
        path=out,
        mesh=tuple(lengths),
        scale=scale,
        translate=(x, y, z),
        size=(width, height, depth),
        plate=plate,
        hogels=hogels,
        reach=_round_up(ROOM * max(-bottom, top, longest / 2)),
        units=request.units or "units",
        heights=(bottom, top),
        rotate_deg=turn,
        unread=part.unread,
    )
    if flat and request.place is None:
        warning: str | None = (
            "the mesh is flat, and is placed behind the plate: in the plate, displacement is "
            "undefined and no plan holds (--before places it on the viewer's side)"
        )
    elif count := in_plate(replace(part, vertices=scale * part.vertices + [x, y, z])):
        warning = (
            f"{count:,} triangles lie in the plate, within rounding: displacement is undefined "
            "there, and no plan holds for apertures that show them; give --behind or --before, or "
            "another translate"
        )
    else:
        warning = display.warning(written)
    return replace(written, warning=warning)


def _round_up(value: float) -> float:
    power = math.floor(math.log10(value))
    # Convert from text, as a reader of the file does: 1.2 times 10^-3 is not the double 0.0012.
    steps = (float(f"{step:g}e{power}") for step in ROUND_STEPS)
    return next((step for step in steps if step >= value), float(f"1e{power + 1}"))


def _quoted(text: str) -> str:
    """Return a TOML string."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
