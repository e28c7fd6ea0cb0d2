"""Draw the figures of docs/method.md as SVG: python scripts/draw_method_figures.py [FOLDER]."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from pathlib import Path

WIDTH, HEIGHT = 720, 300
INK, FAINT, BACK, FRONT, PLATE = "#333", "#999", "#0072b2", "#d55e00", "#000"
"""Okabe and Ito's blue for C, behind the plate, and vermilion for C*, before it."""

Point = tuple[float, float]


class Drawing:
    """An SVG document that is put together element by element.

    Parameters
    ----------
    scale
        Pixels for each unit of length.
    origin
        Where (0, 0) lies, pixels from the top left.
    """

    def __init__(self, scale: Point, origin: Point = (WIDTH / 2, HEIGHT / 2)) -> None:
        self._scale, self._origin = scale, origin
        self._elements: list[str] = []

    def _at(self, point: Point) -> Point:
        return (
            self._origin[0] + self._scale[0] * point[0],
            self._origin[1] - self._scale[1] * point[1],
        )

    def line(
        self, points: Iterable[Point], color: str = INK, width: float = 1.5, dash: str = ""
    ) -> None:
        """Draw a line through some points."""
        path = " ".join(f"{x:.2f},{y:.2f}" for x, y in map(self._at, points))
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self._elements.append(
            f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="{width}"{dashed}/>'
        )

    def area(self, points: Iterable[Point], color: str, opacity: float = 0.15) -> None:
        """Fill a polygon, faintly by default."""
        path = " ".join(f"{x:.2f},{y:.2f}" for x, y in map(self._at, points))
        self._elements.append(f'<polygon points="{path}" fill="{color}" fill-opacity="{opacity}"/>')

    def dot(self, point: Point, color: str = INK) -> None:
        """Mark a point."""
        x, y = self._at(point)
        self._elements.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="4" fill="{color}"/>')

    def text(
        self,
        point: Point,
        words: str,
        color: str = INK,
        anchor: str = "middle",
        shift: Point = (0, 0),
    ) -> None:
        """Write words at a point, shifted by some pixels."""
        x, y = self._at(point)
        self._elements.append(
            f'<text x="{x + shift[0]:.2f}" y="{y + shift[1]:.2f}" fill="{color}" '
            f'text-anchor="{anchor}">{words}</text>'
        )

    def document(self) -> str:
        """Return the whole document."""
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
            'font-family="sans-serif" font-size="14">\n'
            f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>\n'
            + "\n".join(self._elements)
            + "\n</svg>\n"
        )


REACH, SLOPE, TOP = 4.0, 0.5, 2.4
"""Reach to either side, half-extent of the frustum, half the height of the plate; units of the figures."""


def _plate(drawing: Drawing) -> None:
    """Draw the plate edge-on, with the viewer on the right: +z points there."""
    drawing.line([(0, -TOP), (0, TOP)], PLATE, 3)
    drawing.text((0, TOP), "plate, z = 0", PLATE, shift=(0, -8))
    drawing.text((REACH, -TOP), "viewer, z &gt; 0", FAINT, "end", (0, 14))
    drawing.text((-REACH, -TOP), "behind the plate, z &lt; 0", FAINT, "start", (0, 14))


def crossed_frustum() -> Drawing:
    """Return the lines of one aperture on both sides of the plate."""
    drawing = Drawing((75, 50))
    _plate(drawing)
    edge = REACH * SLOPE
    drawing.area([(0, 0), (-REACH, -edge), (-REACH, edge)], BACK)
    drawing.area([(0, 0), (REACH, -edge), (REACH, edge)], FRONT)
    for step in range(-4, 5):
        slope = SLOPE * step / 4
        drawing.line([(-REACH, -slope * REACH), (REACH, slope * REACH)], FAINT, 1)
    drawing.dot((0, 0))
    drawing.line([(0.05, -0.1), (0.3, -1.5)], INK, 1)
    drawing.text((0.3, -1.5), "aperture", shift=(2, 14), anchor="start")
    drawing.text((-REACH, 2.0), "nearest surface wins", BACK, "start", (4, -6))
    drawing.text((REACH, 2.0), "farthest surface wins", FRONT, "end", (-4, -6))
    return drawing


