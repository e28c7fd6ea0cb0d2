"""The study as one JSON object: criteria, what is enough in every case, and what measured it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from xfrustum.reports.splitting_study import facts
from xfrustum.reports.splitting_study.document import Rows, sentence
from xfrustum.reports.splitting_study.families import Help, helps, of_family
from xfrustum.reports.splitting_study.grid import Family
from xfrustum.reports.splitting_study.rows import ASKED_SEPARATION
from xfrustum.reports.splitting_study.suitability import Outcome, outcomes
from xfrustum.reports.studies.origin import Origin
from xfrustum.scenes.plate.double_frustum import (
    Camera,
    DepthFormat,
    DepthMapping,
    Fit,
    Offset,
    Pivot,
)
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX


@dataclass(frozen=True, kw_only=True)
class FilesRecord:
    """Places of what a study wrote."""

    document: Path
    data: Path
    figures: tuple[Path, ...]


@dataclass(frozen=True, kw_only=True)
class CriteriaRecord:
    """What a setting must keep to be enough."""

    displacement_p99_px: float
    depth_wrong: float
    separation: float


@dataclass(frozen=True, kw_only=True)
class CaseRecord:
    """A `Case`, and what is enough in it."""

    family: Family
    pivot: Pivot
    fit: Fit | None
    offset: Offset
    side: Camera
    ratio: float
    resolution: int
    depth: DepthFormat
    mapping: DepthMapping
    one_pair: bool
    nears: tuple[float, ...]
    slabs: tuple[float, ...] | None

    @classmethod
    def of(cls, outcome: Outcome) -> CaseRecord:
        """Return what is written of a case."""
        case = outcome.case
        return cls(
            family=case.family,
            pivot=case.pivot,
            fit=case.fit,
            offset=case.offset,
            side=case.side,
            ratio=case.ratio,
            resolution=case.resolution,
            depth=case.buffer[0],
            mapping=case.buffer[1],
            one_pair=outcome.one_pair,
            nears=outcome.nears,
            slabs=outcome.slabs,
        )


@dataclass(frozen=True, kw_only=True)
class StudyRecord:
    """What `study splitting --json` prints."""

    files: FilesRecord
    sentence: str
    criteria: CriteriaRecord
    cells: int
    agreement: facts.Agreement
    helps: tuple[Help, ...]
    cases: tuple[CaseRecord, ...]
    versions: Mapping[str, str]
    devices: Mapping[str, str]


def study_record(rows: Rows, origin: Origin, files: FilesRecord) -> StudyRecord:
    """Return what is written of a study."""
    first = of_family(rows, Family.ONE_SIDE)
    return StudyRecord(
        files=files,
        sentence=sentence(rows),
        criteria=CriteriaRecord(
            displacement_p99_px=TOLERANCE_PX,
            depth_wrong=MAX_DEPTH_WRONG,
            separation=ASKED_SEPARATION,
        ),
        cells=len(rows),
        agreement=facts.agreement(first, facts.buffer_facts(first)),
        helps=tuple(helps(rows)),
        cases=tuple(map(CaseRecord.of, outcomes(rows).values())),
        versions=origin.versions,
        devices=origin.devices,
    )
