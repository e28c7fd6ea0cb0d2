"""`xfrustum study noticeable`: answered, written down, and resumed where it was stopped."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from xfrustum.reports.cluster.run import Engine
from xfrustum.reports.common.summaries import Summarized
from xfrustum.reports.noticeable_study.document import document, sentence
from xfrustum.reports.noticeable_study.facts import (
    Quarter,
    Thresholds,
    disagreement,
    quarters,
    replays,
    thresholds,
)
from xfrustum.reports.noticeable_study.figures import figures
from xfrustum.reports.noticeable_study.grid import FULL, Grid
from xfrustum.reports.noticeable_study.rows import NoticedRow
from xfrustum.reports.noticeable_study.run import ReplayJob, measure
from xfrustum.reports.studies.cells import study_team
from xfrustum.reports.studies.folder import IMAGES, StudyFolder, WrittenStudy
from xfrustum.reports.studies.origin import Origin

DEFAULT_FOLDER = Path("study") / "noticeable"
PLANS = "plans-car.png"
"""Picture of both plans for the car, which scripts/draw_eye_figures.py draws into the folder of figures."""

DOCUMENT, DATA = "noticeable.md", "noticeable.parquet"


@dataclass(frozen=True, kw_only=True)
class FilesRecord:
    """Places of what the study wrote."""

    document: Path
    data: Path
    figures: tuple[Path, ...]


@dataclass(frozen=True, kw_only=True)
class ThresholdsRecord:
    """A scene and its largest unnoticed nears, mm: by distance, and for the crack the smallest of all."""

    scene: str
    pivot: str
    stereo: Mapping[str, float | None]
    pixels_worst: float | None
    pixels_median: float | None

    @classmethod
    def of(cls, found: Thresholds) -> ThresholdsRecord:
        """Return what is written of thresholds."""
        return cls(
            scene=found.scene,
            pivot=found.pivot,
            stereo={f"{distance:g}": near for distance, near in found.stereo.items()},
            pixels_worst=found.pixels_worst,
            pixels_median=found.pixels_median,
        )


@dataclass(frozen=True, kw_only=True)
class StudyRecord:
    """What `study noticeable --json` prints."""

    files: FilesRecord
    sentence: str
    cells: int
    thresholds: tuple[ThresholdsRecord, ...]
    quarters: tuple[Quarter, ...]
    replays: int
    replayed_over_predicted: tuple[float, float]
    disagreement: Mapping[str, int]
    versions: Mapping[str, str]
    devices: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class StudyFiles(WrittenStudy[NoticedRow], Summarized[StudyRecord]):
    """What the study left behind."""

    @property
    def record(self) -> StudyRecord:
        """The study, as the command prints it."""
        found, apart = replays(self.rows), disagreement(self.rows)
        return StudyRecord(
            files=FilesRecord(document=self.document, data=self.data, figures=self.figures),
            sentence=sentence(self.rows),
            cells=len(self.rows),
            thresholds=tuple(map(ThresholdsRecord.of, thresholds(self.rows))),
            quarters=tuple(quarters(self.rows)),
            replays=found.count,
            replayed_over_predicted=(found.lowest, found.highest),
            disagreement={
                "pixels_only": apart.pixels_only,
                "eyes_only": apart.eyes_only,
                "both": apart.both,
                "neither": apart.neither,
            },
            versions=self.origin.versions,
            devices=self.origin.devices,
        )


def make_study(out: Path | None = None, grid: Grid = FULL, *, progress: bool = False) -> StudyFiles:
    """Answer what viewers notice, and write it down.

    Every replay is kept in `measurements.sqlite` in the folder as soon as it is measured; what is there
    already, from the same sources, libraries and device, is not measured again.

    Parameters
    ----------
    out
        Folder; `DEFAULT_FOLDER` where None.
    grid
        What to ask.
    progress
        Show progress bars on standard error.

    Raises
    ------
    InputError
        An unwritable folder, a file in the way, no OpenGL.
    """
    found = make_study_on(Engine(workers=1), out, grid, progress=progress)
    assert found is not None, "one process replays everything"
    return found


def make_study_on(
    engine: Engine,
    out: Path | None = None,
    grid: Grid = FULL,
    *,
    told: Callable[[str], object] = lambda line: None,
    progress: bool = False,
) -> StudyFiles | None:
    """Answer by several processes, which share the replays; what is written is what `make_study` writes.

    Parameters
    ----------
    engine
        Where cells are replayed; this process evaluates the closed forms.
    out, grid, progress
        As for `make_study`.
    told
        Called with notes in words, such as the address of the dashboard.

    Returns
    -------
    None where other parts of a job array are not replayed yet.

    Raises
    ------
    InputError
        As from `make_study`; or no scheduler answers, or workers replay with something else.
    """
    folder = _folder(DEFAULT_FOLDER if out is None else out)
    folder.check_writable()
    asking = ReplayJob(cells=tuple(grid.cells()), grid=grid, path=folder.results)
    with study_team(engine, asking, told) as (team, origin):
        rows = measure(grid, asking.measured_with(origin), team, engine.part, progress=progress)
    return None if rows is None else write_study(rows, origin, folder.out)


def rewrite_document(folder: Path) -> Path:
    """Write document and figures of a folder again, from the data that lie there; nothing is measured.

    Raises
    ------
    InputError
        An unwritable folder.
    """
    rows, origin = _folder(folder).read()
    return write_study(rows, origin, folder).document


def write_study(rows: Sequence[NoticedRow], origin: Origin, out: Path) -> StudyFiles:
    """Write document, figures and data of some rows; see `StudyFolder.write`."""

    def told(rows: Sequence[NoticedRow], origin: Origin) -> str:
        return document(rows, origin, pictured=(out / IMAGES / PLANS).exists())

    return StudyFiles(**vars(_folder(out).write(rows, origin, figures(rows), told)))


def _folder(out: Path) -> StudyFolder[NoticedRow]:
    return StudyFolder(out=out, document=DOCUMENT, data=DATA, row=NoticedRow)
