"""The inspection page of a report: the best setting at the apertures that were measured."""

from __future__ import annotations

from xfrustum.reports.common.formatting import digits
from xfrustum.reports.inspection.page import Inspection
from xfrustum.reports.inspection.plate_map import PlateMap
from xfrustum.reports.measurements.best import best_setting
from xfrustum.reports.measurements.measurement import Sweep


def inspection_of(sweep: Sweep) -> Inspection:
    """Return what the inspection page of a sweep shows."""
    best = best_setting(sweep.rows).settings
    shares = [(*row.aperture.index, row.surface_fraction) for row in sweep.rows if row.settings == best]
    drawn = f"near {digits(best.near)}, {best.depth_label}"
    return Inspection(
        command="report",
        scene=sweep.scene,
        told=(f"The apertures of the report, drawn with its best setting: {drawn}.",),
        hogels=sweep.inspected,
        plate_map=PlateMap.of(sweep.scene.plate, "Share of wrong surfaces", shares),
    )
