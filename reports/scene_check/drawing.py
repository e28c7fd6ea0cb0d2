"""The side view and the top view of a scene: plate, reach, frusta and objects, as one small SVG each."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np

from xfrustum.compare.extent import aside_of_frusta, box
from xfrustum.compare.extent_words import heights, length
from xfrustum.reports.scene_check.picture_frame import (
    HEIGHT,
    LEFT,
    TOP,
    WIDTH,
    PictureFrame,
    View,
    shown_apertures,
)
from xfrustum.reports.scene_check.silhouettes import Outline, outlines
from xfrustum.scenes.model.scene import Scene

PICTURE_WIDTH = 660
C_COLOR, C_STAR_COLOR = "#0072b2", "#d55e00"
OBJECT_COLORS = ("#3a3f47", "#009e73", "#a0428a", "#8a6d00", "#5b6fd6")
"""Okabe and Ito's palette, darkened where it is light; further objects share the last color."""

INK, SOFT, FAINT, PAPER = "#1b1f24", "#5b636d", "#c9ced4", "#ffffff"
CHARACTER = 6.9
"""Mean width of a character of the labels, pixels: text is laid out without a font at hand."""

LINE = 18
"""Height of a line of the legend."""

SMALL_PX = 7.0
"""An object smaller than this on the picture gets a ring around it."""

_TITLES = {
    View.SIDE: ("Side view", "seen from the viewer's left, y is up"),
    View.TOP: ("Top view", "seen from above, x is up: the viewer's right"),
}


NAMESPACE = "http://www.w3.org/2000/svg"


def draw_view(scene: Scene, view: View) -> str:
    """Return one view of a scene as an SVG document that needs nothing else.

    Plate, reach and frusta are drawn where they are, to one scale in both directions, and objects as the
    outlines of all their triangles. Objects too far away for that are named at the border they lie behind.
    """
    return _Drawing(scene, view).text()


