"""`xfrustum check`: what lies where in a scene, which apertures see it, and what looks like a mistake."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.compare.extent import (
    ObjectExtent,
    Visibility,
    extents,
    heights,
    length,
    plate_warnings,
    unseen_facts,
    warnings,
)
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.scene_check.drawing import View, draw_view
from xfrustum.scenes.model.scene import NormalsMade, Scene, SceneObject
from xfrustum.scenes.notebook import Figure, Shown, Table, counted, digits

FILES = tuple(f"{view.value}.svg" for view in View)


@dataclass(frozen=True, kw_only=True)
class ObjectCheck:
    """One object, as it is known before it is drawn.

    Attributes
    ----------
    normals, colors, textures
        What its vertices and triangles have to be shaded with, and where that comes from, in words.
    """

    extent: ObjectExtent
    normals: str
    colors: str
    textures: str


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SceneCheck(Shown):
    """A scene, as it is known before it is drawn.

    Attributes
    ----------
    seen
        Whether any aperture of the plate can show anything; true of a scene without objects.
    """

    scene: Scene
    objects: tuple[ObjectCheck, ...]
    warnings: tuple[str, ...]
    seen: bool

    def view(self, view: View | str) -> str:
        """Return the `side` or the `top` view as an SVG document."""
        return draw_view(self.scene, View(view))

    def _said(self) -> str:
        seen = "apertures see it" if self.seen else "no aperture sees anything"
        told = counted(len(self.warnings), "warning")
        return f"{self.scene.name!r}, {counted(len(self.objects), 'object')}, {seen}; {told}"

    def _tables(self) -> Sequence[Table]:
        units = self.scene.units
        rows = [
            (
                Path(one.extent.name).name,
                f"{one.extent.triangles:,}",
                " x ".join(map(digits, one.extent.size)),
                f"{digits(one.extent.low[2])} to {digits(one.extent.high[2])}",
                f"{one.extent.sight.apertures:,}",
            )
            for one in self.objects
        ]
        head = ("object", "triangles", f"size, {units}", f"heights, {units}", "apertures that see it")
        return (Table(head=head, rows=rows), Table(rows=[("warning", line) for line in self.warnings]))

    def _figures(self) -> Sequence[Figure]:
        return [Figure(caption=view.value, content=self.view(view).encode()) for view in View]

    def summary(self) -> dict[str, Any]:
        """Return everything but the pictures, as `check --json` prints it."""
        objects = [
            vars(one.extent) | {"size": one.extent.size, **{name: getattr(one, name) for name in _WORDS}}
            for one in self.objects
        ]
        scene = self.scene
        found = {
            "scene": scene.name,
            "units": scene.units,
            "plate": scene.plate,
            "reach": scene.frustum.reach,
        }
        told = {"objects": objects, "warnings": self.warnings, "seen": self.seen}
        ready: dict[str, Any] = json_ready(found | told)
        return ready


_WORDS = ("normals", "colors", "textures")
"""Fields of `ObjectCheck` in words."""


def check(scene: Scene) -> SceneCheck:
    """Say where each object of a scene lies, which apertures may see it, and what looks like a mistake.

    Nothing is drawn or traced: an object behind another one counts as seen.
    """
    found = extents(scene)
    unseen = unseen_facts(scene, scene.plate.apertures())
    told = list(scene.warnings)
    if unseen is not None:
        told.append(unseen)
    else:
        told += [*warnings(scene), *plate_warnings(scene)]
        told += [
            f"object {one.number} ({Path(one.name).name}) is outside the frusta of all apertures"
            for one in found
            if one.sight.apertures == 0
        ]
    return SceneCheck(
        scene=scene,
        objects=tuple(
            ObjectCheck(extent=extent, normals=_normals(part), colors=_colors(part), textures=_textures(part))
            for extent, part in zip(found, scene.objects, strict=True)
        ),
        warnings=tuple(dict.fromkeys(told)),
        seen=unseen is None,
    )


def write_check(checked: SceneCheck, out: Path) -> tuple[Path, ...]:
    """Write side.svg and top.svg into a folder, both or none.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    with Staging(out, FILES) as staging:
        for view, name in zip(View, FILES, strict=True):
            (staging.folder / name).write_text(checked.view(view), encoding="utf-8")
        return staging.commit()


