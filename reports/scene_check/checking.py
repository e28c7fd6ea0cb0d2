"""`xfrustum check`: position and visibility of objects, likely mistakes, and two views."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Self

import numpy as np
from markupsafe import Markup
from PIL import Image, ImageDraw
from skimage.measure import find_contours

from xfrustum.reports.common.outputs import json_object, write_files
from xfrustum.reports.common.templates_environment import Filters, fragment, plain_text
from xfrustum.reports.notebook import Figure, NotebookRepr
from xfrustum.reports.scene_check.effects import SceneEffects, scene_effects
from xfrustum.reports.text import (
    facing_warnings,
    heights,
    length,
    plate_warnings,
    unseen_facts,
    warnings,
)
from xfrustum.scenes import Aperture, DoubleFrustum
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import NormalsMade, Scene, SceneObject
from xfrustum.scenes.model.visibility import (
    ObjectExtent,
    aside_of_frusta,
    box,
    extents,
    triangles_in_chunks,
)
from xfrustum.scenes.representation import counted

#: position and size of the drawing area in the picture, pixels
LEFT, TOP, WIDTH, HEIGHT = 58.0, 62.0, 500.0, 400.0

#: margin around all content, as a share of its size; size in pixels of the picture below which a
#: ring marks an object
MARGIN, SMALL_PX = 0.04, 7.0

#: Largest distance of drawn objects beyond the reach or the plate's sides, share of the whole
#: reach. Farther objects are only named: a mesh in wrong units must not shrink other objects to a
#: dot.
FARTHEST = 0.75

#: largest number of drawn objects: the number of colors of the template
MAX_DRAWN = 5

#: cells of the outline mask per pixel of the picture, in each direction
FINER = 2

#: attribute of the first element of a view, redundant in HTML pages
NAMESPACE = ' xmlns="http://www.w3.org/2000/svg"'


class View(StrEnum):
    """Viewpoint of a scene's picture; the viewer's side of the plate is always on the right."""

    SIDE = "side"
    TOP = "top"

    @property
    def axis(self) -> int:
        """Axis that points upward in the picture: y from the side, x from above."""
        return 1 if self is View.SIDE else 0


TITLES = {
    View.SIDE: ("Side view", "seen from the viewer's left, y is up"),
    View.TOP: ("Top view", "seen from above, x is up: the viewer's right"),
}


@dataclass(frozen=True, kw_only=True)
class PictureFrame:
    """Rectangle of space that a view shows, with equal scales in both directions."""

    #: Left, bottom, right and top, scene units: z to the right, and x or y upward.
    box: tuple[float, float, float, float]
    #: pixels per scene unit
    scale: float

    @classmethod
    def from_scene(cls, scene: Scene, view: View) -> Self:
        """Return the frame of the reach, the plate, the frusta and all objects not far away."""
        toward, back = scene.frustum.reach
        far, plate = FARTHEST * (toward + back), scene.plate.size[view.axis] / 2
        least, most = np.array([-back - far, -plate - far]), np.array([toward + far, plate + far])
        frusta = aside_of_frusta(scene.frustum, shown_apertures(scene), view.axis, (-back, toward))
        corners = [np.clip(np.column_stack([(-back, toward), frusta]), least, most)]
        for part in scene.objects:
            ends = np.array(box(part))[:, [2, view.axis]]
            if (ends[1] >= least).all() and (ends[0] <= most).all():
                corners.append(np.clip(ends, least, most))
        first, last = np.concatenate(corners).min(axis=0), np.concatenate(corners).max(axis=0)
        size = np.array([WIDTH, HEIGHT])
        scale = float((size / (last - first)).min() / (1 + 2 * MARGIN))
        # Give the rectangle the aspect ratio of the drawing area.
        rectangle = [(first + last) / 2 + side * size / scale / 2 for side in (-1, 1)]
        left, bottom, right, top = np.concatenate(rectangle).tolist()
        return cls(box=(left, bottom, right, top), scale=scale)

    def place(self, points: Floats) -> Floats:
        """Return positions (.., 2), pixels from the top left, of points (z, x) or (z, y)."""
        left, _, _, top = self.box
        return np.asarray((points - (left, top)) * (self.scale, -self.scale))

    def x(self, z: float) -> float:
        """Return the column of a height z in the picture, pixels from the left."""
        return round(LEFT + (z - self.box[0]) * self.scale, 1)

    def y(self, across: float) -> float:
        """Return the row of an x or y in the picture, pixels from the top."""
        return round(TOP + (self.box[3] - across) * self.scale, 1)


def shown_apertures(scene: Scene) -> list[Aperture]:
    """Return the middle, top left and bottom right apertures of the plate, without repetition."""
    return list(dict.fromkeys((scene.plate.middle, *scene.plate.corners)))


def outlines(part: SceneObject, frame: PictureFrame, view: View) -> list[Floats]:
    """Return closed outlines (N, 2) of an object within a frame, pixels from its top left.

    Holes are separate outlines, for the even-odd rule. Every triangle is projected; parts thinner
    than a cell of the mask are one cell thick.
    """
    size = int(FINER * WIDTH), int(FINER * HEIGHT)
    mask = Image.new("1", size)
    draw = ImageDraw.Draw(mask)
    for triangles in triangles_in_chunks(part):
        corners = frame.place(triangles[..., [2, view.axis]]) * FINER
        low, high = corners.min(axis=1), corners.max(axis=1)
        within = ((high >= 0) & (low <= size)).all(axis=1)
        # Triangles no larger than a cell are drawn only by their corners, each cell once.
        tiny = (high - low).max(axis=1) <= 1
        cells = np.unique(corners[within & tiny].reshape(-1, 2).astype(np.int64), axis=0)
        draw.point(cells.ravel().tolist(), fill=1)
        # Clipping to Pillow's coordinate range is exact: points far outside stay outside.
        for triangle in np.clip(corners[within & ~tiny], -1e6, 1e6).reshape(-1, 6).tolist():
            draw.polygon(triangle, fill=1, outline=1)
    # Add a border, so that outlines that leave the frame are closed along it.
    rings = []
    for contour in find_contours(np.pad(np.asarray(mask, np.float64), 1), 0.5):
        # Leave out points within straight runs; coordinates are halves, so that the test is exact.
        bends = np.pad(np.diff(contour, 2, axis=0).any(axis=1), 1, constant_values=True)
        rings.append((contour[bends][:, ::-1] - 0.5) / FINER)
    return rings


def draw_view(scene: Scene, view: View) -> str:
    """Return one view of a scene as a self-contained SVG document.

    Plate, reach and frusta are drawn with equal scales in both directions, objects as outlines of
    all triangles. Objects that are too far away are only named.
    """
    frame, frustum, axis = PictureFrame.from_scene(scene, view), scene.frustum, view.axis
    toward, back = frustum.reach
    frusta = []
    middle, *corners = shown_apertures(scene)
    # Draw the middle aperture last.
    for aperture in (*corners, middle):
        for end in (-back, toward):
            low, high = aside_of_frusta(frustum, [aperture], axis, (end, end))
            places = [(0.0, (aperture.x, aperture.y)[axis]), (end, low), (end, high)]
            points = " ".join(f"{frame.x(z)},{frame.y(across)}" for z, across in places)
            frusta.append({"points": points, "behind": end < 0, "middle": aperture == middle})
    objects = []
    for number, part in enumerate(scene.objects[:MAX_DRAWN]):
        shapes, (lowest, highest) = outlines(part, frame, view), box(part)
        ring = None
        if shapes:
            every = np.concatenate(shapes)
            if np.ptp(every, axis=0).max() < SMALL_PX:
                middle_of_shape = (every.min(axis=0) + every.max(axis=0)) / 2
                ring = np.add(middle_of_shape, (LEFT, TOP)).round(1).tolist()
        paths = ("L".join(f"{x:.1f} {y:.1f}" for x, y in shape) for shape in shapes)
        shape = {
            "name": f"{number} {Path(part.name).name}",
            "ring": ring,
            # An object outside the picture is labeled with its heights.
            "away": "" if shapes else heights(lowest[2], highest[2], scene.units),
            "path": "".join(f"M{path}Z" for path in paths),
        }
        objects.append(shape)
    title, subtitle = TITLES[view]

    def signed(value: float) -> str:
        return ("\N{MINUS SIGN}" if value < 0 else "") + length(abs(value))

    def printable(words: str) -> str:
        # File names may contain control characters, which XML cannot represent.
        return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in words)

    values = {
        **{"scene": scene, "frame": frame, "frustum": frustum, "axis": axis},
        **{"title": title, "subtitle": subtitle, "frusta": frusta, "objects": objects},
        "ticks": [_ticks(frame.box[0], frame.box[2]), _ticks(frame.box[1], frame.box[3])],
        "more": max(0, len(scene.objects) - len(objects)),
        "height": 540 + 18 * len(objects),
    }
    filters: Filters = {"printable": printable, "signed": signed, "length": length}
    return fragment("scene-view.svg.j2", values, filters) + "\n"


def _ticks(low: float, high: float) -> list[float]:
    """Return about five round numbers between two limits."""
    rough = (high - low) / 5
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough)
    ticks: list[float] = (step * np.arange(np.ceil(low / step), np.floor(high / step) + 1)).tolist()
    return ticks


def scene_fit(scene: Scene) -> dict[str, Any]:
    """Return the views and warnings for the scene section of a page (`_scene.html.j2`)."""
    views = tuple(Markup(draw_view(scene, view).replace(NAMESPACE, "", 1)) for view in View)
    return {"views": views, "warnings": warnings(scene)}


FILES = tuple(f"{view.value}.svg" for view in View)


@dataclass(frozen=True, kw_only=True)
class ObjectCheck:
    """Facts of one object, found without drawing it."""

    extent: ObjectExtent
    #: descriptions of shading data: `normals`, `colors` and `textures`
    looks: dict[str, str]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SceneCheck(NotebookRepr):
    """Facts of a scene, found without drawing it."""

    scene: Scene
    objects: tuple[ObjectCheck, ...]
    warnings: tuple[str, ...]
    #: whether any aperture of the plate can show anything; True for a scene without objects
    seen: bool
    effects: SceneEffects

    def view(self, view: View | str) -> str:
        """Return the `side` or the `top` view as an SVG document."""
        return draw_view(self.scene, View(view))

    def _said(self) -> str:
        seen = "apertures see it" if self.seen else "no aperture sees anything"
        count = counted(len(self.warnings), "warning")
        return f"{self.scene.name!r}, {counted(len(self.objects), 'object')}, {seen}; {count}"

    def _facts(self) -> str:
        return "\n".join([*(f"warning: {line}" for line in self.warnings), self.table()])

    def _figures(self) -> Sequence[Figure]:
        return [Figure(caption=view.value, content=self.view(view).encode()) for view in View]

    def summary(self) -> dict[str, Any]:
        """Return the JSON object that `check --json` prints."""
        scene = self.scene
        objects = [
            {**vars(item.extent), "size": item.extent.size, **item.looks} for item in self.objects
        ]
        return json_object(
            {
                "scene": scene.name,
                "units": scene.units,
                "plate": scene.plate,
                "reach": scene.frustum.reach,
                "objects": objects,
                "unread": [
                    {"object": number, "file": part.name, **asdict(feature)}
                    for number, part in enumerate(scene.objects)
                    for feature in part.unread
                ],
                "warnings": self.warnings,
                "seen": self.seen,
                **self.effects.summary(),
            }
        )

    def table(self) -> str:
        """Return the check as text."""
        filters: Filters = {"length": length, "heights": heights}
        text = plain_text("check.txt.j2", vars(self), filters)
        return f"{text}\n{self.effects.table()}"


def check(
    scene: Scene,
    aperture: Aperture | None = None,
    settings: DoubleFrustum | None = None,
    viewer_distance: float | None = None,
) -> SceneCheck:
    """Return position and visibility of objects, likely mistakes, effects, and errors by depth.

    `aperture`, `settings` and `viewer_distance` are passed to `scene_effects`.
    """
    objects = tuple(
        ObjectCheck(extent=extent, looks=_looks(part))
        for extent, part in zip(extents(scene), scene.objects, strict=True)
    )
    unseen = unseen_facts(scene, scene.plate.apertures())
    messages = [*scene.warnings, *([unseen] if unseen is not None else [])]
    if unseen is None:
        messages += [*warnings(scene), *plate_warnings(scene), *facing_warnings(scene)]
        messages += [
            f"object {seen.number} ({Path(seen.name).name}) is outside the frusta of all apertures"
            for seen in (checked.extent for checked in objects)
            if seen.sight.apertures == 0
        ]
    return SceneCheck(
        scene=scene,
        objects=objects,
        warnings=tuple(dict.fromkeys(messages)),
        seen=unseen is None,
        effects=scene_effects(scene, aperture, settings, viewer_distance),
    )


def write_check(checked: SceneCheck, out: Path) -> tuple[Path, ...]:
    """Write side.svg and top.svg into a folder, both or none; InputError if that fails."""
    return write_files(
        out, {name: checked.view(view) for view, name in zip(View, FILES, strict=True)}
    )


def _looks(part: SceneObject) -> dict[str, str]:
    """Return descriptions of the shading data of a mesh: normals, colors and textures."""
    normals, colors, textures = "none: every triangle is flat", "none: its material's", "none"
    if part.vertex_normals is not None:
        usable = int(np.isfinite(part.vertex_normals).all(axis=1).sum())
        if usable:
            source = _SOURCES[part.normals_made]
            normals = f"{source}, at {_share(usable, len(part.vertices))} vertices"
    if part.vertex_colors is not None:
        different = bool((part.vertex_colors != part.vertex_colors[0]).any())
        colors = f"of the mesh, {'one per vertex' if different else 'the same at all vertices'}"
    number, uv = part.texture_of_triangle, part.uv
    if uv is not None and np.isfinite(uv).any():
        textures = "none, though it has texture coordinates"
        if number is not None and part.textures:
            shown = int(((number >= 0) & np.isfinite(uv[part.faces]).all(axis=(1, 2))).sum())
            pictures = counted(len(part.textures), "picture")
            textures = f"{pictures}, on {_share(shown, len(part.faces))} triangles"
    return {"normals": normals, "colors": colors, "textures": textures}


def _share(number: int, count: int) -> str:
    return "all" if number == count else f"{number:,} of {count:,}"


_SOURCES = {
    NormalsMade.NONE: "of the mesh",
    NormalsMade.SOME: "of the mesh, and where it has none made by smooth = true",
    NormalsMade.ALL: "made by smooth = true",
}
