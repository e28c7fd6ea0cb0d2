"""The answers of the study of viewers as rows, and as Parquet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from xfrustum.compare.eye.limits import STEREO_ACUITY_ARCSEC
from xfrustum.compare.scouting.sample import share_at_most
from xfrustum.reports.noticeable_study.grid import DepthBuffer, Seat, Setting
from xfrustum.reports.studies.origin import Origin
from xfrustum.reports.studies.rows import read_rows, write_rows
from xfrustum.scenes.plate.double_frustum import Pivot
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX

Case = tuple[str, float, float, Pivot, DepthBuffer]
"""Scene, pitch, distance, pivot and depth buffer."""


@dataclass(frozen=True, kw_only=True)
class Predicted:
    """What a viewer notices, in closed form; lengths in millimeters.

    Attributes
    ----------
    stereo_arcsec
        Largest change of disparity between two things that the viewer sees.
    crack_arcmin
        Width of the crack in a surface that runs through the plate; None where there is none.
    crack_hidden_arcmin, crack_hidden_by
        Width of a crack that is not noticed, and what hides it.
    ordered_separation
        Smallest separation that the depth buffer orders at the farthest visible surfaces, the worse side.
    resolved_separation, resolved_by
        Smallest separation that the viewer, or the display, tells apart there, and what decides that.
    pixels_median, pixels_worst
        99th percentile of displacement in pixels of a hogel: at the median and the worst of the apertures
        that were looked through; None where surfaces pass through them.
    pixels_beyond
        Share of these apertures that are displaced by more than half a pixel.
    asked_separation
        Separation that `plan` asks for without a viewer: a thousandth of the reach.
    nearest_distance
        Distance from the eyes of the nearest surface before the plate; the plate's own where there is none.
    sheared
        Whether what is replayed is sheared: the frustum is recentered, and the pivot is `aperture`.
    """

    stereo_arcsec: float
    crack_arcmin: float | None
    crack_hidden_arcmin: float
    crack_hidden_by: str
    ordered_separation: float
    resolved_separation: float
    resolved_by: str
    pixels_median: float | None
    pixels_worst: float | None
    pixels_beyond: float
    asked_separation: float
    nearest_distance: float
    sheared: bool


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What a replay shows to two eyes; None where a cell was not replayed.

    Attributes
    ----------
    replayed_stereo_arcsec
        Change of disparity, as in `reports.eye.replayed`.
    replayed_points
        Number of surface points that both eyes were shown.
    replayed_wrong, replayed_depth_wrong
        Share of pixels with wrong surfaces, and with such as exact depth shows rightly.
    replayed_pixels
        Number of pixels of both eyes that these are shares of.
    """

    replayed_stereo_arcsec: float | None = None
    replayed_points: int | None = None
    replayed_wrong: float | None = None
    replayed_depth_wrong: float | None = None
    replayed_pixels: int | None = None


@dataclass(frozen=True, kw_only=True)
class NoticedRow(Seat, Setting, Predicted, Measured):
    """A cell with its answers."""

    @property
    def stereo_seen(self) -> bool:
        """Whether the viewer sees the change of depth."""
        return self.stereo_arcsec > STEREO_ACUITY_ARCSEC

    @property
    def crack_seen(self) -> bool:
        """Whether the viewer sees the crack."""
        return self.crack_arcmin is not None and self.crack_arcmin > self.crack_hidden_arcmin

    @property
    def case(self) -> Case:
        """Everything but near: plate and place, pivot, depth buffer."""
        return self.scene, self.pitch, self.distance, self.pivot, self.buffer

    @property
    def offset_seen(self) -> bool:
        """Whether the viewer notices the near offset, whatever the depth buffer does."""
        return self.stereo_seen or self.crack_seen

    @property
    def noticed(self) -> bool:
        """Whether the viewer notices anything of near and depth buffer."""
        return self.offset_seen or self.depth_seen

    @property
    def is_replayed(self) -> bool:
        """Whether the cell was replayed."""
        return self.replayed_pixels is not None

    @property
    def depth_wrong_at_most(self) -> float:
        """Upper bound of the share of pixels wrong by depth, as of a random sample; 1 where not replayed."""
        if self.replayed_pixels is None or self.replayed_depth_wrong is None:
            return 1.0
        return share_at_most(round(self.replayed_depth_wrong * self.replayed_pixels), self.replayed_pixels)

    @property
    def right_in_pixels(self) -> bool:
        """Whether the settings keep what `plan` requires of hogels' pixels, in closed form."""
        moved = self.pixels_worst is not None and self.pixels_worst <= TOLERANCE_PX
        return moved and self.ordered_separation <= self.asked_separation

    @property
    def depth_seen(self) -> bool:
        """Whether the depth buffer confuses what the viewer tells apart, or was measured to be wrong."""
        wrong = self.replayed_depth_wrong is not None and self.replayed_depth_wrong > MAX_DEPTH_WRONG
        return wrong or self.ordered_separation > self.resolved_separation


def decisive(rows: Sequence[NoticedRow]) -> frozenset[int]:
    """Return the indices of the rows that decide whether one pair of frusta is enough.

    For each plate, place and depth buffer that is the largest near whose offset is not noticed: a larger one
    is noticed, and a smaller one leaves more to be wrong by depth. None where every near is noticed.
    """
    found: dict[Case, int] = {}
    for index, row in enumerate(rows):
        if not row.offset_seen and row.near > rows[found.setdefault(row.case, index)].near:
            found[row.case] = index
    return frozenset(found.values())


def starved_nears(rows: Sequence[NoticedRow]) -> dict[Case, float]:
    """Return the largest nears at which a replay shows too much that is wrong by depth.

    A smaller near of the same case leaves more to be wrong, whatever the closed form says of it.
    """
    found: dict[Case, float] = {}
    for row in rows:
        if row.is_replayed and row.depth_seen:
            found[row.case] = max(row.near, found.get(row.case, 0.0))
    return found


def write_parquet(rows: Sequence[NoticedRow], origin: Origin, path: Path) -> None:
    """Write one row per cell; see `write_rows`."""
    write_rows(NoticedRow, rows, origin, path)


def read_parquet(path: Path) -> tuple[tuple[NoticedRow, ...], Origin]:
    """Return the rows of a file of `write_parquet`, and where they came from."""
    return read_rows(NoticedRow, path)
