"""Layouts in which files may be meant, where they are wrong in the stated one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

from xfrustum.compare.diagnosis.defects import Defect
from xfrustum.compare.judging.judged import judge
from xfrustum.compare.judging.verdict import Hogel
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.compare.renderer_model.pictures import shown_points
from xfrustum.reports.verification import sources
from xfrustum.reports.verification.verdict import Verification
from xfrustum.scenes import InputError
from xfrustum.scenes.files import layouts
from xfrustum.scenes.files.plate_files import FileSet, find_files

# Name of the defect.
LAYOUT = "layout"

CONVENTIONAL_FAULTS = {"orientation", "aperture-order", "shift-x", "shift-y", "view-shear"}
"""Defects of files in the right layout: where they alone explain, it is not doubted."""

#: largest number of hogels by which another reading is tried
MAX_TRIED_HOGELS = 9

MAX_WRONG_IN_RIGHT_READING = 0.1
"""Largest share of wrong pixels of a right layout (see `testset.MIN_EXPLAINED_FRACTION`)."""


def with_layout_named(
    verification: Verification,
    source: sources.Source,
    verified: Callable[[sources.Source], Verification],
) -> Verification:
    """Return a verification that names the layout of the files if another one is right.

    The layout is then a defect, and the corrected figures belong to the other reading.
    """
    named = {fault.fault for fault in verification.diagnosis.faults}
    if (
        not isinstance(source, sources.LaidOut)
        or verification.passed
        or (named and named <= CONVENTIONAL_FAULTS)
    ):
        return verification
    readings = other_readings(source.files, sources.shape_of(verification.scene))
    others = (replace(source, files=files) for files in readings)
    right = next((other for other in others if _is_right(other, verification)), None)
    if right is None:
        return verification
    other = verified(right)
    before = sum(
        hogel.as_found.wrong for hogel in verification.hogels if hogel.as_found is not None
    )
    after = sum(hogel.corrected.wrong for hogel in other.hogels if hogel.corrected is not None)
    fault = Defect(
        fault=LAYOUT,
        value=right.files.layout.name,
        stated=source.files.layout.meaning,
        details=(right.files.layout.meaning,),
        explains=max(0.0, 1.0 - after / before) if before else None,
    )
    corrected = {hogel.aperture: hogel for hogel in other.hogels}

    def mended(hogel: Hogel) -> Hogel:
        its = corrected[hogel.aperture]
        return replace(hogel, corrected=its.corrected, left=its.left, mended=its.mended)

    return replace(
        verification,
        diagnosis=replace(
            other.diagnosis, faults=(fault, *other.diagnosis.faults), does_not_explain=()
        ),
        hogels=tuple(map(mended, verification.hogels)),
    )


def other_readings(stated: FileSet, shape: layouts.PlateShape) -> Iterator[FileSet]:
    """Yield other layouts in which the same files form a plate of some shape."""
    for layout in (
        *layouts.LAYOUTS,
        *(other for each in layouts.LAYOUTS for other in mistaken(each)),
    ):
        with suppress(InputError):
            files = (
                find_files(stated.place, shape, (layout,)) if layout != stated.layout else stated
            )
            if files is not stated and files.shape == shape and not files.missing:
                yield files


def mistaken(layout: layouts.Layout) -> tuple[layouts.Layout, ...]:
    """Return layouts mistaken for one: exchanged numbers, views from the other side."""

    def other_side(view_layout: layouts.Layout) -> layouts.Layout:
        def view(pixels: layouts.Pixels, _: layouts.Index, tiles: layouts.Index) -> layouts.Pixels:
            return layouts.tiled_views(pixels, tiles, downward=True)

        return replace(
            view_layout, view=view, meaning=view_layout.meaning.replace("bottom left", "top left")
        )

    numbers = layout.stated if layout.name == "quilt" else tuple(layout.numbers)
    exchanged: tuple[layouts.Layout, ...] = ()
    if len(numbers) == 2:
        first, second = numbers
        pattern = layout.pattern.replace(f"<{first}>", "<swapped>").replace(
            f"<{second}>", f"<{first}>"
        )
        meaning = layout.meaning.replace("columns x rows", "rows x columns")
        if meaning == layout.meaning:
            meaning = f"{meaning}, with the two numbers of its names exchanged"
        exchanged = (
            replace(layout, pattern=pattern.replace("<swapped>", f"<{second}>"), meaning=meaning),
        )
    if layout.name == "quilt":
        return (*exchanged, *(other_side(entry) for entry in (layout, *exchanged)))
    return exchanged


def _is_right(source: sources.LaidOut, verification: Verification) -> bool:
    """Return whether nearly all pixels of a few hogels are right in another layout."""
    reference, nominal, wrong, shown = source.reference, RendererModel(), 0, 0
    for hogel in verification.hogels[:: max(1, len(verification.hogels) // MAX_TRIED_HOGELS)][
        :MAX_TRIED_HOGELS
    ]:
        try:
            image = source.image(hogel.aperture)
        except sources.Problem:
            return False
        points = shown_points(reference.scene, nominal, image)
        figures = judge(
            reference, nominal, image, points, verification.limits.judging, explained=False
        )
        wrong, shown = wrong + figures.numbers.limited, shown + figures.numbers.shown
    return wrong <= MAX_WRONG_IN_RIGHT_READING * shown
