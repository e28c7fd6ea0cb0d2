"""Other layouts in which the files of a plate may be meant, where they are wrong in the stated one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.judging.judged import judge
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.compare.renderer_model.pictures import shown_points
from xfrustum.reports.verification.sources import LaidOut, Problem, Source, shape_of
from xfrustum.reports.verification.verdict import Verification
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.layouts import (
    CUBEVI_TILES,
    LAYOUTS,
    Index,
    Layout,
    Pixels,
    PlateShape,
    tiled_views,
)
from xfrustum.scenes.files.plate_files import FileSet, find_files

CONVENTIONAL_FAULTS = {"orientation", "aperture-order", "shift-x", "shift-y", "view-shear"}
"""Faults that files in the right layout have too: where these alone explain the images, it is not doubted."""

MAX_TRIED_HOGELS = 9
"""Largest number of hogels by which another reading is tried."""

MAX_WRONG_IN_RIGHT_READING = 0.1
"""Largest share of wrong pixels under which another reading counts as right: a tenth, as for all that must
explain what is wrong (`compare.diagnosis.evidence`)."""

NOMINAL = DrawnModel()
"""Model of a renderer without any fault."""


def with_layout_named(
    found: Verification, source: Source, verified: Callable[[Source], Verification]
) -> Verification:
    """Return a verification that names the layout of the files if it is another than the stated one.

    The layout is then a fault, and the corrected figures are those of the other reading.
    """
    named = {fault.fault for fault in found.diagnosis.faults}
    if not isinstance(source, LaidOut) or found.passed or (named and named <= CONVENTIONAL_FAULTS):
        return found
    others = (replace(source, files=files) for files in other_readings(source.files, shape_of(found.scene)))
    right = next((one for one in others if _is_right(one, found)), None)
    if right is None:
        return found
    other = verified(right)
    before = sum(hogel.as_found.wrong for hogel in found.hogels if hogel.as_found is not None)
    after = sum(hogel.corrected.wrong for hogel in other.hogels if hogel.corrected is not None)
    fault = Fault(
        fault="layout",
        value=right.files.layout.name,
        words=f"files were read as {source.files.layout.words}, and hold {right.files.layout.words}",
        explains=max(0.0, 1.0 - after / before) if before else None,
    )
    corrected = {hogel.aperture: hogel.corrected for hogel in other.hogels}
    return replace(
        found,
        diagnosis=replace(other.diagnosis, faults=(fault, *other.diagnosis.faults), does_not_explain=()),
        hogels=tuple(replace(hogel, corrected=corrected[hogel.aperture]) for hogel in found.hogels),
    )


def other_readings(stated: FileSet, told: PlateShape) -> Iterator[FileSet]:
    """Yield other layouts in which the same files form the plate that is told."""
    for layout in (*LAYOUTS, *(other for each in LAYOUTS for other in mistaken(each))):
        if layout == stated.layout:
            continue
        try:
            found = find_files(stated.place, told, (layout,))
        except InputError:
            continue
        if found.shape == told and not found.missing:
            yield found


def mistaken(layout: Layout) -> tuple[Layout, ...]:
    """Return what others take for a layout: numbers in the other order, and views from the other side."""
    numbers = layout.stated if layout.name == "quilt" else tuple(layout.numbers)
    exchanged: tuple[Layout, ...] = ()
    if len(numbers) == 2:
        first, second = numbers
        pattern = layout.pattern.replace(f"<{first}>", "<swapped>").replace(f"<{second}>", f"<{first}>")
        words = layout.words.replace("columns x rows", "rows x columns")
        if words == layout.words:
            words = f"{words}, with the two numbers of its names exchanged"
        exchanged = (replace(layout, pattern=pattern.replace("<swapped>", f"<{second}>"), words=words),)
    if layout.name == "quilt":
        return (*exchanged, *(_other_side(one, downward=True) for one in (layout, *exchanged)))
    return (_other_side(layout, downward=False),) if layout.name == "cubevi" else exchanged


def _other_side(layout: Layout, *, downward: bool) -> Layout:
    """Return a layout of tiles whose view 0 lies at the top left, or at the bottom left."""

    def view(pixels: Pixels, _: Index, tiles: Index) -> Pixels:
        return tiled_views(pixels, tiles or CUBEVI_TILES, downward=downward)

    before, after = ("bottom left", "top left") if downward else ("top left", "bottom left")
    return replace(layout, view=view, words=layout.words.replace(before, after))


def _is_right(source: LaidOut, found: Verification) -> bool:
    """Return whether nearly all claims of a few hogels in another reading hold, whatever the other faults."""
    reference, wrong, shown = source.reference, 0, 0
    hogels = found.hogels[:: max(1, len(found.hogels) // MAX_TRIED_HOGELS)]
    for hogel in hogels[:MAX_TRIED_HOGELS]:
        try:
            image = source.image(hogel.aperture)
        except Problem:
            return False
        points = shown_points(reference.scene, NOMINAL, image)
        figures = judge(reference, NOMINAL, image, points, found.limits.judging, explained=False)
        wrong, shown = wrong + figures.numbers.limited, shown + figures.numbers.shown
    return wrong <= MAX_WRONG_IN_RIGHT_READING * shown