def two_cameras() -> Drawing:
    """Return C and C* with their common near plane."""
    drawing = Drawing((75, 50))
    near = 0.8
    _plate(drawing)
    for side, color, name in ((-1, BACK, "C"), (1, FRONT, "C*")):
        center = -side * near
        window, far = near * SLOPE, (REACH + near) * SLOPE
        drawing.area([(0, window), (side * REACH, far), (side * REACH, -far), (0, -window)], color)
        for sign in (-1, 1):
            drawing.line([(center, 0), (side * REACH, sign * far)], color, 1.5)
        drawing.dot((center, 0), color)
        drawing.text((center, 0), f"{name}", color, shift=(-side * 14, -10))
        drawing.line([(0, -0.55), (center, -0.55)], color, 1)
        drawing.text((center / 2, -0.55), "n", color, shift=(0, 16))
    return drawing


def near_offset() -> Drawing:
    """Return drawn over true film coordinate, |z|/(|z| + n), for some near offsets."""
    drawing = Drawing((140, 190), (80, 250))
    drawing.line([(0, 0), (4.2, 0)])
    drawing.line([(0, 0), (0, 1.1)])
    drawing.line([(0, 1), (4.2, 1)], FAINT, 1, "4 4")
    drawing.text((0, 1), "1", anchor="end", shift=(-8, 5))
    drawing.text((0, 0), "0", anchor="end", shift=(-8, 5))
    drawing.text((2.1, 0), "|z|, distance of the surface from the plate", shift=(0, 32))
    drawing.text((0, 1.1), "drawn u / true u", anchor="start", shift=(0, -10))
    for near, color in ((0.03, BACK), (0.3, "#009e73"), (1.0, FRONT)):
        depths = [4.0 * (step / 200) ** 2 for step in range(1, 201)]
        drawing.line([(z, z / (z + near)) for z in depths], color, 2)
        drawing.text(
            (4.0, 4.0 / (4.0 + near)), f"n = {near:g}", color, "start", (6, 5 if near > 0.1 else -6)
        )
    return drawing


def shear() -> Drawing:
    """Return the near windows of both cameras for both pivots."""
    drawing = Drawing((38, 50))
    near, slope = 1.4, 0.45
    for offset, pivot in ((-5.0, "aperture"), (5.0, "camera")):
        drawing.line([(offset, -TOP), (offset, TOP)], PLATE, 3)
        drawing.text((offset, TOP), f"pivot {pivot}", shift=(0, -8))
        for side, color in ((-1, BACK), (1, FRONT)):
            # C and C* see the same shear; about the aperture their centers move apart by 2 n k.
            start = side * near * slope if pivot == "aperture" else 0.0
            center = (offset - side * near, -start)
            middle = -start + side * slope * near
            half = near * 0.35
            drawing.line([center, (offset, middle + half)], color, 1)
            drawing.line([center, (offset, middle - half)], color, 1)
            drawing.line(
                [(offset + side * 0.12, middle - half), (offset + side * 0.12, middle + half)],
                color,
                5,
            )
            drawing.dot(center, color)
            drawing.text(center, "C" if side < 0 else "C*", color, shift=(-side * 16, 5))
    drawing.text((-5, -TOP), "the near windows coincide", FAINT, shift=(0, 16))
    drawing.text((5, -TOP), "they miss each other by 2 n k", FAINT, shift=(0, 16))
    return drawing


