"""Camera geometries of a report side by side: curves over near, and what the shear alone does to points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import plotly.graph_objects as go

from xfrustum.compare.attribution.budget import ShearNumbers
from xfrustum.reports.common.geometry import CameraGeometry, geometry_names
from xfrustum.reports.error_report import best, figures
from xfrustum.reports.error_report.best import Recommendation
from xfrustum.reports.error_report.measurement import Measurement
from xfrustum.reports.error_report.sweep import Sweep
from xfrustum.scenes.notebook import digits, percent
from xfrustum.scenes.plate.double_frustum import Offset, Pivot
from xfrustum.scenes.plate.plate import Aperture

ROUNDED_SHEAR_PX = 1e-6
"""Displacement up to which a shear is taken for rounding, of an aperture's place or of pixels. In double
precision places on large films are known to some 1e-12 px: larger shears have six digits or more."""

EQUAL_FRACTION = 1e-6
"""Relative difference of two shears, each larger than `ROUNDED_SHEAR_PX`, that is rounding alone."""


MAX_TOLD_GEOMETRIES = 2
"""Largest number of geometries that are compared in sentences: of more, only a table can be read."""


@dataclass(frozen=True, kw_only=True)
class ShownGeometry:
    """One camera geometry on the page: its name, and its best setting."""

    name: str
    best: Recommendation


@dataclass(frozen=True, kw_only=True)
class ShearRow:
    """What the shear does at one aperture and near."""

    aperture: Aperture
    near: float
    numbers: ShearNumbers

    @property
    def sheared(self) -> bool:
        """Whether there is a shear: right before the middle of its screen an aperture has none."""
        return self.numbers.closed_form_rms_px > ROUNDED_SHEAR_PX


@dataclass(frozen=True, kw_only=True)
class GeometryContext:
    """What the page says about camera geometries.

    Attributes
    ----------
    without_offset
        Whether the cameras of some geometry stay in the aperture.
    """

    shown: tuple[ShownGeometry, ...]
    depth_label: str
    sentences: tuple[str, ...]
    shear: tuple[ShearRow, ...]
    without_offset: bool

    def name_of(self, best: Recommendation) -> str:
        """Return the name of the geometry of a setting."""
        wanted = CameraGeometry.of(best.settings)
        return next(one.name for one in self.shown if CameraGeometry.of(one.best.settings) == wanted)


def context(sweep: Sweep) -> GeometryContext:
    """Return what the page says about the camera geometries of a sweep."""
    names = geometry_names(sweep.geometries)
    found = best.best_per_geometry(sweep.rows)
    shown = tuple(ShownGeometry(name=names[CameraGeometry.of(one.settings)], best=one) for one in found)
    shear = _shear_rows(sweep)
    sentences = [*_compared(shown, sweep.scene.units), *_shear_sentences(shear, sweep)]
    return GeometryContext(
        shown=shown,
        depth_label=sweep.best.settings.depth_label,
        sentences=tuple(sentences),
        shear=shear,
        without_offset=any(one.offset is Offset.NONE for one in sweep.geometries),
    )


def comparison_figures(sweep: Sweep, aperture: Aperture) -> dict[str, go.Figure]:
    """Return curves of an aperture with a line for each geometry, by name; none of a single geometry.

    All lines are drawn with the depth buffer of the best setting.
    """
    if len(sweep.geometries) < 2:
        return {}
    label, reach = sweep.best.settings.depth_label, sweep.scene.frustum.longest_reach
    names = geometry_names(sweep.geometries)
    groups = {
        names[one]: [item for item in sweep.numbered(aperture, one) if item[1].settings.depth_label == label]
        for one in sweep.geometries
    }

    def wrong(row: Measurement) -> float | None:
        return row.surface_fraction or None

    def moved(row: Measurement) -> float | None:
        return row.displacement_p99_px or None

    numbers: tuple[tuple[str, Callable[[Measurement], float | None], str], ...] = (
        ("geometry_surface", wrong, "share of pixels with the wrong surface"),
        ("geometry_displacement", moved, "99th percentile of displacement, px"),
    )
    drawn = {name: figures.grouped_figure(groups, reach, number, title) for name, number, title in numbers}
    figures.write_percent(drawn["geometry_surface"])
    return drawn | _shear_figure(sweep, aperture)


def _shear_figure(sweep: Sweep, aperture: Aperture) -> dict[str, go.Figure]:
    """Return the shear's curves, blank where an aperture has no shear; none where nothing is sheared."""
    every = _shear_rows(sweep)
    if not every:
        return {}
    rows = [row for row in every if row.aperture == aperture and row.sheared]
    reach = sweep.scene.frustum.longest_reach
    figure = figures.pair_figure(
        [row.near / reach for row in rows],
        [row.numbers.rms_px for row in rows],
        [row.numbers.closed_form_rms_px for row in rows],
        "rms displacement by the shear alone, px",
    )
    return {"geometry_shear": figure}


