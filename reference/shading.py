"""The default light on true hits, in double precision, with the true eye vector and no flips."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.light import DEFAULT_LIGHT


def shaded(normals: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return linear RGB of surfaces with given normals, (..., 3), black where they are NaN.

    Parameters
    ----------
    normals
        (..., 3) unit normals by the mesh's winding; lighting is two-sided, so that the side
        turned to the viewer is lit, whichever it is.
    directions
        (..., 3) d of each line, from the viewer to the back: the eye vector is -d.
    """
    away = np.einsum("...i,...i->...", normals, directions) > 0
    cosine = np.where(away, -1.0, 1.0) * (normals @ np.asarray(DEFAULT_LIGHT.direction))
    lambert = DEFAULT_LIGHT.ambient + (1 - DEFAULT_LIGHT.ambient) * np.maximum(cosine, 0.0)
    gray = np.nan_to_num(DEFAULT_LIGHT.albedo * lambert, nan=0.0).astype(np.float32)
    return np.repeat(gray[..., None], 3, axis=-1)
