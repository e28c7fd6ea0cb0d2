"""`xfrustum study noticeable`: answered, written down, and resumed where it was stopped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from xfrustum.reports.common.outputs import Staging
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
from xfrustum.reports.noticeable_study.rows import NoticedRow, read_parquet, write_parquet
from xfrustum.reports.noticeable_study.run import measure, replays_hash
from xfrustum.reports.splitting_study.run import measured_by
from xfrustum.reports.splitting_study.store import Store
from xfrustum.reports.studies.origin import Origin

DEFAULT_FOLDER = Path("study") / "noticeable"
PLANS = "plans-car.png"
"""Picture of both plans for the car, which scripts/draw_eye_figures.py draws into the folder of figures."""

DOCUMENT, DATA, RESULTS, IMAGES = "noticeable.md", "noticeable.parquet", "measurements.sqlite", "images"


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
class StudyFiles(Summarized[StudyRecord]):
    """What a study left behind.

    Attributes
    ----------
    document, data
        Markdown and Parquet.
    figures
        SVG files.
    rows
        Every answer.
    origin
        What measured the replays.
    """

    document: Path
    data: Path
    figures: tuple[Path, ...]
    rows: tuple[NoticedRow, ...]
    origin: Origin

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
    out = DEFAULT_FOLDER if out is None else out
    with Staging(out, (DOCUMENT, DATA, RESULTS)), Staging(out / IMAGES):
        pass  # It can be written; nothing is left lying about while it is being measured.
    measured_with = measured_by()
    with Store(out / RESULTS, replays_hash(measured_with)) as store:
        rows = measure(grid, store, progress=progress)
    return write_study(rows, measured_with, out)


def rewrite_document(folder: Path) -> Path:
    """Write document and figures of a folder again, from the data that lie there; nothing is measured.

    Raises
    ------
    InputError
        An unwritable folder.
    """
    rows, origin = read_parquet(folder / DATA)
    return write_study(rows, origin, folder).document


def _document(rows: Sequence[NoticedRow], origin: Origin, out: Path) -> str:
    return document(rows, origin, pictured=(out / IMAGES / PLANS).exists())


def write_study(rows: Sequence[NoticedRow], origin: Origin, out: Path) -> StudyFiles:
    """Write document, figures and data of some rows; the data goes first and the document last."""
    with Staging(out / IMAGES) as staging:
        for name, drawn in figures(rows).items():
            (staging.folder / f"{name}.svg").write_text(drawn, encoding="utf-8")
        drawn_files = staging.commit()
    with Staging(out, (DOCUMENT, DATA)) as staging:
        write_parquet(rows, origin, staging.folder / DATA)
        # From what is in the file, so that the file alone gives the same document again.
        rows, origin = read_parquet(staging.folder / DATA)
        (staging.folder / DOCUMENT).write_text(_document(rows, origin, out), encoding="utf-8")
        staging.commit()
    return StudyFiles(
        document=out / DOCUMENT, data=out / DATA, figures=drawn_files, rows=tuple(rows), origin=origin
    )