def slabs() -> Drawing:
    """Return two cuts on either side, the part of space that each slab draws, and the cameras' places."""
    drawing = Drawing((75, 50))
    near, cuts = 0.35, (0.9, 2.0, REACH)
    _plate(drawing)
    # Fitted to the first cut: the cameras of the first slab span there what the true frustum spans.
    fitted = SLOPE * cuts[0] / (cuts[0] + near)
    window, first = near * fitted, cuts[0] * SLOPE
    for side, color in ((-1, BACK), (1, FRONT)):
        drawing.area(
            [(0, window), (side * cuts[0], first), (side * cuts[0], -first), (0, -window)],
            color,
            0.45,
        )
        for begin, end in ((cuts[0], cuts[1]), (cuts[1], cuts[2])):
            corners = ((begin, begin), (end, end), (end, -end), (begin, -begin))
            drawing.area([(side * depth, SLOPE * aside) for depth, aside in corners], color)
        for cut in cuts[:-1]:
            drawing.line([(side * cut, -1.6), (side * cut, 1.6)], color, 1, "4 4")
        for sign in (-1, 1):
            drawing.line(
                [(side * cuts[0], sign * first), (side * REACH, sign * REACH * SLOPE)], color, 1.5
            )
            drawing.line([(0, 0), (side * cuts[0], sign * first)], FAINT, 1, "4 4")
        drawing.text((side * cuts[0], 1.6), "z1", color, shift=(0, -6))
        drawing.text((side * cuts[1], 1.6), "z2", color, shift=(0, -6))
    for side, color in ((-1, BACK), (1, FRONT)):
        for sign in (-1, 1):
            drawing.line([(-side * near, 0), (side * cuts[0], sign * first)], color, 1)
        drawing.dot((-side * near, 0), color)
    drawing.dot((0, 0))
    drawing.line([(-0.6, -0.15), (-1.15, -1.7)], INK, 1)
    drawing.line([(1.7, -0.4), (1.6, -1.7)], INK, 1)
    for middle, lines in (
        (-1.25, ("first slab: cameras", "stand n off the plate")),
        (1.55, ("other slabs: cameras", "stand in the aperture")),
    ):
        for number, words in enumerate(lines):
            drawing.text((middle, -1.7), words, shift=(0, 16 + 17 * number))
    return drawing


def moved_halves() -> Drawing:
    """Return one surface on each side of the plate, drawn by two apertures, and where a viewer sees it."""
    drawing = Drawing((75, 50))
    _plate(drawing)
    near = 0.7
    surfaces = {
        -1: [(-0.6, 0.9), (-1.6, 0.1), (-2.6, 0.5)],
        1: [(0.6, -0.6), (1.4, -1.0), (2.2, -0.2)],
    }
    apertures = (1.6, -1.3)
    for aperture in apertures:
        drawing.dot((0, aperture))
    for side, color in ((-1, BACK), (1, FRONT)):
        moved = [(z + side * near, x) for z, x in surfaces[side]]
        drawing.line(surfaces[side], FAINT, 3)
        drawing.line(moved, color, 3)
        (z, x), (moved_z, _) = surfaces[side][1], moved[1]
        drawing.dot((z, x), FAINT)
        drawing.dot((moved_z, x), color)
        for aperture in apertures:
            # Drawn with the slope (x - a) / (|z| + n), and replayed from the aperture itself.
            slope = (x - aperture) / abs(moved_z)
            drawing.line(
                [(0, aperture), (moved_z * 1.12, aperture + 1.12 * slope * abs(moved_z))], color, 1
            )
        drawing.line([(z, x), (moved_z, x)], INK, 1, "3 3")
        drawing.text(((z + moved_z) / 2, x), "n", shift=(0, 16))
    drawing.text((-2.6, 0.5), "true", FAINT, "end", (-4, -6))
    drawing.text((-2.6 - near, 0.5), "seen", BACK, "end", (-8, -2))
    drawing.text((2.2, -0.2), "true", FAINT, "end", (-4, -6))
    drawing.text((2.2 + near, -0.2), "seen", FRONT, "start", (8, 5))
    for aperture, name in zip(apertures, ("a", "a'"), strict=True):
        drawing.text((0, aperture), name, anchor="start", shift=(8, -6))
    return drawing


FIGURES: dict[str, Callable[[], Drawing]] = {
    "method-crossed-frustum.svg": crossed_frustum,
    "method-two-cameras.svg": two_cameras,
    "method-near-offset.svg": near_offset,
    "method-shear.svg": shear,
    "method-slabs.svg": slabs,
    "method-moved-halves.svg": moved_halves,
}


def main(folder: Path) -> None:
    """Write all figures into a folder."""
    for name, draw in FIGURES.items():
        (folder / name).write_text(draw().document(), encoding="utf-8")


if __name__ == "__main__":
    main(
        Path(sys.argv[1])
        if len(sys.argv) > 1
        else Path(__file__).resolve().parents[1] / "docs" / "images"
    )
