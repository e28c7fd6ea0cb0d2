"""`--apertures auto`: the scout of a plate, and the apertures chosen from it, in words and in JSON."""

from __future__ import annotations

from dataclasses import dataclass

from xfrustum.compare.scouting.automatic import AutoApertures, ChosenAperture
from xfrustum.compare.scouting.scout import FILM_PIXELS, MAX_APERTURES, Look, scout
from xfrustum.reports.common.progress import progress_bar
from xfrustum.scenes.model.scene import Scene


def auto_apertures(scene: Scene, *, progress: bool = False) -> AutoApertures:
    """Look through apertures all over a plate, and choose the middle one and the worst.

    Parameters
    ----------
    progress
        Show a progress bar on standard error.
    """
    with progress_bar(None, "scout", "aperture", shown=progress) as bar:
        return AutoApertures.of(scout(scene, bar.update))


def notes(auto: AutoApertures) -> list[str]:
    """Say in a sentence each how the apertures were chosen, and which and why."""
    columns, rows = auto.scout.scene.plate.hogels
    looks = len(auto.scout.looks)
    everything = "all" if looks == columns * rows else f"{looks} of the"
    lines = [
        f"auto: looked through {everything} {columns * rows:,} apertures of the plate (at most "
        f"{MAX_APERTURES:,}), along {FILM_PIXELS**2} lines each"
    ]
    if auto.blocked:
        lines.append(
            f"auto: at {auto.blocked} of these a surface lies in the aperture itself, which no settings draw"
        )
    return [*lines, *(f"auto: {spelled(one)}" for one in auto.chosen)]


def spelled(chosen: ChosenAperture) -> str:
    """Return an aperture with the reason for which it was chosen."""
    return f"aperture {chosen.aperture.column},{chosen.aperture.row}: {chosen.why}"


@dataclass(frozen=True, kw_only=True)
class ChoiceRecord:
    """An aperture by its column and row, and the reason for which it was chosen."""

    aperture: tuple[int, int]
    why: str

    @classmethod
    def of(cls, chosen: ChosenAperture) -> ChoiceRecord:
        """Return how a chosen aperture is written."""
        return cls(aperture=chosen.aperture.index, why=chosen.why)


def choices(auto: AutoApertures | None) -> tuple[ChoiceRecord, ...] | None:
    """Return how chosen apertures are written; None where nothing was to be chosen."""
    return None if auto is None else tuple(ChoiceRecord.of(one) for one in auto.chosen)


@dataclass(frozen=True, kw_only=True)
class LookRecord:
    """What the coarse film of one aperture shows; see `scout.Look`.

    Attributes
    ----------
    nearest
        Smallest visible |z|, scene units; null where nothing is seen.
    pixels_per_near
        The 99th percentile of displacement over a small n; null where a surface lies in the aperture.
    outline_widths
        Length of the outlines in widths of the film.
    """

    aperture: tuple[int, int]
    nearest: float
    pixels_per_near: float
    outline_widths: float

    @classmethod
    def of(cls, look: Look) -> LookRecord:
        """Return how a look is written."""
        return cls(
            aperture=look.aperture.index,
            nearest=look.nearest,
            pixels_per_near=look.pixels_per_near,
            outline_widths=look.outline_widths,
        )


@dataclass(frozen=True, kw_only=True)
class ScoutRecord:
    """The scout of a plate, and what was chosen from it.

    Attributes
    ----------
    hogels, scouted, blocked
        Hogels of the plate; of these, how many were looked through, and of those, in how many a surface lies.
    lines
        Lines through each aperture that was looked through.
    chosen
        The apertures that were taken, with their reasons.
    looks
        What each look saw.
    """

    hogels: int
    scouted: int
    blocked: int
    lines: int
    chosen: tuple[ChoiceRecord, ...]
    looks: tuple[LookRecord, ...]

    @classmethod
    def of(cls, auto: AutoApertures) -> ScoutRecord:
        """Return how a scout is written."""
        columns, rows = auto.scout.scene.plate.hogels
        return cls(
            hogels=columns * rows,
            scouted=len(auto.scout.looks),
            blocked=auto.blocked,
            lines=FILM_PIXELS**2,
            chosen=tuple(ChoiceRecord.of(one) for one in auto.chosen),
            looks=tuple(LookRecord.of(look) for look in auto.scout.looks),
        )