class _Drawing:
    """One view while it is drawn, from the back to the front."""

    def __init__(self, scene: Scene, view: View) -> None:
        self.scene, self.view = scene, view
        self.frame = PictureFrame.of(scene, view)
        self.legend: list[tuple[str, str]] = []
        self.away: list[tuple[int, str]] = []
        title, subtitle = _TITLES[view]
        self.root = Xml.Element(
            "svg",
            {
                "xmlns": NAMESPACE,
                "font-family": "system-ui, 'Segoe UI', Roboto, 'Liberation Sans', 'DejaVu Sans', sans-serif",
                "font-size": "12",
                "fill": INK,
                "role": "img",
            },
        )
        Xml.SubElement(self.root, "title").text = _printable(f"{title} of {scene.name}, {subtitle}")
        self.paper = self.add("rect", x=0, y=0, rx=8, fill=PAPER)
        self.label(LEFT, 24, title, font_size=16, font_weight=600)
        self.label(LEFT + 96, 24, subtitle, fill=SOFT)
        # An SVG within the SVG, in the same coordinates, because it hides what lies outside.
        box_of_space = f"{LEFT:g} {TOP:g} {WIDTH:g} {HEIGHT:g}"
        self.space = self.add("svg", x=LEFT, y=TOP, width=WIDTH, height=HEIGHT, viewBox=box_of_space)
        self._halves()
        self._axes()
        self._frusta()
        self._objects()
        self._reach_and_plate()
        for place, (number, color) in enumerate(self.away):
            self._point_at(number, color, place)
        self._viewer()
        self._legend()

    def text(self) -> str:
        """Return the document."""
        return Xml.tostring(self.root, encoding="unicode") + "\n"

    def add(self, tag: str, parent: Xml.Element | None = None, **attributes: object) -> Xml.Element:
        """Add a shape."""
        return Xml.SubElement(self.root if parent is None else parent, tag, _attributes(**attributes))

    def label(self, x: float, y: float, words: str, **attributes: object) -> Xml.Element:
        """Add a text; with a white rim, so that it can be read on lines."""
        rim = {"paint_order": "stroke", "stroke": PAPER, "stroke_width": 3, "stroke_linejoin": "round"}
        element = self.add("text", None, x=x, y=y, **(rim | attributes))
        element.text = _printable(words)
        return element

    def _halves(self) -> None:
        """Tint the two halves of the reach, C's and C*'s, and name them."""
        toward, back = self.scene.frustum.reach
        plate = self.frame.x(0.0)
        for end, color, words in (
            (-back, C_COLOR, "behind the plate: camera C"),
            (toward, C_STAR_COLOR, "viewer's side: camera C*"),
        ):
            x = min(plate, self.frame.x(end))
            width = abs(self.frame.x(end) - plate)
            self.add(
                "rect", self.space, x=x, y=TOP, width=width, height=HEIGHT, fill=color, fill_opacity=0.05
            )
            # The two texts meet at the plate, unless a half is wide enough to have its text in the middle.
            room = width - CHARACTER * len(words)
            inset = max(room / 2, 8.0)
            anchor, place = ("end", plate - inset) if end < 0 else ("start", plate + inset)
            self.label(place, TOP - 22, words, fill=color, text_anchor=anchor, font_weight=600)

    def _axes(self) -> None:
        left, bottom, right, top = self.frame.box
        self.add("rect", x=LEFT, y=TOP, width=WIDTH, height=HEIGHT, fill="none", stroke=FAINT)
        for z in _ticks(left, right):
            self.label(self.frame.x(z), TOP + HEIGHT + 16, _signed(z), fill=SOFT, text_anchor="middle")
            self.add("path", d=f"M{self.frame.x(z):.1f} {TOP + HEIGHT}v4", stroke=SOFT)
        for across in _ticks(bottom, top):
            self.label(LEFT - 8, self.frame.y(across) + 4, _signed(across), fill=SOFT, text_anchor="end")
            self.add("path", d=f"M{LEFT} {self.frame.y(across):.1f}h-4", stroke=SOFT)
        units, axis = self.scene.units, "xy"[self.view.axis]
        words = f"z, {units}: height above the plate"
        self.label(LEFT + WIDTH / 2, TOP + HEIGHT + 34, words, fill=SOFT, text_anchor="middle")
        self.label(8, TOP - 22, f"{axis}, {units}", fill=SOFT)

    def _frusta(self) -> None:
        toward, back = self.scene.frustum.reach
        middle, *corners = shown_apertures(self.scene)
        for aperture in (*corners, middle):
            for end, color in ((-back, C_COLOR), (toward, C_STAR_COLOR)):
                low, high = aside_of_frusta(self.scene.frustum, [aperture], self.view.axis, (end, end))
                at = (aperture.x, aperture.y)[self.view.axis]
                corner = [(0.0, at), (end, low), (end, high)]
                points = " ".join(f"{self.frame.x(z):.1f},{self.frame.y(y):.1f}" for z, y in corner)
                look: dict[str, object] = {"fill": color, "fill_opacity": 0.16, "stroke": color}
                if aperture is not middle:
                    look = {"fill": "none", "stroke": color, "stroke_dasharray": "5 4", "stroke_opacity": 0.7}
                self.add("polygon", self.space, points=points, **look)
        if self.scene.frustum.screen is not None:
            screen, axis = self.scene.frustum.screen, self.view.axis
            ends = [screen.center[axis] + side * screen.size[axis] / 2 for side in (-1, 1)]
            self._upright(screen.height, ends[0], ends[1], stroke="#00785a", stroke_width=3)
            self.legend.append(("screen", "projection screen"))

    def _objects(self) -> None:
        """Draw the outlines of the objects; remember those that lie outside the picture."""
        for number, part in enumerate(self.scene.objects):
            color = OBJECT_COLORS[min(number, len(OBJECT_COLORS) - 1)]
            shapes = outlines(part, self.frame, self.view)
            if not shapes:
                self.away.append((number, color))
                continue
            path = "".join(_path(outline) for outline in shapes)
            self.add(
                "path",
                self.space,
                d=path,
                transform=f"translate({LEFT:g} {TOP:g})",
                fill=color,
                fill_opacity=0.45,
                fill_rule="evenodd",
                stroke=color,
                stroke_width=1,
            )
            points = np.concatenate([np.array(outline) for outline in shapes])
            low, high = points.min(axis=0), points.max(axis=0)
            x, y = (low + high) / 2 + (LEFT, TOP)
            if max(high - low) < SMALL_PX:
                self.add("circle", cx=x, cy=y, r=9, fill="none", stroke=color, stroke_width=1.5)

    def _point_at(self, number: int, color: str, place: int) -> None:
        """Name an object outside the picture, with an arrow at the border that it lies behind."""
        part = self.scene.objects[number]
        low, high = box(part)
        left, bottom, right, top = self.frame.box
        axis = self.view.axis
        middle = [(low[2] + high[2]) / 2, (low[axis] + high[axis]) / 2]
        # Where the line from the picture's middle to the object leaves the picture.
        center, half = ((left + right) / 2, (bottom + top) / 2), ((right - left) / 2, (top - bottom) / 2)
        way = middle[0] - center[0], middle[1] - center[1]
        out = max(abs(way[0]) / half[0], abs(way[1]) / half[1], 1e-30)
        x = self.frame.x(center[0] + way[0] / out)
        y = self.frame.y(center[1] + way[1] / out)
        angle = float(np.degrees(np.arctan2(-way[1], way[0])))
        self.add(
            "path", d="M0 0l-22 0m22 0l-9 -6m9 6l-9 6", fill="none", stroke=color, stroke_width=2.5,
            transform=f"translate({x:.1f} {y:.1f}) rotate({angle:.1f})",
        )  # fmt: skip
        words = [
            f"{number} {Path(part.name).name}",
            heights(low[2], high[2], self.scene.units),
            f"{'xy'[axis]} {_signed_range(low[axis], high[axis])} {self.scene.units}",
        ]
        text_x = min(max(x, LEFT + 30), LEFT + WIDTH - 30)
        anchor = "start" if x < LEFT + WIDTH / 3 else "end" if x > LEFT + 2 * WIDTH / 3 else "middle"
        text_y = min(max(y + 22 + 48 * place, TOP + 40), TOP + HEIGHT - 40)
        for line, word in enumerate(words):
            self.label(text_x, text_y + 14 * line, word, fill=color, text_anchor=anchor)

    def _reach_and_plate(self) -> None:
        toward, back = self.scene.frustum.reach
        plate = self.scene.plate.size[self.view.axis] / 2
        top = self.frame.box[3]
        for end in (-back, toward):
            self._upright(end, self.frame.box[1], top, stroke=SOFT, stroke_dasharray="2 3", stroke_width=1.5)
        self._upright(0.0, -plate, plate, stroke=INK, stroke_width=4)
        labels = [(-back, f"reach {length(back)}"), (0.0, "plate"), (toward, f"reach {length(toward)}")]
        places = _spread([(self.frame.x(z), CHARACTER * len(words)) for z, words in labels])
        for (_, words), x in zip(labels, places, strict=True):
            weight = 600 if words == "plate" else 400
            self.label(x, TOP - 6, words, text_anchor="middle", font_weight=weight)

    def _upright(self, z: float, low: float, high: float, **look: object) -> None:
        x = f"{self.frame.x(z):.1f}"
        path = f"M{x} {self.frame.y(low):.1f}L{x} {self.frame.y(high):.1f}"
        self.add("path", self.space, d=path, **look)

    def _viewer(self) -> None:
        """Draw an eye beside the picture, where the viewer is, and the way the viewer looks."""
        x, y = LEFT + WIDTH + 44, TOP + HEIGHT / 2
        self.add(
            "path", d=f"M{x - 16} {y}q16 -15 32 0q-16 15 -32 0z", fill=PAPER, stroke=INK, stroke_width=1.6
        )
        self.add("circle", cx=x - 3, cy=y, r=5, fill=INK)
        self.add("path", d=f"M{x - 20} {y}h-16m0 0l7 -5m-7 5l7 5", fill="none", stroke=INK, stroke_width=1.6)
        self.label(x, y + 28, "viewer", text_anchor="middle", font_weight=600)

    def _legend(self) -> None:
        entries = [("middle", "frustum of the middle aperture"), ("corner", "frusta of two corner apertures")]
        if len(shown_apertures(self.scene)) == 1:
            entries.pop()
        entries += [*self.legend, ("reach", f"reach, {self.scene.units}")]
        for number, part in enumerate(self.scene.objects[: len(OBJECT_COLORS)]):
            entries.append((OBJECT_COLORS[number], f"{number} {_short(Path(part.name).name)}"))
        more = len(self.scene.objects) - len(OBJECT_COLORS)
        if more > 0:
            entries[-1] = (OBJECT_COLORS[-1], f"{len(OBJECT_COLORS) - 1} and {more} more objects")
        x, y = LEFT, TOP + HEIGHT + 62
        for key, words in entries:
            width = 34 + CHARACTER * len(words) + 18
            if x + width > PICTURE_WIDTH and x > LEFT:
                x, y = LEFT, y + LINE
            self._key(key, x, y)
            self.label(x + 32, y, words)
            x += width
        height = y + 16
        self.root.set("viewBox", f"0 0 {PICTURE_WIDTH} {height:g}")
        self.root.set("width", str(PICTURE_WIDTH))
        self.root.set("height", f"{height:g}")
        self.paper.set("width", str(PICTURE_WIDTH))
        self.paper.set("height", f"{height:g}")

    def _key(self, key: str, x: float, y: float) -> None:
        """Draw what an entry of the legend explains."""
        if key in ("middle", "corner"):
            filled, dash = (0.16, "none") if key == "middle" else (0.0, "2 2")
            for color, way in ((C_COLOR, -12), (C_STAR_COLOR, 12)):
                path = f"M{x + 12} {y - 4}l{way} -6v12z"
                self.add("path", d=path, fill=color, fill_opacity=filled, stroke=color, stroke_dasharray=dash)
        elif key == "screen":
            self.add("path", d=f"M{x} {y - 4}h24", stroke="#00785a", stroke_width=3)
        elif key == "reach":
            self.add("path", d=f"M{x} {y - 4}h24", stroke=SOFT, stroke_dasharray="2 3", stroke_width=1.5)
        else:
            self.add("rect", x=x, y=y - 10, width=24, height=12, fill=key, fill_opacity=0.45, stroke=key)


