"""`xfrustum check`: what lies where in a scene, which apertures see it, and what looks like a mistake."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.compare.extent import (
    ObjectExtent,
    extents,
    facing_warnings,
    heights,
    length,
    plate_warnings,
    unseen_facts,
    warnings,
)
from xfrustum.reports.common.outputs import json_ready, write_files
from xfrustum.reports.scene_check.drawing import View, draw_view
from xfrustum.scenes.model.scene import NormalsMade, Scene, SceneObject
from xfrustum.scenes.notebook import Figure, Shown, Table, counted, digits

FILES = tuple(f"{view.value}.svg" for view in View)


@dataclass(frozen=True, kw_only=True)
class ObjectCheck:
    """One object, as it is known before it is drawn."""

    extent: ObjectExtent
    looks: dict[str, str]  #: what it is shaded with, in words: `normals`, `colors` and `textures`


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SceneCheck(Shown):
    """A scene, as it is known before it is drawn."""

    scene: Scene
    objects: tuple[ObjectCheck, ...]
    warnings: tuple[str, ...]
    seen: bool  #: whether any aperture of the plate can show anything; true of a scene without objects

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
                Path(one.name).name,
                f"{one.triangles:,}",
                " x ".join(map(digits, one.size)),
                f"{digits(one.low[2])} to {digits(one.high[2])}",
                f"{one.sight.apertures:,}",
            )
            for one in (checked.extent for checked in self.objects)
        ]
        head = ("object", "triangles", f"size, {units}", f"heights, {units}", "apertures that see it")
        return (Table(head=head, rows=rows), Table(rows=[("warning", line) for line in self.warnings]))

    def _figures(self) -> Sequence[Figure]:
        return [Figure(caption=view.value, content=self.view(view).encode()) for view in View]

    def summary(self) -> dict[str, Any]:
        """Return everything but the pictures, as `check --json` prints it."""
        scene = self.scene
        objects = [{**vars(one.extent), "size": one.extent.size, **one.looks} for one in self.objects]
        content: dict[str, Any] = json_ready(
            {
                "scene": scene.name,
                "units": scene.units,
                "plate": scene.plate,
                "reach": scene.frustum.reach,
                "objects": objects,
                "warnings": self.warnings,
                "seen": self.seen,
            }
        )
        return content


def check(scene: Scene) -> SceneCheck:
    """Say where each object of a scene lies, which apertures may see it, and what looks like a mistake.

    An object behind another one counts as seen; only which side of an object is seen is traced.
    """
    objects = tuple(
        ObjectCheck(extent=extent, looks=_looks(part))
        for extent, part in zip(extents(scene), scene.objects, strict=True)
    )
    unseen = unseen_facts(scene, scene.plate.apertures())
    told = [*scene.warnings, *([unseen] if unseen is not None else [])]
    if unseen is None:
        told += [*warnings(scene), *plate_warnings(scene), *facing_warnings(scene)]
        told += [
            f"object {one.number} ({Path(one.name).name}) is outside the frusta of all apertures"
            for one in (checked.extent for checked in objects)
            if one.sight.apertures == 0
        ]
    return SceneCheck(scene=scene, objects=objects, warnings=tuple(dict.fromkeys(told)), seen=unseen is None)


def write_check(checked: SceneCheck, out: Path) -> tuple[Path, ...]:
    """Write side.svg and top.svg into a folder, both or none; InputError where that cannot be."""
    return write_files(out, {name: checked.view(view) for view, name in zip(View, FILES, strict=True)})


def table(checked: SceneCheck) -> str:
    """Return a check as lines for people."""
    scene = checked.scene
    (toward, back), units = scene.frustum.reach, scene.units
    (width, height), hogels = map(length, scene.plate.size), scene.plate.hogels
    lines = [
        f"{scene.name}: plate of {width} x {height} {units}, {hogels[0]} x {hogels[1]} apertures; "
        f"reach {length(toward)} {units} before and {length(back)} {units} behind it"
    ]
    if not checked.objects:
        lines.append("no objects: the true image of nothing is nothing")
    for one in checked.objects:
        extent, sight = one.extent, one.extent.sight
        seen = f"none of {sight.of:,} apertures"
        if sight.apertures == sight.of:
            seen = f"all {sight.of:,} apertures"
        elif sight.columns is not None and sight.rows is not None:
            seen = (
                f"{sight.apertures:,} of {sight.of:,} apertures, columns {sight.columns[0]} to "
                f"{sight.columns[1]}, rows {sight.rows[0]} to {sight.rows[1]}; "
                f"{'the middle one too' if sight.middle else 'not the middle one'}, "
                f"{sum(sight.corners)} of 4 corners"
            )
        share = extent.share_in_reach
        rows = {
            "triangles": f"{extent.triangles:,}",
            "size": " x ".join(length(side) for side in extent.size) + f" {units}",
            "height": heights(extent.low[2], extent.high[2], units),
            "in the reach": "no area" if share is None else f"{100 * share:.4g} % of its surface",
            "seen by": seen,
            **one.looks,
        }
        lines += ["", f"object {extent.number}: {extent.name}"]
        lines += [f"  {name:<12}  {value}" for name, value in rows.items()]
    return "\n".join(lines)


def _looks(part: SceneObject) -> dict[str, str]:
    """Say what a mesh has to be shaded with: normals, colors of its own, and pictures on triangles."""

    def of(some: int, total: int, what: str) -> str:
        return f"all {what}" if some == total else f"{some:,} of {total:,} {what}"

    made = part.vertex_normals
    usable = 0 if made is None else int(np.isfinite(made).all(axis=1).sum())
    who = {
        NormalsMade.NONE: "of the mesh",
        NormalsMade.SOME: "of the mesh, and where it has none made by smooth = true",
        NormalsMade.ALL: "made by smooth = true",
    }
    normals = f"{who[part.normals_made]}, at {of(usable, len(part.vertices), 'vertices')}"

    colors = "none: its material's"
    if part.vertex_colors is not None:
        different = bool((part.vertex_colors != part.vertex_colors[0]).any())
        colors = f"of the mesh, {'one per vertex' if different else 'the same at all vertices'}"

    number, uv = part.texture_of_triangle, part.uv
    coordinates = uv is not None and bool(np.isfinite(uv).any())
    textures = "none, though it has texture coordinates" if coordinates else "none"
    if number is not None and uv is not None and part.textures:
        shown = int(((number >= 0) & np.isfinite(uv[part.faces]).all(axis=(1, 2))).sum())
        sizes = ", ".join(dict.fromkeys(f"{one.shape[1]} x {one.shape[0]}" for one in part.textures))
        pictures = counted(len(part.textures), "picture")
        textures = f"{pictures} of {sizes} pixels, on {of(shown, len(part.faces), 'triangles')}"
    return {
        "normals": normals if usable else "none: every triangle is flat",
        "colors": colors,
        "textures": textures,
    }
