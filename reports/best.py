"""The verdict: which setting is best, and the sentence that says so."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from xfrustum.reports.measurement import Measurement
from xfrustum.scenes.double_frustum import DepthFormat, DepthMapping, DoubleFrustum

SURFACE_TIE = 1e-4
"""Surface fractions closer than this are equal. A rasterizer snaps vertices to 2^-8 px, which puts
the pixels within sqrt(2)/2 2^-8 px on both sides of a silhouette in doubt: a share of 0.0055 l/W, for
contours as long as l image widths. At W = 512 and nine image widths that is one pixel in ten thousand."""

DISPLACEMENT_TIE_PX = 1e-3
"""Displacements closer than this are equal: 32-bit surface positions measure it no better (99 % of
pixels within 1e-3 px on meshes)."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One setting, with its numbers at the worst of the apertures.

    Attributes
    ----------
    settings
        The setting.
    surface_fraction
        Share of judged pixels with the wrong surface.
    displacement_p99_px
        99th percentile of displacement in pixels.
    """

    settings: DoubleFrustum
    surface_fraction: float
    displacement_p99_px: float


def worst_over_apertures(rows: Sequence[Measurement]) -> list[Verdict]:
    """Return one verdict per setting, in the order in which settings first appear."""
    grouped: dict[DoubleFrustum, list[Measurement]] = {}
    for row in rows:
        grouped.setdefault(row.settings, []).append(row)
    return [
        Verdict(
            settings=settings,
            surface_fraction=max(row.surface_fraction for row in group),
            displacement_p99_px=max(row.displacement_p99_px for row in group),
        )
        for settings, group in grouped.items()
    ]


def best_setting(rows: Sequence[Measurement]) -> Verdict:
    """Return the best setting: least surface error, then least displacement, then largest near.

    Of all settings within `SURFACE_TIE` of the least surface fraction, and of those within
    `DISPLACEMENT_TIE_PX` of the least 99th percentile of displacement, the one with the largest near;
    at equal near the one listed first. The worst aperture counts.

    Raises
    ------
    ValueError
        There are no rows.
    """
    candidates = worst_over_apertures(rows)
    least = min(c.surface_fraction for c in candidates)
    candidates = [c for c in candidates if c.surface_fraction <= least + SURFACE_TIE]
    least = min(c.displacement_p99_px for c in candidates)
    candidates = [c for c in candidates if c.displacement_p99_px <= least + DISPLACEMENT_TIE_PX]
    return max(candidates, key=lambda c: c.settings.near)


def can_be_judged(rows: Sequence[Measurement]) -> bool:
    """Return whether there is a pixel that some setting could show wrongly."""
    shown = any(row.comparison["covered"] or row.comparison["displacement_px"] for row in rows)
    return shown and any(row.comparison["judged"] for row in rows)


def best_per_depth(rows: Sequence[Measurement]) -> list[Verdict]:
    """Return the best setting of each depth format and mapping, in the order of the rows."""
    grouped: dict[tuple[DepthFormat, DepthMapping], list[Measurement]] = {}
    for row in rows:
        grouped.setdefault((row.settings.depth, row.settings.mapping), []).append(row)
    return [best_setting(group) for group in grouped.values()]


def sentence(rows: Sequence[Measurement], units: str, reach: float) -> str:
    """Say which setting is best and how good it is.

    Parameters
    ----------
    rows
        All rows of a sweep.
    units, reach
        The scene's length unit, and its larger reach in it.
    """
    if not any(row.comparison["judged"] for row in rows):
        return "Nothing can be judged: every pixel of the truth is a tie."
    if not can_be_judged(rows):
        return "There is nothing to judge: neither the truth nor any raster image shows a surface."
    verdict = best_setting(rows)
    settings = len({row.settings for row in rows})
    apertures = len({row.aperture for row in rows})
    where = f" at the worst of {apertures} apertures" if apertures > 1 else ""
    chosen = "The one setting measured" if settings == 1 else f"Best of {settings} settings"
    return (
        f"{chosen}: near {digits(verdict.settings.near)} {units} "
        f"({digits(verdict.settings.near / reach)} of the reach) with {verdict.settings.depth_label} depth. "
        f"{percent(verdict.surface_fraction)} of the judged pixels show the wrong surface{where}, "
        f"and 99 % of the picture lies within {pixels(verdict.displacement_p99_px)} of where it belongs."
    )


def digits(value: float) -> str:
    """Write a number with three digits, such as `0.0474` or `2.87e-7`."""
    return _plain(f"{value:.3g}")


def percent(fraction: float) -> str:
    """Write a fraction as percent with two digits, such as `0.012 %`; `100 %` has three."""
    return _plain(f"{100 * fraction:.0f} %" if fraction >= 0.1 else f"{100 * fraction:.2g} %")


def pixels(value: float) -> str:
    """Write a displacement; below `DISPLACEMENT_TIE_PX` the digits mean nothing."""
    return _plain(f"{max(value, DISPLACEMENT_TIE_PX):.2g} px")


def _plain(text: str) -> str:
    """Drop the zero that Python puts into small exponents."""
    return re.sub(r"e([+-])0(\d)", r"e\1\2", text).replace("e+", "e")
