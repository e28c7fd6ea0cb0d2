"""Notebook displays of the objects of `scenes` and `compare`.

`register` adds the displays to IPython; in a notebook, `import xfrustum` calls `register`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch
from pathlib import PurePath
from typing import Any

import numpy as np

from xfrustum.compare.comparison import Comparison
from xfrustum.compare.run import JudgedDrawing, JudgedHogel
from xfrustum.reports import text
from xfrustum.reports.notebook import Display, Figure, as_shown, by_height, marked, png
from xfrustum.scenes import HogelImage, Scene
from xfrustum.scenes.model.eye import EyeImage
from xfrustum.scenes.model.images import Certainty, SurfaceImage
from xfrustum.scenes.model.scene import SceneObject
from xfrustum.scenes.representation import counted, digits, percent, sides

MOVED_PX = 1.0
"""Displacement shown in full color on a map: one pixel."""

#: largest number of listed objects of a scene; the others are counted
MAX_LISTED_OBJECTS = 24

DISPLAYED = (Scene, SceneObject, HogelImage, EyeImage, Comparison, JudgedDrawing, JudgedHogel)
"""Types that notebooks display by the functions below."""


def register(formatters: Mapping[str, Any]) -> None:
    """Add displays to `formatters`, IPython's formatters by media type."""
    # IPython looks formatters up along the classes of an object: subclasses are displayed, too.
    for kind in DISPLAYED:
        formatters["text/html"].for_type(kind, html)
        formatters["image/png"].for_type(kind, first_png)


def html(value: Any) -> str:
    """Return the display of an object as HTML."""
    return display(value).html(type(value).__name__)


def first_png(value: Any) -> bytes | None:
    """Return the first picture of an object as PNG; None if it has none."""
    return display(value).first_png


@singledispatch
def display(value: Any) -> Display:
    """Return the display of an object."""
    raise TypeError(f"{type(value).__name__} has no display")


@display.register
def _scene(scene: Scene) -> Display:
    rows = [("object", "triangles", f"size, {scene.units}", f"heights, {scene.units}", "material")]
    rows += [
        (*_object_cells(part), part.material or "default")
        for part in scene.objects[:MAX_LISTED_OBJECTS]
    ]
    lines = [text.aligned(rows)] if scene.objects else []
    if (more := len(scene.objects) - MAX_LISTED_OBJECTS) > 0:
        lines.append(f"and {counted(more, 'more object')}")
    lines.append(f"source: {scene.source or 'made in memory'}")
    lines += [f"warning: {line}" for line in scene.warnings]
    return Display(line=text.scene_line(scene), facts="\n".join(lines))


def _object_cells(part: SceneObject) -> tuple[str, str, str, str]:
    points = part.vertices[part.faces.ravel()]
    low, high = points.min(axis=0), points.max(axis=0)
    size = " x ".join(map(digits, (high - low).tolist()))
    heights = f"{digits(low[2])} to {digits(high[2])}"
    return PurePath(part.name).name, f"{len(part.faces):,}", size, heights


@display.register
def _object(part: SceneObject) -> Display:
    name, _, size, heights = _object_cells(part)
    triangles = counted(len(part.faces), "triangle")
    return Display(line=f"{name!r}, {triangles}, {size} scene units, heights {heights}")


def _surface_figures(image: SurfaceImage) -> tuple[Figure, ...]:
    covered, height = image.covered, image.position[..., 2]
    shades = Figure(caption="height, dark to light", content=png(by_height(covered, height)))
    if image.color is None:
        return (shades,)
    color = png(as_shown(image.color, covered, height))
    return Figure(caption="color, sRGB", content=color), shades


def _surface_words(image: SurfaceImage) -> str:
    """Return the size of an image, its number of covered pixels, and the range of their heights."""
    rows, columns = image.covered.shape
    count, height = int(np.count_nonzero(image.covered)), image.position[..., 2]
    # Empty images have no heights, and no share to divide by.
    where, share = "", percent(count / max(1, image.covered.size))
    # Background pixels have NaN as height.
    if (known := height[np.isfinite(height)]).size:
        low, high = digits(float(known.min())), digits(float(known.max()))
        where = f" at heights {low} to {high} scene units"
    return f"{sides((columns, rows))} pixels, {count:,} ({share}) show a surface{where}"


@display.register
def _hogel_image(image: HogelImage) -> Display:
    camera = image.camera
    kind = "image" if image.certainty is None else "truth"
    if camera.settings is not None:
        kind = f"drawing with near {digits(camera.settings.near)} {camera.settings.depth_label}"
    column, row = camera.aperture.index
    optional = ("color", "normal", "variance", "certainty")
    has = ["surfaces", *(name for name in optional if getattr(image, name) is not None)]
    facts = [f"renderer: {camera.renderer}"]
    if camera.settings is not None:
        facts.append(f"settings: {camera.settings}")
    if image.certainty is not None:
        counts = {
            kind_of.name.lower(): np.count_nonzero(image.certainty == kind_of)
            for kind_of in Certainty
        }
        facts.append("certainty: " + ", ".join(f"{n:,} {name}" for name, n in counts.items() if n))
    return Display(
        line=f"{kind} of aperture {column},{row} of {camera.scene or 'a scene'!r} by "
        f"{camera.renderer}; {_surface_words(image)}; has {', '.join(has)}",
        facts="\n".join(facts),
        figures=_surface_figures(image),
    )


@display.register
def _eye_image(image: EyeImage) -> Display:
    place = ", ".join(map(digits, image.eye.position))
    color = "with" if image.color is not None else "without"
    return Display(
        line=f"view of an eye at ({place}) scene units; {_surface_words(image)}; {color} color",
        figures=_surface_figures(image),
    )


@display.register
def _comparison(comparison: Comparison) -> Display:
    errors = comparison.errors
    camera, renderer = errors.truth.camera, errors.raster.camera.renderer
    column, row = camera.aperture.index
    truth, picture = (
        as_shown(image.color, image.covered, image.height)
        for image in (errors.truth, errors.raster)
    )
    marks = marked(picture, errors.surface, errors.moved / MOVED_PX)
    caption = f"wrong surfaces red, displacement blue (full at {digits(MOVED_PX)} px)"
    pictures = (caption, marks), ("truth", truth), ("image", picture)
    return Display(
        line=f"{renderer} against the truth, aperture {column},{row} of "
        f"{camera.scene or 'a scene'!r}; {text.comparison_line(comparison)}",
        facts=text.comparison_table(comparison),
        figures=[Figure(caption=name, content=png(content)) for name, content in pictures],
    )


@display.register
def _drawing(drawing: JudgedDrawing) -> Display:
    comparison = drawing.comparison
    return Display(
        line=text.drawing_line(drawing),
        facts=text.comparison_table(comparison),
        figures=display(comparison).figures if isinstance(comparison, Comparison) else (),
    )


@display.register
def _hogel(hogel: JudgedHogel) -> Display:
    drawn = "; ".join(map(text.drawing_line, hogel.drawings))
    return Display(
        line=f"aperture {hogel.aperture.column},{hogel.aperture.row}; {drawn}",
        figures=() if hogel.truth is None else display(hogel.truth).figures,
    )