def _attributes(**given: object) -> dict[str, str]:
    """Return attributes as SVG spells them."""
    return {
        name.replace("_", "-"): f"{value:.6g}" if isinstance(value, float) else str(value)
        for name, value in given.items()
    }


def _path(outline: Outline) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in outline) + "Z"


def _ticks(low: float, high: float) -> list[float]:
    """Return some five round numbers between two."""
    rough = (high - low) / 5
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough)
    return [float(step * k) for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]


def _spread(labels: list[tuple[float, float]]) -> list[float]:
    """Move labels, (middle, width) in ascending order, apart until none overlaps the next."""
    places = [x for x, _ in labels]
    half = len(labels) // 2
    for k in range(half + 1, len(labels)):
        places[k] = max(places[k], places[k - 1] + (labels[k - 1][1] + labels[k][1]) / 2 + 8)
    for k in range(half - 1, -1, -1):
        places[k] = min(places[k], places[k + 1] - (labels[k + 1][1] + labels[k][1]) / 2 - 8)
    return places


def _signed(value: float) -> str:
    """Write a coordinate with a real minus sign."""
    return ("\N{MINUS SIGN}" if value < 0 else "") + length(abs(value))


def _signed_range(low: float, high: float) -> str:
    return _signed(low) if _signed(low) == _signed(high) else f"{_signed(low)} to {_signed(high)}"


def _short(name: str, most: int = 32) -> str:
    return name if len(name) <= most else f"{name[: most - 1]}\N{HORIZONTAL ELLIPSIS}"


def _printable(words: str) -> str:
    """Replace what XML cannot hold: file names may contain control characters."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in words)
