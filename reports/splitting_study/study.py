"""`xfrustum study splitting`: measured, written down, and resumed where it was stopped."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from xfrustum.reports.cluster.run import Engine
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.common.summaries import Summarized
from xfrustum.reports.splitting_study.document import document
from xfrustum.reports.splitting_study.figures import maps, svg
from xfrustum.reports.splitting_study.grid import FULL, Grid
from xfrustum.reports.splitting_study.rows import StudyRow
from xfrustum.reports.splitting_study.run import PICTURES, Measuring, StudyJob
from xfrustum.reports.splitting_study.study_record import FilesRecord, StudyRecord, study_record
from xfrustum.reports.studies.cells import study_team
from xfrustum.reports.studies.folder import StudyFolder, WrittenStudy
from xfrustum.reports.studies.origin import Origin

DEFAULT_FOLDER = Path("study") / "splitting"
DOCUMENT, DATA = "when-to-split.md", "when-to-split.parquet"


@dataclass(frozen=True, kw_only=True)
class StudyFiles(WrittenStudy[StudyRow], Summarized[StudyRecord]):
    """What the study left behind."""

    @property
    def record(self) -> StudyRecord:
        """The study, as the command prints it."""
        files = FilesRecord(document=self.document, data=self.data, figures=self.figures)
        return study_record(self.rows, self.origin, files)


def make_study(out: Path | None = None, grid: Grid = FULL, *, progress: bool = False) -> StudyFiles:
    """Measure where one pair of frusta is enough, and write it down.

    Every cell is kept in `measurements.sqlite` in the folder as soon as it is measured; what is there
    already, from the same sources, libraries and device, is not measured again.

    Parameters
    ----------
    out
        Folder; `DEFAULT_FOLDER` where None.
    grid
        What to measure.
    progress
        Show progress bars on standard error.

    Raises
    ------
    InputError
        An unwritable folder, a file in the way, no OpenGL.
    """
    found = make_study_on(Engine(workers=1), out, grid, progress=progress)
    assert found is not None, "one process measures everything"
    return found


def make_study_on(
    engine: Engine,
    out: Path | None = None,
    grid: Grid = FULL,
    *,
    told: Callable[[str], object] = lambda line: None,
    progress: bool = False,
) -> StudyFiles | None:
    """Measure a study by several processes; all but its times is what `make_study` measures.

    Parameters
    ----------
    engine
        Where cells are measured.
    out, grid, progress
        As for `make_study`.
    told
        Called with notes in words, such as the address of the dashboard.

    Returns
    -------
    None where other parts of a job array are not measured yet.

    Raises
    ------
    InputError
        As from `make_study`; or no scheduler answers, or workers measure with something else.
    """
    folder = _folder(DEFAULT_FOLDER if out is None else out)
    folder.check_writable()
    asking = StudyJob(asked=grid, kind=PICTURES, stage=0, path=folder.results)
    with study_team(engine, asking, told) as (team, origin):
        measuring = Measuring(
            team=team,
            part=engine.part,
            path=folder.results,
            origin=asking.hashed(origin),
            progress=progress,
        )
        rows = measuring.rows(grid)
    return None if rows is None else write_study(rows, origin, folder.out)


def rewrite_document(folder: Path) -> Path:
    """Write the document of a folder again, from the data that lie there; nothing is measured or drawn.

    Raises
    ------
    InputError
        An unwritable folder.
    """
    rows, origin = _folder(folder).read()
    with Staging(folder, (DOCUMENT,)) as staging:
        (staging.folder / DOCUMENT).write_text(document(rows, origin), encoding="utf-8")
        staging.commit()
    return folder / DOCUMENT


def write_study(rows: Sequence[StudyRow], origin: Origin, out: Path) -> StudyFiles:
    """Write document, figures and data of some rows; see `StudyFolder.write`."""
    figures = {name: svg(drawn) for name, drawn in maps(rows).items()}
    return StudyFiles(**vars(_folder(out).write(rows, origin, figures, document)))


def _folder(out: Path) -> StudyFolder[StudyRow]:
    return StudyFolder(out=out, document=DOCUMENT, data=DATA, row=StudyRow)
