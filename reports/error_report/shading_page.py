"""What the page of a report shows of a shaded scene, and nothing for others."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import plotly.graph_objects as go

from xfrustum.compare.metrics.left_out import LeftOutNumbers
from xfrustum.compare.metrics.perceptual import PIXELS_PER_DEGREE
from xfrustum.reports.error_report import figures, images
from xfrustum.reports.error_report.shading import ShadingReport
from xfrustum.reports.measurements.measurement import Measurement
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True)
class ShownLight:
    """The light that is missed in one aperture's image; `pictures` are data addresses, see `MissedLight`."""

    aperture: Aperture
    numbers: LeftOutNumbers
    pictures: tuple[str, str]


@dataclass(frozen=True, kw_only=True, eq=False)
class LightContext:
    """What the page's parts about light show.

    Attributes
    ----------
    report
        The measurements.
    sentences
        The measurements in words.
    missed
        Light that is missed, by aperture.
    """

    report: ShadingReport
    sentences: tuple[str, ...]
    missed: tuple[ShownLight, ...]
    radiance_colors: tuple[str, ...] = tuple(images.radiance_scale())
    radiance_range: tuple[float, float] = images.RADIANCE_RANGE
    pixels_per_degree: float = PIXELS_PER_DEGREE


def context(shading: ShadingReport | None) -> LightContext | None:
    """Return what the page's parts about light show; None where the scene is not shaded."""
    if shading is None:
        return None
    missed = [
        ShownLight(
            aperture=part.aperture,
            numbers=part.numbers,
            pictures=(_uri(part.picture), _uri(part.difference)),
        )
        for part in shading.missed
    ]
    return LightContext(report=shading, sentences=tuple(shading.sentences()), missed=tuple(missed))


def curves(
    shading: ShadingReport | None, rows: Sequence[tuple[int, Measurement]], reach: float
) -> dict[str, go.Figure]:
    """Return the further figures of the rows of an aperture and a camera geometry, by name."""
    if shading is None:
        return {}

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


def eye_figure(shading: ShadingReport | None) -> go.Figure | None:
    """Return the figure of the bent eye vector; None where there is none."""
    if shading is None or not shading.eye:
        return None
    reach = shading.scene.frustum.longest_reach
    return figures.pair_figure(
        [error.near / reach for error in shading.eye],
        [error.measured for error in shading.eye],
        [error.predicted for error in shading.eye],
        "rms change of radiance at the same surface points",
    )


def _uri(encoded: bytes) -> str:
    return f"data:{images.media_type(encoded)};base64,{base64.b64encode(encoded).decode()}"
