"""The rule for a near that no eye notices, and how the rows of the study keep it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from xfrustum.compare.eye.limits import STEREO_ACUITY_ARCSEC, Viewer
from xfrustum.reports.noticeable_study.rows import NoticedRow


def safe_near(distance: float, nearest: float) -> float:
    """Return the largest near of which two eyes notice no change of depth without shear, mm.

    Parameters
    ----------
    distance
        Distance L of the eyes from the plate, mm.
    nearest
        Distance R of the eyes from the nearest surface before the plate, mm; L where there is none.

    Notes
    -----
    With eyes b apart, disparity changes by b n/R^2 for the nearest surface, and by -b n/L^2 for one just
    behind the plate. Their difference is stereo acuity at n = (acuity/b)/(1/L^2 + 1/R^2). That is to first
    order in n; the nearest surface changes by b n/(R (R - n)), which is a share of n/(R - n) more.
    """
    viewer = Viewer(distance=distance)
    acuity = math.radians(viewer.stereo_acuity_arcsec / 3600)
    return acuity / viewer.eyes_apart_mm / (1 / distance**2 + 1 / nearest**2)


@dataclass(frozen=True, kw_only=True)
class Kept:
    """Cases that keep the rule: scenes, pivots, pitches, distances and nears.

    Attributes
    ----------
    count
        Number of cases whose near is no larger than `safe_near`.
    seen
        Number of those in which the viewer notices the near offset, in closed form.
    replayed
        Number of those that were replayed, with any depth buffer.
    replayed_seen
        Number of those in which the replayed change of disparity is beyond stereo acuity.
    largest_share
        Largest ratio of near to the distance of the nearest surface: what the rule leaves out.
    """

    count: int
    seen: int
    replayed: int
    replayed_seen: int
    largest_share: float

    @property
    def holds(self) -> bool:
        """Whether nothing is noticed in any of the cases, in closed form and replayed."""
        return self.count > 0 and not self.seen and not self.replayed_seen


def kept(rows: Sequence[NoticedRow], *, sheared: bool) -> Kept:
    """Return how the cases do that keep the rule: those with shear, or those without."""
    own: dict[tuple[object, ...], list[NoticedRow]] = {}
    for row in rows:
        if row.sheared is sheared and row.near <= safe_near(row.distance, row.nearest_distance):
            own.setdefault((row.scene, row.pivot, row.pitch, row.distance, row.near), []).append(row)
    changes = [
        [row.replayed_stereo_arcsec or 0.0 for row in case if row.is_replayed] for case in own.values()
    ]
    return Kept(
        count=len(own),
        seen=sum(case[0].offset_seen for case in own.values()),
        replayed=sum(bool(one) for one in changes),
        replayed_seen=sum(max(one, default=0.0) > STEREO_ACUITY_ARCSEC for one in changes),
        largest_share=max((case[0].near / case[0].nearest_distance for case in own.values()), default=0.0),
    )


def sheared_limits(
    rows: Sequence[NoticedRow], limits: Sequence[tuple[str, float, float]]
) -> tuple[float, float] | None:
    """Return the range of limits with shear, in parts of `safe_near`; None where nothing is sheared.

    Parameters
    ----------
    limits
        Scene, distance and largest unnoticed near of each case with shear, mm.
    """
    nearest = {(row.scene, row.distance): row.nearest_distance for row in rows}
    shares = [
        near / safe_near(distance, nearest[scene, distance])
        for scene, distance, near in limits
        if math.isfinite(near)
    ]
    return (min(shares), max(shares)) if shares else None