def _shear_rows(sweep: Sweep) -> tuple[ShearRow, ...]:
    """Return the shear of each aperture and near, ascending; depth buffers, fits and cuts share it."""
    found: dict[tuple[int, float], ShearRow] = {}
    for row in sweep.rows:
        if row.shear is not None:
            place = sweep.apertures.index(row.aperture)
            shown = ShearRow(aperture=row.aperture, near=row.settings.near, numbers=row.shear)
            found.setdefault((place, row.settings.near), shown)
    return tuple(found[key] for key in sorted(found))


def _compared(shown: Sequence[ShownGeometry], units: str) -> list[str]:
    """Say for each geometry how good its best setting is, where there are two; the table tells of more."""
    if not 1 < len(shown) <= MAX_TOLD_GEOMETRIES:
        return []
    return [
        f"With {one.name} the best setting is near {digits(one.best.settings.near)} {units} and "
        f"{one.best.settings.depth_label} depth: {percent(one.best.surface_fraction)} of the judged pixels "
        f"show the wrong surface, and {best.where_it_lies(one.best.displacement_p99_px)}."
        f"{best.gap(one.best, units)}"
        for one in shown
    ]


def _shear_sentences(shear: Sequence[ShearRow], sweep: Sweep) -> list[str]:
    sheared = [row for row in shear if row.sheared]
    if not sheared:
        return []
    units = sweep.scene.units
    worst = max(sheared, key=lambda row: row.numbers.rms_px)
    apart = max(abs(row.numbers.rms_px / row.numbers.closed_form_rms_px - 1) for row in sheared)
    where = f"near {digits(worst.near)} {units} and aperture {worst.aperture.column},{worst.aperture.row}"
    said = [
        "Beside what the near offset does, a shear about the cameras' own centers moves points by up to "
        f"{digits(worst.numbers.rms_px)} px (rms, at {where}), and a shear about the aperture by nothing.",
        "This is what is traced. The closed form -k n/((|z| + n) t), for the same points, differs from it by "
        + (f"at most {percent(apart)} at every near." if apart > EQUAL_FRACTION else "nothing but rounding."),
    ]
    return [*said, *_limits(sweep)]


def _limits(sweep: Sweep) -> list[str]:
    """Say up to which near each pivot keeps the displacement that nobody sees, where both were measured."""
    kept = {pivot: _kept_near(sweep, pivot) for pivot in Pivot}
    parts = []
    for pivot, near in kept.items():
        if near is None:
            return []
        where = f"up to near {digits(near)} {sweep.scene.units}" if near else "at no near that was measured"
        parts.append(f"with pivot {pivot} {where}")
    unseen = digits(best.UNSEEN_DISPLACEMENT_PX)
    return [f"99 % of the picture lies within {unseen} px {', '.join(parts)}."]


def _kept_near(sweep: Sweep, pivot: Pivot) -> float | None:
    """Return the largest near at which every aperture keeps it, with the usual fit, offset and no cuts.

    0 where none does; None where these cameras were not measured with the depth buffer of the best setting.
    """
    usual = CameraGeometry(pivot=pivot)
    moved: dict[float, float] = {}
    label = sweep.best.settings.depth_label
    for row in sweep.rows:
        if CameraGeometry.of(row.settings) == usual and row.settings.depth_label == label:
            near = row.settings.near
            moved[near] = max(moved.get(near, 0.0), row.displacement_p99_px)
    if not moved:
        return None
    return max((near for near, px in moved.items() if px <= best.UNSEEN_DISPLACEMENT_PX), default=0.0)
