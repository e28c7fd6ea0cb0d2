"""Truth of one aperture with light transport to a file: its color is a mean with a variance."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from xfrustum.compare.metrics.left_out import transported
from xfrustum.reference import Reference
from xfrustum.reports.common.progress import progress_bar
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.files.exr import write_image
from xfrustum.scenes.model.effects import ALL_EFFECTS
from xfrustum.scenes.model.rendering import Rendering
from xfrustum.scenes.plate.plate import Aperture


def trace_transported(
    reference: Reference, aperture: Aperture, path: str | Path, *, progress: bool = False
) -> None:
    """Trace the truth of an aperture and color it by light paths, as its scene asks; write it as EXR.

    Surfaces are those of the certified truth. The variance of the color goes into channels of its own, and
    the number of light paths into the camera.

    Parameters
    ----------
    reference
        Truth of the scene.
    aperture
        Aperture to be traced.
    path
        The file; it appears complete, or not at all.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    scene = reference.scene
    with progress_bar(1 + scene.sampling.aperture, "trace", "image", shown=progress) as bar:
        image = reference.trace(aperture, Sampling())
        bar.update()
        estimate = transported(scene, aperture, scene.transport, done=bar.update)
    camera = replace(image.camera, light_paths=estimate.samples, renderer="reference, colored by Mitsuba")
    color, variance = estimate.mean.astype(np.float32), estimate.variance_of_mean.astype(np.float32)
    rendering = Rendering.of(ALL_EFFECTS, scene.sampling, scene.transport)
    write_image(path, replace(image, camera=camera, color=color, variance=variance, rendering=rendering))
