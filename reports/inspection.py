"""Inspection page: hogels in panes of truth, image and errors, and the values at wrong pixels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from xfrustum.compare.error_maps import displacement, judged_pixels, lengths
from xfrustum.compare.judging.judged import Figures
from xfrustum.compare.run import Evaluator, FrameRequest, JudgedFrame
from xfrustum.reports.common import pictures
from xfrustum.reports.common.templates_environment import address, html_page
from xfrustum.reports.notebook import by_height, map_of, png
from xfrustum.reports.plotting import plate_cells
from xfrustum.scenes import Aperture, DoubleFrustum, HogelImage, Plate, Scene
from xfrustum.scenes.arrays import Bytes, Floats, Indices, Mask
from xfrustum.scenes.model.images import NOTHING
from xfrustum.scenes.representation import digits, percent

PAGE = "inspect.html"
#: text that identifies the pages of this program
MARK = '<p class="kicker">xfrustum'

MAX_HOGELS = 12
"""Largest number of hogels on a page: a hogel of 512 x 512 pixels takes about a megabyte."""

MAX_SIDE_PX = 1024
"""Longest side of a pane; panes of larger films keep the worst pixel of each block."""

MAX_LISTED_PIXELS = 400
"""Largest number of wrong pixels of a hogel whose values are on the page."""

#: request of frames that can be inspected
DRAWN = FrameRequest(color=True, causes=True)

COLORS = (
    "rgb(224,49,49)",
    "rgb(214,51,132)",
    "rgb(245,135,0)",
    "rgb(150,90,200)",
    "rgb(0,114,178)",
    "rgb(86,180,233)",
    "rgb(0,158,115)",
)
"""Colors of classes of pixels; the first three classes are errors."""

Classes = Mapping[str, Mask]
"""Masks (H, W) by label; a pixel in several masks has the label of the first mask."""


@dataclass(frozen=True, kw_only=True)
class Legend:
    """An entry of a pane's legend: a class of pixels."""

    label: str
    color: str
    pixels: int


@dataclass(frozen=True, kw_only=True)
class Pane:
    """A picture of a hogel, PNG or WebP."""

    caption: str
    content: bytes
    #: errors, shown over the dimmed truth
    over_truth: bool = False
    legend: tuple[Legend, ...] = ()


@dataclass(frozen=True, kw_only=True)
class InspectedHogel:
    """A hogel in panes, and the values of truth and image at its wrong pixels."""

    #: column and row
    aperture: tuple[int, int]
    #: width and height in pixels
    size: tuple[int, int]
    #: errors of the hogel in a line
    words: str
    #: panes of the hogel, beginning with the truth
    panes: tuple[Pane, ...]
    #: names of columns, and a row of values for each listed wrong pixel
    columns: tuple[str, ...]
    pixels: tuple[tuple[int | float | str | None, ...], ...]


def inspected_drawings(
    evaluator: Evaluator,
    apertures: Sequence[Aperture],
    setting: DoubleFrustum,
    *,
    causes: bool = True,
) -> Iterator[InspectedHogel]:
    """Yield the hogels of some apertures, drawn with a setting, with the causes of their errors."""
    request = replace(DRAWN, causes=causes)
    with closing(evaluator.frames(apertures, (setting,), request)) as frames:
        yield from (inspected_frame(evaluator.scene, frame) for frame in frames)


def inspected_frame(scene: Scene, frame: JudgedFrame) -> InspectedHogel:
    """Return a frame of our own rasterizer with truth, errors and, given a budget, causes."""
    comparison, settings, errors = frame.comparison, frame.settings, frame.comparison.errors
    assert errors.surface is not None and errors.outside is not None, "the scene is at hand"
    words = []
    if comparison.surface is not None:
        words.append(f"wrong surfaces {percent(comparison.surface.fraction)}")
    if comparison.displacement_px is not None:
        words.append(f"displacement (p99) {digits(comparison.displacement_px.p99)} px")
    states = {
        "wrong surface": errors.surface & ~errors.outside,
        "wrong surface from outside the film": errors.outside,
        "right surface, another triangle": errors.triangle,
        "tie, not judged": ~errors.judged,
    }
    classes: dict[str, Classes] = {"Right or wrong": states}
    if (budget := frame.budget) is not None:
        classes["Cause"] = {
            name: budget.surface_charge == number for number, name in enumerate(budget.links)
        }
        classes["Rounding"] = budget.explanation.masks
    return _inspected(
        scene,
        frame.aperture,
        (frame.truth, frame.image),
        ", ".join(words),
        (f"Image: near {digits(settings.near)}, {settings.depth_label}", classes, errors.moved),
    )


