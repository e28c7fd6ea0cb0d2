"""The answer of a survey: counts and bounds for each setting, the sentence, and the JSON object."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from xfrustum.compare.sampling import CONFIDENCE, risk_of_claim, share_beyond, share_beyond_at_least
from xfrustum.reports.common.formatting import digits, percent
from xfrustum.reports.common.json_ready import INLINED
from xfrustum.reports.common.summaries import Summarized
from xfrustum.reports.survey.tally import P99, Tally
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook.pictures import map_of, png
from xfrustum.scenes.notebook.shown import Figure, Shown, Table
from xfrustum.scenes.plate.double_frustum import DoubleFrustum


@dataclass(frozen=True, kw_only=True)
class WorstRecord:
    """The worst hogel, as it is written."""

    aperture: tuple[int, int]
    displacement_p99_px: float | None
    surface_fraction: float | None


@dataclass(frozen=True, kw_only=True)
class ShareRecord:
    """Hogels beyond the tolerance with one setting, and the bound on their share of the plate."""

    judged: int
    beyond: int
    share_beyond_at_most: float | None
    worst: WorstRecord | None


@dataclass(frozen=True, kw_only=True)
class SettingRecord:
    """One setting with its counts; the settings are null for a plate of another renderer."""

    settings: DoubleFrustum | None
    share: ShareRecord = field(metadata=INLINED)


@dataclass(frozen=True, kw_only=True)
class SurveyRecord:
    """JSON object of a survey: that of the best setting, and each setting in its order."""

    scene: str
    hash: str
    hogels: int
    share: ShareRecord = field(metadata=INLINED)
    confidence: float
    tolerance_px: float
    limit: float | None
    complete: bool
    seed: int | None
    workers: int
    wall_s: float
    sentence: str
    settings: tuple[SettingRecord, ...]


@dataclass(frozen=True, kw_only=True)
class Extent:
    """How many hogels were judged, and how they were chosen.

    Attributes
    ----------
    hogels, judged
        Number of hogels of the plate, and of those that were judged.
    look
        Number of the last look, from 0; None where the whole plate was to be judged, or one sample.
    seed
        Start of the random numbers; None where nothing was drawn at random.
    complete
        Whether all hogels that were asked for are judged; with `--part`, they need not be.
    """

    hogels: int
    judged: int
    look: int | None
    seed: int | None
    complete: bool

    @property
    def everything(self) -> bool:
        """Whether every hogel of the plate was judged."""
        return self.judged == self.hogels

    def bound(self, beyond: int, settings: int) -> float | None:
        """Return the bound on the share of hogels beyond; None where the sample is not complete.

        It holds for all settings together, and at every look.
        """
        if self.everything:
            return beyond / self.hogels
        if not self.complete:
            return None
        return share_beyond(beyond, self.judged, self.hogels, risk_of_claim(settings, self.look))

    def decides(self, beyond: int, settings: int, limit: float) -> bool:
        """Return whether the share of one setting surely keeps a limit, or surely exceeds it.

        That a survey stops where a share surely exceeds the limit costs no risk: what is claimed are the
        upper bounds, and these hold at all looks together.
        """
        bound = self.bound(beyond, settings)
        if bound is None or self.everything or bound <= limit:
            return bound is not None
        risk = risk_of_claim(settings, self.look)
        return share_beyond_at_least(beyond, self.judged, self.hogels, risk) > limit


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Survey(Shown, Summarized[SurveyRecord]):
    """What a survey has found.

    Attributes
    ----------
    scene
        Scene of the plate.
    settings
        Settings that were judged; a single None for a plate of another renderer.
    tallies
        All rows of each setting.
    extent
        How many hogels were judged, and how they were chosen.
    tolerance_px, limit
        Displacement beyond which a hogel is counted, and largest share of such hogels that was asked for;
        None where no share was.
    judged_by
        Limits that counted hogels exceed, in words.
    workers, wall_s
        Number of processes, and wall seconds.
    """

    scene: Scene
    settings: tuple[DoubleFrustum | None, ...]
    tallies: tuple[Tally, ...]
    extent: Extent
    tolerance_px: float
    limit: float | None
    judged_by: str
    workers: int
    wall_s: float

    @property
    def best(self) -> int:
        """Number of the setting with the fewest hogels beyond; of equals, with the least bad worst one."""
        keys = [
            (tally.beyond, tally.worst[0].badness if tally.worst else 0.0, number)
            for number, tally in enumerate(self.tallies)
        ]
        return min(keys)[-1]

    @property
    def confidence(self) -> float:
        """Probability that all bounds hold; 1 where every hogel was judged."""
        return 1.0 if self.extent.everything else CONFIDENCE

    def share(self, setting: int) -> ShareRecord:
        """Return the counts and the bound of a setting."""
        tally = self.tallies[setting]
        worst = tally.worst[0] if tally.worst else None
        return ShareRecord(
            judged=tally.judged,
            beyond=tally.beyond,
            share_beyond_at_most=self.extent.bound(tally.beyond, len(self.tallies)),
            worst=None
            if worst is None
            else WorstRecord(
                aperture=worst.aperture,
                displacement_p99_px=worst.displacement_p99_px,
                surface_fraction=worst.surface_fraction,
            ),
        )

    @property
    def decided(self) -> bool:
        """Whether every setting keeps the share that was asked for, or surely exceeds it.

        True where no share was asked for.
        """
        if self.limit is None:
            return True
        several = len(self.tallies)
        return all(self.extent.decides(tally.beyond, several, self.limit) for tally in self.tallies)

    @property
    def exceeded(self) -> bool:
        """Whether the share that was asked for is exceeded, or, with none, any judged hogel is beyond."""
        share = self.share(self.best)
        if self.limit is None:
            return share.beyond > 0
        return share.share_beyond_at_most is None or share.share_beyond_at_most > self.limit

    @property
    def sentence(self) -> str:
        """The answer in one sentence, for the best setting."""
        share, extent = self.share(self.best), self.extent
        with_what = self._named_setting
        if extent.everything:
            counted = (
                f"{share.beyond:,} of the {extent.hogels:,} hogels ({percent(share.beyond / extent.hogels)})"
            )
            said = f"{counted} {'is' if share.beyond == 1 else 'are'} {self.judged_by}{with_what}"
        elif share.share_beyond_at_most is None:
            said = (
                f"{share.beyond:,} of the {extent.judged:,} hogels judged so far, of {extent.hogels:,}, "
                f"are {self.judged_by}{with_what}; the other parts are not finished"
            )
        else:
            bound = percent_up(share.share_beyond_at_most)
            said = (
                f"at most {bound} of the {extent.hogels:,} hogels are {self.judged_by} "
                f"({percent(self.confidence)}; {share.beyond:,} of {extent.judged:,} sampled){with_what}"
            )
        if share.worst is not None:
            said += f"; worst: {share.worst.aperture[0]},{share.worst.aperture[1]}"
        return f"{said}."

    @property
    def _named_setting(self) -> str:
        chosen = self.settings[self.best]
        if chosen is None or len(self.settings) == 1:
            return ""
        return f" with near {digits(chosen.near)}, the best of {len(self.settings)}"

    @property
    def record(self) -> SurveyRecord:
        """The object that is written."""
        return SurveyRecord(
            scene=self.scene.name,
            hash=self.scene.content_hash,
            hogels=self.extent.hogels,
            share=self.share(self.best),
            confidence=self.confidence,
            tolerance_px=self.tolerance_px,
            limit=self.limit,
            complete=self.extent.complete,
            seed=self.extent.seed,
            workers=self.workers,
            wall_s=self.wall_s,
            sentence=self.sentence,
            settings=tuple(
                SettingRecord(settings=one, share=self.share(number))
                for number, one in enumerate(self.settings)
            ),
        )

    def _said(self) -> str:
        return f"{self.scene.name!r}, {self.sentence}"

    def _tables(self) -> Sequence[Table]:
        shares = [(one, self.share(number)) for number, one in enumerate(self.settings)]
        rows = [
            (
                "as found"
                if one is None
                else f"near {digits(one.near)} {self.scene.units}, {one.depth_label}",
                f"{share.judged:,}",
                f"{share.beyond:,}",
                "-" if share.share_beyond_at_most is None else percent_up(share.share_beyond_at_most),
                "-" if share.worst is None else f"{share.worst.aperture[0]},{share.worst.aperture[1]}",
            )
            for one, share in shares
        ]
        head = ("settings", "judged", "beyond", "share beyond, at most", "worst hogel")
        return (Table(head=head, rows=rows, numbers=True),)

    def _figures(self) -> Sequence[Figure]:
        found = self.tallies[self.best].maps.get(P99)
        if found is None or not np.isfinite(found).any():
            return ()
        largest = digits(float(np.nanmax(found)))
        caption = f"99th percentile of displacement over the plate, up to {largest} px; black: not judged"
        return (Figure(caption=caption, content=png(map_of(found))),)

    def table(self) -> str:
        """Return the sentence, and each setting where there are several."""
        lines = [self.sentence]
        if len(self.settings) > 1:
            for number, one in enumerate(self.settings):
                share = self.share(number)
                assert one is not None
                at_most = share.share_beyond_at_most
                bound = "" if at_most is None else f", at most {percent_up(at_most)}"
                lines.append(f"near {digits(one.near)}: {share.beyond:,} of {share.judged:,} beyond{bound}")
        return "\n".join(lines)


def percent_up(share: float) -> str:
    """Return an upper bound in percent, rounded up to two digits."""
    if share <= 0 or share >= 1:
        return f"{100 * share:.0f} %"
    step = 10.0 ** (math.floor(math.log10(100 * share)) - 1)
    # A share that is a number of two digits but for rounding stays that number.
    rounded = math.ceil(100 * share / step - 1e-9) * step
    return f"{min(rounded, 100.0):.3g} %"
