"""What a comparison says of itself: in words, in a table, in pictures, and as labelled arrays."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from xfrustum.compare.metrics.comparison import Comparison, ComparisonNumbers, Share
from xfrustum.compare.metrics.displacement import lengths
from xfrustum.scenes.arrays import Bytes
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.notebook.labels import NO_UNIT, Labelled, dataset
from xfrustum.scenes.notebook.numbers import digits, percent
from xfrustum.scenes.notebook.pictures import as_shown, marked, png
from xfrustum.scenes.notebook.shown import Figure, Table

if TYPE_CHECKING:
    import xarray

MOVED_PX = 1.0
"""Displacement from which on a map is in full color: a neighboring pixel shows what this one should."""


def said_of_comparison(found: Comparison) -> str:
    """Return whose image was compared, and its errors in a line."""
    camera = found.errors.truth.camera
    column, row = camera.aperture.index
    return (
        f"{found.errors.raster.camera.renderer} against the truth, aperture {column},{row} of "
        f"{camera.scene or 'a scene'!r}; of {found.judged:,} judged pixels {', '.join(_errors(found))}"
    )


def said_of_numbers(found: ComparisonNumbers) -> str:
    """Return the errors of an image in a line."""
    return f"of {found.judged:,} judged pixels {', '.join(_errors(found))}"


def _errors(found: ComparisonNumbers) -> Iterator[str]:
    yield (
        "unknown show the wrong surface"
        if found.surface is None
        else (f"{_share(found.surface)} show the wrong surface")
    )
    if found.triangle is not None:
        yield f"{_share(found.triangle)} another triangle"
    if found.displacement_px is not None:
        spread = found.displacement_px
        yield f"99 of 100 surface points within {digits(spread.p99)} px, all within {digits(spread.max)} px"


def _share(share: Share) -> str:
    return f"{share.wrong:,} ({percent(share.fraction)})"


def table_of_numbers(found: ComparisonNumbers) -> Table:
    """Return the numbers of a comparison."""
    rows = [
        ("pixels", f"{found.pixels:,}; {found.judged:,} are judged, {found.covered:,} show a surface"),
        ("certainty of the truth", ", ".join(f"{n:,} {name}" for name, n in found.certainty.items() if n)),
    ]
    if found.surface is not None:
        rows.append(("wrong surface", f"{_share(found.surface)}, {found.surface.outside:,} outside the film"))
    if found.triangle is not None:
        rows.append(("another triangle", _share(found.triangle)))
    if found.displacement_px is not None:
        spread = found.displacement_px
        numbers = f"rms {digits(spread.rms)}, 50 % {digits(spread.p50)}, 95 % {digits(spread.p95)}"
        rows.append(("displacement, px", f"{numbers}, 99 % {digits(spread.p99)}, max {digits(spread.max)}"))
    if found.height is not None:
        rows.append(
            ("height, scene units", f"rms {digits(found.height.rms)}, max {digits(found.height.max)}")
        )
    if found.radiance is not None:
        rows.append(("radiance", f"rms {digits(found.radiance.rms)}, max {digits(found.radiance.max)}"))
    return Table(rows=rows)


def figures(found: Comparison) -> Iterator[Figure]:
    """Yield the errors on the dimmed image, the truth, and the image."""
    truth, drawn = found.errors.truth, found.errors.raster
    picture = as_shown(drawn.color, drawn.covered, drawn.height)
    moved = lengths(found.maps.displacement) / MOVED_PX
    yield Figure(
        caption=f"wrong surfaces red, displacement blue (full at {digits(MOVED_PX)} px)",
        content=png(marked(picture, found.maps.surface, moved)),
    )
    yield Figure(caption="truth", content=png(_picture(truth)))
    yield Figure(caption="image", content=png(picture))


def _picture(image: HogelImage) -> Bytes:
    return as_shown(image.color, image.covered, image.height)


def labelled(found: Comparison, units: str) -> xarray.Dataset:
    """Return the errors as labelled arrays; see `Comparison.to_xarray`."""
    maps, camera = found.maps, found.errors.truth.camera
    columns, rows = maps.displacement[..., 0], maps.displacement[..., 1]
    images = {
        "judged": Labelled(values=maps.judged, meaning="whether the truth is no tie"),
        "surface": None if maps.surface is None else Labelled(
            values=maps.surface, meaning="whether the wrong surface is shown"
        ),
        "triangle": Labelled(values=maps.triangle, meaning="whether another triangle is shown"),
        "displacement_columns": Labelled(
            values=columns, meaning="true minus drawn place, to the right", units="px"
        ),
        "displacement_rows": Labelled(values=rows, meaning="true minus drawn place, down", units="px"),
        "height_error": Labelled(values=maps.height, meaning="height, image minus truth", units=units),
        "radiance_error": None if maps.radiance is None else Labelled(
            values=maps.radiance, meaning="linear radiance, image minus truth", units=NO_UNIT
        ),
    }  # fmt: skip
    attributes = {
        "aperture": list(camera.aperture.index),
        "scene": camera.scene,
        "scene_hash": camera.scene_hash,
        "truth": camera.renderer,
        "image": found.errors.raster.camera.renderer,
    }
    return dataset(images, {}, attributes)
