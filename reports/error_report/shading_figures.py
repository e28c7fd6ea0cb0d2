"""The curves of a shaded scene: radiance error and FLIP against near, and the bent eye vector's share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import plotly.graph_objects as go

from xfrustum.reports.error_report import figures
from xfrustum.reports.error_report.shading import EyeError
from xfrustum.reports.measurements.measurement import Measurement, Sweep
from xfrustum.scenes.plate.plate import Aperture


def curves(sweep: Sweep, aperture: Aperture) -> dict[str, go.Figure]:
    """Return the figures of one aperture that `figures.curves` lacks, by name; likewise with row numbers."""
    rows = [(i, row) for i, row in enumerate(sweep.rows) if row.aperture == aperture]
    reach = sweep.scene.frustum.longest_reach

    def rms(row: Measurement) -> float | None:
        return _of(row.comparison["radiance"], "rms")

    def flip(row: Measurement) -> float | None:
        return _of(row.comparison["radiance"], "flip")

    return {
        "radiance": figures.number_figure(rows, reach, rms, "rms radiance error, linear"),
        "flip": figures.number_figure(rows, reach, flip, "FLIP, mean over the picture"),
    }


def eye_figure(errors: Sequence[EyeError], reach: float) -> go.Figure:
    """Return what the bent eye vector costs against near, predicted and measured."""
    return figures.pair_figure(
        [error.near / reach for error in errors],
        [error.measured for error in errors],
        [error.predicted for error in errors],
        "rms change of radiance at the same surface points",
    )


def _of(radiance: Mapping[str, Any] | None, statistic: str) -> float | None:
    return None if radiance is None else radiance[statistic] or None