def inspected_figures(
    scene: Scene, aperture: Aperture, as_found: Figures, corrected: Figures
) -> InspectedHogel:
    """Return a hogel of another renderer, judged as delivered and after correction."""
    words = f"{as_found.numbers.limited_figure} {percent(as_found.numbers.judged_fraction)}"
    answer, image = as_found.answer, as_found.image
    # Ties have no true triangle, so that no renderer can be wrong there.
    tie = ~judged_pixels(answer)
    classes: dict[str, Classes] = {
        "Right or wrong": {"wrong": as_found.error, "tie, not judged": tie}
    }
    if corrected is not as_found:
        words += f", corrected {percent(corrected.numbers.judged_fraction)}"
        classes["Right or wrong, corrected"] = {"wrong": corrected.error, "tie, not judged": tie}
    if corrected.cause_masks is not None:
        classes["Rounding"] = corrected.cause_masks.masks
    moved = None
    if np.isfinite(image.position).any():
        moved = lengths(displacement(image, answer.camera))
    return _inspected(scene, aperture, (answer, image), words, ("Image, upright", classes, moved))


def _inspected(
    scene: Scene,
    aperture: Aperture,
    pair: tuple[HogelImage, HogelImage],
    words: str,
    errors: tuple[str, Mapping[str, Classes], Floats | None],
) -> InspectedHogel:
    """Return the panes of truth and image, of classes of errors, and of displacement."""
    (truth, image), (caption, classes, moved) = pair, errors
    height, width = truth.triangle.shape
    # Round up, so that no pane is longer than the limit.
    reduction = -(-max(width, height) // MAX_SIDE_PX)
    maps = {name: _class_numbers(masks) for name, masks in classes.items()}
    panes = [
        Pane(caption="Truth", content=_picture(truth, reduction)),
        Pane(caption=caption, content=_picture(image, reduction)),
        *(_classes_pane(name, list(classes[name]), maps[name], reduction) for name in classes),
    ]
    if moved is not None:
        low, high = pictures.DISPLACEMENT_RANGE_PX
        content = pictures.displacement_map(moved, reduction)
        panes.append(Pane(caption=f"Displacement, {low:g} to {high:g} px", content=content))
    # Ties are not wrong. Wrong surfaces have precedence over other triangles.
    first = next(iter(classes))
    wrong = [n for n, label in enumerate(classes[first], start=1) if not label.startswith("tie")]
    places = np.concatenate([np.flatnonzero(maps[first] == n) for n in wrong])[:MAX_LISTED_PIXELS]
    values = {"column": (places % width).tolist(), "row": (places // width).tolist()}
    for name, masks in classes.items():
        labels = [None, *masks]
        values[name] = [labels[number] for number in maps[name].reshape(-1)[places]]
    values |= _values(scene, "truth", truth, places) | _values(scene, "image", image, places)
    if moved is not None:
        values["displacement, px"] = moved.reshape(-1)[places].tolist()
    return InspectedHogel(
        aperture=aperture.index,
        size=(width, height),
        words=words,
        panes=tuple(panes),
        columns=tuple(values),
        pixels=tuple(zip(*values.values(), strict=True)),
    )


def _picture(image: HogelImage, reduction: int) -> bytes:
    """Return the colors of an image, or shades by height where it has none."""
    if image.color is not None:
        return pictures.picture(image, reduction)
    return png(by_height(image.covered, image.height))


def _class_numbers(masks: Classes) -> Bytes:
    """Return the number of the class of each pixel, counted from 1; 0 for none."""
    numbers = np.zeros(next(iter(masks.values())).shape, dtype=np.uint8)
    # The first of overlapping classes is painted last, over the others.
    for number, mask in reversed(list(enumerate(masks.values(), start=1))):
        numbers[mask] = number
    return numbers


def _classes_pane(caption: str, labels: Sequence[str], numbers: Bytes, reduction: int) -> Pane:
    """Return a pane with a color for each class that has pixels."""
    colors = [COLORS[place % len(COLORS)] for place in range(len(labels))]
    counts = np.bincount(numbers.reshape(-1), minlength=len(labels) + 1)[1:].tolist()
    legend = tuple(
        Legend(label=label, color=color, pixels=count)
        for label, color, count in zip(labels, colors, counts, strict=True)
        if count
    )
    content = pictures.class_map(numbers, colors, reduction)
    return Pane(caption=caption, content=content, over_truth=True, legend=legend)


def _values(
    scene: Scene, name: str, image: HogelImage, places: Indices
) -> dict[str, list[int | float | str | None]]:
    """Return triangle, object and position of some pixels of an image, by the names of columns."""
    names = [part.name for part in scene.objects]
    triangles, objects = (
        channel.reshape(-1)[places].tolist() for channel in (image.triangle, image.object)
    )
    points = image.position.reshape(-1, 3)[places]
    return {
        f"{name} triangle": [None if number == NOTHING else number for number in triangles],
        f"{name} object": [
            names[number] if 0 <= number < len(names) else None for number in objects
        ],
        **{f"{name} {axis}": points[:, place].tolist() for place, axis in enumerate("xyz")},
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateMap:
    """A value of each hogel of a plate; it is a share if `words` begin with "Share"."""

    words: str
    #: (rows, columns) largest value of each cell; NaN in cells without a value
    cells: Floats

    @classmethod
    def from_values(
        cls, plate: Plate, words: str, values: Iterable[tuple[int, int, float]]
    ) -> PlateMap:
        """Make a map of hogels by column and row."""
        every = np.reshape(list(values), (-1, 3))
        return cls(words=words, cells=plate_cells(plate.hogels, every[:, :2], every[:, 2])[0])

    @property
    def picture(self) -> str | None:
        """Data URL of the map, brightest at the largest value; None for a single cell."""
        if self.cells.size < 2 or not np.isfinite(self.cells).any():
            return None
        return address(png(map_of(self.cells)))

    @property
    def largest(self) -> str:
        """Largest value as text; empty if no hogel has a value."""
        if not np.isfinite(self.cells).any():
            return ""
        value = float(np.nanmax(self.cells))
        return percent(value) if self.words.startswith("Share") else digits(value)


@dataclass(frozen=True, kw_only=True, eq=False)
class Inspection:
    """Content of an inspection page of `report`, `verify` or `survey`."""

    command: str
    scene: Scene
    #: sentence about the hogels
    intro: str
    #: the worst first; at most `MAX_HOGELS` are shown
    hogels: Sequence[InspectedHogel]
    #: errors of the hogels of the plate
    plate_map: PlateMap


def write_inspection(folder: Path, shown: Inspection) -> None:
    """Write the page into a folder."""
    hogels = shown.hogels[:MAX_HOGELS]
    values = {
        "shown": shown,
        "hogels": hogels,
        "left_out": len(shown.hogels) - len(hogels),
        "listed": MAX_LISTED_PIXELS,
        "page_data": [
            {"size": hogel.size, "columns": hogel.columns, "pixels": hogel.pixels}
            for hogel in hogels
        ],
    }
    page = html_page("inspect.html.j2", values)
    (folder / PAGE).write_text(page, encoding="utf-8")


@contextmanager
def replacing_inspection(folder: Path, *, kept: bool = True) -> Iterator[None]:
    """Remove an earlier run's inspection page after the `with` block, unless `kept`.

    A file of this name from another program stays.
    """
    yield
    page = folder / PAGE
    if not kept and page.is_file() and MARK in page.read_text(encoding="utf-8", errors="replace"):
        page.unlink()
