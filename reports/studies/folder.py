"""The folder of a study: probed before the work, and its document written with figures and data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from xfrustum.reports.common.outputs import Staging, check_writable_folder
from xfrustum.reports.studies.origin import Origin
from xfrustum.reports.studies.rows import read_rows, write_rows

Row = TypeVar("Row")

RESULTS, IMAGES = "measurements.sqlite", "images"
"""Names of the file of results and of the folder of figures."""


@dataclass(frozen=True, kw_only=True)
class WrittenStudy(Generic[Row]):
    """What a study left behind.

    Attributes
    ----------
    document, data
        Markdown and Parquet.
    figures
        SVG files.
    rows
        Everything measured.
    origin
        What measured it.
    """

    document: Path
    data: Path
    figures: tuple[Path, ...]
    rows: tuple[Row, ...]
    origin: Origin


@dataclass(frozen=True, kw_only=True)
class StudyFolder(Generic[Row]):
    """The folder of a study, whether or not it exists yet.

    Attributes
    ----------
    out
        Folder.
    document, data
        Names of the document and of the data.
    row
        Dataclass of the study's rows.
    """

    out: Path
    document: str
    data: str
    row: type[Row]

    @property
    def results(self) -> Path:
        """The file of results, whatever folder a worker runs in."""
        return self.out.absolute() / RESULTS

    def check_writable(self) -> None:
        """Raise InputError unless the study can be written; nothing is left lying about while it is measured.

        Raises
        ------
        InputError
            See `Staging`.
        """
        check_writable_folder(self.out, (self.document, self.data, RESULTS))
        check_writable_folder(self.out / IMAGES)

    def read(self) -> tuple[tuple[Row, ...], Origin]:
        """Return the rows that lie there, and what measured them."""
        return read_rows(self.row, self.out / self.data)

    def write(
        self,
        rows: Sequence[Row],
        origin: Origin,
        figures: Mapping[str, str],
        document: Callable[[Sequence[Row], Origin], str],
    ) -> WrittenStudy[Row]:
        """Write figures, data and document.

        The data goes first and the document last: what a document refers to is there.

        Parameters
        ----------
        rows, origin
            Everything measured, and what measured it.
        figures
            SVG documents by the names of their files without ending.
        document
            Function that makes the document of rows and their origin.

        Raises
        ------
        InputError
            See `Staging`.
        """
        with Staging(self.out / IMAGES) as staging:
            for name, drawn in figures.items():
                (staging.folder / f"{name}.svg").write_text(drawn, encoding="utf-8")
            drawn_files = staging.commit()
        with Staging(self.out, (self.document, self.data)) as staging:
            write_rows(self.row, rows, origin, staging.folder / self.data)
            # From what is in the file, so that the file alone gives the same document again.
            filed, origin = read_rows(self.row, staging.folder / self.data)
            (staging.folder / self.document).write_text(document(filed, origin), encoding="utf-8")
            staging.commit()
        return WrittenStudy(
            document=self.out / self.document,
            data=self.out / self.data,
            figures=drawn_files,
            rows=filed,
            origin=origin,
        )
