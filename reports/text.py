"""Sentences and aligned lines for the codes and records of `compare`, `reference` and `scenes`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from xfrustum.compare.metrics.comparison import ComparisonNumbers, Share
from xfrustum.compare.prediction.reasons import MIN_PIXELS, Reason, Reasons
from xfrustum.scenes import Scene
from xfrustum.scenes.model.images import Certainty
from xfrustum.scenes.representation import counted, digits, percent, plain, sides

if TYPE_CHECKING:
    # Only for their types: these modules load tracers and rasterizer.
    from xfrustum.compare.run import JudgedDrawing
    from xfrustum.compare.selfcheck.selfcheck import SelfCheck, ViewCheck

SENTENCES = {
    Reason.CROSSES: "not predicted: surfaces cross the plate",
    Reason.STARVED: "the depth buffer shows other surfaces than the displaced ones",
    Reason.ROUNDED: "smaller than the rounding of float32 positions",
    Reason.LARGE: (
        "triangles are far larger than the plate: "
        "float32 rounds their depth by more than is predicted"
    ),
    Reason.PARALLEL: (
        "surfaces are parallel to the plate: the depth of all their pixels is rounded alike"
    ),
    Reason.FEW: f"fewer than {MIN_PIXELS} pixels are predicted: chance decides",
    Reason.OUTSIDE: "points from outside the film are shown; the truth does not have them",
    Reason.STEPS: "all depths lie within two steps below one: float32 rounds many pixels alike",
    Reason.ALIGNED: (
        "edges run along rows or columns: all pixels beside an edge become wrong together"
    ),
    Reason.THIN: "surfaces are thinner than a pixel: the truth shows only a part of their contours",
}


def sentences(reasons: Reasons) -> Reasons:
    """Return reasons as sentences."""
    words = {name: reason and SENTENCES[Reason(reason)] for name, reason in vars(reasons).items()}
    return Reasons(**words)


DISPLACEMENT_TIE_PX = 1e-3
"""Displacements that differ by less count as equal, because 32-bit surface positions measure
displacement no better (99 % of pixels within 1e-3 px on meshes)."""

CERTAINTY_LABELS = {
    Certainty.PROVEN: "proven in floating point",
    Certainty.EXACT: "decided in rational arithmetic",
    Certainty.TIE: "tie, not judged",
    Certainty.UNEXAMINED: "not examined",
}
"""Meanings of the values of `certainty`."""


def displacement_words(displacement_p99_px: float) -> str:
    """Return the displacement of 99 % of a picture as a clause."""
    if math.isinf(displacement_p99_px):
        return (
            "where the picture belongs is undefined, "
            "for much of it shows a surface in the plate itself"
        )
    return f"99 % of the picture lies within {pixels(displacement_p99_px)} of where it belongs"


def pixels(value: float) -> str:
    """Write a displacement with two digits, at least `DISPLACEMENT_TIE_PX`."""
    # Round first, so that 99.6 is printed as 100, like other large values.
    rounded = float(f"{max(value, DISPLACEMENT_TIE_PX):.2g}")
    return f"{rounded:,.0f} px" if rounded >= 100 else plain(f"{rounded:.2g} px")


def aligned(rows: Sequence[Sequence[str]], others: Callable[[str, int], str] = str.rjust) -> str:
    """Return rows of cells as lines: the first column left-aligned, other columns by `others`."""
    first, *rest = [max(map(len, column)) for column in zip(*rows, strict=True)]
    # Align names to the left, and numbers to the right by default.
    cells = ([row[0].ljust(first), *map(others, row[1:], rest)] for row in rows)
    return "\n".join("  ".join(line).rstrip() for line in cells)


def scene_line(scene: Scene) -> str:
    """Return plate, film, reach and contents of a scene in a line."""
    toward, back = map(digits, scene.frustum.reach)
    screen, fov, units = scene.frustum.screen, scene.frustum.fov, scene.units
    if screen is not None:
        size, height = sides(screen.size), digits(screen.height)
        lines = f"recentered on a screen of {size} {units} at height {height} {units}"
    else:
        lines = f"each {sides(math.degrees(angle) for angle in fov or ())} degrees"
    triangles = sum(len(part.faces) for part in scene.objects)
    plate = scene.plate
    return (
        f"{scene.name!r}, a plate of {sides(plate.size)} {units} with {sides(plate.hogels)} "
        f"hogels of {sides(scene.frustum.resolution)} pixels, {lines}, "
        f"reach {toward} {units} toward the viewer and {back} {units} behind; "
        f"{counted(len(scene.objects), 'object')}, {counted(triangles, 'triangle')}"
    )


def _share(share: Share | None) -> str:
    return "not known" if share is None else f"{share.wrong:,} ({percent(share.fraction)})"


def comparison_line(numbers: ComparisonNumbers) -> str:
    """Return the errors of an image in a line."""
    parts = [
        "an unknown number show the wrong surface"
        if numbers.surface is None
        else f"{_share(numbers.surface)} show the wrong surface"
    ]
    if numbers.triangle is not None:
        parts.append(f"{_share(numbers.triangle)} another triangle")
    if spread := numbers.displacement_px:
        p99, most = digits(spread.p99), digits(spread.max)
        parts.append(f"99 of 100 surface points within {p99} px, all within {most} px")
    return f"of {numbers.judged:,} judged pixels {', '.join(parts)}"


def drawing_line(drawing: JudgedDrawing) -> str:
    """Return settings and errors of a judged drawing in a line."""
    near, depth = drawing.settings.near, drawing.settings.depth_label
    return f"near {near:.3g} scene units, {depth}: {comparison_line(drawing.comparison)}"


def comparison_table(numbers: ComparisonNumbers) -> str:
    """Return the numbers of a comparison as aligned lines."""
    surface, color = numbers.surface, numbers.radiance

    def named(group: object, names: str) -> str:
        """Write some numbers of a group, each after its name."""
        if group is None:
            return "not defined"
        return "  ".join(f"{name} {getattr(group, name):.3g}" for name in names.split())

    lines = {
        "pixels": f"{numbers.pixels:,}",
        "judged": f"{numbers.judged:,}",
        "covered": f"{numbers.covered:,}",
        "wrong surface": _share(surface),
    }
    if surface is not None and surface.culled is not None:
        lines["  a face culled"] = f"{surface.culled:,}"
    lines |= {
        "another triangle": _share(numbers.triangle),
        "displacement, px": named(numbers.displacement_px, "rms p50 p95 p99 max"),
        "height error": named(numbers.height, "rms max"),
        "drawn in the plate": f"{numbers.at_plate:,}",
    }
    if color is not None:
        lines["radiance error"] = named(color, "mean rms p99 max")
        if color.away_from_edges is not None:
            lines["  in the same triangle"] = named(color.away_from_edges, "mean rms p99 max")
        if color.flip is not None:
            ssim = "not defined" if color.ssim is None else f"{color.ssim:.4g}"
            lines["looks different"] = f"FLIP {color.flip:.3g}  SSIM {ssim}"
        if color.noise is not None:
            lines["beyond noise, 1/255"] = f"{color.noise.differ:,} pixels"
    return aligned(list(lines.items()), str.ljust)


COUNTS = {name: name for name in ("pixels", "covered", "proven", "exact", "ties", "wrong")}
COUNTS["tracer_wrong"] = "float32 wrong"
"""Titles of the counts of a self-check."""


def selfcheck_table(check: SelfCheck) -> str:
    """Return a self-check as text: a row per scene, the sphere, every disagreement, the result."""
    of_scene: dict[str, list[ViewCheck]] = {}
    for view in check.views:
        of_scene.setdefault(view.scene, []).append(view)
    rows = [("scene", "apertures", *COUNTS.values())]
    for name, group in (*of_scene.items(), ("all", list(check.views))):
        sums = (sum(getattr(view, count) for view in group) for count in COUNTS)
        rows.append((name, str(len(group)), *(f"{n:,}" for n in sums)))
    lines = [aligned(rows)]
    if sphere := check.sphere:
        lines.append(
            f"sphere of {sphere.triangles:,} triangles, lines from its center: "
            f"{sphere.vertices:,} vertices, "
            f"{sphere.vertex_misses:,} missed (float32 {sphere.tracer_vertex_misses:,}); "
            f"{sphere.edges:,} edges, "
            f"{sphere.edge_misses:,} missed (float32 {sphere.tracer_edge_misses:,}); "
            f"{sphere.wrong:,} wrong"
        )
    pixels, still_open, differing, wrong = (
        sum(getattr(each, count) for each in check.directions)
        for count in ("pixels", "open", "differing", "wrong")
    )
    lines += [
        f"by direction: {pixels:,} pixels of {sum(each.directions for each in check.directions):,} "
        f"images, {still_open:,} not proven, {differing:,} unlike pixels of hogels, {wrong:,} wrong"
    ]
    lines += [
        f"{each.scene} by direction: hogel column {each.columns[0] + at.column}, "
        f"row {each.rows[0] + at.row}, {at.about}: expected {at.expected}, got {at.got}"
        for each in check.directions
        for at in each.disagreements
    ]
    lines += [
        f"{view.scene} {view.aperture[0]},{view.aperture[1]}: column {at.column}, row {at.row}, "
        f"{at.about}: expected {at.expected}, got {at.got}"
        for view in check.views
        for at in view.disagreements
    ]
    result = "agree" if check.agrees else "DISAGREE"
    pixels = f"{check.total('pixels'):,} pixels"
    return "\n".join(
        [*lines, f"reference and integers {result} on {pixels} ({check.seconds:.0f} s)"]
    )
