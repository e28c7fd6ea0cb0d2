"""The curves of a shaded scene: radiance error and FLIP against near, and the bent eye vector's share."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go

from xfrustum.reports.error_report import figures
from xfrustum.reports.error_report.shading import EyeError
from xfrustum.reports.measurements.measurement import Measurement


def curves(rows: Sequence[tuple[int, Measurement]], reach: float) -> dict[str, go.Figure]:
    """Return the figures of one aperture and geometry that `figures.curves` lacks, by name."""

    def rms(row: Measurement) -> float | None:
        error = row.comparison.radiance
        return None if error is None else error.rms or None

    def flip(row: Measurement) -> float | None:
        error = row.comparison.radiance
        return None if error is None else error.flip or None

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
