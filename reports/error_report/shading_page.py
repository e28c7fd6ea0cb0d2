"""What the page of a report shows of a shaded scene, and nothing for others."""

from __future__ import annotations

import base64
import json
from typing import Any

import plotly.graph_objects as go

from xfrustum.compare.metrics.perceptual import PIXELS_PER_DEGREE
from xfrustum.reports.error_report import images, shading_figures
from xfrustum.reports.error_report.shading import ShadingReport, milliseconds
from xfrustum.reports.measurements.measurement import Sweep
from xfrustum.scenes.plate.plate import Aperture


def context(shading: ShadingReport | None) -> dict[str, Any] | None:
    """Return what the page's parts about light are written with; None where the scene is not shaded."""
    if shading is None:
        return None
    return {
        "report": shading,
        "sentences": list(shading.sentences()),
        "milliseconds": milliseconds,
        "radiance_colors": images.radiance_scale(),
        "radiance_range": images.RADIANCE_RANGE,
        "pixels_per_degree": PIXELS_PER_DEGREE,
        "missed": [
            {
                **part.numbers,
                "aperture": part.aperture,
                "pictures": [_uri(part.picture), _uri(part.difference)],
            }
            for part in shading.missed
        ],
    }


def curves(shading: ShadingReport | None, sweep: Sweep, aperture: Aperture) -> dict[str, go.Figure]:
    """Return the further figures of an aperture, by name."""
    return {} if shading is None else shading_figures.curves(sweep, aperture)


def eye_figure(shading: ShadingReport | None) -> dict[str, Any] | None:
    """Return the figure of the bent eye vector for the page's script; None where there is none."""
    if shading is None or not shading.eye:
        return None
    figure = shading_figures.eye_figure(shading.eye, shading.scene.frustum.longest_reach)
    ready: dict[str, Any] = json.loads(figure.to_json())
    return ready


def _uri(encoded: bytes) -> str:
    return f"data:{images.media_type(encoded)};base64,{base64.b64encode(encoded).decode()}"
