"""Pixels whose true surface is turned away from the viewer: what culling loses of open meshes."""

from __future__ import annotations

import numpy as np

from xfrustum.compare.metrics.film import true_lines
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import Cull


def turned_away(truth: HogelImage) -> Mask:
    """Return the pixels (H, W) whose true surface shows its back: its normal points away from the viewer.

    With culling such a pixel shows nothing, or what lies behind that surface: the wrong surface either way.

    Parameters
    ----------
    truth
        True image with normals.
    """
    assert truth.normal is not None, "the reference gives normals"
    directions = true_lines(truth.camera).directions()
    with np.errstate(invalid="ignore"):
        return np.asarray(np.einsum("hwi,hwi->hw", truth.normal, directions) > 0)


def culled_pixels(truth: HogelImage, raster: HogelImage) -> Mask | None:
    """Return the pixels (H, W) whose true surface the raster's cameras leave out; None where nothing is."""
    settings = raster.camera.settings
    if settings is None or settings.cull is Cull.NONE or truth.normal is None:
        return None
    return turned_away(truth)
