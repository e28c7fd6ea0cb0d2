"""Truth of one aperture to a file, in the memory of a band, whatever the image's size."""

from __future__ import annotations

from pathlib import Path

from xfrustum.reference import Reference
from xfrustum.reports.progress import progress_bar
from xfrustum.scenes.exr import ImageWriter
from xfrustum.scenes.plate import Aperture


def trace_to_file(
    reference: Reference, aperture: Aperture, path: str | Path, *, progress: bool = False
) -> None:
    """Trace the truth of an aperture and write it as EXR while it is being traced.

    Parameters
    ----------
    reference
        Of the scene.
    aperture
        Which one.
    path
        The file; it appears complete, or not at all.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    height = reference.scene.frustum.resolution[1]
    camera, rendering = reference.camera(aperture), reference.rendering()
    with (
        ImageWriter(path, camera, normals=True, color=True, certainty=True, rendering=rendering) as writer,
        progress_bar(height, "trace", "row", shown=progress) as bar,
    ):
        row = 0
        for band in reference.trace_bands(aperture):
            writer.write_rows(row, band)
            row += len(band.triangle)
            bar.update(len(band.triangle))