def table(checked: SceneCheck) -> str:
    """Return a check as lines for people."""
    scene = checked.scene
    (toward, back), units = scene.frustum.reach, scene.units
    plate = f"plate of {length(scene.plate.size[0])} x {length(scene.plate.size[1])} {units}, "
    plate += f"{scene.plate.hogels[0]} x {scene.plate.hogels[1]} apertures"
    lines = [
        f"{scene.name}: {plate}; reach {length(toward)} {units} before and {length(back)} {units} behind it"
    ]
    if not checked.objects:
        lines.append("no objects: the true image of nothing is nothing")
    for one in checked.objects:
        extent = one.extent
        lines += ["", f"object {extent.number}: {extent.name}"]
        share = extent.share_in_reach
        rows = (
            ("triangles", f"{extent.triangles:,}"),
            ("size", " x ".join(length(side) for side in extent.size) + f" {units}"),
            ("height", heights(extent.low[2], extent.high[2], units)),
            ("in the reach", "no area" if share is None else f"{100 * share:.4g} % of its surface"),
            ("seen by", _seen_by(extent.sight)),
            ("normals", one.normals),
            ("colors", one.colors),
            ("textures", one.textures),
        )
        lines += [f"  {name:<12}  {value}" for name, value in rows]
    return "\n".join(lines)


def _seen_by(found: Visibility) -> str:
    """Say which apertures see an object."""
    if found.columns is None or found.rows is None:
        return f"none of {found.of:,} apertures"
    if found.apertures == found.of:
        return f"all {found.of:,} apertures"
    (left, right), (top, bottom) = found.columns, found.rows
    middle = "the middle one too" if found.middle else "not the middle one"
    return (
        f"{found.apertures:,} of {found.of:,} apertures, columns {left} to {right}, rows {top} to {bottom}; "
        f"{middle}, {sum(found.corners)} of 4 corners"
    )


def _normals(part: SceneObject) -> str:
    """Say which vertices have normals to shade with, and who made them."""
    found = part.vertex_normals
    usable = 0 if found is None else int(np.isfinite(found).all(axis=1).sum())
    if usable == 0:
        return "none: every triangle is flat"
    who = {
        NormalsMade.NONE: "of the mesh",
        NormalsMade.SOME: "of the mesh, and where it has none made by smooth = true",
        NormalsMade.ALL: "made by smooth = true",
    }
    return f"{who[part.normals_made]}, at {_of(usable, len(part.vertices), 'vertices')}"


def _colors(part: SceneObject) -> str:
    """Say whether the mesh has colors of its own."""
    colors = part.vertex_colors
    if colors is None:
        return "none: its material's"
    different = bool((colors != colors[0]).any())
    return "of the mesh, one per vertex" if different else "of the mesh, the same at all vertices"


def _textures(part: SceneObject) -> str:
    """Say how many pictures the mesh has, how large, and on how many triangles."""
    number, uv = part.texture_of_triangle, part.uv
    coordinates = uv is not None and bool(np.isfinite(uv).any())
    if number is None or uv is None or not part.textures:
        return "none, though it has texture coordinates" if coordinates else "none"
    shown = int(((number >= 0) & np.isfinite(uv[part.faces]).all(axis=(1, 2))).sum())
    sizes = ", ".join(dict.fromkeys(f"{picture.shape[1]} x {picture.shape[0]}" for picture in part.textures))
    count = f"{len(part.textures)} picture{'s' if len(part.textures) > 1 else ''} of {sizes} pixels"
    return f"{count}, on {_of(shown, len(part.faces), 'triangles')}"


def _of(some: int, total: int, what: str) -> str:
    return f"all {what}" if some == total else f"{some:,} of {total:,} {what}"
